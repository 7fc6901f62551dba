"""Readers of robots' files: TOML, URDF, MJCF, and Pinocchio's models."""
