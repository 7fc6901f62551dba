"""Adaptation gains on all parameters, from how heavy the links may be and what the control period carries."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import PriorRanges, typical_inertia
from adaptctl.description import GROUND
from adaptctl.description.reach import reach_behind
from adaptctl.dynamics import Mechanism

SHORTEST_LEVER = 0.05
"""m, behind a last joint"""
HEAVIEST = 5.0
"""kg, the greatest prior range of a link's mass unless given"""
LEAST_SHARE = 1e-3
"""of the largest share of a link's parameter in the torques, in proportion to the ranges: less is learned no faster"""

Shares: TypeAlias = Literal["ranges", "links", "parameters", "mixed"]
"""Parts with an equal share in the adaptation number: each link, each parameter, or none (in proportion to the prior
ranges); mixed is half of the latter and half of each link."""


def prior_ranges(mechanism: Mechanism, heaviest: float = HEAVIEST) -> Array:
    """Prior ranges (P,), SI units, of all P inertial and friction parameters of a `mechanism`: their greatest plausible
    errors, in the order of its `parameter_names`.

    Those of a link come from the typical inertia I of the joint that moves it, the median of its mass matrix entry over
    200 random positions. A point mass m = I/lever^2, at most `heaviest` (kg; 5 by default), would have that inertia at
    a lever of a third of the arm's length beyond the joint, which is taken as at least 0.05 m. m is then the range of
    the link's mass, sqrt(m I) that of its first moments and I that of its inertias. Friction has the ranges of
    `PriorRanges`, 5 N m s/rad (N s/m if prismatic) for viscous and 10 N m (N) for Coulomb friction. Raises `InputError`
    where a typical inertia is not positive.
    """
    inertia = _behind(mechanism)
    levers = np.maximum(reach_behind(mechanism.links), SHORTEST_LEVER) / 3.0
    masses = np.minimum(inertia / levers**2, heaviest)
    by_owner: dict[str, PriorRanges] = {}
    for link, mass, moment in zip(mechanism.links, masses.tolist(), inertia.tolist(), strict=True):
        # A link owns its ten, its joint the drive's.
        by_owner[link.name] = by_owner[link.joint.name] = PriorRanges(mass, float(np.sqrt(mass * moment)), moment)
    names = mechanism.parameter_names
    return np.concatenate([by_owner[name.rpartition(".")[0]].of((name,)) for name in names])


def adaptation_number(regressor: Array, damping: Array, gain: Array, period: float) -> float:
    """The adaptation number T lambda_max(K^-1 Y Gamma Y'), without a unit, the greatest over S samples: sampled
    adaptation is stable below 2.

    Y is the torque `regressor` (S, r, P) of r joints and P parameters and Y' its transpose, K the `damping` (r,), N m
    s/rad (N s/m if prismatic), Gamma the adaptation gain, whose diagonal (P,) is `gain`, in the parameters' units
    squared per J, T the control `period`, s, and lambda_max the largest eigenvalue. Nothing is checked.
    """
    scaled = regressor * np.sqrt(gain) / np.sqrt(damping)[:, None]
    return period * float(np.linalg.eigvalsh(scaled @ np.swapaxes(scaled, -1, -2))[:, -1].max())


def carried_gain(
    mechanism: Mechanism, regressor: Array, damping: Array, ranges: Array, period: float, number: float, shares: Shares
) -> Array:
    """The diagonal (P,) of an adaptation gain Gamma on all P parameters of a `mechanism`, scaled so that the adaptation
    number is `number`. It is in the order of the mechanism's `parameter_names` and in their units squared per J.

    The adaptation number is the greatest T lambda_max(K^-1 Y Gamma Y'), no unit, over S samples: Y is the torque
    `regressor` (S, r, P) of r joints and Y' its transpose, K the `damping` (r,), N m s/rad (N s/m if prismatic), T the
    control `period`, s, and lambda_max the largest eigenvalue. `shares` says what the gain is in proportion to:
    "ranges", the squares of the parameters' prior `ranges` (P,), SI units; "links", these, but scaled so that each link
    with its drive's rotor, and each drive's friction, has the same adaptation number by itself; "parameters", the
    inverse of the greatest, over the samples, of the parameter's entry of the diagonal of Y'K^-1 Y; "mixed", half
    "ranges" and half "links". Nothing is checked.
    """
    gain = ranges**2
    if shares == "links":
        gain = _each_link(mechanism, regressor, damping, gain, period)
    elif shares == "parameters":
        gain = _each_parameter(mechanism, regressor, damping, gain)
    elif shares == "mixed":
        parts = gain, _each_link(mechanism, regressor, damping, gain, period)
        gain = np.sum([part / adaptation_number(regressor, damping, part, period) for part in parts], axis=0)
    return gain * number / adaptation_number(regressor, damping, gain, period)


def _each_link(mechanism: Mechanism, regressor: Array, damping: Array, gain: Array, period: float) -> Array:
    """Gamma whose part for each link, and for each drive, has the same number."""
    found = gain.copy()
    for group in _groups(mechanism):
        number = adaptation_number(regressor[..., group], damping, gain[group], period)
        found[group] = gain[group] / number if number > 0.0 else 0.0
    return _positive(found)


def _each_parameter(mechanism: Mechanism, regressor: Array, damping: Array, gain: Array) -> Array:
    """Diagonal Gamma (k,): the inverse of each parameter's largest share Y'K^-1 Y of the torques."""
    share = (regressor**2 / damping[:, None]).sum(axis=1).max(axis=0)
    found = gain.copy()
    for group in _groups(mechanism):
        least = LEAST_SHARE * float((share[group] * gain[group]).max()) / gain[group]
        found[group] = 1.0 / np.maximum(share[group], least) if np.all(least > 0.0) else 0.0
    return _positive(found)


def _positive(gain: Array) -> Array:
    """Gains, those of parameters that nothing tells of made small instead of zero."""
    return np.maximum(gain, 1e-12 * gain[gain > 0.0].min())


def _groups(mechanism: Mechanism) -> list[list[int]]:
    """Indices of the parameters of each link with its drive's rotor, and of each drive's friction.

    A rotor alone moves little, and an equal share of it would be a gain that makes its estimate ring.
    """
    links = {link.joint.name: link.name for link in mechanism.links}
    groups: dict[tuple[str, bool], list[int]] = {}
    for k, name in enumerate(mechanism.parameter_names):
        owner = name.rpartition(".")[0]
        groups.setdefault((links.get(owner, owner), k >= mechanism.energetic), []).append(k)
    return list(groups.values())


def _behind(mechanism: Mechanism) -> Array:
    """Typical inertia (N,) that the nearest driven joint at or before each link moves."""
    of_joints = dict(zip(mechanism.description.primary, typical_inertia(mechanism).tolist(), strict=True))
    found: list[float] = []
    for i, link in enumerate(mechanism.links):
        before = found[link.parent] if link.parent != GROUND else max(of_joints.values())
        found.append(of_joints.get(i, before))
    return np.array(found)
