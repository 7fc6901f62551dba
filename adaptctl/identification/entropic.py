"""Physically consistent estimation: least squares with an entropic prior.

    minimise  |residuals|^2/2 + weight sum_i (tr(P0_i^-1 P_i) - log det(P0_i^-1 P_i) - 4)

over inertial parameters, P_i the pseudo-inertia of link i and P0_i a prior one (Lee, Wensing and Park 2020, equation
27: the Bregman divergence of -log det). The divergence is its own barrier: it grows without bound towards what no
body can have, so that Newton's method, damped, keeps to links that can be, and no semidefinite programme is needed.
It is self-concordant, hence a few dozen steps from anywhere (Boyd and Vandenberghe 2004, section 9.6). What must be
positive alone, rotors, viscous and Coulomb friction, has the same divergence of a positive number.
"""

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

UNITS = np.stack([pseudo_inertia(unit) for unit in np.eye(10)])
"""(10, 4, 4): the pseudo-inertia of each unit parameter."""
MOST, STAGES = 60, 12
ENOUGH = 1e-10
"""Newton's decrement, relative to the objective, at which the search ends."""
SLIGHT = 1e-2
"""Weight of the divergence of what need only be positive."""
RIDGE = 1e-11
"""Of each column's own square: keeps columns without a prior apart that the data cannot tell apart."""


@dataclass(frozen=True, eq=False)
class EntropicPrior:
    """Entropic prior of a robot's parameters, from what is known before any log is read (Lee, Wensing and Park 2020).
    It has first guesses of N links, all that are not massless in the mechanism's order, and rough sizes of parameters
    that must be positive, such as viscous and Coulomb friction.

    `tens` (N, 10) are the links' inertial parameters m (kg), mc_x, mc_y, mc_z (kg m), I_xx, I_xy, I_yy, I_xz, I_yz,
    I_zz (kg m^2), about the origins of their frames; in vectors x (P,) of all P parameters they are the first 10 N.
    `positive` (c,) are the zero-based indices of the c other positive parameters, `scales` (c,), SI units, their rough
    sizes. Raises `InputError` for a link whose pseudo-inertia (4, 4), the matrix of its second and first moments and
    mass, is not positive definite: no rigid body has its ten parameters.
    """

    tens: Array
    positive: NDArray[np.int64]
    scales: Array

    def __post_init__(self) -> None:
        for i, matrix in enumerate(map(pseudo_inertia, self.tens)):
            if not np.linalg.eigvalsh(matrix)[0] > 0.0:
                raise InputError(f"prior: no rigid body has the ten of link {i + 1}: {self.tens[i].tolist()}")

    @cached_property
    def inverses(self) -> Array:
        """Inverses (N, 4, 4) of the pseudo-inertias of the prior's N links. A link's pseudo-inertia is the positive
        definite matrix [[S, c], [c^T, m]] of its second moments S (3, 3), kg m^2, first moments c (3,), kg m, with c^T
        their transpose, and mass m, kg. Nothing is raised."""
        return np.linalg.inv(np.stack([pseudo_inertia(ten) for ten in self.tens]))

    def start(self, size: int) -> Array:
        """The prior's own parameters (P,), SI units, for `size` = P parameters, from which a search can begin. First
        come the ten inertial ones of each link (m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz); other
        positive parameters have their rough sizes (the prior's `scales`, at its indices `positive`), all others are
        zero. Raises `ValueError` for a size too small for the links, `IndexError` for one too small for the others."""
        x = np.zeros(size)
        x[: self.tens.size] = self.tens.ravel()
        x[self.positive] = self.scales
        return x

    def divergence(self, x: Array, weight: float) -> float:
        """Divergence, without a unit, of P parameters `x` (P,), SI units (ten of each link first), from the prior
        (first guesses), up to a constant. It is `weight` (unitless) times the sum over the links of tr(L0^-1 L) - log
        det L, plus 0.01 times the sum of z - log z over the other positive parameters. L (4, 4) is a link's
        pseudo-inertia, the matrix of its second and first moments and mass, by x, and L0 by the prior; z is a parameter
        divided by its rough size in the prior's `scales`. Infinite where no rigid bodies have x, or a positive
        parameter is not positive. Raises `ValueError` or `IndexError` where `x` is too short."""
        matrices = self._matrices(x)
        sign, determinants = np.linalg.slogdet(matrices)
        ratios = x[self.positive] / self.scales
        if np.any(sign <= 0.0) or np.any(ratios <= 0.0) or np.any(np.linalg.eigvalsh(matrices)[:, 0] <= 0.0):
            return np.inf
        links = np.sum(self.inverses * matrices) - float(np.sum(determinants))
        return float(weight * links + SLIGHT * np.sum(ratios - np.log(ratios)))

    def distance(self, x: Array) -> float:
        """Divergence, without a unit, of the links in P parameters `x` (P,), SI units (ten of each link first), from
        the prior's first guesses of the links: the sum over the links of tr(L0^-1 L) - log det(L0^-1 L) - 4. L (4, 4)
        is a link's pseudo-inertia, the matrix of its second and first moments and mass, by x, and L0 by the prior. It
        is 0 at the prior itself, and greater elsewhere; `x` must be of links that rigid bodies can have, which is not
        checked."""
        _, logarithms = np.linalg.slogdet(self.inverses @ self._matrices(x))
        return float(np.sum(self.inverses * self._matrices(x)) - np.sum(logarithms) - 4 * len(self.tens))

    def gradient(self, x: Array, weight: float) -> Array:
        """Gradient (P,), per SI unit of each parameter, of the divergence of P parameters `x` (P,), SI units (ten of
        each link first), from the prior (first guesses). The divergence is that of the method `divergence`, with the
        same `weight` (unitless) of the links. Entries are zero for parameters that are neither a link's nor among the
        prior's other positive ones. Raises NumPy's `LinAlgError` where a link's pseudo-inertia (4, 4), the matrix of
        its second and first moments and mass, is singular; other impossible links are not refused."""
        out = np.zeros_like(x)
        slopes = self.inverses - np.linalg.inv(self._matrices(x))
        out[: self.tens.size] = weight * np.einsum("kij,nij->nk", UNITS, slopes).ravel()
        out[self.positive] = SLIGHT * (1.0 / self.scales - 1.0 / x[self.positive])
        return out

    def curvature(self, x: Array, weight: float) -> Array:
        """Second derivatives (P, P), per SI units of two parameters, of the divergence of P parameters `x` (P,), SI
        units (ten of each link first), from the prior (first guesses). The divergence is that of the method
        `divergence`, with the same `weight` (unitless) of the links. There is a block (10, 10) for each link, a
        diagonal entry for each other positive parameter, and zero elsewhere. Raises NumPy's `LinAlgError` where a
        link's pseudo-inertia (4, 4), the matrix of its second and first moments and mass, is singular; other impossible
        links are not refused."""
        inverse = np.linalg.inv(self._matrices(x))[:, None]
        bent = inverse @ UNITS @ inverse
        blocks = weight * np.einsum("naij,bij->nab", bent, UNITS)
        out = np.zeros((len(x), len(x)))
        for i, block in enumerate(blocks):
            out[10 * i : 10 * i + 10, 10 * i : 10 * i + 10] = block
        out[self.positive, self.positive] = SLIGHT / x[self.positive] ** 2
        return out

    def _matrices(self, x: Array) -> Array:
        return np.einsum("nk,kij->nij", x[: self.tens.size].reshape(-1, 10), UNITS)


def consistent_estimate(A: Array, b: Array, prior: EntropicPrior, weight: float, start: Array | None = None) -> Array:
    """The P physically consistent parameters x (P,), SI units (ten of each link first), that minimise x^T A x/2 - b^T x
    plus the divergence of x from a `prior` (first guesses): least squares with links that rigid bodies can have. The
    normal matrix A (P, P), per SI units of two parameters, and the moment b (P,), per SI unit of each, are of equations
    divided by their standard deviations, without a unit; ^T is the transpose.

    `weight` (unitless) is that of the prior's links in the divergence, `start` (P,), of links that rigid bodies can
    have, is where the search begins, None for the prior's own parameters. Parameters without data, whose rows and
    columns of A are zero, keep what the prior says, or zero. The search is Newton's, damped. Where the data outweigh
    the prior so far that it does not converge, it begins again with a larger weight, which is brought down to the one
    asked for. Raises `AdaptctlError` where that does not converge either, as for parameters whose scales differ too
    much.
    """
    started = prior.start(len(b)) if start is None else start
    x, done = _newton(A, b, prior, weight, 1.0, started)
    if done:
        return x
    x = prior.start(len(b))
    for times in np.geomspace(1.0 + abs(_value(A, b, prior, weight, 1.0, x)) / weight, 1.0, STAGES).tolist():
        x, done = _newton(A, b, prior, weight, times, x)
    if not done:
        raise AdaptctlError("the consistent estimate was not found: are the columns scaled beyond reason?")
    return x


def _newton(A: Array, b: Array, prior: EntropicPrior, weight: float, times: float, x: Array) -> tuple[Array, bool]:
    """Minimum by damped Newton steps, with the divergence weighted; the point reached, and whether it is the
    minimum."""
    own = np.diag(A)
    absent = own == 0.0
    absent[: prior.tens.size] = False
    absent[prior.positive] = False
    ridge = RIDGE * np.where(own > 0.0, own, 0.0) + np.where(absent, 1.0, 0.0)
    value = _value(A, b, prior, weight, times, x)
    for _ in range(MOST):
        gradient = A @ x - b + times * prior.gradient(x, weight)
        curvature = A + times * prior.curvature(x, weight)
        curvature[np.diag_indices_from(curvature)] += ridge
        step = -_solved(curvature, gradient)
        decrement = float(-gradient @ step)
        there, found = _stepped(lambda y: _value(A, b, prior, weight, times, y), x, value, step, decrement)
        if decrement <= ENOUGH * (1.0 + abs(value)) or found == value:
            return there, True
        x, value = there, found
    return x, False


def _solved(curvature: Array, gradient: Array) -> Array:
    """Newton step of a positive definite curvature, whose diagonal grows where round-off has made it indefinite: any
    descent will do."""
    scale = 1.0 / np.sqrt(np.diag(curvature))
    scaled = curvature * np.outer(scale, scale)
    for more in (0.0, 1e-10, 1e-8, 1e-6):
        with suppress(LinAlgError):
            return scale * cho_solve(cho_factor(scaled + more * np.eye(len(scaled))), scale * gradient)
    raise AdaptctlError("the consistent estimate was not found: are the columns scaled beyond reason?")


def _value(A: Array, b: Array, prior: EntropicPrior, weight: float, times: float, x: Array) -> float:
    return float(0.5 * x @ A @ x - b @ x + times * prior.divergence(x, weight))


def _stepped(
    objective: Callable[[Array], float], x: Array, value: float, step: Array, decrement: float
) -> tuple[Array, float]:
    """The point along a Newton step where the objective falls enough, found by halving (Armijo), and the objective
    there."""
    share = 1.0
    while share > 1e-14:
        there = x + share * step
        found = objective(there)
        if found <= value - 1e-4 * share * decrement:
            return there, found
        share *= 0.5
    return x, value


DENSITY = 2700.0
"""kg/m^3, aluminium: a link is spread at least as far as a ball of it."""


def prior_links(mechanism: Mechanism) -> tuple[Array, list[str]]:
    """The inertial parameters (N, 10) of a mechanism's N links, those not declared massless, in their order, as guessed
    before any log is read; and a list of remarks, as text, on links that were changed. A link's ten are m (kg), mc_x,
    mc_y, mc_z (kg m), I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg m^2), about its frame's origin.

    They are the mechanism's own, but physically consistent. A link is changed where its least principal second moment
    of mass about its centre is below 1 % of that of a solid aluminium ball of the same mass, as in files without
    inertia tensors: each principal second moment below the ball's is then set to the ball's. Raises `InputError` for a
    link without mass that is not declared massless.
    """
    tens, remarks = [], []
    for i in mechanism.description.bodies:
        link = mechanism.links[i]
        ten = link.inertia
        if not ten[0] > 0.0:
            raise InputError(
                f"{mechanism.name}: link {link.name!r} has no mass in the robot's file; the estimate needs a guess of "
                "every link: give it a mass, a centre and an inertia, roughly"
            )
        spread = _spread_enough(ten)
        if not np.array_equal(spread, ten):
            remarks.append(
                f"{link.name}: no body has its inertia in the robot's file; taken at least as that of a ball of "
                "aluminium of its mass"
            )
        tens.append(spread)
    return np.stack(tens), remarks


def _spread_enough(ten: Array) -> Array:
    """The ten with principal second moments about the centre of at least those of a ball."""
    mass, center = float(ten[0]), ten[1:4] / ten[0]
    at_origin = 0.5 * np.trace(inertia_tensor(ten)) * np.eye(3) - inertia_tensor(ten)
    values, axes = np.linalg.eigh(at_origin - mass * np.outer(center, center))
    least = 0.2 * mass * (3.0 * mass / (4.0 * np.pi * DENSITY)) ** (2.0 / 3.0)
    if values[0] >= 0.01 * least:
        return ten
    moments = axes @ np.diag(np.maximum(values, least)) @ axes.T
    return from_center_of_mass(mass, center, np.trace(moments) * np.eye(3) - moments)
