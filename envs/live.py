"""Environment with a live view."""

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
    """
    Wrapper that shows each control period of an environment in a live view.

    Parameters
    ----------
    env : gymnasium.Env
        Environment with a `control_period` in s and `observation_slices` of `p` and `reference_p`.
    live : Live
        View with curves and the arm, drawn by the rerun viewer.

    Raises
    ------
    InputError
        If the environment is another or wrappers have changed its observations. Put those around this one.

    Notes
    -----
    A failure of the view is a `LiveViewWarning`.

    Examples
    --------
    >>> import warnings
    >>> from adaptctl.envs import LiveView
    >>> from adaptctl.recording import Live
    >>> with warnings.catch_warnings(action="ignore"), Live(arm, "127.0.0.1:9", start_viewer=False) as live:
    ...     seen = LiveView(env, live)
    ...     observation, info = seen.reset(seed=0)
    >>> observation.shape
    (14,)
    """

    def __init__(self, env: gymnasium.Env[Any, Any], live: Live) -> None:
        super().__init__(env)
        self.live = live
        self._slices, self._period = _shown_of(env)
        self._steps = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """
        Begin a new episode; nothing is shown yet.

        Parameters
        ----------
        seed : int, optional
            Seed passed to the environment. Default: none, its random numbers go on.
        options : dict, optional
            Options passed to the environment. Default: none.

        Returns
        -------
        tuple
            First observation (n,) and `info` of the environment.
        """
        self._steps = 0
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Array) -> tuple[Array, Any, bool, bool, dict[str, Any]]:
        """
        Advance the environment by a control period and show it.

        Parameters
        ----------
        action : ndarray
            Action (a,) in the units of the environment, torques in N m (N) for a `TrackingEnv`.

        Returns
        -------
        tuple
            Observation (n,), reward, `terminated`, `truncated` and `info` of the environment.
        """
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._steps += 1
        p, desired = (np.asarray(observation)[self._slices[name]] for name in ("p", "reference_p"))
        time = float(info.get("time", self._steps * self._period))
        self.live.show(time, p, desired, info.get("applied_torque", action))
        return observation, reward, terminated, truncated, info


def _shown_of(env: gymnasium.Env[Any, Any]) -> tuple[Mapping[str, slice], float]:
    """Slices of an observation, and the control period in s."""
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
        raise InputError(f"{env}: expected observations in SI units: apply unit-changing wrappers after this one")
    return slices, period
