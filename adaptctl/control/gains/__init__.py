"""Gains of the tracking loop."""
