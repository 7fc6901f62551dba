"""Shapes of links for drawing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

from adaptctl.description.pose import Pose
from adaptctl.errors import InputError

Color = tuple[float, float, float, float]
"""Red, green, blue and opacity, from 0 to 1."""


@dataclass(frozen=True)
class Mesh:
    """Mesh of triangles for drawing, in the file at `path`."""

    path: Path
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        if not all(math.isfinite(s) and s != 0.0 for s in self.scale):
            raise InputError(f"mesh {self.path.name}: scale: expected finite numbers other than zero, got {self.scale}")


@dataclass(frozen=True)
class Box:
    """Box for drawing, of edge lengths (3,) in m."""

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        _validate_positive("box", self.size)


@dataclass(frozen=True)
class Cylinder:
    """Cylinder for drawing, its axis along z, with lengths in m."""

    radius: float
    length: float

    def __post_init__(self) -> None:
        _validate_positive("cylinder", (self.radius, self.length))


@dataclass(frozen=True)
class Sphere:
    """Sphere for drawing, centred at its frame's origin, of a `radius` (m)."""

    radius: float

    def __post_init__(self) -> None:
        _validate_positive("sphere", (self.radius,))


Solid = Mesh | Box | Cylinder | Sphere


@dataclass(frozen=True)
class Visual:
    """Shape for drawing, fixed to a link (-1 for the ground)."""

    link: int
    pose: Pose
    solid: Solid
    color: Color | None = None

    def on(self, link: int, pose: Pose) -> Visual:
        """Copy of this shape fixed to another link."""
        return replace(self, link=link, pose=pose @ self.pose)


def _validate_positive(what: str, lengths: tuple[float, ...]) -> None:
    if not all(math.isfinite(length) and length > 0.0 for length in lengths):
        raise InputError(f"{what}: expected positive lengths, got {lengths}")
