"""Viewpoint from which all of a mechanism's motion is seen, and the floor under it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.recording.skeleton import Skeleton

POSITIONS = 200
"""At most as many positions are looked at."""
SEEN = 0.5
"""Share of a camera's distance, beside its axis, up to which rerun's viewer shows things: tan of half its angle."""


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """Camera's viewpoint of a mechanism: `eye` (3,), the camera's position, `target` (3,), the point that it looks at,
    and `floor`, the height of the floor along z, all in m in the world's frame. Nothing is checked at construction."""

    eye: Array
    """(3,) where the camera stands"""
    target: Array
    """(3,) what it looks at"""
    floor: float
    """height of the floor"""

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
        feet = np.array([link.near.translation for link in mechanism.links if link.parent < 0])
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
    lowest = min(float(heights.min()), min(link.near.translation[2] for link in mechanism.links[:1]))
    return 0.0 if lowest > 0.0 else lowest - 0.6 * parts.reach
