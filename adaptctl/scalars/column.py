"""Columns of n scalars."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import checked, numbers
from adaptctl.errors import InputError, printable
from adaptctl.scalars.scalar import Scalar


class Vec:
    """
    Vector (3,) of scalars, such as a position or force in one frame.

    Parameters
    ----------
    x, y, z : float, array, Dual or symbolic scalar
        Coordinates along the frame's axes, in one unit. ``+`` and ``-`` are elementwise, and a scalar may be a factor
        on the left.

    Examples
    --------
    >>> from adaptctl.scalars import Vec
    >>> (2.0 * Vec(1.0, 2.0, 3.0)).z
    6.0
    """

    __slots__ = ("x", "y", "z")
    __array_ufunc__ = None  # lets `array * Vec` reach __rmul__

    def __init__(self, x: Scalar, y: Scalar, z: Scalar) -> None:
        self.x, self.y, self.z = x, y, z

    def __add__(self, other: Vec) -> Vec:
        if other is ZERO:
            return self
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
    """
    Compute the inner product of two vectors.

    Parameters
    ----------
    a, b : Vec
        Vectors (3,) of scalars of one kind.

    Returns
    -------
    float, array, Dual or symbolic scalar
        Inner product, in the product of their units.

    Examples
    --------
    >>> from adaptctl.scalars import Vec, dot
    >>> dot(Vec(1.0, 2.0, 3.0), Vec(0.0, 1.0, 1.0))
    5.0
    """
    if b is ZERO:
        return 0.0
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Vec, b: Vec) -> Vec:
    """
    Compute the vector product of two vectors.

    Parameters
    ----------
    a, b : Vec
        Vectors (3,) of scalars of one kind.

    Returns
    -------
    Vec
        Product a x b (3,), in the product of their units.

    Examples
    --------
    >>> from adaptctl.scalars import Vec, cross
    >>> cross(Vec(1.0, 0.0, 0.0), Vec(0.0, 1.0, 0.0)).z
    1.0
    """
    if b is ZERO:
        return ZERO
    return Vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


class Mat:
    """
    Matrix (3, 3) of scalars, such as a rotation or inertia tensor, given by its rows.

    Parameters
    ----------
    x, y, z : Vec
        Rows. ``+`` and ``-`` are elementwise; ``@`` multiplies with a `Vec` or a `Mat`.

    Examples
    --------
    >>> from adaptctl.scalars import Mat, Vec
    >>> (Mat.of(2.0 * np.eye(3)) @ Vec(1.0, 2.0, 3.0)).z
    6.0
    """

    __slots__ = ("x", "y", "z")

    def __init__(self, x: Vec, y: Vec, z: Vec) -> None:
        self.x, self.y, self.z = x, y, z

    @classmethod
    def of(cls, rows: ArrayLike) -> Mat:
        """
        Make a matrix of floats from numbers.

        Parameters
        ----------
        rows : array_like
            Three rows of three numbers, (3, 3), in any unit.

        Returns
        -------
        Mat
            Matrix (3, 3).

        Raises
        ------
        InputError
            If the shape is wrong or an entry is not a number.
        NonFiniteError
            If an entry is NaN or infinite.

        Examples
        --------
        >>> from adaptctl.scalars import Mat
        >>> Mat.of([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).T.x.y
        1.0
        """
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
        """Transpose (3, 3)."""
        a, b, c = self.x, self.y, self.z
        return Mat(Vec(a.x, b.x, c.x), Vec(a.y, b.y, c.y), Vec(a.z, b.z, c.z))


def product(a: Mat, b: Mat) -> Mat:
    """
    Compute the product of two matrices.

    Parameters
    ----------
    a, b : Mat
        Matrices (3, 3) of scalars of one kind, `a` on the left.

    Returns
    -------
    Mat
        Product (3, 3), in the product of their units.

    Examples
    --------
    >>> from adaptctl.scalars import Mat, product
    >>> half = Mat.of(0.5 * np.eye(3))
    >>> product(half, half).x.x
    0.25
    """
    columns = b.T
    return Mat(*(columns @ row for row in a))


ZERO = Vec(0.0, 0.0, 0.0)


class Column:
    """
    Vector (n,) of scalars of one kind, in which equations are written.

    Parameters
    ----------
    of : iterable of scalars
        Entries: floats, arrays of samples, dual numbers or symbolic scalars, kept as a tuple.

    Notes
    -----
    ``+``, ``-`` and ``*`` are elementwise, ``@`` is the inner product, and a scalar may be a factor on either side.
    Different lengths raise ``ValueError``.

    Examples
    --------
    >>> from adaptctl.scalars import Column
    >>> x = Column([1.0, 2.0])
    >>> (2.0 * x) @ x
    10.0
    >>> x[1], len(x)
    (2.0, 2)
    """

    __slots__ = ("of",)
    __array_ufunc__ = None

    def __init__(self, of: Iterable[Any]) -> None:
        self.of = tuple(of)

    @classmethod
    def zeros(cls, n: int) -> Column:
        """
        Make a column of zeros.

        Parameters
        ----------
        n : int
            Number of entries; 0 or less gives an empty column.

        Returns
        -------
        Column
            Column (n,) of floats.

        Examples
        --------
        >>> from adaptctl.scalars import Column
        >>> list(Column.zeros(2))
        [0.0, 0.0]
        """
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
    """Linear combination of m `columns` (n,)."""
    total = weights[0] * columns[0]
    for weight, one in zip(weights.of[1:], columns[1:], strict=True):
        total = total + weight * one
    return total


def column(array: Any) -> Column:
    """
    Make a column whose entries are along an array's last axis.

    Parameters
    ----------
    array : array_like or Column
        Array (..., n) in any unit, whose leading axes are samples. A column is returned as it is.

    Returns
    -------
    Column
        Entries (n,): floats for an array (n,), else arrays of samples (...).

    Raises
    ------
    InputError
        If there is no axis or an entry is not a number.

    Examples
    --------
    >>> from adaptctl.scalars import column
    >>> column(np.zeros((5, 2)))[0].shape
    (5,)
    """
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
    """
    Make a column of n entries from one value or n values.

    Parameters
    ----------
    values : scalar, array_like or Column
        One scalar () for all entries, or n numbers (n,), in any unit. A column is returned as it is, not checked.
    n : int
        Length of the column.

    Returns
    -------
    Column
        Column (n,).

    Raises
    ------
    InputError
        If numbers are of another shape or not real, or a value is neither number nor scalar.

    Examples
    --------
    >>> from adaptctl.scalars import each
    >>> list(each(0.5, 2))
    [0.5, 0.5]
    """
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
    """
    Place values at some indices of a column of zeros.

    Parameters
    ----------
    values : Column
        Values (m,).
    columns : sequence of int
        Indices (m,) from 0, each once.
    size : int
        Length of the result.

    Returns
    -------
    Column
        Column (size,) with zeros elsewhere, which cost nothing in compiled equations.

    Raises
    ------
    InputError
        If there are not as many indices as values, or one is repeated or out of range.

    Examples
    --------
    >>> from adaptctl.scalars import Column, spread
    >>> list(spread(Column([5.0]), [1], 3))
    [0.0, 5.0, 0.0]
    """
    if not len({*columns}) == len(columns) == len(values) or not all(0 <= i < size for i in columns):
        raise InputError(
            f"spread: expected {len(values)} different indices from 0 to {size - 1}, got {list(map(int, columns))}"
        )
    entries: list[Any] = [0.0] * size
    for column, value in zip(columns, values, strict=True):
        entries[column] = value
    return Column(entries)
