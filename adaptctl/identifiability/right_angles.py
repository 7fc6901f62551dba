"""Axes that are almost, but not quite, parallel or perpendicular: usually a rounded pi/2 in a file.

They matter: the SO-100 arm's file tilts its first axis by 6e-6 rad from the vertical, and has 38 independent
parameters instead of 36.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.description import Description
from adaptctl.description.transforms.snapping import meeting_axes

NEAR = 1e-3
"""rad: closer to a multiple of 90 degrees than this is suspicious"""
EXACT = 1e-9
"""rad: closer than this is taken as meant and reached"""


@dataclass(frozen=True)
class NearRightAngle:
    """Two successive joints and by how much (rad) the angle between their axes misses a multiple of 90 degrees."""

    parent: str
    """a joint's name, or "gravity" for a joint on the ground"""
    child: str
    degrees: int
    """the multiple of 90 degrees"""
    miss: float

    def __str__(self) -> str:
        return (
            f"{self.parent} and {self.child} miss {self.degrees} degrees by {abs(self.miss):.1e} rad: "
            "if a right angle is meant, write it exactly, or snap it (`snapped`)"
        )


def near_right_angles(description: Description, exact: float = EXACT) -> tuple[NearRightAngle, ...]:
    """Successive joint axes, gravity before the first, within 1e-3 but not within `exact` (rad) of a multiple of 90
    degrees."""
    meeting = list(meeting_axes(description))
    if not meeting:
        return ()
    axes = np.array([pair for _, _, pair in meeting])
    first, second = axes[:, 0], axes[:, 1]
    # The arc tangent is exact at all angles; the arc cosine loses half the digits near 0.
    angles = np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), np.sum(first * second, axis=1))
    quarters = np.round(angles / (np.pi / 2)).astype(int)
    misses = angles - quarters * (np.pi / 2)
    near = np.flatnonzero((exact < np.abs(misses)) & (np.abs(misses) < NEAR)).tolist()
    pairs = ((meeting[i], i) for i in near)
    return tuple(
        NearRightAngle(parent, link.joint.name, 90 * int(quarters[i]), float(misses[i]))
        for (link, parent, _), i in pairs
    )
