"""Many arms as a `VecEnv` of stable-baselines3; needs the extra `rl`."""

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
    """A vector environment of ours made with `autoreset_mode="SameStep"`, in wrappers or not, for stable-baselines3:
    what `make_vec("adaptctl/Learning-v0")` makes, a `ResidualVectorEnv`, a `TuningVectorEnv`.

    Actions are in [-1, 1], shares of their largest. See `LearnerView` for the rest.
    """

    def __init__(self, env: gymnasium.vector.VectorEnv[Any, Any, Any]) -> None:
        self.view, self.actions = LearnerView(env), np.zeros(0)
        super().__init__(env.num_envs, self.view.observation_space, self.view.action_space)

    def reset(self) -> Array:
        """Observations (N, n) after an episode of every arm has begun, with the seeds and options that were set."""
        observations = self.view.reset(self._seeds, self._options)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: Array) -> None:
        """Take actions (N, r) in the next `step_wait`."""
        self.actions = actions

    def step_wait(self) -> tuple[Array, Array, NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations (N, n), rewards (N,), ends (N,) and infos after one control period."""
        return self.view.step(self.actions)

    def close(self) -> None:
        """Close the environment of the arms."""
        self.view.env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8]]:
        """Images (height, width, 3) of every arm."""
        return self.view.env.render() or ()

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """An attribute of the vector environment, or of the single one that all arms are like, once for each arm."""
        inner = self.view.env.unwrapped
        owner = next((one for one in (self.view.env, inner) if hasattr(one, attr_name)), inner.single)
        return [getattr(owner, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Raise `InputError`: arms have no attributes of their own."""
        raise InputError(f"{attr_name}: arms share what they are made with: use `set_options`, or make others")

    def env_method(
        self, method_name: str, *method_args: Any, indices: int | Iterable[int] | None = None, **method_kwargs: Any
    ) -> list[Any]:
        """Raise `InputError`: arms have no methods of their own."""
        raise InputError(f"{method_name}: arms are stepped together and have no methods of their own")

    def env_is_wrapped(self, wrapper_class: type, indices: int | Iterable[int] | None = None) -> list[bool]:
        """False for each arm: arms are in no wrappers."""
        return [False for _ in self._get_indices(indices)]
