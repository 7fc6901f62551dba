"""Environments with observations and actions in [-1, 1]."""

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
"""Error observed as a half, as a share of half the joint range."""
VELOCITY_SCALE_RATE = 5.0
"""1/s, scale of velocity errors over that of errors."""


@dataclass(frozen=True, eq=False)
class NormalisedView:
    """Map from observations (..., n) to x/(|x| + c)."""

    slices: Mapping[str, slice]
    middle: Array
    scale: Array

    @classmethod
    def of(cls, env: TrackingEnv) -> NormalisedView:
        """View with the scales c of an environment."""
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
    Rewards, episodes, options and `info` are the environment's.

    ## Action space

    `Box(-1, 1, (r,), float32)`: fractions of the torque limits, clipped; those of `ResidualEnv` and `TuningEnv` are
    unchanged.

    ## Observation space

    `Box(-1, 1, (5r + r L,), float32)` for L look-ahead times: each number x is scaled to x/(|x| + c), with h half the
    joint's range (1 rad or m without limits) and b a tenth of h, or of the error bound where that is less.

    - 0 to r: position errors, c = b
    - r to 2r: velocity errors, c = 5 b/s
    - 2r to 3r: positions from mid-range, c = h
    - 3r to 4r: velocities, c = h/s
    - 4r to 5r: reference accelerations, c = h/s^2
    - 5r to end: reference positions ahead, less those now, c = b

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
            Seed of the random numbers. Default: the generator goes on from the last episode.
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
            Action (r,) or (a,) in [-1, 1], as fractions of the environment's bounds.

        Returns
        -------
        tuple
            Observation (n,) in [-1, 1], reward, `terminated`, `truncated` and `info` of the environment.

        Raises
        ------
        InputError
            If the shape is wrong.
        NonFiniteError
            If the action or the motion is NaN or infinite.
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
"""Differences from `TrackingEnv`."""
MANY: dict[str, Any] = DEFAULTS | {"autoreset_mode": "SameStep"}
"""Differences from `VectorTrackingEnv`."""


def learning(**settings: Any) -> LearningEnv:
    """Environment `adaptctl/Learning-v0`."""
    return LearningEnv(TrackingEnv(**DEFAULTS | settings))


def puma560_learning(**settings: Any) -> LearningEnv:
    """Environment `adaptctl/Puma560Learning-v0`."""
    return LearningEnv(Puma560TrackingEnv(**DEFAULTS | settings))


def many_learning(num_envs: int = 1, **settings: Any) -> LearningVectorEnv:
    """Vector environment `adaptctl/Learning-v0`."""
    return LearningVectorEnv(VectorTrackingEnv(num_envs, **MANY | settings))


def many_puma560_learning(num_envs: int = 1, **settings: Any) -> LearningVectorEnv:
    """Vector environment `adaptctl/Puma560Learning-v0`."""
    return LearningVectorEnv(Puma560VectorTrackingEnv(num_envs, **MANY | settings))


def _scale(space: Any) -> Array:
    return np.asarray(space.high, dtype=np.float64)


def _observed(env: Any) -> TrackingEnv:
    """Tracking environment with these observations."""
    inner = tracking_of(env)
    if getattr(env, "single_observation_space", env.observation_space) != inner.observation_space:
        raise InputError(f"{env}: expected observations in SI units, but a wrapper has changed them")
    return inner


def tracking_of(env: Any) -> TrackingEnv:
    """`TrackingEnv` inside wrappers or a vector environment."""
    inner = getattr(env, "unwrapped", env)
    inner = getattr(inner, "single", inner)
    if not isinstance(inner, TrackingEnv):
        raise InputError(f"{env}: expected a tracking environment of adaptctl, such as adaptctl/Tracking-v0")
    return inner
