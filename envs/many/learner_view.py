"""A view of many arms for learners that know one kind of end, and actions in [-1, 1]."""

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
    """Adapter of a vector environment of adaptctl with N arms, in wrappers or not, for learners that take one flag
    `done` for both kinds of an episode's end. Actions (N, a) are scaled to [-1, 1], fractions of the largest action,
    such as the torque limits, and infos are one dictionary an arm.

    `env` is the environment; the attributes `observation_space`, of n numbers, and `action_space`, of a numbers, are
    those of one arm. `done` (N,) is terminated or truncated. The info of an arm that is done has `terminal_observation`
    (n,), the last of the episode that ended, and `TimeLimit.truncated`, True if it ended by its duration alone; other
    infos are empty, to save time. The observation is then the first of the next episode. Raises `InputError` for
    another vector environment, and for one whose `autoreset_mode` is not "SameStep".
    """

    def __init__(self, env: gymnasium.vector.VectorEnv[Any, Any, Any]) -> None:
        inner = env.unwrapped
        if not isinstance(inner, VectorTrackingEnv):
            raise InputError(f"{env}: expected a vector environment of adaptctl, such as make_vec makes")
        if inner.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise InputError(
                f"{env}: arms must begin again in the same step: make it with autoreset_mode='SameStep', not "
                f"{inner.autoreset_mode.value!r}"
            )
        self.env: Any = env
        self.observation_space = env.single_observation_space
        own: Any = env.single_action_space
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, own.shape, np.float32)
        self._largest, self._dof = np.asarray(own.high), inner.single.plant.dof

    def reset(self, seeds: Sequence[int | None], options: Sequence[Mapping[str, Any]]) -> Array:
        """First observations (N, n), n numbers an arm, in the order and the units of the environment's own, of new
        episodes of all N arms, which this call begins. `seeds` and `options` have N entries each: an arm's seed, None
        to go on with its random numbers, and its options, of the same names for all arms. These are those of
        `TrackingEnv.reset`: `payload` (a mass in kg, a `Payload`, or a mapping with `mass`, kg, `center` (3,), m, and
        `inertia` (3, 3), kg m^2, about that centre, in the last link's frame), `trajectory` (a `Reference`, a seed or
        "random"), `initial_error` (one number or (r,), rad, m if prismatic) and `parameters` (P,), the P true inertial
        and friction ones, SI units, in the order of `Mechanism.parameter_names`.

        Raises `InputError` for a bad seed or option, for another number of seeds or options than N, and for options
        whose names differ from arm to arm (its subclasses `NotFoundError` for an unknown option, `NonFiniteError` for
        numbers that are not finite); `SingularityError` where loops cannot be followed to the start.
        """
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
        if "initial_error" in each:  # One number for all joints would else be one a joint.
            off = enumerate(each["initial_error"])
            each["initial_error"] = [per_joint(own, self._dof, f"initial_error of arm {arm}") for arm, own in off]
        observations: Array = self.env.reset(seed=seeds, options=each)[0]
        return observations

    def step(self, actions: ArrayLike) -> tuple[Array, Array, NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations (N, n), rewards (N,), unitless, flags done (N,), True where an episode is terminated or
        truncated, and a list of N infos, one dictionary an arm, after one control period, by which this call advances
        the N arms. Observations have n numbers an arm, in the order and the units of the environment's own. Actions (N,
        a), a numbers an arm in [-1, 1], are fractions of the largest action, such as the torque limits, and are not
        clipped here.

        An arm that is done has started its next episode; its info has `terminal_observation` (n,) and
        `TimeLimit.truncated`, others are empty. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN and
        infinity and where a motion diverges to non-finite values, Gymnasium's `ResetNeeded` before the first reset.
        """
        scaled = finite_actions(actions, self.env.action_space) * self._largest
        observation, reward, terminated, truncated, info = self.env.step(scaled)
        done: NDArray[np.bool_] = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.env.num_envs)]
        for arm in np.flatnonzero(done).tolist():
            infos[arm]["terminal_observation"] = info["final_obs"][arm]
            infos[arm]["TimeLimit.truncated"] = bool(truncated[arm] and not terminated[arm])
        return observation, reward, done, infos
