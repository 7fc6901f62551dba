"""A reference read ahead, in blocks, so that a control step costs no evaluation."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array, checked
from adaptctl.control.controller import Reference
from adaptctl.errors import InputError

BLOCK = 1024
"""Control periods evaluated at once."""


class Preview:
    """Rows of a reference of r joints at every control period (s): p, v, a now and p at each time ahead (s).

    Raises what `sampled` raises.
    """

    def __init__(self, reference: Reference, dof: int, control_period: float, look_ahead: Array) -> None:
        self.reference, self._dof = reference, dof
        self._period, self._look_ahead = control_period, look_ahead
        self._first, self._rows = 0, self._block(0)

    def row(self, step: int) -> Array:
        """The row (3r + r per time ahead,) at a control period."""
        if not self._first <= step < self._first + BLOCK:
            self._first, self._rows = step, self._block(step)
        return self._rows[step - self._first]

    def _block(self, first: int) -> Array:
        times = self._period * np.arange(first, first + BLOCK, dtype=np.float64)
        return sampled(self.reference, times, self._dof, self._look_ahead)


def sampled(reference: Reference, times: Array, dof: int, look_ahead: Array) -> Array:
    """p, v, a at times (T,) and p at each time ahead of them, in rows (T, 3r + r per time ahead).

    Raises `InputError` when the reference is not of r joints or does not take many times at once, and
    `NonFiniteError` where it is not finite.
    """
    now = reference(times)
    parts = [(getattr(now, name), name) for name in ("p", "v", "a")]
    parts += [(reference(times + delay).p, "p") for delay in look_ahead]
    return np.concatenate([_checked(values, name, len(times), dof) for values, name in parts], axis=1)


def _checked(values: Array, name: str, count: int, dof: int) -> Array:
    array = checked(values, dof, f"reference: {name}")
    if array.shape != (count, dof):
        raise InputError(
            f"reference: {name}: expected times of shape (n,) to give shape (n, {dof}), "
            f"got {array.shape} for n = {count}"
        )
    return array
