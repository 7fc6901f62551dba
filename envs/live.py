"""An environment whose arm is shown live."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from adaptctl.arrays import Array
from adaptctl.recording.live import Live


class LiveView(gymnasium.Wrapper[Array, Array, Array, Array]):
    """A wrapper of a single-arm environment that shows each of its control periods in a live view, `live`, and changes
    nothing else.

    `env` is one of ours, or one whose `env.unwrapped` has a `control_period` (s) and `observation_slices`, a mapping
    from `p` and `reference_p` to their slices (r,) of the observation; one without raises `AttributeError`. Wrappers
    within it that scale observations are not noticed, and their numbers are shown as rad (m): put them around this one.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], live: Live) -> None:
        super().__init__(env)
        self.live = live
        self._slices = env.unwrapped.observation_slices  # type: ignore[attr-defined]
        self._steps = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """The environment's first observation (n,) and `info` of an episode, which begins; nothing is shown yet. `seed`
        and `options`, None for none, are passed to the environment, and what it raises passes."""
        self._steps = 0
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Array) -> tuple[Array, Any, bool, bool, dict[str, Any]]:
        """The environment's observation (n,), reward, `terminated`, `truncated` and `info` after one control period
        under the `action` (a,). What is shown is the time, `time` of `info` or else the periods counted, s, the
        positions and the reference's (r,), rad (m), and the torque that `info` has as `applied_torque` (r,), N m (N),
        or else the action. Raises what the environment raises; a failure of the view is a `LiveViewWarning`."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._steps += 1
        p, desired = (np.asarray(observation)[self._slices[name]] for name in ("p", "reference_p"))
        period: float = self.env.unwrapped.control_period  # type: ignore[attr-defined]
        time = float(info.get("time", self._steps * period))
        self.live.show(time, p, desired, info.get("applied_torque", action))
        return observation, reward, terminated, truncated, info
