"""Closed loops: constraints, assembly and continuation."""
