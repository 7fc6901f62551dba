"""Columns of n scalars."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from adaptctl.arrays import numbers
from adaptctl.errors import InputError, printable
from adaptctl.scalars.scalar import Scalar


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
