"""Judgement of a robot by rows that no fit has seen, as its file predicts them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from math import lcm

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.identification.filtered_dynamics import RowFilter, SmoothMotion
from adaptctl.identification.fit import LogEvidence
from adaptctl.identification.momentum_balance import MomentumBalance
from adaptctl.identification.validation import Validation


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Part of the logs that plays no role in a fit, with the two cut-offs (Hz) at which robots are judged on it."""

    evidence: LogEvidence
    origin: str
    cutoff: float
    band: float
    left_out: tuple[int, ...] = ()

    def judged(self, mechanism: Mechanism) -> tuple[Validation, Validation]:
        """Validations of a robot as it is, by its own dynamics: at the common cut-off, and in the motion's band."""
        predicted = self._predicted(mechanism, {self.cutoff, self.band})
        found = {cutoff: self.validation(cutoff, torque) for cutoff, torque in predicted.items()}
        return found[self.cutoff], found[self.band]

    def of(self, x: Array) -> Validation:
        """Validation of parameters (P,) of the fits' mechanism, at the common cut-off."""
        return self.validation(self.cutoff, self.evidence.rows[self.cutoff].regressor @ x)

    def validation(self, cutoff: float, predicted: Array) -> Validation:
        """Validation of torques (n, r) predicted for all rows of a cut-off."""
        rows, joints = self.evidence.rows[cutoff], self.evidence.mechanism.primary_joints
        units = tuple(joint.kind.effort_unit for joint in joints)
        return Validation(self.origin, cutoff, rows.time, rows.torque, predicted, units, self.left_out)

    def _predicted(self, mechanism: Mechanism, cutoffs: Collection[float]) -> dict[float, Array]:
        """Torques (n, r) by cut-off, from one pass over each motion."""
        balance = MomentumBalance(mechanism, known=True)
        parts: dict[float, list[Array]] = {cutoff: [] for cutoff in cutoffs}
        for motion in self.evidence.motions:
            times = {c: self.evidence.rows[c].time[self.evidence.rows[c].log == motion.number] for c in cutoffs}
            for cutoff, torque in _predicted(motion, {c: own for c, own in times.items() if len(own)}, balance):
                parts[cutoff].append(torque)
        return {cutoff: np.concatenate(own) for cutoff, own in parts.items()}


def _predicted(
    motion: SmoothMotion, times: Mapping[float, Array], balance: MomentumBalance
) -> Iterator[tuple[float, Array]]:
    """Cut-offs with the torques (n, r) that a robot's own momenta give at rows of a motion, by the rows' times."""
    if not times:
        return
    filters = [RowFilter.of(motion, cutoff) for cutoff in times]
    first = [int(np.searchsorted(f.times(motion), own[0])) for f, own in zip(filters, times.values(), strict=True)]
    step = lcm(*(f.every for f in filters))
    skipped = min(k * f.every for k, f in zip(first, filters, strict=True)) // step * step
    place = motion.first + motion.every * skipped
    part = replace(motion, first=place, position=motion.position[skipped:], velocity=motion.velocity[skipped:])
    found = part.filtered_regressors(balance, filters)
    for f, k, packed, (cutoff, own) in zip(filters, first, found, times.items(), strict=True):
        yield cutoff, packed.torques(np.ones(1))[k - skipped // f.every :][: len(own)]


def late_blocks(evidence: LogEvidence, share: float) -> list[int]:
    """Blocks of the last share of each log; whole logs, the last ones, where each is one block."""
    sources = {motion.number: motion.log.source for motion in evidence.motions}
    own = [sources[number] for number, _ in evidence.edges]
    place = [(own[:b].count(source) + 0.5) / own.count(source) for b, source in enumerate(own)]
    return sorted(np.argsort(place, kind="stable")[round((1.0 - share) * len(own)) :].tolist())
