"""References of many arms: one for all, or one each; in samples, or sinusoids by their numbers, for native code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from adaptctl.arrays import Array, stacked
from adaptctl.caching import cached_property
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.control.references import SinusoidNumbers, Sinusoids, sinusoids_at
from adaptctl.errors import InputError
from adaptctl.scalars import Column, column
from adaptctl.simulation.sampled_references import REFERENCE, sampled


@dataclass(frozen=True)
class SampledForm:
    """Form in which a compiled step gets its reference points as samples from outside: positions, rad (m), velocities
    and accelerations, the same per s and s^2, of `size` joints each, one point for all arms or, where `each` is True,
    one for each arm. `held`, `shared` and `driven` name the step's columns (vectors); forms that are equal share native
    code. Nothing is checked."""

    size: int
    each: bool

    @property
    def held(self) -> dict[str, int]:
        """Lengths, by name, of the columns that each arm keeps through a run: {}, for samples are not kept."""
        return {}

    @property
    def shared(self) -> dict[str, int]:
        """Lengths, by name, of the columns that are new in each control period and the same for all arms:
        "reference_p", "reference_v" and "reference_a", one number for each of `size` joints, where one reference is for
        all arms; else {}."""
        return {} if self.each else dict.fromkeys(REFERENCE, self.size)

    @property
    def driven(self) -> dict[str, int]:
        """Lengths, by name, of the columns that are new in each control period for each arm: "reference_p",
        "reference_v" and "reference_a", one number for each of `size` joints, where each arm has its own reference;
        else {}."""
        return dict.fromkeys(REFERENCE, self.size) if self.each else {}

    def point(self, columns: Mapping[str, Column]) -> ReferencePoint:
        """The reference point of a control period, made of three entries of `columns`, vectors of scalars, unchanged:
        "reference_p", positions, rad (m), "reference_v", velocities, and "reference_a", accelerations, the same per s
        and s^2, (r,) each for r = `size` joints. Raises `KeyError` where one is missing."""
        return ReferencePoint(*(columns[name] for name in REFERENCE))


@dataclass(frozen=True)
class SinusoidForm:
    """Form in which a compiled step computes its reference points itself, from the numbers of each arm's own
    `Sinusoids`, sums of `terms` sinusoids for each of `size` joints. `held`, `shared` and `driven` name the step's
    columns (vectors); forms that are equal share native code. Nothing is checked."""

    size: int
    terms: int

    @property
    def held(self) -> dict[str, int]:
        """Lengths, by name, of the columns that each arm keeps through a run, the numbers of its sinusoids for r =
        `size` joints and h = `terms` terms: r for "center" (rad or m); h r for "amplitude" (rad or m), "frequency" (Hz)
        and "phase" (rad), each with the r numbers of the first term first; 1 for "start_time" (s)."""
        wave = self.size * self.terms
        return SinusoidNumbers(self.size, wave, wave, wave, 1)._asdict()

    @property
    def shared(self) -> dict[str, int]:
        """Lengths, by name, of the columns that are new in each control period and the same for all arms: 1 for "time"
        (s)."""
        return {"time": 1}

    @property
    def driven(self) -> dict[str, int]:
        """Lengths, by name, of the columns that are new in each control period for each arm: {}, for the time alone is
        new."""
        return {}

    def point(self, columns: Mapping[str, Column], ahead: float = 0.0) -> ReferencePoint:
        """The reference point of an arm's sums of sinusoids, at the time in `columns` plus `ahead` (s), 0 unless given:
        columns (r,), vectors, for r = `size` joints of positions, rad (m), velocities, rad/s (m/s), and accelerations,
        rad/s^2 (m/s^2), over scalars of any kind (floats, arrays, or symbols to be compiled).

        `columns` has by name "time" (1,), s, and the numbers of h = `terms` sinusoids a joint: "center" (r,) and
        "amplitude" (h r,), rad (m), "frequency" (h r,), Hz, "phase" (h r,), rad, with the r numbers of the first
        sinusoid first, and "start_time" (1,), s. Raises `KeyError` where one is missing.
        """
        numbers = SinusoidNumbers(*(columns[name] for name in SinusoidNumbers._fields))
        return sinusoids_at(columns["time"][0] + ahead, numbers)

    def numbers(self, references: Sequence[Reference | None]) -> SinusoidNumbers:
        """The numbers of the M `references`, all of them `Sinusoids`, for r = `size` joints and h = `terms` terms:
        center (M, r) and amplitude (M, h r), rad or m, frequency, Hz, and phase, rad, (M, h r) each, with the r numbers
        of the first term first, and start_time (M, 1), s. Sums of fewer than `terms` sinusoids are filled up with terms
        of amplitude 0. Raises `KeyError` for what is no `Sinusoids`, `ValueError` for sums of more terms."""
        known: dict[int, SinusoidNumbers] = {}
        for one in references:
            if isinstance(one, Sinusoids) and id(one) not in known:
                known[id(one)] = _filled(one.numbers, self.terms * self.size)
        rows = [known[id(one)] for one in references]
        return SinusoidNumbers(*(np.array(values) for values in zip(*rows, strict=True)))


ReferenceForm: TypeAlias = SampledForm | SinusoidForm
"""The way in which a step comes by its reference points: columns that an arm keeps (`held`), of a control period
(`shared`), of both (`driven`), and the point that they make. Equal forms share native code."""


@dataclass(frozen=True, eq=False)
class ReferencesOfMany:
    """References of many arms, `references`, one for all or one for each, and the `form` in which a compiled step gets
    their points: as samples from outside, or as sinusoids by their numbers. Each point has positions, rad (m),
    velocities and accelerations, the same per s and s^2, of `size` joints. `arms` is the number of arms (M,), or ()
    where one reference was given for any number. `ReferencesOfMany.of` checks them; the class itself checks nothing."""

    references: Sequence[Reference]
    form: ReferenceForm
    size: int
    arms: tuple[int, ...]
    """The number of arms (M,) they are for; () where one was given for any number."""

    @classmethod
    def of(cls, given: Reference | Sequence[Reference], size: int) -> ReferencesOfMany:
        """The references of many arms, from `given`, one for all or a sequence with one for each, whose points are of
        `size` joints. One for all, or the same object for each, is sampled. Where all of several are `Sinusoids` with
        equal numbers of terms, they are kept by their numbers; else all are sampled. Raises `InputError` for what is
        not callable, and for an empty sequence."""
        if callable(given):
            return cls([given], SampledForm(size, each=False), size, ())
        references = list(given) if isinstance(given, Sequence) else []
        if not references or not all(map(callable, references)):
            raise InputError(f"reference: expected a Reference or a sequence of them, got {given!r}")
        arms = (len(references),)
        if all(one is references[0] for one in references):
            return cls(references[:1], SampledForm(size, each=False), size, arms)
        return cls(references, _form(references, size), size, arms)

    def of_arms(self, arms: slice) -> ReferencesOfMany:
        """The references, in the same form, of those arms that the slice `arms` (from start to stop) selects;
        themselves where one is for all. Nothing is checked."""
        if self._is_shared:
            return self
        return replace(self, references=self.references[arms], arms=(arms.stop - arms.start,))

    @property
    def held(self) -> Mapping[str, Array]:
        """The columns, by name, that each of M arms keeps through a run: the numbers of its `Sinusoids`, of h terms for
        each of r joints: "center" (M, r) and "amplitude" (M, h r), rad or m, "frequency", Hz, and "phase", rad, (M, h
        r) each, with the r numbers of the first term first, and "start_time" (M, 1), s; empty where references are
        sampled."""
        return {} if self._numbers is None else self._numbers._asdict()

    def start(self) -> tuple[Array, Array]:
        """Positions, rad (m), and velocities, rad/s (m/s), of the references at time zero: (M, n) each for M arms, n
        numbers a point; (n,) where one is for all. Raises, where references are sampled, `InputError` for points of
        another shape and `NonFiniteError` for NaN or infinity."""
        if self._numbers is not None:
            point = sinusoids_at(0.0, SinusoidNumbers(*map(column, self._numbers)))
            return stacked(point.p.of, self.arms), stacked(point.v.of, self.arms)
        points = self._points(np.zeros(1))
        return points.p[0], points.v[0]

    def signals(self, time: Array) -> Mapping[str, Array]:
        """The columns, by name, that come from outside at the times `time` (T,), s, of T control periods: "time" (T, 1)
        for sinusoids kept by their numbers; else "reference_p", rad (m), "reference_v" and "reference_a", the same per
        s and s^2, (T, M, n) for M arms, n numbers a point, or (T, n) where one reference is for all. Raises, where
        references are sampled, `InputError` for points of another shape and `NonFiniteError` for NaN or infinity."""
        if isinstance(self.form, SinusoidForm):
            return {"time": time[:, None]}
        return dict(zip(REFERENCE, self._points(time), strict=True))

    def _points(self, time: Array) -> ReferencePoint:
        """The points (T, M, n) at times (T,), (T, n) where one is for all."""
        points = [sampled(one, time, self.size) for one in self.references]
        if self._is_shared:
            return points[0]
        return ReferencePoint(*(np.stack(parts, axis=1) for parts in zip(*points, strict=True)))

    @property
    def _is_shared(self) -> bool:
        """True if one reference is for all arms."""
        return isinstance(self.form, SampledForm) and not self.form.each

    @cached_property
    def _numbers(self) -> SinusoidNumbers | None:
        """Numbers (M, n) of the sinusoids, where all are sinusoids of one form; else None."""
        if not isinstance(self.form, SinusoidForm):
            return None
        return self.form.numbers(self.references)


def _form(references: Sequence[Reference], size: int) -> ReferenceForm:
    """Sinusoids where all are sums of as many, samples else."""
    lengths = {one.amplitude.shape if isinstance(one, Sinusoids) else None for one in references}
    shape = lengths.pop()
    if lengths or shape is None or shape[1] != size:
        return SampledForm(size, each=True)
    return SinusoidForm(size, shape[0])


def _filled(numbers: SinusoidNumbers, size: int) -> SinusoidNumbers:
    """The numbers of as many terms as make `size` waves."""
    none = np.zeros(size - len(numbers.amplitude))
    amplitude, frequency, phase = (np.concatenate((part, none)) for part in numbers[1:4])
    return SinusoidNumbers(numbers.center, amplitude, frequency, phase, numbers.start_time)
