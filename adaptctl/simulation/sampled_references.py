"""References at given times: samples, checked, and rows of them ahead of an arm that follows one."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, checked
from adaptctl.compilation import Kernel, compile_function
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.control.reference_check import require_point
from adaptctl.control.references import SinusoidNumbers, Sinusoids, sinusoids_at
from adaptctl.errors import InputError
from adaptctl.scalars import Column

REFERENCE = ("reference_p", "reference_v", "reference_a")
"""Names of a reference point's parts as columns."""
BLOCK = 1024
"""Control periods evaluated at once."""


def sampled(reference: Reference, times: Array, size: int) -> ReferencePoint:
    """The points (T, size) of a reference at times (T,), s.

    Raises `InputError` where they are not of that shape, `NonFiniteError` where they are not finite.
    """
    point = _sinusoids(reference, times) if isinstance(reference, Sinusoids) else reference(times)
    require_point(point)
    return ReferencePoint(*(_checked(point, name, len(times), size) for name in ReferencePoint._fields))


class Preview:
    """Preview of a reference of r joints, rows at every control period (s): p, v, a now and p at each time ahead (s).

    They are evaluated in blocks, so that a control step costs no evaluation. Raises what `sampled` raises.
    """

    def __init__(
        self, reference: Reference, dof: int, control_period: float, look_ahead: Array, block: int = BLOCK
    ) -> None:
        self.reference, self._dof = reference, dof
        self._period, self._look_ahead, self._size = control_period, look_ahead, block
        self._blocks: dict[int, Array] = {}
        self._keep([0])

    def row(self, step: int) -> Array:
        """The row (3r + r per time ahead,) at a control period."""
        block, place = divmod(step, self._size)
        if block not in self._blocks:
            self._keep([block])
        row: Array = self._blocks[block][place]
        return row

    def rows(self, steps: NDArray[np.int64]) -> Array:
        """The rows (k, ...) at control periods (k,)."""
        needed, which = np.unique(steps // self._size, return_inverse=True)
        self._keep(needed.tolist())
        rows: Array = np.stack(list(self._blocks.values()))[which, steps % self._size]
        return rows

    def _keep(self, blocks: list[int]) -> None:
        """Have these blocks, in this order, and no others."""
        self._blocks = {k: self._blocks[k] if k in self._blocks else self._block(k) for k in blocks}

    def _block(self, block: int) -> Array:
        times = self._period * np.arange(block * self._size, (block + 1) * self._size, dtype=np.float64)
        ahead = [sampled(self.reference, times + t, self._dof).p for t in self._look_ahead]
        return np.concatenate((*sampled(self.reference, times, self._dof), *ahead), axis=1)


def _sinusoids(reference: Sinusoids, times: Array) -> ReferencePoint:
    """Sinusoids at times (T,), s, in native code."""
    numbers = reference.numbers
    points: Array = _compiled(*map(len, numbers)).map(times[:, None], *numbers)
    return ReferencePoint(*points.swapaxes(0, 1))


@lru_cache(maxsize=16)
def _compiled(*sizes: int) -> Kernel:
    """Native code for sinusoids of so many numbers."""

    def point(time: Column, **numbers: Column) -> list[Column]:
        return list(sinusoids_at(time[0], SinusoidNumbers(**numbers)))

    lengths = dict(zip(SinusoidNumbers._fields, sizes, strict=True))
    return compile_function(point, {"time": 1, **lengths}, name="sinusoids")


def _checked(point: ReferencePoint, name: str, count: int, size: int) -> Array:
    array = checked(getattr(point, name), size, f"reference: {name}")
    if array.shape != (count, size):
        raise InputError(
            f"reference: {name}: expected times of shape (n,) to give shape (n, {size}), "
            f"got {array.shape} for n = {count}"
        )
    return array
