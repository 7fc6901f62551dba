"""Notes of numbers in a robot's file that no robot has."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Protocol

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import Description, Joint, Link
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.description.link import GROUND
from adaptctl.description.reach import reach_behind
from adaptctl.errors import PlausibilityWarning, warn

MAX_DENSITY = 22_600.0
"""kg/m^3: osmium's"""
MIN_RADIUS = 1e-6
"""m: bodies of a smaller radius of gyration are mass points"""
MAX_REACHES, MIN_REACH = 2.0, 1.0
"""radius of gyration as a share of the mechanism's reach, and m: shorter reaches do not say how large parts are"""
MAX_OVERLOAD = 1.1
"""share of the torque limit that gravity may ask for"""
POSTURES, LINE, MAX_SWEPT_JOINTS = 400, 25, 12
"""numbers of postures tried, of those along a joint's range, and of joints of arms in which these are tried"""
SWEEPS = (1.0, 1.0, 0.1, 0.1)
"""shares of their ranges in which joints are moved one after the other"""
FLOATING_LINKS = 5
"""massless links with which a floating base begins"""
MAX_LISTED = 3
"""joints or links that a note names"""


class PosedArm(Protocol):
    """Protocol of a mechanism, made of its description alone."""

    description: Description

    def __init__(self, description: Description) -> None: ...

    def inverse_dynamics(self, p: Array, v: Array, a: Array) -> Array:
        """Torques (..., r) of motions (..., r)."""


def warn_of_implausible(mechanism: PosedArm, source: str | Path) -> None:
    """Warn (`PlausibilityWarning`) in one line of masses, inertias and torque limits that no robot has."""
    description = mechanism.description
    told = [*implausible_masses(description), *_listed(_overloads(mechanism))]
    if told:
        text = f"{source}: implausible: {'; '.join(told)}; expected kg, m, kg m^2 and N m"
        warn(text, PlausibilityWarning)


def _listed(told: list[str]) -> list[str]:
    rest = len(told) - MAX_LISTED
    return [*told[:MAX_LISTED], f"and {rest} more alike"] if rest > 0 else told


def implausible_masses(description: Description, besides: Description | None = None) -> list[str]:
    """Texts on links whose mass and inertia no part has, less those of links that are so in another description too."""
    reach = max(float(reach_behind(description.links).max()), MIN_REACH)
    known = {link.name for link in besides.links if _mass(link, reach)} if besides is not None else ()
    return _listed([text for link in description.links if link.name not in known and (text := _mass(link, reach))])


def _mass(link: Link, reach: float) -> str:
    """Text on a link's inertia; empty where it can be, and for mass points, massless and inconsistent links."""
    mass, variances = float(link.inertia[0]), _variances(link)
    radius = math.sqrt(max(variances[1] + variances[2], 0.0))
    if radius < MIN_RADIUS or variances[0] < -1e-9 * variances[2]:
        return ""
    # No body of one density and these variances is larger than an ellipsoid, nor this than the ball.
    density = mass / (4.0 / 3.0 * math.pi * (5.0 * variances[2]) ** 1.5)
    what = f"link {link.name!r} has {mass:.4g} kg at a radius of gyration of {radius:.3g} m"
    if density > MAX_DENSITY:
        return f"{what}, denser than any material"
    return f"{what}, beyond the robot's reach" if radius > MAX_REACHES * reach else ""


def _variances(link: Link) -> Array:
    """Variances (3,) of a link's mass about its centre in m^2, ascending; zero without mass."""
    if link.inertia[0] <= 0.0:
        return np.zeros(3)
    moments = pseudo_inertia(link.inertia) / link.inertia[0]
    return np.linalg.eigvalsh(moments[:3, :3] - np.outer(moments[:3, 3], moments[:3, 3]))


def _overloads(mechanism: PosedArm) -> list[str]:
    """Joints whose limit gravity exceeds; none with loops, floating bases and roots with several limbs."""
    description = mechanism.description
    limits = np.array([link.joint.limits.effort for link in description.links])
    limbs = sum(link.parent == GROUND for link in description.links)
    floats = all(link.massless for link in description.links[:FLOATING_LINKS])
    if (
        description.loops is not None
        or limbs != 1
        or floats
        or not np.isfinite(limits).any()
        or not np.any(description.gravity)
    ):
        return []
    torques = _gravity_torques(type(mechanism)(description.with_drives(Drive())), limits)
    return [
        f"gravity takes {torque:.4g} {joint.kind.effort_unit} of joint {joint.name!r}, whose limit is {limit:.4g}"
        for torque, limit, joint in zip(torques, limits, (link.joint for link in description.links), strict=True)
        if torque > MAX_OVERLOAD * limit
    ]


def _gravity_torques(mechanism: PosedArm, limits: Array) -> Array:
    """Largest torques (n,) of gravity found within position limits, refined where the answer is near."""
    lower, upper = np.array([_range(link.joint) for link in mechanism.description.links]).T
    postures = lower + (upper - lower) * _spread(POSTURES, len(lower))
    found = _torques(mechanism, postures)
    worst, best = postures[found.argmax(axis=0)], found.max(axis=0)
    near = np.flatnonzero((best > 0.5 * limits) & (best <= MAX_OVERLOAD * limits))
    sweeps = [(share, k) for share in SWEEPS for k in range(len(lower))]
    for share, k in sweeps if near.size and len(lower) <= MAX_SWEPT_JOINTS else ():
        tried = np.repeat(worst[near, None], LINE, axis=1)
        around = worst[near, k, None] + share * (upper[k] - lower[k]) * np.linspace(-1.0, 1.0, LINE)
        tried[..., k] = np.clip(around, lower[k], upper[k])
        rows = np.arange(near.size)
        torques = _torques(mechanism, tried)[rows, :, near]
        place = torques.argmax(axis=1)
        better = torques[rows, place] > best[near]
        worst[near[better]] = tried[rows, place][better]
        best[near] = np.maximum(best[near], torques[rows, place])
    return best


def _spread(count: int, size: int) -> Array:
    """Points (count, size) that fill a cube evenly, by multiples of powers of an irrational number."""
    root = 2.0
    for _ in range(50):  # of x^(size + 1) = x + 1
        root = (1.0 + root) ** (1.0 / (size + 1))
    return np.outer(np.arange(1, count + 1), root ** -np.arange(1.0, size + 1)) % 1.0


def _range(joint: Joint) -> tuple[float, float]:
    """Position limits, of a turn at most; 2 m where a slide has no two."""
    lower, upper = joint.limits.lower, joint.limits.upper
    if math.isfinite(upper - lower) and (upper - lower <= 2.0 * math.pi or not joint.kind.is_revolute):
        return lower, upper
    start = lower if math.isfinite(lower) else upper if math.isfinite(upper) else 0.0
    way = math.pi if joint.kind.is_revolute else 1.0
    inside = min(max(start, lower + way), upper - way)
    return inside - way, inside + way


def _torques(mechanism: PosedArm, p: Array) -> Array:
    """Sizes (..., n) of gravity's torques at positions."""
    return np.abs(mechanism.inverse_dynamics(p, np.zeros(p.shape), np.zeros(p.shape)))
