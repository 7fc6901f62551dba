"""Matrices of long mechanisms on arrays, column by column: each the torque of one parameter, or of one acceleration.

Their own equations grow with the square of the links, and take LLVM from seconds to minutes. The torque's, which grows
with the links alone, is compiled in a second or two and evaluated for several columns at once in SIMD registers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, same_samples, writable
from adaptctl.dynamics.array_equation import ArrayEquation


class ColumnByColumn:
    """Equation of a matrix (m, k) on NumPy arrays, evaluated column by column: `call` and `into` take and return what
    those of an `ArrayEquation` of the matrix do.

    Made of `whole`, the matrix's own `ArrayEquation`, which is asked for several states as long as that of a column is
    no native code; `vector`, the `ArrayEquation` of one column (m,); `arranged`, a callable that makes of the matrix's
    arguments at one state, (size,) each, those of `vector` for all k columns, (size,) or (k, size) each; and `columns`,
    k. `call` and `into` raise `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity, `ValueError` for
    another number of arguments, and what `vector` raises.
    """

    def __init__(
        self, whole: ArrayEquation, vector: ArrayEquation, arranged: Callable[..., Sequence[Array]], columns: int
    ) -> None:
        self._whole, self._vector, self._arranged, self._columns = whole, vector, arranged, columns

    def call(self, *arguments: ArrayLike) -> Array:
        """The matrices (..., m, k) at arguments (..., size), whose leading axes are samples and broadcast."""
        sizes, name = self._whole.sizes, self._whole.name
        pairs = zip(sizes.items(), arguments, strict=True)
        arrays = {what: checked(values, size, f"{name}: {what}") for (what, size), values in pairs}
        samples = same_samples(**arrays)
        count = math.prod(samples)
        if not self._vector.is_native(count * self._columns) and count != 1:
            return self._whole.call(*arguments)
        rows = [np.broadcast_to(x, (*samples, x.shape[-1])).reshape(count, x.shape[-1]) for x in arrays.values()]
        matrices = [self._vector.on_rows(*self._arranged(*state)).T for state in zip(*rows, strict=True)]
        return np.reshape(matrices, (*samples, *matrices[0].shape)) if matrices else self._whole.call(*arguments)

    def into(self, out: Array, *arguments: ArrayLike) -> Array:
        """The array `out`, float64 of the result's shape, filled with the matrices that `call` returns. Raises
        `InputError` for another `out`."""
        found = self.call(*arguments)
        writable(out, found.shape, self._whole.name)[...] = found
        return out


@lru_cache(maxsize=4)
def unit_rows(n: int) -> Array:
    """The identity (n, n), read-only, as a view of the 2n - 1 numbers of which each row has n: 1 in the middle, else
    0."""
    numbers = np.zeros(2 * n - 1)
    numbers[n - 1] = 1.0
    return np.lib.stride_tricks.sliding_window_view(numbers, n)[::-1]
