"""Consistent estimates: the minimum of squares and an entropic divergence, by a primal-dual interior-point method."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description.inertia import UNIT_PSEUDO_INERTIAS
from adaptctl.errors import AdaptctlError
from adaptctl.identification.entropic import POSITIVE_WEIGHT, EntropicPrior

# The divergence is its own barrier: x^T A x/2 - b^T x + sum_i w_i (tr(P0_i^-1 P_i) - log det P_i) is least where
# A x - b + w_i P0_i^-1 - Z_i = 0 and P_i Z_i = w_i I, with a multiplier Z_i for each pseudo-inertia P_i. Positive
# parameters are matrices of one entry. Steps of P alone crawl along the cone's edge where data push against it; those
# of P and Z together do not (Nesterov and Todd 1997; corrector of Mehrotra 1992). They are symmetric S and T in
# P = G (V + S) G^T and Z = G^-T (V + T) G^-1, where G makes both the same diagonal V.

# (10, 4, 4): an orthonormal basis of symmetric matrices, and (10, 10) what turns its coordinates into parameters.
PAIRS = [(i, j) for i in range(4) for j in range(i, 4)]
DIRECTIONS = np.zeros((10, 4, 4))
for k, (i, j) in enumerate(PAIRS):
    DIRECTIONS[k, i, j] = DIRECTIONS[k, j, i] = 1.0 if i == j else np.sqrt(0.5)
FROM_DIRECTIONS = np.linalg.inv(np.einsum("aij,kij->ak", DIRECTIONS, UNIT_PSEUDO_INERTIAS))
EYE, FLAT = np.eye(4), DIRECTIONS.reshape(10, 16)
# Logarithm of a factor on the prior's links from which on a search may begin there too, as of logs in another unit.
FAR = np.log(30.0)
# Steps at most of a search from a start until its slope is small, and of any; share of the way to the cone's edge that
# one takes; and share of the multipliers at the start of those that balance the data there.
MAX_WARM_STEPS, MAX_STEPS, EDGE_SHARE, FIRST_SHARE = 15, 60, 0.95, 0.1
# Relative error of P Z and of the slope at which the search ends, that from which on it is near its end, and steps
# there without half as large an error after which round-off is all that is left, as it is where the objective would
# fall by no more than a share of the squares, or by less than a larger one that has not become half as large either.
ERROR, NEAR_END, IDLE_STEPS, LEAST_FALL, SMALL_FALL = 1e-8, 0.1, 4, 1e-14, 1e-10
# Error of the slope below which the corrector is weighed by the square of the predictor's share, and share of a step
# below which one that only centers is tried, on some times the mean of P Z: else some searches go round for ever. Those
# that still do begin again with all correctors weighed so, unless the residual is less than a bound.
SMALL_SLOPE, SHORT, CENTER, ENOUGH = 10.0, 0.3, 3.0, 1e-3
# Sum of the divergence's weights relative to the squares below which it is lost in round-off, and taken to be so large.
LEAST_WEIGHT = 1e-13
# Share of each column's square that is added, since data may not tell columns without a prior apart.
RIDGE_RATIO = 1e-11
# Least eigenvalue of a pseudo-inertia over its largest, clear of round-off.
CONE_MARGIN = 1e-14


def consistent_estimate(A: Array, b: Array, prior: EntropicPrior, weight: float, start: Array | None = None) -> Array:
    """Consistent parameters (P,) that minimise x^T A x/2 - b^T x plus the divergence, searched from a start."""
    if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b))):
        raise AdaptctlError("the sums of the rows' squares are not finite; check the units of the columns")
    told = np.flatnonzero((np.diag(A) > 0.0) | (np.arange(len(b)) < prior.tens.size))
    told = np.union1d(told, prior.positive)
    x = np.zeros(len(b))
    own = EntropicPrior(prior.tens, np.searchsorted(told, prior.positive), prior.scales)
    x[told] = _estimate(_Problem(A[np.ix_(told, told)], b[told], own, weight), None if start is None else start[told])
    return x


def _estimate(problem: _Problem, start: Array | None) -> Array:
    """Consistent parameters of a problem that has no columns without rows."""
    found, prior = list[Array](), problem.prior
    origin = prior.start(len(problem.b))
    first = [] if start is None else [(start, True, SMALL_SLOPE)]
    starts = (origin, *_multiple(problem.A, problem.b, prior))
    others = [(x, False, slope) for slope in (SMALL_SLOPE, np.inf) for x in starts]
    for begun, near, slope in (*first, *others):
        with suppress(np.linalg.LinAlgError, FloatingPointError), np.errstate(over="raise", invalid="raise"):
            most = MAX_WARM_STEPS if near else MAX_STEPS
            point, converged = _searched(problem, problem.start(begun, near), most, slope)
            if converged or (not near and problem.residual(point.x) < ENOUGH):
                return _inside(point.x, prior)
            if np.isfinite(problem.height(point.x)):  # a search that runs away ends at no point
                found.append(point.x)
    return _inside(min(found, key=problem.height, default=origin), prior)


def _multiple(A: Array, b: Array, prior: EntropicPrior) -> list[Array]:
    """Parameters (P,) with a multiple of the prior's links, where the squares ask for one that is far from it."""
    x, links = prior.start(len(b)), np.arange(len(b)) < prior.tens.size
    own = np.where(links, x, 0.0)
    times = float(b @ own) / (float(own @ A @ own) or 1.0)
    return [np.where(links, times * x, x)] if times > 0.0 and abs(np.log(times)) > FAR else []


def _searched(problem: _Problem, point: _Point, most: int, small_slope: float) -> tuple[_Point, bool]:
    """Point at which a search ends, and whether its error is that of round-off."""
    best, lowest, idle = np.inf, np.inf, 0
    for k in range(MAX_STEPS):
        newton = _Newton(problem, point)
        error, fall = newton.error, newton.fall
        if k >= most and newton.slope_error > small_slope:
            break
        idle = idle + 1 if 0.5 * best < error < NEAR_END or 0.5 * lowest < fall < SMALL_FALL else 0
        best, lowest = min(best, error), min(lowest, fall)
        if error < ERROR or idle == IDLE_STEPS or fall < LEAST_FALL:
            return point, True
        try:
            point = newton.next_point(small_slope)
        except np.linalg.LinAlgError:
            break
    return point, False


def optimality_residual(A: Array, b: Array, prior: EntropicPrior, weight: float, x: Array) -> float:
    """Objective at parameters (P,) less its minimum, by Newton's decrement, relative to the fitted sum of squares."""
    return _Problem(A, b, prior, weight).residual(x)


@dataclass(frozen=True, eq=False)
class _Point:
    """Parameters (P,), with G (N, 4, 4) and V (N, 4) of the links, g and v (c,) of positive parameters."""

    x: Array
    scaling: Array
    values: Array
    sizes: Array
    own: Array


@dataclass(frozen=True, eq=False)
class _Problem:
    """Squares x^T A x/2 - b^T x and the divergence from a prior at a weight."""

    A: Array
    b: Array
    prior: EntropicPrior
    weight: float

    @cached_property
    def root(self) -> Array:
        """Matrix F (m, P) with F^T F = A, but for round-off, so that no squares are negative."""
        own = np.diag(self.A)
        size = np.sqrt(np.where(own > 0.0, own, 1.0))
        values, vectors = np.linalg.eigh(self.A / np.outer(size, size))
        kept = values > 0.0
        return np.asarray(np.sqrt(values[kept])[:, None] * vectors[:, kept].T * size)

    @cached_property
    def unit(self) -> Array:
        """Weights (P,) of the divergence for each parameter."""
        out = np.zeros(len(self.b))
        out[: self.prior.tens.size], out[self.prior.positive] = self.weight, POSITIVE_WEIGHT
        return out

    @cached_property
    def penalised(self) -> NDArray[np.bool_]:
        """Mask (P,) of the parameters that have a divergence."""
        return np.asarray(self.unit > 0.0)

    @cached_property
    def ridge(self) -> Array:
        """Curvatures (P,) added for parameters without a divergence."""
        own = np.diag(self.A)
        return np.where(self.penalised, 0.0, np.where(own > 0.0, RIDGE_RATIO * own, 1.0))

    @cached_property
    def degrees(self) -> Array:
        """Weights (4 N + c,) of the eigenvalues."""
        c = len(self.prior.positive)
        return np.concatenate([np.full(4 * len(self.prior.tens), self.weight), np.full(c, POSITIVE_WEIGHT)])

    def height(self, x: Array) -> float:
        """Objective at parameters (P,)."""
        return 0.5 * float(x @ (self.A @ x)) - float(self.b @ x) + self.prior.divergence(x, self.weight)

    def times(self, x: Array) -> float:
        """Factor on the weights: 1, unless the divergence is lost in the squares' round-off."""
        return max(1.0, LEAST_WEIGHT * abs(float(self.b @ x)) / float(self.degrees.sum()))

    def residual(self, x: Array) -> float:
        """Objective at parameters (P,) less its minimum, by Newton's decrement, relative to the fitted squares."""
        prior, times = self.prior, self.times(x)
        with suppress(np.linalg.LinAlgError):
            if np.all(x[prior.positive] > 0.0):
                roots = np.asarray(np.linalg.cholesky(prior.matrices(x)), dtype=np.float64)
                move = _Map.of(roots, x[prior.positive], prior.positive)
                pulled = np.where(self.penalised, prior.gradient(x, self.weight), 0.0)
                slope = move.back(self.A @ x - self.b + times * pulled)
                curved = move.curvature(self.root) + np.diag(times * self.unit + self.ridge)
                return float(0.5 * slope @ _solver(curved)(slope) / (abs(float(self.b @ x)) + self.weight))
        return np.inf

    def start(self, x: Array, near: bool = False) -> _Point:
        """Point at parameters, those of any sign where least, with multipliers of the end or by the data's push."""
        prior, free, c = self.prior, ~self.penalised, len(self.prior.positive)
        x = x.copy()
        if free.any():
            x[free] = 0.0
            solved = _solver((self.A + np.diag(self.ridge))[np.ix_(free, free)])
            x[free] = solved((self.b - self.A @ x)[free])
        roots, own = np.asarray(np.linalg.cholesky(prior.matrices(x)), dtype=np.float64), x[prior.positive]
        slope = self.A @ x - self.b + np.where(free, 0.0, prior.gradient(x, self.weight))
        pushed = np.abs(_Map.of(roots, own, prior.positive).back(slope))
        far = FIRST_SHARE * float(np.max(pushed[~free] / self.unit[~free], initial=1.0))
        times = 1.0 if near else max(1.0, far)
        values, sizes = np.sqrt(times * self.weight), np.sqrt(times * POSITIVE_WEIGHT)
        return _Point(x, roots / np.sqrt(values), np.full((len(roots), 4), values), own / sizes, np.full(c, sizes))


@dataclass(frozen=True, eq=False)
class _Newton:
    """Newton's equations at a point, scaled by G."""

    problem: _Problem
    point: _Point

    @cached_property
    def times(self) -> float:
        """Factor on the weights at the end."""
        return self.problem.times(self.point.x)

    @cached_property
    def map(self) -> _Map:
        """Changes of the parameters by unit steps."""
        return _Map.of(self.point.scaling, self.point.sizes, self.problem.prior.positive)

    @cached_property
    def ratios(self) -> Array:
        """Eigenvalues (4 N + c,) of P Z over those at the end."""
        squares = np.concatenate([self.point.values.ravel(), self.point.own]) ** 2
        return np.asarray(squares / (self.times * self.problem.degrees))

    @cached_property
    def spread(self) -> float:
        """Mean of the ratios."""
        return float(self.ratios.mean())

    @cached_property
    def slope(self) -> Array:
        """Slope (P,) of the Lagrangian by unit steps."""
        problem, point, G = self.problem, self.point, self.point.scaling
        out = self.map.back(problem.A @ point.x - problem.b)
        pull = self.times * problem.weight * G.mT @ problem.prior.inverses @ G
        own = self.times * POSITIVE_WEIGHT * point.sizes / problem.prior.scales
        return np.asarray(out + self.joined(pull - _diagonal(point.values), own - point.own))

    @cached_property
    def slope_error(self) -> float:
        """Largest relative error of the slope."""
        kept = self.problem.penalised
        slopes = np.abs(self.slope[kept]) / np.sqrt(self.times * self.problem.unit[kept])
        return float(slopes.max(initial=0.0))

    @property
    def error(self) -> float:
        """Largest relative error of P Z and of the slope."""
        return max(float(np.abs(self.ratios - 1.0).max(initial=0.0)), self.slope_error)

    @property
    def fall(self) -> float:
        """Most by which the objective would fall, by the slope and by P Z, relative to the fitted squares."""
        problem, slope = self.problem, self.slope
        size = abs(float(problem.b @ self.point.x)) + problem.weight
        gap = self.times * float(problem.degrees @ np.abs(self.ratios - 1.0)) / size
        return gap if gap > LEAST_FALL else gap + 0.5 * float(slope @ self.solver(slope)) / size

    @cached_property
    def solver(self) -> Callable[[Array], Array]:
        """Solver of Newton's equations."""
        problem = self.problem
        return _solver(self.map.curvature(problem.root) + np.diag(problem.penalised + problem.ridge))

    def joined(self, matrices: Array, own: Array) -> Array:
        """Step (P,) of symmetric matrices (N, 4, 4) and positive parameters (c,)."""
        out = np.zeros(len(self.point.x))
        out[: self.problem.prior.tens.size] = _coordinates(matrices).ravel()
        out[self.problem.prior.positive] = own
        return out

    def parted(self, step: Array) -> tuple[Array, Array]:
        """Symmetric matrices (N, 4, 4) and positive parameters (c,) of a step (P,)."""
        links = step[: self.problem.prior.tens.size].reshape(-1, 10)
        return (links @ FLAT).reshape(-1, 4, 4), step[self.problem.prior.positive]

    def step(self, target: float, bent: Array | float = 0.0, own: Array | float = 0.0) -> tuple[Array, Array]:
        """Steps (P,) of parameters and of multipliers to eigenvalues of P Z a target times those at the end."""
        V, v, times = self.point.values, self.point.own, target * self.times
        wanted = _diagonal(times * self.problem.weight - V**2) - bent
        sums = self.joined(2.0 * wanted / (V[:, :, None] + V[:, None, :]), (times * POSITIVE_WEIGHT - v**2 - own) / v)
        step = self.solver(sums - self.slope)
        return step, np.where(self.problem.penalised, sums - step, 0.0)

    def share(self, steps: tuple[Array, Array], most: float) -> float:
        """Share of steps that is within some share of the way to the cone's edge, at most 1."""
        root = 1.0 / np.sqrt(self.point.values)
        scale = root[:, :, None] * root[:, None, :]
        (S, s), (T, t) = map(self.parted, steps)
        values = np.linalg.eigvalsh(np.stack([S * scale, T * scale]))[..., 0]
        least = min(values.min(initial=0.0), (np.minimum(s, t) / self.point.own).min(initial=0.0))
        return min(1.0, most / max(-least, 1e-12))

    def next_point(self, small_slope: float) -> _Point:
        """Point after a step with Mehrotra's corrector, or after one that only centers, if that is longer."""
        (S, s), (T, t) = map(self.parted, predicted := self.step(1.0))
        share = self.share(predicted, 1.0)
        V, v = _diagonal(self.point.values), self.point.own
        after = float(np.sum((V + share * S) * (V + share * T))) / self.problem.weight
        after += float(np.sum((v + share * s) * (v + share * t))) / POSITIVE_WEIGHT
        mean = after / (self.times * len(self.ratios))
        left = min(max((mean - 1.0) / (self.spread - 1.0), 0.0), 1.0) if self.spread > 1.0 + 1e-12 else 0.0
        target = 1.0 + left * max(self.spread - 1.0, 0.0)
        near = self.slope_error < small_slope
        bent = share**2 if near else 1.0
        steps = self.step(target, 0.5 * bent * (S @ T + T @ S), bent * s * t)
        taken = self.share(steps, EDGE_SHARE)
        if taken < SHORT:
            centering = self.step(CENTER * self.spread)
            if (other := self.share(centering, EDGE_SHARE)) > taken:
                return self.moved(*centering, other)
        return self.moved(*steps, taken)

    def moved(self, step: Array, other: Array, share: float) -> _Point:
        """Point after a share of the steps of parameters and of multipliers."""
        (S, s), (T, t) = self.parted(share * step), self.parted(share * other)
        V = _diagonal(self.point.values)
        root, other_root = np.linalg.cholesky(V + S), np.linalg.cholesky(V + T)
        _, values, turn = np.linalg.svd(other_root.mT @ root)
        scaling = self.point.scaling @ root @ turn.mT / np.sqrt(values)[:, None, :]
        p, z = self.point.own + s, self.point.own + t
        x = self.point.x + self.map.forth(share * step)
        matrices = scaling * values[:, None, :] @ scaling.mT
        x[: self.problem.prior.tens.size] = (_coordinates(matrices) @ FROM_DIRECTIONS.T).ravel()
        x[self.problem.prior.positive] = self.point.sizes * p
        return _Point(x, scaling, values, self.point.sizes * np.sqrt(p / z), np.sqrt(p * z))


@dataclass(frozen=True, eq=False)
class _Map:
    """Changes of the parameters by unit steps: a block (N, 10, 10) for each link, sizes (c,) of positive parameters."""

    blocks: Array
    sizes: Array
    positive: NDArray[np.int64]

    @classmethod
    def of(cls, scaling: Array, sizes: Array, positive: NDArray[np.int64]) -> _Map:
        """Map of steps S by G S G^T, and of positive parameters' by their sizes."""
        G = scaling[:, None]
        return cls(FROM_DIRECTIONS @ _coordinates(G @ DIRECTIONS @ G.mT).mT, sizes, positive)

    def forth(self, step: Array) -> Array:
        """Changes (P,) of the parameters by a step (P,)."""
        return self._applied(self.blocks, step)

    def back(self, slope: Array) -> Array:
        """Slope (P,) by unit steps, from that by parameters (P,)."""
        return self._applied(self.blocks.mT, slope)

    def curvature(self, root: Array) -> Array:
        """Curvature (P, P) of squares F^T F by unit steps, from F (m, P)."""
        rows = self._applied(self.blocks.mT, root.T).T
        return np.asarray(rows.T @ rows)

    def _applied(self, blocks: Array, values: Array) -> Array:
        count, out = 10 * len(blocks), np.array(values)
        out[:count] = (blocks @ values[:count].reshape(len(blocks), 10, -1)).reshape(out[:count].shape)
        out[self.positive] = (self.sizes * values[self.positive].T).T
        return out


def _coordinates(matrices: Array) -> Array:
    return np.asarray(matrices.reshape(*matrices.shape[:-2], 16) @ FLAT.T)


def _diagonal(values: Array) -> Array:
    return np.asarray(values[:, :, None] * EYE)


def _solver(matrix: Array) -> Callable[[Array], Array]:
    """Solver of positive definite equations, with a little more on the diagonal where round-off asks for it."""
    own = np.abs(np.diag(matrix))  # round-off makes some negative
    scale = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
    scaled = matrix * np.outer(scale, scale)
    for more in (0.0, 1e-15, 1e-14, 1e-13, 1e-12, 1e-11, 1e-9, 1e-7):
        with suppress(np.linalg.LinAlgError):
            raised = scaled + more * np.eye(len(scaled)) if more else scaled
            np.linalg.cholesky(raised)
            return lambda wanted: np.asarray(scale * np.linalg.solve(raised, scale * wanted))
    values, vectors = np.linalg.eigh(scaled)
    inverse = vectors / np.maximum(values, 1e-7 * values[-1]) @ vectors.T
    return lambda wanted: np.asarray(scale * (inverse @ (scale * wanted)))


def _inside(x: Array, prior: EntropicPrior) -> Array:
    """Parameters (P,) of which round-off has left none outside the cone: a little nearer to the prior, if need be."""
    links = np.arange(len(x)) < prior.tens.size
    for share in (0.0, *np.geomspace(1e-13, 1.0, 27).tolist()):
        near = np.where(links, x + share * (prior.start(len(x)) - x), x)
        values = np.linalg.eigvalsh(prior.matrices(near))
        if np.all(values[:, 0] > CONE_MARGIN * values[:, -1]):
            return near
    return prior.start(len(x))
