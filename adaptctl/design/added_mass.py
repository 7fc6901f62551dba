"""Effects of a body fixed to a link."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen, frozen_array, positive_number
from adaptctl.caching import cached_property
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.design.bodies import ball_tens, point
from adaptctl.design.mounting_bounds import MountingBounds
from adaptctl.design.task import DesignTask
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.simulation.effects import Payload

# Energy error (%) at which components are counted, unless given.
ENERGY_ERROR_PERCENT = 1.0
# Positions along each edge of a link's box.
GRID_POINTS = 9


@dataclass(frozen=True, eq=False)
class AddedMass:
    """
    Effect of a body added to a link on a mechanism's energy, torques and parameters.

    Made by `added_mass`.

    Parameters
    ----------
    task : DesignTask
        Mechanism, and sampled states of its motion over which root mean squares are taken.
    link : str
        Name of the link that carries the body. An unknown name raises `InputError` on first use.
    body : Payload
        Rigid body fixed to the link, placed in the link's frame.
    percent : float
        Largest allowed energy error in percent, which decides the number of essential `components`.

    Notes
    -----
    Properties raise `RankError` where a rank cannot be certified, `NonFiniteError` where a cost overflows.

    Examples
    --------
    >>> from adaptctl.design import DesignTask, added_mass
    >>> effect = added_mass(DesignTask.within_limits(arm, samples=20), "lower", 0.5)
    >>> effect.torques.shape, effect.energy_change > 0.0
    ((2,), True)
    """

    task: DesignTask
    link: str
    body: Payload
    percent: float

    def __repr__(self) -> str:
        return f"<AddedMass of {self.body.mass:.3g} kg on {self.link!r} of {self.task.mechanism.name!r}>"

    @cached_property
    def parameter_change(self) -> Array:
        """Change (P,) of the inertial parameters in SI units, in the order of `task.parameters`."""
        return frozen(change_of(self.task, self.link, self.body))

    @cached_property
    def parameters(self) -> Array:
        """Inertial parameters (P,) with the body in SI units, without friction."""
        return frozen(self.task.parameters + self.parameter_change)

    @cached_property
    def essential_change(self) -> Array:
        """Part (P,) of `parameter_change` in SI units that torques depend on: its projection on the essential space."""
        return frozen(self.task.essential_space.project(self.parameter_change))

    @property
    def own_energy(self) -> float:
        """Root mean square energy of the body alone about its mean, in J."""
        return self.task.cost("energy", self.parameter_change)

    @property
    def energy_change(self) -> float:
        """Relative change of the root mean square energy; negative if the body acts as a counterweight."""
        return self._change("energy")

    @property
    def torque_change(self) -> float:
        """Relative change of the root mean square of torques divided by their limits, without friction."""
        return self._change("torque")

    @property
    def torques(self) -> Array:
        """Root mean square torques (r,) with the body, in N m (N), without friction."""
        return self.task.torques(self.parameters)

    @property
    def components(self) -> int:
        """Smallest number of essential components whose energy error is at most `percent`."""
        return self.task.components(self.percent, self.parameters)

    @cached_property
    def newly_identifiable(self) -> tuple[str, ...]:
        """Names of the base parameters that make up more than 1e-6 of the energy only with the body."""
        before = set(self.task.nonzero_parameters())
        return tuple(name for name in self.task.nonzero_parameters(self.parameters) if name not in before)

    @cached_property
    def base_parameter_changes(self) -> tuple[tuple[str, float], ...]:
        """Pairs (name, change in SI units) of the base parameters that the body changes."""
        basis = self.task.basis
        changes = basis.regrouping @ self.parameter_change
        size = 1e-9 * float(np.abs(self.parameter_change).max(initial=0.0))
        return tuple((n, x) for n, x in zip(basis.names, changes.tolist(), strict=True) if abs(x) > size)

    def _change(self, objective: str) -> float:
        before = self.task.cost(objective)
        return (self.task.cost(objective, self.parameters) - before) / before if before > 0.0 else np.inf


def added_mass(
    task: DesignTask,
    link: str,
    body: Payload | float,
    place: ArrayLike | None = None,
    *,
    percent: float = ENERGY_ERROR_PERCENT,
) -> AddedMass:
    """
    Compute the effect of adding a body to a link.

    Parameters
    ----------
    task : DesignTask
        Mechanism and states.
    link : str
        Link that carries the body, by name.
    body : Payload or float
        Body to add, or the mass in kg of a point, from 0 to 1e20.
    place : array_like, optional
        Position (3,) of its center of mass in the link's frame in m. Default: the payload's own, or the origin for a
        point.
    percent : float, default 1.0
        Largest error of the energy in percent at which essential components are counted.

    Returns
    -------
    AddedMass
        Effect on energy, torques and parameters.

    Raises
    ------
    InputError
        If the link is unknown, a number is out of range, or the task's energy is constant.
    RankError
        If the number of identifiable parameters cannot be certified.

    Examples
    --------
    >>> from adaptctl.design import DesignTask, added_mass, gripper
    >>> task = DesignTask.within_limits(arm, samples=20)
    >>> [name for name, _ in added_mass(task, "lower", gripper()).base_parameter_changes]
    ['upper.mc_x', 'upper.I_zz', 'lower.mc_x', 'lower.I_zz']
    """
    loaded = Payload.of(body) if isinstance(body, Payload | Mapping) else point(body)
    if place is not None:
        loaded = Payload(loaded.mass, frozen_array(place, (3,), "place"), loaded.inertia)
    task.link_index(link)
    task.components(percent)
    task.validate_energy()
    return AddedMass(task, link, loaded, percent)


def change_of(task: DesignTask, link: str, body: Payload) -> Array:
    """Change (P,) of the inertial parameters in SI units."""
    change, place = np.zeros(len(task.parameters)), 10 * task.link_index(link)
    change[place : place + 10] = from_center_of_mass(body.mass, body.center, body.inertia)
    if not np.isfinite(change).all():
        raise InputError(f"{link}: the body's parameters overflow")
    return change


@dataclass(frozen=True, eq=False)
class LinkCost:
    """Smallest and largest relative change of a cost on a link, and their positions (3,) in m."""

    link: str
    least: float
    cheapest: Array
    most: float
    dearest: Array
    at_center: float


@dataclass(frozen=True, eq=False)
class CostMap:
    """
    Relative change of a motion's cost due to a point mass, as a function of its position.

    Parameters
    ----------
    task : DesignTask
        Mechanism and states.
    mass : float
        Mass of the point in kg.
    objective : {"energy", "torque", "coupling", "components"}
        Cost of the motion, as `DesignTask.cost` computes it.

    Raises
    ------
    InputError
        If the mass is not positive and finite, the objective is unknown, or the cost without the mass is zero.
    RankError
        If "components" is asked for and the rank cannot be certified.

    Examples
    --------
    >>> from adaptctl.design import CostMap, DesignTask
    >>> costs = CostMap(DesignTask.within_limits(arm, samples=20), 0.5, "energy")
    >>> costs.at("lower", np.zeros((4, 3))).shape
    (4,)
    """

    task: DesignTask
    mass: float
    objective: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", positive_number(self.mass, "mass: expected a positive number of kg"))
        if not self.task.cost(self.objective) > 0.0:
            raise InputError(f"objective: {self.objective!r} is zero in all states; give another one")

    def at(self, link: str, positions: ArrayLike) -> Array:
        """
        Compute the relative changes of the cost for positions of the mass on a link.

        Parameters
        ----------
        link : str
            Link that carries the mass, by name.
        positions : array_like
            Positions (..., 3) in the link's frame in m.

        Returns
        -------
        numpy.ndarray
            Relative changes (...) without unit, 0.1 for 10 % more.

        Raises
        ------
        InputError
            If the link is unknown or the shape is wrong (`NonFiniteError` for NaN, infinity and overflow).

        Examples
        --------
        >>> from adaptctl.design import DesignTask, cost_map
        >>> costs = cost_map(DesignTask.within_limits(arm, samples=20))
        >>> costs.at("lower", [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]]).shape
        (2,)
        """
        x = checked(positions, 3, f"{link}: positions")
        M, first = self.task.cost_matrix(self.objective), 10 * self.task.link_index(link)
        before = M @ self.task.parameters
        with np.errstate(over="ignore", invalid="ignore"):
            tens = ball_tens(np.full(x.shape[:-1], self.mass), x)
            after = np.linalg.norm(before + tens @ M[:, first : first + 10].T, axis=-1)
        if not np.isfinite(after).all():
            raise NonFiniteError(
                f"{link}: positions: expected smaller distances, got up to {np.abs(x).max():g} m: the cost overflows"
            )
        size = float(np.linalg.norm(before))
        return np.asarray((after - size) / size)

    def extremes(self, places: MountingBounds, points_per_edge: int = GRID_POINTS) -> LinkCost:
        """
        Find the smallest and the largest relative change on a grid of positions.

        Parameters
        ----------
        places : MountingBounds
            Link, and box of positions on it.
        points_per_edge : int, default 9
            Number of positions along each edge of the box, 1 to 100. 9 by default, so that the middle and both ends of
            every edge are among the 729 positions.

        Returns
        -------
        LinkCost
            Smallest and largest relative change, their positions in m, and the change at the link's center of mass.

        Raises
        ------
        InputError
            If the link is unknown or the number is out of range.

        Examples
        --------
        >>> from adaptctl.design import CostMap, DesignTask, MountingBounds
        >>> costs = CostMap(DesignTask.within_limits(arm, samples=20), 0.5, "energy")
        >>> found = costs.extremes(MountingBounds.for_link(arm, "lower"))
        >>> found.least < found.most
        True
        """
        grid = places.grid(points_per_edge)
        changes = self.at(places.link, grid)
        low, high = int(np.argmin(changes)), int(np.argmax(changes))
        at_center = float(self.at(places.link, self.task.center_of_mass(places.link)))
        return LinkCost(places.link, float(changes[low]), grid[low], float(changes[high]), grid[high], at_center)


def cost_map(task: DesignTask, mass: float = 1.0, objective: str = "energy") -> CostMap:
    """
    Return the relative change of a cost due to a point mass, as a function of its position.

    Parameters
    ----------
    task : DesignTask
        Mechanism and states.
    mass : float, default 1.0
        Mass of the point in kg; by default one kilogram, to read changes per kilogram.
    objective : {"energy", "torque", "coupling", "components"}, default "energy"
        Cost of the motion, as `DesignTask.cost` computes it.

    Returns
    -------
    CostMap
        Map of the relative changes, a function of link and position.

    Raises
    ------
    InputError
        If the mass is not positive and finite, the objective is unknown, or the cost without the mass is zero.
    RankError
        If "components" is asked for and the rank cannot be certified.

    Examples
    --------
    >>> from adaptctl.design import DesignTask, cost_map
    >>> cost_map(DesignTask.within_limits(arm, samples=20), 0.5).at("upper", [0.0, 0.0, 0.0]).shape
    ()
    """
    task.validate_energy()
    return CostMap(task, mass, objective)
