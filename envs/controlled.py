"""Arms with a controller in their loop, to whose torques, or to whose gains, a learner adds."""

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
    """Base class of wrappers of a tracking environment whose arm a controller drives, and in which actions (a,),
    unitless, in [-1, 1], change the controller's torques or gains: `ResidualEnv` and `TuningEnv`. Each episode begins
    with a new initial state of the controller.

    `env` is a single-arm environment, `controller` the `Controller` and `space` the action space. A subclass defines
    what actions do by `_torque(action)`: from a finite action (a,) it returns the torque (r,) of the next control
    period on r joints, N m (N if prismatic), the controller's state after it, and a dict that is added to `info`.
    Raises `InputError` for what is no `Controller`, for an environment without the attributes `observation_slices` and
    `control_period` of a `TrackingEnv`, for another number of joints than the controller's, and where wrappers have
    changed the observation or the action space.
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], controller: Controller[Any], space: gymnasium.Space[Any] | None = None
    ) -> None:
        gymnasium.Wrapper.__init__(self, env)
        validate_controller(controller)
        self._parts, _ = interface(env, controller)
        inner = env.unwrapped
        if (env.observation_space, env.action_space) != (inner.observation_space, inner.action_space):
            raise InputError(
                f"{env}: expected observations and torques in their own units: put such wrappers around this one"
            )
        shape = env.action_space.shape or ()
        self.controller: Controller[Any] = controller
        self.action_space = space or gymnasium.spaces.Box(-1.0, 1.0, shape, np.float32)  # type: ignore[assignment]
        self._memory: Any = None
        self._seen: tuple[Array, Array, ReferencePoint]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """First observation (n,), n = 5r + r L for a `TrackingEnv` of r joints with L look-ahead times, and `info` of a
        new episode, which this call begins with a new initial state of the controller. The observation is the wrapped
        environment's, in its units; `info` has besides its keys what the class adds, for an action of zero.

        `seed` is that of the random numbers, None to go on with them. `options`, None for none, are those of
        `TrackingEnv.reset`: `payload` (a mass in kg, a `Payload`, or a mapping with `mass`, kg, `center` (3,), m, and
        `inertia` (3, 3), kg m^2, about that centre, in the last link's frame), `trajectory` (a `Reference`, a seed or
        "random"), `initial_error` (one number or (r,), rad, m if prismatic) and `parameters` (P,), the P true inertial
        and friction ones, SI units, in the order of `Mechanism.parameter_names`. Raises `InputError` for bad options
        (its subclass `NotFoundError` for unknown ones), `SingularityError` where loops cannot be followed to the start,
        Gymnasium's `Error` for a bad seed.
        """
        observation, info = self.env.reset(seed=seed, options=options)
        self._look(observation)
        self._memory = self.controller.init(*self._seen[:2])
        *_, told = self._torque(np.zeros(self.action_space.shape or ()))
        return observation, info | told

    def step(self, action: Any) -> tuple[Array, Any, bool, bool, dict[str, Any]]:
        """Observation (n,), the n numbers of the wrapped environment's, reward (unitless), `terminated`, `truncated`
        and `info` after one control period, by which this call advances the environment under its controller. The
        action (a,), unitless, in [-1, 1], changes the controller's torque or gains as the class defines. Observation,
        in the environment's units and the order of its `observation_slices`, reward and ends are the environment's;
        `info` has besides its keys what the class adds.

        Raises `InputError` on a wrong shape, `NonFiniteError` on NaN and infinity and where the motion diverges to
        non-finite values, Gymnasium's `ResetNeeded` before the first reset and after the episode's end.
        """
        if self._memory is None:
            raise gymnasium.error.ResetNeeded("there is no episode yet: call env.reset() first")
        torque, self._memory, told = self._torque(finite_actions(action, self.action_space))
        observation, reward, terminated, truncated, info = self.env.step(torque)
        self._look(observation)
        return observation, reward, terminated, truncated, info | told

    @abstractmethod
    def _torque(self, action: Array) -> tuple[Array, Any, dict[str, Any]]:
        """The torque (r,) of the next control period under an action (a,), the controller's memory after it, and what
        `info` tells of it."""

    def _look(self, observation: Array) -> None:
        """Take what is observed."""
        p, v, *reference = (np.asarray(observation, dtype=np.float64)[..., part] for part in self._parts)
        self._seen = p, v, ReferencePoint(*reference)


class ControlledVectorEnv(gymnasium.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """Base class of vector environments of N arms that a controller drives, and in which actions (N, a), unitless, in
    [-1, 1], change the controller's torques or gains: `ResidualVectorEnv` and `TuningVectorEnv`. Each arm has its own
    controller state, which is initialised anew with each episode.

    `env` is a `VectorTrackingEnv`, without wrappers; `controller` the `Controller`; `actions` the number a of actions
    of one arm. Observations are those of `env`. A subclass defines what actions do by `_torques(actions)`: from finite
    actions (N, a) it returns the torques (N, r) of the next control period on r joints, N m (N if prismatic), the
    controller's state after it, and a dict that is added to `info`. It takes the state before from `_memory` and
    positions, velocities and reference, (N, r) each, from `_seen`. Raises `InputError` for another environment, a
    `controller` that is no `Controller`, and one for another number of joints.
    """

    def __init__(self, env: VectorTrackingEnv, controller: Controller[Any], actions: int) -> None:
        if not isinstance(env, VectorTrackingEnv):
            raise InputError(f"{env}: expected a vector environment of adaptctl, such as make_vec makes")
        validate_controller(controller)
        if controller.dof != env.single.plant.dof:
            raise InputError(f"{env}: observes {env.single.plant.dof} joints, the controller is for {controller.dof}")
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
        """First observations (N, n), n = 5r + r L for r joints and L look-ahead times, in the units and the order of
        `VectorTrackingEnv`'s, and `info`, that of `VectorTrackingEnv.reset`, of new episodes of all N arms, which this
        call begins with new initial states of the controller; with `autoreset_mode` "Disabled" only of the arms in the
        option `reset_mask`, bools (N,).

        `seed` s gives arm i, from 0, the seed s + i, a list has one for each arm, and None lets the random numbers go
        on. `options`, None for none, are those of `VectorTrackingEnv.reset`, for all arms or one each: `payload` (a
        mass in kg, a `Payload`, or a mapping with `mass`, kg, `center` (3,), m, and `inertia` (3, 3), kg m^2, about
        that centre, in the last link's frame), `trajectory` (a `Reference`, a seed or "random"), `initial_error` (one
        number, (r,) or (N, r), rad, m if prismatic) and `parameters`, (P,) or (N, P), the P true inertial and friction
        ones, SI units, in the order of `Mechanism.parameter_names`. Raises `InputError` for bad seeds and options (its
        subclasses `NotFoundError` for unknown options, `NonFiniteError` for numbers that are not finite),
        `SingularityError` where loops cannot be followed to the start, Gymnasium's `ResetNeeded` for a part of the arms
        before the first reset of all.
        """
        observations, info = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]  # ours takes more
        started = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        self._over = self._over & ~started
        self._look(observations, started)
        return observations, info

    def step(self, actions: Any) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Observations (N, n), rewards (N,), unitless, `terminated` and `truncated`, bools (N,), and `info` after one
        control period, by which this call advances all N arms, each under its own controller. Actions (N, a), unitless,
        in [-1, 1], change the controllers' torques or gains as the subclass defines. Observations have n numbers an
        arm, in the environment's units and in the order of its `observation_slices`.

        Rewards and ends are those of `VectorTrackingEnv.step`: terminated where a joint's error passes its bound or
        kinematic loops come near a singularity (the smallest singular value of their closure Jacobian below 0.05 of
        that at the reference configuration) or leave bounds that the robot's file states, truncated where the duration
        is over. `info` has that environment's keys and the subclass's, `base_torque` or `gains`. Actions of arms that
        begin a new episode in this step have no effect, but are checked. Raises `InputError` on a wrong shape and
        `NonFiniteError` on NaN and infinity, naming number and arm, before anything has moved; `NonFiniteError`, naming
        the arm, for a motion that diverges to non-finite values; Gymnasium's `ResetNeeded` before the first reset, and
        with `autoreset_mode` "Disabled" where an arm's episode is over.
        """
        if self._memory is None:
            raise gymnasium.error.ResetNeeded("there is no episode yet: call env.reset() first")
        torques, self._memory, told = self._torques(finite_actions(actions, self.action_space))
        observations, rewards, terminated, truncated, info = self.env.step(torques)
        over = terminated | truncated
        started = {AutoresetMode.SAME_STEP: over, AutoresetMode.NEXT_STEP: self._over}.get(self._mode, over & False)
        self._over = over
        self._look(observations, started)
        return observations, rewards, terminated, truncated, info | told

    @abstractmethod
    def _torques(self, actions: Array) -> tuple[Array, Any, dict[str, Any]]:
        """The torques (N, r) of the next control period under actions (N, a), the controllers' memory after it, and
        what `info` tells of it."""

    def _look(self, observations: Array, started: NDArray[np.bool_]) -> None:
        """Take what is observed, and let arms whose episode has started forget the last one."""
        p, v, *reference = (observations[:, part] for part in self._parts)
        self._seen = p, v, ReferencePoint(*reference)
        if self._memory is None:
            self._memory = self.controller.init(p, v)
        else:
            self._memory = self.controller.reset(self._memory, started, p, v)


class ResidualEnv(ControlledEnv):
    """
    ## Description

    A wrapper of a tracking environment that a `controller`, a `Controller`, drives, to whose torques the action adds
    others, so that what the controller's model does not have can be learned. An action of zero leaves the controller
    alone.

    ```python
    env = ResidualEnv(gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", ...), controller, residual_scale=0.2)
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

    def __init__(self, env: gymnasium.Env[Any, Any], controller: Controller[Any], residual_scale: float = 0.2) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(self, controller=controller, residual_scale=residual_scale)
        super().__init__(env, controller)
        self._scale = _share(residual_scale) * np.asarray(env.action_space.high)  # type: ignore[attr-defined]  # a torques' Box

    def _torque(self, action: Array) -> tuple[Array, Any, dict[str, Any]]:
        base, memory = self.controller.step(self._memory, *self._seen)
        return base + self._scale * action, memory, {"base_torque": base}


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

    def __init__(self, env: VectorTrackingEnv, controller: Controller[Any], residual_scale: float = 0.2) -> None:
        validate_controller(controller)
        super().__init__(env, controller, controller.dof)
        self._scale = _share(residual_scale) * np.asarray(env.single.plant.torque_limits)

    def _torques(self, actions: Array) -> tuple[Array, Any, dict[str, Any]]:
        base, memory = self.controller.step(self._memory, *self._seen)
        return base + self._scale * actions, memory, masked({"base_torque": base}, np.ones(len(base), dtype=np.bool_))


def validate_controller(given: object) -> None:
    """Raise `InputError` unless `given` is a `Controller`; nothing is returned."""
    if not isinstance(given, Controller):
        raise InputError(f"controller: expected a Controller, got {given!r:.80}")


def _share(share: object) -> float:
    if not 0.0 < (given := positive_number(share, "residual_scale: expected a number above 0, at most 1")) <= 1.0:
        raise InputError(f"residual_scale: expected a number above 0, at most 1, got {share}")
    return given
