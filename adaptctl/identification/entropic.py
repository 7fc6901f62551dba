"""Entropic prior of physically consistent links (Lee, Wensing and Park 2020)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description.inertia import (
    UNIT_PSEUDO_INERTIAS,
    from_center_of_mass,
    from_pseudo_inertia,
    inertia_tensor,
)
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError

# Minimised is |residuals|^2/2 + weight sum_i (tr(P0_i^-1 P_i) - log det(P0_i^-1 P_i) - 4) with the pseudo-inertias P_i
# of the links and P0_i of a prior (equation 27). The divergence is its own, self-concordant barrier. Positive scalars
# (rotors, viscous and Coulomb friction) have the same divergence.

# Weight of the divergence of what need only be positive.
POSITIVE_WEIGHT = 1e-2


@dataclass(frozen=True, eq=False)
class EntropicPrior:
    """Prior of N links' ten inertial parameters (N, 10), and rough sizes of other positive parameters."""

    tens: Array
    positive: NDArray[np.int64]
    scales: Array

    def __post_init__(self) -> None:
        for i in np.flatnonzero(~(np.linalg.eigvalsh(self.own)[:, 0] > 0.0)).tolist():
            raise InputError(
                f"prior: the parameters of link {i + 1} are not physically consistent: {self.tens[i].tolist()}"
            )

    @cached_property
    def own(self) -> Array:
        """Pseudo-inertias (N, 4, 4) of the prior."""
        return self.matrices(self.tens.ravel())

    @cached_property
    def inverses(self) -> Array:
        """Inverses (N, 4, 4) of the prior's pseudo-inertias."""
        return np.asarray(np.linalg.inv(self.own), dtype=np.float64)

    @property
    def is_placeholder(self) -> bool:
        """True if more than half of several links are alike, as where a file's values are placeholders."""
        alike = np.unique(self.tens, axis=0, return_counts=True)[1]
        return bool(2 * alike.max() > len(self.tens) > 1)

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
        """Gradients (..., P) of the divergence at parameters (..., P)."""
        out = np.zeros_like(x)
        slopes = (self.inverses - np.linalg.inv(self.matrices(x))).reshape(*x.shape[:-1], len(self.tens), 16)
        links = slopes @ UNIT_PSEUDO_INERTIAS.reshape(10, 16).T
        out[..., : self.tens.size] = weight * links.reshape(*x.shape[:-1], -1)
        out[..., self.positive] = POSITIVE_WEIGHT * (1.0 / self.scales - 1.0 / x[..., self.positive])
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

    def hold(self, x: Array, weight: float) -> Array:
        """Curvature (P, P) of the links' divergence without its barrier: what pulls them to the prior from afar."""
        # The barrier is stiff where a fit is at the edge of the cone, which says nothing of where the truth is.
        roots = np.linalg.cholesky(self.own)
        inner = np.linalg.inv(roots)
        ratios, axes = np.linalg.eigh(inner @ self.matrices(x) @ inner.mT)
        clear = roots @ (axes * np.maximum(ratios, 1.0)[:, None]) @ axes.mT @ roots.mT
        moved = x.copy()
        moved[: self.tens.size] = np.concatenate([from_pseudo_inertia(matrix) for matrix in clear])
        out = self.curvature(moved, weight)
        out[self.tens.size :, self.tens.size :] = 0.0
        return out

    def matrices(self, x: Array) -> Array:
        """Pseudo-inertias (..., N, 4, 4) of the links of parameters (..., P)."""
        links = x[..., : self.tens.size].reshape(*x.shape[:-1], -1, 10)
        return (links @ UNIT_PSEUDO_INERTIAS.reshape(10, 16)).reshape(*links.shape[:-1], 4, 4)


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
                f"{link.name}: its inertia in the robot file is not physically consistent, or far denser than metal; "
                "increased to that of a ball of aluminium of its mass"
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
