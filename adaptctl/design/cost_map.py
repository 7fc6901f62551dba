"""Map of the cost of a point mass at every place of an arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, positive_number
from adaptctl.design.bodies import ball_tens
from adaptctl.design.places import PlaceBounds
from adaptctl.design.task import DesignTask
from adaptctl.errors import InputError, NonFiniteError

EACH = 9
"""PlaceBounds along each edge of a link's box that are looked at."""


@dataclass(frozen=True, eq=False)
class LinkCost:
    """Cost of a point mass on a link named `link`: the `least` and the `most` of the relative changes (unitless, 0.1
    for 10 % more) that the mass makes, over a grid of positions, of a cost of the mechanism's motion, such as its root
    mean square energy. `cheapest` and `dearest` (3,) are the positions of both, m in the link's frame; `at_center` is
    the change with the mass at the link's centre of mass. Made by `CostMap.over`; nothing is checked at
    construction."""

    link: str
    least: float
    cheapest: Array
    """(3,) m in the link's frame"""
    most: float
    dearest: Array
    at_center: float
    """at the link's centre of mass"""


@dataclass(frozen=True, eq=False)
class CostMap:
    """Map of the relative changes (unitless) that a point `mass` (kg), fixed at any position on any link, makes of a
    cost of a mechanism's motion over a `task`, a `DesignTask`.

    `objective` names the cost, a root mean square over the task's states: "energy" of the kinetic plus potential energy
    about its mean (J), "torque" of the joint torques as fractions of their limits (unitless), "coupling" of the mass
    matrix's entries off the diagonal (kg m^2; their mean over pairs of joints), "components" of the energy about its
    mean, computed from the combinations of inertial parameters that change it (J). Made by `cost_map`. Raises
    `InputError` at construction for a mass that is not positive and finite, for an unknown objective and for a cost
    that is zero without the mass, `RankError` for "components" where the number of identifiable parameters cannot be
    certified.
    """

    task: DesignTask
    mass: float
    objective: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", positive_number(self.mass, "mass: expected a positive number of kg"))
        if not self.task.cost(self.objective) > 0.0:
            raise InputError(
                f"objective: expected one that costs something, got {self.objective!r}: zero in all states"
            )

    def at(self, link: str, places: ArrayLike) -> Array:
        """Relative changes (...), unitless, 0.1 for 10 % more, of the cost that this map's `objective` names, by its
        point mass at the positions `places` (..., 3), m in the frame of the link named `link`. Raises `InputError` for
        unknown links and for positions of another shape, `NonFiniteError` for positions that are not finite, or so far
        that the cost overflows."""
        x = checked(places, 3, f"{link}: places")
        M, first = self.task.matrix(self.objective), 10 * self.task.link(link)
        before = M @ self.task.parameters
        with np.errstate(over="ignore", invalid="ignore"):
            tens = ball_tens(np.full(x.shape[:-1], self.mass), x)
            after = np.linalg.norm(before + tens @ M[:, first : first + 10].T, axis=-1)
        if not np.isfinite(after).all():
            raise NonFiniteError(
                f"{link}: places: expected nearer ones, got up to {np.abs(x).max():g} m: cost overflows"
            )
        size = float(np.linalg.norm(before))
        return np.asarray((after - size) / size)

    def over(self, places: PlaceBounds, each: int = EACH) -> LinkCost:
        """The least and the greatest relative change (unitless), 0.1 for 10 % more, of the cost that this map's
        `objective` names, by its point mass on a grid of positions on a link, and the positions of both, as a
        `LinkCost`.

        The grid has `each` positions, 9 by default, along each edge of the box of `places`, a `PlaceBounds`, which also
        names the link. The `LinkCost` has the link's name, the changes `least` and `most`, their positions `cheapest`
        and `dearest` (3,), m in the link's frame, and the change `at_center`, for the mass at the link's centre of
        mass. Raises `InputError` for unknown links and `each` other than a whole number from 1 to 100, `NonFiniteError`
        for bounds so far that the cost overflows.
        """
        grid = places.grid(each)
        changes = self.at(places.link, grid)
        low, high = int(np.argmin(changes)), int(np.argmax(changes))
        at_center = float(self.at(places.link, self.task.center_of_mass(places.link)))
        return LinkCost(places.link, float(changes[low]), grid[low], float(changes[high]), grid[high], at_center)


def cost_map(task: DesignTask, mass: float = 1.0, objective: str = "energy") -> CostMap:
    """The map, a `CostMap`, of the relative changes (unitless) that a point mass (kg; 1 by default), fixed at any
    position on any link, makes of a cost of a mechanism's motion over a task.

    `objective` names the cost, a root mean square over the task's states: "energy", the default, of the kinetic plus
    potential energy about its mean (J), "torque" of the joint torques as fractions of their limits (unitless),
    "coupling" of the mass matrix's entries off the diagonal (kg m^2; their mean over pairs of joints), "components" of
    the energy about its mean, computed from the combinations of inertial parameters that change it (J). Raises
    `InputError` for a mass that is not positive and finite, for an unknown objective, for a cost that is zero without
    the mass and for a task with constant energy, and `RankError` for "components" where the number of identifiable
    parameters cannot be certified.
    """
    task.require_energy()
    return CostMap(task, mass, objective)
