"""Equations of motion through a filter, without accelerations (Slotine and Li 1987; Pucci et al. 2013)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.energy import momentum_terms
from adaptctl.errors import InputError
from adaptctl.identification.preparation import DIFFERENCE_MARGIN, PreparedLog, derivative, filtered, low_pass, padded
from adaptctl.scalars import column

# With a kernel w of finite length, tau = d/dt (h D) - f D becomes w*tau = (w'*h - w*f) D: the derivative falls on the
# kernel. h and f are the regressors of the momenta and of the other forces, friction among them (`momentum_terms`).

# Hz, of positions and velocities before the equations, which are not linear in them.
MOTION_CUTOFF = 50.0
# Length in s of the stretches that spectra are of, and the share of the speeds' squares that the motion's band has.
SPECTRUM_LENGTH, BAND_SHARE = 8.0, 0.99
# Samples in a period of that cut-off: how densely the equations are evaluated.
OVERSAMPLING = 10.0
# Rows in a period of a row's own cut-off.
ROWS_PER_PERIOD = 4.0
# Rows that a log has at least, if it has as many samples.
MIN_ROWS = 400
# Samples evaluated at a time: enough that sums outweigh their calls.
CHUNK_SAMPLES = 6000


COLUMNS = ("time", "regressor", "torque", "change", "velocity", "log", "moving")


@dataclass(frozen=True, eq=False)
class Rows:
    """Filtered equations torque = Y x at n instants: torques (n, r), their rates, regressors (n, r, P)."""

    cutoff: float
    time: Array
    regressor: Array
    torque: Array
    change: Array
    velocity: Array
    log: NDArray[np.int64]
    moving: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.time)

    def chosen(self, which: NDArray[np.bool_]) -> Rows:
        """Rows where a mask (n,) is True, without a copy where they follow each other."""
        at = np.flatnonzero(which)
        follow = len(at) and at[-1] - at[0] == len(at) - 1
        picked = slice(at[0], at[-1] + 1) if follow else at
        return Rows(self.cutoff, *(getattr(self, name)[picked] for name in COLUMNS))

    def used(self, least: Array) -> NDArray[np.bool_]:
        """Mask (n, r) of the joints' rows in motion whose speeds are at least some (r,)."""
        return np.asarray(self.moving[:, None] & (np.abs(self.velocity) >= least))

    @property
    def moved(self) -> Rows:
        """Rows at which the arm moves."""
        return self.chosen(self.moving)

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """Rows of several parts, one after the other."""
        if len(parts) == 1:
            return parts[0]
        return cls(parts[0].cutoff, *(np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS))


@dataclass(frozen=True, eq=False)
class SmoothMotion:
    """Positions and velocities of a log through a low-pass filter, thinned to every `every`-th sample."""

    log: PreparedLog
    number: int
    cutoff: float
    every: int
    first: int
    position: Array
    velocity: Array
    whole: int = 0
    """samples of the motion that this is a part of, if it is"""

    @property
    def rate(self) -> float:
        """Sampling rate of the smoothed motion in Hz."""
        return self.log.rate / self.every

    @classmethod
    def of(cls, log: PreparedLog, number: int, cutoff: float = MOTION_CUTOFF) -> SmoothMotion:
        """Smoothed motion of a log, filtered at a cut-off (Hz) or a fifth of its rate."""
        cutoff = min(cutoff, 0.2 * log.rate)
        kernel = low_pass(cutoff, log.rate)
        rate_kernel = derivative(kernel, log.rate)
        if len(rate_kernel) + 4 * DIFFERENCE_MARGIN >= len(log.time):
            raise InputError(
                f"{log.source}: {len(log.time)} consecutive samples are too few to filter; record a longer log"
            )
        every = max(1, int(log.rate / (OVERSAMPLING * cutoff)))
        position = filtered(log.position, padded(kernel))[::every]
        velocity = filtered(log.position, rate_kernel)[::every]
        return cls(log, number, cutoff, every, len(rate_kernel) // 2, position, velocity)

    def later(self, cutoff: float, times: Array, delay: float) -> tuple[Array, Array]:
        """Rise (n, r) of the torques, filtered at a cut-off (Hz), from times (n,) to a delay (s) later; rates there."""
        kernel = low_pass(cutoff, self.log.rate)
        signal, first = filtered(self.log.torque, kernel), len(kernel) // 2
        at = self.log.time[first : first + len(signal)]
        rates = np.gradient(signal, 1.0 / self.log.rate, axis=0)
        rise = [np.interp(times + delay, at, own) - np.interp(times, at, own) for own in signal.T]
        return np.stack(rise, axis=-1), np.stack([np.interp(times + delay, at, own) for own in rates.T], axis=-1)

    def states(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations (M - 4, r), these from differences of the smoothed velocities."""
        inner = slice(DIFFERENCE_MARGIN, -DIFFERENCE_MARGIN)
        return self.position[inner], self.velocity[inner], filtered(self.velocity, derivative(np.ones(1), self.rate))

    def rows(self, mechanism: Mechanism, cutoffs: Sequence[float]) -> list[Rows]:
        """Rows for each cut-off (Hz), about four in its period."""
        return self.filtered_rows(mechanism, [RowFilter.of(self, cutoff) for cutoff in cutoffs])

    def filtered_rows(self, mechanism: Mechanism, filters: Sequence[RowFilter]) -> list[Rows]:
        """Rows by each filter."""
        found: list[list[Array]] = [[] for _ in filters]
        widest = max(f.taps for f in filters)
        if len(self.position) < widest:
            raise InputError(f"{self.log.source}: {len(self.log.time)} consecutive samples are too few to filter")
        narrowest = min(f.taps for f in filters)
        for start in range(0, max(1, len(self.position) - narrowest + 1), CHUNK_SAMPLES):
            terms = _Terms.of(self, mechanism, slice(start, start + CHUNK_SAMPLES + widest - 1))
            for row_filter, parts in zip(filters, found, strict=True):
                parts.append(row_filter.regressor(terms, start, min(CHUNK_SAMPLES, len(self.position) - start)))
        return [f.rows(self, _emptied(parts)) for f, parts in zip(filters, found, strict=True)]


def _emptied(parts: list[Array]) -> Array:
    """One array of all parts, whose list is emptied to free memory."""
    whole = np.concatenate(parts)
    parts.clear()
    return whole


@dataclass(frozen=True, eq=False)
class _Terms:
    """Regressors (n, K) of momenta and forces, of the K of all r times P entries that are not 0 by structure."""

    momentum: Array
    forces: Array
    entries: NDArray[np.intp]
    shape: tuple[int, int]

    @classmethod
    def of(cls, motion: SmoothMotion, mechanism: Mechanism, where: slice) -> _Terms:
        """Terms of some samples of a motion."""
        q, v = column(mechanism.configuration(motion.position[where])), column(motion.velocity[where])
        columns = range(len(mechanism.parameter_names))
        terms = momentum_terms(mechanism.equations, q, v, columns)
        both = [[entry for row in rows for entry in row] for rows in terms]
        entries = [k for k, own in enumerate(zip(*both, strict=True)) if any(map(_may_differ, own))]
        momentum, forces = (_side_by_side([own[k] for k in entries], len(motion.position[where])) for own in both)
        return cls(momentum, forces, np.array(entries, dtype=np.intp), (len(terms.momentum), len(columns)))

    def whole(self, packed: Array) -> Array:
        """Regressor (n, r, P) of the entries (n, K)."""
        regressor = np.zeros((len(packed), self.shape[0] * self.shape[1]))
        regressor[:, self.entries] = packed
        return regressor.reshape(-1, *self.shape)


def _may_differ(entry: Any) -> bool:
    """False for the number 0 of an entry that is 0 by structure."""
    return np.ndim(entry) > 0 or bool(entry)


def _side_by_side(entries: Sequence[Any], samples: int) -> Array:
    """Array (n, K) of entries for n samples, each of which is contiguous."""
    out = np.empty((len(entries), samples))
    for i, entry in enumerate(entries):
        out[i] = entry
    return out.T


@dataclass(frozen=True, eq=False)
class RowFilter:
    """Low-pass filter that makes rows of a motion, one at every stride."""

    cutoff: float
    kernel: Array
    change: Array
    every: int

    @property
    def taps(self) -> int:
        """Length of the kernel in the motion's samples."""
        return len(self.kernel)

    @classmethod
    def of(cls, motion: SmoothMotion, cutoff: float) -> RowFilter:
        """Filter of a cut-off (Hz) for a motion."""
        kernel = low_pass(cutoff, motion.rate)
        every = min(int(motion.rate / (ROWS_PER_PERIOD * cutoff)), (motion.whole or len(motion.position)) // MIN_ROWS)
        return cls(cutoff, padded(kernel), derivative(kernel, motion.rate), max(1, every))

    def regressor(self, terms: _Terms, start: int, length: int) -> Array:
        """Regressor (n, r, P) of rows from momenta and forces of a chunk of samples."""
        skipped = -start % self.every
        end = length + self.taps - 1
        h, f = terms.momentum[skipped:end], terms.forces[skipped:end]
        if len(h) < self.taps:
            return np.empty((0, *terms.shape))
        return terms.whole(filtered(h, self.change, self.every) - filtered(f, self.kernel, self.every))

    def signal(self, values: Array) -> Array:
        """Signal (m, ...) through the filter, at all rows."""
        return filtered(values, self.kernel, self.every)

    def rows(self, motion: SmoothMotion, regressor: Array) -> Rows:
        """Rows at all instants, with a mask of those at which the arm moves."""
        log, n = motion.log, len(regressor)
        at = self._centers(motion, n)
        own = low_pass(self.cutoff, log.rate)
        torque = filtered(log.torque, own)[at - len(own) // 2]
        velocity, number = self.signal(motion.velocity), np.full(n, motion.number)
        return Rows(
            self.cutoff, log.time[at], regressor, torque, self._change(log, at), velocity, number, self.moving(motion)
        )

    def _change(self, log: PreparedLog, at: NDArray[np.int64]) -> Array:
        """Rates (n, r) of the filtered torques at samples."""
        kernel = derivative(low_pass(self.cutoff, log.rate), log.rate)
        return filtered(log.torque, kernel)[at - len(kernel) // 2]

    def times(self, motion: SmoothMotion) -> Array:
        """Times (n,) in s of all rows of a motion."""
        return motion.log.time[self._centers(motion, self._count(motion))]

    def _count(self, motion: SmoothMotion) -> int:
        return len(range(0, len(motion.position) - self.taps + 1, self.every))

    def moving(self, motion: SmoothMotion) -> NDArray[np.bool_]:
        """Mask (n,) of the rows at whose instant and kernel's ends the arm moves."""
        at = self._centers(motion, self._count(motion))
        around, moving = motion.every * (self.taps // 2), motion.log.moving
        return np.asarray(moving[at - around] & moving[at] & moving[at + around])

    def _centers(self, motion: SmoothMotion, count: int) -> NDArray[np.int64]:
        return motion.first + motion.every * (self.taps // 2 + self.every * np.arange(count))


def rows_of(motions: Sequence[SmoothMotion], mechanism: Mechanism, cutoffs: Sequence[float]) -> list[Rows]:
    """Rows of several logs, one after the other, for each cut-off."""
    each = [motion.rows(mechanism, cutoffs) for motion in motions]
    return [Rows.joined(parts) for parts in zip(*each, strict=True)]


def motions_of(logs: Sequence[PreparedLog], cutoff: float = MOTION_CUTOFF) -> Iterator[SmoothMotion]:
    """Motions of logs, numbered from 0, smoothed at a cut-off (Hz)."""
    return (SmoothMotion.of(log, number, cutoff) for number, log in enumerate(logs))


def motion_band(logs: Sequence[PreparedLog]) -> float:
    """Frequency (Hz) below which 99 % of the square of every joint's speed are, noise of positions taken off."""
    return max(_band(log) for log in logs)


def _band(log: PreparedLog) -> float:
    """Band (Hz) of one log, where the flat part of the spectrum of positions is noise, as its upper half has it."""
    length = min(len(log.time), max(64, round(SPECTRUM_LENGTH * log.rate)))
    each = [welch(column, log.rate, nperseg=length) for column in log.position.T]  # less memory than all at once
    frequency, power = each[0][0], np.stack([own for _, own in each], axis=-1)
    upper = frequency > 0.5 * min(frequency[-1], 2.0 * MOTION_CUTOFF)
    noise = np.median(power[upper], axis=0)
    speed = np.maximum(power - 3.0 * noise, 0.0) * frequency[:, None] ** 2
    total = np.cumsum(speed[frequency <= MOTION_CUTOFF], axis=0)
    found = [float(frequency[np.searchsorted(part, BAND_SHARE * part[-1])]) for part in total.T if part[-1] > 0.0]
    return max(found, default=MOTION_CUTOFF)
