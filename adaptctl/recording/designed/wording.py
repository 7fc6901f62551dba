"""Words for studies of designs, the same in the terminal, the report and the recording."""

from __future__ import annotations

from collections.abc import Iterator

from adaptctl.arrays import Array
from adaptctl.design import DesignStudy, DesignTask
from adaptctl.recording.fact import Fact
from adaptctl.recording.units import coupling_unit


def header(study: DesignStudy) -> str:
    """Text, one line, of a design study's robot and task: the robot's name, its numbers of inertial parameters, of
    independent (base) parameters and of base parameters that each contribute more than 1e-6 of the energy ("not zero"),
    and the states that the task consists of. Raises `RankError` where the mechanism's rank, its number of base
    parameters, cannot be certified."""
    task = study.task
    return (
        f"{task.mechanism.name}: {len(task.parameters)} inertial parameters, {task.basis.rank} independent, "
        f"{len(task.carried())} of them not zero; over {task.origin}"
    )


def outcome_words(study: DesignStudy) -> str:
    """The outcome of a design `study` in a sentence or two. It says by how many percent a point with the mass of the
    study's body changes the energy, a root mean square about its mean, at the best and at the worst position on any
    link, and how many percent of their objective, such as energy, the counterweights save. Nothing is raised."""
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
    """Facts of a design study, each a `Fact`: a question that a person asks first, and its answer in words, with units.
    They are numbers of parameters and essential components (combinations of them), the costs of the motion before and
    after the counterweights, and the counterweights' masses. Costs are root mean squares: energy in J, torque in
    percent of its limit, and coupling, the mass matrix's entries off the diagonal, in kg m^2 (kg between prismatic
    joints, kg m between one of each kind). Raises `RankError` where the mechanism's rank, its number of base
    parameters, cannot be certified."""
    found, before = study.counterweights, study.task
    after = found.balanced
    yield Fact("Independent parameters", f"{before.basis.rank}, {len(before.carried())} not zero")
    yield Fact(
        f"Components within {study.percent:g} % of energy",
        f"{before.components(study.percent)} → {after.components(study.percent)}",
    )
    yield Fact("Energy carried", _fall(before.cost("energy"), after.cost("energy"), "J"))
    yield Fact("Torque, of its limit (RMS)", _fall(100.0 * before.cost("torque"), 100.0 * after.cost("torque"), "%"))
    unit = coupling_unit(before.mechanism)
    yield Fact("Coupling (RMS off the diagonal)", _fall(before.cost("coupling"), after.cost("coupling"), unit))
    yield Fact("Counterweights", " + ".join(f"{w.mass:.3g} kg" for w in found.weights) or "none")


def _fall(before: float, after: float, unit: str) -> str:
    return f"{before:.3g} → {after:.3g} {unit}"


def quantities(task: DesignTask, percent: float) -> Iterator[tuple[str, str]]:
    """Costs of a mechanism's motion over a design `task`, as pairs of texts, a label and a number with its unit. They
    are the numbers of base parameters, of those that are not zero (each contributes more than 1e-6 of the energy), and
    of essential components, combinations of parameters, that keep the energy to an error of `percent` (%); and root
    mean squares of energy about its mean (J), torque (% of its limit), coupling, the mass matrix's entries off the
    diagonal (kg m^2, kg between prismatic joints, kg m between one of each kind), and each joint's torque (N m, N if
    prismatic). Raises `InputError` for a `percent` that is not a finite number of at least 0, `RankError` where the
    mechanism's rank, its number of base parameters, cannot be certified."""
    yield "independent parameters", f"{task.basis.rank}"
    yield "of them not zero", f"{len(task.carried())}"
    yield f"components within {percent:g} % of energy", f"{task.components(percent)}"
    yield "energy (RMS about its mean)", f"{task.cost('energy'):.4g} J"
    yield "torque, of its limit (RMS)", f"{100.0 * task.cost('torque'):.3g} %"
    yield "coupling (RMS off the diagonal)", f"{task.cost('coupling'):.3g} {coupling_unit(task.mechanism)}"
    for joint, torque in zip(task.mechanism.primary_joints, task.torques().tolist(), strict=True):
        yield f"{joint.name} (RMS)", f"{torque:.3g} {joint.kind.effort_unit}"


def change(share: float) -> str:
    """Relative change `share` (a fraction) formatted as a percentage with its sign: 0.125 is "+12.5 %". Nothing is
    raised."""
    return f"{100.0 * share:+.3g} %".replace("-", "−")


def place(x: Array) -> str:
    """Position `x` (3,), m in a link's frame, formatted as text without the unit: "(0.100, 0.000, -0.250)". Nothing is
    checked."""
    return f"({', '.join(f'{value:.3f}' for value in x + 0.0)})"
