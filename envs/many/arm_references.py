"""The references of many arms: sinusoids by their numbers, for native code; others by samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference
from adaptctl.control.references import SinusoidNumbers, Sinusoids
from adaptctl.envs.preview import sampled
from adaptctl.errors import InputError

BLOCK = 64
"""Control periods sampled at once."""

Steps = NDArray[np.int64]


class ArmReferences:
    """A reference of r joints for each arm, looked at every control period (s) and at times ahead (s)."""

    def __init__(self, arms: int, dof: int, control_period: float, look_ahead: Array) -> None:
        self.of: list[Reference | None] = [None] * arms
        self._terms = np.zeros(arms, dtype=np.int64)
        self._dof, self._period, self._look_ahead = dof, control_period, look_ahead
        self._groups: list[tuple[Steps, _Samples]] = []

    def put(self, arms: Steps, references: Sequence[Reference]) -> None:
        """Give references to some arms."""
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
        """Those of some arms' sinusoids (k, ...), filled up with sinusoids of no amplitude."""
        known: dict[int, SinusoidNumbers] = {}
        rows = []
        for arm in arms.tolist():
            reference = self.of[arm]
            if isinstance(reference, Sinusoids) and id(reference) not in known:
                known[id(reference)] = _filled(reference.numbers, terms * self._dof)
            rows.append(known[id(reference)])
        return SinusoidNumbers(*(np.array(values) for values in zip(*rows, strict=True)))

    def rows(self, arms: Steps, steps: Steps) -> Array:
        """p, v, a now and p at each time ahead (k, 3r + r per time), of some arms at their steps (k,)."""
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
                samples = known.get(key) or _Samples(reference, self._dof, self._period, self._look_ahead)
                self._groups.append((np.array(arms), samples))


class _Samples:
    """Blocks of rows of one reference, those that its arms are in."""

    def __init__(self, reference: Reference, dof: int, period: float, look_ahead: Array) -> None:
        self.reference, self._dof, self._period, self._look_ahead = reference, dof, period, look_ahead
        self._blocks: dict[int, Array] = {}

    def rows(self, steps: Steps) -> Array:
        """At each step (k,)."""
        needed, which = np.unique(steps // BLOCK, return_inverse=True)
        self._blocks = {block: self._block(block) for block in needed.tolist()}
        return np.stack(list(self._blocks.values()))[which, steps % BLOCK]

    def _block(self, block: int) -> Array:
        if block in self._blocks:
            return self._blocks[block]
        times = self._period * np.arange(block * BLOCK, (block + 1) * BLOCK, dtype=np.float64)
        return sampled(self.reference, times, self._dof, self._look_ahead)


def _filled(numbers: SinusoidNumbers, size: int) -> SinusoidNumbers:
    """With as many sinusoids."""
    none = np.zeros(size - len(numbers.amplitude))
    amplitude, frequency, phase = (np.concatenate((part, none)) for part in numbers[1:4])
    return SinusoidNumbers(numbers.center, amplitude, frequency, phase, numbers.start_time)
