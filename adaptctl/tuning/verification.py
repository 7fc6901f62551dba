"""Verification of gains: what runs show of an arm as described, of another, and of a late torque."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Gains
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.simulation import Rollouts
from adaptctl.tuning.trial import Trials, TrialSetting

DURATION = 20.0
"""s of a verification run"""
BEGINNING, SETTLED = 1.0, 2.0
"""s over which the first and the last error are taken"""
ASTRAY = 1.0
"""rad or m"""
LEARNED, CLIPPED = 1.0 / 3.0, 0.05
"""of the first error and of the error with adaptation off; share of the second half's samples at a torque limit"""
LINKS_OFF = 0.3


@dataclass(frozen=True)
class Verification:
    """Tracking errors of a simulated run of 20 s with a tuning's gains, and of the same run with adaptation off, in rad
    (m if prismatic), RMS over all joints and an interval of time. Nothing is checked.

    `name` is the run: "as described", "torque late" (by a control period), "links off" (each link's ten inertial
    parameters 30 % up or down) or "both". `first` is the error over the first second, `last` that over the last two,
    and `off` that over the last two with adaptation off, infinite where an error then reached 1 rad (m). `largest` is
    the largest magnitude of any joint's error at any time, not RMS. `limited` is the fraction, 0 to 1, of the samples
    in the second half of the run in which a torque was at its limit. `unit` is the unit, as text, of a thousandth of
    the errors: "mrad" by default, "mm" or "mrad or mm" with prismatic joints. Errors are infinite in a run that was not
    finite.
    """

    name: str
    first: float
    """over the first second"""
    last: float
    """over the last two"""
    off: float
    """the last, with adaptation off; infinite where an error then reached 1 rad or m"""
    largest: float
    """error of any joint at any time"""
    limited: float
    """fraction of the second half of the run in which a torque was at its limit"""
    unit: str = "mrad"
    """of a thousandth of the errors, as text"""

    @property
    def stayed(self) -> bool:
        """True if no joint's tracking error reached 1 rad (m if prismatic) in the run, and a torque was at its limit in
        at most 5 % of its second half."""
        return self.largest < ASTRAY and self.limited <= CLIPPED

    @property
    def learns(self) -> bool:
        """True if the run stayed near the reference and its error became small. It stayed near if no joint's tracking
        error reached 1 rad (m if prismatic) and a torque was at its limit in at most 5 % of the second half. The RMS
        tracking error over all joints and the last 2 s must be at most a third of that of the first second and of that
        of the last 2 s with adaptation off."""
        return self.stayed and self.last <= LEARNED * min(self.first, self.off)

    def __str__(self) -> str:
        if not self.stayed:
            astray = self.largest >= ASTRAY
            why = f"an error of {self.largest:.2g}" if astray else f"{self.limited:.0%} at a torque limit"
            return f"{self.name}: fails, {why}"
        without = f"{1e3 * self.off:.3g} {self.unit}" if np.isfinite(self.off) else "falls"
        return f"{self.name}: {1e3 * self.first:.3g} to {1e3 * self.last:.3g} {self.unit}; adaptation off {without}"


def verifications(trials: Trials, gains: Gains, gain: Array, seed: int) -> tuple[Verification, ...]:
    """Verifications, a tuple of four `Verification`, of tracking `gains` and of an adaptation gain with the diagonal
    `gain` (P,) on all P inertial and friction parameters, in their units squared per J.

    They are runs of 20 s, in this order: of the arm as described; with torques a control period late; with the ten
    inertial parameters of each link 30 % up or down, drawn by `seed`, a whole number of at least 0; and with both. Each
    is run with adaptation and without, by `trials`. Raises `InputError` for a mechanism of more than 100 links.
    """
    mechanism = trials.plant.mechanism
    own, other = mechanism.inertial_parameters, scaled_links(mechanism, LINKS_OFF, seed)
    cases = [("as described", own, False), ("torque late", own, True), ("links off", other, False)]
    cases.append(("both", other, True))
    settings = [
        TrialSetting(gains.bandwidth, gains.damping, share * gain, true, late)
        for _, true, late in cases
        for share in (1.0, 0.0)
    ]
    return tuple(_verified(trials.run(settings, DURATION), [case[0] for case in cases], trials))


def _verified(runs: Rollouts, names: list[str], trials: Trials) -> Iterator[Verification]:
    first, last, largest, limited = measures(runs, np.asarray(trials.plant.torque_limits))
    for k, name in enumerate(names):
        on, off = 2 * k, 2 * k + 1
        without = float(last[off]) if largest[off] < ASTRAY else np.inf
        share, unit = float(limited[on]), error_unit(trials.plant.mechanism)
        yield Verification(name, float(first[on]), float(last[on]), without, float(largest[on]), share, unit)


def measures(runs: Rollouts, limits: Array) -> tuple[Array, Array, Array, Array]:
    """Four arrays (M,) that judge M simulated `runs`. They are the tracking error (RMS over all joints) of the first
    second, that of the last 2 s, and the largest error of any joint at any time, all in rad (m if prismatic) and
    infinite where a run was not finite; and the fraction, 0 to 1, of samples in the second half in which a torque was
    at its limit. `limits` (r,) are the torque limits of the r joints, N m (N). Nothing is checked."""
    finite = runs.finite
    squares = np.where(finite, np.mean(np.where(finite[:, None], runs.error, 0.0) ** 2, axis=-1), np.inf)
    time = runs.time
    first = np.sqrt(squares[time < BEGINNING].mean(axis=0))
    last = np.sqrt(squares[time >= time[-1] - SETTLED].mean(axis=0))
    largest = np.where(finite, runs.largest_error.max(axis=-1), np.inf)
    at_limit = (np.abs(runs.applied[len(time) // 2 :]) >= (1.0 - 1e-9) * limits).any(axis=-1)
    return first, last, largest, np.asarray(at_limit.mean(axis=0))


def scaled_links(mechanism: Mechanism, share: float, seed: int) -> Array:
    """All P inertial and friction parameters (P,) of a `mechanism` with rescaled links, SI units, in the order of its
    `parameter_names`. The ten inertial ones of each body (link) are multiplied by 1 + `share` or 1 - `share`, no unit,
    with equal probability, drawn by `seed`, a whole number of at least 0, the same for equal seeds. With a share below
    1 a rigid body stays one; drives keep their parameters. Under linear constraints on the parameters only those that
    are free, which `parameter_names` then has, are multiplied and returned; the others follow from them, so that a body
    need not stay one. Nothing is checked."""
    names, bodies = mechanism.description.parameter_names, len(mechanism.description.bodies)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], bodies)
    scales = dict(zip(names, np.repeat(1.0 + share * signs, 10).tolist(), strict=False))
    return np.array([scales.get(name, 1.0) for name in mechanism.parameter_names]) * mechanism.inertial_parameters
