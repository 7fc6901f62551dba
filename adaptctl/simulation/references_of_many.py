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
    """Form of sampled references: points of `size` numbers a part that come from outside, one for all arms or each its
    own."""

    size: int
    each: bool

    @property
    def held(self) -> dict[str, int]:
        """Lengths of the columns that an arm keeps: an empty mapping."""
        return {}

    @property
    def shared(self) -> dict[str, int]:
        """Lengths of the point's parts by name, if it is one for all."""
        return {} if self.each else dict.fromkeys(REFERENCE, self.size)

    @property
    def driven(self) -> dict[str, int]:
        """Lengths of the point's parts by name, if each arm has its own."""
        return dict.fromkeys(REFERENCE, self.size) if self.each else {}

    def point(self, columns: Mapping[str, Column]) -> ReferencePoint:
        """The reference point as it came."""
        return ReferencePoint(*(columns[name] for name in REFERENCE))


@dataclass(frozen=True)
class SinusoidForm:
    """Form of sinusoidal references: each arm's own numbers, `terms` of them for each of `size` joints."""

    size: int
    terms: int

    @property
    def held(self) -> dict[str, int]:
        """Lengths, by name, of the numbers that make an arm's sinusoids."""
        wave = self.size * self.terms
        return SinusoidNumbers(self.size, wave, wave, wave, 1)._asdict()

    @property
    def shared(self) -> dict[str, int]:
        """Length of the column of the time (s), by its name."""
        return {"time": 1}

    @property
    def driven(self) -> dict[str, int]:
        """Lengths of the columns that come from outside for each arm: an empty mapping."""
        return {}

    def point(self, columns: Mapping[str, Column], ahead: float = 0.0) -> ReferencePoint:
        """The reference point of the sinusoids at the time now, or a time `ahead` (s) of it."""
        numbers = SinusoidNumbers(*(columns[name] for name in SinusoidNumbers._fields))
        return sinusoids_at(columns["time"][0] + ahead, numbers)

    def numbers(self, references: Sequence[Reference | None]) -> SinusoidNumbers:
        """The numbers (M, ...) of references, all `Sinusoids`, filled up with terms of no amplitude."""
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
    """References of many arms and their form; a single one is for all arms."""

    references: Sequence[Reference]
    form: ReferenceForm
    size: int
    arms: tuple[int, ...]
    """The number of arms (M,) they are for; () where one was given for any number."""

    @classmethod
    def of(cls, given: Reference | Sequence[Reference], size: int) -> ReferencesOfMany:
        """One reference or a sequence, of so many numbers each. Raises `InputError` where it is none."""
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
        """The references of some of the arms, in the same form."""
        if self._is_shared:
            return self
        return replace(self, references=self.references[arms], arms=(arms.stop - arms.start,))

    @property
    def held(self) -> Mapping[str, Array]:
        """Columns (M, n) that each arm keeps, by name: its sinusoids' numbers, or nothing."""
        return {} if self._numbers is None else self._numbers._asdict()

    def start(self) -> tuple[Array, Array]:
        """Positions (rad or m) and velocities, (M, n) each, at time zero; (n,) where one is for all."""
        if self._numbers is not None:
            point = sinusoids_at(0.0, SinusoidNumbers(*map(column, self._numbers)))
            return stacked(point.p.of, self.arms), stacked(point.v.of, self.arms)
        points = self._points(np.zeros(1))
        return points.p[0], points.v[0]

    def signals(self, time: Array) -> Mapping[str, Array]:
        """Columns of the references, by name, that come from outside at times (T,), s."""
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
