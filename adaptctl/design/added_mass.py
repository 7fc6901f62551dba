"""Costs of a body fixed to a link: its projection on the essential space, and the cost of the motion with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.caching import cached_property
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.design.task import DesignTask
from adaptctl.errors import InputError
from adaptctl.simulation.effects import Payload

PERCENT = 1.0
"""Energy error (%) at which components are counted, unless given."""


@dataclass(frozen=True, eq=False)
class AddedMass:
    """The effect of an added body on the energy, torques and essential parameters of an arm, over a task's states."""

    task: DesignTask
    link: str
    body: Payload
    percent: float
    """% energy error at which components are counted"""

    @cached_property
    def change(self) -> Array:
        """The change of the inertial parameters (P,), SI units."""
        return change_of(self.task, self.link, self.body)

    @cached_property
    def parameters(self) -> Array:
        """The inertial parameters (P,) with the body, SI units."""
        return self.task.parameters + self.change

    @cached_property
    def essential(self) -> Array:
        """The change's projection (P,) on the essential space, V1 V1' times it: all of it that changes any torque."""
        return self.task.space.project(self.change)

    @property
    def own_energy(self) -> float:
        """Energy of the body alone, J: the root mean square about its mean over the task's states."""
        return self.task.cost("energy", self.change)

    @property
    def energy_change(self) -> float:
        """Change of the energy that the arm carries, as a share of it; negative where the body balances the arm."""
        return self._change("energy")

    @property
    def torque_change(self) -> float:
        """Change of the torques, as a share of them: root mean squares over their limits, all joints together."""
        return self._change("torque")

    @property
    def torques(self) -> Array:
        """Root mean square torques (r,) with the body, N m or N."""
        return self.task.torques(self.parameters)

    @property
    def components(self) -> int:
        """Number of essential components that keep the energy to an error of `percent`."""
        return self.task.components(self.percent, self.parameters)

    @cached_property
    def becomes_essential(self) -> tuple[str, ...]:
        """Names of the fundamental parameters that are zero without the body, and are not with it."""
        before = set(self.task.carried())
        return tuple(name for name in self.task.carried(self.parameters) if name not in before)

    @cached_property
    def changed(self) -> tuple[tuple[str, float], ...]:
        """Names of the fundamental parameters that the body changes, and by how much, in SI units."""
        basis = self.task.basis
        changes = basis.regrouping @ self.change
        size = 1e-9 * float(np.abs(self.change).max(initial=0.0))
        return tuple((n, x) for n, x in zip(basis.names, changes.tolist(), strict=True) if abs(x) > size)

    def _change(self, objective: str) -> float:
        before = self.task.cost(objective)
        return (self.task.cost(objective, self.parameters) - before) / before if before > 0.0 else np.inf


def added_mass(
    task: DesignTask, link: str, body: Payload | float, place: ArrayLike | None = None, *, percent: float = PERCENT
) -> AddedMass:
    """The effect of a body on a link; a number is a point's mass in kg. `place` (3,) is its centre in the link's frame.

    Without a place, it is where the body says. Raises `InputError` for links that do not exist, masses below zero and
    places that are not finite.
    """
    loaded = Payload.of(body)
    if place is not None:
        loaded = Payload(loaded.mass, frozen_array(place, (3,), "place"), loaded.inertia)
    task.link(link)
    task.components(percent)
    task.require_energy()
    return AddedMass(task, link, loaded, percent)


def change_of(task: DesignTask, link: str, body: Payload) -> Array:
    """The change (P,) of inertial parameters by a body on a link. Raises `InputError` where a number overflows."""
    change, place = np.zeros(len(task.parameters)), 10 * task.link(link)
    change[place : place + 10] = from_center_of_mass(body.mass, body.center, body.inertia)
    if not np.isfinite(change).all():
        raise InputError(f"{link}: the body is too large for numbers")
    return change
