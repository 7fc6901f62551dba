"""Shapes by which a mechanism is drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import Link
from adaptctl.description.reach import MIN_LENGTH, attachments, chain_reach, depths, joint_line, link_end
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.recording.drawing import thinned

# Radii of the first and the last link as shares of the reach.
ROOT_RADIUS, TIP_RADIUS = 0.062, 0.026


class Solid(Enum):
    """Kinds of round solids: capsule along a link, cylinder about a joint's axis, ball at the tip."""

    LINK = "link"
    JOINT = "joint"
    TOOL = "tool"


@dataclass(frozen=True, eq=False)
class Shape:
    """Round solid fixed to a link: ends (3,) of its axis in the link's frame and radius, in m."""

    link: int
    solid: Solid
    start: Array
    end: Array
    radius: float

    @property
    def length(self) -> float:
        """Length of the solid's axis in m."""
        return float(np.linalg.norm(self.end - self.start))


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Round solids of a mechanism, its reach (m) from first joint to tip, and the tip's link and position."""

    shapes: tuple[Shape, ...]
    reach: float
    tip_link: int
    tip: Array


def skeleton(mechanism: Mechanism) -> Skeleton:
    """Skeleton of a mechanism."""
    links = mechanism.links
    ends = attachments(mechanism.description)
    deep = np.array(depths(link.parent for link in links)) - 1
    tip_link = int(np.argmax(deep))
    tip, reach = link_end(links[tip_link]), chain_reach(links, tip_link) or 1.0
    slimness = deep / max(float(deep.max()), 1.0)
    radii = reach * (ROOT_RADIUS + slimness * (TIP_RADIUS - ROOT_RADIUS))
    shapes = [shape for i in range(len(links)) for shape in _link_shapes(links, i, ends[i], float(radii[i]))]
    tool = Shape(tip_link, Solid.TOOL, tip, tip, 1.15 * TIP_RADIUS * reach)
    parts = Skeleton((*shapes, tool), reach, tip_link, tip)
    # What hangs behind locked joints, a wrist or a hand, is a frame of the last link.
    frames = [frame.pose.translation for frame in mechanism.description.frames if frame.link == tip_link]
    farthest = max(frames, key=lambda place: float(np.linalg.norm(place - tip)), default=tip)
    return with_tip(parts, tip_link, farthest) if np.linalg.norm(farthest - tip) > MIN_LENGTH else parts


def with_tip(parts: Skeleton, link: int, tip: Array) -> Skeleton:
    """Skeleton with another tip (3,) in a link's frame, reached by a capsule."""
    start = parts.tip if link == parts.tip_link else np.zeros(3)
    body = [shape for shape in parts.shapes if shape.solid is not Solid.TOOL]
    ball = max(shape.radius for shape in parts.shapes if shape.solid is Solid.TOOL)
    radius = min((shape.radius for shape in body if shape.solid is Solid.LINK), default=ball)
    arm = Shape(link, Solid.LINK, start, tip, radius)
    reach = parts.reach + arm.length
    return Skeleton((*body, arm, Shape(link, Solid.TOOL, tip, tip, ball)), reach, link, tip)


def tip_path(parts: Skeleton, rotations: Array, translations: Array) -> Array:
    """Positions (..., 3) of the tip in m in the world's frame, from the poses of the links."""
    return translations[..., parts.tip_link, :] + rotations[..., parts.tip_link, :, :] @ parts.tip


def _link_shapes(links: tuple[Link, ...], index: int, ends: Sequence[Array], radius: float) -> Iterator[Shape]:
    link = links[index]
    start, axis = joint_line(link)
    for goal in ends:
        corner = start + axis * float(axis @ (goal - start))
        for a, b in ((start, corner), (corner, goal)):
            if np.linalg.norm(b - a) > MIN_LENGTH:
                yield Shape(index, Solid.LINK, a, b, radius)
    half = (1.25 if link.joint.kind.is_revolute else 2.5) * radius * axis
    yield Shape(index, Solid.JOINT, start - half, start + half, 1.2 * radius)


# Largest number of positions looked at.
MAX_POSITIONS = 200
# Share of a camera's distance, beside its axis, up to which rerun's viewer shows things: tan of half its angle.
VIEW_SLOPE = 0.5


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """Camera's position (3,) and target (3,), and the floor's height, in m in the world's frame."""

    eye: Array
    target: Array
    floor: float

    @classmethod
    def of(cls, mechanism: Mechanism, parts: Skeleton, p: Array) -> Viewpoint:
        """Viewpoint from a mechanism's side that sees all of it along positions (T, r)."""
        poses = link_poses(mechanism, p[thinned(len(p), MAX_POSITIONS)])
        origins, places = poses.translations, np.concatenate(poses.translations)
        center = (places.min(axis=0) + places.max(axis=0)) / 2.0
        feet = np.array([link.parent_to_joint.translation for link in mechanism.links if link.parent < 0])
        outward = feet[-1] - feet[0] if len(feet) > 1 else origins[:, parts.tip_link].mean(axis=0)
        azimuth = float(np.arctan2(outward[1], outward[0])) - 1.1
        away = np.array([np.cos(azimuth), np.sin(azimuth), 0.4])
        target = center - np.array([0.0, 0.0, 0.15 * parts.reach])
        apart = float(np.linalg.norm(feet.max(axis=0) - feet.min(axis=0)))
        width = 1.4 * max(parts.reach, apart + 0.5 * parts.reach) * float(np.linalg.norm(away))
        moved = np.concatenate([places, tip_path(parts, *poses)]) - target
        toward = away / np.linalg.norm(away)
        distance = max(width, _distance_to_see(moved, toward))
        return cls(target + distance * toward, target, floor_height(mechanism, parts, p))


def _distance_to_see(points: Array, toward: Array) -> float:
    """Distance (m) of a camera in a direction (3,) that sees all points (n, 3) around the origin."""
    along = points @ toward
    beside = np.linalg.norm(points - along[:, None] * toward, axis=1)
    return float(np.max(along + beside / VIEW_SLOPE))


def floor_height(mechanism: Mechanism, parts: Skeleton, p: Array) -> float:
    """Height (m) of the floor: 0 where the mechanism stays above, else below its lowest link."""
    heights = link_poses(mechanism, p[thinned(len(p), MAX_POSITIONS)]).translations[..., 2]
    lowest = min(float(heights.min()), float(mechanism.links[0].parent_to_joint.translation[2]))
    return 0.0 if lowest > 0.0 else lowest - 0.6 * parts.reach
