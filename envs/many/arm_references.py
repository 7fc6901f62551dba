"""The references of many arms: sinusoids by their numbers, for native code; others by samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference
from adaptctl.control.references import SinusoidNumbers, Sinusoids
from adaptctl.errors import InputError
from adaptctl.simulation.references_of_many import SinusoidForm
from adaptctl.simulation.sampled_references import Preview

BLOCK = 64
"""Control periods sampled at once."""

Steps = NDArray[np.int64]


class ArmReferences:
    """References of r joints for many arms, one each, sampled every control period (s) and at times ahead (s)."""

    def __init__(self, arms: int, dof: int, control_period: float, look_ahead: Array) -> None:
        self.of: list[Reference | None] = [None] * arms
        self._terms = np.zeros(arms, dtype=np.int64)
        self._dof, self._period, self._look_ahead = dof, control_period, look_ahead
        self._groups: list[tuple[Steps, Preview]] = []

    def put(self, arms: Steps, references: Sequence[Reference]) -> None:
        """Give some arms references. Raises `InputError` for sinusoids of another number of joints, naming the arm."""
        for arm, reference in zip(arms.tolist(), references, strict=True):
            if isinstance(reference, Sinusoids) and len(reference.center) != self._dof:
                raise InputError(f"reference: expected {self._dof} joints, got {len(reference.center)} for arm {arm}")
            self.of[arm] = reference
            self._terms[arm] = len(reference.amplitude) if isinstance(reference, Sinusoids) else 0
        if not self.terms:
            self._group()

    @property
    def terms(self) -> int:
        """The most sinusoids that any joint of an arm sums; 0 where a reference is none of sinusoids."""
        return int(self._terms.max()) if self._terms.all() else 0

    def numbers(self, arms: Steps, terms: int) -> SinusoidNumbers:
        """The numbers of some arms' sinusoids (k, ...), filled up to so many terms by ones of no amplitude."""
        return SinusoidForm(self._dof, terms).numbers([self.of[arm] for arm in arms.tolist()])

    def rows(self, arms: Steps, steps: Steps) -> Array:
        """Rows (k, 3r + r per time ahead) of p, v, a now and p at each time ahead, of some arms at their steps (k,)."""
        rows = np.empty((len(self.of), (3 + len(self._look_ahead)) * self._dof))
        chosen = np.zeros(len(self.of), dtype=np.bool_)
        at = np.zeros(len(self.of), dtype=np.int64)
        chosen[arms], at[arms] = True, steps
        for members, samples in self._groups:
            own = members[chosen[members]]
            if own.size:
                rows[own] = samples.rows(at[own])
        return rows[arms]

    def _group(self) -> None:
        """Arms that share a reference share its samples."""
        known = {id(samples.reference): samples for _, samples in self._groups}
        members: dict[int, list[int]] = {}
        for arm, reference in enumerate(self.of):
            members.setdefault(id(reference), []).append(arm)
        self._groups = []
        for key, arms in members.items():
            reference = self.of[arms[0]]
            if reference is not None:
                samples = known.get(key) or Preview(reference, self._dof, self._period, self._look_ahead, BLOCK)
                self._groups.append((np.array(arms), samples))
