"""Physically consistent estimation by an entropic prior (Lee, Wensing and Park 2020)."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description.inertia import UNIT_PSEUDO_INERTIAS, from_center_of_mass, inertia_tensor, pseudo_inertia
from adaptctl.dynamics import Mechanism
from adaptctl.errors import AdaptctlError, InputError

# Minimised is |residuals|^2/2 + weight sum_i (tr(P0_i^-1 P_i) - log det(P0_i^-1 P_i) - 4) with the pseudo-inertias P_i
# of the links and P0_i of a prior (equation 27). The divergence is its own, self-concordant barrier: Newton
# steps keep to links that rigid bodies can have, and no semidefinite programme is needed. Positive scalars (rotors,
# viscous and Coulomb friction) have the same divergence.
#
# Newton's steps are relative: R (1 + S) R^T for a pseudo-inertia R R^T, x (1 + s) for a positive parameter. In them the
# divergence has unit curvature wherever a link is, also at the edge of the cone (Nesterov and Todd 1997), and the line
# search is exact. From the prior, the divergence's weight falls by stages, as in path following (Boyd and Vandenberghe
# 2004, section 11.3).

# Weight of the divergence of what need only be positive.
POSITIVE_WEIGHT = 1e-2
# (10, 4, 4): an orthonormal basis of symmetric matrices, and (10, 10) what turns its coordinates into parameters.
PAIRS = [(i, j) for i in range(4) for j in range(i, 4)]
DIRECTIONS = np.zeros((10, 4, 4))
for k, (i, j) in enumerate(PAIRS):
    DIRECTIONS[k, i, j] = DIRECTIONS[k, j, i] = 1.0 if i == j else np.sqrt(0.5)
FROM_DIRECTIONS = np.linalg.inv(np.einsum("aij,kij->ak", DIRECTIONS, UNIT_PSEUDO_INERTIAS))
# Factor between the weights of two stages, and most Newton steps of a stage, of the last, and of one begun elsewhere.
STAGE_RATIO, MAX_STAGE_STEPS, MAX_LAST_STEPS, MAX_WARM_STEPS = 1000.0, 20, 60, 60
# Newton's decrement, relative to the divergence's weight, at which a stage and the last one end, and a whole step is
# taken.
STAGE_DECREMENT, LAST_DECREMENT, FULL_STEP_DECREMENT = 0.1, 1e-14, 0.05
# Round-off of the objective, relative to the squares.
ROUND_OFF = 1e-15
# Share of each column's square that is added, since data may not tell columns without a prior apart.
RIDGE_RATIO = 1e-11
LINE_SEARCH_STEPS, LONGEST_STEP = 40, 16.0
# Least eigenvalue of a pseudo-inertia over its largest, clear of round-off.
CONE_MARGIN = 1e-14


@dataclass(frozen=True, eq=False)
class EntropicPrior:
    """Prior of N links' ten inertial parameters (N, 10), and rough sizes of other positive parameters."""

    tens: Array
    positive: NDArray[np.int64]
    scales: Array

    def __post_init__(self) -> None:
        for i, matrix in enumerate(map(pseudo_inertia, self.tens)):
            if not np.linalg.eigvalsh(matrix)[0] > 0.0:
                raise InputError(
                    f"prior: the parameters of link {i + 1} are not physically consistent: {self.tens[i].tolist()}"
                )

    @cached_property
    def inverses(self) -> Array:
        """Inverses (N, 4, 4) of the prior's pseudo-inertias."""
        return np.linalg.inv(np.stack([pseudo_inertia(ten) for ten in self.tens]))

    def start(self, size: int) -> Array:
        """Prior's own parameters (P,), from which a search can begin."""
        x = np.zeros(size)
        x[: self.tens.size] = self.tens.ravel()
        x[self.positive] = self.scales
        return x

    def divergence(self, x: Array, weight: float) -> float:
        """Divergence of parameters (P,) from the prior, up to a constant."""
        matrices = self.matrices(x)
        sign, determinants = np.linalg.slogdet(matrices)
        ratios = x[self.positive] / self.scales
        if np.any(sign <= 0.0) or np.any(ratios <= 0.0) or np.any(np.linalg.eigvalsh(matrices)[:, 0] <= 0.0):
            return np.inf
        links = np.sum(self.inverses * matrices) - float(np.sum(determinants))
        return float(weight * links + POSITIVE_WEIGHT * np.sum(ratios - np.log(ratios)))

    def distance(self, x: Array) -> float:
        """Divergence of the links from the prior's: the sum of tr(L0^-1 L) - log det(L0^-1 L) - 4, 0 at the prior."""
        _, logarithms = np.linalg.slogdet(self.inverses @ self.matrices(x))
        return float(np.sum(self.inverses * self.matrices(x)) - np.sum(logarithms) - 4 * len(self.tens))

    def gradient(self, x: Array, weight: float) -> Array:
        """Gradient (P,) of the divergence."""
        out = np.zeros_like(x)
        slopes = self.inverses - np.linalg.inv(self.matrices(x))
        out[: self.tens.size] = weight * np.einsum("kij,nij->nk", UNIT_PSEUDO_INERTIAS, slopes).ravel()
        out[self.positive] = POSITIVE_WEIGHT * (1.0 / self.scales - 1.0 / x[self.positive])
        return out

    def curvature(self, x: Array, weight: float) -> Array:
        """Second derivatives (P, P) of the divergence: a block for each link, a diagonal entry for other parameters."""
        inverse = np.linalg.inv(self.matrices(x))[:, None]
        bent = inverse @ UNIT_PSEUDO_INERTIAS @ inverse
        blocks = weight * np.einsum("naij,bij->nab", bent, UNIT_PSEUDO_INERTIAS)
        out = np.zeros((len(x), len(x)))
        for i, block in enumerate(blocks):
            out[10 * i : 10 * i + 10, 10 * i : 10 * i + 10] = block
        out[self.positive, self.positive] = POSITIVE_WEIGHT / x[self.positive] ** 2
        return out

    def matrices(self, x: Array) -> Array:
        """Pseudo-inertias (N, 4, 4) of the links."""
        return np.einsum("nk,kij->nij", x[: self.tens.size].reshape(-1, 10), UNIT_PSEUDO_INERTIAS)


def consistent_estimate(A: Array, b: Array, prior: EntropicPrior, weight: float, start: Array | None = None) -> Array:
    """Consistent parameters (P,) that minimise x^T A x/2 - b^T x plus the divergence from the prior."""
    if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b))):
        raise AdaptctlError("the sums of the rows' squares are not finite; check the units of the columns")
    squares = _Squares.of(A, b, prior, weight)
    begun = None if start is None else _Point.of(start, prior)
    if begun is None:
        return _inside(_from_prior(squares).x, prior)
    near, converged = squares.minimum(begun, 1.0, MAX_WARM_STEPS)
    found = near if converged else min(near, _from_prior(squares), key=squares.value)
    return _inside(found.x, prior)


def _inside(x: Array, prior: EntropicPrior) -> Array:
    """Parameters (P,) of which round-off has left none outside the cone: a little nearer to the prior, if need be."""
    links = np.arange(len(x)) < prior.tens.size
    for share in (0.0, *np.geomspace(1e-13, 1.0, 27).tolist()):
        near = np.where(links, x + share * (prior.start(len(x)) - x), x)
        values = np.linalg.eigvalsh(prior.matrices(near))
        if np.all(values[:, 0] > CONE_MARGIN * values[:, -1]):
            return near
    return prior.start(len(x))


def kkt_residual(A: Array, b: Array, prior: EntropicPrior, weight: float, x: Array) -> float:
    """Slope of the objective at parameters (P,), by relative steps, over its largest part; 0 at the minimum."""
    squares, point = _Squares.of(A, b, prior, weight), _Point.of(x, prior)
    if point is None:
        return np.inf
    size = max(float(np.abs(point.map.T @ part).max()) for part in (A @ x, b)) + weight
    return float(np.abs(squares.slope(point, 1.0)).max() / size)


def _from_prior(squares: _Squares) -> _Point:
    prior = squares.prior
    point = _Point.of(prior.start(len(squares.b)), prior)
    if point is None:
        raise AdaptctlError("the links of the prior are not physically consistent")
    point = squares.with_free_columns(point)
    penalised = squares.unit > 0.0
    pushed = np.abs(point.map.T @ (squares.A @ point.x - squares.b))
    times = max(1.0, float(np.max((pushed[penalised] / squares.unit[penalised]), initial=1.0)))
    while times > 1.0:
        point, _ = squares.minimum(point, times, MAX_STAGE_STEPS)
        times = max(1.0, times / STAGE_RATIO)
    return squares.minimum(point, 1.0, MAX_LAST_STEPS)[0]


@dataclass(frozen=True, eq=False)
class _Point:
    """Parameters (P,) inside the cone, with factors (N, 4, 4) of the links' pseudo-inertias."""

    x: Array
    roots: Array
    positive: NDArray[np.int64]

    @classmethod
    def of(cls, x: Array, prior: EntropicPrior) -> _Point | None:
        """Point of parameters; None outside the cone."""
        with suppress(np.linalg.LinAlgError):
            if np.all(x[prior.positive] > 0.0):
                return cls(x, np.asarray(np.linalg.cholesky(prior.matrices(x)), dtype=np.float64), prior.positive)
        return None

    @cached_property
    def map(self) -> Array:
        """Changes (P, P) of the parameters by unit steps."""
        out = np.eye(len(self.x))
        out[self.positive, self.positive] = self.x[self.positive]
        R = self.roots[:, None]
        moved = np.einsum("aij,ncij->nac", DIRECTIONS, R @ DIRECTIONS @ R.mT)
        for i, block in enumerate(FROM_DIRECTIONS @ moved):
            out[10 * i : 10 * i + 10, 10 * i : 10 * i + 10] = block
        return out

    def symmetric(self, step: Array) -> Array:
        """Relative steps (N, 4, 4) of the pseudo-inertias."""
        return np.einsum("nc,cij->nij", step[: 10 * len(self.roots)].reshape(-1, 10), DIRECTIONS)

    def moved(self, step: Array) -> _Point:
        """Point after a step (P,) that stays inside."""
        roots = self.roots @ np.linalg.cholesky(np.eye(4) + self.symmetric(step))
        x = self.x + self.map @ step
        x[: 10 * len(roots)] = (np.einsum("aij,nij->na", DIRECTIONS, roots @ roots.mT) @ FROM_DIRECTIONS.T).ravel()
        return _Point(x, roots, self.positive)


@dataclass(frozen=True, eq=False)
class _Squares:
    """Objective x^T A x/2 - b^T x plus the divergence, whose curvature by unit steps is `unit` (P,)."""

    A: Array
    b: Array
    prior: EntropicPrior
    weight: float
    unit: Array
    ridge: Array

    @classmethod
    def of(cls, A: Array, b: Array, prior: EntropicPrior, weight: float) -> _Squares:
        """Objective of normal equations and a prior."""
        unit = np.zeros(len(b))
        unit[: prior.tens.size], unit[prior.positive] = weight, POSITIVE_WEIGHT
        own = np.diag(A)
        return cls(A, b, prior, weight, unit, np.where(unit > 0.0, 0.0, np.where(own > 0.0, RIDGE_RATIO * own, 1.0)))

    def with_free_columns(self, point: _Point) -> _Point:
        """Point with those parameters that may have any sign at their minimum."""
        free = self.unit == 0.0
        x = np.where(free, 0.0, point.x)
        x[free] = _solved((self.A + np.diag(self.ridge))[np.ix_(free, free)], (self.b - self.A @ x)[free])
        return _Point(x, point.roots, point.positive)

    def value(self, point: _Point) -> float:
        """Objective at a point."""
        squares = 0.5 * float(point.x @ (self.A @ point.x)) - float(self.b @ point.x)
        return squares + self.prior.divergence(point.x, self.weight)

    def pull(self, point: _Point) -> Array:
        """Slope (P,) of the divergence's linear part by unit steps."""
        out, R = np.zeros(len(point.x)), point.roots
        inner = R.mT @ self.prior.inverses @ R
        out[: self.prior.tens.size] = self.weight * np.einsum("nij,cij->nc", inner, DIRECTIONS).ravel()
        out[point.positive] = POSITIVE_WEIGHT * point.x[point.positive] / self.prior.scales
        return out

    def push(self) -> Array:
        """Slope (P,) of the divergence's logarithms by unit steps."""
        out = np.zeros(len(self.b))
        traces = np.trace(DIRECTIONS, axis1=1, axis2=2)
        out[: self.prior.tens.size] = self.weight * np.tile(traces, len(self.prior.tens))
        out[self.prior.positive] = POSITIVE_WEIGHT
        return out

    def slope(self, point: _Point, times: float) -> Array:
        """Slope (P,) of the objective by unit steps, the divergence taken `times`."""
        squares = point.map.T @ (self.A @ point.x - self.b)
        return np.asarray(squares + times * (self.pull(point) - self.push()))

    def minimum(self, point: _Point, times: float, steps: int) -> tuple[_Point, bool]:
        """Minimum by Newton steps, and whether it was reached."""
        least = STAGE_DECREMENT if times > 1.0 else LAST_DECREMENT
        lightest = times * float(self.unit[self.unit > 0.0].min(initial=1.0))
        for _ in range(steps):
            slope = self.slope(point, times)
            curved = point.map.T @ self.A @ point.map
            step = -_solved(curved + np.diag(times * self.unit + self.ridge), slope)
            decrement = -float(slope @ step)
            rough = ROUND_OFF * abs(float(self.b @ point.x))
            near = decrement <= FULL_STEP_DECREMENT * lightest
            point = point.moved(step if near else self._share(point, times, step, float(step @ curved @ step)) * step)
            if decrement <= max(least * lightest, rough):
                return point, True
        return point, False

    def _share(self, point: _Point, times: float, step: Array, curvature: float) -> float:
        """Share of a step at which the objective is least along it."""
        parts = np.concatenate([np.linalg.eigvalsh(point.symmetric(step)).ravel(), step[point.positive]])
        weights = np.concatenate(
            [np.full(4 * len(point.roots), self.weight), np.full(len(point.positive), POSITIVE_WEIGHT)]
        )
        straight = float(step @ (point.map.T @ (self.A @ point.x - self.b) + times * self.pull(point)))
        high = min(LONGEST_STEP, 0.999 / max(float(-parts.min(initial=0.0)), 1e-9))
        low = 0.0
        for _ in range(LINE_SEARCH_STEPS):
            share = 1.0 if low < 1.0 < high else 0.5 * (low + high)
            rise = straight + share * curvature - times * float(np.sum(weights * parts / (1.0 + share * parts)))
            low, high = (share, high) if rise < 0.0 else (low, share)
            if high - low < 0.05 * high:
                break
        return 0.5 * (low + high)


def _solved(matrix: Array, wanted: Array) -> Array:
    """Solution of positive definite equations, with a little more on the diagonal where round-off asks for it."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    scaled = matrix * np.outer(scale, scale)
    for more in (0.0, 1e-13, 1e-11, 1e-9, 1e-7):
        with suppress(LinAlgError):
            return np.asarray(scale * cho_solve(cho_factor(scaled + more * np.eye(len(scaled))), scale * wanted))
    values, vectors = np.linalg.eigh(scaled)
    return np.asarray(scale * (vectors @ ((vectors.T @ (scale * wanted)) / np.maximum(values, 1e-7 * values[-1]))))


# Density in kg/m^3 of a ball that a link is spread at least as far as.
ALUMINIUM_DENSITY = 2700.0


def prior_links(mechanism: Mechanism) -> tuple[Array, list[str]]:
    """Prior (N, 10) of the links, made physically consistent, and remarks on those that were changed."""
    tens, remarks = [], []
    for i in mechanism.description.bodies:
        link = mechanism.links[i]
        ten = link.inertia
        if not ten[0] > 0.0:
            raise InputError(
                f"{mechanism.name}: link {link.name!r} has no mass in the robot file; the estimate needs prior values "
                "of all links; give it an approximate mass, centre and inertia"
            )
        spread = _spread_enough(ten)
        if not np.array_equal(spread, ten):
            remarks.append(
                f"{link.name}: its inertia in the robot file is not physically consistent; increased to that of a ball "
                "of aluminium of its mass"
            )
        tens.append(spread)
    return np.stack(tens), remarks


def _spread_enough(ten: Array) -> Array:
    """The ten parameters with principal second moments about the center of at least those of a ball."""
    mass, center = float(ten[0]), ten[1:4] / ten[0]
    at_origin = 0.5 * np.trace(inertia_tensor(ten)) * np.eye(3) - inertia_tensor(ten)
    values, axes = np.linalg.eigh(at_origin - mass * np.outer(center, center))
    least = 0.2 * mass * (3.0 * mass / (4.0 * np.pi * ALUMINIUM_DENSITY)) ** (2.0 / 3.0)
    if values[0] >= 0.01 * least:
        return ten
    moments = axes @ np.diag(np.maximum(values, least)) @ axes.T
    return from_center_of_mass(mass, center, np.trace(moments) * np.eye(3) - moments)
