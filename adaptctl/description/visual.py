"""Shapes of links for drawing: meshes and plain solids, fixed to them. Nothing of it moves anything."""

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
    """Triangles in a file, its lengths times `scale` in m; a negative one mirrors."""

    path: Path
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        if not all(math.isfinite(s) and s != 0.0 for s in self.scale):
            raise InputError(f"mesh {self.path.name}: scale: expected finite numbers other than zero, got {self.scale}")


@dataclass(frozen=True)
class Box:
    """A box about its frame's origin, its edges (m) along the axes."""

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        _require_positive("box", self.size)


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about its frame's origin, along z; m."""

    radius: float
    length: float

    def __post_init__(self) -> None:
        _require_positive("cylinder", (self.radius, self.length))


@dataclass(frozen=True)
class Sphere:
    """A sphere about its frame's origin; m."""

    radius: float

    def __post_init__(self) -> None:
        _require_positive("sphere", (self.radius,))


Solid = Mesh | Box | Cylinder | Sphere


@dataclass(frozen=True)
class Visual:
    """A solid fixed to a link, the index of which is -1 for what stands on the ground; `pose` is in its frame.

    Without a colour it has its mesh's own, or the one that a picture gives to links.
    """

    link: int
    pose: Pose
    solid: Solid
    color: Color | None = None

    def on(self, link: int, pose: Pose) -> Visual:
        """The same fixed to another link, on which the frame that carried it is at `pose`."""
        return replace(self, link=link, pose=pose @ self.pose)


def _require_positive(what: str, lengths: tuple[float, ...]) -> None:
    if not all(math.isfinite(length) and length > 0.0 for length in lengths):
        raise InputError(f"{what}: expected positive lengths, got {lengths}")
