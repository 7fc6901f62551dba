"""Arms and tasks that designs are tested on, and a brute-force search of counterweights."""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import Any

import numpy as np
from robot_files import urdf

import adaptctl
from adaptctl.arrays import Array
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.design import DesignTask, MountingBounds

ARMS = {
    "puma560_measured": ("link2", "link3"),
    "semi_direct_drive": ("link2", "link3"),
    "ur5": ("upper_arm_link", "forearm_link"),
}
"""An arm, and two links that carry counterweights: shoulder and elbow."""


@cache
def task(name: str, samples: int = 400) -> DesignTask:
    mechanism = adaptctl.load(urdf("ur5_robot.urdf") if name == "ur5" else name)
    return DesignTask.within_limits(mechanism, samples)


def steel_ball(mass: float, place: Any) -> Array:
    """The ten of a ball of steel, written down once more."""
    radius = (3.0 * mass / (4.0 * np.pi * 7850.0)) ** (1.0 / 3.0)
    return from_center_of_mass(mass, np.asarray(place), 0.4 * mass * radius**2 * np.eye(3))


def direct_cost(task: DesignTask, objective: str, parameters: Array) -> float:
    """The cost by what the mechanism with these parameters does in every state, without matrices."""
    arm = task.with_parameters(parameters).mechanism
    if objective == "energy":
        return float(np.std(arm.energy(task.p, task.v)))
    if objective == "torque":
        shares = arm.inverse_dynamics(task.p, task.v, task.a) / task.torque_limits
        return float(np.sqrt(np.mean(np.sum(shares**2, axis=-1))))
    M = arm.mass_matrix(task.p)
    above = np.triu_indices(arm.dof, 1)
    return float(np.sqrt(np.mean(M[:, above[0], above[1]] ** 2)))


def grid_of(places: MountingBounds, each: int) -> tuple[Array, Array]:
    """Designs (each^4, 4), mass and place, on a grid of a link's bounds, and the balls' tens."""
    axes = [
        np.linspace(0.0, places.mass, each),
        *(np.linspace(a, b, each) for a, b in zip(places.lower, places.upper, strict=True)),
    ]
    designs = np.array(list(product(*axes)))
    return designs, np.array([steel_ball(d[0], d[1:]) for d in designs])


def best_on_grid(
    task: DesignTask, objective: str, first: MountingBounds, second: MountingBounds, each: int
) -> tuple[float, Array]:
    """The least cost over all pairs of grid points on two links, and the parameters of that pair.

    |c + A a_i + B b_j|^2 is tabulated as |c + A a_i|^2 + |B b_j|^2 + 2 (c + A a_i)'B b_j, for all i and j.
    """
    M, (D, one), (_, two) = (
        task.cost_matrix(objective),
        (task.parameters, grid_of(first, each)[1]),
        grid_of(second, each),
    )
    places = [10 * task.link_index(p.link) for p in (first, second)]
    base = M @ D + one @ M[:, places[0] : places[0] + 10].T
    more = two @ M[:, places[1] : places[1] + 10].T
    costs = np.sum(base**2, axis=1)[:, None] + np.sum(more**2, axis=1) + 2.0 * base @ more.T
    i, j = np.unravel_index(int(np.argmin(costs)), costs.shape)
    best = np.array(D)
    best[places[0] : places[0] + 10] += one[i]
    best[places[1] : places[1] + 10] += two[j]
    return float(np.sqrt(costs[i, j])), best
