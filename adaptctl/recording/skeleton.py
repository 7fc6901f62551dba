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
from adaptctl.dynamics.recursion.kinematics import link_poses

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
    tip_link: int
    tip: Array


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
    half = (1.25 if link.joint.kind.is_revolute else 2.5) * radius * axis
    yield Shape(index, Solid.JOINT, start - half, start + half, 1.2 * radius)


POSITIONS = 200
"""At most as many positions are looked at."""
SEEN = 0.5
"""Share of a camera's distance, beside its axis, up to which rerun's viewer shows things: tan of half its angle."""


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """Camera's viewpoint of a mechanism: `eye` (3,), the camera's position, `target` (3,), the point that it looks at,
    and `floor`, the height of the floor along z, all in m in the world's frame. Nothing is checked at construction."""

    eye: Array
    target: Array
    floor: float

    @classmethod
    def of(cls, mechanism: Mechanism, parts: Skeleton, p: Array) -> Viewpoint:
        """The viewpoint, from a mechanism's side, from which all of it is seen along its motion: positions `p` (T, r),
        rad (m if prismatic), of r joints at T samples, at least one, of which at most 200 are looked at. `parts` are
        the shapes it is drawn by. Raises `InputError` for positions of another number of joints, `NonFiniteError` for
        NaN and infinity, `LoopError` where kinematic loops cannot be closed, `SingularityError` near a singularity of
        these, `IndexError` for no positions."""
        poses = link_poses(mechanism, p[:: max(1, -(-len(p) // POSITIONS))])
        origins = poses.translations
        tips = origins[:, parts.tip_link] + poses.rotations[:, parts.tip_link] @ parts.tip
        center = (origins.reshape(-1, 3).min(axis=0) + origins.reshape(-1, 3).max(axis=0)) / 2.0
        feet = np.array([link.parent_to_joint.translation for link in mechanism.links if link.parent < 0])
        outward = feet[-1] - feet[0] if len(feet) > 1 else origins[:, parts.tip_link].mean(axis=0)
        azimuth = float(np.arctan2(outward[1], outward[0])) - 1.1
        away = np.array([np.cos(azimuth), np.sin(azimuth), 0.4])
        target = center - np.array([0.0, 0.0, 0.15 * parts.reach])
        apart = float(np.linalg.norm(feet.max(axis=0) - feet.min(axis=0)))
        width = 1.4 * max(parts.reach, apart + 0.5 * parts.reach) * float(np.linalg.norm(away))
        moved = np.concatenate([origins.reshape(-1, 3), tips]) - target
        toward = away / np.linalg.norm(away)
        distance = max(width, _distance_to_see(moved, toward))
        return cls(target + distance * toward, target, floor_height(mechanism, parts, p))


def _distance_to_see(points: Array, toward: Array) -> float:
    """Distance (m) of a camera in a direction (3,), a unit vector, that sees all points (n, 3) around the origin."""
    along = points @ toward
    beside = np.linalg.norm(points - along[:, None] * toward, axis=1)
    return float(np.max(along + beside / SEEN))


def floor_height(mechanism: Mechanism, parts: Skeleton, p: Array) -> float:
    """Height of the floor under a mechanism, m along z in the world's frame. It is 0 where the origins of all links'
    frames stay above z = 0, else below the lowest of them and of the first joint, by 0.6 of the length of the chain of
    links to the tip. `p` (T, r) are the positions, rad (m if prismatic), of r joints at T samples, at least one, of
    which at most 200 are looked at; `parts` are the shapes it is drawn by.

    Raises `InputError` for positions of another number of joints, `NonFiniteError` for NaN and infinity, `LoopError`
    where kinematic loops cannot be closed, `SingularityError` near a singularity of these.
    """
    heights = link_poses(mechanism, p[:: max(1, -(-len(p) // POSITIONS))]).translations[..., 2]
    lowest = min(float(heights.min()), min(link.parent_to_joint.translation[2] for link in mechanism.links[:1]))
    return 0.0 if lowest > 0.0 else lowest - 0.6 * parts.reach
