"""Control laws that adapt: their estimate, and the period it learns from."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.caching import cached_property
from adaptctl.control.adaptation.gradient import Gradient
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.control.controller import Controller
from adaptctl.control.gains.gains import require_sampled_gain
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, spread


class AdaptiveState(NamedTuple):
    """The memory of an adaptive control law: its estimate, and the last tick, from which it learns at the next.

    Whatever limits the torque behind the controller should put what was applied into `torque`, and zero into
    `elapsed` for a period that is not to be learned from.
    """

    estimate: Any
    """(k,) the parameters' estimate"""
    q: Any
    """(n,) the tree's joints at the last tick: where the loops, if any, are followed from"""
    motion: Any
    """numbers of the last tick's motion, from which the gradient Y_r's is made"""
    s: Any
    """(r,) the sliding variable there"""
    torque: Any
    """(r,) N m, held since the last tick"""
    elapsed: Any
    """(1,) s since the last tick, 0 before the first"""
    learning: Any
    """the adaptation law's memory"""
    more: Any
    """the control law's own memory besides"""


class AdaptiveController(Controller[AdaptiveState]):
    """A control law on a model's k parameters, and an adaptation law chosen apart from it.

    `adaptation` is the law, or a gain for `Gradient`, or None to switch adaptation off; `initial` (k,) is the
    first estimate, zero when not given; `period` is the control period T_c in s.
    """

    model: ReducedModel
    adaptation: AdaptationLaw[Any] | Array | None
    initial: Array | None
    period: float

    def _settle(self) -> None:
        """Check the period, the first estimate and the adaptation law, and freeze them."""
        k = len(self.model.columns)
        if not (np.isfinite(self.period) and self.period > 0.0):
            raise InputError(f"control period: expected a positive time in s, got {self.period}")
        initial = np.zeros(k) if self.initial is None else self.initial
        object.__setattr__(self, "initial", frozen_array(initial, (k,), "initial estimate"))
        if self.adaptation_law is None:
            return
        if not isinstance(self.adaptation, AdaptationLaw):
            object.__setattr__(self, "adaptation", self.adaptation_law.gain)  # type: ignore[attr-defined]
        self.adaptation_law.require(self.model, np.asarray(self.initial), self.period)

    def _require_carried(self, damping: ArrayLike) -> None:
        require_sampled_gain(self.model.mechanism, damping, self.period)

    @cached_property
    def adaptation_law(self) -> AdaptationLaw[Any] | None:
        """The adaptation law, `Gradient` where only a gain was given; None with adaptation off."""
        if self.adaptation is None or isinstance(self.adaptation, AdaptationLaw):
            return self.adaptation
        return Gradient(self.adaptation)

    @property
    def dof(self) -> int:
        """Number of joints r."""
        return self.model.mechanism.dof

    @property
    def home(self) -> Array:
        """Positions (r,) where loops, if any, are known to close."""
        return self.model.mechanism.home

    def start(self, p: Array, v: Array) -> AdaptiveState:
        """The memory before the first tick: the first estimate, and a period of no length to learn from."""
        rest, initial = np.zeros(self.dof), np.array(self.initial)
        motion = np.zeros(self._motion_size)
        q, law = self.model.mechanism.configuration(p), self.adaptation_law
        learning = NoMemory() if law is None else law.start(self.model, initial, q, v, self.period)
        return AdaptiveState(initial, q, motion, rest, rest, np.zeros(1), learning, self._more(p, v))

    @property
    @abstractmethod
    def _motion_size(self) -> int:
        """Number of a motion's numbers that the law remembers."""

    def _more(self, p: Array, v: Array) -> Any:
        """The control law's own memory besides, before the first tick."""
        return NoMemory()

    def _learned(self, memory: AdaptiveState, passed: Period) -> tuple[Column, Any]:
        """The estimate (k,) after the period that has passed, and the adaptation law's memory."""
        if self.adaptation_law is None:
            return memory.estimate, memory.learning
        return self.adaptation_law.law(self.model, memory.estimate, passed, memory.learning)

    def _parameters(self, estimate: Column) -> Column:
        """All P parameters of an estimate."""
        return spread(estimate, self.model.columns, self.model.mechanism.equations.parameters)
