"""Environments in which a learner adds torques to those of a controller."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.envs.many.controlled import ControlledVectorEnv, finite_actions, require_controller
from adaptctl.envs.many.vector_tracking import VectorTrackingEnv, masked
from adaptctl.errors import InputError
from adaptctl.simulation.rollout import interface


class ResidualEnv(gymnasium.Wrapper[Array, Array, Array, Array], gymnasium.utils.RecordConstructorArgs):
    """
    ## Description

    A wrapper of a tracking environment that a `controller`, a `Controller`, drives, to whose torques the action adds
    others, so that what the controller's model does not have can be learned. An action of zero leaves the controller
    alone.

    ```python
    env = ResidualEnv(gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", ...), controller, share=0.2)
    ```

    ## Action space

    `Box(-1, 1, (r,), float32)`, r joints: fractions of `share` (0.2 by default) times the torque limits, N m (N). What
    is out of bounds is not clipped; the sum of both torques is, to the torque limits. A wrong shape raises
    `InputError`, NaN and infinity `NonFiniteError`.

    ## Observation space

    That of the environment, (n,), in its units; n = 5r + r L for a `TrackingEnv` with L look-ahead times. `info` has,
    besides the environment's, `base_torque` (r,), N m (N): the controller's torque in the last control period; after
    a reset, in the first one to come.

    ## Errors

    `InputError` for a `controller` that is no `Controller` or of another number of joints than the environment's, an
    environment without the attributes `observation_slices` and `control_period` of a `TrackingEnv`, or whose
    observations or actions a wrapper has changed, and a `share` that is not above 0 and at most 1.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], controller: Controller[Any], share: float = 0.2) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(self, controller=controller, share=share)
        gymnasium.Wrapper.__init__(self, env)
        self._parts = parts_of(env, controller)
        limits: Array = env.action_space.high  # type: ignore[attr-defined]  # a Box, as every torque's space
        self.controller, self._scale = controller, _share(share) * np.asarray(limits)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, limits.shape, np.float32)  # type: ignore[assignment]
        self._memory: Any = None
        self._base = np.zeros(limits.shape)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """First observation (n,), n = 5r + r L for a `TrackingEnv` of r joints with L look-ahead times, and `info` of a
        new episode, which this call begins with a new initial state of the controller. The observation is the wrapped
        environment's, such as positions, velocities and the reference's positions, velocities and accelerations, then
        its positions at each time ahead, in rad, rad/s, rad/s^2 (m, m/s, m/s^2 if prismatic); `info` has besides the
        environment's keys `base_torque` (r,), N m (N if prismatic), the controller's first torque at r joints.

        `seed` is that of the random numbers, None to go on with them. `options`, None for none, are those of
        `TrackingEnv.reset`: `payload` (a mass in kg, a `Payload`, or a mapping with `mass`, kg, `center` (3,), m, and
        `inertia` (3, 3), kg m^2, about that centre, in the last link's frame), `trajectory` (a `Reference`, a seed or
        "random"), `initial_error` (one number or (r,), rad, m if prismatic) and `parameters` (P,), the P true inertial
        and friction ones, SI units, in the order of `Mechanism.parameter_names`. Raises `InputError` for bad options
        (its subclass `NotFoundError` for unknown ones), `SingularityError` where loops cannot be followed to the start,
        Gymnasium's `Error` for a bad seed.
        """
        observation, info = self.env.reset(seed=seed, options=options)
        p, v, _ = self._read(observation)
        self._memory = self.controller.init(p, v)
        self._plan(observation)
        return observation, info | {"base_torque": self._base.copy()}

    def step(self, action: Array) -> tuple[Array, Any, bool, bool, dict[str, Any]]:
        """Observation (n,), the n numbers of the wrapped environment's, reward (unitless), `terminated`, `truncated`
        and `info` after one control period, by which this call advances the environment. The torque is the controller's
        plus the action (r,), in [-1, 1] but not clipped, times `share` (given at construction) times the torque limits,
        N m (N if prismatic), of r joints. Observation, in the environment's units and the order of its
        `observation_slices`, reward and ends are the environment's; `info` has besides its keys the controller's torque
        as `base_torque` (r,), N m (N).

        Raises `InputError` on a wrong shape, `NonFiniteError` on NaN and infinity and where the motion diverges to
        non-finite values, Gymnasium's `ResetNeeded` before the first reset and after the episode's end.
        """
        if self._memory is None:
            raise gymnasium.error.ResetNeeded("there is no episode yet: call env.reset() first")
        torque = self._base + self._scale * finite_actions(action, self.action_space)
        observation, reward, terminated, truncated, info = self.env.step(torque)
        info = info | {"base_torque": self._base.copy()}
        if not (terminated or truncated):
            self._plan(observation)
        return observation, reward, terminated, truncated, info

    def _plan(self, observation: Array) -> None:
        """The controller's torque for the next control period."""
        p, v, reference = self._read(observation)
        self._base, self._memory = self.controller.step(self._memory, p, v, reference)

    def _read(self, observation: Array) -> tuple[Array, Array, ReferencePoint]:
        p, v, *reference = (np.asarray(observation, dtype=np.float64)[part] for part in self._parts)
        return p, v, ReferencePoint(*reference)


class ResidualVectorEnv(ControlledVectorEnv):
    """Vector environment of N arms of r joints, a wrapper of a `VectorTrackingEnv`, in which a `controller`, a
    `Controller`, drives each arm and the actions add torques to the controller's, as in `ResidualEnv`. Actions (N, r)
    in [-1, 1], unitless and not clipped, are fractions of `share` (above 0 and at most 1, 0.2 by default) times the
    torque limits. After a step `info` has besides the environment's keys the controllers' torques as `base_torque` (N,
    r), N m (N if prismatic), and the mask `_base_torque` (N,), all True. Observations (N, n), n numbers an arm, are
    those of `env`, in its units.

    Raises `InputError` for an `env` that is no `VectorTrackingEnv` or is in wrappers, a `controller` that is no
    `Controller` or of another number of joints, and a `share` that is not above 0 and at most 1.
    """

    def __init__(self, env: VectorTrackingEnv, controller: Controller[Any], share: float = 0.2) -> None:
        require_controller(controller)
        super().__init__(env, controller, controller.dof)
        self._scale = _share(share) * np.asarray(env.single.plant.torque_limits)

    def _torques(self, actions: Array) -> tuple[Array, dict[str, Any]]:
        base, self._memory = self.controller.step(self._memory, *self._seen)
        return base + self._scale * actions, masked({"base_torque": base}, np.ones(len(base), dtype=np.bool_))


def parts_of(env: gymnasium.Env[Any, Any], controller: Controller[Any]) -> list[slice]:
    """Slices of an observation that a `controller` needs, a list of five in the order p, v, reference_p, reference_v,
    reference_a: positions, velocities, and the reference's positions, velocities and accelerations. `env` is a
    single-arm environment, in wrappers or not.

    Raises `InputError` for what is no `Controller`, for an environment whose `unwrapped` has no `observation_slices`
    with these names or no `control_period`, for another number of joints than the controller's, and where wrappers have
    changed the observation or the action space.
    """
    require_controller(controller)
    parts, _ = interface(env, controller)
    inner = env.unwrapped
    if (env.observation_space, env.action_space) != (inner.observation_space, inner.action_space):
        raise InputError(
            f"{env}: expected observations and torques in their own units: put such wrappers around this one"
        )
    return parts


def _share(share: object) -> float:
    if not 0.0 < (given := positive_number(share, "share: expected a number above 0, at most 1")) <= 1.0:
        raise InputError(f"share: expected a number above 0, at most 1, got {share}")
    return given
