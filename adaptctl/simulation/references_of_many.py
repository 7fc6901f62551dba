"""What many arms follow: one reference, or one each; in samples, or by formula."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from adaptctl.arrays import Array, stacked
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.control.references import SinusoidNumbers, Sinusoids, sinusoids_at
from adaptctl.errors import InputError
from adaptctl.scalars import Column, column
from adaptctl.simulation.closed_loop import REFERENCE, sampled


@dataclass(frozen=True)
class Samples:
    """Points of so many numbers each that come from outside, one for all arms or each its own."""

    size: int
    each: bool

    @property
    def held(self) -> dict[str, int]:
        """Nothing is kept."""
        return {}

    @property
    def shared(self) -> dict[str, int]:
        """The point, if it is one for all."""
        return {} if self.each else dict.fromkeys(REFERENCE, self.size)

    @property
    def driven(self) -> dict[str, int]:
        """The point, if each has its own."""
        return dict.fromkeys(REFERENCE, self.size) if self.each else {}

    def point(self, columns: dict[str, Column]) -> ReferencePoint:
        """As it came."""
        return ReferencePoint(*(columns.pop(name) for name in REFERENCE))


@dataclass(frozen=True)
class Formula:
    """Sinusoids of each arm's own numbers, so many terms a joint."""

    size: int
    terms: int

    @property
    def held(self) -> dict[str, int]:
        """What they are made of."""
        wave = self.size * self.terms
        return SinusoidNumbers(self.size, wave, wave, wave, 1)._asdict()

    @property
    def shared(self) -> dict[str, int]:
        """The time, s."""
        return {"time": 1}

    @property
    def driven(self) -> dict[str, int]:
        """Nothing comes from outside."""
        return {}

    def point(self, columns: dict[str, Column]) -> ReferencePoint:
        """The sinusoids now."""
        numbers = SinusoidNumbers(*(columns.pop(name) for name in SinusoidNumbers._fields))
        return sinusoids_at(columns.pop("time")[0], numbers)


ReferenceForm: TypeAlias = Samples | Formula
"""How a step comes by its reference points: columns that an arm keeps (`held`), of a control period (`shared`), of both
(`driven`), and the point that they make. Equal forms share native code."""


@dataclass(frozen=True, eq=False)
class ReferencesOfMany:
    """References and their form; a single one is for all arms."""

    references: Sequence[Reference]
    form: ReferenceForm
    size: int

    @classmethod
    def of(cls, given: Reference | Sequence[Reference], size: int) -> ReferencesOfMany:
        """One reference or a sequence, of so many numbers each. Raises `InputError` where it is none."""
        if callable(given):
            return cls([given], Samples(size, each=False), size)
        references = list(given) if isinstance(given, Sequence) else []
        if not references or not all(map(callable, references)):
            raise InputError(f"reference: expected a Reference or a sequence of them, got {given!r}")
        return cls(references, _form(references, size), size)

    @property
    def arms(self) -> tuple[int, ...]:
        """How many arms they are for; () where one is for all."""
        each = not isinstance(self.form, Samples) or self.form.each
        return (len(self.references),) if each else ()

    @property
    def held(self) -> Mapping[str, Array]:
        """What each arm keeps (M, n)."""
        return {} if self._numbers is None else self._numbers._asdict()

    def start(self) -> tuple[Array, Array]:
        """Positions and velocities (M, n) at time zero, (n,) where one is for all."""
        if self._numbers is not None:
            point = sinusoids_at(0.0, SinusoidNumbers(*map(column, self._numbers)))
            return stacked(point.p.of, self.arms), stacked(point.v.of, self.arms)
        points = self._points(np.zeros(1))
        return points.p[0], points.v[0]

    def signals(self, time: Array) -> Mapping[str, Array]:
        """What comes from outside at times (T,)."""
        if isinstance(self.form, Formula):
            return {"time": time[:, None]}
        return dict(zip(REFERENCE, self._points(time), strict=True))

    def _points(self, time: Array) -> ReferencePoint:
        """The points (T, M, n) at times (T,), (T, n) where one is for all."""
        points = [sampled(one, time, self.size) for one in self.references]
        if not self.arms:
            return points[0]
        return ReferencePoint(*(np.stack(parts, axis=1) for parts in zip(*points, strict=True)))

    @cached_property
    def _numbers(self) -> SinusoidNumbers | None:
        """What sinusoids are made of (M, n), where they are followed by formula."""
        if not isinstance(self.form, Formula):
            return None
        numbers = [one.numbers for one in self.references if isinstance(one, Sinusoids)]
        return SinusoidNumbers(*(np.array(parts) for parts in zip(*numbers, strict=True)))


def _form(references: Sequence[Reference], size: int) -> ReferenceForm:
    """Formula where all are sinusoids alike, samples else."""
    lengths = {one.amplitude.shape if isinstance(one, Sinusoids) else None for one in references}
    shape = lengths.pop()
    if lengths or shape is None or shape[1] != size:
        return Samples(size, each=True)
    return Formula(size, shape[0])
