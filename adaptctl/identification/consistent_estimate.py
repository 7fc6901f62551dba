"""Consistent estimates: the minimum of squares and an entropic divergence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.errors import AdaptctlError
from adaptctl.identification.entropic import EntropicPrior
from adaptctl.identification.interior_point import LEAP, LEAST_FALL, Newton, Points, Problems

# Logarithm of a factor on the prior's links from which on a search may begin there too, as of logs in another unit.
FAR = np.log(30.0)
# Steps at most of a search from a start until its slope is small, and of any.
MAX_WARM_STEPS, MAX_STEPS = 15, 60
# Relative error of P Z and of the slope at which the search ends, that from which on it is near its end, and steps
# there without half as large an error after which round-off is all that is left, as it is where the objective would
# fall by no more than a share of the squares, or by less than a larger one that has not become half as large either.
ERROR, NEAR_END, IDLE_STEPS, SMALL_FALL = 1e-8, 0.1, 4, 1e-10
# Error of the slope below which the corrector is weighed by the square of the predictor's share. Searches that go round
# for ever begin again with all correctors weighed so, unless the residual is less than a bound.
SMALL_SLOPE, ENOUGH = 10.0, 1e-3
# Least eigenvalue of a pseudo-inertia over its largest, clear of round-off.
CONE_MARGIN = 1e-14


def consistent_estimate(A: Array, b: Array, prior: EntropicPrior, weight: float, start: Array | None = None) -> Array:
    """Consistent parameters (P,) that minimise x^T A x/2 - b^T x plus the divergence, searched from a start."""
    return consistent_estimates(A[None], b[None], prior, weight, None if start is None else start[None])[0]


def consistent_estimates(A: Array, b: Array, prior: EntropicPrior, weight: float, starts: Array | None = None) -> Array:
    """Consistent parameters (m, P) of several problems, searched together from starts (m, P)."""
    if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b))):
        raise AdaptctlError("the sums of the rows' squares are not finite; check the units of the columns")
    some = np.any(np.diagonal(A, axis1=1, axis2=2) > 0.0, axis=0)
    told = np.union1d(np.flatnonzero(some | (np.arange(len(some)) < prior.tens.size)), prior.positive)
    x = np.zeros_like(b)
    own = EntropicPrior(prior.tens, np.searchsorted(told, prior.positive), prior.scales)
    problem = Problems.made(A[:, told[:, None], told], b[:, told], own, weight)
    x[:, told] = _estimates(problem, None if starts is None else starts[:, told])
    return x


def _estimates(problem: Problems, starts: Array | None) -> Array:
    """Consistent parameters (m, P) of problems that have no columns without rows."""
    origin = np.tile(problem.prior.start(problem.b.shape[-1]), (len(problem.b), 1))
    x, left = origin.copy(), np.arange(len(origin))
    found: list[list[Array]] = [[] for _ in x]
    for begun, near, slope in _starts(problem, origin, starts):
        for k, (end, converged) in zip(left.tolist(), _ends(problem.of(left), begun[left], near, slope), strict=True):
            own, here = problem.of([k]), bool(np.all(np.isfinite(end)))
            if converged or (here and not near and own.residual(end[None]) < ENOUGH):
                x[k], left = end, left[left != k]
            elif here and np.isfinite(own.height(end)):  # a search that runs away ends at no point
                found[k].append(end)
        if not len(left):
            break
    for k in left.tolist():
        x[k] = min(found[k], key=problem.of([k]).height, default=x[k])
    return np.stack([_inside(own, problem.prior) for own in x])


def _starts(problem: Problems, origin: Array, starts: Array | None) -> Iterator[tuple[Array, bool, float]]:
    """Starts (m, P) of searches, whether they are near the end, and the error of a slope that is small."""
    if starts is not None:
        yield starts, True, SMALL_SLOPE
    each = [origin, *_multiple(problem, origin)]
    yield from ((x, False, slope) for slope in (SMALL_SLOPE, np.inf) for x in each)


def _multiple(problem: Problems, x: Array) -> Iterator[Array]:
    """Parameters (m, P) with multiples of the prior's links, where the squares ask for some that are far from it."""
    links = np.arange(x.shape[-1]) < problem.prior.tens.size
    own = np.where(links, x, 0.0)
    square = np.einsum("mi,mij,mj->m", own, problem.A, own)
    times = np.einsum("mi,mi->m", problem.b, own) / np.where(square == 0.0, 1.0, square)
    far = np.maximum(times, 1.0 / times, where=times > 0.0, out=np.zeros_like(times)) > np.exp(FAR)
    if far.any():
        yield np.where(far[:, None] & links, times[:, None] * x, x)


def _ends(problem: Problems, x: Array, near: bool, slope: float) -> list[tuple[Array, bool]]:
    """Parameters (P,) at which searches from (m, P) end, and whether they are minima."""
    with suppress(np.linalg.LinAlgError, FloatingPointError), np.errstate(over="raise", invalid="raise"):
        ends, converged = _searched(problem, problem.start(x, near), MAX_WARM_STEPS if near else MAX_STEPS, slope)
        return list(zip(ends, converged.tolist(), strict=True))
    if len(x) == 1:
        return [(np.full(x.shape[-1], np.nan), False)]
    return [end for k in range(len(x)) for end in _ends(problem.of([k]), x[[k]], near, slope)]


def _searched(problem: Problems, point: Points, most: int, small_slope: float) -> tuple[Array, NDArray[np.bool_]]:
    """Parameters (m, P) at which searches end, and a mask (m,) of those whose error is that of round-off."""
    x, converged = point.x.copy(), np.zeros(len(point.x), dtype=bool)
    on, idle = np.arange(len(x)), np.zeros(len(x))
    best, lowest = np.full((2, len(x)), np.inf)
    cold = most == MAX_STEPS
    leap = LEAP if cold else np.inf  # the multipliers of starts near the end may have yet to grow, as slopes tell
    for k in range(MAX_STEPS):
        newton = Newton(problem, point)
        error, fall = newton.error, newton.fall
        slow = (0.5 * best < error) & (error < NEAR_END) | (0.5 * lowest < fall) & (fall < SMALL_FALL)
        slow &= cold | (newton.slope_error <= small_slope)
        idle, best, lowest = np.where(slow, idle + 1, 0), np.minimum(best, error), np.minimum(lowest, fall)
        stuck = newton.slope_error > small_slope if k >= most else np.zeros(len(on), dtype=bool)
        ended = ~stuck & ((error < ERROR) | (idle == IDLE_STEPS) | (fall < LEAST_FALL))
        converged[on] = ended
        if not (go := ~(ended | stuck)).all():
            on, idle, best, lowest = on[go], idle[go], best[go], lowest[go]
            problem, point = problem.of(go), point.of(go)
            newton = Newton(problem, point)
        if not len(on):
            break
        try:
            point = newton.next_point(small_slope, leap)
        except np.linalg.LinAlgError:
            if len(on) > 1:
                raise
            break
        x[on] = point.x
    return x, converged


def optimality_residual(A: Array, b: Array, prior: EntropicPrior, weight: float, x: Array) -> float:
    """Objective at parameters (P,) less its minimum, by Newton's decrement, relative to the fitted sum of squares."""
    return Problems.made(A[None], b[None], prior, weight).residual(x[None])


def _inside(x: Array, prior: EntropicPrior) -> Array:
    """Parameters (P,) of which round-off has left none outside the cone: a little nearer to the prior, if need be."""
    links = np.arange(len(x)) < prior.tens.size
    for share in (0.0, *np.geomspace(1e-13, 1.0, 27).tolist()):
        near = np.where(links, x + share * (prior.start(len(x)) - x), x)
        values = np.linalg.eigvalsh(prior.matrices(near))
        if np.all(values[:, 0] > CONE_MARGIN * values[:, -1]):
            return near
    return prior.start(len(x))
