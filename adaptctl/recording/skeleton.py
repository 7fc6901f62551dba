"""Shapes that stand for a mechanism: capsules along its links, cylinders about its joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import GROUND, Link
from adaptctl.description.reach import SHORTEST, attachments, chain_reach, joint_line, link_end
from adaptctl.dynamics import Mechanism

ROOT_RADIUS, TIP_RADIUS = 0.062, 0.026
"""Radii of the first and the last link as shares of the reach."""


class Solid(Enum):
    """Kinds of shapes: a link's, a joint's, and the tool at the tip."""

    LINK = "link"
    JOINT = "joint"
    TOOL = "tool"


@dataclass(frozen=True, eq=False)
class Shape:
    """Round solid fixed to a link, from `start` to `end` (3,) in that link's frame; lengths in m."""

    link: int
    solid: Solid
    start: Array
    end: Array
    radius: float

    @property
    def length(self) -> float:
        """Distance from start to end, m."""
        return float(np.linalg.norm(self.end - self.start))


@dataclass(frozen=True, eq=False)
class Skeleton:
    """The skeleton of a mechanism: its shapes, and the point (tip) whose path is of interest."""

    shapes: tuple[Shape, ...]
    reach: float
    """m, along the chain from the first joint to the tip"""
    tip_link: int
    tip: Array
    """(3,) in the tip link's frame"""


def skeleton(mechanism: Mechanism) -> Skeleton:
    """Shapes of a mechanism: its offsets between joints, and its joints' axes.

    An offset goes along the joint's axis first and square to it then, as an arm's shoulder does.
    """
    links = mechanism.links
    ends = attachments(mechanism.description)
    depths = _depths(links)
    tip_link = int(np.argmax(depths))
    tip, reach = link_end(links[tip_link]), chain_reach(links, tip_link) or 1.0
    slimness = depths / max(float(depths.max()), 1.0)
    radii = reach * (ROOT_RADIUS + slimness * (TIP_RADIUS - ROOT_RADIUS))
    shapes = [shape for i in range(len(links)) for shape in _link_shapes(links, i, ends[i], float(radii[i]))]
    tool = Shape(tip_link, Solid.TOOL, tip, tip, 1.15 * TIP_RADIUS * reach)
    return Skeleton((*shapes, tool), reach, tip_link, tip)


def with_tip(parts: Skeleton, link: int, tip: Array) -> Skeleton:
    """Skeleton with another point (3,) of a link as its tip, to which that link then reaches."""
    start = parts.tip if link == parts.tip_link else np.zeros(3)
    body = [shape for shape in parts.shapes if shape.solid is not Solid.TOOL]
    ball = max(shape.radius for shape in parts.shapes if shape.solid is Solid.TOOL)
    arm = Shape(link, Solid.LINK, start, tip, min(shape.radius for shape in body if shape.solid is Solid.LINK))
    reach = parts.reach + arm.length
    return Skeleton((*body, arm, Shape(link, Solid.TOOL, tip, tip, ball)), reach, link, tip)


def tip_path(parts: Skeleton, rotations: Array, translations: Array) -> Array:
    """Positions (..., 3) of the tip in the world for link rotations (..., N, 3, 3) and origins (..., N, 3)."""
    return translations[..., parts.tip_link, :] + rotations[..., parts.tip_link, :, :] @ parts.tip


def _link_shapes(links: tuple[Link, ...], index: int, ends: Sequence[Array], radius: float) -> Iterator[Shape]:
    link = links[index]
    start, axis = joint_line(link)
    for goal in ends:
        corner = start + axis * float(axis @ (goal - start))
        for a, b in ((start, corner), (corner, goal)):
            if np.linalg.norm(b - a) > SHORTEST:
                yield Shape(index, Solid.LINK, a, b, radius)
    half = (1.25 if link.joint.kind.turns else 2.5) * radius * axis
    yield Shape(index, Solid.JOINT, start - half, start + half, 1.2 * radius)


def _depths(links: tuple[Link, ...]) -> NDArray[np.int64]:
    """Number of links before each link (N,); parents come before their children."""
    depths = np.zeros(len(links), dtype=np.int64)
    for i, link in enumerate(links):
        depths[i] = 0 if link.parent == GROUND else depths[link.parent] + 1
    return depths
