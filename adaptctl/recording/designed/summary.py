"""Studies of designs in JSON's types."""

from __future__ import annotations

from typing import Any

from adaptctl.design import AddedMass, Counterweights, DesignStudy, DesignTask, Removal

SCHEMA = "adaptctl/design/1"


def as_builtins(study: DesignStudy, detail: AddedMass | None = None) -> dict[str, Any]:
    """The results of a design study in JSON's types, SI units, changes of energy and torque as shares (0.1 for 10 %
    more): `robot`, name and hash; `task`, its `states` in words and their number, `samples`; `before`, the costs of the
    motion (as `costs` returns them); the `body` to add, its mass and inertia; `links`, for each link its mass, the
    cheapest and dearest place for the body's mass, with the change of energy, and the body's effect at the link's
    centre of mass; `counterweights`, with the costs after them; `removals`, changes that remove parameters, with the
    floating-point operations saved. `detail`, the effect of a body at one place, is `added`; left out where None, the
    default. Raises `RankError` where the mechanism's rank, its number of base parameters, cannot be certified."""
    task, mechanism = study.task, study.task.mechanism
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "robot": {"name": mechanism.name, "sha256": mechanism.description.sha256},
        "task": {"states": task.origin, "samples": len(task.p)},
        "before": costs(task, study.percent),
        "body": {"mass": study.body.mass, "inertia": study.body.inertia.tolist()},
        "links": [
            {
                "link": cost.link,
                "mass": added.task.parameters[10 * task.link(cost.link)],
                "cheapest": {"place": cost.cheapest.tolist(), "energy_change": cost.least},
                "dearest": {"place": cost.dearest.tolist(), "energy_change": cost.most},
                "at_center_of_mass": added_as_builtins(added),
            }
            for cost, added in zip(study.links, study.added, strict=True)
        ],
        "counterweights": balanced(study.counterweights),
        "removals": [removal_as_builtins(removal) | {"operations_saved": saved} for removal, saved in study.worthwhile],
    }
    if detail is not None:
        content["added"] = added_as_builtins(detail)
    return content


def costs(task: DesignTask, percent: float) -> dict[str, Any]:
    """Costs of a mechanism's motion over a task, in JSON's types: `rank`, the number of base parameters; `carried`, how
    many of them each by itself make more than 1e-6 of the energy; `components`, how many essential components
    (combinations of inertial parameters) keep the energy to an error of `percent` (%), itself an entry; `energy`,
    kinetic plus potential, J, its root mean square (RMS) about its mean; `torque`, the RMS of the torques as shares of
    their limits, no unit, squares summed over joints; `coupling`, kg m^2, the RMS of the mass matrix's entries off the
    diagonal, those of prismatic joints times the mechanism's characteristic length; and `torques`, RMS, one a joint, N
    m (N if prismatic); all torques without friction. Raises `InputError` for a percentage that is no finite number of
    at least 0, `RankError` where the rank cannot be certified."""
    return {
        "rank": task.basis.rank,
        "carried": len(task.carried()),
        "components": task.components(percent),
        "percent": percent,
        "energy": task.cost("energy"),
        "torque": task.cost("torque"),
        "coupling": task.cost("coupling"),
        "torques": task.torques().tolist(),
    }


def added_as_builtins(added: AddedMass) -> dict[str, Any]:
    """The effect of a body added to a link, in JSON's types, energies and torques being root mean squares over the
    task's states, energies about their mean: `link`, its name; `place`, m in its frame; `mass`, kg; `own_energy`, J,
    that of the body alone; `energy_change` and `torque_change` of the mechanism by the body, as shares (0.1 for 10 %
    more); `torques` with it, one a joint, N m (N if prismatic); `components`, how many essential components
    (combinations of inertial parameters) keep the energy with it to the error `added.percent` (%); `becomes_essential`,
    names of base parameters that, each by itself, make more than 1e-6 of the energy only with the body; and `changed`,
    changes of base parameters by name, SI units. Raises `RankError` where the mechanism's rank, its number of base
    parameters, cannot be certified."""
    return {
        "link": added.link,
        "place": added.body.center.tolist(),
        "mass": added.body.mass,
        "own_energy": added.own_energy,
        "energy_change": added.energy_change,
        "torque_change": added.torque_change,
        "torques": added.torques.tolist(),
        "components": added.components,
        "becomes_essential": list(added.becomes_essential),
        "changed": dict(added.changed),
    }


def balanced(found: Counterweights) -> dict[str, Any]:
    """The counterweights that were found, in JSON's types: `objective`, the cost that they make least, root mean square
    "energy" about its mean (J), "torque" as a share of the limits, or "coupling", the mass matrix off its diagonal (kg
    m^2), or "components", the number of essential components, combinations of parameters, that keep the energy to an
    error of `after`'s `percent` (%); `cost_before` and `cost_after` in that unit and `saved`, the share that they
    remove, 0 to 1; `bounds`, for each link that may carry one, the box of places from `lower` to `upper`, m in the
    link's frame, and the greatest `mass`, kg; `weights`, those found, with `link`, `mass`, kg, and `place`, m in the
    link's frame; `after`, the costs of the motion with them, by the keys of `costs` (rank, carried, components,
    percent, energy, torque, coupling, torques); and `inconsistent_links`, names of links whose inertial parameters,
    counterweights included, no rigid body has. Raises `RankError` where the mechanism's rank, its number of base
    parameters, cannot be certified."""
    return {
        "objective": found.objective,
        "cost_before": found.cost_before,
        "cost_after": found.cost_after,
        "saved": found.saved,
        "bounds": [
            {"link": p.link, "lower": p.lower.tolist(), "upper": p.upper.tolist(), "mass": p.mass} for p in found.within
        ],
        "weights": [{"link": w.link, "mass": w.mass, "place": w.place.tolist()} for w in found.weights],
        "after": costs(found.balanced, found.percent),
        "inconsistent_links": list(found.inconsistent),
    }


def removal_as_builtins(removal: Removal) -> dict[str, Any]:
    """A change of design that removes parameters, in JSON's types: `way`, "symmetry" (the link made its own mirror
    image), "balance" (a ball added) or "relocation" (a part of the link's mass moved); `link`, its name, empty for all
    symmetries that links have already, and `what`, the change in words; `gone`, names of the base parameters that are
    not needed after it, and `rank`, the number of parameters that then are enough; `mass`, kg, added or moved, 0 for a
    symmetry, and `place`, where to, m in the link's frame, None for a symmetry; `before` and `after`, the equations of
    base parameters (sums of inertial ones) that it alters, as lists of texts. Nothing is raised."""
    return {
        "way": removal.way,
        "link": removal.link,
        "what": removal.words,
        "gone": list(removal.gone),
        "rank": removal.rank,
        "mass": removal.mass,
        "place": None if removal.place is None else removal.place.tolist(),
        "before": list(removal.before),
        "after": list(removal.after),
    }
