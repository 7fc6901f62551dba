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
    """A control period in s. Raises `InputError` for what is none."""
    return positive_number(given, "control_period: expected a positive time in s")


def steps_of(duration: object, control_period: float) -> int:
    """Number of control periods (s) in a duration (s). Raises `InputError` for less than one."""
    what = f"duration: expected at least one control period of {control_period:g} s"
    if (length := positive_number(duration, what)) < control_period:
        raise InputError(f"{what}, got {length}")
    return round(length / control_period)


def times_ahead_of(given: Sequence[float]) -> Array:
    """Look-ahead times (L,), s. Raises `InputError` for another shape, and for times that are negative or not
    finite."""
    times = frozen_array(given, (np.size(given),), "look_ahead")
    if (times < 0.0).any():
        raise InputError(f"look_ahead: expected times of at least 0 s, got {times.tolist()}")
    return times


def initial_error_of(given: ArrayLike, dof: int) -> Array:
    """Initial errors (r,), rad (m), from one number or one a joint. Raises `InputError` on another shape,
    `NonFiniteError` on NaN and infinity."""
    return finite_numbers(per_joint(given, dof, "initial_error"), "initial_error")


def weights_of(given: object) -> RewardWeights:
    """Weights of the reward, None for the defaults. Raises `InputError` for others."""
    if given is not None and not isinstance(given, RewardWeights):
        raise InputError(f"reward_weights: expected RewardWeights(...), got {given!r:.80}")
    return given or RewardWeights()


def finite_numbers(given: ArrayLike, what: str) -> Array:
    """Numbers of any shape. Raises `InputError` for what are none, `NonFiniteError` on NaN and infinity."""
    array = numbers(given, what)
    if not np.isfinite(array).all():
        place = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        raise NonFiniteError(f"{what}: expected finite numbers, got {array[place]} at index {place}")
    return array


def require_integrator(given: object) -> None:
    """Raise `InputError` for what is neither an integrator nor None."""
    if given is not None and (isinstance(given, type) or not (hasattr(given, "step") and hasattr(given, "implicit"))):
        raise InputError(f"integrator: expected an Integrator, such as RungeKutta4(), or None, got {given!r:.80}")


def require_reference(given: Trajectory, dof: int) -> None:
    """Raise `InputError` for what stands for no reference, and for a reference of another number of joints; lists, one
    reference for each of many arms, are looked at when these begin."""
    if isinstance(given, list | tuple | np.ndarray):
        return
    require_trajectory(given, "reference")
    if callable(given):
        require_point(point := given(np.zeros(1)))
        if any((shape := np.shape(part)) != (1, dof) for part in (point.p, point.v, point.a)):
            raise InputError(
                f"reference: expected {dof} joints, p, v and a (n, {dof}) at times (n,), got {shape} for n = 1"
            )
