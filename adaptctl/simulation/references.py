"""References sampled at given times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, checked, stacked
from adaptctl.caching import cached_property
from adaptctl.compilation import Kernel, compile_function
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.control.references import SinusoidNumbers, Sinusoids, sinusoids_at
from adaptctl.errors import InputError, NonFiniteError, ReferenceWarning, shown, warn
from adaptctl.scalars import Column, column

DERIVATIVE_SAMPLES, DIFFERENCE_STEP = 41, 1e-4
"""number of times, and s"""
DERIVATIVE_TOLERANCE = 0.05
"""of the largest derivative, at the median"""


def validate_point(point: object) -> None:
    """Raise `InputError` unless it is a reference point."""
    if not all(hasattr(point, name) for name in ReferencePoint._fields):
        raise InputError(
            f"reference: expected it to return ReferencePoint(p, v, a), each (n, r) at times (n,), got a "
            f"{type(point).__name__}"
        )


def warn_of_derivatives(reference: Reference, names: Sequence[str], duration: float) -> None:
    """Warn (`ReferenceWarning`) of velocities or accelerations that are not derivatives."""
    time = (
        DIFFERENCE_STEP
        + (duration - 2.0 * DIFFERENCE_STEP) * (np.arange(DERIVATIVE_SAMPLES) + 0.382) / DERIVATIVE_SAMPLES
    )
    if not time[0] < time[-1]:
        return
    before, now, after = points = [reference(time + shift) for shift in (-DIFFERENCE_STEP, 0.0, DIFFERENCE_STEP)]
    for point in points:
        validate_point(point)
    for what, of, stated, low, high in (
        ("velocity", "position", now.v, before.p, after.p),
        ("acceleration", "velocity", now.a, before.v, after.v),
    ):
        wrong = _wrong(np.asarray(stated), (np.asarray(high) - np.asarray(low)) / (2.0 * DIFFERENCE_STEP))
        if wrong:
            joints = ", ".join(names[j] if j < len(names) else f"{j}" for j in wrong)
            warn(
                f"reference: the {what} of {joints} is not the derivative of its {of}: the controller can follow "
                f"neither; give {type(reference).__name__} exact derivatives, or use a `Spline` through its positions",
                ReferenceWarning,
            )
            return


def _wrong(stated: Array, slope: Array) -> list[int]:
    """Joints whose derivatives (T, r) differ from finite differences."""
    scale = np.maximum(np.abs(stated), np.abs(slope)).max(axis=0)
    return np.flatnonzero(np.median(np.abs(stated - slope), axis=0) > DERIVATIVE_TOLERANCE * scale + 1e-6).tolist()


REFERENCE = ("reference_p", "reference_v", "reference_a")
"""column names of a reference point"""
BLOCK, AHEAD = 128, 1024
"""control periods evaluated at once: of one arm, with what comes next, and of many"""


def sampled(reference: Reference, times: Array, size: int, out: Array | None = None) -> ReferencePoint:
    """Checked points (T, size) at times (T,), views of one array (T, 3, size)."""
    points = np.empty((len(times), 3, size)) if out is None else out
    parts = ReferencePoint(*points.swapaxes(0, 1))
    if isinstance(reference, Sinusoids) and len(reference.center) == size:
        with suppress(NonFiniteError):  # which is raised below, where it is known of what
            _put_sinusoids(points, reference, times)
            return parts
    point = reference(times)
    validate_point(point)
    for name, part in parts._asdict().items():
        part[...] = _checked(point, name, len(times), size)
    return parts


class Preview:
    """Reference of each control period and its next positions."""

    def __init__(
        self, reference: Reference, dof: int, control_period: float, look_ahead: Array, block: int = BLOCK
    ) -> None:
        self.reference, self._dof = reference, dof
        self._period, self._look_ahead, self._size = control_period, look_ahead, block
        self._blocks: dict[int, Array] = {}
        self._keep([0])

    def row(self, step: int) -> Array:
        """Row (3r + h r,) of a control period."""
        block, place = divmod(step, self._size)
        if block not in self._blocks:
            self._keep([block])
        row: Array = self._blocks[block][place]
        return row

    def rows(self, steps: NDArray[np.int64]) -> Array:
        """Rows (k, 3r + h r) of control periods."""
        needed, which = np.unique(steps // self._size, return_inverse=True)
        self._keep(needed.tolist())
        rows: Array = np.stack(list(self._blocks.values()))[which, steps % self._size]
        return rows

    def _keep(self, blocks: list[int]) -> None:
        self._blocks = {k: self._blocks[k] if k in self._blocks else self._block(k) for k in blocks}

    def _block(self, block: int) -> Array:
        times = self._period * np.arange(block * self._size, (block + 1) * self._size, dtype=np.float64)
        n, ahead = self._size, (times + t for t in self._look_ahead)
        p, v, a = sampled(self.reference, np.concatenate((times, *ahead)), self._dof)
        later = p[n:].reshape(-1, n, self._dof).swapaxes(0, 1)
        return np.concatenate((p[:n], v[:n], a[:n], later.reshape(n, -1)), axis=1)


def _put_sinusoids(points: Array, reference: Sinusoids, times: Array) -> None:
    """Write sinusoids at times (T,), s, into an array (T, 3, r)."""
    numbers = reference.numbers
    evaluated = _compiled(*map(len, numbers)).map
    if points.flags.c_contiguous:
        evaluated(times[:, None], *numbers, out=points)
    else:
        points[...] = evaluated(times[:, None], *numbers)


@lru_cache(maxsize=16)
def _compiled(*sizes: int) -> Kernel:
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


@dataclass(frozen=True)
class ReferenceForm:
    """Samples, or sums of `terms` sinusoids."""

    size: int
    terms: int = 0
    each: bool = False

    @property
    def held(self) -> dict[str, int]:
        """Lengths, by name, of each arm's constant columns."""
        wave = self.size * self.terms
        return SinusoidNumbers(self.size, wave, wave, wave, 1)._asdict() if self.terms else {}

    @property
    def shared(self) -> dict[str, int]:
        """Lengths, by name, of varying columns common to all arms."""
        if self.terms:
            return {"time": 1}
        return {} if self.each else dict.fromkeys(REFERENCE, self.size)

    @property
    def driven(self) -> dict[str, int]:
        """Lengths, by name, of each arm's varying columns."""
        return dict.fromkeys(REFERENCE, self.size) if self.each and not self.terms else {}

    def point(self, columns: Mapping[str, Column], ahead: float = 0.0) -> ReferencePoint:
        """Reference point, `ahead` s later if computed."""
        if not self.terms:
            return ReferencePoint(*(columns[name] for name in REFERENCE))
        numbers = SinusoidNumbers(*(columns[name] for name in SinusoidNumbers._fields))
        return sinusoids_at(columns["time"][0] + ahead, numbers)

    def numbers(self, references: Sequence[Reference | None]) -> SinusoidNumbers:
        """Numbers of M sums of sinusoids, padded by zero amplitudes."""
        known: dict[int, SinusoidNumbers] = {}
        for one in references:
            if isinstance(one, Sinusoids) and id(one) not in known:
                known[id(one)] = _filled(one.numbers, self.terms * self.size)
        rows = [known[id(one)] for one in references]
        return SinusoidNumbers(*(np.array(values) for values in zip(*rows, strict=True)))


@dataclass(frozen=True, eq=False)
class ReferencesOfMany:
    """References of M arms, sampled or as sinusoids."""

    references: Sequence[Reference]
    form: ReferenceForm
    size: int
    arms: tuple[int, ...]

    @classmethod
    def of(cls, given: Reference | Sequence[Reference], size: int) -> ReferencesOfMany:
        """Checked references, one for all arms or one each."""
        if callable(given):
            return cls([given], ReferenceForm(size), size, ())
        references = list(given) if isinstance(given, Sequence) else []
        if not references or not all(map(callable, references)):
            raise InputError(f"reference: expected a Reference or a sequence of them, got {shown(given)}")
        arms = (len(references),)
        if all(one is references[0] for one in references):
            return cls(references[:1], ReferenceForm(size), size, arms)
        return cls(references, _form(references, size), size, arms)

    def of_arms(self, arms: slice) -> ReferencesOfMany:
        """References of a slice of arms."""
        if self._is_shared:
            return self
        return replace(self, references=self.references[arms], arms=(arms.stop - arms.start,))

    @property
    def held(self) -> Mapping[str, Array]:
        """Values of constant columns, by name; empty for samples."""
        return {} if self._numbers is None else self._numbers._asdict()

    def start(self) -> tuple[Array, Array]:
        """Positions and velocities at time zero."""
        if self._numbers is not None:
            point = sinusoids_at(0.0, SinusoidNumbers(*map(column, self._numbers)))
            return stacked(point.p.of, self.arms), stacked(point.v.of, self.arms)
        points = self._points(np.zeros(1))
        return points.p[0], points.v[0]

    def signals(self, time: Array) -> Mapping[str, Array]:
        """Values of varying columns, by name."""
        if self.form.terms:
            return {"time": time[:, None]}
        return dict(zip(REFERENCE, self._points(time), strict=True))

    def _points(self, time: Array) -> ReferencePoint:
        """Points (T, M, n), or (T, n) for one reference."""
        points = [sampled(one, time, self.size) for one in self.references]
        if self._is_shared:
            return points[0]
        return ReferencePoint(*(np.stack(parts, axis=1) for parts in zip(*points, strict=True)))

    @property
    def _is_shared(self) -> bool:
        return not (self.form.terms or self.form.each)

    @cached_property
    def _numbers(self) -> SinusoidNumbers | None:
        """Numbers (M, n) of sinusoids of one form, else None."""
        return self.form.numbers(self.references) if self.form.terms else None


class SignalsAhead:
    """Values of varying columns, evaluated for a block of control periods and given in parts of it."""

    def __init__(self, references: ReferencesOfMany, control_period: float, steps: int) -> None:
        self.references, self._period, self._steps = references, control_period, steps
        self._first, self._end, self._kept = 0, 0, dict[str, Array]()

    def part(self, first: int, count: int) -> Mapping[str, Array]:
        """Values of `count` control periods from the one numbered `first` on, by name."""
        if not self._first <= first <= first + count <= self._end:
            self._first, self._end = first, min(first + max(count, AHEAD), self._steps)
            time: Array = self._period * np.arange(self._first, self._end, dtype=np.float64)
            self._kept = dict(self.references.signals(time))
        place = slice(first - self._first, first - self._first + count)
        return {name: values[place] for name, values in self._kept.items()}


def _form(references: Sequence[Reference], size: int) -> ReferenceForm:
    lengths = {one.amplitude.shape if isinstance(one, Sinusoids) else None for one in references}
    shape = lengths.pop()
    if lengths or not shape or shape[1] != size or not shape[0]:
        return ReferenceForm(size, each=True)
    return ReferenceForm(size, shape[0])


def _filled(numbers: SinusoidNumbers, size: int) -> SinusoidNumbers:
    none = np.zeros(size - len(numbers.amplitude))
    amplitude, frequency, phase = (np.concatenate((part, none)) for part in numbers[1:4])
    return SinusoidNumbers(numbers.center, amplitude, frequency, phase, numbers.start_time)
