"""Right angles that a file meant but rounded: 1.5708 for pi/2, or a CAD export's last digits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import GROUND, Description, Link
from adaptctl.description.pose import Pose, exact_right_angles

if TYPE_CHECKING:
    from adaptctl.description.loops import Closure

WITHIN = 1e-3
"""rad"""


def snapped(description: Description, within: float = WITHIN) -> Description:
    """A copy of a mechanism's `description` with nearly right angles made exact: those between successive joint axes,
    and between gravity and the axes of joints on the ground, that are within `within` (rad, 1e-3 by default) of a
    multiple of 90 degrees.

    Link and joint frames whose rotation matrix has all entries within `within` of 0 or +-1 get exactly these entries,
    and joint axes that near to a coordinate axis become that axis. Axes that still meet another at nearly a right
    angle, or are nearly parallel to it, are turned with their joint, and with the links behind it, whose origins move
    by at most `within` times the chain's length. Frames of loop closures are made exact like link frames. Limits,
    inertias in their links' frames and names stay. `within` is not checked.
    """
    links: list[Link] = []
    for link in description.links:
        straight = _straightened(link, within)
        carrier = _carrier(description, links, straight)
        links.append(straight if carrier is None else _turned(carrier[1], straight, within))
    loops = description.loops
    if loops is not None:
        loops = replace(loops, closures=tuple(_closure(closure, within) for closure in loops.closures))
    return replace(description, links=tuple(links), loops=loops)


def meeting_axes(description: Description) -> Iterator[tuple[Link, str, tuple[Array, Array]]]:
    """Triples (link, name, axes) of a mechanism's `description` in the links' order: a link, the name of the joint
    before its own, and the axes of these two joints, unit vectors (3,), in the frame of the link's parent. For a link
    on the ground the name is "gravity", the first axis is gravity's direction, and the frame is the ground's; without
    gravity such a link is left out. Nothing is raised."""
    for link in description.links:
        carrier = _carrier(description, description.links, link)
        if carrier is not None:
            yield link, carrier[0], (carrier[1], link.near.rotation @ link.joint.axis)


def _carrier(description: Description, links: Sequence[Link], link: Link) -> tuple[str, Array] | None:
    """Name of the axis that a joint's angle is measured from (the parent's joint, or gravity), and its direction in the
    frame that carries the joint; None without either."""
    if link.parent != GROUND:
        parent = links[link.parent]
        return parent.joint.name, parent.far.rotation.T @ parent.joint.axis
    strength = float(np.linalg.norm(description.gravity))
    return ("gravity", description.gravity / strength) if strength > 0.0 else None


def _straightened(link: Link, within: float) -> Link:
    """A link whose frames and axis are turned onto the axes of what carries them, where they nearly are on them."""
    axis, unit = link.joint.axis, np.round(link.joint.axis)
    near_unit = np.abs(unit).sum() == 1.0 and np.linalg.norm(axis - unit) < within
    joint = replace(link.joint, axis=unit) if near_unit else link.joint
    return replace(link, joint=joint, near=_pose(link.near, within), far=_pose(link.far, within))


def _pose(pose: Pose, within: float) -> Pose:
    rounded = np.round(pose.rotation) + 0.0
    is_turn = np.array_equal(np.abs(rounded).sum(0), np.ones(3)) and np.linalg.det(rounded) > 0.0
    if is_turn and np.abs(pose.rotation - rounded).max() < within:
        return Pose(rounded, pose.translation)
    return pose


def _closure(closure: Closure, within: float) -> Closure:
    first, second = _pose(closure.first_frame, within), _pose(closure.second_frame, within)
    return replace(closure, first_frame=first, second_frame=second)


def _turned(first: Array, child: Link, within: float) -> Link:
    """The child's joint turned until its axis makes the angle with a direction `first` that it nearly makes."""
    second = child.near.rotation @ child.joint.axis
    along = float(first @ second)
    across = second - along * first
    if np.linalg.norm(across) < within:
        meant = np.copysign(1.0, along) * first
    elif abs(along) < within:
        meant = across / np.linalg.norm(across)
    else:
        return child
    rotation = exact_right_angles(_shortest_turn(second, meant) @ child.near.rotation, 1e-14)
    return replace(child, near=Pose(rotation, child.near.translation))


def _shortest_turn(start: Array, end: Array) -> Array:
    """The rotation by the least angle that takes one unit vector to another that is near it."""
    x, y, z = np.cross(start, end)
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + hat + hat @ hat / (1.0 + float(start @ end))
