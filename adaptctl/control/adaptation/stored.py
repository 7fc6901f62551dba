"""Stored excitation, and excitation in quarantine."""

from __future__ import annotations

from typing import Any, NamedTuple

from adaptctl.arrays import Array
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.recalled_step import Flow
from adaptctl.scalars import Column, Scalar, where
from adaptctl.scalars.scalar import Condition

QUARANTINE = 0.3
"""s, mean time from a sample to the memory, so that a contact that is detected is forgotten"""


class Stored(NamedTuple):
    """
    Information and z of memory and of quarantine, in units of the initial gain.

    `valid` (2,) are factors of both, 1 or 0: what was found useless is cleared by the next period, with no pass over
    the matrices of its own.
    """

    information: Any
    known: Any
    pending: Any
    pending_known: Any
    valid: Any

    def cleared(self, kept: Scalar, pending: Scalar) -> Stored:
        """The same times factors of the memory and of quarantine."""
        return self._replace(valid=Column((kept, pending)))

    def flow(self, period: Period, alarmed: Condition, counts: Scalar, rates: tuple[Any, Any]) -> Flow:
        """Shares that a period keeps, takes and recalls of what is valid, at rates of forgetting and recall in 1/s."""
        quiet, stay, (forgetting, recall) = where(alarmed, 0.0, 1.0), 1.0 / (1.0 + period.period / QUARANTINE), rates
        keep = 1.0 / (1.0 + (forgetting * period.dt) * (quiet * counts))
        old, pending = self.valid
        return Flow(old * keep, pending * (quiet * (1.0 - stay)), pending * stay, quiet * (recall * period.dt))

    @property
    def remembered(self) -> Array:
        """Triangle of the information of one arm that counts."""
        counts: Array = self.information * self.valid[..., :1]
        return counts
