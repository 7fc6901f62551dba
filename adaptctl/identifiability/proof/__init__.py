"""Ranks that are proved."""
