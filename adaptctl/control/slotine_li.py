"""Slotine and Li's adaptive controller on fundamental parameters."""

from __future__ import annotations

from dataclasses import dataclass

from adaptctl.control.adaptation.law import NoMemory
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.passivity import PassivityBased, Wanted
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

    Arguments and errors are those of `PassivityBased`.
    """

    def wanted(self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState) -> Wanted:
        """The reference's velocity, and Lambda back to it."""
        v_r = reference.v - self._bandwidth * (p - reference.p)
        return Wanted(v_r, reference.a - self._bandwidth * (v - reference.v), NoMemory())
