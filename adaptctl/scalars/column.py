"""Joint space and parameter space: columns of n scalars."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import checked, numbers
from adaptctl.errors import InputError, printable
from adaptctl.scalars.scalar import Scalar


class Vec:
    """A vector (3,) of scalars `x`, `y` and `z` of one kind (floats, arrays of samples, dual numbers or nodes of an
    expression graph), in the coordinates of one frame. `+` and `-` are elementwise, and a scalar may be a factor on the
    left. Nothing is checked at construction."""

    __slots__ = ("x", "y", "z")
    __array_ufunc__ = None  # lets `array * Vec` reach __rmul__

    def __init__(self, x: Scalar, y: Scalar, z: Scalar) -> None:
        self.x, self.y, self.z = x, y, z

    def __add__(self, other: Vec) -> Vec:
        return Vec(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Vec) -> Vec:
        return Vec(self.x - other.x, self.y - other.y, self.z - other.z)

    def __neg__(self) -> Vec:
        return Vec(-self.x, -self.y, -self.z)

    def __rmul__(self, factor: Scalar) -> Vec:
        return Vec(factor * self.x, factor * self.y, factor * self.z)

    def __iter__(self) -> Iterator[Any]:
        return iter((self.x, self.y, self.z))


def dot(a: Vec, b: Vec) -> Any:
    """The inner (dot) product of two vectors a and b (3,) whose entries are scalars of one kind: a scalar of that kind,
    in the product of their units. Nothing is checked."""
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Vec, b: Vec) -> Vec:
    """The vector (cross) product a x b (3,) of two vectors (3,) whose entries are scalars of one kind, in the product
    of their units. Nothing is checked."""
    return Vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


class Mat:
    """A 3 by 3 matrix of scalars of one kind (floats, arrays of samples, dual numbers or nodes of an expression graph),
    given by its rows `x`, `y` and `z`, each a `Vec` (3,). `+` and `-` are elementwise, and `@` multiplies it with a
    `Vec`, which gives a `Vec`, or with a `Mat`, which gives a `Mat`. Nothing is checked at construction."""

    __slots__ = ("x", "y", "z")

    def __init__(self, x: Vec, y: Vec, z: Vec) -> None:
        self.x, self.y, self.z = x, y, z

    @classmethod
    def of(cls, rows: ArrayLike) -> Mat:
        """A matrix (3, 3) of floats from three rows of three numbers, nested sequences or an array (3, 3). Raises
        `InputError` for another shape and for entries that are no numbers, `NonFiniteError` for NaN and infinity."""
        entries = checked(rows, 3, "matrix")
        if entries.shape != (3, 3):
            raise InputError(f"matrix: expected shape (3, 3), got {entries.shape}")
        return cls(*(Vec(*row) for row in entries.tolist()))

    def __add__(self, other: Mat) -> Mat:
        return Mat(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Mat) -> Mat:
        return Mat(self.x - other.x, self.y - other.y, self.z - other.z)

    def __iter__(self) -> Iterator[Vec]:
        return iter((self.x, self.y, self.z))

    @overload
    def __matmul__(self, other: Vec) -> Vec: ...
    @overload
    def __matmul__(self, other: Mat) -> Mat: ...
    def __matmul__(self, other: Vec | Mat) -> Vec | Mat:
        if isinstance(other, Mat):
            return product(self, other)
        return Vec(dot(self.x, other), dot(self.y, other), dot(self.z, other))

    @property
    def T(self) -> Mat:
        """The transpose (3, 3) of this matrix, rows and columns exchanged."""
        a, b, c = self.x, self.y, self.z
        return Mat(Vec(a.x, b.x, c.x), Vec(a.y, b.y, c.y), Vec(a.z, b.z, c.z))


def product(a: Mat, b: Mat) -> Mat:
    """The matrix product a b (3, 3) of two matrices (3, 3), `a` on the left, whose entries are scalars of one kind, in
    the product of their units. Nothing is checked."""
    columns = b.T
    return Mat(*(columns @ row for row in a))


ZERO = Vec(0.0, 0.0, 0.0)


class Column:
    """A column (n,) of n scalars of one kind: floats, arrays of samples, dual numbers or nodes of an expression graph.
    `of`, any iterable of them, is kept as a tuple. `+`, `-` and `*` of two columns are elementwise, a scalar may be a
    factor on either side, and `@` is the inner product, a scalar; columns of different lengths raise `ValueError`.
    `column[i]` is entry i, from 0; `len` and iteration are those of a tuple. Nothing is checked at construction."""

    __slots__ = ("of",)
    __array_ufunc__ = None

    def __init__(self, of: Iterable[Any]) -> None:
        self.of = tuple(of)

    @classmethod
    def zeros(cls, n: int) -> Column:
        """Column (n,) of n zeros, as floats; empty for `n` of 0 or less. Nothing is checked."""
        return cls((0.0,) * n)

    def __add__(self, other: Column) -> Column:
        return Column(a + b for a, b in zip(self.of, other.of, strict=True))

    def __sub__(self, other: Column) -> Column:
        return Column(a - b for a, b in zip(self.of, other.of, strict=True))

    def __mul__(self, other: Column | Scalar) -> Column:
        if not isinstance(other, Column):
            return other * self
        return Column(a * b for a, b in zip(self.of, other.of, strict=True))

    def __rmul__(self, factor: Scalar) -> Column:
        return Column(factor * a for a in self.of)

    def __neg__(self) -> Column:
        return Column(-a for a in self.of)

    def __matmul__(self, other: Column) -> Any:
        products = [a * b for a, b in zip(self.of, other.of, strict=True)]
        parts = [sum(products[k + 4 :: 4], products[k]) for k in range(min(4, len(products)))]
        return sum(parts[1:], parts[0]) if parts else 0.0  # four sums at once: one would wait for itself

    def __getitem__(self, i: int) -> Any:
        return self.of[i]

    def __iter__(self) -> Iterator[Any]:
        return iter(self.of)

    def __len__(self) -> int:
        return len(self.of)


def combined(columns: Sequence[Column], weights: Column) -> Column:
    """The linear combination of m `columns` (n,): the column (n,) of n scalars that is the sum of each column times its
    entry of `weights`, a column (m,). Raises `IndexError` for no columns or no weights, and `ValueError` for different
    numbers of them or columns of different lengths."""
    total = weights[0] * columns[0]
    for weight, one in zip(weights.of[1:], columns[1:], strict=True):
        total = total + weight * one
    return total


def column(array: Any) -> Column:
    """A column of the n entries (n,) along the last axis of an `array` (..., n), or of nested lists or tuples of
    numbers. Entries are floats for one sample (n,), arrays of samples (...) otherwise. A column is returned as it is.
    Raises `InputError` for one number, which has no axis, and for entries that are no numbers."""
    if isinstance(array, Column):
        return array
    if not isinstance(array, np.ndarray):
        array = numbers(array, "column", "of shape (..., n)")
    if array.ndim == 0:
        raise InputError(f"column: expected shape (..., n), got the number {array}")
    if array.ndim == 1:
        return Column(array.tolist())
    return Column(array[..., i] for i in range(array.shape[-1]))


def each(values: Any, n: int) -> Column:
    """A column (n,) of n entries made of `values`. One scalar of any kind (float, dual number, node of an expression
    graph) is every entry; numbers (n,), (1,) or (), an array, list or tuple, become floats, texts in a list that read
    as numbers too; a column is returned as it is, not checked. Raises `InputError` for numbers of another shape,
    entries that are not real numbers, and anything else that is no scalar, such as a text, a boolean or a complex
    number."""
    if isinstance(values, Column):
        return values
    said = f"each: expected a number or {n} of them"
    if isinstance(values, np.ndarray | list | tuple):
        array = numbers(values, "each", f"of shape ({n},)")
        if array.shape not in ((), (1,), (n,)):
            raise InputError(f"{said}, got shape {array.shape}")
        return column(np.broadcast_to(array, (n,)))
    if isinstance(values, bool | np.bool_ | complex) or not hasattr(values, "__neg__"):
        raise InputError(f"{said}, got {printable(repr(values))}")
    return Column((values,) * n)


def spread(values: Column, columns: Sequence[int], size: int) -> Column:
    """Column (size,) with the m `values` at the m indices `columns`, counted from 0, and exact zeros elsewhere, which
    compiled equations leave out of their arithmetic. Raises `InputError` for another number of indices than values, for
    an index given twice and for one outside 0..size-1."""
    if not len({*columns}) == len(columns) == len(values) or not all(0 <= i < size for i in columns):
        raise InputError(
            f"spread: expected {len(values)} different indices from 0 to {size - 1}, got {list(map(int, columns))}"
        )
    entries: list[Any] = [0.0] * size
    for column, value in zip(columns, values, strict=True):
        entries[column] = value
    return Column(entries)
