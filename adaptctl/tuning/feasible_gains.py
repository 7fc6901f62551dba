"""Feasible gains and initial errors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.control import Gains
from adaptctl.control.controller import Reference
from adaptctl.control.gains.gains import TORQUE_MARGIN, finite_torque_limits
from adaptctl.control.gains.sampling_ratio import sampled_inertia
from adaptctl.control.gains.workspace import reachable
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.tuning.feasible_reference import motion_ranges

DAMPING_TORQUE_SHARE = 0.5  # of a torque limit, for damping at the initial error
ACCELERATION_SHARE = 0.3  # of a torque limit, to correct the initial error
FREE_SHARE = 0.5  # of the bound of T lambda_max(M^-1 K) without viscous friction, which may be less than in the file
SEARCH_STEPS, GROWTH_STEPS, GROWTH = 150, 120, 1.08
REFERENCE_MARGIN = 0.2  # rad (m)
MAX_INITIAL_ERROR = 0.1  # rad (m), and of a joint's range
MIN_BANDWIDTH = 1.0  # 1/s, to correct an initial error
MAX_GRAVITY_SHARE = 0.4  # of a torque limit at the initial error, so that heavier links can still be held there
ERROR_SHRINKAGE, SHRINKAGE_ROUNDS = 0.8, 20
PUSH_SHARE, MAX_YIELD = 0.05, 1.0  # of a torque limit; rad (m) beyond which an arm is lost
ROUND_OFF = 1e-9  # of an eigenvalue, more than there is
ROTOR_DAMPING_FACTOR = 4.0  # for which a rotor's inertia is named


class FeasibleGains(NamedTuple):
    """Gains, what limits them (r,), and free inertias (r,)."""

    gains: Gains
    limited_by_sampling: NDArray[np.bool_]
    free_inertia: Array
    limited_by_torque: NDArray[np.bool_]


def feasible_gains(
    mechanism: Mechanism, limits: Array, p: Array, off: Array, control_period: float, bandwidth: float, hold: float
) -> FeasibleGains:
    """Largest gains at positions (S, r). Raises `InputError` without inertia."""
    M = mechanism.mass_matrix(p)
    _validate_inertia(mechanism, M)
    inertia = np.diagonal(M, axis1=1, axis2=2).max(axis=0)
    reachable = np.sqrt(ACCELERATION_SHARE * limits / (inertia * off))
    rates = np.asarray(np.minimum(bandwidth, reachable), dtype=np.float64)
    inverse = _inverse(mechanism, p, M, control_period)
    affordable = np.asarray(DAMPING_TORQUE_SHARE * limits / (rates * off), dtype=np.float64)
    damping = _largest_damping(
        inverse, control_period, hold, affordable, np.asarray(np.linalg.inv(M), dtype=np.float64)
    )
    free = 1.0 / np.diagonal(inverse, axis1=1, axis2=2).max(axis=0)
    return FeasibleGains(Gains(rates, damping), damping < 0.99 * affordable, free, reachable < bandwidth)


def achieved_sampling_ratio(mechanism: Mechanism, p: Array, damping: Array, control_period: float) -> float:
    """Greatest T lambda_max(M^-1 K) at positions (S, r), M the inertia under a held torque."""
    return _Worst(_inverse(mechanism, p, mechanism.mass_matrix(p), control_period), control_period).of(damping)[0]


def _inverse(mechanism: Mechanism, p: Array, M: Array, control_period: float) -> Array:
    return np.asarray(np.linalg.inv(sampled_inertia(mechanism, p, M, control_period)), dtype=np.float64)


def _largest_damping(inverse: Array, control_period: float, hold: float, affordable: Array, free: Array) -> Array:
    """Largest damping (r,): joints grow alike, and those at the limit shrink, also without the file's friction."""
    typical = np.median(1.0 / np.diagonal(inverse, axis1=1, axis2=2), axis=0)
    worst = _Worst(np.concatenate((inverse, FREE_SHARE * free)), control_period)
    damping = np.minimum(hold / control_period * typical, affordable)
    for k in range(SEARCH_STEPS):
        number, shares = worst.of(damping)
        if number > hold:
            damping = damping * (hold / number) ** (shares / shares.max())
        elif k < GROWTH_STEPS:
            damping = np.minimum(damping * GROWTH, affordable)
    return damping * min(1.0, hold / worst.of(damping)[0])


class _Worst:
    """Greatest T lambda_max(M^-1 K) of samples, without those whose bound another one exceeds."""

    def __init__(self, inverse: Array, control_period: float) -> None:
        self._inverse = control_period * inverse
        self._bounds, self._damping = np.full(len(inverse), np.inf), np.ones(inverse.shape[-1])

    def of(self, damping: Array) -> tuple[float, Array]:
        """The number for a damping (r,), and each joint's part (r,) in it."""
        # Each eigenvalue changes by no smaller and no larger factor than the damping does.
        change, root, self._damping = damping / self._damping, np.sqrt(damping), damping
        least, self._bounds = self._bounds.max() * change.min(), self._bounds * change.max()
        likely = np.flatnonzero(self._bounds >= (1.0 - ROUND_OFF) * least)
        ratios = self._inverse[likely] * root[:, None] * root
        self._bounds[likely] = np.linalg.eigvalsh(ratios)[:, -1]
        values, vectors = np.linalg.eigh(ratios[self._bounds[likely].argmax()])
        return float(values[-1]), np.asarray(vectors[:, -1] ** 2)


def _validate_inertia(mechanism: Mechanism, M: Array) -> None:
    names = [joint.name for joint in mechanism.primary_joints]
    diagonal = np.diagonal(M, axis1=1, axis2=2)
    light = np.flatnonzero(~(diagonal.min(axis=0) > 1e-12 * diagonal.max()))
    if light.size:
        raise InputError(
            f"{mechanism.name}: {', '.join(names[j] for j in light)}: moves no inertia, so there are no stable gains: "
            "give its links mass, or the joint drive = { rotor_inertia = ... } in a TOML file (adaptctl new ROBOT.toml "
            "--like FILE writes one)"
        )
    root = np.sqrt(diagonal)
    least = np.linalg.eigvalsh(M / root[:, :, None] / root[:, None, :])[:, 0]
    if not least.min() > 1e-10:
        wrong = mechanism.description.inconsistent_links
        whose = f"give {', '.join(wrong)}" if wrong else "give the links"
        raise InputError(
            f"{mechanism.name}: the mass matrix is not positive definite along the reference, so there are no stable "
            f"gains: {whose} physically consistent inertial parameters, or the joints rotor inertias"
        )


def limitations(mechanism: Mechanism, carried: FeasibleGains) -> tuple[str, ...]:
    """Sentences on what limits each joint's gains."""
    return tuple(_limitation(mechanism, carried, j) for j in range(mechanism.dof))


def _limitation(mechanism: Mechanism, carried: FeasibleGains, j: int) -> str:
    joint = mechanism.primary_joints[j]
    unit = "kg m²" if joint.kind.is_revolute else "kg"
    if carried.limited_by_sampling[j]:
        rotor = (ROTOR_DAMPING_FACTOR - 1.0) * carried.free_inertia[j]
        kind = "reflected rotor inertia" if joint.kind.is_revolute else "drive mass"
        return (
            f"K is limited by the sampling period; adding {rotor:.1g} {unit} of {kind} would allow "
            f"{ROTOR_DAMPING_FACTOR:g}× the damping"
        )
    if carried.limited_by_torque[j]:
        return "Λ and K are limited by the torque limit"
    return "K is limited by the torque limit"


def yielding_note(mechanism: Mechanism, gains: Gains) -> str:
    """Sentence on joints that a small push turns far, since what they move is light for their limits; or empty."""
    limits = np.array([joint.limits.effort for joint in mechanism.primary_joints])
    yields = PUSH_SHARE * np.where(np.isfinite(limits), limits, 0.0) / (gains.bandwidth * gains.damping)
    if not (names := [mechanism.primary_joints[j].name for j in np.flatnonzero(yields > MAX_YIELD)]):
        return ""
    whom = "it" if len(names) == 1 else "them"
    return (
        f"{', '.join(names)}: a push of {PUSH_SHARE:.0%} of the torque limit moves {whom} by more than {MAX_YIELD:g} "
        "rad (m) before it is learned: what moves is light for these limits; give lower ones, or rotor_inertia"
    )


def assumed_limits(mechanism: Mechanism) -> str:
    """Sentence on the torque limits that are assumed where there are none; or empty."""
    without = np.flatnonzero(np.isinf(mechanism.effort_limits)).tolist()
    if not without:
        return ""
    names = ", ".join(mechanism.primary_joints[j].name for j in without)
    assumed = ", ".join(f"{x:.3g}" for x in finite_torque_limits(mechanism)[without])
    return (
        f"{names}: no torque limits are given; {assumed} N m (N) are assumed, {TORQUE_MARGIN:g} times what moves the "
        "arm: give effort in the file"
    )


def recoverable_error(mechanism: Mechanism, limits: Array, reference: Reference) -> Array:
    """Initial errors (r,) that torque limits can correct."""
    start, common = reference(np.zeros(1)).p, common_error(mechanism)
    inertia = np.diagonal(mechanism.mass_matrix(start)[0])
    wanted = common / np.maximum(1.0, inertia * common * MIN_BANDWIDTH**2 / (ACCELERATION_SHARE * limits))
    errors = ERROR_SHRINKAGE ** np.arange(SHRINKAGE_ROUNDS)[:, None] * wanted
    errors = np.concatenate((errors[reachable(mechanism, start + errors)], np.zeros_like(start)))
    load = np.abs(mechanism.inverse_dynamics(start + errors, 0.0 * errors, 0.0 * errors)) / limits
    fits = np.all(load <= np.maximum(MAX_GRAVITY_SHARE, load[-1]), axis=1)
    return np.asarray(errors[fits.argmax()])


def common_error(mechanism: Mechanism) -> Array:
    """Initial errors (r,) without torque limits."""
    lower, upper = motion_ranges(mechanism)
    return np.minimum(MAX_INITIAL_ERROR, MAX_INITIAL_ERROR * (upper - lower))
