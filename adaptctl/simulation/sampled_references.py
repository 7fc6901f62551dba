"""References at given times: samples, checked, and rows of them ahead of an arm that follows one."""

from __future__ import annotations

from contextlib import suppress
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, checked
from adaptctl.compilation import Kernel, compile_function
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.control.reference_check import require_point
from adaptctl.control.references import SinusoidNumbers, Sinusoids, sinusoids_at
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column

REFERENCE = ("reference_p", "reference_v", "reference_a")
"""Names of a reference point's parts as columns."""
BLOCK = 128
"""Control periods evaluated at once."""


def sampled(reference: Reference, times: Array, size: int, out: Array | None = None) -> ReferencePoint:
    """The points of a `reference` of `size` coordinates (joints) at `times` (T,), s, a `ReferencePoint`: positions,
    velocities and accelerations, (T, size) each, in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic). They are
    views of one array (T, 3, size): `out`, which is overwritten, or a new one where `out` is None. The shape of `out`
    is not checked.

    Raises `InputError` where the reference returns no reference point or one of another shape, `NonFiniteError` for NaN
    or infinity in it; what the reference itself raises goes through.
    """
    points = np.empty((len(times), 3, size)) if out is None else out
    parts = ReferencePoint(*points.swapaxes(0, 1))
    if isinstance(reference, Sinusoids) and len(reference.center) == size:
        with suppress(NonFiniteError):  # which is raised below, where it is known of what
            _put_sinusoids(points, reference, times)
            return parts
    point = reference(times)
    require_point(point)
    for name, part in parts._asdict().items():
        part[...] = _checked(point, name, len(times), size)
    return parts


class Preview:
    """Preview of a `reference` of r = `dof` joints: a row of numbers for each `control_period` (s). A row has
    positions, rad (m if prismatic), velocities, rad/s (m/s), and accelerations, rad/s^2 (m/s^2), of the period's
    beginning, then positions at each of the h times `look_ahead` (h,), s, after it.

    Rows are computed for `block` periods at once, BLOCK (128) by default, so that a control step costs no evaluation of
    its own; only the blocks asked for last are kept. Raises at construction and in its methods `InputError` where the
    reference's points have another shape, `NonFiniteError` where they have NaN or infinity.
    """

    def __init__(
        self, reference: Reference, dof: int, control_period: float, look_ahead: Array, block: int = BLOCK
    ) -> None:
        self.reference, self._dof = reference, dof
        self._period, self._look_ahead, self._size = control_period, look_ahead, block
        self._blocks: dict[int, Array] = {}
        self._keep([0])

    def row(self, step: int) -> Array:
        """The row (3r + h r,) of the control period of zero-based index `step`, of r joints. It has the reference's
        positions, rad (m if prismatic), velocities, rad/s (m/s), and accelerations, rad/s^2 (m/s^2), (r,) each, at the
        period's beginning, then its positions at each of the h times after that for which the preview was made. Raises
        `InputError` where the reference's points have another shape, `NonFiniteError` where they have NaN or infinity.
        """
        block, place = divmod(step, self._size)
        if block not in self._blocks:
            self._keep([block])
        row: Array = self._blocks[block][place]
        return row

    def rows(self, steps: NDArray[np.int64]) -> Array:
        """The rows (k, 3r + h r) of the control periods of zero-based indices `steps` (k,), of r joints. Each has the
        reference's positions, rad (m if prismatic), velocities, rad/s (m/s), and accelerations, rad/s^2 (m/s^2), (r,)
        each, at the period's beginning, then its positions at each of the h times after that for which the preview was
        made. Raises `InputError` where the reference's points have another shape, `NonFiniteError` where they have NaN
        or infinity."""
        needed, which = np.unique(steps // self._size, return_inverse=True)
        self._keep(needed.tolist())
        rows: Array = np.stack(list(self._blocks.values()))[which, steps % self._size]
        return rows

    def _keep(self, blocks: list[int]) -> None:
        """Have these blocks, in this order, and no others."""
        self._blocks = {k: self._blocks[k] if k in self._blocks else self._block(k) for k in blocks}

    def _block(self, block: int) -> Array:
        times = self._period * np.arange(block * self._size, (block + 1) * self._size, dtype=np.float64)
        n, ahead = self._size, (times + t for t in self._look_ahead)
        p, v, a = sampled(self.reference, np.concatenate((times, *ahead)), self._dof)
        later = p[n:].reshape(-1, n, self._dof).swapaxes(0, 1)
        return np.concatenate((p[:n], v[:n], a[:n], later.reshape(n, -1)), axis=1)


def _put_sinusoids(points: Array, reference: Sinusoids, times: Array) -> None:
    """Put the points of sinusoids at times (T,), s, into an array (T, 3, r), in native code."""
    numbers = reference.numbers
    evaluated = _compiled(*map(len, numbers)).map
    if points.flags.c_contiguous:
        evaluated(times[:, None], *numbers, out=points)
    else:
        points[...] = evaluated(times[:, None], *numbers)


@lru_cache(maxsize=16)
def _compiled(*sizes: int) -> Kernel:
    """Native code for sinusoids of so many numbers."""

    def point(time: Column, **numbers: Column) -> list[Column]:
        return list(sinusoids_at(time[0], SinusoidNumbers(**numbers)))

    lengths = dict(zip(SinusoidNumbers._fields, sizes, strict=True))
    return compile_function(point, {"time": 1, **lengths}, name="sinusoids", finite="results")


def _checked(point: ReferencePoint, name: str, count: int, size: int) -> Array:
    array = checked(getattr(point, name), size, f"reference: {name}")
    if array.shape != (count, size):
        raise InputError(
            f"reference: {name}: expected times of shape (n,) to give shape (n, {size}), "
            f"got {array.shape} for n = {count}"
        )
    return array
