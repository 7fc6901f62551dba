"""Transforms of descriptions: joined, snapped to right angles, on a floating base."""
