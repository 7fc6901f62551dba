"""The references of many arms: sinusoids by their numbers, for native code; others by samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference
from adaptctl.control.references import SinusoidNumbers, Sinusoids
from adaptctl.errors import InputError, NotFoundError
from adaptctl.simulation.references_of_many import SinusoidForm
from adaptctl.simulation.sampled_references import Preview

BLOCK = 64
"""Control periods sampled at once."""

Steps = NDArray[np.int64]


class ArmReferences:
    """References of N arms of r joints, one each, evaluated at every control period (s) and at L look-ahead times (s):
    those that are sums of sinusoids (`Sinusoids`) in native code from their amplitudes, frequencies and phases, others
    from rows of samples.

    `arms` is N and `dof` r; `control_period` is in s; `look_ahead` (L,) are the times ahead, s. The attribute `of`
    lists the arms' references, None until `put` sets them. Nothing is checked at construction.
    """

    def __init__(self, arms: int, dof: int, control_period: float, look_ahead: Array) -> None:
        self.of: list[Reference | None] = [None] * arms
        self._terms = np.zeros(arms, dtype=np.int64)
        self._dof, self._period, self._look_ahead = dof, control_period, look_ahead
        self._groups: list[tuple[Steps, Preview]] = []

    def put(self, arms: Steps, references: Sequence[Reference]) -> None:
        """Set the references of the arms of indices `arms` (k,), zero-based, to the k `references`, callables from
        times (s) to a `ReferencePoint`; nothing is returned. Raises `InputError`, naming the arm, for `Sinusoids` of
        another number of joints, and `ValueError` where there are not k references. Where then some arm has another
        kind of reference than `Sinusoids`, all references are sampled at once, which raises `InputError` for results of
        a wrong shape and `NonFiniteError` for NaN and infinity."""
        for arm, reference in zip(arms.tolist(), references, strict=True):
            if isinstance(reference, Sinusoids) and len(reference.center) != self._dof:
                raise InputError(f"reference: expected {self._dof} joints, got {len(reference.center)} for arm {arm}")
            self.of[arm] = reference
            self._terms[arm] = len(reference.amplitude) if isinstance(reference, Sinusoids) else 0
        self._groups = [] if self.terms else self._grouped()

    @property
    def terms(self) -> int:
        """Largest number of sinusoids that an arm's reference sums in each joint; 0 where not all arms have `Sinusoids`
        as their reference, so that rows of samples are needed."""
        return int(self._terms.max()) if self._terms.all() else 0

    def numbers(self, arms: Steps, terms: int) -> SinusoidNumbers:
        """Parameters of the sinusoids of the arms of indices `arms` (k,), zero-based, r joints each, a
        `SinusoidNumbers`: center (k, r), rad (m), amplitude, rad (m), frequency, Hz, and phase, rad, each (k, r
        `terms`) with the r numbers of the first sinusoid first, and start_time (k, 1), s. Each reference has `terms`
        sinusoids a joint, the missing ones with amplitude 0. Raises `KeyError` unless all k arms have `Sinusoids`,
        `ValueError` for fewer `terms` than one of them has."""
        return SinusoidForm(self._dof, terms).numbers([self.of[arm] for arm in arms.tolist()])

    def rows(self, arms: Steps, steps: Steps) -> Array:
        """References' points now and ahead, (k, 3r + r L), of the k arms of zero-based indices `arms` (k,), a row an
        arm, at the control periods `steps` (k,), counted from 0 at the episode's start. A row has the positions,
        velocities and accelerations of r joints at that time, then the positions at each of the L look-ahead times, in
        rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic).

        Raises `NotFoundError`, naming the arm, for arms without samples: those whose reference has not been set by
        `put`, and all where the property `terms` is not 0; and what sampling the references raises: `InputError` for a
        wrong shape, `NonFiniteError` for NaN and infinity.
        """
        rows = np.empty((len(self.of), (3 + len(self._look_ahead)) * self._dof))
        chosen = np.zeros(len(self.of), dtype=np.bool_)
        at = np.zeros(len(self.of), dtype=np.int64)
        chosen[arms], at[arms] = True, steps
        for members, samples in self._groups:
            own = members[chosen[members]]
            if own.size:
                rows[own], chosen[own] = samples.rows(at[own]), False
        if chosen.any():
            raise NotFoundError(f"references: there are no samples of that of arm {int(chosen.argmax())}: give it one")
        return rows[arms]

    def _grouped(self) -> list[tuple[Steps, Preview]]:
        """Groups of arms that share a reference, and so its samples."""
        known = {id(samples.reference): samples for _, samples in self._groups}
        members: dict[int, list[int]] = {}
        for arm, reference in enumerate(self.of):
            members.setdefault(id(reference), []).append(arm)
        groups = []
        for key, arms in members.items():
            reference = self.of[arms[0]]
            if reference is not None:
                samples = known.get(key) or Preview(reference, self._dof, self._period, self._look_ahead, BLOCK)
                groups.append((np.array(arms), samples))
        return groups
