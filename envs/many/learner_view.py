"""Adapter for learners with one flag `done`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, per_joint
from adaptctl.envs.many.vector_tracking import VectorTrackingEnv
from adaptctl.envs.task import finite_actions
from adaptctl.errors import InputError


class LearnerView:
    """
    Vector environment for learners that expect one flag `done` instead of two.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        A `VectorTrackingEnv` of N arms, wrapped or not, with `autoreset_mode` "SameStep".

    Raises
    ------
    InputError
        If the environment is another or resets its arms at another time.

    Examples
    --------
    >>> from adaptctl.envs import VectorTrackingEnv
    >>> from adaptctl.envs.many.learner_view import LearnerView
    >>> settings = {"robot": arm, "reference": reference, "duration": 0.1}
    >>> view = LearnerView(VectorTrackingEnv(3, autoreset_mode="SameStep", **settings))
    >>> view.reset([0, 1, 2], [{}, {}, {}]).shape
    (3, 14)
    """

    def __init__(self, env: gymnasium.vector.VectorEnv[Any, Any, Any]) -> None:
        inner = env.unwrapped
        if not isinstance(inner, VectorTrackingEnv):
            raise InputError(f"{env}: expected a vector environment of adaptctl, as made by make_vec")
        if inner.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise InputError(
                f"{env}: arms must be reset in the same step: use autoreset_mode='SameStep', not "
                f"{inner.autoreset_mode.value!r}"
            )
        self.env: Any = env
        self.observation_space = env.single_observation_space
        own: Any = env.single_action_space
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, own.shape, np.float32)
        self._largest, self._dof = np.asarray(own.high), inner.single.plant.dof

    def reset(self, seeds: Sequence[int | None], options: Sequence[Mapping[str, Any]]) -> Array:
        """First observations (N, n)."""
        count = self.env.num_envs
        listed = isinstance(options, Sequence) and all(isinstance(own, Mapping) for own in options)
        if not listed or len(options) != count:
            raise InputError(f"options: expected a mapping for each of {count} arms, got {options!r:.80}")
        names = set(options[0])
        if any(set(own) != names for own in options):
            raise InputError(
                f"options: expected the same ones for all arms, such as {', '.join(sorted(names)) or 'none'}"
            )
        each: dict[str, Any] = {name: [own[name] for own in options] for name in names}
        if "initial_error" in each:  # One number for all joints would else be one per joint.
            off = enumerate(each["initial_error"])
            each["initial_error"] = [per_joint(own, self._dof, f"initial_error of arm {arm}") for arm, own in off]
        observations: Array = self.env.reset(seed=seeds, options=each)[0]
        return observations

    def step(self, actions: ArrayLike) -> tuple[Array, Array, NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations, rewards, `done` and infos."""
        scaled = finite_actions(actions, self.env.action_space) * self._largest
        observation, reward, terminated, truncated, info = self.env.step(scaled)
        done: NDArray[np.bool_] = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.env.num_envs)]
        for arm in np.flatnonzero(done).tolist():
            infos[arm]["terminal_observation"] = info["final_obs"][arm]
            infos[arm]["TimeLimit.truncated"] = bool(truncated[arm] and not terminated[arm])
        return observation, reward, done, infos
