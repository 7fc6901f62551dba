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
from adaptctl.dynamics.recursion.energy import momentum_terms
from adaptctl.errors import InputError
from adaptctl.identification.preparation import AROUND, PreparedLog, derivative, filtered, low_pass, padded
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
    """Rows of a robot's filtered equations of motion at n instants: torque = regressor D, with the robot's P parameters
    D (P,) in SI units, in the order of the mechanism's `parameter_names`. Torques and regressor went through one
    low-pass filter of `cutoff` Hz.

    `time` (n,) is in s, as in the logs; `regressor` (n, r, P) in N m (N for a prismatic joint) per SI unit of each
    parameter; `torque` (n, r) are the torques of r primary (independent) joints, N m (N); `velocity` (n, r) their
    filtered velocities, rad/s (m/s); and `log` (n,) the zero-based index of the log of each instant. `len` gives n.
    Nothing is checked at construction.
    """

    cutoff: float
    time: Array
    regressor: Array
    torque: Array
    velocity: Array
    log: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.time)

    def chosen(self, which: NDArray[np.bool_]) -> Rows:
        """The rows, a `Rows`, of those of the n instants where a mask `which` (n,) is True. Raises `IndexError` for a
        mask of another length."""
        t, Y, torque, v = (part[which] for part in (self.time, self.regressor, self.torque, self.velocity))
        return Rows(self.cutoff, t, Y, torque, v, self.log[which])

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """The rows, a `Rows`, of several `parts` one after the other, with the first part's `cutoff`; that the others
        have the same is not checked. Raises `IndexError` where `parts` is empty, `ValueError` for parts of other joints
        or parameters."""
        names = ("time", "regressor", "torque", "velocity", "log")
        return cls(parts[0].cutoff, *(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@dataclass(frozen=True, eq=False)
class SmoothMotion:
    """Smoothed motion of one stretch of a log, at the rate at which its equations of motion are evaluated; its torques
    are those of the log, unfiltered.

    `log` is the `PreparedLog` (evenly sampled) and `number` its zero-based index among several. The motion has every
    `every`-th of the log's samples, from the sample of index `first` on, M in all: `position` (M, r), rad (m for a
    prismatic joint), and `velocity` (M, r), rad/s (m/s), of r primary (independent) joints, both through one low-pass
    filter of at most 50 Hz. Made by `SmoothMotion.of`; nothing is checked at construction.
    """

    log: PreparedLog
    number: int
    every: int
    first: int
    position: Array
    velocity: Array

    @property
    def rate(self) -> float:
        """Sampling rate of the smoothed motion, Hz: the log's rate divided by the motion's `every`, for it has every
        `every`-th of the log's samples."""
        return self.log.rate / self.every

    @classmethod
    def of(cls, log: PreparedLog, number: int) -> SmoothMotion:
        """The smoothed motion of a prepared `log`, whose zero-based index among several is `number`: positions and
        velocities through a low-pass filter of 50 Hz, or a fifth of the log's sampling rate if that is less. The
        motion's rate is about ten times this cut-off, or the log's own where that is lower. Raises `InputError` for a
        log too short for the filter."""
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
        """Accelerations (M - 4, r), rad/s^2 (m/s^2 for a prismatic joint), of r primary (independent) joints, from
        differences of the smoothed velocities. They are at the motion's M samples without the first two and the last
        two. Raises `InputError` for a motion of fewer than five samples."""
        return filtered(self.velocity, derivative(np.ones(1), self.rate))

    def rows(self, mechanism: Mechanism, cutoffs: Sequence[float]) -> list[Rows]:
        """Rows of filtered equations of motion, a list with one `Rows` for each of the low-pass filters' `cutoffs`
        (Hz), in their order. Each has about four instants in a period of its cut-off, only those at which the arm
        moves, and regressors on all P parameters of a `mechanism`. Raises `InputError` where too few samples are left
        to filter and for a mechanism whose file has linear relations between parameters that fix some at values other
        than zero, `ValueError` for empty `cutoffs` and for one not below half the motion's rate, `SingularityError`
        near a singularity of kinematic loops."""
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
    """Low-pass filter, of `cutoff` Hz, that makes rows of filtered equations of motion from a smoothed motion. `kernel`
    (t,) has t symmetric weights that sum to 1; `change` (t,), 1/s, is the kernel of the filtered signal's time
    derivative; and `every` is the stride of the rows in the motion's samples. Made by `RowFilter.of`; nothing is
    checked at construction."""

    cutoff: float
    kernel: Array
    change: Array
    every: int

    @property
    def taps(self) -> int:
        """Length of the filter's kernel, in samples of the motion that the filter was made for."""
        return len(self.kernel)

    @classmethod
    def of(cls, motion: SmoothMotion, cutoff: float) -> RowFilter:
        """The low-pass filter, a `RowFilter`, with a `cutoff` (Hz) for a smoothed `motion`. It makes about four rows in
        a period of the cut-off, at most one for each of the motion's samples. Raises `ValueError` for a negative
        cut-off or one not below half the motion's rate, `ZeroDivisionError` for 0."""
        kernel = low_pass(cutoff, motion.rate)
        every = max(1, int(motion.rate / (ROWS * cutoff)))
        return cls(cutoff, padded(kernel), derivative(kernel, motion.rate), every)

    def regressor(self, momentum: Array, forces: Array, start: int, length: int) -> Array:
        """The regressor (n, r, P), N m (N for a prismatic joint) per SI unit of each of P parameters, of n rows of
        low-pass filtered equations of motion, from a chunk of l samples of a motion of r primary (independent) joints.
        It is `momentum` (l, r, P), the regressor of the generalised momenta, N m s (N s) per unit, through the
        derivative of the filter, minus `forces` (l, r, P), that of all other forces, friction among them, N m (N) per
        unit, through the filter.

        `start` is the zero-based index in the motion of the chunk's first sample. A row is made for every `every`-th
        sample of the motion (the filter's stride), counted from its first, that is among the first `length` of the
        chunk. It takes `taps` samples (the kernel's length) from there on, of which the middle one is its instant, so
        the chunk has up to `taps` - 1 more than `length`. n is 0 where the chunk is shorter than the filter. Nothing is
        checked.
        """
        skipped = -start % self.every
        end = length + self.taps - 1
        h, f = momentum[skipped:end], forces[skipped:end]
        if len(h) < self.taps:
            return np.empty((0, *h.shape[1:]))
        return filtered(h, self.change, self.every) - filtered(f, self.kernel, self.every)

    def signal(self, values: Array) -> Array:
        """A motion's signal, `values` (m, ...) at its m samples, through the low-pass filter: an array (n, ...) in its
        own unit, at all n rows that the filter makes of the motion. n is (m - t + 1) divided by the filter's stride
        `every` and rounded up, t being the kernel's length, its property `taps`. Raises `InputError` for a signal
        shorter than the kernel."""
        return filtered(values, self.kernel, self.every)

    def rows(self, motion: SmoothMotion, regressor: Array) -> Rows:
        """Rows of low-pass filtered equations of motion, a `Rows`, at those of n instants at which the arm moves. They
        are made of a filtered `regressor` (n, r, P), the torques, filtered alike at the log's own rate, and the
        filtered velocities of the `motion`. The regressor, N m (N for a prismatic joint) of r joints per SI unit of
        each of P parameters, is that of all n rows that the filter makes of the motion. Nothing is checked."""
        log, n = motion.log, len(regressor)
        at = self._centers(motion, n)
        own = low_pass(self.cutoff, log.rate)
        torque = filtered(log.torque, own)[at - len(own) // 2]
        velocity, number = self.signal(motion.velocity), np.full(n, motion.number)
        return Rows(self.cutoff, log.time[at], regressor, torque, velocity, number).chosen(self.moving(motion))

    def moving(self, motion: SmoothMotion) -> NDArray[np.bool_]:
        """Mask (n,) of the n rows of low-pass filtered equations of motion that the filter makes of a `motion`: True
        where the arm moves at the row's instant and at both ends of the filter's kernel around it. Empty for a motion
        shorter than the kernel. Nothing is checked."""
        at = self._centers(motion, len(range(0, len(motion.position) - self.taps + 1, self.every)))
        around, moving = motion.every * (self.taps // 2), motion.log.moving
        return np.asarray(moving[at - around] & moving[at] & moving[at + around])

    def _centers(self, motion: SmoothMotion, count: int) -> NDArray[np.int64]:
        """The log's samples that rows are of."""
        return motion.first + motion.every * (self.taps // 2 + self.every * np.arange(count))


def rows_of(motions: Sequence[SmoothMotion], mechanism: Mechanism, cutoffs: Sequence[float]) -> list[Rows]:
    """Rows of filtered equations of several logs, a list with one `Rows` for each of the low-pass filters' `cutoffs`
    (Hz). Each has the rows of all smoothed `motions`, one log after the other, with regressors on all parameters of a
    `mechanism`. The list is empty where `motions` is. Raises `InputError` where a motion is too short to filter and for
    a mechanism whose file has linear relations between parameters that fix some at values other than zero, `ValueError`
    for empty `cutoffs` and for one not below half a motion's rate, `SingularityError` near a singularity of kinematic
    loops."""
    each = [motion.rows(mechanism, cutoffs) for motion in motions]
    return [Rows.joined(parts) for parts in zip(*each, strict=True)]


def motions_of(logs: Sequence[PreparedLog]) -> Iterator[SmoothMotion]:
    """An iterator of smoothed motions, one `SmoothMotion` for each of several prepared `logs`, numbered from 0 in their
    order. The iterator raises `InputError` at a log too short to be filtered."""
    return (SmoothMotion.of(log, number) for number, log in enumerate(logs))
