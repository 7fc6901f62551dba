"""Judgement of a robot by rows that no fit has seen, as its file predicts them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.identification.filtered_dynamics import RowFilter, Rows, SmoothMotion
from adaptctl.identification.fit import LogEvidence
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
        first = self.validation(self.cutoff, self._predicted(mechanism, self.cutoff))
        if self.band == self.cutoff:
            return first, first
        return first, self.validation(self.band, self._predicted(mechanism, self.band))

    def of(self, x: Array) -> Validation:
        """Validation of parameters (P,) of the fits' mechanism, at the common cut-off."""
        return self.validation(self.cutoff, self.evidence.rows[self.cutoff].regressor @ x)

    def validation(self, cutoff: float, predicted: Array) -> Validation:
        """Validation of torques (n, r) predicted for all rows of a cut-off."""
        rows, joints = self.evidence.rows[cutoff], self.evidence.mechanism.primary_joints
        units = tuple(joint.kind.effort_unit for joint in joints)
        return Validation(self.origin, cutoff, rows.time, rows.torque, predicted, units, self.left_out)

    def _predicted(self, mechanism: Mechanism, cutoff: float) -> Array:
        rows = self.evidence.rows[cutoff]
        here = [motion for motion in self.evidence.motions if np.any(rows.log == motion.number)]
        parts = [_predicted(motion, rows, mechanism) for motion in here]
        return np.concatenate(parts)


def _predicted(motion: SmoothMotion, rows: Rows, mechanism: Mechanism) -> Array:
    """Torques (n, r) that a robot's own regressor gives at those rows that are of a motion."""
    times = rows.time[rows.log == motion.number]
    row_filter = RowFilter.of(motion, rows.cutoff)
    skipped = row_filter.every * int(np.searchsorted(row_filter.times(motion), times[0]))
    first = motion.first + motion.every * skipped
    part = replace(motion, first=first, position=motion.position[skipped:], velocity=motion.velocity[skipped:])
    (found,) = part.filtered_rows(mechanism, [row_filter])
    return found.regressor[: len(times)] @ mechanism.inertial_parameters
