"""Costs of a body fixed to a link: its projection on the essential space, and the cost of the motion with it."""

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

PERCENT = 1.0
"""Energy error (%) at which components are counted, unless given."""
EACH = 9
"""Places along each edge of a link's box that are looked at."""


@dataclass(frozen=True, eq=False)
class AddedMass:
    """The effect of a body added to a link on the energy, the joint torques and the essential parameters of a
    mechanism, over the states of a `task`, a `DesignTask`.

    `link` is the link's name, `body` the `Payload` fixed to it, placed in the link's frame, and `percent` the energy
    error (%) that the property `components`, a number of essential components, allows; essential components are the
    parts of the inertial parameters along the right singular vectors of the task's energies. Energies, kinetic plus
    potential, are root mean squares about their mean over the states. There are P inertial parameters: ten a link,
    about its frame's origin (kg, kg m, kg m^2), and rotor inertias (kg m^2, kg for a prismatic joint); friction is left
    out. Made by `added_mass`; nothing is checked at construction. An unknown link or a percentage that is no finite
    number of at least 0 raises `InputError` where it is first used. The properties `essential`, `components`, `changed`
    and `becomes_essential` raise `RankError` where the number of identifiable parameters cannot be certified.
    """

    task: DesignTask
    link: str
    body: Payload
    percent: float

    @cached_property
    def change(self) -> Array:
        """The change (P,) of a mechanism's P inertial parameters by the body added to a link of it. That link's ten
        change by the body's mass m (kg), first moments mc_x, mc_y, mc_z (kg m) and inertia tensor's entries I_xx, I_xy,
        I_yy, I_xz, I_yz, I_zz (kg m^2), about the origin of the link's frame; the others by zero. The order is ten a
        link, in the mechanism's order of links, then rotor inertias. Raises `InputError` for an unknown link and where
        a parameter overflows. Read-only."""
        return frozen(change_of(self.task, self.link, self.body))

    @cached_property
    def parameters(self) -> Array:
        """The P inertial parameters (P,) of a mechanism with the added body, without friction: of each link, in the
        mechanism's order, its mass m (kg), first moments mc_x, mc_y, mc_z (kg m) and inertia tensor's entries I_xx,
        I_xy, I_yy, I_xz, I_yz, I_zz (kg m^2), about the origin of its frame, then rotor inertias (kg m^2, or kg for a
        prismatic joint). Raises `InputError` for an unknown link. Read-only."""
        return frozen(self.task.parameters + self.change)

    @cached_property
    def essential(self) -> Array:
        """The projection V1 V1' c (P,), in SI units, of the change c (P,) of a mechanism's P inertial parameters by the
        added body, in the order of the property `parameters`: the part of c that changes energies and torques. V1 (P,
        k) is an orthonormal basis of the essential space: the k right singular vectors of the task's energies whose
        singular values are not zero. Raises `InputError` for an unknown link, `RankError` where the number of
        identifiable parameters cannot be certified. Read-only."""
        return frozen(self.task.space.project(self.change))

    @property
    def own_energy(self) -> float:
        """Energy of the added body alone, kinetic plus potential, J: the root mean square about its mean over the
        task's states. Raises `InputError` for an unknown link, `NonFiniteError` where the energy overflows."""
        return self.task.cost("energy", self.change)

    @property
    def energy_change(self) -> float:
        """Relative change (unitless) of the mechanism's energy by the added body, 0.1 for 10 % more. The energy is
        kinetic plus potential, as its root mean square about its mean over the task's states. Negative where the body
        balances the mechanism; infinite where the energy without the body is zero. Raises `InputError` for an unknown
        link, `NonFiniteError` where the energy overflows."""
        return self._change("energy")

    @property
    def torque_change(self) -> float:
        """Relative change (unitless) of the joint torques, without friction, by the added body, 0.1 for 10 % more. The
        torques, each as a fraction of its joint's torque limit, count as one number: the square root of the sum, over
        the joints, of their mean squares over the task's states. Infinite where the torques without the body are zero.
        Raises `InputError` for an unknown link, `NonFiniteError` where the torques overflow."""
        return self._change("torque")

    @property
    def torques(self) -> Array:
        """Root mean square torques (r,) of the r primary (independently moving) joints with the added body, over the
        task's states, N m (N for a prismatic joint), without friction. Raises `InputError` for an unknown link,
        `NonFiniteError` where the torques overflow."""
        return self.task.torques(self.parameters)

    @property
    def components(self) -> int:
        """Least number of essential components that keep the mechanism's root mean square energy, with the added body,
        to an error of at most this object's `percent` (%; Sheu and Walker 1991, equation 23). Essential components are
        the parts of the inertial parameters along the right singular vectors of the task's energies. Raises
        `InputError` for an unknown link and for a percentage that is no finite number of at least 0, `RankError` where
        the number of identifiable parameters cannot be certified."""
        return self.task.components(self.percent, self.parameters)

    @cached_property
    def newly_identifiable(self) -> tuple[str, ...]:
        """Names of the fundamental (base) parameters that matter only with the added body: the part of the energy that
        each makes alone is more than 1e-6 (unitless) of the whole with the body, and at most 1e-6 without it. Energies
        are kinetic plus potential, as root mean squares about their mean over the task's states. Raises `InputError`
        for an unknown link and where the energy is constant, with the body or without, `RankError` where the number of
        identifiable parameters cannot be certified."""
        before = set(self.task.nonzero_parameters())
        return tuple(name for name in self.task.nonzero_parameters(self.parameters) if name not in before)

    @cached_property
    def changed(self) -> tuple[tuple[str, float], ...]:
        """Pairs (name, change), in the order of the basis `task.basis`, of the fundamental (base) parameters that the
        added body changes, the changes in SI units (kg, kg m or kg m^2). Left out are changes whose magnitude, in SI
        units, is at most 1e-9 of the greatest change of one of the link's ten inertial parameters. Raises `InputError`
        for an unknown link, `RankError` where the number of identifiable parameters cannot be certified."""
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
    """The effect, an `AddedMass`, of adding a body to the link named `link` on energy, torques and essential parameters
    of a task's mechanism, over the task's states. The body is a `Payload`, or a number: a point's mass in kg, from 0 to
    1e20.

    `place` (3,) is the position of the body's centre of mass in the link's frame, m, which replaces the payload's own;
    by default (None) the payload's own `center`, or the frame's origin for a point. `percent` is the error (%), by
    default 1, of the root mean square energy, kinetic plus potential, that the result's number of essential components
    allows. Raises `InputError` for links that do not exist, masses out of range, percentages that are no finite number
    of at least 0, positions that are not three finite numbers, bodies with inertial parameters above 1e20 and tasks
    with constant energy, `NonFiniteError` where the energy overflows, `RankError` where the number of identifiable
    parameters cannot be certified.
    """
    loaded = Payload.of(body) if isinstance(body, Payload | Mapping) else point(body)
    if place is not None:
        loaded = Payload(loaded.mass, frozen_array(place, (3,), "place"), loaded.inertia)
    task.link(link)
    task.components(percent)
    task.validate_energy()
    return AddedMass(task, link, loaded, percent)


def change_of(task: DesignTask, link: str, body: Payload) -> Array:
    """The change (P,) of a mechanism's P inertial parameters by a `body` fixed to the link named `link`: that of the
    link's mass m (kg), first moments mc_x, mc_y, mc_z (kg m) and inertia tensor's entries I_xx, I_xy, I_yy, I_xz, I_yz,
    I_zz (kg m^2), about the origin of its frame, and zero for all others. The order is that of `task.parameters`: ten a
    link, in the mechanism's order of links, then rotor inertias. Raises `InputError` for an unknown link and where a
    parameter overflows."""
    change, place = np.zeros(len(task.parameters)), 10 * task.link(link)
    change[place : place + 10] = from_center_of_mass(body.mass, body.center, body.inertia)
    if not np.isfinite(change).all():
        raise InputError(f"{link}: the body is too large for numbers")
    return change


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
    most: float
    dearest: Array
    at_center: float


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

    def over(self, places: MountingBounds, each: int = EACH) -> LinkCost:
        """The least and the greatest relative change (unitless), 0.1 for 10 % more, of the cost that this map's
        `objective` names, by its point mass on a grid of positions on a link, and the positions of both, as a
        `LinkCost`.

        The grid has `each` positions, 9 by default, along each edge of the box of `places`, a `MountingBounds`, which
        also names the link. The `LinkCost` has the link's name, the changes `least` and `most`, their positions
        `cheapest` and `dearest` (3,), m in the link's frame, and the change `at_center`, for the mass at the link's
        centre of mass. Raises `InputError` for unknown links and `each` other than a whole number from 1 to 100,
        `NonFiniteError` for bounds so far that the cost overflows.
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
    task.validate_energy()
    return CostMap(task, mass, objective)
