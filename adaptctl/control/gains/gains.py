"""Gains of the tracking loop, and the largest that a sampled controller can carry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, per_joint
from adaptctl.dynamics import Mechanism
from adaptctl.errors import GainError, InputError

LARGEST_SAMPLED_GAIN = 1.5
"""A torque held over T_c is stable while T_c max lambda(M^-1 K) < 2; the rest is a margin."""


def positive_per_joint(values: ArrayLike, dof: int, what: str) -> Array:
    """Positive finite numbers (r,), from one for all joints or one each: read-only.

    Raises `InputError` on a wrong shape and for any other numbers.
    """
    array = per_joint(values, dof, what)
    if not np.all((array > 0.0) & np.isfinite(array)):
        raise InputError(f"{what}: expected positive numbers, got {array.tolist()}")
    return array


def sampled_configurations(mechanism: Mechanism, samples: int = 200, seed: int = 0) -> Array:
    """Random positions (samples, r) within the limits: the full circle, or 1 m, where there are none.

    With loops, those of them that the loops allow.
    """
    limits = [joint.limits for joint in mechanism.primary_joints]
    wide = [np.pi if joint.kind.turns else 1.0 for joint in mechanism.primary_joints]
    lower = [max(b.lower, -w) if np.isinf(b.lower) else b.lower for b, w in zip(limits, wide, strict=True)]
    upper = [min(b.upper, w) if np.isinf(b.upper) else b.upper for b, w in zip(limits, wide, strict=True)]
    p = np.random.default_rng(seed).uniform(lower, upper, (samples, mechanism.dof))
    if mechanism.continuation is None:
        return p
    p = p[mechanism.description.within_conditions(p)]
    return p[mechanism.continuation.reachable(p)]


def typical_inertia(mechanism: Mechanism) -> Array:
    """The median over configurations of each joint's own inertia, M's diagonal (r,), in kg m^2 or kg."""
    return np.median(np.diagonal(_mass_matrices(mechanism), axis1=-2, axis2=-1), axis=0)


@lru_cache(maxsize=8)
def _mass_matrices(mechanism: Mechanism) -> Array:
    """M (samples, r, r) at the sampled configurations, kept: with loops these take seconds to reach."""
    return frozen(mechanism.mass_matrix(sampled_configurations(mechanism)))


@dataclass(frozen=True, eq=False)
class Gains:
    """Slotine and Li's gains: `bandwidth` is Lambda (r,) in 1/s, `damping` is K (r,) in N m s/rad."""

    bandwidth: Array
    damping: Array

    @classmethod
    def from_bandwidth(cls, mechanism: Mechanism, bandwidth: ArrayLike, ratio: float = 1.0) -> Gains:
        """Gains that put both poles of each joint's error at the bandwidth (1/s), were its inertia typical.

        With the true parameters M s' + (C + K) s = 0 and e' + Lambda e = s; so Lambda is the bandwidth and K
        the typical inertia times `ratio` bandwidths. A larger ratio is stiffer against what is unknown.
        """
        rates = positive_per_joint(bandwidth, mechanism.dof, "bandwidth")
        inertia = typical_inertia(mechanism)
        if np.any(inertia <= 0.0):
            raise InputError(f"{mechanism.name}: gains need a positive inertia at every joint, got {inertia}")
        return cls(rates, positive_per_joint(ratio * rates * inertia, mechanism.dof, "damping"))


def sampled_gain(mechanism: Mechanism, damping: ArrayLike, period: float) -> float:
    """T_c max_q lambda_max(M(q)^-1 K): 2 is the limit of stability of a torque held over the period T_c (s)."""
    root = np.sqrt(positive_per_joint(damping, mechanism.dof, "damping"))
    eigenvalues = np.linalg.eigvalsh(_mass_matrices(mechanism) / (root[:, None] * root))
    smallest = float(eigenvalues.min())
    return period / smallest if smallest > 0.0 else np.inf


def _largest_share(mechanism: Mechanism, damping: ArrayLike) -> float:
    """An upper bound of max_q lambda_max(M(q)^-1 K) that costs little: K is at most so many times the typical inertia,
    and the eigenvalues rise with K."""
    inertia, largest = _typical(mechanism)
    if not (np.isfinite(largest) and np.all(inertia > 0.0)):
        return np.inf
    return float((positive_per_joint(damping, mechanism.dof, "damping") / inertia).max()) * largest


@lru_cache(maxsize=8)
def _typical(mechanism: Mechanism) -> tuple[Array, float]:
    """The typical inertia, and max_q lambda_max(M(q)^-1 K) were K that; infinite where it cannot be."""
    inertia = typical_inertia(mechanism)
    return inertia, sampled_gain(mechanism, inertia, 1.0) if np.all(inertia > 0.0) else np.inf


def require_sampled_gain(mechanism: Mechanism, damping: ArrayLike, period: float) -> None:
    """Raise `GainError` for a damping (r,) that the control period (s) cannot carry, saying the largest it can."""
    if not (np.isfinite(period) and period > 0.0):
        raise InputError(f"control period: expected a positive time in s, got {period}")
    if period * _largest_share(mechanism, damping) <= LARGEST_SAMPLED_GAIN:
        return
    gain = sampled_gain(mechanism, damping, period)
    if not gain <= LARGEST_SAMPLED_GAIN:
        _refuse(mechanism, gain, period)


def _refuse(mechanism: Mechanism, gain: float, period: float) -> NoReturn:
    if np.isinf(gain):
        raise GainError(
            f"{mechanism.name}: the mass matrix is not positive definite everywhere, so no damping can be "
            "checked against it: give the mechanism physically consistent parameters"
        )
    factor = LARGEST_SAMPLED_GAIN / gain
    raise GainError(
        f"{mechanism.name}: damping is too stiff for a control period of {period:g} s: T_c lambda_max(M^-1 K) = "
        f"{gain:.3g}, at most {LARGEST_SAMPLED_GAIN} is allowed; use at most {factor:.3g} times this damping or "
        f"a period of at most {period * factor:.3g} s"
    )
