"""Many arms with a controller in their loop, of whose doing a learner changes something."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from adaptctl.arrays import Array, numbers
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.envs.many.vector_tracking import VectorTrackingEnv
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.simulation.rollout import PARTS


class ControlledVectorEnv(gymnasium.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """Base class of vector environments of N arms that a controller drives, and in which actions (N, a), unitless, in
    [-1, 1], change the controller's torques or gains: `ResidualVectorEnv` and `TuningVectorEnv`. Each arm has its own
    controller state, which is initialised anew with each episode.

    `env` is a `VectorTrackingEnv`, without wrappers; `controller` the `Controller`; `actions` the number a of actions
    of one arm. Observations are those of `env`. A subclass defines what actions do by `_torques(actions)`: from finite
    actions (N, a) it returns the torques (N, r) of the next control period on r joints, N m (N if prismatic), and a
    dict that is added to `info`. It takes the controller's state from `_memory` and positions, velocities and
    reference, (N, r) each, from `_seen`, and puts the next state into `_memory`. Raises `InputError` for another
    environment, a `controller` that is no `Controller`, and one for another number of joints.
    """

    def __init__(self, env: VectorTrackingEnv, controller: Controller[Any], actions: int) -> None:
        if not isinstance(env, VectorTrackingEnv):
            raise InputError(f"{env}: expected a vector environment of adaptctl, such as make_vec makes")
        require_controller(controller)
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
        begun = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        self._over = self._over & ~begun
        self._look(observations, begun)
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
        torques, told = self._torques(finite_actions(actions, self.action_space))
        observations, rewards, terminated, truncated, info = self.env.step(torques)
        over = terminated | truncated
        begun = {AutoresetMode.SAME_STEP: over, AutoresetMode.NEXT_STEP: self._over}.get(self._mode, over & False)
        self._over = over
        self._look(observations, begun)
        return observations, rewards, terminated, truncated, info | told

    @abstractmethod
    def _torques(self, actions: Array) -> tuple[Array, dict[str, Any]]:
        """The torques (N, r) of the next control period under actions (N, a), and what `info` tells of it; the memory
        goes on."""

    def _look(self, observations: Array, begun: NDArray[np.bool_]) -> None:
        """Take what is observed, and let arms whose episode has begun forget the last one."""
        p, v, *reference = (observations[:, part] for part in self._parts)
        self._seen = p, v, ReferencePoint(*reference)
        if self._memory is None:
            self._memory = self.controller.init(p, v)
        else:
            self._memory = self.controller.restart(self._memory, begun, p, v)


def require_controller(given: object) -> None:
    """Raise `InputError` unless `given` is a `Controller`; nothing is returned."""
    if not isinstance(given, Controller):
        raise InputError(f"controller: expected a Controller, got {given!r:.80}")


def finite_actions(given: Any, space: gymnasium.Space[Any]) -> Array:
    """The actions `given` as a float64 array of the shape of `space`, a Gymnasium space, in their own unit; they are
    not clipped to its bounds. Raises `InputError` for another shape and for entries that are no numbers,
    `NonFiniteError`, naming the index and, of many arms, the arm, on NaN and infinity."""
    actions = numbers(given, "action", f"of shape {space.shape}")
    if actions.shape != space.shape:
        raise InputError(f"action: expected shape {space.shape}, got {actions.shape}")
    if not np.isfinite(actions).all():
        *arm, number = np.argwhere(~np.isfinite(actions))[0].tolist()
        bad = actions[(*arm, number)]
        whose = f" of arm {arm[0]}" if arm else ""
        raise NonFiniteError(f"action: expected finite numbers, got {bad} for number {number}{whose}")
    return actions
