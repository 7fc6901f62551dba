"""Study of a mechanism's design."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description import GROUND, Link
from adaptctl.design.added_mass import ENERGY_ERROR_PERCENT, AddedMass, CostMap, LinkCost, added_mass, cost_map
from adaptctl.design.bodies import CATALOGUE, point
from adaptctl.design.counterweights import Counterweights, optimal_counterweights
from adaptctl.design.mounting_bounds import MASS_SHARE, OFFSET_SHARE, MountingBounds, bounds
from adaptctl.design.simplifications import Simplification, operations_saved, simplifications
from adaptctl.design.task import DesignTask
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NotFoundError
from adaptctl.simulation.effects import Payload

# Links that carry counterweights where none are named.
MAX_DEFAULT_LINKS = 6
# Angle in rad to the vertical within which an axis is vertical.
VERTICAL_TOLERANCE = 1e-6
# Removals by symmetry, and as many by masses, whose operations are counted.
MAX_RECOMMENDED = 6


@dataclass(frozen=True, eq=False)
class DesignStudy:
    """
    Results of a design study: effects of added masses, counterweights, and changes that remove parameters.

    Made by `design_study`. Properties raise `InputError` for a task with constant energy, `RankError` where the rank
    cannot be certified.

    Parameters
    ----------
    task : DesignTask
        Mechanism and states.
    body : Payload
        Body whose addition to each link is studied.
    bounds : tuple of MountingBounds
        Bounds of mass and position on every link.
    percent : float
        Largest error of the energy in percent at which essential components are counted.
    counterweights : Counterweights
        Optimal counterweights.
    simplifications : tuple of Simplification
        Changes that remove parameters, sorted by the number of parameters that remain.

    Examples
    --------
    >>> from adaptctl.design import Counterweights, DesignStudy, DesignTask, MountingBounds, point
    >>> task, bounds = DesignTask.within_limits(arm, samples=20), MountingBounds.for_link(arm, "lower")
    >>> study = DesignStudy(task, point(1.0), (bounds,), 1.0, Counterweights(task, "energy", 1.0, (), (), 0), ())
    >>> [cost.link for cost in study.links]
    ['lower']
    """

    task: DesignTask
    body: Payload
    bounds: tuple[MountingBounds, ...]
    percent: float
    counterweights: Counterweights
    simplifications: tuple[Simplification, ...]

    def __repr__(self) -> str:
        return f"<DesignStudy of {self.task.mechanism.name!r}: {len(self.bounds)} links>"

    @cached_property
    def map(self) -> CostMap:
        """Relative energy change due to a point mass as heavy as the body, as a function of its position."""
        return cost_map(self.task, self.body.mass)

    @cached_property
    def links(self) -> tuple[LinkCost, ...]:
        """Positions of the least and greatest relative change of the energy on every link."""
        return tuple(self.map.extremes(places) for places in self.bounds)

    @cached_property
    def added(self) -> tuple[AddedMass, ...]:
        """Effects of adding the body at each link's center of mass."""
        centers = (self.task.center_of_mass(places.link) for places in self.bounds)
        pairs = zip(self.bounds, centers, strict=True)
        return tuple(added_mass(self.task, p.link, self.body, x, percent=self.percent) for p, x in pairs)

    @cached_property
    def bodies(self) -> dict[str, dict[str, float]]:
        """Relative changes of the energy, by added body (gripper, camera or motor) and link."""
        task, links = self.task, [places.link for places in self.bounds]
        return {
            name: {link: added_mass(task, link, body(), task.center_of_mass(link)).energy_change for link in links}
            for name, body in CATALOGUE.items()
        }

    @cached_property
    def recommended(self) -> tuple[tuple[Simplification, int], ...]:
        """Pairs of a design change and the floating-point operations that it saves in each control period."""
        lightest: dict[tuple[tuple[str, ...], bool], Simplification] = {}
        for removal in self.simplifications:
            lightest.setdefault((removal.eliminated, removal.kind == "symmetry"), removal)
        chosen = [
            removal
            for by_shape in (True, False)
            for removal in [r for (_, shape), r in lightest.items() if shape is by_shape][:MAX_RECOMMENDED]
        ]
        return tuple((removal, operations_saved(self.task, removal)) for removal in chosen)


def design_study(
    task: DesignTask,
    body: Payload | str | float = 1.0,
    *,
    links: Iterable[str] = (),
    mass_ratio: float = MASS_SHARE,
    max_offset: float = OFFSET_SHARE,
    objective: str = "energy",
    percent: float = ENERGY_ERROR_PERCENT,
    seed: int = 0,
) -> DesignStudy:
    """
    Study the effects of an added body and of counterweights, and find changes that remove parameters.

    Parameters
    ----------
    task : DesignTask
        Mechanism and states.
    body : Payload, str or float, default 1.0
        Body to add: a payload, "gripper", "camera" or "motor", or the mass of a point in kg.
    links : iterable of str, optional
        Links that may carry counterweights. Default: the six that may carry the heaviest, but none that turns on the
        ground about a vertical axis, as it needs no balance.
    mass_ratio : float, default 0.2
        Largest mass of a counterweight as a fraction of its link's, without unit.
    max_offset : float, default 0.5
        Margin around the link in which it may be mounted, a fraction without unit, as in `MountingBounds.for_link`.
    objective : {"energy", "torque", "coupling", "components"}, default "energy"
        Cost that counterweights minimise, as `DesignTask.cost` computes it.
    percent : float, default 1.0
        Largest error of the energy in percent at which essential components are counted.
    seed : int, default 0
        Seed of the search for counterweights. Fixed, so that a study can be repeated.

    Returns
    -------
    DesignStudy
        Costs, counterweights and simplifications.

    Raises
    ------
    InputError
        If a link is unknown or given twice, an objective is unknown, a number is out of range, or the task's energy is
        constant.
    NotFoundError
        If the body's name is unknown.
    RankError
        If the number of identifiable parameters cannot be certified.

    Examples
    --------
    >>> from adaptctl.design import DesignTask, design_study
    >>> study = design_study(DesignTask.within_limits(arm, samples=20), 0.5, links=["upper"], objective="coupling")
    >>> len(study.links), len(study.simplifications) > 0
    (2, True)
    """
    carried = named_body(body)
    every = bounds(task.mechanism, task.mechanism.description.body_names, mass_ratio, max_offset)
    chosen = bounds(task.mechanism, tuple(links) or _heaviest(task.mechanism, every), mass_ratio, max_offset)
    found = optimal_counterweights(task, chosen, objective, percent=percent, seed=seed)
    return DesignStudy(task, carried, every, percent, found, simplifications(task, every))


def named_body(body: Payload | str | float) -> Payload:
    """Body from its name or mass."""
    if isinstance(body, str):
        if body not in CATALOGUE:
            raise NotFoundError(f"unknown body {body!r}; bodies: {', '.join(CATALOGUE)}, or a mass in kg")
        return CATALOGUE[body]()
    found = body if isinstance(body, Payload) else point(body)
    if not found.mass > 0.0:
        raise InputError(f"expected a body with a mass above 0 kg, got {found.mass:g}")
    return found


def _heaviest(mechanism: Mechanism, every: tuple[MountingBounds, ...]) -> tuple[str, ...]:
    idle = {link.name for link in mechanism.links if _lifts_nothing(link, mechanism.description.gravity)}
    later = [places for places in every if places.mass > 0.0 and places.link not in idle] or list(every)
    heaviest = sorted(later, key=lambda places: -places.mass)[:MAX_DEFAULT_LINKS]
    return tuple(places.link for places in later if places in heaviest)


def _lifts_nothing(link: Link, gravity: Array) -> bool:
    axis = link.parent_to_joint.rotation @ link.joint.axis
    upright = float(np.linalg.norm(np.cross(axis, gravity))) <= VERTICAL_TOLERANCE * float(np.linalg.norm(gravity))
    return link.parent == GROUND and link.joint.kind.is_revolute and upright
