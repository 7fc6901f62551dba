"""Closed loops: their constraints, how they are chosen and followed."""
