"""Studies of designs in JSON's types."""

from __future__ import annotations

from typing import Any

from adaptctl.design import AddedMass, Counterweights, DesignStudy, DesignTask, Removal

SCHEMA = "adaptctl/design/1"


def as_builtins(study: DesignStudy, detail: AddedMass | None = None) -> dict[str, Any]:
    """Results of a design `study`, a dict in JSON's types, in SI units, changes of energy and torque being relative
    (0.1 for 10 % more). Its keys are `robot`, name and hash; `task`, its `states` in words and their number, `samples`;
    `before`, the costs of the motion (as `costs` returns them); the `body` to add, its mass and inertia; `links`, for
    each link its mass, the positions where the body's mass makes the energy least and greatest, with the change of
    energy, and the body's effect at the link's centre of mass; `counterweights`, with the costs after them; `removals`,
    changes that remove parameters, with the floating-point operations saved. `detail`, the effect of a body at one
    position, is `added`; left out where None, the default. Raises `RankError` where the mechanism's rank, its number of
    base parameters, cannot be certified."""
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
    """Costs of a mechanism's motion over a design `task`, a dict in JSON's types. Root mean squares (RMS) are over the
    task's states, torques without friction. `rank` is the number of fundamental (base) parameters, `carried` the number
    of those that each contribute more than 1e-6 of the energy. `energy` is the RMS, about its mean, of kinetic plus
    potential energy, J; `components` is the number of essential components (combinations of inertial parameters) that
    keep it to an error of `percent` (%), itself an entry. `torque` is the RMS of the torques divided by their limits,
    no unit, squares summed over joints; `torques` are RMS, one a joint, N m (N if prismatic). `coupling`, kg m^2, is
    the RMS, over pairs of joints too, of the mass matrix's entries off the diagonal, each times the mechanism's
    characteristic length for each prismatic joint of its pair. Raises `InputError` for a `percent` that is not a finite
    number of at least 0, `RankError` where the rank cannot be certified."""
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
    """Effect of a body added to a link, a dict in JSON's types. Energies and torques are root mean squares over the
    task's states, energies about their mean. `link` is the link's name; `place`, m in its frame, the body's position;
    `mass`, kg; `own_energy`, J, the energy of the body alone; `energy_change` and `torque_change`, of the mechanism by
    the body, are relative (0.1 for 10 % more); `torques` are those with it, one a joint, N m (N if prismatic).
    `components` is the number of essential components (combinations of inertial parameters) that keep the energy with
    it to an error of `added.percent` (%); `becomes_essential` has the names of base parameters that, each by itself,
    contribute more than 1e-6 of the energy only with the body; `changed` the changes of base parameters by name, SI
    units. Raises `RankError` where the mechanism's rank, its number of base parameters, cannot be certified."""
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
    """Counterweights that were found for a mechanism, a dict in JSON's types. `objective` names the cost that they make
    least: root mean squares over the task's states of "energy" about its mean (J), "torque" as a fraction of the
    limits, or "coupling", the mass matrix's entries off the diagonal (kg m^2); or "components", the number of essential
    components, combinations of parameters, that keep the energy to an error of `percent` (%) in `after`. `cost_before`
    and `cost_after` are in that unit, `saved` is the fraction that they remove, 0 to 1. `bounds` has, for each link
    that may have a counterweight, the box of positions from `lower` to `upper`, m in the link's frame, and the greatest
    `mass`, kg; `weights` those found, with `link`, `mass`, kg, and `place`, m in the link's frame. `after` has the
    costs of the motion with them, by the keys of `costs` (rank, carried, components, percent, energy, torque, coupling,
    torques), and `inconsistent_links` names of links whose inertial parameters, counterweights included, no rigid body
    has. Raises `RankError` where the mechanism's rank, its number of base parameters, cannot be certified."""
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
    """Change of a link by which parameters are no longer needed, a dict in JSON's types. `way` is "symmetry" (the link
    made its own mirror image), "balance" (a ball added) or "relocation" (a part of the link's mass moved); `link` its
    name, empty for all symmetries that links have already; `what` the change in words. `gone` has the names of the base
    parameters that are not needed after it, `rank` is the number of parameters that then are enough. `mass`, kg, is
    added or moved, 0 for a symmetry, and `place`, m in the link's frame, is where to, None for a symmetry. `before` and
    `after` are the equations of base parameters (sums of inertial ones) that it alters, as lists of texts. Nothing is
    raised."""
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
