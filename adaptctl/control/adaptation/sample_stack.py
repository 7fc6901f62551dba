"""Stack of samples, and a step of an estimate along each of their equations."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple, TypeAlias

from adaptctl.compilation.loops import Interpreter, matrix, vector
from adaptctl.compilation.matrix_operation import MatrixOperation
from adaptctl.control.adaptation.symmetric import copied, dots

Places: TypeAlias = tuple[tuple[int, ...], ...]
"""Indices of the parameters in each joint's equation; a sample has their entries, joint by joint."""


class Along(NamedTuple):
    """Row (k,) of an equation, and gain times row."""

    m: Interpreter
    places: Places
    gain: Any
    is_whole: bool
    row: Any
    loaded: Any
    k: int

    def equations(self, samples: Any, q: Any) -> Iterator[int]:
        """Joints, each with the row of its equation in sample q."""
        first = 0
        for i, places in enumerate(self.places):
            for j in self.m.columns(0, self.k):
                self.row[0, j] = 0.0
            entries = [self.m.variable(samples[q, first + entry]) for entry in range(len(places))]
            for place, entry in zip(places, entries, strict=True):
                self.row[0, place] = entry.value
            first += len(places)
            self._load(places, entries)
            yield i

    def _load(self, places: tuple[int, ...], entries: list[Any]) -> None:
        for j in self.m.columns(0, self.k):
            if not self.is_whole:
                self.loaded[0, j] = self.gain[0, j] * self.row[0, j]
                continue
            total = self.m.variable(0.0)
            for place, entry in zip(places, entries, strict=True):
                total.value = total.value + self.gain[place, j] * entry.value
            self.loaded[0, j] = total.value

    def power(self, sample: Any, weights: Any) -> Any:
        """Sum of weights times row' gain row."""
        total = self.m.variable(0.0)
        for i in self.equations(sample, 0):
            total.value = total.value + weights[i] * dots(self.m, [(self.loaded, 0)], self.row, 0, self.k)[0]
        return total.value

    def step(self, x: Any, samples: Any, torques: Any, weights: Any, q: Any, dt: Any) -> None:
        """Step of x along the equations of sample q, implicit in time, one after the other."""
        for i in self.equations(samples, q):
            power, known = dots(self.m, [(self.loaded, 0), (x, 0)], self.row, 0, self.k)
            weight = self.m.variable(weights[i] * dt)
            excess = self.m.variable(weight.value / (1.0 + weight.value * power) * (known - torques[q, i]))
            for j in self.m.columns(0, self.k):
                x[0, j] = x[0, j] - excess.value * self.loaded[0, j]


@cache
def sample_stack(places: Places, count: int, k: int, is_whole: bool) -> MatrixOperation:
    """
    Estimate (k,), rows and torques of `count` samples, and a flag (1,), after a period.

    Of estimate, gain, rows, torques, a period's sample and torques, weights of the joints, and (threshold of novelty,
    flag of a sample that is kept, control period).
    """
    r, size, lines = len(places), sum(map(len, places)), k if is_whole else 1

    def sample_stack(
        m: Interpreter, estimate: Any, gain: Any, rows: Any, torques: Any, sample: Any, torque: Any, weights: Any,
        numbers: Any, estimate_out: Any, rows_out: Any, torques_out: Any, flag_out: Any,
    ) -> None:  # fmt: skip
        along = Along(m, places, copied(m, gain, lines, k), is_whole, m.scratch(1, k), m.scratch(1, k), k)
        x, apart = copied(m, estimate, 1, k), m.scratch(1, size)
        for j in m.columns(0, size):
            apart[0, j] = sample[j] - rows[0, j]
        flag = m.variable(m.where_less(numbers[0], along.power(apart, weights), numbers[1], 0.0))
        kept, measured = _kept(m, rows, sample, count, size, flag), _kept(m, torques, torque, count, r, flag)
        for q in m.range(count):
            along.step(x, kept, measured, weights, q, numbers[2])
        for made, out, height, width in (
            (kept, rows_out, count, size),
            (measured, torques_out, count, r),
            (x, estimate_out, 1, k),
        ):
            for q in m.range(height):
                for j in m.columns(0, width):
                    out[q, j] = made[q, j]
        flag_out[0] = flag.value

    stack = [matrix(count, size), matrix(count, r)]
    given = [matrix(1, k), matrix(lines, k), *stack, vector(size), vector(r), vector(r), vector(3)]
    return MatrixOperation(sample_stack, given, [matrix(1, k), *stack, vector(1)], k)


def _kept(m: Interpreter, stack: Any, sample: Any, count: int, width: int, flag: Any) -> Any:
    """Stack with the oldest sample replaced, if the flag is above 0."""
    kept = m.scratch(count, width)
    for j in m.columns(0, width):
        kept[0, j] = m.where_less(0.0, flag.value, sample[j], stack[0, j])
    for q in m.range(1, count):
        for j in m.columns(0, width):
            kept[q, j] = m.where_less(0.0, flag.value, stack[q - 1, j], stack[q, j])
    return kept
