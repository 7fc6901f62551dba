"""Optimal counterweights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.arrays import Array, frozen, positive_number, random_seed
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.description.inertia import is_physically_consistent
from adaptctl.design.added_mass import ENERGY_ERROR_PERCENT
from adaptctl.design.bodies import STEEL_DENSITY, ball_tens, ball_tens_slopes, sphere
from adaptctl.design.mounting_bounds import MountingBounds
from adaptctl.design.task import OBJECTIVES, DesignTask, component_counts
from adaptctl.errors import InputError
from adaptctl.simulation.effects import Payload

# Sampled designs, evenly spread, and the best of them that are improved.
SAMPLED_DESIGNS, SEARCH_STARTS = 4096, 10
# Share of the mass allowed below which there is no counterweight.
MIN_MASS_SHARE = 1e-6


@sent_as_made
@dataclass(frozen=True, eq=False)
class Counterweight:
    """
    Solid ball on a link that balances it.

    Parameters
    ----------
    link : str
        Name of the link, checked where it is used.
    mass : float
        Mass in kg, from 0 to 1e20.
    place : numpy.ndarray
        Position (3,) of its center in the link's frame in m.
    density : float
        Density in kg/m^3.

    Raises
    ------
    InputError
        If a number is out of range or not finite, or a shape is wrong.

    Examples
    --------
    >>> from adaptctl.design import Counterweight
    >>> Counterweight("upper", 2.0, np.array([-0.5, 0.0, 0.0]), 7850.0).body.mass
    2.0
    """

    link: str
    mass: float
    place: Array
    density: float

    def __post_init__(self) -> None:
        body = self.body
        object.__setattr__(self, "mass", body.mass)
        object.__setattr__(self, "place", body.center)

    @property
    def body(self) -> Payload:
        """Ball as a rigid body in the link's frame."""
        return sphere(self.mass, self.place, density=self.density)


@dataclass(frozen=True, eq=False)
class Counterweights:
    """
    Counterweights that minimise a cost of the motion, and this cost with and without them.

    Made by `optimal_counterweights`. Properties raise `InputError` for unknown links and objectives, `RankError` where
    "components" needs a rank that cannot be certified.

    Parameters
    ----------
    task : DesignTask
        Mechanism without counterweights, and states.
    objective : {"energy", "torque", "coupling", "components"}
        Cost that is minimised, as `DesignTask.cost` computes it; for "components" the number of essential components.
    percent : float
        Largest error of the energy in percent at which essential components are counted.
    bounds : tuple of MountingBounds
        Bounds of masses (kg) and positions (m).
    weights : tuple of Counterweight
        Counterweights found, without those lighter than 1e-6 of the allowed mass.
    evaluations : int
        Number of designs that the search evaluated.

    Examples
    --------
    >>> from adaptctl.design import Counterweight, Counterweights, DesignTask
    >>> ball = Counterweight("upper", 3.0, np.array([-0.6, 0.0, 0.0]), 7850.0)
    >>> found = Counterweights(DesignTask.within_limits(arm, samples=20), "energy", 1.0, (), (ball,), 0)
    >>> found.cost_after < found.cost_before
    True
    """

    task: DesignTask
    objective: str
    percent: float
    bounds: tuple[MountingBounds, ...]
    weights: tuple[Counterweight, ...]
    evaluations: int

    def __repr__(self) -> str:
        return f"<Counterweights on {self.task.mechanism.name!r}: {len(self.weights)} for {self.objective}>"

    @cached_property
    def parameters(self) -> Array:
        """Inertial parameters (P,) with the counterweights in SI units, without friction."""
        D = np.array(self.task.parameters)
        for weight in self.weights:
            first = 10 * self.task.link_index(weight.link)
            D[first : first + 10] += ball_tens(weight.mass, weight.place, weight.density)
        return frozen(D)

    @cached_property
    def balanced_task(self) -> DesignTask:
        """Task of the mechanism with the counterweights."""
        return self.task.with_parameters(self.parameters)

    @property
    def cost_before(self) -> float:
        """Cost without counterweights, in J for "energy", in kg m^2 for "coupling", else without unit."""
        return _cost(self.task, self.objective, self.percent)

    @property
    def cost_after(self) -> float:
        """Cost with the counterweights, in the unit of `cost_before`."""
        return _cost(self.balanced_task, self.objective, self.percent)

    @property
    def relative_reduction(self) -> float:
        """Relative reduction of the cost by the counterweights, between 0 and 1."""
        return 1.0 - self.cost_after / self.cost_before if self.cost_before > 0.0 else 0.0

    @property
    def inconsistent(self) -> tuple[str, ...]:
        """Names of links that no rigid body can have, with counterweights as without."""
        names, tens = self.task.mechanism.description.body_names, self.parameters
        pairs = ((name, tens[10 * i : 10 * i + 10]) for i, name in enumerate(names))
        return tuple(name for name, ten in pairs if not is_physically_consistent(ten))


def optimal_counterweights(
    task: DesignTask,
    bounds: Sequence[MountingBounds],
    objective: str = "energy",
    *,
    percent: float = ENERGY_ERROR_PERCENT,
    density: float = STEEL_DENSITY,
    seed: int = 0,
) -> Counterweights:
    """
    Find the counterweights that minimise a cost of a mechanism's motion.

    Parameters
    ----------
    task : DesignTask
        Mechanism and states.
    bounds : sequence of MountingBounds
        Bounds of mass and position for each link that may carry a ball.
    objective : {"energy", "torque", "coupling", "components"}, default "energy"
        Cost that is minimised, as `DesignTask.cost` computes it; for "components" the number of essential components.
    percent : float, default 1.0
        Largest error of the energy in percent at which essential components are counted.
    density : float, default 7850.0
        Density of the balls in kg/m^3; that of steel by default.
    seed : int, default 0
        Seed of the sampled designs, from 0 to 2^32 - 1. Fixed, so that a result can be repeated.

    Returns
    -------
    Counterweights
        At most one ball on each link, and the cost with and without the balls.

    Raises
    ------
    InputError
        If an objective or link is unknown, a link is missing or given twice, a number is out of range, or the task's
        energy is constant.
    RankError
        If the number of identifiable parameters cannot be certified.

    Notes
    -----
    A trust-region search starts from the ten best of 4096 sampled designs (a Sobol sequence) and from no
    counterweights; it may miss an optimum between samples. Consistent links stay consistent.

    Examples
    --------
    >>> from adaptctl.design import DesignTask, MountingBounds, optimal_counterweights
    >>> bounds = MountingBounds("upper", np.array([-0.6, 0.0, 0.0]), np.zeros(3), 3.0)
    >>> found = optimal_counterweights(DesignTask.within_limits(arm, samples=20), [bounds])
    >>> [weight.link for weight in found.weights], found.relative_reduction > 0.3
    (['upper'], True)
    """
    if objective not in OBJECTIVES:
        raise InputError(f"objective: expected one of {', '.join(OBJECTIVES)}, got {objective!r}")
    links = [places.link for places in bounds]
    if not links or len(set(links)) < len(links):
        raise InputError(f"counterweights: expected bounds for one or more different links, got {', '.join(links)}")
    seed = random_seed(seed, "counterweights: seed")
    task.components(percent)
    task.validate_energy()
    search = _Search(task, tuple(bounds), objective, positive_number(density, "density: expected a positive number"))
    z = search.fewest(percent, seed) if objective == "components" else search.least(None, seed)
    masses, places = search.physical(z)
    found = [
        Counterweight(name, mass, place, density)
        for name, mass, place, most in zip(links, masses.tolist(), places, search.masses.tolist(), strict=True)
        if mass > MIN_MASS_SHARE * most
    ]
    return Counterweights(task, objective, percent, tuple(bounds), tuple(found), search.evaluations)


class _Search:
    """Residuals M (D + change) over designs z (4 L,) in the unit cube."""

    def __init__(self, task: DesignTask, bounds: tuple[MountingBounds, ...], objective: str, density: float) -> None:
        M = task.cost_matrix(objective)
        firsts = [10 * task.link_index(places.link) for places in bounds]
        self.fixed = M @ task.parameters
        self.shares = np.stack([M[:, first : first + 10] for first in firsts])
        self.masses = np.array([places.mass for places in bounds])
        self.lower = np.stack([places.lower for places in bounds])
        self.width = np.stack([places.upper for places in bounds]) - self.lower
        self.density, self.evaluations = density, 0

    def physical(self, z: Array) -> tuple[Array, Array]:
        """Masses (..., L) in kg and positions (..., L, 3) in m."""
        each = z.reshape(*z.shape[:-1], len(self.masses), 4)
        return each[..., 0] * self.masses, self.lower + each[..., 1:] * self.width

    def residuals(self, z: Array) -> Array:
        """Residuals (..., n) of designs (..., 4 L)."""
        self.evaluations += int(np.prod(z.shape[:-1]))
        tens = ball_tens(*self.physical(z), self.density)
        return self.fixed + np.einsum("...li,lni->...n", tens, self.shares)

    def slopes(self, z: Array) -> Array:
        """Derivatives (n, 4 L) of the residuals of one design."""
        each = ball_tens_slopes(*self.physical(z), self.density)
        each[..., 0] *= self.masses[:, None]
        each[..., 1:] *= self.width[:, None, :]
        return np.concatenate(list(self.shares @ each), axis=-1)

    def least(self, kept: int | None, seed: int, designs: Array | None = None) -> Array:
        """Design of least residuals."""
        from scipy.optimize import least_squares

        def share(z: Array) -> Array:
            return _beyond(self.residuals(z), kept)

        def slopes(z: Array) -> Array:
            return _beyond_slopes(self.residuals(z), self.slopes(z), kept)

        drawn = self.drawn(seed) if designs is None else designs
        order = np.argsort(np.linalg.norm(share(drawn), axis=-1), kind="stable")
        settings: dict[str, Any] = {"bounds": (0.0, 1.0), "xtol": 1e-9, "ftol": 1e-9, "max_nfev": 200}
        found = [least_squares(share, z, slopes, **settings) for z in drawn[order[:SEARCH_STARTS]]]
        return np.asarray(min(found, key=lambda result: result.cost).x, dtype=np.float64)

    def fewest(self, percent: float, seed: int) -> Array:
        """Design with the fewest components within an error."""
        drawn = self.drawn(seed)
        counts = component_counts(self.residuals(drawn), percent)
        best = drawn[int(np.argmin(counts))]
        count = int(counts.min())
        while count > 0:
            z = self.least(count - 1, seed, drawn)
            fewer = int(component_counts(self.residuals(z), percent))
            if fewer >= count:
                break
            best, count = z, fewer
        return self.least(count, seed, np.vstack([best, drawn]))

    def drawn(self, seed: int) -> Array:
        """Sampled designs (DRAWN + 1, 4 L), without counterweights first."""
        from scipy.stats import qmc

        size = 4 * len(self.masses)
        cube = qmc.Sobol(size, rng=np.random.default_rng(seed)).random(SAMPLED_DESIGNS)
        return np.vstack([np.r_[np.tile([0.0, 0.5, 0.5, 0.5], len(self.masses))], cube])


def _beyond(residuals: Array, kept: int | None) -> Array:
    if kept is None:
        return residuals
    smallest = np.sort(np.abs(residuals), axis=-1)[..., : residuals.shape[-1] - kept]
    return smallest / np.linalg.norm(residuals, axis=-1, keepdims=True)


def _beyond_slopes(residuals: Array, slopes: Array, kept: int | None) -> Array:
    if kept is None:
        return slopes
    smallest = np.argsort(np.abs(residuals), kind="stable")[: len(residuals) - kept]
    size = float(np.linalg.norm(residuals))
    of_size = residuals @ slopes / size
    signs = np.sign(residuals[smallest])[:, None]
    return np.asarray(signs * (slopes[smallest] - residuals[smallest, None] * of_size / size) / size)


def _cost(task: DesignTask, objective: str, percent: float) -> float:
    return float(task.components(percent)) if objective == "components" else task.cost(objective)
