"""Primal-dual interior-point steps of several searches at once: minima of squares and an entropic divergence."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description.inertia import UNIT_PSEUDO_INERTIAS
from adaptctl.identification.entropic import POSITIVE_WEIGHT, EntropicPrior

# The divergence is its own barrier: x^T A x/2 - b^T x + sum_i w_i (tr(P0_i^-1 P_i) - log det P_i) is least where
# A x - b + w_i P0_i^-1 - Z_i = 0 and P_i Z_i = w_i I, with a multiplier Z_i for each pseudo-inertia P_i. Positive
# parameters are matrices of one entry. Steps of P alone crawl along the cone's edge where data push against it; those
# of P and Z together do not (Nesterov and Todd 1997; corrector of Mehrotra 1992). They are symmetric S and T in
# P = G (V + S) G^T and Z = G^-T (V + T) G^-1, where G makes both the same diagonal V.
# NumPy's overhead outweighs the arithmetic of one search: the first axis of all arrays is that of m searches.

# (10, 4, 4): an orthonormal basis of symmetric matrices, and (10, 10) what turns its coordinates into parameters.
PAIRS = [(i, j) for i in range(4) for j in range(i, 4)]
DIRECTIONS = np.zeros((10, 4, 4))
for k, (i, j) in enumerate(PAIRS):
    DIRECTIONS[k, i, j] = DIRECTIONS[k, j, i] = 1.0 if i == j else np.sqrt(0.5)
FROM_DIRECTIONS = np.linalg.inv(np.einsum("aij,kij->ak", DIRECTIONS, UNIT_PSEUDO_INERTIAS))
FLAT = DIRECTIONS.reshape(10, 16)
# Share of the way to the cone's edge that a step takes, and share of the multipliers at the start of those that balance
# the data there.
EDGE_SHARE, FIRST_SHARE = 0.95, 0.1
# Factor on the mean of P Z beyond which a step has too much of the corrector, and share of a step below which one that
# only centers is tried, on some times that mean: else some searches go round for ever.
LEAP, SHORT, CENTER = 10.0, 0.3, 3.0
# Fall of the objective over the squares below which it is round-off.
LEAST_FALL = 1e-14
# Sum of the divergence's weights relative to the squares below which it is lost in round-off, and taken to be so large.
LEAST_WEIGHT = 1e-13
# Share of each column's square that is added, since data may not tell columns without a prior apart.
RIDGE_RATIO = 1e-11

# Steps (m, P) of parameters and of multipliers, and shares (m,) of them.
Move = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Points:
    """Parameters (m, P), with G (m, N, 4, 4) and V (m, N, 4) of the links, g and v (m, c) of positive parameters."""

    x: Array
    scaling: Array
    values: Array
    sizes: Array
    own: Array

    def of(self, which: NDArray[np.bool_]) -> Points:
        """Points of some searches."""
        return Points(*(part[which] for part in (self.x, self.scaling, self.values, self.sizes, self.own)))


@dataclass(frozen=True, eq=False)
class Problems:
    """Squares x^T A x/2 - b^T x of matrices (m, P, P) and (m, P), F^T F = A, and the divergence at a weight."""

    A: Array
    b: Array
    root: Array
    prior: EntropicPrior
    weight: float

    @classmethod
    def made(cls, A: Array, b: Array, prior: EntropicPrior, weight: float) -> Problems:
        """Problems with their matrices F (m, P, P), but for round-off, so that no squares are negative."""
        own = np.diagonal(A, axis1=-2, axis2=-1)
        size = np.sqrt(np.where(own > 0.0, own, 1.0))
        roots = _roots(_definite(A / (size[..., :, None] * size[..., None, :])))
        return cls(A, b, roots.mT * size[..., None, :], prior, weight)

    def of(self, which: NDArray[np.bool_ | np.int64] | list[int]) -> Problems:
        """Some of the problems."""
        return replace(self, A=self.A[which], b=self.b[which], root=self.root[which])

    @cached_property
    def unit(self) -> Array:
        """Weights (P,) of the divergence for each parameter."""
        out = np.zeros(self.b.shape[-1])
        out[: self.prior.tens.size], out[self.prior.positive] = self.weight, POSITIVE_WEIGHT
        return out

    @cached_property
    def penalised(self) -> NDArray[np.bool_]:
        """Mask (P,) of the parameters that have a divergence."""
        return np.asarray(self.unit > 0.0)

    @cached_property
    def ridge(self) -> Array:
        """Curvatures (m, P) added for parameters without a divergence."""
        own = np.diagonal(self.A, axis1=-2, axis2=-1)
        return np.where(self.penalised, 0.0, np.where(own > 0.0, RIDGE_RATIO * own, 1.0))

    @cached_property
    def degrees(self) -> Array:
        """Weights (4 N + c,) of the eigenvalues."""
        c = len(self.prior.positive)
        return np.concatenate([np.full(4 * len(self.prior.tens), self.weight), np.full(c, POSITIVE_WEIGHT)])

    def height(self, x: Array) -> float:
        """Objective of the first problem at parameters (P,)."""
        return 0.5 * float(x @ (self.A[0] @ x)) - float(self.b[0] @ x) + self.prior.divergence(x, self.weight)

    def slope(self, x: Array) -> Array:
        """Slope (m, P) of the squares at parameters (m, P)."""
        return _product(self.A, x) - self.b

    def fitted(self, x: Array) -> Array:
        """Fitted squares (m,)."""
        return np.abs(_inner(self.b, x))

    def times(self, x: Array) -> Array:
        """Factors (m,) on the weights: 1, unless the divergence is lost in the squares' round-off."""
        return np.maximum(1.0, LEAST_WEIGHT * self.fitted(x) / self.degrees.sum())

    def residual(self, x: Array) -> float:
        """Objective of one problem at parameters (1, P) over its minimum, by Newton's decrement, over its squares."""
        prior, times = self.prior, self.times(x)[:, None]
        with suppress(np.linalg.LinAlgError):
            if np.all(x[:, prior.positive] > 0.0):
                move = Map.of(_roots(prior.matrices(x)), x[:, prior.positive], prior.positive)
                pulled = np.where(self.penalised, prior.gradient(x, self.weight), 0.0)
                slope = move.back(self.slope(x) + times * pulled)
                curved = move.curvature(self.root) + diagonal(times * self.unit + self.ridge)
                return float(0.5 * slope[0] @ solver(curved)(slope)[0] / (self.fitted(x)[0] + self.weight))
        return np.inf

    def start(self, x: Array, near: bool = False) -> Points:
        """Points at parameters, those of any sign where least, with multipliers of the end or by the data's push."""
        prior, free, c = self.prior, ~self.penalised, len(self.prior.positive)
        x = x.copy()
        if free.any():
            x[:, free] = 0.0
            x[:, free] = solver((self.A + diagonal(self.ridge))[:, free][:, :, free])(-self.slope(x)[:, free])
        roots, own = _roots(prior.matrices(x)), x[:, prior.positive]
        slope = self.slope(x) + np.where(free, 0.0, prior.gradient(x, self.weight))
        pushed = np.abs(Map.of(roots, own, prior.positive).back(slope))[:, ~free] / self.unit[~free]
        far = np.maximum(FIRST_SHARE * pushed.max(axis=1, initial=1.0), 1.0)
        times = np.sqrt(np.ones(len(x)) if near else far)[:, None]
        values, sizes = times * np.sqrt(self.weight), times * np.sqrt(POSITIVE_WEIGHT)
        scaling = roots / np.sqrt(values)[:, :, None, None]
        each = np.repeat(values[:, :, None], len(prior.tens), 1).repeat(4, 2)
        return Points(x, scaling, each, own / sizes, np.repeat(sizes, c, 1))


@dataclass(frozen=True, eq=False)
class Newton:
    """Newton's equations at points, scaled by G."""

    problem: Problems
    point: Points

    @cached_property
    def times(self) -> Array:
        """Factors (m,) on the weights at the end."""
        return self.problem.times(self.point.x)

    @cached_property
    def map(self) -> Map:
        """Changes of the parameters by unit steps."""
        return Map.of(self.point.scaling, self.point.sizes, self.problem.prior.positive)

    @cached_property
    def ratios(self) -> Array:
        """Eigenvalues (m, 4 N + c) of P Z over those at the end."""
        values = self.point.values.reshape(len(self.times), -1)
        squares = np.concatenate([values, self.point.own], axis=1) ** 2
        return np.asarray(squares / (self.times[:, None] * self.problem.degrees))

    @cached_property
    def spread(self) -> Array:
        """Means (m,) of the ratios."""
        return np.asarray(self.ratios.mean(axis=1))

    @cached_property
    def slope(self) -> Array:
        """Slopes (m, P) of the Lagrangian by unit steps."""
        problem, point, G = self.problem, self.point, self.point.scaling
        out = self.map.back(problem.slope(point.x))
        pull = _wide(self.times, 4) * problem.weight * G.mT @ problem.prior.inverses @ G
        own = self.times[:, None] * POSITIVE_WEIGHT * point.sizes / problem.prior.scales
        return np.asarray(out + self.joined(pull - diagonal(point.values), own - point.own))

    @cached_property
    def slope_error(self) -> Array:
        """Largest relative errors (m,) of the slopes."""
        kept = self.problem.penalised
        slopes = np.abs(self.slope[:, kept]) / np.sqrt(self.times[:, None] * self.problem.unit[kept])
        return np.asarray(slopes.max(axis=1, initial=0.0))

    @property
    def error(self) -> Array:
        """Largest relative errors (m,) of P Z and of the slopes."""
        return np.maximum(np.abs(self.ratios - 1.0).max(axis=1, initial=0.0), self.slope_error)

    @property
    def fall(self) -> Array:
        """Most (m,) by which the objectives would fall, by the slopes and by P Z, relative to the fitted squares."""
        size = self.problem.fitted(self.point.x) + self.problem.weight
        gap = self.times * (np.abs(self.ratios - 1.0) @ self.problem.degrees) / size
        low = gap <= LEAST_FALL
        return gap + 0.5 * _inner(self.slope, self.solver(self.slope)) / size * low if low.any() else gap

    @cached_property
    def solver(self) -> Callable[[Array], Array]:
        """Solver of Newton's equations."""
        problem = self.problem
        return solver(self.map.curvature(problem.root) + diagonal(problem.penalised + problem.ridge))

    def joined(self, matrices: Array, own: Array) -> Array:
        """Steps (m, P) of symmetric matrices (m, N, 4, 4) and positive parameters (m, c)."""
        out = np.zeros_like(self.point.x)
        out[:, : self.problem.prior.tens.size] = _coordinates(matrices).reshape(len(out), -1)
        out[:, self.problem.prior.positive] = own
        return out

    def parted(self, step: Array) -> tuple[Array, Array]:
        """Symmetric matrices (m, N, 4, 4) and positive parameters (m, c) of steps (m, P)."""
        links = step[:, : self.problem.prior.tens.size].reshape(len(step), -1, 10)
        return (links @ FLAT).reshape(*links.shape[:2], 4, 4), step[:, self.problem.prior.positive]

    def step(self, target: Array, bent: Array | float = 0.0, own: Array | float = 0.0) -> tuple[Array, Array]:
        """Steps (m, P) of parameters and of multipliers to eigenvalues of P Z targets (m,) times those at the end."""
        V, v, times = self.point.values, self.point.own, target * self.times
        wanted = diagonal(_wide(times, 3) * self.problem.weight - V**2) - bent
        positive = (times[:, None] * POSITIVE_WEIGHT - v**2 - own) / v
        sums = self.joined(2.0 * wanted / (V[..., :, None] + V[..., None, :]), positive)
        step = self.solver(sums - self.slope)
        return step, np.where(self.problem.penalised, sums - step, 0.0)

    def share(self, steps: tuple[Array, Array], most: float) -> Array:
        """Shares (m,) of steps that are within some share of the way to the cone's edge, at most 1."""
        root = 1.0 / np.sqrt(self.point.values)
        scale = root[..., :, None] * root[..., None, :]
        (S, s), (T, t) = map(self.parted, steps)
        values = np.linalg.eigvalsh(np.concatenate([S * scale, T * scale], axis=1))[..., 0]
        own = np.minimum(s, t) / self.point.own
        least = np.minimum(values.min(axis=1, initial=0.0), own.min(axis=1, initial=0.0))
        return np.minimum(1.0, most / np.maximum(-least, 1e-12))

    def next_point(self, small_slope: float, leap: float = LEAP) -> Points:
        """Points after steps with Mehrotra's corrector, or less of it, or after those that only center."""
        predicted = self.step(np.ones(len(self.times)))
        share = self.share(predicted, 1.0)
        target = np.clip(self._mean(*predicted, share), 1.0, np.maximum(self.spread, 1.0))
        best = self._corrected(predicted, target, np.where(self.slope_error < small_slope, share**2, 1.0))
        for bent in (share**2, np.zeros(len(share))):
            if not np.any(leaps := self._mean(*best) > leap * self.spread):
                break
            best = _chosen(leaps, self._corrected(predicted, target, bent), best)
        if np.any(short := best[2] < SHORT):
            centering = self._within(self.step(CENTER * self.spread))
            best = _chosen(short & (centering[2] > best[2]), centering, best)
        return self.moved(*best)

    def _corrected(self, predicted: tuple[Array, Array], target: Array, bent: Array) -> Move:
        """Steps to targets (m,) with shares (m,) of the products that the predicted ones leave, and how far to go."""
        (S, s), (T, t) = map(self.parted, predicted)
        return self._within(self.step(target, 0.5 * _wide(bent, 4) * (S @ T + T @ S), bent[:, None] * s * t))

    def _within(self, steps: tuple[Array, Array]) -> Move:
        return *steps, self.share(steps, EDGE_SHARE)

    def _mean(self, step: Array, other: Array, share: Array) -> Array:
        """Means (m,) of the ratios after shares (m,) of the steps of parameters and of multipliers."""
        (S, s), (T, t) = map(self.parted, (step, other))
        V, v = diagonal(self.point.values), self.point.own
        after = np.sum((V + _wide(share, 4) * S) * (V + _wide(share, 4) * T), axis=(1, 2, 3)) / self.problem.weight
        after += np.sum((v + share[:, None] * s) * (v + share[:, None] * t), axis=1) / POSITIVE_WEIGHT
        return np.asarray(after / (self.times * self.ratios.shape[1]))

    def moved(self, step: Array, other: Array, share: Array) -> Points:
        """Points after shares (m,) of the steps of parameters and of multipliers."""
        (S, s), (T, t) = self.parted(share[:, None] * step), self.parted(share[:, None] * other)
        V, point, prior = diagonal(self.point.values), self.point, self.problem.prior
        root, other_root = _roots(V + S), _roots(V + T)
        _, values, turn = np.linalg.svd(other_root.mT @ root)
        scaling = point.scaling @ root @ turn.mT / np.sqrt(values)[..., None, :]
        p, z = point.own + s, point.own + t
        x = point.x + self.map.forth(share[:, None] * step)
        matrices = scaling * values[..., None, :] @ scaling.mT
        x[:, : prior.tens.size] = (_coordinates(matrices) @ FROM_DIRECTIONS.T).reshape(len(x), -1)
        x[:, prior.positive] = point.sizes * p
        return Points(x, scaling, values, point.sizes * np.sqrt(p / z), np.sqrt(p * z))


@dataclass(frozen=True, eq=False)
class Map:
    """Changes of the parameters by unit steps: a block (m, N, 10, 10) a link, sizes (m, c) of positive parameters."""

    blocks: Array
    sizes: Array
    positive: NDArray[np.int64]

    @classmethod
    def of(cls, scaling: Array, sizes: Array, positive: NDArray[np.int64]) -> Map:
        """Map of steps S by G S G^T, and of positive parameters' by their sizes."""
        G = scaling[:, :, None]
        return cls(FROM_DIRECTIONS @ _coordinates(G @ DIRECTIONS @ G.mT).mT, sizes, positive)

    def forth(self, step: Array) -> Array:
        """Changes (m, P) of the parameters by steps (m, P)."""
        return self._applied(self.blocks, step[..., None])[..., 0]

    def back(self, slope: Array) -> Array:
        """Slopes (m, P) by unit steps, from those by parameters (m, P)."""
        return self._applied(self.blocks.mT, slope[..., None])[..., 0]

    def curvature(self, root: Array) -> Array:
        """Curvatures (m, P, P) of squares F^T F by unit steps, from F (m, P, P)."""
        rows = self._applied(self.blocks.mT, root.mT)
        return np.asarray(rows @ rows.mT)

    def _applied(self, blocks: Array, values: Array) -> Array:
        count, out = 10 * blocks.shape[1], np.array(values)
        links = values[:, :count].reshape(*blocks.shape[:2], 10, -1)
        out[:, :count] = (blocks @ links).reshape(out[:, :count].shape)
        out[:, self.positive] = self.sizes[..., None] * values[:, self.positive]
        return out


def _chosen(which: NDArray[np.bool_], some: Move, others: Move) -> Move:
    """Some steps and their shares where a mask (m,) says so, else others."""
    step, other = (np.where(which[:, None], *both) for both in zip(some[:2], others[:2], strict=True))
    return step, other, np.where(which, some[2], others[2])


def _coordinates(matrices: Array) -> Array:
    return np.asarray(matrices.reshape(*matrices.shape[:-2], 16) @ FLAT.T)


def diagonal(values: Array) -> Array:
    """Diagonal matrices (..., n, n) of values (..., n)."""
    return np.asarray(values[..., :, None] * np.eye(values.shape[-1]))


def _wide(values: Array, axes: int) -> Array:
    return values.reshape(-1, *[1] * (axes - 1))


def _roots(matrices: Array) -> Array:
    return np.asarray(np.linalg.cholesky(matrices), dtype=np.float64)


def _product(matrices: Array, vectors: Array) -> Array:
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def _inner(one: Array, other: Array) -> Array:
    return np.einsum("mi,mi->m", one, other)


def solver(matrices: Array) -> Callable[[Array], Array]:
    """Solver of positive definite equations (m, P, P), with a little more on diagonals where round-off asks for it."""
    own = np.abs(np.diagonal(matrices, axis1=-2, axis2=-1))  # round-off makes some negative
    scale = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
    scaled = matrices * (scale[..., :, None] * scale[..., None, :])
    scaled = _definite(scaled)
    return lambda wanted: scale * _solved(scaled, scale * wanted)


def _solved(matrices: Array, wanted: Array) -> Array:
    return np.asarray(np.linalg.solve(matrices, wanted[..., None])[..., 0])


def _definite(scaled: Array) -> Array:
    """Matrices (m, P, P) with a little more on their diagonals where round-off asks for it."""
    with suppress(np.linalg.LinAlgError):
        np.linalg.cholesky(scaled)
        return scaled
    return np.stack([_raised(matrix) for matrix in scaled])


def _raised(scaled: Array) -> Array:
    for more in (0.0, 1e-15, 1e-14, 1e-13, 1e-12, 1e-11, 1e-9, 1e-7):
        with suppress(np.linalg.LinAlgError):
            raised = scaled + more * np.eye(len(scaled))
            np.linalg.cholesky(raised)
            return raised
    values, vectors = np.linalg.eigh(scaled)
    return np.asarray(vectors * np.maximum(values, 1e-7 * values[-1]) @ vectors.T)
