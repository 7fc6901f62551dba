"""Counterweights: balls of steel on links that make an arm's motion cheaper, found within bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.arrays import Array, frozen, positive_number, whole_number
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.description.inertia import is_physically_consistent
from adaptctl.design.added_mass import PERCENT
from adaptctl.design.bodies import STEEL, ball_tens, ball_tens_slopes, sphere
from adaptctl.design.mounting_bounds import MountingBounds
from adaptctl.design.task import OBJECTIVES, DesignTask, component_counts
from adaptctl.errors import InputError
from adaptctl.simulation.effects import Payload

DRAWN, STARTS = 4096, 10
"""Designs that are looked at first, evenly spread, and the best of them that are improved."""
NO_MASS = 1e-6
"""Share of the mass allowed below which there is no counterweight."""


@sent_as_made
@dataclass(frozen=True, eq=False)
class Counterweight:
    """A counterweight: a solid ball of a `mass` (kg) and a `density` (kg/m^3) on the link named `link`, its centre at
    the position `place` (3,), m in the link's frame.

    Raises `InputError` for a mass below zero or above 1e20 kg, a density not from 1e-100 to 1e100, a position that is
    not of shape (3,), inertial parameters about the frame's origin above 1e20 (SI units), and numbers that are not
    finite. The link's name is checked only where it is used.
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
        """The counterweight as a rigid body, a `Payload`, in the link's frame: mass (kg), centre (3,), m, and inertia
        (3, 3), kg m^2, about it."""
        return sphere(self.mass, self.place, density=self.density)


@dataclass(frozen=True, eq=False)
class Counterweights:
    """Optimal counterweights of a mechanism, which make a cost of its motion least within bounds, with the costs with
    and without them: the result of `optimal_counterweights`.

    `task` (a `DesignTask`), `objective` (the cost: "energy", "torque", "coupling", which is the mass matrix's entries
    off the diagonal, or "components", which is the number of essential components), `within` (the bounds of masses and
    positions, one `MountingBounds` for each link) and `percent` are those asked for. Essential components are the parts
    of the inertial parameters along the right singular vectors of the task's energies; `percent` is the energy error
    (%) that their number allows. `weights` are the counterweights found, in the order of `within`, without those of at
    most 1e-6 of the mass allowed on their link, and `evaluations` is the number of designs evaluated. Nothing is
    checked at construction.
    """

    task: DesignTask
    objective: str
    percent: float
    within: tuple[MountingBounds, ...]
    weights: tuple[Counterweight, ...]
    evaluations: int

    @cached_property
    def parameters(self) -> Array:
        """The P inertial parameters (P,) of a mechanism with the counterweights, without friction: of each link, in the
        mechanism's order, its mass m (kg), first moments mc_x, mc_y, mc_z (kg m) and inertia tensor's entries I_xx,
        I_xy, I_yy, I_xz, I_yz, I_zz (kg m^2), about the origin of its frame, then rotor inertias (kg m^2, or kg for a
        prismatic joint). Raises `InputError` for a counterweight on an unknown link. Read-only."""
        D = np.array(self.task.parameters)
        for weight in self.weights:
            first = 10 * self.task.link(weight.link)
            D[first : first + 10] += ball_tens(weight.mass, weight.place, weight.density)
        return frozen(D)

    @cached_property
    def balanced_task(self) -> DesignTask:
        """Design task of the mechanism with the counterweights, a `DesignTask`: the same states as without them, and
        inertial parameters that include them. Raises `InputError` for a counterweight on an unknown link and for a
        link's inertial parameter above 1e20 (SI units)."""
        return self.task.with_parameters(self.parameters)

    @property
    def cost_before(self) -> float:
        """The cost, which this object's `objective` names, of the mechanism's motion without counterweights: a root
        mean square over the task's states, of the energy about its mean, J ("energy"), of the joint torques as
        fractions of their limits, unitless ("torque"), or of the mass matrix's entries off the diagonal, kg m^2
        ("coupling"); or the number of essential components (parts of the inertial parameters along the right singular
        vectors of the energies) that keep the energy to an error of this object's `percent` % ("components"). Raises
        `InputError` for an unknown objective and, for "components", for a percentage that is no finite number of at
        least 0, `NonFiniteError` where the cost overflows, `RankError` for "components" where the number of
        identifiable parameters cannot be certified."""
        return _cost(self.task, self.objective, self.percent)

    @property
    def cost_after(self) -> float:
        """The cost, which this object's `objective` names, of the mechanism's motion with the counterweights: a root
        mean square over the task's states, of the energy about its mean, J ("energy"), of the joint torques as
        fractions of their limits, unitless ("torque"), or of the mass matrix's entries off the diagonal, kg m^2
        ("coupling"); or the number of essential components (parts of the inertial parameters along the right singular
        vectors of the energies) that keep the energy to an error of this object's `percent` % ("components"). Raises
        `InputError` for a counterweight on an unknown link, for a link's inertial parameter above 1e20 (SI units), for
        an unknown objective and, for "components", for a percentage that is no finite number of at least 0,
        `NonFiniteError` where the cost overflows, `RankError` for "components" where the number of identifiable
        parameters cannot be certified."""
        return _cost(self.balanced_task, self.objective, self.percent)

    @property
    def relative_reduction(self) -> float:
        """Fraction (unitless) by which the counterweights reduce the cost of the mechanism's motion that this object's
        `objective` names: (before - after) / before, of the properties `cost_before` and `cost_after`; 0 where the cost
        without them is zero. The cost "components" is the number of essential components (parts of the inertial
        parameters along the right singular vectors of the energies) that keep the energy to an error of `percent` %.
        Raises `InputError` for a counterweight on an unknown link, for a link's inertial parameter above 1e20 (SI
        units), for an unknown objective and, for "components", for a percentage that is no finite number of at least 0,
        `NonFiniteError` where the cost overflows, `RankError` for "components" where the number of identifiable
        parameters cannot be certified."""
        return 1.0 - self.cost_after / self.cost_before if self.cost_before > 0.0 else 0.0

    @property
    def inconsistent(self) -> tuple[str, ...]:
        """Names of the links whose ten inertial parameters, with the counterweights, no rigid body can have, since
        their pseudo-inertia (4, 4), the matrix of second moments, first moments and mass, is not positive definite. A
        link whose pseudo-inertia is positive definite without the counterweights is not among them. Raises `InputError`
        for a counterweight on an unknown link."""
        names, tens = self.task.mechanism.description.body_names, self.parameters
        pairs = ((name, tens[10 * i : 10 * i + 10]) for i, name in enumerate(names))
        return tuple(name for name, ten in pairs if not is_physically_consistent(ten))


def optimal_counterweights(
    task: DesignTask,
    within: Sequence[MountingBounds],
    objective: str = "energy",
    *,
    percent: float = PERCENT,
    density: float = STEEL,
    seed: int = 0,
) -> Counterweights:
    """The counterweights, at most one ball on each link of `within`, that make a cost of a mechanism's motion over a
    task least, as a `Counterweights`. `within` has one `MountingBounds` for each such link: bounds of the ball's mass
    and position.

    `objective` names the cost: a root mean square over the task's states, of the energy about its mean ("energy", J),
    of the joint torques as fractions of their limits ("torque", unitless), or of the mass matrix's entries off the
    diagonal ("coupling", kg m^2); or the number of essential components ("components"). Essential components are the
    parts of the inertial parameters along the right singular vectors of the task's energies; the fewest are counted
    that keep the energy to an error of `percent`, by default 1 %, and of designs with equally few, the one with the
    least error is taken. Balls, of a density in kg/m^3 (steel's 7850 by default), have a positive definite
    pseudo-inertia (the matrix of second moments, first moments and mass), so that links that are physically consistent
    stay so. The search starts from the ten best of 4096 designs of a scrambled Sobol sequence, the same for the same
    `seed`, and of the design without counterweights, and goes on by trust regions within bounds (SciPy's
    `least_squares`): a local optimum between the sampled designs can be missed. Raises `InputError` for an unknown
    objective or link, for no links or one given twice, for a `percent` that is no finite number of at least 0, a
    density not positive and finite, a `seed` other than a whole number from 0 to 2^32 - 1 and a task with constant
    energy, `RankError` where the number of identifiable parameters cannot be certified.
    """
    if objective not in OBJECTIVES:
        raise InputError(f"objective: expected one of {', '.join(OBJECTIVES)}, got {objective!r}")
    links = [places.link for places in within]
    if not links or len(set(links)) < len(links):
        raise InputError(f"counterweights: expected places on at least one link, each once, got {', '.join(links)}")
    seed = whole_number(seed, "counterweights: seed", 0, 2**32 - 1)
    task.components(percent)
    task.validate_energy()
    search = _Search(task, tuple(within), objective, positive_number(density, "density: expected a positive number"))
    z = search.fewest(percent, seed) if objective == "components" else search.least(None, seed)
    masses, places = search.physical(z)
    found = [
        Counterweight(name, mass, place, density)
        for name, mass, place, most in zip(links, masses.tolist(), places, search.masses.tolist(), strict=True)
        if mass > NO_MASS * most
    ]
    return Counterweights(task, objective, percent, tuple(within), tuple(found), search.evaluations)


class _Search:
    """Residuals M (D + change) over designs z (4 L,) in the unit cube: a link's mass, then its place."""

    def __init__(self, task: DesignTask, within: tuple[MountingBounds, ...], objective: str, density: float) -> None:
        M = task.matrix(objective)
        firsts = [10 * task.link(places.link) for places in within]
        self.fixed = M @ task.parameters
        self.shares = np.stack([M[:, first : first + 10] for first in firsts])
        self.masses = np.array([places.mass for places in within])
        self.lower = np.stack([places.lower for places in within])
        self.width = np.stack([places.upper for places in within]) - self.lower
        self.density, self.evaluations = density, 0

    def physical(self, z: Array) -> tuple[Array, Array]:
        """Masses (..., L) in kg and places (..., L, 3) in m."""
        each = z.reshape(*z.shape[:-1], len(self.masses), 4)
        return each[..., 0] * self.masses, self.lower + each[..., 1:] * self.width

    def residuals(self, z: Array) -> Array:
        """M (D + change) (..., n) of designs (..., 4 L)."""
        self.evaluations += int(np.prod(z.shape[:-1]))
        tens = ball_tens(*self.physical(z), self.density)
        return self.fixed + np.einsum("...li,lni->...n", tens, self.shares)

    def slopes(self, z: Array) -> Array:
        """Slopes (n, 4 L) of the residuals of one design (4 L,)."""
        each = ball_tens_slopes(*self.physical(z), self.density)
        each[..., 0] *= self.masses[:, None]
        each[..., 1:] *= self.width[:, None, :]
        return np.concatenate(list(self.shares @ each), axis=-1)

    def least(self, kept: int | None, seed: int, designs: Array | None = None) -> Array:
        """The design of least residuals; with `kept`, of the least share that is beyond as many components."""
        from scipy.optimize import least_squares

        def share(z: Array) -> Array:
            return _beyond(self.residuals(z), kept)

        def slopes(z: Array) -> Array:
            return _beyond_slopes(self.residuals(z), self.slopes(z), kept)

        drawn = self.drawn(seed) if designs is None else designs
        order = np.argsort(np.linalg.norm(share(drawn), axis=-1), kind="stable")
        settings: dict[str, Any] = {"bounds": (0.0, 1.0), "xtol": 1e-9, "ftol": 1e-9, "max_nfev": 200}
        found = [least_squares(share, z, slopes, **settings) for z in drawn[order[:STARTS]]]
        return np.asarray(min(found, key=lambda result: result.cost).x, dtype=np.float64)

    def fewest(self, percent: float, seed: int) -> Array:
        """The design with the fewest components: one less at a time, for as long as the error allows."""
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
        """Designs (DRAWN + 1, 4 L) spread evenly over the cube, and the one without counterweights first."""
        from scipy.stats import qmc

        size = 4 * len(self.masses)
        cube = qmc.Sobol(size, rng=np.random.default_rng(seed)).random(DRAWN)
        return np.vstack([np.r_[np.tile([0.0, 0.5, 0.5, 0.5], len(self.masses))], cube])


def _beyond(residuals: Array, kept: int | None) -> Array:
    """The residuals themselves, or as shares of all of them those beyond the `kept` largest."""
    if kept is None:
        return residuals
    smallest = np.sort(np.abs(residuals), axis=-1)[..., : residuals.shape[-1] - kept]
    return smallest / np.linalg.norm(residuals, axis=-1, keepdims=True)


def _beyond_slopes(residuals: Array, slopes: Array, kept: int | None) -> Array:
    """Slopes of `_beyond` (n, 4 L) where no two sizes are alike."""
    if kept is None:
        return slopes
    smallest = np.argsort(np.abs(residuals), kind="stable")[: len(residuals) - kept]
    size = float(np.linalg.norm(residuals))
    of_size = residuals @ slopes / size
    signs = np.sign(residuals[smallest])[:, None]
    return np.asarray(signs * (slopes[smallest] - residuals[smallest, None] * of_size / size) / size)


def _cost(task: DesignTask, objective: str, percent: float) -> float:
    return float(task.components(percent)) if objective == "components" else task.cost(objective)
