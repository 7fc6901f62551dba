"""Rewards for tracking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, frozen_array, numbers, per_joint, positive_number, real_number
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.compilation import Kernel, compile_function
from adaptctl.envs.random_reference import Trajectory, validate_trajectory
from adaptctl.errors import InputError, NonFiniteError, NotFoundError
from adaptctl.scalars import Column, Scalar, absolute, where
from adaptctl.simulation.period import PlantState
from adaptctl.simulation.references import Preview, validate_point


@dataclass(frozen=True)
class RewardWeights:
    """Weights of the reward for tracking a reference: factors of the squared errors and torques, summed over the
    joints, that are subtracted at each control period.

    `position`, per rad^2 (m^2 if prismatic) of position error; `velocity`, per (rad/s)^2 ((m/s)^2) of velocity error;
    `torque`, unitless, per square of the ratio torque/limit; `termination`, unitless, is subtracted once when an
    episode is terminated, as by an error that passes its bound. Without it a learner whose every reward is negative
    would do best by ending the episode at once. Raises `InputError` at construction for a weight that is no number,
    negative or not finite.
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
        """Tracking cost of a control period, unitless, without the penalty for termination: the sum of the arguments,
        each times this object's weight of the same name. The arguments are sums over the joints, `position` of squared
        position errors, rad^2 (m^2), `velocity` of squared velocity errors, (rad/s)^2 ((m/s)^2), and `torque` of
        (torque/limit)^2, unitless: scalars, or arrays that broadcast, of any kind of number. Nothing is checked."""
        return self.position * position + self.velocity * velocity + self.torque * torque


class Judged(NamedTuple):
    """Reward and termination of a control period, one scalar each of any kind (float, array over periods or arms, or
    symbol to be compiled): `reward`, unitless, without the penalty for an episode's end, and `lost`, 1.0 if a joint's
    position error passed its bound, else 0.0. Nothing is checked."""

    reward: Scalar
    lost: Scalar


@dataclass(frozen=True, eq=False)
class Judgement:
    """Reward and termination rule of control periods in which r joints track a reference, as an equation over scalars
    of any kind (floats, arrays, or symbols) and as native code. Rewards have the `RewardWeights` `weights`; an episode
    ends where a joint's position error is greater in magnitude than its `error_bound` (r,), rad (m if prismatic).
    Torques count relative to `torque_limits` (r,), N m (N for a prismatic joint). Nothing is checked."""

    weights: RewardWeights
    error_bound: Array
    torque_limits: Array

    def equation(self, p: Column, v: Column, reference_p: Column, reference_v: Column, torque: Column) -> Judged:
        """The reward and the termination flag of one control period, a `Judged`, from Columns (r,), vectors of scalars
        of any kind. These are the positions `p`, rad (m if prismatic), and velocities `v`, rad/s (m/s), reached at the
        period's end, the reference's positions `reference_p` and velocities `reference_v` then, and the `torque`
        applied over the period, N m (N). The reward is minus the weighted sums over the joints of squared position
        errors, squared velocity errors and (torque/limit)^2. Nothing is checked."""
        error, rate = p - reference_p, v - reference_v
        relative = Column(x / limit for x, limit in zip(torque, self.torque_limits.tolist(), strict=True))
        return Judged(-self.weights.cost(error @ error, rate @ rate, relative @ relative), self._lost(error))

    @cached_property
    def kernel(self) -> Kernel:
        """Native code of the method `equation`, a `Kernel`, made at the first use. Called with arrays (r,) for `p`,
        `v`, `reference_p`, `reference_v` and `torque`, in that equation's units, it returns a `Judged` of two floats;
        its method `map` takes arrays (m, r) of m periods, and returns a `Judged` of two arrays (m,). Raises
        `InputError` for other shapes."""
        names = ("p", "v", "reference_p", "reference_v", "torque")
        return compile_function(self.equation, dict.fromkeys(names, len(self.error_bound)), name="judgement")

    def _lost(self, error: Column) -> Scalar:
        lost: Scalar = 0.0
        for x, bound in zip(error, self.error_bound.tolist(), strict=True):
            lost = where(absolute(x) > bound, 1.0, lost)
        return lost


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


def known_options(given: Mapping[str, Any] | None, names: Sequence[str]) -> Mapping[str, Any]:
    """The options of a reset that are `given`, a mapping, empty for None. Raises `InputError` for anything else and
    `NotFoundError` for an option that is not among the `names`."""
    options = given if given is not None else {}
    if not isinstance(options, Mapping):
        raise InputError(f"reset: options: expected a mapping, got {options!r}")
    if unknown := [name for name in options if name not in names]:
        raise NotFoundError(f"reset: unknown option {unknown[0]!r}; options: {', '.join(names)}")
    return options


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


def finite_actions(
    given: Any, space: gymnasium.Space[Any], what: str = "number", ignored: NDArray[np.bool_] | None = None
) -> Array:
    """The actions `given` as a new float64 array of the shape of `space`, a Gymnasium space, in their own unit; they
    are not clipped to its bounds. Those of the arms in the mask `ignored` (N,), if there is one, are zero. Raises
    `InputError` for another shape and for entries that are no numbers, `NonFiniteError`, naming the index of `what`
    and, of many arms, the arm, on NaN and infinity."""
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
    """Raise `InputError` unless `given` stands for a reference of `dof` joints: a callable (a `Reference`), a seed (a
    whole number of at least 0), "random" or None. A callable is called with the time 0 s as an array (1,), and must
    return positions, velocities and accelerations, (1, `dof`) each, in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if
    prismatic); its own errors are not caught. Nothing is returned. A list, tuple or array of several, one for each of
    many arms, passes here and is checked at a reset."""
    if isinstance(given, list | tuple | np.ndarray):
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
    """Mutable state of a running episode of a tracking environment: the plant's P true inertial and friction
    `parameters` (P,), SI units, in the order of `Mechanism.parameter_names`, without the loads of effects; `preview`,
    the `Preview` of its reference; `state`, the `PlantState`; `step`, the number of control periods since its start;
    `clipped`, the number of these in which a torque was clipped; and `over`, True once it has ended. Nothing is
    checked."""

    parameters: Array
    preview: Preview
    state: PlantState
    step: int = 0
    clipped: int = 0
    over: bool = False
