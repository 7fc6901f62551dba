"""Right angles between joint axes: nearly right ones, and exact ones made of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.link import GROUND, Link
from adaptctl.description.pose import Pose, exact_right_angles

if TYPE_CHECKING:
    from adaptctl.description.loops import Closure

NEAR_RIGHT_ANGLE = 1e-3
"""rad, to a multiple of 90 degrees, below which a miss is suspicious"""
ROUNDED_ANGLE = 1e-4
"""rad, to a multiple of 90 degrees: four decimals of radians miss by up to 5e-5, two of degrees by up to 8.7e-5"""
EXACT_RIGHT_ANGLE = 1e-11
"""rad, to a multiple of 90 degrees, below which it counts as reached: 1.57079632679 misses by 5e-12"""


@dataclass(frozen=True)
class NearRightAngle:
    """
    Angle between successive joint axes that is nearly, but not exactly, a multiple of 90 degrees.

    Nearly means within 1e-3 rad. Nothing is checked at construction.

    Parameters
    ----------
    parent : str
        Name of the preceding joint, or "gravity" for a joint on the ground.
    child : str
        Name of the joint.
    degrees : int
        Nearest multiple of 90 degrees: 0, 90 or 180.
    deviation : float
        Angle minus that multiple, in rad.

    Examples
    --------
    >>> from adaptctl.identifiability import NearRightAngle
    >>> print(NearRightAngle("shoulder", "elbow", 90, 2e-5))  # doctest: +ELLIPSIS
    shoulder and elbow are 2.0e-05 rad from 90 degrees
    """

    parent: str
    child: str
    degrees: int
    deviation: float

    def __str__(self) -> str:
        return f"{self.parent} and {self.child} are {abs(self.deviation):.1e} rad from {self.degrees} degrees"


def near_right_angles(description: Description, exact: float = EXACT_RIGHT_ANGLE) -> tuple[NearRightAngle, ...]:
    """Return the angles of successive joint axes that miss a right angle by more than `exact` rad."""
    meeting = list(meeting_axes(description))
    if not meeting:
        return ()
    axes = np.array([pair for _, _, pair in meeting])
    first, second = axes[:, 0], axes[:, 1]
    # The arc tangent is exact at all angles; the arc cosine loses half the digits near 0.
    angles = np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), np.sum(first * second, axis=1))
    quarters = np.round(angles / (np.pi / 2)).astype(int)
    misses = angles - quarters * (np.pi / 2)
    near = np.flatnonzero((exact < np.abs(misses)) & (np.abs(misses) < NEAR_RIGHT_ANGLE)).tolist()
    pairs = ((meeting[i], i) for i in near)
    return tuple(
        NearRightAngle(parent, link.joint.name, 90 * int(quarters[i]), float(misses[i]))
        for (link, parent, _), i in pairs
    )


def snapped(description: Description, tolerance: float = NEAR_RIGHT_ANGLE) -> Description:
    """
    Round nearly right angles between successive joint axes to exact multiples of 90 degrees.

    Parameters
    ----------
    description : Description
        Description of the mechanism, for example from a file with rounded angles.
    tolerance : float, default 1e-3
        Largest deviation of an angle in rad from a multiple of 90 degrees that is rounded.

    Returns
    -------
    Description
        The mechanism with exact frames and axes, also relative to gravity. Link origins move by at most `tolerance`
        times the chain's length; limits and inertias in the links' frames stay.

    Examples
    --------
    >>> from adaptctl.description import snapped
    >>> snapped(arm.description).links[0].joint.axis.tolist()
    [0.0, 0.0, 1.0]
    """
    links: list[Link] = []
    for link in description.links:
        straight = _straightened(link, tolerance)
        carrier = _carrier(description, links, straight)
        links.append(straight if carrier is None else _turned(carrier[1], straight, tolerance))
    loops = description.loops
    if loops is not None:
        loops = replace(loops, closures=tuple(_closure(closure, tolerance) for closure in loops.closures))
    return replace(description, links=tuple(links), loops=loops)


def meeting_axes(description: Description) -> Iterator[tuple[Link, str, tuple[Array, Array]]]:
    """Triples (link, name, axes) of a mechanism's `description` in the links' order."""
    for link in description.links:
        carrier = _carrier(description, description.links, link)
        if carrier is not None:
            yield link, carrier[0], (carrier[1], link.parent_to_joint.rotation @ link.joint.axis)


def _carrier(description: Description, links: Sequence[Link], link: Link) -> tuple[str, Array] | None:
    """Axis that a joint's angle is measured from (parent's joint or gravity), with its name, or None."""
    if link.parent != GROUND:
        parent = links[link.parent]
        return parent.joint.name, parent.joint_to_link.rotation.T @ parent.joint.axis
    strength = float(np.linalg.norm(description.gravity))
    return ("gravity", description.gravity / strength) if strength > 0.0 else None


def _straightened(link: Link, tolerance: float) -> Link:
    """Link whose frames and axis are nearly on axes of what carries them, put onto these."""
    axis, unit = link.joint.axis, np.round(link.joint.axis)
    near_unit = np.abs(unit).sum() == 1.0 and np.linalg.norm(axis - unit) < tolerance
    joint = replace(link.joint, axis=unit) if near_unit else link.joint
    return replace(
        link,
        joint=joint,
        parent_to_joint=_pose(link.parent_to_joint, tolerance),
        joint_to_link=_pose(link.joint_to_link, tolerance),
    )


def _pose(pose: Pose, tolerance: float) -> Pose:
    rounded = np.round(pose.rotation) + 0.0
    is_turn = np.array_equal(np.abs(rounded).sum(0), np.ones(3)) and np.linalg.det(rounded) > 0.0
    if is_turn and np.abs(pose.rotation - rounded).max() < tolerance:
        return Pose(rounded, pose.translation)
    return pose


def _closure(closure: Closure, tolerance: float) -> Closure:
    first, second = _pose(closure.first_frame, tolerance), _pose(closure.second_frame, tolerance)
    return replace(closure, first_frame=first, second_frame=second)


def _turned(first: Array, child: Link, tolerance: float) -> Link:
    second = child.parent_to_joint.rotation @ child.joint.axis
    along = float(first @ second)
    across = second - along * first
    if np.linalg.norm(across) < tolerance:
        meant = np.copysign(1.0, along) * first
    elif abs(along) < tolerance:
        meant = across / np.linalg.norm(across)
    else:
        return child
    rotation = exact_right_angles(_shortest_turn(second, meant) @ child.parent_to_joint.rotation, 1e-14)
    return replace(child, parent_to_joint=Pose(rotation, child.parent_to_joint.translation))


def _shortest_turn(start: Array, end: Array) -> Array:
    x, y, z = np.cross(start, end)
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + hat + hat @ hat / (1.0 + float(start @ end))
