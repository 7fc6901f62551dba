"""Wrappers that run a controller."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from adaptctl.arrays import Array, positive_number
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.envs.many.vector_tracking import VectorTrackingEnv, masked
from adaptctl.envs.task import finite_actions
from adaptctl.errors import InputError
from adaptctl.simulation.rollout import PARTS, interface


class ControlledEnv(gymnasium.Wrapper[Array, Array, Array, Array], gymnasium.utils.RecordConstructorArgs):
    """Base class of wrappers around one arm."""

    def __init__(
        self, env: gymnasium.Env[Any, Any], controller: Controller[Any], space: gymnasium.Space[Any] | None = None
    ) -> None:
        gymnasium.Wrapper.__init__(self, env)
        validate_controller(controller)
        self._parts, _ = interface(env, controller)
        inner = env.unwrapped
        if (env.observation_space, env.action_space) != (inner.observation_space, inner.action_space):
            raise InputError(
                f"{env}: expected observations and torques in SI units: apply unit-changing wrappers after this one"
            )
        shape = env.action_space.shape or ()
        self.controller: Controller[Any] = controller
        self.action_space = space or gymnasium.spaces.Box(-1.0, 1.0, shape, np.float32)  # type: ignore[assignment]
        self._memory: Any = None
        self._seen: tuple[Array, Array, ReferencePoint]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin a new episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._look(observation)
        self._memory = self.controller.init(*self._seen[:2])
        *_, told = self._torque(np.zeros(self.action_space.shape or ()))
        return observation, info | told

    def step(self, action: Any) -> tuple[Array, Any, bool, bool, dict[str, Any]]:
        """Advance by a control period."""
        if self._memory is None:
            raise gymnasium.error.ResetNeeded("no episode has started: call env.reset() first")
        torque, self._memory, told = self._torque(finite_actions(action, self.action_space))
        observation, reward, terminated, truncated, info = self.env.step(torque)
        self._look(observation)
        return observation, reward, terminated, truncated, info | told

    @abstractmethod
    def _torque(self, action: Array) -> tuple[Array, Any, dict[str, Any]]:
        """Torque (r,), the next controller state, and additions to `info`."""

    def _look(self, observation: Array) -> None:
        p, v, *reference = (np.asarray(observation, dtype=np.float64)[..., part] for part in self._parts)
        self._seen = p, v, ReferencePoint(*reference)


class ControlledVectorEnv(gymnasium.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """Base class of wrappers around N arms."""

    def __init__(self, env: VectorTrackingEnv, controller: Controller[Any], actions: int) -> None:
        if not isinstance(env, VectorTrackingEnv):
            raise InputError(f"{env}: expected a vector environment of adaptctl, as made by make_vec")
        validate_controller(controller)
        if controller.dof != env.single.plant.dof:
            raise InputError(f"{env}: has {env.single.plant.dof} joints, but the controller has {controller.dof}")
        super().__init__(env)
        self.controller = controller.compile(many=True)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (actions,), np.float32)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._parts = [env.observation_slices[name] for name in PARTS]
        self._mode, self._over = env.autoreset_mode, np.zeros(self.num_envs, dtype=np.bool_)
        self._memory: Any = None
        self._seen: tuple[Array, Array, ReferencePoint]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin new episodes."""
        observations, info = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]  # ours takes more
        started = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        self._over = self._over & ~started
        self._look(observations, started)
        return observations, info

    def step(self, actions: Any) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Advance by a control period."""
        if self._memory is None:
            raise gymnasium.error.ResetNeeded("no episode has started: call env.reset() first")
        torques, self._memory, told = self._torques(finite_actions(actions, self.action_space))
        observations, rewards, terminated, truncated, info = self.env.step(torques)
        over = terminated | truncated
        started = {AutoresetMode.SAME_STEP: over, AutoresetMode.NEXT_STEP: self._over}.get(self._mode, over & False)
        self._over = over
        self._look(observations, started)
        return observations, rewards, terminated, truncated, info | told

    @abstractmethod
    def _torques(self, actions: Array) -> tuple[Array, Any, dict[str, Any]]:
        """Torques (N, r), the next controller states, and additions to `info`."""

    def _look(self, observations: Array, started: NDArray[np.bool_]) -> None:
        p, v, *reference = (observations[:, part] for part in self._parts)
        self._seen = p, v, ReferencePoint(*reference)
        if self._memory is None:
            self._memory = self.controller.init(p, v)
        else:
            self._memory = self.controller.reset(self._memory, started, p, v)


class ResidualEnv(ControlledEnv):
    """
    Wrapper in which actions add torques to those of a controller (residual learning).

    Parameters
    ----------
    env : gymnasium.Env
        Tracking environment of r joints.
    controller : Controller
        Controller that drives the robot.
    residual_scale : float, default 0.2
        Fraction of the torque limits, above 0 and at most 1, that an action of 1 adds. A fifth leaves the controller in
        charge.

    Raises
    ------
    InputError
        If the controller does not fit, `residual_scale` is out of range, or the environment is no tracking environment
        or a wrapper has changed its spaces.

    Notes
    -----
    ## Action space

    `Box(-1, 1, (r,), float32)`: fractions of the residual torque; only the total torque is clipped. A wrong shape
    raises `InputError`, NaN and infinity `NonFiniteError`.

    ## Observation space

    That of the environment. `info` also has `base_torque` (r,) in N m (N), the controller's torque in the last control
    period, after a reset in the first.

    Examples
    --------
    >>> from adaptctl.envs import ResidualEnv
    >>> residual = ResidualEnv(env, law)
    >>> residual.reset(seed=0)[1]["base_torque"].shape
    (2,)
    """

    def __init__(self, env: gymnasium.Env[Any, Any], controller: Controller[Any], residual_scale: float = 0.2) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(self, controller=controller, residual_scale=residual_scale)
        super().__init__(env, controller)
        self._scale = _share(residual_scale) * np.asarray(env.action_space.high)  # type: ignore[attr-defined]  # a torques' Box

    def _torque(self, action: Array) -> tuple[Array, Any, dict[str, Any]]:
        base, memory = self.controller.step(self._memory, *self._seen)
        return base + self._scale * action, memory, {"base_torque": base}


class ResidualVectorEnv(ControlledVectorEnv):
    """
    Vector environment in which actions add torques to those of a controller of each arm.

    Parameters
    ----------
    env : VectorTrackingEnv
        Environment of N arms of r joints, in no wrappers.
    controller : Controller
        Controller that drives the arms.
    residual_scale : float, default 0.2
        Fraction of the torque limits, above 0 and at most 1, that an action of 1 adds. A fifth leaves the controller in
        charge.

    Raises
    ------
    InputError
        If the environment or the controller does not fit or `residual_scale` is out of range.

    Notes
    -----
    Actions are (N, r), observations (N, n). `info` has `base_torque` (N, r) and the mask `_base_torque` (N,).

    Examples
    --------
    >>> from adaptctl.envs import ResidualVectorEnv, VectorTrackingEnv
    >>> ResidualVectorEnv(VectorTrackingEnv(3, robot=arm, reference=reference), law).action_space.shape
    (3, 2)
    """

    def __init__(self, env: VectorTrackingEnv, controller: Controller[Any], residual_scale: float = 0.2) -> None:
        validate_controller(controller)
        super().__init__(env, controller, controller.dof)
        self._scale = _share(residual_scale) * np.asarray(env.single.plant.torque_limits)

    def _torques(self, actions: Array) -> tuple[Array, Any, dict[str, Any]]:
        base, memory = self.controller.step(self._memory, *self._seen)
        return base + self._scale * actions, memory, masked({"base_torque": base}, np.ones(len(base), dtype=np.bool_))


def validate_controller(given: object) -> None:
    """Raise `InputError` for other types."""
    if not isinstance(given, Controller):
        raise InputError(f"controller: expected a Controller, got {given!r:.80}")


def _share(share: object) -> float:
    if not 0.0 < (given := positive_number(share, "residual_scale: expected a number above 0, at most 1")) <= 1.0:
        raise InputError(f"residual_scale: expected a number above 0, at most 1, got {share}")
    return given
