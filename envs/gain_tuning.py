"""Environments whose actions scale controller gains."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.control.controller import Controller
from adaptctl.envs.controlled import ControlledEnv, ControlledVectorEnv, validate_controller
from adaptctl.envs.many.vector_tracking import VectorTrackingEnv, masked
from adaptctl.errors import GainError, InputError, NotFoundError

HALVINGS = 12
"""Bisection steps for the largest factor."""


@dataclass(frozen=True, eq=False)
class GainRange:
    """Map from actions to gains."""

    controller: Controller[Any]
    names: tuple[str, ...]
    lowest: float
    highest: float

    @classmethod
    def of(cls, controller: Controller[Any], names: Iterable[str], max_factor: float) -> GainRange:
        """Range from 1/`max_factor` to `max_factor` times the gains, within what the controller accepts."""
        validate_controller(controller)
        chosen = names_of(names)
        controller.tuned({name: controller.numbers.get(name, 0.0) for name in chosen})
        if not chosen:
            raise NotFoundError(f"gains: expected at least one of {', '.join(controller.numbers) or '(none)'}")
        if positive_number(max_factor, "max_factor: expected a number above 1") <= 1.0:
            raise InputError(f"max_factor: expected a number above 1, got {max_factor}")
        widest = cls(controller, chosen, 1.0 / max_factor, float(max_factor))
        if widest._carried():
            return widest
        low, high = 0.0, float(np.log(max_factor))
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            carried = replace(widest, highest=float(np.exp(middle)))._carried()
            low, high = (middle, high) if carried else (low, middle)
        return replace(widest, highest=float(np.exp(low)))

    @property
    def space(self) -> gymnasium.spaces.Box:
        """Action space of one arm."""
        return gymnasium.spaces.Box(-1.0, 1.0, (sum(self.sizes.values()),), np.float32)

    @property
    def sizes(self) -> dict[str, int]:
        """Numbers of actions by gain."""
        shapes = {name: self.controller.numbers[name].shape for name in self.names}
        return {name: self.controller.dof if shape == (self.controller.dof,) else 1 for name, shape in shapes.items()}

    def gains(self, actions: Array) -> dict[str, Array]:
        """Gains by name under actions (..., a)."""
        within = np.clip(actions, -1.0, 1.0)
        factors = np.where(within > 0.0, self.highest, 1.0 / self.lowest) ** within
        ends = np.cumsum(list(self.sizes.values())).tolist()
        parts = {name: factors[..., end - n : end] for (name, n), end in zip(self.sizes.items(), ends, strict=True)}
        return {name: self.controller.numbers[name].ravel() * factor for name, factor in parts.items()}

    def packed(self, actions: Array) -> Array:
        """All numbers (N, g) of the controller under actions (N, a)."""
        moved, count = self.gains(actions), len(actions)
        rows = [moved.get(name, np.tile(own.ravel(), (count, 1))) for name, own in self.controller.numbers.items()]
        return np.concatenate(rows, axis=1)

    def _carried(self) -> bool:
        largest = self.gains(np.ones(self.space.shape))
        try:
            self.controller.tuned({n: largest[n].reshape(self.controller.numbers[n].shape) for n in self.names})
        except GainError:
            return False
        return True


class TuningEnv(ControlledEnv):
    """
    Wrapper in which actions scale gains of a controller at each control period (gain scheduling).

    Parameters
    ----------
    env : gymnasium.Env
        Tracking environment of r joints.
    controller : Controller
        Controller that drives the robot.
    gains : str or iterable of str
        Names of the gains in `controller.numbers`.
    max_factor : float, default 4.0
        Largest factor without a unit, above 1: an action x scales a gain by max_factor^x, by
        default from a quarter to four times.

    Raises
    ------
    InputError
        If the controller does not fit, `max_factor` is out of range, or the environment is no tracking environment or a
        wrapper has changed its spaces.
    NotFoundError
        If a gain is unknown or none is given.

    Notes
    -----
    ## Action space

    `Box(-1, 1, (a,), float32)`, clipped: one action per joint for gains such as `bandwidth`, one for all values of
    others, such as `adaptation.gain`. Zero leaves the gains unchanged, 1 gives the largest stable factor up to
    `max_factor`. A wrong shape raises `InputError`, NaN and infinity `NonFiniteError`.

    ## Observation space

    That of the environment. `info` also has `gains`, a mapping to the gains (m,) of the last control period.

    Examples
    --------
    >>> from adaptctl.envs import TuningEnv
    >>> TuningEnv(env, law, ["damping", "adaptation.gain"]).action_space.shape
    (3,)
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], controller: Controller[Any], gains: Iterable[str], max_factor: float = 4.0
    ) -> None:
        gains = names_of(gains)
        gymnasium.utils.RecordConstructorArgs.__init__(self, controller=controller, gains=gains, max_factor=max_factor)
        self.range = GainRange.of(controller, gains, max_factor)
        super().__init__(env, controller, self.range.space)

    def _torque(self, action: Array) -> tuple[Array, Any, dict[str, Any]]:
        gains = self.range.packed(action[None])
        torque, memory = self.controller.step_tuned(gains, self._memory, *self._seen)
        return torque[0], memory, {"gains": self.range.gains(action)}

    def _look(self, observation: Array) -> None:
        super()._look(np.asarray(observation)[None])


class TuningVectorEnv(ControlledVectorEnv):
    """
    Vector environment in which actions scale gains of a controller of each arm.

    Parameters
    ----------
    env : VectorTrackingEnv
        Environment of N arms of r joints, in no wrappers.
    controller : Controller
        Controller that drives the arms.
    gains : str or iterable of str
        Names of the gains in `controller.numbers`.
    max_factor : float, default 4.0
        Largest factor without a unit, above 1: an action x scales a gain by max_factor^x, by
        default from a quarter to four times.

    Raises
    ------
    InputError
        If the environment or the controller does not fit or `max_factor` is out of range.
    NotFoundError
        If a gain is unknown or none is given.

    Notes
    -----
    Actions are (N, a), observations (N, n). `info` has `gains`, a mapping to arrays (N, m), and masks (N,).

    Examples
    --------
    >>> from adaptctl.envs import TuningVectorEnv, VectorTrackingEnv
    >>> TuningVectorEnv(VectorTrackingEnv(3, robot=arm, reference=reference), law, "damping").action_space.shape
    (3, 2)
    """

    def __init__(
        self, env: VectorTrackingEnv, controller: Controller[Any], gains: Iterable[str], max_factor: float = 4.0
    ) -> None:
        self.range = GainRange.of(controller, gains, max_factor)
        super().__init__(env, controller, self.range.space.shape[0])

    def _torques(self, actions: Array) -> tuple[Array, Any, dict[str, Any]]:
        torques, memory = self.controller.step_tuned(self.range.packed(actions), self._memory, *self._seen)
        every = np.ones(len(actions), dtype=np.bool_)
        return torques, memory, masked({"gains": masked(self.range.gains(actions), every)}, every)


def names_of(gains: object) -> tuple[str, ...]:
    """Names of gains as a tuple."""
    names = (gains,) if isinstance(gains, str) else tuple(gains) if isinstance(gains, Iterable) else None
    if names is None or not all(isinstance(name, str) for name in names):
        raise InputError(f"gains: expected names, such as ['damping'], got {gains!r:.80}")
    return names
