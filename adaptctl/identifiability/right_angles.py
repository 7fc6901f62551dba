"""Axes that are almost, but not quite, parallel or perpendicular: usually a rounded pi/2 in a file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.mechanism import GROUND, Description, Link
from adaptctl.mechanism.pose import Array

NEAR = 1e-3
"""rad: closer to a multiple of 90 degrees than this is suspicious"""
EXACT = 1e-9
"""rad: closer than this is taken as meant and reached"""


@dataclass(frozen=True)
class NearRightAngle:
    """Two successive joints and by how much (rad) the angle between their axes misses a multiple of 90 degrees."""

    parent: str
    child: str
    degrees: int
    """the multiple of 90 degrees"""
    miss: float

    def __str__(self) -> str:
        return (
            f"{self.parent} and {self.child} miss {self.degrees} degrees by {abs(self.miss):.1e} rad: "
            "if a right angle is meant, write it exactly"
        )


def near_right_angles(description: Description, exact: float = EXACT) -> tuple[NearRightAngle, ...]:
    """Successive joint axes within 1e-3 but not within `exact` (rad) of a multiple of 90 degrees."""
    links = description.links
    pairs = [(links[link.parent], link) for link in links if link.parent != GROUND]
    found = [_pair(parent, child) for parent, child in pairs]
    return tuple(pair for pair in found if exact < abs(pair.miss) < NEAR)


def _pair(parent: Link, child: Link) -> NearRightAngle:
    turn: Array = parent.far.rotation @ child.near.rotation
    first, second = parent.joint.axis, turn @ child.joint.axis
    # The arc tangent is exact at all angles; the arc cosine loses half the digits near 0.
    angle = float(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second))
    quarter = round(angle / (np.pi / 2))
    return NearRightAngle(parent.joint.name, child.joint.name, 90 * quarter, angle - quarter * np.pi / 2)
