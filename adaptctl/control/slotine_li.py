"""Slotine and Li's adaptive controller on fundamental parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.control.gains import per_joint, require_sampled_gain
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.mechanism.pose import Array, frozen_array
from adaptctl.scalars import Column


class SlotineLiState(NamedTuple):
    """What the controller remembers: its estimate, and the last tick's motion for the trapezium."""

    estimate: Any
    """(k,) the parameters' estimate"""
    q: Any
    """(n,) the tree's joints at the last tick: where the loops, if any, are followed from"""
    v: Any
    v_r: Any
    a_r: Any
    s: Any
    elapsed: Any
    """(1,) s since the last tick, 0 before the first"""


@dataclass(frozen=True, eq=False)
class SlotineLi(Controller[SlotineLiState]):
    """Adaptive control by passivity (Slotine and Li 1987), on as many parameters as the model has.

        e = p - p_d,  v_r = v_d - Lambda e,  s = v - v_r
        torque = Y_r(p, v, v_r, a_r) estimate - K s
        estimate' = -Gamma Y_r' s

    In continuous time V = s'Ms/2 + (error)' Gamma^-1 (error)/2 falls as -s'Ks, so the tracking error goes to
    zero; the estimates converge too only under persistent excitation, and nothing keeps them physically
    consistent. In discrete time the estimate moves by the trapezium -T_c Gamma Y_k'(s_k + s_k+1)/2, which
    holds V where Euler's rule lets it rise.

    `bandwidth` is Lambda (1/s) and `damping` K (N m s/rad), scalars or (r,); `adaptation` is Gamma, its
    diagonal (k,) or whole (k, k), or None to switch adaptation off; `initial` (k,) is the first estimate, zero
    when not given; `period` is the control period T_c in s.
    Raises `GainError` when the period cannot carry the damping, `InputError` on wrong shapes.
    """

    model: ReducedModel
    bandwidth: Array
    damping: Array
    adaptation: Array | None = None
    initial: Array | None = None
    period: float = 1e-3

    def __post_init__(self) -> None:
        mechanism, k = self.model.mechanism, len(self.model.columns)
        for name in ("bandwidth", "damping"):
            object.__setattr__(self, name, per_joint(getattr(self, name), mechanism.dof, name))
        initial = np.zeros(k) if self.initial is None else self.initial
        object.__setattr__(self, "initial", frozen_array(initial, (k,), "initial estimate"))
        if self.adaptation is not None:
            object.__setattr__(self, "adaptation", checked_gain(self.adaptation, k))
        require_sampled_gain(mechanism, self.damping, self.period)

    @property
    def dof(self) -> int:
        """Number of joints r."""
        return self.model.mechanism.dof

    def start(self, p: Array, v: Array) -> SlotineLiState:
        """The first estimate, and no motion to learn from yet."""
        rest = np.zeros(self.dof)
        q = self.model.mechanism.configuration(p)
        return SlotineLiState(np.array(self.initial), q, v, v, rest, rest, np.zeros(1))

    def law(
        self, p: Column, v: Column, reference: ReferencePoint, memory: SlotineLiState
    ) -> tuple[Column, SlotineLiState]:
        """One tick: learn from the period that has passed, then act."""
        e, e_rate = p - reference.p, v - reference.v
        v_r = reference.v - self._bandwidth * e
        a_r = reference.a - self._bandwidth * e_rate
        s = v - v_r
        estimate = self._learned(memory, s)
        equations = self.model.mechanism.equations
        q = equations.closed(p, memory.q)
        parameters = spread(estimate, self.model.columns, equations.parameters)
        feedforward = equations.inverse_dynamics(q, v, v_r, a_r, parameters)
        return feedforward - self._damping * s, SlotineLiState(estimate, q, v, v_r, a_r, s, Column((self.period,)))

    def _learned(self, memory: SlotineLiState, s: Column) -> Column:
        """The estimate after the period that has passed: the trapezium between the last s and this one."""
        if self._gain is None:
            return memory.estimate
        gradient = self.model.mechanism.equations.adaptation_gradient(
            memory.q, memory.v, memory.v_r, memory.a_r, 0.5 * (memory.s + s), self.model.columns
        )
        return memory.estimate - memory.elapsed[0] * applied(self._gain, gradient)

    @cached_property
    def _bandwidth(self) -> Column:
        return Column(self.bandwidth.tolist())

    @cached_property
    def _damping(self) -> Column:
        return Column(self.damping.tolist())

    @cached_property
    def _gain(self) -> Column | list[Column] | None:
        if self.adaptation is None:
            return None
        rows = self.adaptation.tolist()
        return Column(rows) if self.adaptation.ndim == 1 else [Column(row) for row in rows]


def spread(values: Column, columns: Sequence[int], size: int) -> Column:
    """Values at their columns, exact zeros elsewhere, so that the rest is never computed once traced."""
    entries: list[Any] = [0.0] * size
    for column, value in zip(columns, values, strict=True):
        entries[column] = value
    return Column(entries)


def applied(gain: Column | Sequence[Column], gradient: Column) -> Column:
    """Gamma times the gradient, for a diagonal or a whole Gamma."""
    if isinstance(gain, Column):
        return gain * gradient
    return Column(row @ gradient for row in gain)


def checked_gain(gain: ArrayLike, k: int) -> Array:
    """An adaptation gain (k,) or (k, k), refused unless it is symmetric and positive definite."""
    array = np.asarray(gain, dtype=np.float64)
    array = frozen_array(array, (k, k) if array.ndim == 2 else (k,), "adaptation gain")
    positive = np.all(array > 0.0) if array.ndim == 1 else _is_positive_definite(array)
    if not positive:
        raise InputError("adaptation gain: expected a positive diagonal or a symmetric positive definite matrix")
    return array


def _is_positive_definite(matrix: Array) -> bool:
    symmetric = np.allclose(matrix, matrix.T, rtol=1e-12, atol=0.0)
    return bool(symmetric and np.linalg.eigvalsh(matrix)[0] > 0.0)
