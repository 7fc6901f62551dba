"""Regressors of long mechanisms on arrays, computed row by row: a row has the powers, per unit of each parameter, at
unit velocity of one joint.

The operations of the whole matrix grow with the pairs of a joint and a link that it moves, in a chain with the square
of its length, so that LLVM takes many seconds to compile it. Those of a row grow with the links alone: it is compiled
in a second or two, and is evaluated for several joints at once in SIMD registers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, writable
from adaptctl.dynamics.array_equation import ArrayEquation

STATES = 64
"""Number of states whose rows are computed at once."""


class RowByRow:
    """Regressor (r, k) of a mechanism of r primary (independent) joints, evaluated on NumPy arrays row by row, by
    native code of a single row, which compiles where that of the whole matrix would take too long. `call` and `into`
    are those of an `ArrayEquation`.

    Made of `whole`, the `ArrayEquation` of the matrix, which is used for several states at once until the row's native
    code is compiled; `powers`, the `ArrayEquation` of the powers (P,) of all P parameters at positions, velocities,
    reference velocities and accelerations and joint rates, (r,) each; `rows`, the number r; and `columns`, the
    zero-based indices of the k parameters, None, the default, for all P. Construction checks nothing. `call` and `into`
    raise `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity in arguments or results, `SingularityError`
    near a singularity of kinematic loops, and `ValueError` for another number of arguments.
    """

    def __init__(
        self, whole: ArrayEquation, powers: ArrayEquation, rows: int, columns: Sequence[int] | None = None
    ) -> None:
        self._whole, self._powers, self._rows = whole, powers, rows
        self._columns = None if columns is None else list(columns)

    def call(self, *arguments: ArrayLike) -> Array:
        """The regressors (..., r, k) at `arguments` (..., r) in SI units, those of `whole`, whose leading axes are
        samples and broadcast. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity,
        `SingularityError` near a singularity of kinematic loops, `ValueError` for another number of arguments."""
        arrays, samples = self._whole.arrays_of(*arguments)
        count = math.prod(samples)
        if not count or (not self._powers.is_native(count * self._rows) and count != 1):
            return self._whole.call(*arguments)
        if not samples:
            return self._rows_at(*arrays)
        given = [np.broadcast_to(x, (*samples, x.shape[-1])).reshape(count, x.shape[-1]) for x in arrays]
        first = self._rows_at(*(x[:STATES] for x in given))
        found = np.empty((count * self._rows, first.shape[1]))
        found[: len(first)] = first
        for k in range(STATES, count, STATES):
            found[k * self._rows : (k + STATES) * self._rows] = self._rows_at(*(x[k : k + STATES] for x in given))
        return found.reshape(*samples, self._rows, first.shape[1])

    def _rows_at(self, *states: Array) -> Array:
        """The rows at one state (size,) or at several (c, size), one state's after another's."""
        units = unit_rows(self._rows)
        if states[0].ndim > 1:
            units = np.tile(units, (len(states[0]), 1))
            states = tuple(np.repeat(x, self._rows, axis=0) for x in states)
        p, v, *reference = states
        rows = self._powers.on_rows(p, v, *(reference if len(reference) == 2 else (v, *reference)), units)
        return rows if self._columns is None else rows[:, self._columns]

    def into(self, out: Array, *arguments: ArrayLike) -> Array:
        """The array `out`, float64 of the result's shape, filled with the matrices that `call` returns for the
        `arguments`. Raises `InputError` for an `out` of another type or shape or that is read-only, and what `call`
        raises."""
        found = self.call(*arguments)
        writable(out, found.shape, self._whole.name)[...] = found
        return out


@lru_cache(maxsize=4)
def unit_rows(n: int) -> Array:
    """Identity matrix (n, n) of floats, read-only: a view of 2n - 1 numbers, of which each row is another part. `n` is
    a whole number of at least 1, not checked."""
    numbers = np.zeros(2 * n - 1)
    numbers[n - 1] = 1.0
    return np.lib.stride_tricks.sliding_window_view(numbers, n)[::-1]
