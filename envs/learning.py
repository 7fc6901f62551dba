"""Tracking environments whose observations and actions are in [-1, 1], for one arm and for many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.envs.built_in import Puma560TrackingEnv
from adaptctl.envs.many.vector_tracking import Puma560VectorTrackingEnv, VectorTrackingEnv
from adaptctl.envs.task import finite_actions
from adaptctl.envs.tracking import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.tuning.feasible_reference import motion_ranges

Observation = NDArray[np.float32]
PRECISION = 0.1
"""Tracking error that is observed as a half: a share of half the joint's range, or of the bound where that is less."""
RATE = 5.0
"""1/s, velocity errors over errors that are observed alike"""


@dataclass(frozen=True, eq=False)
class NormalisedView:
    """Callable that normalises observations of a tracking environment for learners: from observations (..., n) to
    numbers x / (|x| + c) in (-1, 1), unitless, (..., n), float32. Large values are not cut off, and small errors stay
    distinct.

    For r joints and L look-ahead times n = 5r + r L, and x is in turn, each (r,): position error and velocity error,
    actual less reference; position from the middle of the joint's range; velocity; the reference's acceleration; and
    for each time ahead the reference's position then less that now; rad, rad/s, rad/s^2 (m, m/s, m/s^2 if prismatic).

    `slices` are the environment's `observation_slices`, which map p, v, reference_p, reference_v, reference_a and
    look_ahead, in this order, to slices of an observation; `middle` (r,) are the middles of the joints' ranges, rad
    (m); `scale` (n,) are the c, each in its x's unit: the x that becomes 1/2. Made by `NormalisedView.of`; nothing is
    checked.
    """

    slices: Mapping[str, slice]
    middle: Array
    scale: Array

    @classmethod
    def of(cls, env: TrackingEnv) -> NormalisedView:
        """The `NormalisedView` of the observations of `env`, a `TrackingEnv`. With h half a joint's range (1 rad or m
        where it has none) and e = 0.1 min(h, the error bound), the scales c are e for position errors and for the
        reference's positions ahead less those now, 5/s times e for velocity errors, and h, h/s and h/s^2 for positions,
        velocities and accelerations. Nothing is checked."""
        lower, upper = motion_ranges(env.mechanism)
        half = 0.5 * (upper - lower)
        error = PRECISION * np.minimum(half, env.error_bound)
        ahead = [error] * len(env.look_ahead)
        scale = np.concatenate([error, RATE * error, half, half, half, *ahead])
        return cls(env.observation_slices, 0.5 * (lower + upper), scale)

    @property
    def space(self) -> gymnasium.spaces.Box:
        """Observation space of one arm after normalisation, `Box(-1, 1, (n,), float32)`, unitless: n = 5r + r L for r
        joints and L look-ahead times."""
        return gymnasium.spaces.Box(-1.0, 1.0, self.scale.shape, np.float32)

    def __call__(self, observation: Any) -> Observation:
        """The normalised values (..., n) of observations (..., n), n numbers each, scaled to [-1, 1], unitless."""
        p, v, desired, rate, acceleration = (observation[..., part] for part in list(self.slices.values())[:5])
        ahead = observation[..., self.slices["look_ahead"]]
        ahead = ahead - np.tile(desired, ahead.shape[-1] // desired.shape[-1])
        seen = np.concatenate((p - desired, v - rate, p - self.middle, v, acceleration, ahead), axis=-1)
        return np.asarray(seen / (np.abs(seen) + self.scale), dtype=np.float32)


class LearningEnv(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """
    ## Description

    A wrapper of `TrackingEnv` for reinforcement learning: observations and actions are scaled to [-1, 1], unitless.
    Rewards, episodes, options and `info` are the environment's own, so that returns compare with those of controllers
    that drive it: `adaptctl.envs.baselines` computes them. `env` may be a `TuningEnv` or a `ResidualEnv` too. Raises
    `InputError` for an environment that is none of these, or whose observations a wrapper has changed.

    ```python
    env = gymnasium.make("adaptctl.envs:adaptctl/Puma560Learning-v0")     # or Learning-v0, robot=...
    many = gymnasium.make_vec("adaptctl.envs:adaptctl/Puma560Learning-v0", num_envs=64)
    ```

    Those two hold a torque for `control_period` 0.02 s and last `duration` 5 s, 250 steps: at 1 kHz a learner has to
    look a thousand steps ahead to see what a torque does. All other arguments are those of `TrackingEnv`.

    ## Action space

    `Box(-1, 1, (r,), float32)`, r joints: fractions of the torque limits; or the actions of `ResidualEnv` (r,) or
    `TuningEnv` (a,), a the number of its scaled gains, unchanged, where one of those is wrapped. What is out of bounds
    is clipped by the environment. A wrong shape raises `InputError`, NaN and infinity `NonFiniteError`.

    ## Observation space

    `Box(-1, 1, (5r + r L,), float32)` for r joints and L look-ahead times, whichever environment is wrapped: each
    number x, in rad, rad/s or rad/s^2 (m, m/s, m/s^2), becomes x / (|x| + c), with a scale c in the unit of x. Indices
    are zero-based, the last exclusive.

    | Indices     | Number x                                             | Scale c                             |
    |-------------|------------------------------------------------------|-------------------------------------|
    | 0 to r      | position minus the reference's                       | a tenth of h (below), or of the error bound where that is less |
    | r to 2r     | velocity minus the reference's                       | 5/s times the first                 |
    | 2r to 3r    | position from the middle of the joint's range        | h, half the range (1 rad or m where there is none) |
    | 3r to 4r    | velocity                                             | h a second                          |
    | 4r to 5r    | the reference's acceleration                         | h a second squared                  |
    | from 5r     | the reference's positions ahead minus those now      | as the first, each of the L times   |

    ## Version history

    * v0: first version
    """  # noqa: E501  # a table

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        self._view, self._scale = NormalisedView.of(_observed(env)), _scale(env.action_space)
        self.observation_space = self._view.space
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, self._scale.shape, np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """First observation (n,), float32, scaled to [-1, 1], unitless, and `info` of a new episode, which this call
        begins. The observation has for r joints and L look-ahead times n = 5r + r L: position and velocity errors,
        positions, velocities and the reference's accelerations, r each, then its positions at each of the L times ahead
        less those now. `info` is that of the wrapped environment.

        `seed` is that of the random numbers, None to go on with them. `options`, None for none, are those of
        `TrackingEnv.reset`: `payload` (a mass in kg, a `Payload`, or a mapping with `mass`, kg, `center` (3,), m, and
        `inertia` (3, 3), kg m^2, about that centre, in the last link's frame), `trajectory` (a `Reference`, a seed or
        "random"), `initial_error` (one number or (r,), rad, m if prismatic) and `parameters` (P,), the P true inertial
        and friction ones, SI units, in the order of `Mechanism.parameter_names`. Raises `InputError` for bad options
        (its subclass `NotFoundError` for unknown ones), `SingularityError` where loops cannot be followed to the start,
        Gymnasium's `Error` for a bad seed.
        """
        observation, info = self.env.reset(seed=seed, options=options)
        return self._view(observation), info

    def step(self, action: Any) -> tuple[Observation, Any, bool, bool, dict[str, Any]]:
        """Observation (n,), float32, scaled to [-1, 1], reward (unitless), `terminated`, `truncated` and `info` after
        one control period, by which this call advances the environment. The action (r,) in [-1, 1] is the torque as
        fractions of the torque limits; around a `TuningEnv` or a `ResidualEnv` it is that environment's, (a,) or (r,).
        The observation has for r joints and L look-ahead times n = 5r + r L: position and velocity errors, positions,
        velocities and the reference's accelerations, r each, then its positions at each of the L times ahead less those
        now.

        `info`, reward and ends are those of the wrapped environment: `terminated` is True where a joint's error passes
        its bound or kinematic loops come near a singularity (the smallest singular value of their closure Jacobian
        below 0.05 of that at the reference configuration) or leave bounds that the robot's file states, `truncated`
        where the duration is over. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN and infinity and where
        the motion diverges to non-finite values, Gymnasium's `ResetNeeded` before the first reset and after the
        episode's end.
        """
        share = finite_actions(action, self.action_space)
        observation, reward, terminated, truncated, info = self.env.step(share * self._scale)
        return self._view(observation), reward, terminated, truncated, info


class LearningVectorEnv(gymnasium.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """Vector environment of N arms for reinforcement learning, a wrapper of `env`, a `VectorTrackingEnv`, a
    `ResidualVectorEnv` or a `TuningVectorEnv`, that scales observations and actions to [-1, 1], each arm's as in
    `LearningEnv`. Observations (N, n), n = 5r + r L for r joints and L look-ahead times, are float32, unitless; actions
    (N, a) are fractions of the torque limits, a = r, or those of the other two environments, unchanged. Raises
    `InputError` for another vector environment, and for one whose observations a wrapper has changed."""

    def __init__(self, env: gymnasium.vector.VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        self._view, self._scale = NormalisedView.of(_observed(env)), _scale(env.single_action_space)
        self.single_observation_space = self._view.space
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, self._scale.shape, np.float32)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """First observations (N, n), float32, scaled to [-1, 1], unitless, and `info` of new episodes of all N arms,
        which this call begins; with `autoreset_mode` "Disabled" only of those in the option `reset_mask`, bools (N,). A
        row of observations has for r joints and L look-ahead times n = 5r + r L: position and velocity errors,
        positions, velocities and the reference's accelerations, r each, then its positions at each of the L times ahead
        less those now.

        `seed` s gives arm i, from 0, the seed s + i, a list has one for each arm, None lets the random numbers go on.
        `options`, None for none, are those of `TrackingEnv.reset`, for all arms or one each: `payload` (a mass in kg, a
        `Payload`, or a mapping with `mass`, kg, `center` (3,), m, and `inertia` (3, 3), kg m^2, about that centre, in
        the last link's frame), `trajectory` (a `Reference`, a seed or "random"), `initial_error` (one number, (r,) or
        (N, r), rad, m if prismatic) and `parameters`, (P,) or (N, P), the P true inertial and friction ones, SI units,
        in the order of `Mechanism.parameter_names`. Raises `InputError` for bad seeds and options (its subclass
        `NotFoundError` for unknown options), `SingularityError` where loops cannot be followed to the start,
        Gymnasium's `ResetNeeded` for a part of the arms before the first reset of all.
        """
        observations, info = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]  # ours take more
        return self._view(observations), info

    def step(self, actions: Any) -> tuple[Observation, Any, Any, Any, dict[str, Any]]:
        """Observations (N, n), float32, scaled to [-1, 1], rewards (N,), unitless, `terminated` and `truncated`, bools
        (N,), and `info` after one control period, by which this call advances all N arms. Actions (N, r) in [-1, 1] are
        torques as fractions of the torque limits; around a `TuningVectorEnv` or a `ResidualVectorEnv` they are that
        environment's, (N, a) or (N, r). A row of observations has for r joints and L look-ahead times n = 5r + r L:
        position and velocity errors, positions, velocities and the reference's accelerations, r each, then its
        positions at each of the L times ahead less those now.

        `info`, rewards and ends are those of the wrapped environment: `terminated` is True where a joint's error passes
        its bound or kinematic loops come near a singularity (the smallest singular value of their closure Jacobian
        below 0.05 of that at the reference configuration) or leave bounds that the robot's file states, `truncated`
        where the duration is over. `final_obs` in `info` is scaled likewise. Raises `InputError` on a wrong shape,
        `NonFiniteError` on NaN and infinity and where a motion diverges to non-finite values, Gymnasium's `ResetNeeded`
        before the first reset, and with `autoreset_mode` "Disabled" where an arm's episode is over.
        """
        shares = finite_actions(actions, self.action_space)
        observations, rewards, terminated, truncated, info = self.env.step(shares * self._scale)
        if "final_obs" in info:
            last = [None if one is None else self._view(one) for one in info["final_obs"]]
            info = info | {"final_obs": np.fromiter(last, dtype=object, count=len(last))}
        return self._view(observations), rewards, terminated, truncated, info


DEFAULTS: dict[str, Any] = {"control_period": 0.02, "duration": 5.0}
"""What differs from `TrackingEnv`."""
MANY: dict[str, Any] = DEFAULTS | {"autoreset_mode": "SameStep"}
"""What differs from `VectorTrackingEnv`: learners want the last observation and the first in one step."""


def learning(**settings: Any) -> LearningEnv:
    """Learning environment `adaptctl/Learning-v0`: a `TrackingEnv` of any robot in a `LearningEnv`, a wrapper that
    scales observations and actions to [-1, 1].

    `settings` are arguments of `TrackingEnv` by keyword; those not given have its defaults, but for `control_period`,
    0.02 s, and `duration`, 5 s. Raises what `TrackingEnv` raises: `InputError` for bad values, of these `NotFoundError`
    for an unknown built-in robot and `FileError` for a bad file; `TypeError` for an unknown argument.
    """
    return LearningEnv(TrackingEnv(**DEFAULTS | settings))


def puma560_learning(**settings: Any) -> LearningEnv:
    """Learning environment of the PUMA 560 arm, `adaptctl/Puma560Learning-v0`: a `Puma560TrackingEnv` in a
    `LearningEnv`, a wrapper that scales observations and actions to [-1, 1].

    `settings` are arguments of `Puma560TrackingEnv` by keyword; those not given have its defaults, but for
    `control_period`, 0.02 s, and `duration`, 5 s. Raises what that environment raises: `InputError` for bad values, of
    these `NotFoundError` for an unknown built-in robot and `FileError` for a bad file; `TypeError` for an unknown
    argument.
    """
    return LearningEnv(Puma560TrackingEnv(**DEFAULTS | settings))


def many_learning(num_envs: int = 1, **settings: Any) -> LearningVectorEnv:
    """Learning environment `adaptctl/Learning-v0` of `num_envs` arms (1 by default): a `VectorTrackingEnv` of any robot
    in a `LearningVectorEnv`, a wrapper that scales observations and actions to [-1, 1]. An arm whose episode ends
    begins the next in the same step (`autoreset_mode` "SameStep").

    `settings` are arguments of `VectorTrackingEnv` by keyword; those not given have its defaults, but for
    `control_period`, 0.02 s, `duration`, 5 s, and `autoreset_mode`. Raises what that environment raises: `InputError`
    for bad values, of these `NotFoundError` for unknown names and `FileError` for a bad file; `TypeError` for an
    unknown argument.
    """
    return LearningVectorEnv(VectorTrackingEnv(num_envs, **MANY | settings))


def many_puma560_learning(num_envs: int = 1, **settings: Any) -> LearningVectorEnv:
    """Learning environment `adaptctl/Puma560Learning-v0` of `num_envs` PUMA 560 arms (1 by default): a
    `Puma560VectorTrackingEnv` in a `LearningVectorEnv`, a wrapper that scales observations and actions to [-1, 1]. An
    arm whose episode ends begins the next in the same step (`autoreset_mode` "SameStep").

    `settings` are arguments of `Puma560VectorTrackingEnv` by keyword; those not given have its defaults, but for
    `control_period`, 0.02 s, `duration`, 5 s, and `autoreset_mode`. Raises what that environment raises: `InputError`
    for bad values, of these `NotFoundError` for unknown names and `FileError` for a bad file; `TypeError` for an
    unknown argument.
    """
    return LearningVectorEnv(Puma560VectorTrackingEnv(num_envs, **MANY | settings))


def _scale(space: Any) -> Array:
    return np.asarray(space.high, dtype=np.float64)


def _observed(env: Any) -> TrackingEnv:
    """The tracking environment whose observations an environment passes on as they are."""
    inner = tracking_of(env)
    if getattr(env, "single_observation_space", env.observation_space) != inner.observation_space:
        raise InputError(
            f"{env}: expected observations in their own units: they have been changed by a wrapper already"
        )
    return inner


def tracking_of(env: Any) -> TrackingEnv:
    """The `TrackingEnv` inside the wrappers of an environment `env`; for a vector environment of many arms, the
    single-arm environment that holds its settings. Raises `InputError` for an environment that is not made on a
    `TrackingEnv`."""
    inner = getattr(env, "unwrapped", env)
    inner = getattr(inner, "single", inner)
    if not isinstance(inner, TrackingEnv):
        raise InputError(f"{env}: expected a tracking environment of adaptctl, such as adaptctl/Tracking-v0")
    return inner
