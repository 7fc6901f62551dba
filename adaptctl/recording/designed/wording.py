"""Words for studies of designs, the same in the terminal, the report and the recording."""

from __future__ import annotations

from collections.abc import Iterator

from adaptctl.arrays import Array
from adaptctl.design import DesignStudy, DesignTask
from adaptctl.recording.fact import Fact


def header(study: DesignStudy) -> str:
    """Text of the robot, the task, and what its motion depends on."""
    task = study.task
    return (
        f"{task.mechanism.name}: {len(task.parameters)} inertial parameters, {task.basis.rank} independent, "
        f"{len(task.carried())} of them not zero; over {task.origin}"
    )


def outcome_words(study: DesignStudy) -> str:
    """The outcome of a design study in a sentence or two."""
    found, best = study.counterweights, min(study.links, key=lambda cost: cost.least)
    worst = max(study.links, key=lambda cost: cost.most)
    text = (
        f"{study.body.mass:g} kg changes the energy that {study.task.mechanism.name} carries by "
        f"{change(best.least)} at best, on {best.link}, and by {change(worst.most)} at worst, on {worst.link}."
    )
    weights = " and ".join(f"{weight.mass:.3g} kg on {weight.link}" for weight in found.weights)
    if weights:
        text += f" Counterweights of {weights} make {100.0 * found.saved:.3g} % less {found.objective}."
    return text


def facts(study: DesignStudy) -> Iterator[Fact]:
    """Questions that a person asks first about a study, and the answers."""
    found, before = study.counterweights, study.task
    after = found.balanced
    yield Fact("Independent parameters", f"{before.basis.rank}, {len(before.carried())} not zero")
    yield Fact(
        f"Components within {study.percent:g} % of energy",
        f"{before.components(study.percent)} → {after.components(study.percent)}",
    )
    yield Fact("Energy carried", _fall(before.cost("energy"), after.cost("energy"), "J"))
    yield Fact("Torque, of its limit (RMS)", _fall(100.0 * before.cost("torque"), 100.0 * after.cost("torque"), "%"))
    yield Fact("Coupling (RMS off the diagonal)", _fall(before.cost("coupling"), after.cost("coupling"), "kg m²"))
    yield Fact("Counterweights", " + ".join(f"{w.mass:.3g} kg" for w in found.weights) or "none")


def _fall(before: float, after: float, unit: str) -> str:
    return f"{before:.3g} → {after:.3g} {unit}"


def quantities(task: DesignTask, percent: float) -> Iterator[tuple[str, str]]:
    """Costs of a motion, as pairs of a label and a number with its unit."""
    yield "independent parameters", f"{task.basis.rank}"
    yield "of them not zero", f"{len(task.carried())}"
    yield f"components within {percent:g} % of energy", f"{task.components(percent)}"
    yield "energy (RMS about its mean)", f"{task.cost('energy'):.4g} J"
    yield "torque, of its limit (RMS)", f"{100.0 * task.cost('torque'):.3g} %"
    yield "coupling (RMS off the diagonal)", f"{task.cost('coupling'):.3g} kg m²"
    for joint, torque in zip(task.mechanism.primary_joints, task.torques().tolist(), strict=True):
        yield f"{joint.name} (RMS)", f"{torque:.3g} {joint.kind.effort_unit}"


def change(share: float) -> str:
    """Text of a change as a percentage with its sign."""
    return f"{100.0 * share:+.3g} %".replace("-", "−")


def place(x: Array) -> str:
    """Text of a place in m."""
    return f"({', '.join(f'{value:.3f}' for value in x + 0.0)})"
