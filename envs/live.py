"""An environment whose arm is shown live."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from adaptctl.arrays import Array
from adaptctl.recording.live import Live


class LiveView(gymnasium.Wrapper[Array, Array, Array, Array]):
    """A wrapper that shows each control period of an environment of ours, or of one whose `env.unwrapped` has
    `observation_slices` and a `control_period` (s), in a `Live` view, `live`."""

    def __init__(self, env: gymnasium.Env[Any, Any], live: Live) -> None:
        super().__init__(env)
        self.live = live
        self._slices = env.unwrapped.observation_slices  # type: ignore[attr-defined]
        self._steps = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """The environment's first observation (n,) and `info` of an episode, which begins; `seed` and `options`, None
        for none, are passed to it."""
        self._steps = 0
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Array) -> tuple[Array, Any, bool, bool, dict[str, Any]]:
        """The environment's observation (n,), reward, `terminated`, `truncated` and `info` after one control period
        under the `action`, which is shown: with the torque that `info` has as `applied_torque` (r,), N m (N), or else
        the action."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._steps += 1
        p, desired = (np.asarray(observation)[self._slices[name]] for name in ("p", "reference_p"))
        period: float = self.env.unwrapped.control_period  # type: ignore[attr-defined]
        time = float(info.get("time", self._steps * period))
        self.live.show(time, p, desired, info.get("applied_torque", action))
        return observation, reward, terminated, truncated, info
