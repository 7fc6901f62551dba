"""A study of a mechanism's design: what masses cost, which counterweights help, which parameters can go."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description import GROUND, Link
from adaptctl.design.added_mass import PERCENT, AddedMass, CostMap, LinkCost, added_mass, cost_map
from adaptctl.design.bodies import CATALOGUE, point
from adaptctl.design.counterweights import Counterweights, optimal_counterweights
from adaptctl.design.mounting_bounds import BEYOND, SHARE, MountingBounds, bounds
from adaptctl.design.simplifications import Simplification, operations_saved, simplifications
from adaptctl.design.task import DesignTask
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NotFoundError
from adaptctl.simulation.effects import Payload

MOST_LINKS = 6
"""Links that carry counterweights where none are named."""
UPRIGHT = 1e-6
"""rad off the vertical"""
SHOWN = 6
"""Removals by symmetry, and as many by masses, whose operations are counted."""


@dataclass(frozen=True, eq=False)
class DesignStudy:
    """Results of a design study: added masses, counterweights and removable parameters of a mechanism over a `task`, a
    `DesignTask`.

    `body` is the `Payload` to add, `within` holds the bounds (`MountingBounds`) of masses and positions on every link,
    `percent` is the energy error (%) that numbers of essential components (parts of the inertial parameters along the
    right singular vectors of the energies) allow, `counterweights`, a `Counterweights`, has the optimal ones, and
    `simplifications` has all design changes that remove fundamental (base) parameters, one `Simplification` each, those
    that leave the fewest first. Made by `design_study`; nothing is checked at construction.
    """

    task: DesignTask
    body: Payload
    within: tuple[MountingBounds, ...]
    percent: float
    counterweights: Counterweights
    simplifications: tuple[Simplification, ...]

    @cached_property
    def map(self) -> CostMap:
        """Map, a `CostMap`, of the relative changes (unitless) of a mechanism's energy by a point mass, that of the
        study's `body`, at any position on any link. The energy is kinetic plus potential, as its root mean square about
        its mean over the task's states. Raises `InputError` for a body without mass and a task with constant energy."""
        return cost_map(self.task, self.body.mass)

    @cached_property
    def links(self) -> tuple[LinkCost, ...]:
        """The cheapest and the dearest position on every link for a point mass, that of the study's `body`, one
        `LinkCost` for each of its `within`, the bounds (`MountingBounds`) of links' boxes for the mass, in that order.
        They are found among 9 positions along each edge of the link's box: positions (3,), m in the link's frame, and
        relative changes (unitless) of the root mean square energy, kinetic plus potential, about its mean over the
        task's states. Raises `InputError` for a body without mass and a task with constant energy, `NonFiniteError` for
        bounds so far that the energy overflows."""
        return tuple(self.map.over(places) for places in self.within)

    @cached_property
    def added(self) -> tuple[AddedMass, ...]:
        """Effects, one `AddedMass` for each link of `within`, in that order, of the study's `body` added to that link
        alone, its centre of mass at the link's. Raises `InputError` for a task with constant energy and for a
        percentage that is no finite number of at least 0, `RankError` where the number of identifiable parameters
        cannot be certified."""
        centers = (self.task.center_of_mass(places.link) for places in self.within)
        pairs = zip(self.within, centers, strict=True)
        return tuple(added_mass(self.task, p.link, self.body, x, percent=self.percent) for p, x in pairs)

    @cached_property
    def bodies(self) -> dict[str, dict[str, float]]:
        """Relative changes (no unit, 0.1 for 10 % more) of the energy by a gripper, a camera and a motor, each added to
        one link, its centre of mass at the link's: a dict by the body's name of dicts by the link's. Raises as the
        property `added` does."""
        task, links = self.task, [places.link for places in self.within]
        return {
            name: {link: added_mass(task, link, body(), task.center_of_mass(link)).energy_change for link in links}
            for name, body in CATALOGUE.items()
        }

    @cached_property
    def recommended(self) -> tuple[tuple[Simplification, int], ...]:
        """Pairs (removal, number) of a design change that removes fundamental (base) parameters, a `Simplification`,
        and the number of floating-point operations that it saves an adaptive controller in each control period. First
        come at most six changes that make a link symmetric, then at most six that add or move mass, of each kind those
        that leave the fewest parameters, the fewest first. Of changes of one kind that remove the same parameters, the
        one with the least mass is taken. Raises `RankError` where the number of identifiable parameters cannot be
        certified, `LoopError` where kinematic loops cannot be closed."""
        lightest: dict[tuple[tuple[str, ...], bool], Simplification] = {}
        for removal in self.simplifications:
            lightest.setdefault((removal.eliminated, removal.kind == "symmetry"), removal)
        chosen = [
            removal
            for by_shape in (True, False)
            for removal in [r for (_, shape), r in lightest.items() if shape is by_shape][:SHOWN]
        ]
        return tuple((removal, operations_saved(self.task, removal)) for removal in chosen)


def design_study(
    task: DesignTask,
    body: Payload | str | float = 1.0,
    *,
    links: Iterable[str] = (),
    mass_ratio: float = SHARE,
    max_offset: float = BEYOND,
    objective: str = "energy",
    percent: float = PERCENT,
    seed: int = 0,
) -> DesignStudy:
    """The design study, a `DesignStudy`, over a `task`, of an added body (a `Payload`, a known body's name, "gripper",
    "camera" or "motor", or a point mass in kg; 1 kg by default) and of counterweights.

    `links` are the names of the links that may carry counterweights. By default (empty) they are the six that may carry
    the heaviest, without links that turn on the ground about an axis along gravity, if others are left. A counterweight
    has at most the fraction `share` (unitless, 0.2 by default) of its link's mass; its positions are a box around the
    link's joints and centre of mass, widened by `beyond` (unitless, 0.5 by default) of the box's diagonal, and by 0.1 m
    at least. `objective` names the cost that counterweights make least: "energy", the default (its root mean square
    about its mean over the states), "torque" (joint torques as fractions of their limits), "coupling" (the mass
    matrix's entries off the diagonal) or "components" (the number of essential components that keep the energy to an
    error of `percent`, 1 % by default). `seed` draws the sampled designs from which the search for counterweights
    starts. Raises `InputError` for unknown links or one given twice, fractions below zero or not finite, an unknown
    objective, a `percent` below zero or not finite, a `seed` other than a whole number from 0 to 2^32 - 1, a body whose
    mass is 0, negative or above 1e20 kg, and a task with constant energy, `NotFoundError` for an unknown body,
    `RankError` where the number of identifiable parameters cannot be certified.
    """
    carried = named_body(body)
    every = bounds(task.mechanism, task.mechanism.description.body_names, mass_ratio, max_offset)
    chosen = bounds(task.mechanism, tuple(links) or _heaviest(task.mechanism, every), mass_ratio, max_offset)
    found = optimal_counterweights(task, chosen, objective, percent=percent, seed=seed)
    return DesignStudy(task, carried, every, percent, found, simplifications(task, every))


def named_body(body: Payload | str | float) -> Payload:
    """The body to add to a link, a `Payload`, that `body` stands for: one given by its name, "gripper", "camera" or
    "motor", a point mass (kg) at the origin of the link's frame, given as a number, or the given `Payload` itself.
    Raises `InputError` for a mass that is not above 0 and at most 1e20 kg, `NotFoundError` for another name."""
    if isinstance(body, str):
        if body not in CATALOGUE:
            raise NotFoundError(f"there is no body {body!r}; bodies: {', '.join(CATALOGUE)}, or a mass in kg")
        return CATALOGUE[body]()
    found = body if isinstance(body, Payload) else point(body)
    if not found.mass > 0.0:
        raise InputError(f"expected a body with a mass above 0 kg, got {found.mass:g}")
    return found


def _heaviest(mechanism: Mechanism, every: tuple[MountingBounds, ...]) -> tuple[str, ...]:
    """The links with the heaviest counterweights, but for those that turn about the vertical on the ground."""
    idle = {link.name for link in mechanism.links if _lifts_nothing(link, mechanism.description.gravity)}
    later = [places for places in every if places.mass > 0.0 and places.link not in idle] or list(every)
    heaviest = sorted(later, key=lambda places: -places.mass)[:MOST_LINKS]
    return tuple(places.link for places in later if places in heaviest)


def _lifts_nothing(link: Link, gravity: Array) -> bool:
    """True if a link turns on the ground about an axis along gravity, so that it lifts no mass."""
    axis = link.parent_to_joint.rotation @ link.joint.axis
    upright = float(np.linalg.norm(np.cross(axis, gravity))) <= UPRIGHT * float(np.linalg.norm(gravity))
    return link.parent == GROUND and link.joint.kind.is_revolute and upright
