"""Environments in which a learner moves the gains of a controller."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.control.controller import Controller
from adaptctl.envs.controlled import ControlledEnv, ControlledVectorEnv, validate_controller
from adaptctl.envs.many.vector_tracking import VectorTrackingEnv, masked
from adaptctl.errors import GainError, InputError, NotFoundError

HALVINGS = 12
"""of the range in which the largest factor is sought"""


@dataclass(frozen=True, eq=False)
class GainRange:
    """Range within which actions scale some tunable gains of a `controller` of r joints, each between `lowest` and
    `highest` (unitless) times its own value, and the map from actions to gains.

    `names` are the gains that are scaled, keys of `controller.numbers`, a mapping from names to arrays, in the order of
    their actions. A gain of one number a joint (r,) takes r actions, another, such as `adaptation.gain`, one for all
    its numbers; a is the number of all actions. An action x, unitless, in [-1, 1] multiplies by `highest`^x where it is
    positive, else by (1/`lowest`)^x: 0 leaves the gain. Made by `GainRange.of`, which checks; nothing is checked at
    construction.
    """

    controller: Controller[Any]
    names: tuple[str, ...]
    lowest: float
    highest: float

    @classmethod
    def of(cls, controller: Controller[Any], names: Iterable[str], span: float) -> GainRange:
        """The `GainRange` of the gains `names` of a `controller`, from 1/`span` to `span` times their values (`span`,
        unitless, above 1). Where the controller refuses all these gains at `span` times their values, since the loop
        would be unstable at its control period, the upper end is the largest factor that it accepts, at least 1, found
        by bisection.

        `names` is one name of `controller.numbers` (its tunable gains) or several. Raises `InputError` for a
        `controller` that is no `Controller`, names that are no text and a `span` that is not a finite number above 1;
        `NotFoundError` for a name that is not among the tunable gains, and for no names.
        """
        validate_controller(controller)
        chosen = names_of(names)
        controller.tuned({name: controller.numbers.get(name, 0.0) for name in chosen})
        if not chosen:
            raise NotFoundError(f"gains: expected at least one of {', '.join(controller.numbers) or 'none there are'}")
        if positive_number(span, "span: expected a number above 1") <= 1.0:
            raise InputError(f"span: expected a number above 1, got {span}")
        low, high = 0.0, float(np.log(span))
        if not cls(controller, chosen, 1.0 / span, float(span))._carried():
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                carried = cls(controller, chosen, 1.0 / span, float(np.exp(middle)))._carried()
                low, high = (middle, high) if carried else (low, middle)
            high = low
        return cls(controller, chosen, 1.0 / span, float(np.exp(high)))

    @property
    def space(self) -> gymnasium.spaces.Box:
        """Action space of one arm, `Box(-1, 1, (a,), float32)`, unitless: a counts one action for each joint of a gain
        that has one number a joint, and one for every other gain, in the order of the field `names`."""
        return gymnasium.spaces.Box(-1.0, 1.0, (sum(self.sizes.values()),), np.float32)

    @property
    def sizes(self) -> dict[str, int]:
        """Numbers of actions of the gains that are scaled, a mapping from a gain's name, in the order of the actions:
        the number of joints for a gain of one number a joint, else 1."""
        shapes = {name: self.controller.numbers[name].shape for name in self.names}
        return {name: self.controller.dof if shape == (self.controller.dof,) else 1 for name, shape in shapes.items()}

    def gains(self, actions: Array) -> dict[str, Array]:
        """Scaled gains under actions (..., a), unitless, clipped to [-1, 1]: a mapping from the name of each gain that
        is scaled to its h numbers (..., h) in the gain's own unit, a matrix row by row. a is the sum of the property
        `sizes`, in the order of the field `names`: one action a joint for a gain of one number a joint, else one.
        Nothing is checked."""
        within = np.clip(actions, -1.0, 1.0)
        factors = np.where(within > 0.0, self.highest, 1.0 / self.lowest) ** within
        ends = np.cumsum(list(self.sizes.values())).tolist()
        parts = {name: factors[..., end - n : end] for (name, n), end in zip(self.sizes.items(), ends, strict=True)}
        return {name: self.controller.numbers[name].ravel() * factor for name, factor in parts.items()}

    def packed(self, actions: Array) -> Array:
        """All g tunable numbers of the controller for each of N arms, (N, g), each in its own unit, under the arms'
        actions (N, a), unitless, clipped to [-1, 1]: in the order of `controller.numbers`, matrices row by row, as
        `Controller.step_tuned` takes them. Gains that are not scaled keep their values; a is the number of actions of
        one arm. Nothing is checked."""
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
    ## Description

    A wrapper of a tracking environment that a `controller`, a `Controller`, drives, some of whose `gains` the action
    scales at each control period, so that a schedule of gains can be learned. An action of zero leaves the gains
    unchanged.

    ```python
    env = TuningEnv(gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", ...), controller, ["damping", "adaptation.gain"])
    ```

    ## Action space

    `Box(-1, 1, (a,), float32)`, a numbers without a unit: a number x scales a gain by `span`^x, so that -1 divides it
    by `span` (4 by default), 0 leaves it and 1 multiplies it. `gains` is one name in `controller.numbers` or several.
    Those of one number a joint, such as `bandwidth` and `damping`, have an action number a joint; others, such as
    `adaptation.gain`, one for all their numbers, in the order of the names. What is out of bounds is clipped; a wrong
    shape raises `InputError`, NaN and infinity `NonFiniteError`.

    The largest gains together are checked by the controller's constructor: where they would make the loop unstable at
    the control period, an action of 1 stands for the largest factor that is accepted, `env.range.highest`, at least 1.

    ## Observation space

    That of the environment, (n,), in its units; n = 5r + r L for a `TrackingEnv` of r joints and L look-ahead times.
    `info` has, besides the environment's, `gains`: a mapping from the names to the m numbers (m,) of each gain in the
    last control period, in the gain's own unit.

    ## Errors

    `InputError` for a `controller` that is no `Controller` or of another number of joints than the environment's, an
    environment without the attributes `observation_slices` and `control_period` of a `TrackingEnv`, or whose
    observations or actions a wrapper has changed, `gains` that are no names, and a `span` that is not a finite number
    above 1; `NotFoundError` for unknown gains, and for an empty list of gains.
    """  # noqa: E501  # an example

    def __init__(
        self, env: gymnasium.Env[Any, Any], controller: Controller[Any], gains: Iterable[str], span: float = 4.0
    ) -> None:
        gains = names_of(gains)
        gymnasium.utils.RecordConstructorArgs.__init__(self, controller=controller, gains=gains, span=span)
        self.range = GainRange.of(controller, gains, span)
        super().__init__(env, controller, self.range.space)

    def _torque(self, action: Array) -> tuple[Array, Any, dict[str, Any]]:
        gains = self.range.packed(action[None])
        torque, memory = self.controller.step_tuned(gains, self._memory, *self._seen)
        return torque[0], memory, {"gains": self.range.gains(action)}

    def _look(self, observation: Array) -> None:
        """Take what is observed, as of one arm of many (1, r)."""
        super()._look(np.asarray(observation)[None])


class TuningVectorEnv(ControlledVectorEnv):
    """Vector environment of N arms of r joints, a wrapper of a `VectorTrackingEnv`, in which a `controller`, a
    `Controller`, drives each arm and the actions scale some of its gains at each control period, as in `TuningEnv`.

    `gains` is the name of one of the controller's tunable gains, the keys of `controller.numbers`, or several names;
    `span`, unitless, above 1 and 4 by default, is the largest factor. Actions are (N, a), unitless, clipped to [-1, 1]:
    an action x multiplies a gain by `span`^x. Of the a actions, in the order of the names, a gain of one number a joint
    has r, any other gain one. Where gains at `span` times their values would make the loop unstable at the control
    period, positive actions use the largest factor that the controller accepts instead. Observations (N, n), n numbers
    an arm, are those of `env`, in its units. After a step `info` has besides its keys `gains`, a mapping from the names
    to the m numbers (N, m) of each, in the gain's own unit, and Gymnasium's masks, by the names with an underscore
    before them, (N,), all True.

    Raises `InputError` for an `env` that is no `VectorTrackingEnv` or is in wrappers, a `controller` that is no
    `Controller` or of another number of joints, `gains` that are no names, and a `span` that is not a finite number
    above 1; `NotFoundError` for unknown gains, and for an empty list of gains.
    """

    def __init__(
        self, env: VectorTrackingEnv, controller: Controller[Any], gains: Iterable[str], span: float = 4.0
    ) -> None:
        self.range = GainRange.of(controller, gains, span)
        super().__init__(env, controller, self.range.space.shape[0])

    def _torques(self, actions: Array) -> tuple[Array, Any, dict[str, Any]]:
        torques, memory = self.controller.step_tuned(self.range.packed(actions), self._memory, *self._seen)
        every = np.ones(len(actions), dtype=np.bool_)
        return torques, memory, masked({"gains": masked(self.range.gains(actions), every)}, every)


def names_of(gains: object) -> tuple[str, ...]:
    """Names of gains as a tuple, from `gains`, one name or an iterable of several; an empty iterable gives (). Raises
    `InputError` for anything else. Whether a controller has gains of these names is not checked."""
    names = (gains,) if isinstance(gains, str) else tuple(gains) if isinstance(gains, Iterable) else None
    if names is None or not all(isinstance(name, str) for name in names):
        raise InputError(f"gains: expected a name, or several, such as ['damping'], got {gains!r:.80}")
    return names
