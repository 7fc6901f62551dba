"""Physically consistent estimation by an entropic prior (Lee, Wensing and Park 2020)."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description.inertia import from_center_of_mass, inertia_tensor, pseudo_inertia
from adaptctl.dynamics import Mechanism
from adaptctl.errors import AdaptctlError, InputError

# Minimised is |residuals|^2/2 + weight sum_i (tr(P0_i^-1 P_i) - log det(P0_i^-1 P_i) - 4) with the pseudo-inertias P_i
# of the links and P0_i of a prior (equation 27). The divergence is its own, self-concordant barrier: damped Newton
# steps keep to links that rigid bodies can have (Boyd and Vandenberghe 2004, section 9.6); no semidefinite programme
# is needed. Positive scalars (rotors, viscous and Coulomb friction) have the same divergence.

# (10, 4, 4): the pseudo-inertia of each unit parameter.
UNIT_PSEUDO_INERTIAS = np.stack([pseudo_inertia(unit) for unit in np.eye(10)])
MAX_NEWTON_STEPS, MAX_WEIGHT_STAGES = 60, 12
# Newton's decrement, relative to the objective, at which the search ends.
DECREMENT_TOLERANCE = 1e-10
# Weight of the divergence of what need only be positive.
POSITIVE_WEIGHT = 1e-2
# Share of each column's square that is added, since data may not tell columns without a prior apart.
RIDGE_RATIO = 1e-11


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
        matrices = self._matrices(x)
        sign, determinants = np.linalg.slogdet(matrices)
        ratios = x[self.positive] / self.scales
        if np.any(sign <= 0.0) or np.any(ratios <= 0.0) or np.any(np.linalg.eigvalsh(matrices)[:, 0] <= 0.0):
            return np.inf
        links = np.sum(self.inverses * matrices) - float(np.sum(determinants))
        return float(weight * links + POSITIVE_WEIGHT * np.sum(ratios - np.log(ratios)))

    def distance(self, x: Array) -> float:
        """Divergence of the links from the prior's: the sum of tr(L0^-1 L) - log det(L0^-1 L) - 4, 0 at the prior."""
        _, logarithms = np.linalg.slogdet(self.inverses @ self._matrices(x))
        return float(np.sum(self.inverses * self._matrices(x)) - np.sum(logarithms) - 4 * len(self.tens))

    def gradient(self, x: Array, weight: float) -> Array:
        """Gradient (P,) of the divergence."""
        out = np.zeros_like(x)
        slopes = self.inverses - np.linalg.inv(self._matrices(x))
        out[: self.tens.size] = weight * np.einsum("kij,nij->nk", UNIT_PSEUDO_INERTIAS, slopes).ravel()
        out[self.positive] = POSITIVE_WEIGHT * (1.0 / self.scales - 1.0 / x[self.positive])
        return out

    def curvature(self, x: Array, weight: float) -> Array:
        """Second derivatives (P, P) of the divergence: a block for each link, a diagonal entry for other parameters."""
        inverse = np.linalg.inv(self._matrices(x))[:, None]
        bent = inverse @ UNIT_PSEUDO_INERTIAS @ inverse
        blocks = weight * np.einsum("naij,bij->nab", bent, UNIT_PSEUDO_INERTIAS)
        out = np.zeros((len(x), len(x)))
        for i, block in enumerate(blocks):
            out[10 * i : 10 * i + 10, 10 * i : 10 * i + 10] = block
        out[self.positive, self.positive] = POSITIVE_WEIGHT / x[self.positive] ** 2
        return out

    def _matrices(self, x: Array) -> Array:
        return np.einsum("nk,kij->nij", x[: self.tens.size].reshape(-1, 10), UNIT_PSEUDO_INERTIAS)


def consistent_estimate(A: Array, b: Array, prior: EntropicPrior, weight: float, start: Array | None = None) -> Array:
    """Consistent parameters (P,) that minimise x^T A x/2 - b^T x plus the divergence from the prior."""
    started = prior.start(len(b)) if start is None else start
    x, done = _newton(A, b, prior, weight, 1.0, started)
    if done:
        return x
    x = prior.start(len(b))
    for times in np.geomspace(1.0 + abs(_value(A, b, prior, weight, 1.0, x)) / weight, 1.0, MAX_WEIGHT_STAGES).tolist():
        x, done = _newton(A, b, prior, weight, times, x)
    if not done:
        raise AdaptctlError("the consistent estimate did not converge; check the units of the columns")
    return x


def _newton(A: Array, b: Array, prior: EntropicPrior, weight: float, times: float, x: Array) -> tuple[Array, bool]:
    """Minimum by damped Newton steps."""
    own = np.diag(A)
    absent = own == 0.0
    absent[: prior.tens.size] = False
    absent[prior.positive] = False
    ridge = RIDGE_RATIO * np.where(own > 0.0, own, 0.0) + np.where(absent, 1.0, 0.0)
    value = _value(A, b, prior, weight, times, x)
    for _ in range(MAX_NEWTON_STEPS):
        gradient = A @ x - b + times * prior.gradient(x, weight)
        curvature = A + times * prior.curvature(x, weight)
        curvature[np.diag_indices_from(curvature)] += ridge
        step = -_solved(curvature, gradient)
        decrement = float(-gradient @ step)
        there, found = _stepped(lambda y: _value(A, b, prior, weight, times, y), x, value, step, decrement)
        if decrement <= DECREMENT_TOLERANCE * (1.0 + abs(value)) or found == value:
            return there, True
        x, value = there, found
    return x, False


def _solved(curvature: Array, gradient: Array) -> Array:
    """Newton step."""
    scale = 1.0 / np.sqrt(np.diag(curvature))
    scaled = curvature * np.outer(scale, scale)
    for more in (0.0, 1e-10, 1e-8, 1e-6):
        with suppress(LinAlgError):
            return scale * cho_solve(cho_factor(scaled + more * np.eye(len(scaled))), scale * gradient)
    raise AdaptctlError("the consistent estimate did not converge; check the units of the columns")


def _value(A: Array, b: Array, prior: EntropicPrior, weight: float, times: float, x: Array) -> float:
    return float(0.5 * x @ A @ x - b @ x + times * prior.divergence(x, weight))


def _stepped(
    objective: Callable[[Array], float], x: Array, value: float, step: Array, decrement: float
) -> tuple[Array, float]:
    """Point along a Newton step where the objective falls enough (Armijo), and the objective there."""
    share = 1.0
    while share > 1e-14:
        there = x + share * step
        found = objective(there)
        if found <= value - 1e-4 * share * decrement:
            return there, found
        share *= 0.5
    return x, value


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
