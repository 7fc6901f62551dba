"""Evidence of long logs, whose rows take too much memory: normal equations of all, made stretch by stretch."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification.choice import NUM_BLOCKS, SLOW_CANDIDATES
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.filtered_dynamics import ROWS_PER_PERIOD, RowFilter, Rows, SmoothMotion
from adaptctl.identification.fit import LogEvidence, RowsPart
from adaptctl.identification.lasting_noise import Whitening
from adaptctl.identification.momentum_balance import MomentumBalance, PackedRegressor
from adaptctl.identification.normal_equations import NormalEquations, block_edges, blocks_of
from adaptctl.identification.payloads import taken_there, without_payloads
from adaptctl.identification.preparation import PreparedLog
from adaptctl.logs.on_disk import release

# Bytes of all rows' regressors, or samples, above which a log is long; bytes of the rows that are kept of one.
LONG, MANY, KEPT = 256 * 2**20, 2_000_000, 96 * 2**20
# Samples of the smoothed motion in a stretch, at least, and s of the log before and after it.
STRETCH, MARGIN = 20_000, 0.25


class _Stretch(NamedTuple):
    """Smoothed motion of a part of a log, and the first and last of its samples whose rows are its own."""

    motion: SmoothMotion
    first: int
    last: int


@dataclass(frozen=True, eq=False)
class _Grid:
    """Filters of a log's rows by cut-off, which stretches begin at common instants of."""

    log: PreparedLog
    number: int
    smooth: float
    cutoffs: Sequence[float]

    @property
    def rate(self) -> float:
        """Samples per second of the smoothed motion."""
        return self._start.rate

    @cached_property
    def _start(self) -> SmoothMotion:
        return SmoothMotion.of(_cut(self.log, 0, 10 * STRETCH), self.number, self.smooth)

    @property
    def samples(self) -> int:
        """Samples of the whole smoothed motion."""
        return -(-(len(self.log.time) - 2 * self._start.first) // self._start.every)

    @cached_property
    def filters(self) -> list[RowFilter]:
        """Filters of the whole motion, whose strides are those of its length."""
        return [RowFilter.of(replace(self._start, whole=self.samples), cutoff) for cutoff in self.cutoffs]

    def instants(self) -> tuple[Array, NDArray[np.bool_]]:
        """Times (n,) of the least cut-off's rows, and a mask (n,) of those at which the arm moves."""
        motion, own = self._start, self.filters[0]
        half = motion.every * (own.taps // 2)
        count = len(range(0, self.samples - own.taps + 1, own.every))
        at = motion.first + half + motion.every * own.every * np.arange(count)
        moving = self.log.moving
        time = self.log.time[at]
        release()
        return time, moving[at - half] & moving[at] & moving[at + half]

    def stretches(self) -> Iterator[_Stretch]:
        """Stretches of the motion, one after the other."""
        every, K = self._start.every, 2 * self._start.first + 1
        step, widest = math.lcm(*(f.every for f in self.filters)), max(f.taps for f in self.filters)
        length, lead = step * -(-STRETCH // step), step * math.ceil(MARGIN * self._start.rate / step)
        starts = list(range(0, max(1, self.samples - length // 2), length))
        for start, end in pairwise([*starts, self.samples]):
            before = min(lead, start)
            part = _cut(self.log, (start - before) * every, (end + widest + lead) * every + K)
            yield _Stretch(SmoothMotion.of(part, self.number, self.smooth), before, before + end - start)


def _cut(log: PreparedLog, start: int, end: int) -> PreparedLog:
    """Part of a log, in memory."""
    here = slice(start, end)
    parts = (np.ascontiguousarray(getattr(log, name)[here]) for name in ("time", "position", "torque", "moving"))
    cut = PreparedLog(log.source, log.rate, *parts)
    release()
    return cut


@dataclass(frozen=True, eq=False)
class Stretches:
    """Rows of logs at some cut-offs (Hz), rising, made of one stretch after the other of the smoothed motion."""

    logs: Sequence[PreparedLog]
    mechanism: Mechanism
    drives: Drives
    smooth: float
    cutoffs: Sequence[float]
    _found: dict[float, dict[tuple[float, float], NormalEquations]] = field(default_factory=dict)
    _white: dict[tuple[float, float, float, tuple[float, ...]], NormalEquations] = field(default_factory=dict)

    @property
    def are_long(self) -> bool:
        """True if all rows together, or samples at their rate, take too much memory."""
        lasts = sum(len(log.time) / log.rate for log in self.logs)
        return lasts * self._bytes > LONG or sum(len(log.time) for log in self.logs) > MANY

    @property
    def _bytes(self) -> float:
        """Bytes of the regressors of a second."""
        return 8.0 * self.mechanism.dof * len(self.mechanism.parameter_names) * ROWS_PER_PERIOD * sum(self.cutoffs)

    @cached_property
    def balance(self) -> MomentumBalance:
        """Regressors of the samples, which are many."""
        return MomentumBalance(self.mechanism, many=True)

    @cached_property
    def _grids(self) -> list[_Grid]:
        return [_Grid(log, number, self.smooth, self.cutoffs) for number, log in enumerate(self.logs)]

    def validate(self, cutoff: float) -> None:
        """Raise `InputError` for a cut-off (Hz) that filters no motion: longer than one, or not below half its rate."""
        least = max(2.0 * grid.rate / grid.samples for grid in self._grids)
        most = 0.5 * min(grid.rate for grid in self._grids)
        if not least < cutoff < most:
            raise InputError(f"cutoff: expected between {least:.3g} and {most:.3g} Hz for these logs, got {cutoff:g}")

    @cached_property
    def peaks(self) -> Array:
        """Greatest speeds (r,) of the smoothed motion."""
        every = (stretch.motion.velocity for grid in self._grids for stretch in grid.stretches())
        return np.max([np.abs(v).max(axis=0) for v in every], axis=0)

    @cached_property
    def edges(self) -> list[tuple[int, float]]:
        """Index of the log and time (s) at which each block begins."""
        each = []
        for grid in self._grids:
            time, on = grid.instants()
            on = on & ~taken_there(self.drives, grid.log.source, time, self.cutoffs[0])
            each.append((np.full(np.count_nonzero(on), grid.number), time[on]))
        log, time = (np.concatenate(part) for part in zip(*each, strict=True))
        return block_edges(log, time, NUM_BLOCKS)

    def windows(self) -> list[SmoothMotion]:
        """A part of each block, with as many rows of all together as are kept."""
        samples = 8.0 * (2 * self.mechanism.dof + 1) * max(log.rate for log in self.logs)
        most = KEPT / max(self._bytes, samples) / len(self.edges)
        ends = [*self.edges[1:], (len(self.logs), 0.0)]
        found: list[SmoothMotion] = []
        for (k, begin), (other, end) in zip(self.edges, ends, strict=True):
            log = self.logs[k]
            last = min(end if other == k else math.inf, begin + most)
            start, stop = np.searchsorted(log.time, [begin, last]).tolist()
            part = SmoothMotion.of(_cut(log, start, stop), len(found), self.smooth)
            found.append(replace(part, whole=self._grids[k].samples))
        return found

    def sums(self, delay: float) -> dict[tuple[float, float], NormalEquations]:
        """Normal equations by cut-off (Hz) and share of peak speed, with the torques of a delay (s) later."""
        if delay not in self._found:
            self._found.clear()
            self._found[delay] = self._summed(delay)
        return self._found[delay]

    def _summed(self, delay: float) -> dict[tuple[float, float], NormalEquations]:
        """Sums in which every row is added once, to those of the rows that are slow by no larger share."""
        least, P = sorted(SLOW_CANDIDATES, reverse=True), len(self.mechanism.parameter_names)
        empty = partial(NormalEquations.zero, len(self.edges), self.mechanism.dof, P)
        parts = {cutoff: [empty() for _ in least] for cutoff in self.cutoffs}
        for rows, regressor, _ in self.rows(delay, self.cutoffs):
            block, faster = blocks_of(rows, self.edges), np.zeros_like(rows.torque, dtype=np.bool_)
            for slow, own in zip(least, parts[rows.cutoff], strict=True):
                used = rows.used(slow * self.peaks)
                own.add(regressor, rows.torque, block, used & ~faster)
                faster = used
        sums = ((cutoff, accumulate(own, NormalEquations.plus)) for cutoff, own in parts.items())
        return {(cutoff, slow): part for cutoff, own in sums for slow, part in zip(least, own, strict=True)}

    def white(self, delay: float, cutoff: float, slow: float, lasting: tuple[float, ...]) -> NormalEquations:
        """Normal equations of rows of a cut-off (Hz) whose noise lasts some times (r,) in s, made white."""
        key = delay, cutoff, slow, lasting
        if key not in self._white:
            self._white.clear()
            total = NormalEquations.zero(len(self.edges), self.mechanism.dof, len(self.mechanism.parameter_names))
            whitening = Whitening(lasting, cutoff)
            for rows, regressor, _ in self.rows(delay, [cutoff]):
                used, torque = rows.used(slow * self.peaks), rows.torque.copy()
                for j in range(used.shape[1]):
                    parts = (regressor.joint(j)[1], torque[:, j : j + 1])
                    whitening.whiten(j, rows, np.flatnonzero(used[:, j]), parts)
                total.add(regressor, torque, blocks_of(rows, self.edges), used)
            self._white[key] = total
        return self._white[key]

    def rows(self, delay: float, cutoffs: Sequence[float]) -> Iterator[tuple[Rows, PackedRegressor, SmoothMotion]]:
        """Rows of some cut-offs (Hz) of stretches, without known payloads, their packed regressors, and motions."""
        for grid in self._grids:
            filters = [own for own in grid.filters if own.cutoff in cutoffs]
            for motion, first, last in grid.stretches():
                for own, packed in zip(filters, motion.filtered_regressors(self.balance, filters), strict=True):
                    at = own.every * np.arange(len(packed.values))
                    kept = own.rows(motion, packed.values).chosen((at >= first) & (at < last))
                    rise = motion.later(own.cutoff, kept.time, delay)[0] if delay else 0.0
                    packed = packed._replace(values=kept.regressor)
                    kept = replace(kept, torque=kept.torque + rise)
                    yield self._without_payloads(kept, packed, motion), packed, motion

    def _without_payloads(self, rows: Rows, packed: PackedRegressor, motion: SmoothMotion) -> Rows:
        if not self.drives.payloads:
            return rows
        whole = replace(rows, regressor=packed.whole)
        return without_payloads(whole, [motion], self.mechanism, self.drives)


@dataclass(frozen=True, eq=False)
class LongEvidence(LogEvidence):
    """Evidence with the normal equations of all rows, by its own blocks, and rows of a window in each."""

    stretches: Stretches
    own: tuple[int, ...]
    delay: float = 0.0

    @property
    def sampled(self) -> LogEvidence:
        """Evidence of the windows alone."""
        return LogEvidence(*(getattr(self, part.name) for part in fields(LogEvidence)))

    def part(self, blocks: Sequence[int]) -> LogEvidence:
        """Evidence of some blocks of time alone, by rising indices."""
        return replace(super().part(blocks), own=tuple(self.own[b] for b in blocks))  # type: ignore[call-arg]

    def advanced(self, delay: float) -> LogEvidence:
        """Evidence whose torques are those of a delay (s) later."""
        return replace(super().advanced(delay), delay=self.delay + delay)  # type: ignore[call-arg]

    @property
    def logs(self) -> Sequence[PreparedLog]:
        """Logs, or their pieces."""
        return self.stretches.logs

    def parts(self, cutoff: float) -> Iterator[RowsPart]:
        """Rows of a cut-off of all blocks, in parts."""
        for rows, packed, motion in self.stretches.rows(self.delay, [cutoff]):
            whole = replace(rows, regressor=packed.whole)
            yield RowsPart(whole, [motion], blocks_of(rows, self.stretches.edges), self.stretches.peaks)

    def sums(self, cutoff: float, slow: float, lasting: tuple[float, ...] = ()) -> NormalEquations:
        """Normal equations of rows of a cut-off, by blocks, without joints slower than a share of their peaks."""
        if lasting:
            return self.stretches.white(self.delay, cutoff, slow, lasting).chosen(self.own)
        return self.stretches.sums(self.delay)[cutoff, slow].chosen(self.own)
