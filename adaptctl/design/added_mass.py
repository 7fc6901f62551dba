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
    """The effect of a body added to a link on the energy, torques and essential parameters of an arm, over the states
    of a `task`.

    `link` is the link's name, `body` what is fixed to it, placed in its frame, and `percent` the energy error (%) at
    which components are counted. P counts ten parameters a link, about its frame's origin (kg, kg m, kg m^2), and rotor
    inertias; friction is left out. `essential`, `components`, `changed` and `becomes_essential` raise `RankError` where
    the mechanism's rank cannot be certified.
    """

    task: DesignTask
    link: str
    body: Payload
    percent: float
    """% energy error at which components are counted"""

    @cached_property
    def change(self) -> Array:
        """The change of the inertial parameters (P,) by the body, SI units. Raises `InputError` for an unknown link and
        where a number overflows."""
        return change_of(self.task, self.link, self.body)

    @cached_property
    def parameters(self) -> Array:
        """The inertial parameters (P,) with the body, SI units."""
        return self.task.parameters + self.change

    @cached_property
    def essential(self) -> Array:
        """The change's projection (P,) on the essential space, V1 V1' times it, in SI units: all of it that changes any
        torque."""
        return self.task.space.project(self.change)

    @property
    def own_energy(self) -> float:
        """Energy of the body alone, J: the root mean square about its mean over the task's states."""
        return self.task.cost("energy", self.change)

    @property
    def energy_change(self) -> float:
        """Relative change of the energy that the arm carries, 0.1 for 10 % more: of its root mean square about its mean
        over the states. Negative where the body balances the arm; infinite where the energy was zero."""
        return self._change("energy")

    @property
    def torque_change(self) -> float:
        """Relative change of the torques, 0.1 for 10 % more: of root mean squares over their limits, all joints
        together. Infinite where the torques were zero."""
        return self._change("torque")

    @property
    def torques(self) -> Array:
        """Root mean square torques (r,) with the body over the task's states, N m (N for a prismatic joint)."""
        return self.task.torques(self.parameters)

    @property
    def components(self) -> int:
        """Number of essential components that keep the energy to an error of `percent`, with the body."""
        return self.task.components(self.percent, self.parameters)

    @cached_property
    def becomes_essential(self) -> tuple[str, ...]:
        """Names of the fundamental parameters that are zero without the body and not with it; zero is a share of the
        energy of at most 1e-6."""
        before = set(self.task.carried())
        return tuple(name for name in self.task.carried(self.parameters) if name not in before)

    @cached_property
    def changed(self) -> tuple[tuple[str, float], ...]:
        """Pairs of a fundamental parameter that the body changes, by name, and its change in SI units (kg, kg m or kg
        m^2); changes below 1e-9 of the greatest are left out."""
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
    """The effect of a body on the link of a name, over a task's states. The body is a `Payload`, or a number: a point's
    mass in kg.

    `place` (3,) is the body's centre of mass in the link's frame, m; by default (None) the payload's own `center`, the
    frame's origin for a point. `percent` is the energy error (%) at which components are counted, by default 1. Raises
    `InputError` for links that do not exist, masses and percentages below zero, places that are not three finite
    numbers and tasks with constant energy, `RankError` where the mechanism's rank cannot be certified.
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
