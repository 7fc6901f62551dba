"""Adapter to stable-baselines3 (extra `rl`)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.envs.many.learner_view import LearnerView
from adaptctl.errors import InputError, MissingExtraError

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise MissingExtraError(
        "adaptctl.envs.sb3 adapts environments to stable-baselines3, which is not installed: pip install 'adaptctl[rl]'"
    ) from error


class TrackingVecEnv(VecEnv):  # type: ignore[misc]  # stable-baselines3 need not be installed
    """`VecEnv` of stable-baselines3 for N arms."""

    def __init__(self, env: gymnasium.vector.VectorEnv[Any, Any, Any]) -> None:
        self.view, self.actions = LearnerView(env), np.zeros(0)
        super().__init__(env.num_envs, self.view.observation_space, self.view.action_space)

    def reset(self) -> Array:
        """First observations (N, n)."""
        observations = self.view.reset(self._seeds, self._options)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: Array) -> None:
        """Store the actions (N, a)."""
        self.actions = actions

    def step_wait(self) -> tuple[Array, Array, NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations, rewards, ends and infos."""
        return self.view.step(self.actions)

    def close(self) -> None:
        """Close the vector environment."""
        self.view.env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8]]:
        """RGB images of the arms."""
        return self.view.env.render() or ()

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """Attribute, once per arm."""
        inner = self.view.env.unwrapped
        owner = next((one for one in (self.view.env, inner) if hasattr(one, attr_name)), inner.single)
        return [getattr(owner, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Raise `InputError`: the arms share their settings."""
        raise InputError(f"{attr_name}: the arms share their settings: use `set_options`, or create a new environment")

    def env_method(
        self, method_name: str, *method_args: Any, indices: int | Iterable[int] | None = None, **method_kwargs: Any
    ) -> list[Any]:
        """Raise `InputError`: the arms share their methods."""
        raise InputError(f"{method_name}: the arms are stepped together and have no separate methods")

    def env_is_wrapped(self, wrapper_class: type, indices: int | Iterable[int] | None = None) -> list[bool]:
        """False for each arm."""
        return [False for _ in self._get_indices(indices)]
