"""Passivity-based control: feed-forward along a velocity that is wanted, and damping about it."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from adaptctl.arrays import Array
from adaptctl.control.adaptation.law import AdaptationLaw
from adaptctl.control.adaptive import Adaptive, AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains.gains import per_joint
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column


class Wanted(NamedTuple):
    """The velocity v_r (r,) that a law wants, its derivative a_r (r,), and what it remembers of it."""

    v_r: Column
    a_r: Column
    more: Any


@dataclass(frozen=True, eq=False)
class PassivityBased(Adaptive):
    """torque = Y_r(p, v, v_r, a_r) estimate - K s with s = v - v_r, and the gradient Y_r's.

    M s' + C s + K s = Y_r error: whatever the v_r, v_r' = a_r being exact, V = s'Ms/2 + error' Gamma^-1 error/2
    falls as -s'Ks (Ortega and Spong 1989). The laws differ in the v_r they want.

    `bandwidth` is Lambda (1/s) and `damping` K (N m s/rad), scalars or (r,); `adaptation` is an adaptation law,
    or Gamma for `Gradient`, its diagonal (k,) or whole (k, k), or None to switch adaptation off; `initial` (k,)
    is the first estimate, zero when not given; `period` is the control period T_c in s.
    Raises `GainError` when the period cannot carry the damping, `InputError` on wrong shapes and on an
    adaptation law that does not fit the model.
    """

    model: ReducedModel
    bandwidth: Array
    damping: Array
    adaptation: AdaptationLaw[Any] | Array | None = None
    initial: Array | None = None
    period: float = 1e-3

    def __post_init__(self) -> None:
        object.__setattr__(self, "bandwidth", per_joint(self.bandwidth, self._followed, "bandwidth"))
        object.__setattr__(self, "damping", per_joint(self.damping, self.dof, "damping"))
        self._settle()
        self._require_carried(self.damping)

    @abstractmethod
    def wanted(self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState) -> Wanted:
        """The velocity wanted now, at configuration q (n,)."""

    def law(
        self, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> tuple[Column, AdaptiveState]:
        """One tick: learn from the period that has passed, then act."""
        equations = self.model.mechanism.equations
        q = equations.closed(p, memory.q)
        v_r, a_r, more = self.wanted(q, p, v, reference, memory)
        s, motion = v - v_r, equations.motion(q, v, v_r, a_r)

        def gradient(sliding: Column) -> Column:
            return equations.remembered(memory.motion).powers(sliding, self.model.columns)

        estimate, learning = self._learned(memory, s, q, v, gradient)
        torque = motion.torque(self._parameters(estimate)) - self._damping * s
        kept = motion.numbers if self._motion_size else Column(())
        return torque, AdaptiveState(estimate, q, kept, s, torque, Column((self.period,)), learning, more)

    @property
    def _motion_size(self) -> int:
        return 0 if self.adaptation_law is None else self.model.mechanism.equations.motion_size

    @property
    def _followed(self) -> int:
        """How many coordinates the law brings to their reference."""
        return self.dof

    @cached_property
    def _bandwidth(self) -> Column:
        return Column(self.bandwidth.tolist())

    @cached_property
    def _damping(self) -> Column:
        return Column(self.damping.tolist())
