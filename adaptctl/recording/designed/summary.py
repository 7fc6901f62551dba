"""Studies of designs in JSON's types."""

from __future__ import annotations

from typing import Any

from adaptctl.design import AddedMass, Counterweights, DesignStudy, DesignTask, Removal

SCHEMA = "adaptctl/design/1"


def as_builtins(study: DesignStudy, detail: AddedMass | None = None) -> dict[str, Any]:
    """A study in JSON's types; SI units, changes as shares of what the arm costs without."""
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
    """Costs of a mechanism's motion over a task, in JSON's types."""
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
    """Changes by a body at a place, in JSON's types."""
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
    """Counterweights, their bounds, and the costs with them, in JSON's types."""
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
    """A removal, with the equations before and after, in JSON's types."""
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
