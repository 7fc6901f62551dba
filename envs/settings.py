"""Settings of a tracking environment, checked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, numbers, per_joint, positive_number
from adaptctl.control.reference_check import require_point
from adaptctl.envs.random_reference import Trajectory, require_trajectory
from adaptctl.envs.reward import RewardWeights
from adaptctl.errors import InputError, NonFiniteError


def control_period_of(given: object) -> float:
    """Control period, s, as a float, from the value `given`. Raises `InputError` unless that is a positive finite
    number."""
    return positive_number(given, "control_period: expected a positive time in s")


def steps_of(duration: object, control_period: float) -> int:
    """Number of control periods, each of `control_period` (s), in a `duration` (s), rounded to the nearest whole
    number. Raises `InputError` for a `duration` that is no positive finite number, or shorter than one control
    period."""
    what = f"duration: expected at least one control period of {control_period:g} s"
    if (length := positive_number(duration, what)) < control_period:
        raise InputError(f"{what}, got {length}")
    return round(length / control_period)


def times_ahead_of(given: Sequence[float]) -> Array:
    """Look-ahead times (L,), s, as a read-only float64 array, from the sequence `given` of L of them, which may be
    empty. Raises `InputError` for another shape, for entries that are no numbers, and for times that are negative or
    not finite."""
    times = numbers(given, "look_ahead", "(L,)")
    times = frozen_array(times, (times.size,), "look_ahead")
    if (times < 0.0).any():
        raise InputError(f"look_ahead: expected times of at least 0 s, got {times.tolist()}")
    return times


def initial_error_of(given: ArrayLike, dof: int) -> Array:
    """Initial position errors (r,) of r joints, rad (m if prismatic), from one number for all or one a joint, `given`;
    `dof` is r. Raises `InputError` for another shape and for entries that are no numbers, `NonFiniteError` on NaN and
    infinity."""
    return finite_numbers(per_joint(given, dof, "initial_error"), "initial_error")


def weights_of(given: object) -> RewardWeights:
    """Weights of the tracking reward, a `RewardWeights`: those `given`, or the default ones for None. Raises
    `InputError` for anything else."""
    if given is not None and not isinstance(given, RewardWeights):
        raise InputError(f"reward_weights: expected RewardWeights(...), got {given!r:.80}")
    return given or RewardWeights()


def finite_numbers(given: ArrayLike, what: str) -> Array:
    """Finite numbers as a float64 array, of the shape of `given`, whatever it is. `what` is their name in messages.
    Raises `InputError` for entries that are no numbers, `NonFiniteError` on NaN and infinity."""
    array = numbers(given, what)
    if not np.isfinite(array).all():
        place = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        raise NonFiniteError(f"{what}: expected finite numbers, got {array[place]} at index {place}")
    return array


def require_reference(given: Trajectory, dof: int) -> None:
    """Raise `InputError` unless `given` stands for a reference of `dof` joints: a callable (a `Reference`), a seed (a
    whole number of at least 0), "random" or None. A callable is called with the time 0 s as an array (1,), and must
    return positions, velocities and accelerations, (1, `dof`) each, in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if
    prismatic); its own errors are not caught. Nothing is returned. A list, tuple or array of several, one for each of
    many arms, passes here and is checked at a reset."""
    if isinstance(given, list | tuple | np.ndarray):
        return
    require_trajectory(given, "reference")
    if callable(given):
        require_point(point := given(np.zeros(1)))
        if any((shape := np.shape(part)) != (1, dof) for part in (point.p, point.v, point.a)):
            raise InputError(
                f"reference: expected {dof} joints, p, v and a (n, {dof}) at times (n,), got {shape} for n = 1"
            )
