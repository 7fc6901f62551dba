"""Rows of torques whose noise lasts, made white."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.filtered_dynamics import ROWS_PER_PERIOD, Rows

# Noise that fades as exp(-t/T) is white in a row less that share of the row before it, whatever is between them.


class _Before(NamedTuple):
    """Last row (k,) of a joint, the number of its log, and its time in s."""

    log: int
    time: float
    row: Array


@dataclass
class Whitening:
    """Rows at a cut-off (Hz), one after the other, less what they share with those before; times (r,) of noise in s."""

    times: Sequence[float]
    cutoff: float
    _before: dict[int, _Before] = field(default_factory=dict)

    def whiten(self, j: int, rows: Rows, here: NDArray[np.int64], parts: Sequence[Array]) -> None:
        """Make parts (n, k) of a joint's rows white in place, those `here`."""
        if self.times[j] == 0.0 or not len(here):
            return
        joined = np.concatenate([part[here] for part in parts], axis=1)
        found = self._innovations(j, rows.log[here], rows.time[here], joined)
        ends = np.cumsum([part.shape[1] for part in parts])[:-1]
        for part, own in zip(parts, np.split(found, ends, axis=1), strict=True):
            part[here] = own

    def _innovations(self, j: int, log: NDArray[np.int64], time: Array, rows: Array) -> Array:
        first = self._before.get(j, _Before(-1, 0.0, np.zeros(rows.shape[1])))
        self._before[j] = _Before(int(log[-1]), float(time[-1]), rows[-1])
        same = np.diff(log, prepend=first.log) == 0
        share = np.exp(-np.where(same, np.diff(time, prepend=first.time), np.inf) / self.times[j])
        usual = np.exp(-1.0 / (ROWS_PER_PERIOD * self.cutoff * self.times[j]))
        scale = np.sqrt((1.0 - usual**2) / (1.0 - share**2))
        before = np.concatenate([first.row[None], rows[:-1]])
        return np.asarray((rows - share[:, None] * before) * scale[:, None])


def innovations(rows: Rows, used: NDArray[np.bool_], times: Sequence[float]) -> Rows:
    """Rows made white where a mask (n, r) has them, for noise that lasts some times (r,) in s; as they are for none."""
    if not times:
        return rows
    regressor, torque, change = (part.copy() for part in (rows.regressor, rows.torque, rows.change))
    whitening = Whitening(times, rows.cutoff)
    for j in range(used.shape[1]):
        parts = (regressor[:, j], torque[:, j : j + 1], change[:, j : j + 1])
        whitening.whiten(j, rows, np.flatnonzero(used[:, j]), parts)
    return replace(rows, regressor=regressor, torque=torque, change=change)
