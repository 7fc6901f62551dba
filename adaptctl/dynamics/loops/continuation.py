"""Following a mechanism with loops from one closed configuration to another, on one branch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, same_samples
from adaptctl.caching import cached_property
from adaptctl.compilation import Kernel, compile_function
from adaptctl.dynamics.loop_equations import LoopEquations
from adaptctl.dynamics.loops.determinant import determinant
from adaptctl.dynamics.loops.least_squares import factored
from adaptctl.dynamics.loops.straight_ways import MOST, StraightWays
from adaptctl.errors import InputError, SingularityError
from adaptctl.scalars import Column, Scalar, absolute, maximum, where

LARGEST_STEP = 0.05
"""rad or m of any primary joint that moves a loop, between two closed configurations"""

LOST = 1e-9
"""m or rad that are left open where Newton's steps, from one configuration to the next, do not lead back."""

OPEN, HALVINGS = 1e-11, 4
"""m or rad: more than round-off; and how many times a step that leaves as much is halved."""

NEAREST = 0.05
"""Fraction of its reference value below which the dependent block's smallest singular value is too small."""


@dataclass(frozen=True, eq=False)
class Continuation:
    """The assembly branch of a mechanism's reference configuration: the closed configurations that can be reached from
    it without passing a singularity of the loops, at which the primary joints no longer determine the others. It is
    followed by Newton steps; closed forms could pass to another branch unnoticed.

    `equations` are the mechanism's `LoopEquations`, closed by Newton steps; `reference` (n,) is a closed configuration
    of the spanning tree's n joints, rad (m if prismatic). Nothing is checked.
    """

    equations: LoopEquations
    reference: Array

    @property
    def primary(self) -> list[int]:
        """Zero-based indices, among the spanning tree's n joints, of the r primary (independent) ones, in the order of
        their positions p (r,)."""
        return list(self.equations.closing.primary)

    def follow(self, p: Array, start: Array | None = None) -> Array:
        """Closed configurations (..., n) of the spanning tree's n joints, rad (m if prismatic), at positions `p` (...,
        r) of the r primary (independent) joints, rad (m). They are reached from the closed configurations `start` (...,
        n), or one `start` (n,) for all samples, along straight lines in p, in steps of at most 0.05 rad (m); None
        starts at the reference configuration.

        Raises `SingularityError` where the way comes near a singularity of the loops, the smallest singular value of
        the closure Jacobian with respect to the dependent joints being below 0.05 of that at the reference
        configuration, or where the loops cannot be closed, and `InputError` where `start` does not broadcast to the
        samples of p. Other shapes are not checked.
        """
        samples = p.shape[:-1]
        if start is not None and same_samples(p=p, start=start) != samples:
            raise InputError(f"start: expected one configuration or one for each of {samples}, got {start.shape[:-1]}")
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
            self.require_regular(q[on])
        return q.reshape(*samples, q.shape[-1])

    def follow_alone(self, p: object) -> Array | None:
        """The closed configuration (n,) of the spanning tree's n joints, rad (m if prismatic), at positions `p` (r,) of
        the r primary (independent) joints: what the method `follow` returns from the reference configuration for one
        sample, by native code alone. None where `follow` has to decide: for anything but a float64 array (r,) of finite
        numbers, for more than 10,000 steps, where the test `surely_regular` fails at a step, and as long as native code
        is not worth making (until calls/50 + steps/5,000, counted by `follow`, is 1). Raises nothing."""
        if not self._ways.ready or type(p) is not np.ndarray or p.shape != self._start.shape or p.dtype != np.float64:
            return None
        start: list[float] = self._start.tolist()
        way = [x - x0 for x, x0 in zip(p.tolist(), start, strict=True)]
        steps = max((abs(way[i]) for i in self._looped), default=0.0) / LARGEST_STEP
        if not (math.isfinite(sum(way)) and steps <= MOST):
            return None
        return self._ways.followed_alone(self.reference, start, way, max(math.ceil(steps), 1))

    def reachable(self, p: Array) -> NDArray[np.bool_]:
        """Boolean mask (N,) of N positions `p` (N, r) of the r primary (independent) joints, rad (m if prismatic): True
        for those that `follow` reaches from the reference configuration along a straight line in p. On that line the
        closure Jacobian's smallest singular value, with respect to the dependent joints, must be at least 0.05 of that
        at the reference configuration. Positions out of reach raise no error; shapes are not checked."""
        return self.progress(p) >= 1.0

    def progress(self, p: Array, least: float = NEAREST) -> Array:
        """The fraction (N,), from 0 to 1, of straight lines from the reference configuration to N positions `p` (N, r)
        of the r primary (independent) joints, rad (m if prismatic), along which the method `regularity` gives at least
        `least` (no unit, 0.05 by default). Regularity is 1 at the reference configuration and 0 at a singularity of the
        loops. The fraction is counted in steps of at most 0.05 rad (m) and is 1 for the whole line; NaN gives 0. Shapes
        are not checked."""
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
        """Relative smallest singular value (...), no unit, of the closure Jacobian with respect to the dependent joints
        at configurations `q` (..., n) of the spanning tree's n joints, rad (m if prismatic). It is divided by that at
        the reference configuration, so 1 there and 0 at a singularity of the loops.

        It is 0, too, beyond a singularity (where the Jacobian's determinant has the other sign), where a closure
        residual is 1e-9 m or rad or more, and for NaN. Near a singularity it goes as the square root of the joint-space
        distance to it, so that values below 0.05 are near. Raises `InputError` for another number of joints.
        """
        gap, smallest, sign = self._look(q)
        _, reference, side = self._at_reference
        return np.where((sign == side) & (gap < LOST), smallest / reference, 0.0)

    def surely_regular(self, q: Column, lost: float = LOST) -> Scalar:
        """Indicator of a regular configuration `q` (n,) of the spanning tree's n joints, rad (m if prismatic), a scalar
        of the kind of q: 1.0 where the loops are closed and their regularity is proved to be at least 0.05, else 0.0.
        The regularity is the smallest singular value of the closure Jacobian A (d, d) with respect to the d dependent
        joints over that at the reference configuration.

        Loops count as closed where no entry of the closure residual reaches `lost`, m or rad: 1e-9 by default, more is
        needed in single precision. The singular value is judged by a lower bound on it, 1/|A^-1| with Frobenius' norm.
        The bound is at least 1/sqrt(d) of the value, so that 0.0 may be given to a regularity up to 0.05 sqrt(d).
        Beyond a singularity of the loops the result is 0.0. An exactly singular A raises `ZeroDivisionError` in floats.
        """
        block = self.equations.dependent_block(q)
        factor, units = factored(block), range(len(block))
        inverse = [factor.solve(Column(float(i == j) for j in units)) for i in units]
        square = sum((column @ column for column in inverse[1:]), inverse[0] @ inverse[0])
        _, smallest, side = (float(x) for x in self._at_reference)
        gap: Any = 0.0
        for residual in self.equations.residual(q):
            gap = maximum(gap, absolute(residual))
        regular = where(square * (NEAREST * smallest) ** 2 <= 1.0, 1.0, 0.0)
        regular = where(side * determinant(block) > 0.0, regular, 0.0)
        return where(gap < lost, regular, 0.0)

    def is_regular(self, q: Array) -> NDArray[np.bool_]:
        """Mask (...) of configurations `q` (..., n) of the spanning tree's n joints, rad (m if prismatic): True where
        the loops' `regularity` is at least 0.05. It is the relative smallest singular value of the closure Jacobian
        with respect to the dependent joints, 1 at the reference configuration and 0 at a singularity or where loops are
        open. It is computed only where the test `surely_regular`, which takes a hundredth of the time, does not show
        that. Raises `InputError` for another number of joints."""
        if q.ndim == 1:
            return np.asarray(self._native_sure(q) > 0.0 or bool(self.regularity(q) >= NEAREST))
        regular = self._native_sure.map(q.reshape(-1, q.shape[-1])).reshape(q.shape[:-1]) > 0.0
        left = ~regular
        if left.any():
            regular[left] = self.regularity(q[left]) >= NEAREST
        return np.asarray(regular)

    def require_regular(self, q: Array) -> None:
        """Raise `SingularityError`, with the worst one's primary positions, unless the method `regularity` gives at
        least 0.05 at all configurations `q` (..., n) of the spanning tree's n joints, rad (m if prismatic). It is 1 at
        the reference configuration, 0 at or beyond a singularity of the loops or where they are open. Nothing is
        returned. Raises `InputError` for another number of joints."""
        regularity = np.ravel(self.regularity(q))
        if regularity.size == 0:
            return
        worst = int(regularity.argmin())
        if not regularity[worst] >= NEAREST:
            p = np.reshape(q, (-1, q.shape[-1]))[worst, self.primary]
            raise SingularityError(
                f"the loops are near a singularity at p = {np.round(p, 4).tolist()}: their smallest singular value is "
                f"{regularity[worst]:.2g} of that at the reference, at least {NEAREST} is needed"
            )

    def _steps(self, way: Array) -> NDArray[np.int64]:
        """Number of steps that ways (m, r) need, 1 where they are not finite. A joint that moves no closure needs
        none, and couplings are linear."""
        longest = np.abs(way[:, self._looped]).max(axis=1, initial=0.0)
        finite = np.where(np.isfinite(longest), longest, 0.0)
        return np.maximum(np.ceil(finite / LARGEST_STEP).astype(np.int64), 1)

    def _closed(self, p: Array, q: Array, halvings: int = HALVINGS) -> Array:
        """The closed configurations (m, n) at p (m, r), from closed ones nearby; by way of the middle where Newton's
        steps leave the loops open."""
        found = self._mapped(self._native_closed, p, q)[0]
        left = np.flatnonzero(~(self._gap(found) < OPEN))
        if halvings and len(left):
            middle = self._closed(0.5 * (q[left][:, self.primary] + p[left]), q[left], halvings - 1)
            reached = self._gap(middle) < LOST
            found[left[reached]] = self._closed(p[left[reached]], middle[reached], halvings - 1)
        return found

    def _gap(self, q: Array) -> Array:
        """The largest closure residual (m,) of configurations (m, n)."""
        return np.asarray(np.abs(self._mapped(self._native_look, q)[0]).max(axis=-1), dtype=np.float64)

    def _look(self, q: Array) -> tuple[Array, Array, Array]:
        """The largest closure residual (...), and the dependent block's smallest singular value and sign."""
        residual, block = self._mapped(self._native_look, q)
        size = len(self.equations.closing.dependent)
        block = np.nan_to_num(block).reshape(*q.shape[:-1], size, size)
        smallest = np.asarray(np.linalg.svd(block, compute_uv=False)[..., -1], dtype=np.float64)
        return np.abs(residual).max(axis=-1), smallest, np.sign(np.linalg.det(block))

    @staticmethod
    def _mapped(kernel: Kernel, *arrays: Array) -> list[Array]:
        """A kernel over all samples of arrays (..., n)."""
        samples = np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
        flat = [np.broadcast_to(array, (*samples, array.shape[-1])).reshape(-1, array.shape[-1]) for array in arrays]
        return [out.reshape(*samples, out.shape[-1]) for out in kernel.map(*flat)]

    @cached_property
    def _native_closed(self) -> Kernel:
        """Native, since it is done hundreds of times."""
        sizes = {"p": len(self.primary), "q": len(self.reference)}
        return compile_function(lambda p, q: (self._ahead(p, q),), sizes, name="closed")

    def _ahead(self, p: Column, q: Column) -> Column:
        """The closed configuration at p, from one nearby: along the tangent first, then by Newton's steps."""
        ahead = self.equations.rates(q, p - Column(q[i] for i in self.primary))
        return self.equations.closed(p, q + ahead)

    @cached_property
    def _ways(self) -> StraightWays:
        sizes = len(self.reference), len(self.primary)
        return StraightWays(self._ahead, lambda q: self.surely_regular(q, OPEN), *sizes)

    @cached_property
    def _native_look(self) -> Kernel:
        """The residual and the dependent block, column by column, whose singular values are its transpose's."""

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
    def _start(self) -> Array:
        return self.reference[self.primary]

    @cached_property
    def _looped(self) -> list[int]:
        """The primary joints, by their indices in p, that move a closure."""
        return np.flatnonzero(self.equations.closing.looped).tolist()
