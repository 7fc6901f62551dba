"""Recursions over links."""
