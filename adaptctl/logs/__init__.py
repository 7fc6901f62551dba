"""Logs of robots as tables, whatever their format."""
