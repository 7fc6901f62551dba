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
HALF_SCALE_ERROR_SHARE = 0.1
"""Tracking error that is observed as a half: a share of half the joint's range, or of the bound where that is less."""
VELOCITY_SCALE_RATE = 5.0
"""1/s, velocity errors over errors that are observed alike"""


@dataclass(frozen=True, eq=False)
class NormalisedView:
    """Map from observations (..., n) to numbers x/(|x| + c) in (-1, 1) for learners."""

    slices: Mapping[str, slice]
    middle: Array
    scale: Array

    @classmethod
    def of(cls, env: TrackingEnv) -> NormalisedView:
        """View of the observations of an environment, with scales c of its joint ranges and error bound."""
        lower, upper = motion_ranges(env.mechanism)
        half = 0.5 * (upper - lower)
        error = HALF_SCALE_ERROR_SHARE * np.minimum(half, env.error_bound)
        ahead = [error] * len(env.look_ahead)
        scale = np.concatenate([error, VELOCITY_SCALE_RATE * error, half, half, half, *ahead])
        return cls(env.observation_slices, 0.5 * (lower + upper), scale)

    @property
    def space(self) -> gymnasium.spaces.Box:
        """Observation space of one arm."""
        return gymnasium.spaces.Box(-1.0, 1.0, self.scale.shape, np.float32)

    def __call__(self, observation: Any) -> Observation:
        """Normalised observations (..., n)."""
        p, v, desired, rate, acceleration = (observation[..., part] for part in list(self.slices.values())[:5])
        ahead = observation[..., self.slices["look_ahead"]]
        ahead = ahead - np.tile(desired, ahead.shape[-1] // desired.shape[-1])
        seen = np.concatenate((p - desired, v - rate, p - self.middle, v, acceleration, ahead), axis=-1)
        return np.asarray(seen / (np.abs(seen) + self.scale), dtype=np.float32)


class LearningEnv(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """
    Wrapper for reinforcement learning with observations and actions in [-1, 1].

    Parameters
    ----------
    env : gymnasium.Env
        A `TrackingEnv`, `ResidualEnv` or `TuningEnv` of r joints.

    Raises
    ------
    InputError
        If the environment is none of these or a wrapper has changed its observations.

    Notes
    -----
    Rewards, episodes, options and `info` are the environment's own, so returns compare with those of
    `adaptctl.envs.baselines`. The registered `adaptctl/Learning-v0` and `adaptctl/Puma560Learning-v0` hold a torque for
    0.02 s and last 5 s: at 1 kHz a learner has to look a thousand steps ahead to see the effect of a torque. Their
    other arguments are those of `TrackingEnv`.

    ## Action space

    `Box(-1, 1, (r,), float32)`: fractions of the torque limits; the actions of `ResidualEnv` or `TuningEnv` are left as
    they are. What is out of bounds is clipped by the environment. A wrong shape raises `InputError`, NaN and infinity
    `NonFiniteError`.

    ## Observation space

    `Box(-1, 1, (5r + r L,), float32)` for L look-ahead times: each number x becomes x/(|x| + c). Indices are
    zero-based, the last exclusive.

    | Indices     | Number x                                             | Scale c                             |
    |-------------|------------------------------------------------------|-------------------------------------|
    | 0 to r      | position minus the reference's                       | a tenth of h (below), or of the error bound
    where that is less |
    | r to 2r     | velocity minus the reference's                       | 5/s times the first                 |
    | 2r to 3r    | position from the middle of the joint's range        | h, half the range (1 rad or m where there is
    none) |
    | 3r to 4r    | velocity                                             | h per second                        |
    | 4r to 5r    | the reference's acceleration                         | h per second squared                |
    | from 5r     | the reference's positions ahead minus those now      | as the first, each of the L times   |

    ## Version history

    * v0: first version

    Examples
    --------
    >>> from adaptctl.envs import LearningEnv
    >>> learner = LearningEnv(env)
    >>> observation, info = learner.reset(seed=0)
    >>> bool(np.all(np.abs(observation) <= 1.0))
    True
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        self._view, self._scale = NormalisedView.of(_observed(env)), _scale(env.action_space)
        self.observation_space = self._view.space
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, self._scale.shape, np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """
        Begin a new episode.

        Parameters
        ----------
        seed : int, optional
            Seed of the random numbers. Default: they go on.
        options : dict, optional
            Options at reset of `TrackingEnv`. Default: none.

        Returns
        -------
        tuple
            First observation (n,) in [-1, 1] and `info` of the environment.
        """
        observation, info = self.env.reset(seed=seed, options=options)
        return self._view(observation), info

    def step(self, action: Any) -> tuple[Observation, Any, bool, bool, dict[str, Any]]:
        """
        Advance the environment by a control period.

        Parameters
        ----------
        action : array_like
            Action (r,) or (a,) in [-1, 1].

        Returns
        -------
        tuple
            Observation (n,) in [-1, 1], reward, `terminated`, `truncated` and `info` of the environment.
        """
        share = finite_actions(action, self.action_space)
        observation, reward, terminated, truncated, info = self.env.step(share * self._scale)
        return self._view(observation), reward, terminated, truncated, info


class LearningVectorEnv(gymnasium.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """
    Vector environment for reinforcement learning, with observations and actions in [-1, 1].

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        A `VectorTrackingEnv`, `ResidualVectorEnv` or `TuningVectorEnv` of N arms.

    Raises
    ------
    InputError
        If the environment is none of these or a wrapper has changed its observations.

    Notes
    -----
    Observations (N, n) and actions (N, a) are as in `LearningEnv`.

    Examples
    --------
    >>> from adaptctl.envs import LearningVectorEnv, VectorTrackingEnv
    >>> many = LearningVectorEnv(VectorTrackingEnv(3, robot=arm, reference=reference, duration=0.1))
    >>> many.observation_space.shape
    (3, 14)
    """

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
        """
        Begin new episodes.

        Parameters
        ----------
        seed : int or sequence, optional
            Seed s gives arm i the seed s + i; a list has one for each arm. Default: the random numbers go on.
        options : Mapping, optional
            Options at reset of `VectorTrackingEnv`. Default: none.

        Returns
        -------
        tuple
            First observations (N, n) in [-1, 1] and `info` of the environment.
        """
        observations, info = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]  # ours take more
        return self._view(observations), info

    def step(self, actions: Any) -> tuple[Observation, Any, Any, Any, dict[str, Any]]:
        """
        Advance all arms by a control period.

        Parameters
        ----------
        actions : array_like
            Actions (N, a) in [-1, 1].

        Returns
        -------
        tuple
            Observations (N, n) in [-1, 1], rewards (N,), `terminated` and `truncated` (N,), and `info` of the
            environment, its `final_obs` scaled likewise.
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
    """Environment `adaptctl/Learning-v0`: a `TrackingEnv` of 0.02 s periods and 5 s episodes in a `LearningEnv`."""
    return LearningEnv(TrackingEnv(**DEFAULTS | settings))


def puma560_learning(**settings: Any) -> LearningEnv:
    """Environment `adaptctl/Puma560Learning-v0`: a `Puma560TrackingEnv` in a `LearningEnv`."""
    return LearningEnv(Puma560TrackingEnv(**DEFAULTS | settings))


def many_learning(num_envs: int = 1, **settings: Any) -> LearningVectorEnv:
    """Vector environment `adaptctl/Learning-v0` of `num_envs` arms in a `LearningVectorEnv`."""
    return LearningVectorEnv(VectorTrackingEnv(num_envs, **MANY | settings))


def many_puma560_learning(num_envs: int = 1, **settings: Any) -> LearningVectorEnv:
    """Vector environment `adaptctl/Puma560Learning-v0` of `num_envs` arms in a `LearningVectorEnv`."""
    return LearningVectorEnv(Puma560VectorTrackingEnv(num_envs, **MANY | settings))


def _scale(space: Any) -> Array:
    return np.asarray(space.high, dtype=np.float64)


def _observed(env: Any) -> TrackingEnv:
    """Tracking environment whose observations an environment passes on as they are."""
    inner = tracking_of(env)
    if getattr(env, "single_observation_space", env.observation_space) != inner.observation_space:
        raise InputError(f"{env}: expected observations in SI units, but a wrapper has changed them")
    return inner


def tracking_of(env: Any) -> TrackingEnv:
    """The `TrackingEnv` inside wrappers or a vector environment; others raise `InputError`."""
    inner = getattr(env, "unwrapped", env)
    inner = getattr(inner, "single", inner)
    if not isinstance(inner, TrackingEnv):
        raise InputError(f"{env}: expected a tracking environment of adaptctl, such as adaptctl/Tracking-v0")
    return inner
