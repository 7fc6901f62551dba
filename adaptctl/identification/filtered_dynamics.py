"""The equations of motion through a filter: linear in the parameters, and without accelerations.

With a kernel w of finite length, tau = d/dt (h D) - f D becomes  w*tau = (w'*h - w*f) D: the derivative falls on the
kernel (filtered dynamics, as in Slotine and Li 1987, section 4; Pucci, Romano and Nori 2013). h and f are the
momenta's regressor and that of the other forces, friction among them (`momentum_terms`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, stacked_rows
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.momentum import momentum_terms
from adaptctl.errors import InputError
from adaptctl.identification.fir_filter import AROUND, derivative, filtered, low_pass, padded
from adaptctl.identification.preparation import PreparedLog
from adaptctl.scalars import column

MOTION_CUTOFF = 50.0
"""Hz, of positions and velocities before the equations, which are not linear in them."""
OVERSAMPLING = 10.0
"""Samples in a period of that cut-off: how densely the equations are evaluated."""
ROWS = 4.0
"""Rows in a period of a row's own cut-off."""
CHUNK = 1500
"""Samples evaluated at a time."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of filtered equations, n instants of r each: torque = regressor D, all of them through one low-pass filter
    of `cutoff` Hz."""

    cutoff: float
    time: Array
    """(n,) s, as in the log"""
    regressor: Array
    """(n, r, P)"""
    torque: Array
    """(n, r)"""
    velocity: Array
    """(n, r)"""
    log: NDArray[np.int64]
    """(n,) which log they are of"""

    def __len__(self) -> int:
        return len(self.time)

    def chosen(self, which: NDArray[np.bool_]) -> Rows:
        """The rows of some of the instants, by a mask (n,)."""
        t, Y, torque, v = (part[which] for part in (self.time, self.regressor, self.torque, self.velocity))
        return Rows(self.cutoff, t, Y, torque, v, self.log[which])

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """The rows of several parts, one after the other."""
        names = ("time", "regressor", "torque", "velocity", "log")
        return cls(parts[0].cutoff, *(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@dataclass(frozen=True, eq=False)
class SmoothMotion:
    """A smoothed motion of a log, at a rate at which the equations are evaluated, and its torques as they were
    logged."""

    log: PreparedLog
    number: int
    every: int
    """of the log's samples"""
    first: int
    """of the log's samples: the motion's first one"""
    position: Array
    """(m, r)"""
    velocity: Array
    """(m, r)"""

    @property
    def rate(self) -> float:
        """Sampling rate, Hz."""
        return self.log.rate / self.every

    @classmethod
    def of(cls, log: PreparedLog, number: int) -> SmoothMotion:
        """The smoothed motion of a log, through a filter that is shorter where the log is slow. Raises `InputError` for
        logs too short for it."""
        cutoff = min(MOTION_CUTOFF, 0.2 * log.rate)
        kernel = low_pass(cutoff, log.rate)
        rate_kernel = derivative(kernel, log.rate)
        if len(rate_kernel) + 4 * AROUND >= len(log.time):
            raise InputError(f"{log.source}: {len(log.time)} samples without a hole are too few to filter; log longer")
        every = max(1, int(log.rate / (OVERSAMPLING * cutoff)))
        position = filtered(log.position, padded(kernel))[::every]
        velocity = filtered(log.position, rate_kernel)[::every]
        return cls(log, number, every, len(rate_kernel) // 2, position, velocity)

    def acceleration(self) -> Array:
        """Accelerations (m - 2 AROUND, r), rad/s^2 or m/s^2, of all but the samples at the ends."""
        return filtered(self.velocity, derivative(np.ones(1), self.rate))

    def rows(self, mechanism: Mechanism, cutoffs: Sequence[float]) -> list[Rows]:
        """Rows of filtered equations at each cut-off (Hz) where the arm moves, on all P columns. Raises `InputError`
        where too few samples are left to filter."""
        filters = [RowFilter.of(self, cutoff) for cutoff in cutoffs]
        found: list[list[Array]] = [[] for _ in filters]
        widest = max(f.taps for f in filters)
        if len(self.position) < widest:
            raise InputError(f"{self.log.source}: {len(self.log.time)} samples without a hole are too few to filter")
        for start in range(0, max(1, len(self.position) - widest + 1), CHUNK):
            terms = self._terms(mechanism, slice(start, start + CHUNK + widest - 1))
            for row_filter, parts in zip(filters, found, strict=True):
                parts.append(row_filter.regressor(*terms, start, min(CHUNK, len(self.position) - start)))
        return [f.rows(self, np.concatenate(parts)) for f, parts in zip(filters, found, strict=True)]

    def _terms(self, mechanism: Mechanism, where: slice) -> tuple[Array, Array]:
        p, v = self.position[where], self.velocity[where]
        columns = range(len(mechanism.parameter_names))
        terms = momentum_terms(mechanism.equations, column(mechanism.configuration(p)), column(v), columns)
        return stacked_rows(terms.momentum, (len(p),)), stacked_rows(terms.forces, (len(p),))


@dataclass(frozen=True, eq=False)
class RowFilter:
    """Low-pass filter of a motion's equations, from its rate to that of the rows."""

    cutoff: float
    kernel: Array
    change: Array
    """its derivative"""
    every: int

    @property
    def taps(self) -> int:
        """Length of the filter, in samples of the motion."""
        return len(self.kernel)

    @classmethod
    def of(cls, motion: SmoothMotion, cutoff: float) -> RowFilter:
        """The low-pass filter with a cut-off (Hz) for a motion."""
        kernel = low_pass(cutoff, motion.rate)
        every = max(1, int(motion.rate / (ROWS * cutoff)))
        return cls(cutoff, padded(kernel), derivative(kernel, motion.rate), every)

    def regressor(self, momentum: Array, forces: Array, start: int, length: int) -> Array:
        """Filtered rows (n, r, P) of the regressor that begin in a chunk of the motion, from `start` on and `length`
        samples long."""
        skipped = -start % self.every
        end = length + self.taps - 1
        h, f = momentum[skipped:end], forces[skipped:end]
        if len(h) < self.taps:
            return np.empty((0, *h.shape[1:]))
        return filtered(h, self.change, self.every) - filtered(f, self.kernel, self.every)

    def signal(self, values: Array) -> Array:
        """Filtered rows (n, ...) of a motion's signal (m, ...)."""
        return filtered(values, self.kernel, self.every)

    def rows(self, motion: SmoothMotion, regressor: Array) -> Rows:
        """Rows of a filtered regressor with the torques, which are filtered alike at the log's own rate, where the arm
        moves."""
        log, n = motion.log, len(regressor)
        at = self._centers(motion, n)
        own = low_pass(self.cutoff, log.rate)
        torque = filtered(log.torque, own)[at - len(own) // 2]
        velocity, number = self.signal(motion.velocity), np.full(n, motion.number)
        return Rows(self.cutoff, log.time[at], regressor, torque, velocity, number).chosen(self.moving(motion))

    def moving(self, motion: SmoothMotion) -> NDArray[np.bool_]:
        """Mask (n,) of the rows that the filter makes of motion alone, not of rest before or after it."""
        at = self._centers(motion, len(range(0, len(motion.position) - self.taps + 1, self.every)))
        around, moving = motion.every * (self.taps // 2), motion.log.moving
        return np.asarray(moving[at - around] & moving[at] & moving[at + around])

    def _centers(self, motion: SmoothMotion, count: int) -> NDArray[np.int64]:
        """The log's samples that rows are of."""
        return motion.first + motion.every * (self.taps // 2 + self.every * np.arange(count))


def rows_of(motions: Sequence[SmoothMotion], mechanism: Mechanism, cutoffs: Sequence[float]) -> list[Rows]:
    """Rows of all logs at each cut-off (Hz)."""
    each = [motion.rows(mechanism, cutoffs) for motion in motions]
    return [Rows.joined(parts) for parts in zip(*each, strict=True)]


def motions_of(logs: Sequence[PreparedLog]) -> Iterator[SmoothMotion]:
    """The logs' motions, numbered."""
    return (SmoothMotion.of(log, number) for number, log in enumerate(logs))
