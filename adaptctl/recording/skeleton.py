"""Shapes that stand for a mechanism: capsules along its links, cylinders about its joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import Link
from adaptctl.description.reach import SHORTEST, attachments, chain_reach, depths, joint_line, link_end
from adaptctl.dynamics import Mechanism

ROOT_RADIUS, TIP_RADIUS = 0.062, 0.026
"""Radii of the first and the last link as shares of the reach."""


class Solid(Enum):
    """Enumeration of the kinds of round solids by which a mechanism is drawn: LINK, a capsule along a link; JOINT, a
    cylinder about a joint's axis; TOOL, a ball at the tip. The value is the last part of the entity path in recordings:
    "link", "joint", "tool"."""

    LINK = "link"
    JOINT = "joint"
    TOOL = "tool"


@dataclass(frozen=True, eq=False)
class Shape:
    """Round solid by which a link is drawn, fixed to the link of zero-based index `link`: `solid` is its kind, `start`
    and `end` (3,), m in the link's frame, are the ends of its axis, one point for a ball, and `radius`, m, is its
    radius. Nothing is checked at construction."""

    link: int
    solid: Solid
    start: Array
    end: Array
    radius: float

    @property
    def length(self) -> float:
        """Length of the solid's axis, from `start` to `end`, m; 0 for a ball."""
        return float(np.linalg.norm(self.end - self.start))


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Skeleton of a mechanism, by which it is drawn where its file has no shapes. `shapes` are its round solids;
    `reach`, m, is the length of the chain of links from the first joint to the tip. The tip, the point whose path is
    shown, is given by the zero-based index `tip_link` of its link and its position `tip` (3,), m in that link's frame.
    Nothing is checked at construction."""

    shapes: tuple[Shape, ...]
    reach: float
    """m, along the chain from the first joint to the tip"""
    tip_link: int
    tip: Array
    """(3,) in the tip link's frame"""


def skeleton(mechanism: Mechanism) -> Skeleton:
    """The skeleton of a mechanism, a `Skeleton`: capsules along its links, from each joint to the next, cylinders about
    its joints' axes, and a ball at the tip, the end of the link with most links before it (of several, the first). A
    capsule goes along the joint's axis first, then at a right angle to it, as an arm's shoulder does. Lengths are in m;
    radii grow with the reach. Nothing is raised."""
    links = mechanism.links
    ends = attachments(mechanism.description)
    deep = np.array(depths(link.parent for link in links)) - 1
    tip_link = int(np.argmax(deep))
    tip, reach = link_end(links[tip_link]), chain_reach(links, tip_link) or 1.0
    slimness = deep / max(float(deep.max()), 1.0)
    radii = reach * (ROOT_RADIUS + slimness * (TIP_RADIUS - ROOT_RADIUS))
    shapes = [shape for i in range(len(links)) for shape in _link_shapes(links, i, ends[i], float(radii[i]))]
    tool = Shape(tip_link, Solid.TOOL, tip, tip, 1.15 * TIP_RADIUS * reach)
    return Skeleton((*shapes, tool), reach, tip_link, tip)


def with_tip(parts: Skeleton, link: int, tip: Array) -> Skeleton:
    """The skeleton `parts` with another tip: the point `tip` (3,), m in the frame of the link of zero-based index
    `link`. A capsule is added that reaches it, from the old tip where that was on the same link, else from the link's
    origin, and its length is added to the reach; the ball moves to the new tip. Raises `ValueError` for a skeleton
    without a capsule or without a ball."""
    start = parts.tip if link == parts.tip_link else np.zeros(3)
    body = [shape for shape in parts.shapes if shape.solid is not Solid.TOOL]
    ball = max(shape.radius for shape in parts.shapes if shape.solid is Solid.TOOL)
    arm = Shape(link, Solid.LINK, start, tip, min(shape.radius for shape in body if shape.solid is Solid.LINK))
    reach = parts.reach + arm.length
    return Skeleton((*body, arm, Shape(link, Solid.TOOL, tip, tip, ball)), reach, link, tip)


def tip_path(parts: Skeleton, rotations: Array, translations: Array) -> Array:
    """Positions (..., 3) of a mechanism's tip, m in the world's frame, from the poses of its N links in the world. The
    poses are `rotations` (..., N, 3, 3) and `translations` (..., N, 3), m, in the order of `Mechanism.links`, the
    ground not among them, leading axes being samples. `parts` is the skeleton, which has the tip's position in its
    link. Raises `IndexError` where there are fewer links than the tip's index needs."""
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
