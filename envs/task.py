"""Rewards for tracking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import (
    MAX_DURATION,
    Array,
    frozen_array,
    numbers,
    per_joint,
    positive_number,
    positive_period,
    real_number,
)
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.compilation import Kernel, compile_function
from adaptctl.envs.random_reference import Trajectory, validate_trajectory
from adaptctl.errors import InputError, NonFiniteError, NotFoundError
from adaptctl.scalars import Column, Scalar, absolute, where
from adaptctl.simulation.period import PlantState
from adaptctl.simulation.references import Preview, validate_point

LOOK_AHEAD = (0.05, 0.2)
"""s at which a reference ahead is observed, unless others are given"""


@dataclass(frozen=True)
class RewardWeights:
    """
    Weights of squared position errors, velocity errors and torques in the tracking reward.

    Parameters
    ----------
    position : float, default 1.0
        Weight of squared position errors in 1/rad^2 (1/m^2 if prismatic). 1 sets the scale of the reward.
    velocity : float, default 0.1
        Weight of squared velocity errors in s^2/rad^2 (s^2/m^2). At 0.1 an error of 1 rad/s costs as much as 0.3 rad.
    torque : float, default 0.001
        Weight of the squared ratios torque/limit, without a unit. At 0.001 full torque costs as much as an error of
        0.03 rad.
    termination : float, default 1000.0
        Penalty, in units of the reward, for an episode that is terminated: without it ending at once would be best, as
        all rewards are negative.

    Raises
    ------
    InputError
        If a weight is negative or not finite.

    Examples
    --------
    >>> from adaptctl.envs import RewardWeights
    >>> round(RewardWeights(torque=0.0).cost(position=0.02, velocity=0.1, torque=3.0), 3)
    0.03
    """

    position: float = 1.0
    velocity: float = 0.1
    torque: float = 0.001
    termination: float = 1000.0

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = getattr(self, name)
            if not 0.0 <= real_number(value, f"reward weight of {name}") < np.inf:
                raise InputError(f"reward weight of {name}: expected a number of at least 0, got {value}")

    def cost(self, position: Any, velocity: Any, torque: Any) -> Any:
        """
        Return the weighted sum of squared errors and torques of a control period.

        Parameters
        ----------
        position : scalar
            Sum over the joints of squared position errors in rad^2 (m^2 if prismatic), a float, array or symbolic
            scalar like the other two.
        velocity : scalar
            Sum over the joints of squared velocity errors in rad^2/s^2 (m^2/s^2).
        torque : scalar
            Sum over the joints of the squared ratio of torque to torque limit, without a unit.

        Returns
        -------
        scalar
            Cost without a unit. The reward is minus this cost, and minus `termination` where an episode terminates.

        Examples
        --------
        >>> from adaptctl.envs import RewardWeights
        >>> round(RewardWeights().cost(position=0.02, velocity=0.1, torque=3.0), 3)
        0.033
        """
        return self.position * position + self.velocity * velocity + self.torque * torque


class Judged(NamedTuple):
    """Reward, and 1.0 if a position error passed its bound."""

    reward: Scalar
    lost: Scalar


@dataclass(frozen=True, eq=False)
class Judgement:
    """Rule for reward and termination."""

    weights: RewardWeights
    error_bound: Array
    torque_limits: Array

    def equation(self, p: Column, v: Column, reference_p: Column, reference_v: Column, torque: Column) -> Judged:
        """Reward and termination from Columns (r,)."""
        error, rate = p - reference_p, v - reference_v
        relative = Column(x / limit for x, limit in zip(torque, self.torque_limits.tolist(), strict=True))
        return Judged(-self.weights.cost(error @ error, rate @ rate, relative @ relative), self._lost(error))

    @cached_property
    def kernel(self) -> Kernel:
        """Native code of `equation`."""
        names = ("p", "v", "reference_p", "reference_v", "torque")
        return compile_function(self.equation, dict.fromkeys(names, len(self.error_bound)), name="judgement")

    def _lost(self, error: Column) -> Scalar:
        lost: Scalar = 0.0
        for x, bound in zip(error, self.error_bound.tolist(), strict=True):
            lost = where(absolute(x) > bound, 1.0, lost)
        return lost


def control_period_of(given: object) -> float:
    """Control period in s, checked."""
    return positive_period(given, "control_period")


def steps_of(duration: object, control_period: float) -> int:
    """Number of control periods, at least one."""
    what = f"duration: expected at least one control period of {control_period:g} s"
    if (length := positive_number(duration, what, most=MAX_DURATION)) < control_period:
        raise InputError(f"{what}, got {length}")
    return round(length / control_period)


def times_ahead_of(given: Sequence[float]) -> Array:
    """Look-ahead times (L,) in s, checked."""
    times = numbers(given, "look_ahead", "(L,)")
    times = frozen_array(times, (times.size,), "look_ahead")
    if (times < 0.0).any():
        raise InputError(f"look_ahead: expected times of at least 0 s, got {times.tolist()}")
    return times


def initial_error_of(given: ArrayLike, dof: int) -> Array:
    """Initial position errors (r,), checked."""
    found = finite_numbers(per_joint(given, dof, "initial_error"), "initial_error")
    if (most := float(np.abs(found).max())) > 2.0 * np.pi:
        raise InputError(f"initial_error: expected at most a turn in rad (m), got {most:g}: is it in deg?")
    return found


def known_options(given: Mapping[str, Any] | None, names: Sequence[str]) -> Mapping[str, Any]:
    """Options of a reset, checked."""
    options = given if given is not None else {}
    if not isinstance(options, Mapping):
        raise InputError(f"reset: options: expected a mapping, got {options!r}")
    if unknown := [name for name in options if name not in names]:
        raise NotFoundError(f"reset: unknown option {unknown[0]!r}; options: {', '.join(names)}")
    return options


def weights_of(given: object) -> RewardWeights:
    """Weights, checked."""
    if given is not None and not isinstance(given, RewardWeights):
        raise InputError(f"reward_weights: expected RewardWeights(...), got {given!r:.80}")
    return given or RewardWeights()


def finite_numbers(given: ArrayLike, what: str) -> Array:
    """Finite float64 array, checked."""
    array = numbers(given, what)
    if not np.isfinite(array).all():
        place = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        raise NonFiniteError(f"{what}: expected finite numbers, got {array[place]} at index {place}")
    return array


def finite_actions(
    given: Any, space: gymnasium.Space[Any], what: str = "number", ignored: NDArray[np.bool_] | None = None
) -> Array:
    """Finite actions; zero for ignored arms."""
    actions = numbers(given, "action", f"of shape {space.shape}").copy()
    if actions.shape != space.shape:
        raise InputError(f"action: expected shape {space.shape}, got {actions.shape}")
    if ignored is not None:
        actions[ignored] = 0.0
    if not np.isfinite(actions).all():
        *arm, number = np.argwhere(~np.isfinite(actions))[0].tolist()
        whose = f" of arm {arm[0]}" if arm else ""
        raise NonFiniteError(
            f"action: expected finite numbers, got {actions[(*arm, number)]} for {what} {number}{whose}"
        )
    return actions


def validate_reference(given: Trajectory, dof: int) -> None:
    """Raise `InputError` unless it fits `dof` joints."""
    if isinstance(given, list | tuple | np.ndarray):  # one for each arm of a vector environment
        for one in given:
            validate_trajectory(one, "reference")
        return
    validate_trajectory(given, "reference")
    if callable(given):
        validate_point(point := given(np.zeros(1)))
        if any((shape := np.shape(part)) != (1, dof) for part in (point.p, point.v, point.a)):
            raise InputError(
                f"reference: expected {dof} joints, p, v and a (n, {dof}) at times (n,), got {shape} for n = 1"
            )


@sent_as_made
@dataclass
class RunningEpisode:
    """State of a running episode."""

    parameters: Array
    preview: Preview
    state: PlantState
    step: int = 0
    clipped: int = 0
    over: bool = False
