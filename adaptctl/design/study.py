"""A study of a mechanism's design: what masses cost, which counterweights help, which parameters can go."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description import GROUND, Link
from adaptctl.design.added_mass import PERCENT, AddedMass, added_mass
from adaptctl.design.bodies import CATALOGUE, point
from adaptctl.design.cost_map import CostMap, LinkCost, cost_map
from adaptctl.design.counterweights import Counterweights, optimal_counterweights
from adaptctl.design.places import BEYOND, SHARE, PlaceBounds, bounds
from adaptctl.design.removals import Removal, operations_saved, removals
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
    """Results of a design study: added masses, counterweights and removable parameters of a mechanism over a `task`.

    `body` is the `Payload` to add, `within` holds the bounds (`PlaceBounds`) of every link, `percent` is the energy
    error (%) at which components are counted, `counterweights` has the best of them, and `removals` has all changes of
    design that remove fundamental parameters, those that leave the fewest first. Made by `design_study`; nothing is
    refused at construction.
    """

    task: DesignTask
    body: Payload
    within: tuple[PlaceBounds, ...]
    """bounds of every link"""
    percent: float
    counterweights: Counterweights
    removals: tuple[Removal, ...]

    @cached_property
    def map(self) -> CostMap:
        """Map, a `CostMap`, of the relative changes (unitless) of the energy's cost by a point of the body's mass at
        every place of the arm. Raises `InputError` for a body without mass and a task with constant energy."""
        return cost_map(self.task, self.body.mass)

    @cached_property
    def links(self) -> tuple[LinkCost, ...]:
        """The cheapest and the dearest place for a point of the body's mass on every link, as `LinkCost`: changes of
        the energy's cost as shares of it (unitless), and places (3,) in m in the link's frame. Raises `InputError` as
        `map` does."""
        return tuple(self.map.over(places) for places in self.within)

    @cached_property
    def added(self) -> tuple[AddedMass, ...]:
        """Effects, as `AddedMass`, of the body with its centre at the centre of mass of every link. Raises `InputError`
        for a task with constant energy, `RankError` where the mechanism's rank cannot be certified."""
        centers = (self.task.center_of_mass(places.link) for places in self.within)
        pairs = zip(self.within, centers, strict=True)
        return tuple(added_mass(self.task, p.link, self.body, x, percent=self.percent) for p, x in pairs)

    @cached_property
    def worthwhile(self) -> tuple[tuple[Removal, int], ...]:
        """Pairs of the removals that leave the fewest parameters, at most six by symmetry and six by added or moved
        mass, and of the number of floating-point operations that each saves a control tick; the lightest of those that
        remove the same. By symmetry come first, each kind with the fewest parameters left first."""
        lightest: dict[tuple[tuple[str, ...], bool], Removal] = {}
        for removal in self.removals:
            lightest.setdefault((removal.gone, removal.way == "symmetry"), removal)
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
    share: float = SHARE,
    beyond: float = BEYOND,
    objective: str = "energy",
    percent: float = PERCENT,
    seed: int = 0,
) -> DesignStudy:
    """The design study, a `DesignStudy`, over a task of an added body (a `Payload`, a known body's name, "gripper",
    "camera" or "motor", or a point mass in kg; 1 kg by default) and of counterweights.

    `links` are the names of those that may carry counterweights. Where none are named (by default), they are the six
    that may carry the heaviest, but for those that turn about the vertical on the ground. `share` (0.2 by default) and
    `beyond` (0.5), both unitless, bound the counterweights' masses and places as in `PlaceBounds.of`; `objective`,
    `percent` (1 %) and `seed` are those of `optimal_counterweights`. Raises `InputError` for unknown links or one given
    twice, shares below zero or not finite, an unknown objective, a `percent` below zero or not finite, a `seed` other
    than a whole number from 0 to 2^32 - 1, a body whose mass is not above zero, and a task with constant energy,
    `NotFoundError` for an unknown body, `RankError` where the mechanism's rank cannot be certified.
    """
    carried = named_body(body)
    every = bounds(task.mechanism, task.mechanism.description.body_names, share, beyond)
    chosen = bounds(task.mechanism, tuple(links) or _heaviest(task.mechanism, every), share, beyond)
    found = optimal_counterweights(task, chosen, objective, percent=percent, seed=seed)
    return DesignStudy(task, carried, every, percent, found, removals(task, every))


def named_body(body: Payload | str | float) -> Payload:
    """A body by name, or a point by its mass in kg, above zero. Raises `InputError` for a mass that is not positive,
    `NotFoundError` for an unknown name."""
    if isinstance(body, str):
        if body not in CATALOGUE:
            raise NotFoundError(f"there is no body {body!r}; bodies: {', '.join(CATALOGUE)}, or a mass in kg")
        return CATALOGUE[body]()
    found = body if isinstance(body, Payload) else point(body)
    if not found.mass > 0.0:
        raise InputError(f"expected a body with a mass above 0 kg, got {found.mass:g}")
    return found


def _heaviest(mechanism: Mechanism, every: tuple[PlaceBounds, ...]) -> tuple[str, ...]:
    """The links with the heaviest counterweights, but for those that turn about the vertical on the ground."""
    idle = {link.name for link in mechanism.links if _lifts_nothing(link, mechanism.description.gravity)}
    later = [places for places in every if places.mass > 0.0 and places.link not in idle] or list(every)
    heaviest = sorted(later, key=lambda places: -places.mass)[:MOST_LINKS]
    return tuple(places.link for places in later if places in heaviest)


def _lifts_nothing(link: Link, gravity: Array) -> bool:
    """True if a link turns on the ground about an axis along gravity, so that it lifts no mass."""
    axis = link.near.rotation @ link.joint.axis
    upright = float(np.linalg.norm(np.cross(axis, gravity))) <= UPRIGHT * float(np.linalg.norm(gravity))
    return link.parent == GROUND and link.joint.kind.turns and upright
