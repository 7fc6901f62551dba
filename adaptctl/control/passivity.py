"""Passivity-based control: feed-forward along a velocity that is wanted, and damping about it."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import Any, NamedTuple

from adaptctl.control.adaptive import Adaptive, AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.mechanism.pose import Array
from adaptctl.scalars import Column


class Wanted(NamedTuple):
    """The velocity v_r (r,) that a law wants, its derivative a_r (r,), and what it remembers of it."""

    v_r: Column
    a_r: Column
    more: Any


class PassivityBased(Adaptive):
    """torque = Y_r(p, v, v_r, a_r) estimate - K s with s = v - v_r, and the gradient Y_r's.

    M s' + C s + K s = Y_r error: whatever the v_r, v_r' = a_r being exact, V = s'Ms/2 + error' Gamma^-1 error/2
    falls as -s'Ks (Ortega and Spong 1989). The laws differ in the v_r they want.
    """

    damping: Array

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
        s = v - v_r

        def gradient(sliding: Column) -> Column:
            return equations.adaptation_gradient(
                memory.q, memory.v, memory.v_r, memory.a_r, sliding, self.model.columns
            )

        estimate, learning = self._learned(memory, s, q, v, gradient)
        feedforward = equations.inverse_dynamics(q, v, v_r, a_r, self._parameters(estimate))
        torque = feedforward - self._damping * s
        elapsed = Column((self.period,))
        return torque, AdaptiveState(estimate, q, v, v_r, a_r, s, torque, elapsed, learning, more)

    @cached_property
    def _damping(self) -> Column:
        return Column(self.damping.tolist())
