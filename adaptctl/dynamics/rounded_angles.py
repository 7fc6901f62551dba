"""Rounded right angles of robot files, taken as meant."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import Description, JointKind
from adaptctl.description.right_angles import ROUNDED_ANGLE, near_right_angles, snapped
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.errors import RoundedAnglesWarning, warn
from adaptctl.scalars import Column

ROUNDED_TORQUE = 1e-4
"""of a joint's largest torque: a tenth of what good torque measurements tell; 1.5708 for a right angle makes 1e-5"""
STATES, GRAVITY = 64, 9.81


def as_meant(before: Description, where: str) -> Description:
    """Mechanism whose rounded right angles are exact if torques hardly tell, with a `RoundedAnglesWarning`."""
    rounded = [angle for angle in near_right_angles(before) if abs(angle.deviation) <= ROUNDED_ANGLE]
    if not rounded:
        return before
    after = snapped(before, ROUNDED_ANGLE)
    if torque_change(before, after) > ROUNDED_TORQUE:
        return before
    many = len(rounded) > 1
    text = f"{len(rounded)} rounded angles taken as right angles" if many else "1 rounded angle taken as a right angle"
    warn(RoundedAnglesWarning(f"{where}: {text}", before, after))
    return after


def torque_change(one: Description, other: Description) -> float:
    """Largest difference of a joint's torques, divided by its largest torque, at random states of the open tree."""
    states = _states(one)
    before, after = (_torques(description, *states) for description in (one, other))
    most, change = np.abs(before).max(axis=0), np.abs(after - before).max(axis=0)
    return float(np.max(change / np.where(most > 0.0, most, 1.0)))


def _torques(description: Description, p: Array, v: Array, a: Array) -> Array:
    """Torques (states, n) of the open tree."""
    tree, parameters = TreeEquations.of(description), Column(description.inertial_parameters.tolist())
    q, rates, accelerations = (Column([*rows.T]) for rows in (p, v, a))
    found = tree.inverse_dynamics(q, rates, rates, accelerations, parameters)
    return np.array([np.broadcast_to(torque, len(p)) for torque in found.of]).T


def _states(description: Description) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations (states, n) at which inertia, centrifugal forces and gravity compare."""
    rng, links = np.random.default_rng(0), description.links
    length = max(float(np.linalg.norm(link.parent_to_joint.translation)) for link in links) or 1.0
    slides = np.array([link.joint.kind is JointKind.PRISMATIC for link in links])
    size, shape = np.where(slides, length, 1.0), (STATES, len(links))
    p = rng.uniform(-1.0, 1.0, shape) * np.where(slides, length, np.pi)
    v = rng.normal(size=shape) * size * np.sqrt(GRAVITY / length)
    return p, v, rng.normal(size=shape) * size * GRAVITY / length
