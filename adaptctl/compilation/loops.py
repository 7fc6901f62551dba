"""A small language of loops over arrays, in which an operation on matrices is written once."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from adaptctl.scalars import where

PARTS = 8
"""Partial sums of a `sum`: column j belongs to part j modulo 8."""


@dataclass(frozen=True)
class Index:
    """Whole number that is affine in the counters of loops."""

    factors: tuple[tuple[int, int], ...]
    constant: int = 0

    def __add__(self, other: Position) -> Index:
        if isinstance(other, int):
            return Index(self.factors, self.constant + other)
        factors = dict(self.factors)
        for counter, factor in other.factors:
            factors[counter] = factors.get(counter, 0) + factor
        return Index(tuple(factors.items()), self.constant + other.constant)

    __radd__ = __add__

    def __mul__(self, number: int) -> Index:
        return Index(tuple((counter, number * factor) for counter, factor in self.factors), number * self.constant)

    __rmul__ = __mul__

    def __neg__(self) -> Index:
        return -1 * self

    def __sub__(self, other: Position) -> Index:
        return self + -other

    def __rsub__(self, other: Position) -> Index:
        return -self + other


Position: TypeAlias = int | Index
"""Where an entry is: a whole number, or one that depends on loops."""


@dataclass(frozen=True)
class Matrix:
    """Shape of a matrix whose rows follow each other, `pitch` numbers apart."""

    rows: int
    columns: int
    pitch: int

    @property
    def size(self) -> int:
        """Numbers in memory."""
        return self.rows * self.pitch

    def row(self, i: int) -> int:
        """Place of row i's column 0."""
        return i * self.pitch


@dataclass(frozen=True)
class Triangle:
    """Shape of the upper triangle of a symmetric matrix (k, k), row by row."""

    k: int

    @property
    def size(self) -> int:
        """Numbers in memory."""
        return self.k * (self.k + 1) // 2

    def row(self, i: int) -> int:
        """Place of row i's column 0, as if it were there."""
        return i * (2 * self.k - 1 - i) // 2


Shape: TypeAlias = Matrix | Triangle


def vector(n: int) -> Matrix:
    """Shape of n numbers."""
    return Matrix(1, n, n)


def matrix(rows: int, columns: int) -> Matrix:
    """Shape of a matrix without gaps."""
    return Matrix(rows, columns, columns)


def place(key: Any) -> tuple[Any, Any]:
    """Row and column of an array's key, which is one number for a vector."""
    return key if isinstance(key, tuple) else (0, key)


class Variable(Protocol):
    """Number that loops replace."""

    value: Any


class Sum(Protocol):
    """Sum over columns, in `PARTS` parts that are added last: ((0+4)+(2+6))+((1+5)+(3+7))."""

    def add(self, column: Any, term: Any) -> None:
        """Add the term of a column, or of some."""

    @property
    def value(self) -> Any:
        """Sum of all terms."""


class Interpreter(Protocol):
    """
    Runner or recorder of an operation.

    An operation is a function of a machine and of arrays, which reads and assigns their entries by row and column. It
    steers by nothing but `range` and `columns`, computes with ``+ - * /`` and `where_less`, and assigns all results.
    """

    def range(self, start: Any, stop: Any = None) -> Iterable[Any]:
        """Positions, one after the other."""

    def columns(self, start: Any, stop: Any) -> Iterable[Any]:
        """
        Columns that do not depend on each other: one after the other, some at once, or all.

        Where only scratch arrays are read and written by these columns, what is assigned beside them, from the multiple
        of `PARTS` before to the one after, is any number; what a sum reads there must count zero.
        """

    def scratch(self, rows: int, columns: int = 0) -> Any:
        """New array of zeros, (rows,) or (rows, columns)."""

    def variable(self, value: Any) -> Variable:
        """New variable."""

    def sum(self) -> Sum:
        """New sum over columns."""

    def where_less(self, x: Any, y: Any, yes: Any, no: Any) -> Any:
        """`yes` where x < y, else `no`."""


@dataclass
class MutableValue:
    """Variable that is a Python value."""

    value: Any


@dataclass
class Entries:
    """Array of scalars of any kind."""

    of: list[Any]
    shape: Shape

    def __getitem__(self, key: Any) -> Any:
        row, column = place(key)
        return self.of[self.shape.row(row) + column]

    def __setitem__(self, key: Any, value: Any) -> None:
        row, column = place(key)
        self.of[self.shape.row(row) + column] = value


class EntrySum:
    """Sum of scalars of any kind."""

    def __init__(self) -> None:
        self._parts: list[Any] = [0.0] * PARTS

    def add(self, column: int, term: Any) -> None:
        """Add the term of a column."""
        self._parts[column % PARTS] = self._parts[column % PARTS] + term

    @property
    def value(self) -> Any:
        """Sum of all terms."""
        return sum_of_halves(self._parts)


def sum_of_halves(parts: Sequence[Any], add: Callable[[Any, Any], Any] = operator.add) -> Any:
    """Sum of the parts of a sum, a power of two: each half is added to the other until one is left."""
    while len(parts) > 1:
        half = len(parts) // 2
        parts = list(map(add, parts[:half], parts[half:]))
    return parts[0]


class Evaluator:
    """Common part of the interpreters that compute at once."""

    def range(self, start: int, stop: int | None = None) -> Iterable[int]:
        """Numbers, one after the other."""
        return range(start) if stop is None else range(start, stop)

    def variable(self, value: Any) -> MutableValue:
        """New variable."""
        return MutableValue(value)

    def where_less(self, x: Any, y: Any, yes: Any, no: Any) -> Any:
        """`yes` where x < y, else `no`."""
        return where(x < y, yes, no)


class Unrolled(Evaluator):
    """Interpreter that computes with scalars of any kind: traced, the operation is straight-line code."""

    columns = Evaluator.range

    def sum(self) -> EntrySum:
        """New sum over columns."""
        return EntrySum()

    def scratch(self, rows: int, columns: int = 0) -> Entries:
        """New array of zeros."""
        shape = matrix(rows, columns) if columns else vector(rows)
        return Entries([0.0] * shape.size, shape)


Samples: TypeAlias = NDArray[np.float64]


@dataclass
class SampleArray:
    """Array (..., size) of samples along the leading axes."""

    of: Samples
    shape: Shape

    def __getitem__(self, key: Any) -> Samples:
        return self.of[..., self._slice(key)].copy()

    def __setitem__(self, key: Any, value: Any) -> None:
        self.of[..., self._slice(key)] = value

    def _slice(self, key: Any) -> slice:
        row, column = place(key)
        start = self.shape.row(row)
        if isinstance(column, slice):
            return slice(start + column.start, start + column.stop)
        return slice(start + column, start + column + 1)


class SampleSum:
    """Sum over samples' columns."""

    def __init__(self, axes: tuple[int, ...]) -> None:
        self._parts = np.zeros((*axes, PARTS))

    def add(self, column: slice, term: Samples) -> None:
        """Add the terms of columns, in order."""
        for first in range(column.start - column.start % PARTS, column.stop, PARTS):
            start, stop = max(first, column.start), min(first + PARTS, column.stop)
            self._parts[..., start - first : stop - first] += term[..., start - column.start : stop - column.start]

    @property
    def value(self) -> Samples:
        """Sum of all terms (..., 1)."""
        total: Samples = sum_of_halves([self._parts[..., k : k + 1] for k in range(PARTS)])
        return total


class Sampled(Evaluator):
    """Interpreter that computes with NumPy arrays, all columns and all samples at once."""

    def __init__(self, axes: tuple[int, ...]) -> None:
        self._axes = axes

    def columns(self, start: int, stop: int) -> Iterator[slice]:
        """All columns, where there are any."""
        if start < stop:
            yield slice(start, stop)

    def scratch(self, rows: int, columns: int = 0) -> SampleArray:
        """New array of zeros."""
        shape = matrix(rows, columns) if columns else vector(rows)
        return SampleArray(np.zeros((*self._axes, shape.size)), shape)

    def sum(self) -> SampleSum:
        """New sum over columns."""
        return SampleSum(self._axes)
