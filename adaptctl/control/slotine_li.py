"""Slotine and Li's adaptive controller on fundamental parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains import per_joint
from adaptctl.control.passivity import PassivityBased, Wanted
from adaptctl.identifiability import ReducedModel
from adaptctl.mechanism.pose import Array
from adaptctl.scalars import Column


@dataclass(frozen=True, eq=False)
class SlotineLi(PassivityBased):
    """Adaptive control by passivity (Slotine and Li 1987), on as many parameters as the model has.

        e = p - p_d,  v_r = v_d - Lambda e,  s = v - v_r
        torque = Y_r(p, v, v_r, a_r) estimate - K s
        estimate' = -Gamma Y_r' s, or another adaptation law's

    In continuous time V = s'Ms/2 + (error)' Gamma^-1 (error)/2 falls as -s'Ks, so the tracking error goes to
    zero; the estimates converge too only under persistent excitation, and nothing keeps them physically
    consistent, unless the adaptation law does.

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
        for name in ("bandwidth", "damping"):
            object.__setattr__(self, name, per_joint(getattr(self, name), self.dof, name))
        self._settle()
        self._require_carried(self.damping)

    def wanted(self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState) -> Wanted:
        """The reference's velocity, and Lambda back to it."""
        v_r = reference.v - self._bandwidth * (p - reference.p)
        return Wanted(v_r, reference.a - self._bandwidth * (v - reference.v), NoMemory())

    @cached_property
    def _bandwidth(self) -> Column:
        return Column(self.bandwidth.tolist())
