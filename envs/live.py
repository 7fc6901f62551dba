"""An environment whose arm is shown live."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError

if TYPE_CHECKING:
    from adaptctl.recording.live import Live


class LiveView(gymnasium.Wrapper[Array, Array, Array, Array]):
    """A wrapper of a single-arm environment that shows each of its control periods in `live`, a `Live` view (curves and
    the arm, drawn by the rerun viewer); observations, rewards and `info` are unchanged.

    `env` is an environment of adaptctl, or one whose `env.unwrapped` has a `control_period` (s) and
    `observation_slices`, a mapping from `p` and `reference_p`, positions and the reference's, to their slices (r,) of
    the observation, r joints. Raises `InputError` for another environment, and for one in wrappers that change its
    observations: such wrappers belong around this one.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], live: Live) -> None:
        super().__init__(env)
        self.live = live
        self._slices, self._period = _shown_of(env)
        self._steps = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """First observation (n,), n numbers in the environment's units, and `info` of a new episode, which this call
        begins; nothing is shown yet. `seed` and `options`, None for none, are passed to the wrapped environment. Raises
        what that environment raises."""
        self._steps = 0
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Array) -> tuple[Array, Any, bool, bool, dict[str, Any]]:
        """Observation (n,), n numbers in the environment's units, reward (unitless), `terminated`, `truncated` and
        `info`, unchanged, after one control period, by which this call advances the wrapped environment under the
        `action` (a,), its a numbers. Shown are the time, `time` of `info` or else the periods counted, s, the positions
        of the r joints and the reference's (r,), rad (m if prismatic), and the torque (r,), N m (N), `applied_torque`
        of `info` or else the action. Raises what the environment raises; a failure of the view is a `LiveViewWarning`.
        """
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._steps += 1
        p, desired = (np.asarray(observation)[self._slices[name]] for name in ("p", "reference_p"))
        time = float(info.get("time", self._steps * self._period))
        self.live.show(time, p, desired, info.get("applied_torque", action))
        return observation, reward, terminated, truncated, info


def _shown_of(env: gymnasium.Env[Any, Any]) -> tuple[Mapping[str, slice], float]:
    """Slices of the parts of an observation, and the control period (s). Raises `InputError` for an environment that
    cannot be shown."""
    inner = env.unwrapped
    slices, period = getattr(inner, "observation_slices", None), getattr(inner, "control_period", None)
    if (
        not isinstance(slices, Mapping)
        or not {"p", "reference_p"} <= set(slices)
        or not isinstance(period, int | float)
    ):
        raise InputError(
            f"{env}: cannot be shown live: its unwrapped environment needs a control_period in s and "
            "observation_slices, a mapping from p and reference_p to slices of the observation"
        )
    if getattr(env, "observation_space", None) != getattr(inner, "observation_space", None):
        raise InputError(f"{env}: expected observations in their own units: put such wrappers around this one")
    return slices, period
