"""Equations of motion through a filter, without accelerations (Slotine and Li 1987; Pucci et al. 2013)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.identification.convolution import spectrum
from adaptctl.identification.momentum_balance import MomentumBalance, PackedRegressor
from adaptctl.identification.preparation import DIFFERENCE_MARGIN, PreparedLog, derivative, filtered, low_pass, padded
from adaptctl.logs.on_disk import each_column

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
        position, velocity = (filtered(log.position, w, every) for w in (padded(kernel), rate_kernel))
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

    def filtered_rows(self, balance: MomentumBalance, filters: Sequence[RowFilter]) -> list[Rows]:
        """Rows by each filter."""
        packed = self.filtered_regressors(balance, filters)
        return [f.rows(self, own.whole) for f, own in zip(filters, packed, strict=True)]

    def filtered_regressors(self, balance: MomentumBalance, filters: Sequence[RowFilter]) -> list[PackedRegressor]:
        """Regressors of the rows by each filter."""
        found: list[list[PackedRegressor]] = [[] for _ in filters]
        widest, narrowest = (of(f.taps for f in filters) for of in (max, min))
        if len(self.position) < widest:
            raise InputError(f"{self.log.source}: {len(self.log.time)} consecutive samples are too few to filter")
        for start in range(0, len(self.position) - narrowest + 1, CHUNK_SAMPLES):
            here = slice(start, start + CHUNK_SAMPLES + widest - 1)
            samples = balance.at(self.position[here], self.velocity[here], self.rate)
            for row_filter, parts in zip(filters, found, strict=True):
                values = row_filter.balanced(samples.values, start, min(CHUNK_SAMPLES, len(self.position) - start))
                parts.append(samples._replace(values=values))
        return [parts[0]._replace(values=np.concatenate([own.values for own in parts])) for parts in found]


@dataclass(frozen=True, eq=False)
class RowFilter:
    """Low-pass filter that makes rows of a motion, one at every stride; its kernel has two zeros at each end."""

    cutoff: float
    kernel: Array
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
        return cls(cutoff, padded(kernel), max(1, every))

    def balanced(self, values: Array, start: int, length: int) -> Array:
        """Rows (m, K) of a chunk of samples' values, which lack two samples at each end."""
        inner = values[-start % self.every : length + self.taps - 1 - 2 * DIFFERENCE_MARGIN]
        kernel = self.kernel[DIFFERENCE_MARGIN:-DIFFERENCE_MARGIN]
        return filtered(inner, kernel, self.every) if len(inner) >= len(kernel) else np.empty((0, values.shape[1]))

    def signal(self, values: Array) -> Array:
        """Signal (m, ...) through the filter, at all rows."""
        return filtered(values, self.kernel, self.every)

    def rows(self, motion: SmoothMotion, regressor: Array) -> Rows:
        """Rows at all instants, with a mask of those at which the arm moves."""
        log, n = motion.log, len(regressor)
        kernel = low_pass(self.cutoff, log.rate)
        torque, change = (self._at_rows(motion, w, n) for w in (kernel, derivative(kernel, log.rate)))
        velocity, number = self.signal(motion.velocity), np.full(n, motion.number)
        time, moving = log.time[self._centers(motion, n)], self.moving(motion)
        return Rows(self.cutoff, time, regressor, torque, change, velocity, number, moving)

    def _at_rows(self, motion: SmoothMotion, kernel: Array, count: int) -> Array:
        """Torques (n, r) of the log through a kernel at its own rate, at the rows' instants."""
        first = int(self._centers(motion, 1)[0]) - len(kernel) // 2
        return filtered(motion.log.torque[first:], kernel, motion.every * self.every)[:count]

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


def rows_of(motions: Sequence[SmoothMotion], balance: MomentumBalance, cutoffs: Sequence[float]) -> list[Rows]:
    """Rows of several logs, one after the other, for each cut-off."""
    each = [motion.filtered_rows(balance, [RowFilter.of(motion, c) for c in cutoffs]) for motion in motions]
    return [Rows.joined(parts) for parts in zip(*each, strict=True)]


def motions_of(logs: Sequence[PreparedLog], cutoff: float = MOTION_CUTOFF) -> Iterator[SmoothMotion]:
    """Motions of logs, numbered from 0, smoothed at a cut-off (Hz)."""
    return (SmoothMotion.of(log, number, cutoff) for number, log in enumerate(logs))


def motion_band(logs: Sequence[PreparedLog]) -> float:
    """Frequency (Hz) below which 99 % of the square of every joint's speed are, noise of positions taken off."""
    return max(_band(log) for log in logs)


def position_spectrum(log: PreparedLog) -> tuple[Array, Array]:
    """Frequencies (f,) in Hz and spectrum (f, r) of positions by Welch's method."""
    length = min(len(log.time), max(64, round(SPECTRUM_LENGTH * log.rate)))
    frequency = np.asarray(np.fft.rfftfreq(length, 1.0 / log.rate), dtype=np.float64)
    return frequency, np.stack([spectrum(own, log.rate, length) for own in each_column(log.position)], axis=-1)


def _band(log: PreparedLog) -> float:
    """Band (Hz) of one log, where the flat part of the spectrum of positions is noise, as its upper half has it."""
    frequency, power = position_spectrum(log)
    upper = frequency > 0.5 * min(frequency[-1], 2.0 * MOTION_CUTOFF)
    noise = np.median(power[upper], axis=0)
    speed = np.maximum(power - 3.0 * noise, 0.0) * frequency[:, None] ** 2
    total = np.cumsum(speed[frequency <= MOTION_CUTOFF], axis=0)
    found = [float(frequency[np.searchsorted(part, BAND_SHARE * part[-1])]) for part in total.T if part[-1] > 0.0]
    return max(found, default=MOTION_CUTOFF)
