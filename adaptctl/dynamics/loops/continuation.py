"""Continuation of closed configurations along one branch."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, same_samples
from adaptctl.caching import cached_property
from adaptctl.compilation import Kernel, Stepper, compile_function, compile_step
from adaptctl.dynamics.loop_equations import LoopEquations
from adaptctl.dynamics.loops.posture import factored
from adaptctl.errors import InputError, SingularityError
from adaptctl.scalars import Column, Scalar, absolute, column, maximum, where

MAX_PRIMARY_STEP = 0.05
"""rad or m per step of any primary joint that moves a loop"""

MAX_LOST_GAP = 1e-9
"""m or rad of residual after Newton steps that count as failed"""

CLOSURE_TOLERANCE, MAX_HALVINGS = 1e-11, 4
"""m or rad of residual above round-off; and halvings of such a step"""

MIN_REGULARITY = 0.05
"""Least singular value of the dependent block, relative to the reference, that is regular."""


@dataclass(frozen=True, eq=False)
class Continuation:
    """Configurations reached from the reference without a singularity."""

    equations: LoopEquations
    reference: Array

    @property
    def primary(self) -> list[int]:
        """Zero-based indices of the r primary joints."""
        return list(self.equations.closing.primary)

    def follow(self, p: Array, start: Array | None = None) -> Array:
        """Closed configurations (..., n) along straight lines to positions (..., r)."""
        samples = p.shape[:-1]
        if start is not None and same_samples(p=p, start=start) != samples:
            raise InputError(f"start: expected one configuration or one for each of {samples}, got {start.shape[:-1]}")
        if self._linear is not None:
            return p @ self._linear[0] + self._linear[1]
        q = np.broadcast_to(self.reference if start is None else start, (*samples, len(self.reference)))
        q, p = q.reshape(-1, q.shape[-1]).copy(), p.reshape(-1, p.shape[-1])
        begin = q[:, self.primary]
        way, steps, left = p - begin, self._steps(p - begin), np.arange(len(q))
        if len(q) and self._ways.pays(steps):
            found, sure = self._ways.followed(q, begin, way, steps)
            q[sure], left = found[sure], np.flatnonzero(~sure)
        for k in range(1, int(steps[left].max(initial=0)) + 1):
            on = left[steps[left] >= k]
            q[on] = self._closed(begin[on] + way[on] * (k / steps[on, None]), q[on])
            self.validate_regular(q[on])
        return q.reshape(*samples, q.shape[-1])

    def follow_alone(self, p: object) -> Array | None:
        """Closed configuration (n,) of one sample by native code, or None."""
        if (
            self._linear is not None
            or not self._ways.ready
            or type(p) is not np.ndarray
            or p.shape != self._start.shape
            or p.dtype != np.float64
        ):
            return None
        start: list[float] = self._start.tolist()
        way = [x - x0 for x, x0 in zip(p.tolist(), start, strict=True)]
        steps = max((abs(way[i]) for i in self._looped), default=0.0) / MAX_PRIMARY_STEP
        if not (math.isfinite(sum(way)) and steps <= MAX_STEPS_PER_CALL):
            return None
        return self._ways.followed_alone(self.reference, start, way, max(math.ceil(steps), 1))

    def reachable(self, p: Array) -> NDArray[np.bool_]:
        """Mask (N,) of reachable positions `p` (N, r)."""
        return self.progress(p) >= 1.0

    def progress(self, p: Array, least: float = MIN_REGULARITY) -> Array:
        """Fractions (N,) of straight lines that are regular."""
        if self._linear is not None:
            return np.ones(len(p))
        q = np.tile(self.reference, (len(p), 1))
        fine, gone = np.ones(len(p), dtype=bool), np.zeros(len(p))
        way = p - self._start
        steps = self._steps(way)
        for k in range(1, int(steps.max(initial=0)) + 1):
            on = np.flatnonzero(fine & (steps >= k))
            q[on] = self._closed(self._start + way[on] * (k / steps[on, None]), q[on])
            fine[on] = self.regularity(q[on]) >= least
            gone[on] = np.where(fine[on], k / steps[on], gone[on])
        return gone

    def regularity(self, q: Array) -> Array:
        """Smallest singular value (...) of the closure Jacobian, relative to the reference's."""
        gap, smallest, sign = self._look(q)
        _, reference, side = self._at_reference
        return np.where((sign == side) & (gap < MAX_LOST_GAP), smallest / reference, 0.0)

    def surely_regular(self, q: Column, lost: float = MAX_LOST_GAP) -> Scalar:
        """1.0 if loops are closed and a regularity of 0.05 is proved, else 0.0."""
        block = self.equations.dependent_block(q)
        factor, units = factored(block), range(len(block))
        inverse = [factor.solve(Column(float(i == j) for j in units)) for i in units]
        square = sum((column @ column for column in inverse[1:]), inverse[0] @ inverse[0])
        _, smallest, side = (float(x) for x in self._at_reference)
        gap: Any = 0.0
        for residual in self.equations.residual(q):
            gap = maximum(gap, absolute(residual))
        regular = where(square * (MIN_REGULARITY * smallest) ** 2 <= 1.0, 1.0, 0.0)
        regular = where(side * determinant(block) > 0.0, regular, 0.0)
        return where(gap < lost, regular, 0.0)

    def is_regular(self, q: Array) -> NDArray[np.bool_]:
        """Mask (...) of regular configurations `q` (..., n)."""
        if q.ndim == 1:
            return np.asarray(self._native_sure(q) > 0.0 or bool(self.regularity(q) >= MIN_REGULARITY))
        regular = self._native_sure.map(q.reshape(-1, q.shape[-1])).reshape(q.shape[:-1]) > 0.0
        left = ~regular
        if left.any():
            regular[left] = self.regularity(q[left]) >= MIN_REGULARITY
        return np.asarray(regular)

    def validate_regular(self, q: Array) -> None:
        """Raise `SingularityError` unless all regularities are at least 0.05."""
        regularity = np.ravel(self.regularity(q))
        if regularity.size == 0:
            return
        worst = int(regularity.argmin())
        if not regularity[worst] >= MIN_REGULARITY:
            p = np.reshape(q, (-1, q.shape[-1]))[worst, self.primary]
            raise SingularityError(
                f"the loops are near a singularity at p = {np.round(p, 4).tolist()}: the smallest singular value is "
                f"{regularity[worst]:.2g} of that at the reference, below the limit of {MIN_REGULARITY}"
            )

    def _steps(self, way: Array) -> NDArray[np.int64]:
        longest = np.abs(way[:, self._looped]).max(axis=1, initial=0.0)
        finite = np.where(np.isfinite(longest), longest, 0.0)
        return np.maximum(np.ceil(finite / MAX_PRIMARY_STEP).astype(np.int64), 1)

    def _closed(self, p: Array, q: Array, halvings: int = MAX_HALVINGS) -> Array:
        found = self._mapped(self._native_closed, p, q)[0]
        left = np.flatnonzero(~(self._gap(found) < CLOSURE_TOLERANCE))
        if halvings and len(left):
            middle = self._closed(0.5 * (q[left][:, self.primary] + p[left]), q[left], halvings - 1)
            reached = self._gap(middle) < MAX_LOST_GAP
            found[left[reached]] = self._closed(p[left[reached]], middle[reached], halvings - 1)
        return found

    def _gap(self, q: Array) -> Array:
        return np.asarray(np.abs(self._mapped(self._native_look, q)[0]).max(axis=-1), dtype=np.float64)

    def _look(self, q: Array) -> tuple[Array, Array, Array]:
        residual, block = self._mapped(self._native_look, q)
        size = len(self.equations.closing.dependent)
        block = np.nan_to_num(block).reshape(*q.shape[:-1], size, size)
        smallest = np.asarray(np.linalg.svd(block, compute_uv=False)[..., -1], dtype=np.float64)
        return np.abs(residual).max(axis=-1), smallest, np.sign(np.linalg.det(block))

    @staticmethod
    def _mapped(kernel: Kernel, *arrays: Array) -> list[Array]:
        samples = np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
        flat = [np.broadcast_to(array, (*samples, array.shape[-1])).reshape(-1, array.shape[-1]) for array in arrays]
        return [out.reshape(*samples, out.shape[-1]) for out in kernel.map(*flat)]

    @cached_property
    def _native_closed(self) -> Kernel:
        sizes = {"p": len(self.primary), "q": len(self.reference)}
        return compile_function(lambda p, q: (self._ahead(p, q),), sizes, name="closed")

    def _ahead(self, p: Column, q: Column) -> Column:
        ahead = self.equations.joint_velocities(q, p - Column(q[i] for i in self.primary))
        return self.equations.closed(p, q + ahead)

    @cached_property
    def _ways(self) -> BatchContinuation:
        sizes = len(self.reference), len(self.primary)
        return BatchContinuation(self._ahead, lambda q: self.surely_regular(q, CLOSURE_TOLERANCE), *sizes)

    @cached_property
    def _native_look(self) -> Kernel:

        def look(q: Column) -> tuple[Column, Column]:
            block = self.equations.dependent_block(q)
            return self.equations.residual(q), Column(entry for column in block for entry in column)

        return compile_function(look, {"q": len(self.reference)})

    @cached_property
    def _native_sure(self) -> Kernel:
        return compile_function(self.surely_regular, {"q": len(self.reference)}, name="surely_regular")

    @cached_property
    def _at_reference(self) -> tuple[Array, Array, Array]:
        return self._look(self.reference)

    @cached_property
    def _linear(self) -> tuple[Array, Array] | None:
        """Rates (r, n) and offsets (n,) where joints are only coupled, which is regular everywhere; else None."""
        if self.equations.closing.loops:
            return None
        q, units = column(self.reference), np.eye(len(self.primary))
        rates = [list(self.equations.joint_velocities(q, column(unit))) for unit in units]
        return np.array(rates), np.array(list(self.equations.closed(column(0.0 * units[0]), q)))

    @cached_property
    def _start(self) -> Array:
        return self.reference[self.primary]

    @cached_property
    def _looped(self) -> list[int]:
        return np.flatnonzero(self.equations.closing.looped).tolist()


def determinant(rows: Iterable[Column]) -> Scalar:
    """Determinant of a matrix of scalars, without branches."""
    left, product = [list(row) for row in rows], 1.0
    while left:
        pivot, *others = left
        for i, row in enumerate(others):
            larger = absolute(row[0]) > absolute(pivot[0])
            others[i] = [where(larger, -x, y) for x, y in zip(pivot, row, strict=True)]
            pivot = [where(larger, y, x) for x, y in zip(pivot, row, strict=True)]
        product = product * pivot[0]
        left = [_eliminated(row, pivot) for row in others]
    return product


def _eliminated(row: list[Any], pivot: list[Any]) -> list[Any]:
    factor = row[0] / pivot[0]
    return [y - factor * x for x, y in zip(pivot[1:], row[1:], strict=True)]


COMPILE_AFTER_CALLS, COMPILE_AFTER_STEPS = 50, 5000
"""Calls, and steps of configurations, after which native code is compiled."""


MAX_STEPS_PER_CALL = 10_000
"""steps per native call, which Ctrl-C cannot interrupt"""


@dataclass(eq=False)
class BatchContinuation:
    """Native continuation of loops along straight lines."""

    following: Callable[[Column, Column], Column]
    sure: Callable[[Column], Scalar]
    joints: int
    primary: int
    work: float = 0.0

    @property
    def ready(self) -> bool:
        """True if native code is worth compiling."""
        return self.work >= 1.0

    def pays(self, steps: NDArray[np.int64]) -> bool:
        """Count a call for N lines; True if compiling pays."""
        self.work += 1.0 / COMPILE_AFTER_CALLS + float(steps.sum()) / COMPILE_AFTER_STEPS
        return self.ready and int(steps.max(initial=0)) <= MAX_STEPS_PER_CALL

    def followed(self, q: Array, begin: Array, way: Array, steps: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
        """Configurations (N, n) at the lines' ends, and a mask (N,) of regular ones."""
        arms = self._many.ensemble(len(q))
        arms.state["q"], arms.state["sure"] = q, 1.0
        arms.held["begin"], arms.held["way"], arms.held["steps"] = begin, way, steps[:, None]
        arms.run(int(steps.max()))
        return arms.state["q"], arms.state["sure"][:, 0] > 0.0

    def followed_alone(self, q: Array, begin: list[float], way: list[float], steps: int) -> Array | None:
        """Configuration (n,) at a line's end, or None if possibly singular."""
        state, held = np.array([*q, 0.0, 1.0]), np.array([*begin, *way, steps])
        end = self._single.run_single(steps, state, held)
        return end[: self.joints] if end[-1] > 0.0 else None

    @cached_property
    def _single(self) -> Stepper:
        return self._compiled(1)

    @cached_property
    def _many(self) -> Stepper:
        return self._compiled(None)

    def _compiled(self, lanes: int | None) -> Stepper:
        state, held = {"q": self.joints, "gone": 1, "sure": 1}, {"begin": self.primary, "way": self.primary, "steps": 1}
        return compile_step(self._step, state=state, constants=held, lanes=lanes, name="straight_way")

    def _step(
        self, q: Column, gone: Column, sure: Column, begin: Column, way: Column, steps: Column
    ) -> tuple[Column, Column, Column]:
        k = gone[0] + 1.0
        found = self.following(begin + way * (k / steps[0]), q)
        right = sure[0] * self.sure(found)
        after = Column(where(k <= steps[0], x, old) for x, old in zip(found, q, strict=True))
        return after, Column((k,)), Column((where(k <= steps[0], right, sure[0]),))
