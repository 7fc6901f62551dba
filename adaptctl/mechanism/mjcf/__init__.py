"""MJCF, MuJoCo's format."""

from adaptctl.mechanism.mjcf.reader import read_mjcf

__all__ = ["read_mjcf"]
