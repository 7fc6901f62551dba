"""Map of the cost of a point mass at every place of an arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, positive_number
from adaptctl.design.bodies import ball_tens
from adaptctl.design.places import PlaceBounds
from adaptctl.design.task import DesignTask

EACH = 9
"""PlaceBounds along each edge of a link's box that are looked at."""


@dataclass(frozen=True, eq=False)
class LinkCost:
    """Cost of a point mass on a link: the places where it is least and most, as changes of the arm's cost by shares of
    it."""

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
    """Map of a point mass's (kg) effect on an objective: relative changes of its cost, over places on links."""

    task: DesignTask
    mass: float
    objective: str

    def at(self, link: str, places: ArrayLike) -> Array:
        """Relative changes (...) of the cost by the mass at places (..., 3), m in a link's frame. Raises `InputError`
        for unknown links."""
        x = checked(places, 3, f"{link}: places")
        M, first = self.task.matrix(self.objective), 10 * self.task.link(link)
        before = M @ self.task.parameters
        tens = ball_tens(np.full(x.shape[:-1], self.mass), x)
        after = np.linalg.norm(before + tens @ M[:, first : first + 10].T, axis=-1)
        size = float(np.linalg.norm(before))
        return np.asarray((after - size) / size)

    def over(self, places: PlaceBounds, each: int = EACH) -> LinkCost:
        """The least and the greatest relative change of the cost on a grid of `each`^3 places on a link, and where they
        are."""
        grid = places.grid(each)
        changes = self.at(places.link, grid)
        low, high = int(np.argmin(changes)), int(np.argmax(changes))
        at_center = float(self.at(places.link, self.task.center_of_mass(places.link)))
        return LinkCost(places.link, float(changes[low]), grid[low], float(changes[high]), grid[high], at_center)


def cost_map(task: DesignTask, mass: float = 1.0, objective: str = "energy") -> CostMap:
    """The map of what a point mass (kg) changes of an objective's cost. Raises `InputError` for other than a positive
    mass, and for an unknown objective."""
    task.matrix(objective)
    task.require_energy()
    return CostMap(task, positive_number(mass, "mass"), objective)
