"""MJCF, MuJoCo's format."""

from adaptctl.description.readers.mjcf.reader import read_mjcf

__all__ = ["read_mjcf"]
