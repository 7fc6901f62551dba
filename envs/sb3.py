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
    """Vector environment of N arms for stable-baselines3, a `VecEnv` made from `env`, a vector environment of adaptctl
    in wrappers or not, such as `make_vec("adaptctl.envs:adaptctl/Learning-v0")` makes, a `ResidualVectorEnv` or a
    `TuningVectorEnv`, whose `autoreset_mode` is "SameStep".

    Actions (N, a), unitless, are in [-1, 1], fractions of the largest action of `env`, such as its torque limits;
    observations (N, n) are those of `env`. An arm whose episode ends begins the next in the same step: its info then
    has `terminal_observation` (n,) and `TimeLimit.truncated`, as stable-baselines3 expects. Raises `InputError` for
    another environment and another `autoreset_mode`. Importing the module raises `MissingExtraError` without
    stable-baselines3.
    """

    def __init__(self, env: gymnasium.vector.VectorEnv[Any, Any, Any]) -> None:
        self.view, self.actions = LearnerView(env), np.zeros(0)
        super().__init__(env.num_envs, self.view.observation_space, self.view.action_space)

    def reset(self) -> Array:
        """First observations (N, n), n numbers an arm, in the order and the units of the wrapped environment, of new
        episodes of all N arms, which this call begins with the seeds and options that stable-baselines3's `seed` and
        `set_options` have set; these are then cleared. Raises `InputError` for bad seeds and options (its subclass
        `NotFoundError` for unknown options); `SingularityError` where loops cannot be followed to the start."""
        observations = self.view.reset(self._seeds, self._options)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: Array) -> None:
        """Store the `actions` (N, a) of N arms, a numbers each, unitless, in [-1, 1], for the next `step_wait`, which
        checks them. Nothing moves yet; nothing is returned or raised."""
        self.actions = actions

    def step_wait(self) -> tuple[Array, Array, NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations (N, n), rewards (N,), unitless, flags (N,), True where an episode has ended, and a list of N
        infos, one dictionary an arm, after one control period, by which this call advances the arms under the actions
        that `step_async` stored. Observations have n numbers an arm, in the order and the units of the wrapped
        environment.

        An arm whose episode has ended has started the next, whose first observation this is; its info has
        `terminal_observation` (n,), the last one of the old episode, and `TimeLimit.truncated`, True if it ended by its
        duration alone. Other infos are empty. Raises `InputError` on a wrong shape of the actions, `NonFiniteError` on
        NaN and infinity and where a motion diverges to non-finite values, Gymnasium's `ResetNeeded` before the first
        reset.
        """
        return self.view.step(self.actions)

    def close(self) -> None:
        """Close the vector environment of the arms. Nothing is returned."""
        self.view.env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8]]:
        """RGB images (480, 640, 3), uint8, of the arms, one each; () where the environment was made without
        `render_mode="rgb_array"`. Raises Gymnasium's `ResetNeeded` before the first reset."""
        return self.view.env.render() or ()

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """List of the value of the attribute `attr_name`, once for each of the arms of `indices` (one index, from 0, or
        several, None for all): that of the vector environment or, where it has none of that name, of the single-arm
        environment that holds its settings. Raises `AttributeError` for a name that neither has."""
        inner = self.view.env.unwrapped
        owner = next((one for one in (self.view.env, inner) if hasattr(one, attr_name)), inner.single)
        return [getattr(owner, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Raise `InputError`, whatever is given: the arms share one set of settings, so that attributes cannot be set
        for each."""
        raise InputError(f"{attr_name}: arms share what they are made with: use `set_options`, or make others")

    def env_method(
        self, method_name: str, *method_args: Any, indices: int | Iterable[int] | None = None, **method_kwargs: Any
    ) -> list[Any]:
        """Raise `InputError`, whatever is given: the arms are stepped together and have no methods of their own."""
        raise InputError(f"{method_name}: arms are stepped together and have no methods of their own")

    def env_is_wrapped(self, wrapper_class: type, indices: int | Iterable[int] | None = None) -> list[bool]:
        """List of False, once for each of the arms of `indices` (one index, from 0, or several, None for all), since no
        arm is in a wrapper of its own, `wrapper_class` or any other. Nothing is checked."""
        return [False for _ in self._get_indices(indices)]
