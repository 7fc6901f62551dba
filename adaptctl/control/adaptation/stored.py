"""Stored excitation, and excitation in quarantine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from adaptctl.arrays import Array
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.recalled_step import Flow, recalled_step
from adaptctl.scalars import Column, Scalar, maximum, where
from adaptctl.scalars.scalar import Condition

QUARANTINE = 0.3
"""s, mean time from a sample to the memory, so that a contact that is detected is forgotten"""
RESTING = 0.01
"""share of the recall at rest: with all of it a load and friction that one motion does not tell apart keep an arm off
where it rests, and with none estimates drift under noise"""


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
        moves, (old, pending) = quiet * counts, self.valid
        keep = 1.0 / (1.0 + (forgetting * period.dt) * moves)
        recalled = (recall * period.dt) * (quiet * maximum(counts, RESTING))
        return Flow(old * keep, pending * (quiet * (1.0 - stay)), pending * stay, recalled)

    def stepped(
        self, flow: Flow, units: Sequence[Column], torque: Column, shares: Column, at: tuple[Column, Column],
        beside: Sequence[Column],
    ) -> tuple[Stored, Column, Column]:  # fmt: skip
        """Memory with what leaves quarantine, the step at an estimate along a slope, and what is unsure of the rows."""
        # The step recalls what was kept, and takes what is new at once: then V does not rise (docs/adaptation.md).
        kept, new = flow.keep * self.known, flow.leave * self.pending_known
        x, slope = at
        right = slope - flow.recall * kept - new
        found = recalled_step(self.information, self.pending, units, shares, flow, x, right, beside)
        pending = flow.stay * self.pending_known
        for unit, share, missed in zip(units, shares, torque, strict=True):
            pending = pending + (share * missed) * unit
        after = Stored(found.information, kept + new, found.pending, pending, self.valid)
        return after, found.step, found.unsure

    @property
    def remembered(self) -> Array:
        """Triangle of the information of one arm that counts."""
        counts: Array = self.information * self.valid[..., :1]
        return counts
