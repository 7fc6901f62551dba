"""Axes that are almost, but not quite, parallel or perpendicular: usually a rounded pi/2 in a file.

They matter: the SO-100 arm's file tilts its first axis by 6e-6 rad from the vertical, and has 38 independent
parameters instead of 36.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.description import Description
from adaptctl.description.transforms import meeting_axes

NEAR = 1e-3
"""Angle (rad) to a multiple of 90 degrees below which a miss is suspicious."""
EXACT = 1e-11
"""Angle (rad) to a multiple of 90 degrees below which it counts as reached: 1.57079632679 misses by 5e-12."""


@dataclass(frozen=True)
class NearRightAngle:
    """A near right angle: two successive joints, the angle between whose axes is within 1e-3 rad of a multiple of 90
    degrees, but not that multiple.

    `parent` is the name of the joint before, or "gravity" for a joint on the ground, `child` the joint; `degrees` is
    the multiple that is missed (0, 90 or 180), and `miss` the angle beyond it in rad, negative where it falls short,
    less than 1e-3 in size. Nothing is checked at construction.
    """

    parent: str
    """Name of the joint before, or "gravity" for a joint on the ground."""
    child: str
    """Name of the joint."""
    degrees: int
    """The multiple of 90 degrees that is missed."""
    miss: float
    """The angle beyond that multiple (rad), negative where it falls short."""

    def __str__(self) -> str:
        return (
            f"{self.parent} and {self.child} miss {self.degrees} degrees by {abs(self.miss):.1e} rad: "
            "if a right angle is meant, write it exactly, or snap it (`snapped`)"
        )


def near_right_angles(description: Description, exact: float = EXACT) -> tuple[NearRightAngle, ...]:
    """The near right angles of a mechanism: a `NearRightAngle` for each pair of successive joint axes of its
    `description` whose angle is within 1e-3 rad of a multiple of 90 degrees, but not within `exact` (rad, 1e-11 by
    default). For a joint on the ground, the direction of gravity replaces the axis before it; without gravity it has no
    pair. Empty where there are no near right angles. Nothing is checked."""
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
