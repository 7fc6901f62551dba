"""Page of a study of a design: its outcome in words, facts, tables and figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array
from adaptctl.design.driving import Demand, DrivenArm
from adaptctl.design.picture import arm_figure
from adaptctl.design.study import DesignStudy
from adaptctl.design.task import DesignTask
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.recording.drawing import Drawing, run_color, sheet, thinned
from adaptctl.recording.page import SHEU_WALKER, Lines, Section, Table, TableLayout
from adaptctl.recording.result import Fact
from adaptctl.recording.skeleton import skeleton
from adaptctl.recording.wording import coupling_unit, torque_error_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SOURCE = f"Method: {SHEU_WALKER}, section 6."
EACH_ALONE = "Each change is meant alone. The operations are those of one tick of Slotine and Li's law."
IN_LOOP = (
    "Slotine and Li's law follows one reference before and after, from knowing nothing: adapting all parameters, "
    "adapting the few components of most energy, and with their true values."
)
DRAWN = 3000
"""at most as many points of a curve"""
EXPLAINED = 4
"""changes of links whose equations are shown"""


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


def sections(study: DesignStudy, runs: Sequence[DrivenArm] = ()) -> Iterator[Section]:
    """Sections of the report of a design `study`: changes of the motion's energy by a point mass at positions on every
    link, counterweights with the costs of the motion before and after them, and changes by which parameters are no
    longer needed; `runs` are those in closed loop, if there are any. Raises `RankError` where the mechanism's rank, its
    number of base parameters, cannot be certified."""
    mass, mechanism = f"{study.body.mass:g} kg", study.task.mechanism
    told = (
        f"{header(study)}. The energy that is carried is its root mean square about its mean, which counts all pairs "
        "of states. A body changes it by no more than its projection on the essential parameter space."
    )
    arm = Drawing(
        "arm",
        f"The arm, coloured by what a point of {mass} does to the energy that its motion carries: blue where it "
        "balances the arm, red where it costs. Yellow: the counterweights.",
        partial(arm_figure, study, skeleton(mechanism), mechanism.home),
    )
    links = Drawing(
        "links",
        f"What {mass} costs at the cheapest place of every link's bounds, at its centre of mass, and at the dearest "
        "place.",
        partial(links_figure, study),
    )
    yield Section("Where a mass may be added", (told, arm, _links(study), links, _bodies(study)))
    weights = [f"{w.mass:.3g} kg of steel on {w.link} at {place(w.place)} m" for w in study.counterweights.weights]
    found = Lines(weights, bullets=True) if weights else "None helps within these bounds."
    torques = Drawing(
        "torques",
        "Root mean square torques over the task, without the counterweights and with them.",
        partial(torques_figure, study),
    )
    components = Drawing(
        "components",
        "Energy error when only the first components are kept (equation 23), without the counterweights and with them. "
        f"Dashed: {study.percent:g} %.",
        partial(components_figure, study),
    )
    yield Section("Counterweights", (found, costs_table(study), torques, components))
    if runs:
        yield Section("In closed loop", (IN_LOOP, _runs(runs), *_run_drawings(study, runs)))
    yield Section("Parameters that can go", (EACH_ALONE, removals_table(study), *_equations(study)))


def _links(study: DesignStudy) -> Table:
    mass = f"{study.body.mass:g} kg there"
    heads = ("link", "cheapest at [m]", mass, "at the centre of mass", "dearest at [m]", mass, "becomes essential")
    rows = [
        (
            cost.link,
            place(cost.cheapest),
            change(cost.least),
            change(cost.at_center),
            place(cost.dearest),
            change(cost.most),
            ", ".join(added.becomes_essential) or "–",
        )
        for cost, added in zip(study.links, study.added, strict=True)
    ]
    return Table(heads, rows, align="llrrlr", layout=TableLayout.ROWS)


def _bodies(study: DesignStudy) -> Table:
    names, links = list(study.bodies), [places.link for places in study.within]
    rows = [(link, *(change(study.bodies[name][link]) for name in names)) for link in links]
    title = "What common bodies do to it, their centre at the link's centre of mass"
    return Table(("link", *names), rows, title=title, align="l" + "r" * len(names))


def run_words(study: DesignStudy, runs: Sequence[DrivenArm]) -> Iterator[str]:
    """Sentences on `runs` in closed loop, none where there are none: how the counterweights of a `study` change the
    motors' work, and the error of the last two seconds, or when a run was stopped, with few components adapted."""
    of, unit = {run.name: run.demand for run in runs}, error_unit(study.task.mechanism)
    if {"all-before", "all-after"} <= of.keys() and of["all-before"].work > 0.0:
        share = of["all-after"].work / of["all-before"].work - 1.0
        yield f"In closed loop the motors' work changes by {change(share)}."
    if {"few-before", "few-after"} <= of.keys():
        old, new = (_late(of[f"few-{when}"], 1e3, f" {unit}") for when in ("before", "after"))
        yield f"With few components adapted, the tracking error of the last two seconds is {new} instead of {old}."


def _late(found: Demand, scale: float = 1.0, unit: str = "") -> str:
    """The error of the last two seconds; where the run was stopped, when."""
    if found.stopped:
        return f"stopped at {found.duration:.3g} s"
    return "–" if found.final_rms_error is None else f"{scale * found.final_rms_error:.3g}{unit}"


def run_rows(runs: Sequence[DrivenArm]) -> list[tuple[str, str, str, str, str]]:
    """Rows of texts, one for each of `runs` in closed loop: its label, root mean square errors, rad (m if prismatic),
    of the run and of its last two seconds (or when it was stopped), root mean square torque in percent of the limits,
    and the motors' work, J. Nothing is raised."""
    rows = []
    for run in runs:
        found = run.demand
        torque, work = f"{100.0 * found.rms_torque:.3g} %", f"{found.work:.3g} J"
        rows.append((run.label, f"{found.rms_error:.3g}", _late(found), torque, work))
    return rows


def _runs(runs: Sequence[DrivenArm]) -> Table:
    heads = ("run", "error [rad, m]", "last 2 s [rad, m]", "torque, of limit", "work")
    return Table(heads, run_rows(runs), align="lrrrr", layout=TableLayout.ROWS)


def _run_drawings(study: DesignStudy, runs: Sequence[DrivenArm]) -> Iterator[Drawing]:
    errors = {run.label: (run.time, 1e3 * np.sqrt(np.mean(run.error**2, axis=1))) for run in runs}
    torques = {run.label: (run.time, np.sqrt(np.mean(run.applied**2, axis=1))) for run in runs}
    unit = error_unit(study.task.mechanism)
    yield Drawing(
        "tracking",
        f"Root mean square of all joints' tracking errors, in {unit}, logarithmic.",
        partial(_curves, errors, f"RMS error [{unit}]", log=True),
    )
    unit = torque_error_unit(study.task.mechanism)
    yield Drawing(
        "applied",
        f"Root mean square of all joints' torques, in {unit}.",
        partial(_curves, torques, f"RMS torque [{unit}]", log=False),
    )


def _curves(curves: Mapping[str, tuple[Array, Array]], label: str, *, log: bool) -> Figure:
    figure = sheet(3.4)
    axes = figure.subplots()
    for i, (name, (time, values)) in enumerate(curves.items()):
        every = thinned(len(time), DRAWN)
        axes.plot(time[every], values[every], color=run_color(i).hex, label=name, linewidth=1.3)
    axes.set_yscale("log" if log else "linear")
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return figure


def costs_table(study: DesignStudy) -> Table:
    """Table of the costs of a study's motion, as described and with counterweights. Raises `RankError` where the
    mechanism's rank, its number of base parameters, cannot be certified."""
    both = (quantities(task, study.percent) for _, task in _two(study))
    rows = [(what, old, new) for (what, old), (_, new) in zip(*both, strict=True)]
    return Table(("", "as described", "with counterweights"), rows, align="lrr")


def removals_table(study: DesignStudy) -> Table:
    """Table of the changes of a study's links by which parameters are no longer needed. Nothing is raised."""
    rows = [(r.words, ", ".join(r.gone), str(r.rank), str(saved)) for r, saved in study.worthwhile]
    heads = ("what to do", "parameters that go", "left", "operations saved")
    return Table(heads, rows, align="llrr", layout=TableLayout.ROWS)


def _equations(study: DesignStudy) -> Iterator[Lines]:
    """Equations of base parameters before and after the first changes."""
    for removal, _ in study.worthwhile[:EXPLAINED]:
        yield Lines(removal.before, beside=removal.after, title=removal.words)


def links_figure(study: DesignStudy) -> Figure:
    """Figure (Matplotlib) of the changes, in percent, of the energy of a design study's motion by a point with the mass
    of the study's body on every link: at the link's centre of mass, and at the two positions, among those that the
    study allows on the link, where the energy becomes least and greatest. Energy is its root mean square about its mean
    over the task's states. Nothing is checked."""
    figure = sheet(0.55 + 0.5 * len(study.links))
    axes = figure.subplots()
    place = np.arange(len(study.links))
    values = ([c.least for c in study.links], [c.at_center for c in study.links], [c.most for c in study.links])
    for i, (label, each) in enumerate(zip(("cheapest", "centre of mass", "dearest"), values, strict=True)):
        axes.barh(place + 0.27 * (i - 1), 100.0 * np.array(each), 0.25, color=run_color((0, 4, 1)[i]).hex, label=label)
    axes.set_yticks(place, [cost.link for cost in study.links])
    axes.invert_yaxis()
    axes.set_xlabel("change of the energy carried [%]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return figure


def torques_figure(study: DesignStudy) -> Figure:
    """Figure (Matplotlib) of the root mean square torque of every joint over the states of a design study's task, N m
    (N if prismatic), friction left out, without the counterweights and with them. Nothing is checked."""
    figure = sheet(2.8)
    axes = figure.subplots()
    names = [joint.name for joint in study.task.mechanism.primary_joints]
    for i, (label, task) in enumerate(_two(study)):
        axes.bar(np.arange(len(names)) + 0.38 * i, task.torques(), 0.36, color=run_color(1 - i).hex, label=label)
    axes.set_xticks(np.arange(len(names)) + 0.19, names)
    axes.set_ylabel("RMS torque [N m, N]")
    axes.legend(loc="upper right")
    return figure


def components_figure(study: DesignStudy) -> Figure:
    """Figure (Matplotlib) of a design study's energy errors, in percent, on a logarithmic scale, by the number of
    essential components that are kept, without the counterweights and with them. Essential components are combinations
    of inertial parameters, those that make most of the energy first. Raises `RankError` where the mechanism's rank, its
    number of base parameters, cannot be certified."""
    figure = sheet(2.8)
    axes = figure.subplots()
    for i, (label, task) in enumerate(_two(study)):
        errors = percent_errors(task)
        shown = errors > 1e-8
        axes.semilogy(np.arange(len(errors))[shown], errors[shown], "o-", ms=3, color=run_color(1 - i).hex, label=label)
    axes.axhline(study.percent, linestyle=(0, (4, 3)), color=run_color(4).hex)
    axes.set_xlabel("components")
    axes.set_ylabel("energy error [%]")
    axes.legend(loc="upper right")
    return figure


def percent_errors(task: DesignTask) -> Array:
    """Energy errors (k + 1,), in percent, when 0, 1, ... k of the k essential components are kept, those that make most
    of the energy first. The energy that they are a percentage of is its root mean square about its mean over the task's
    states; errors are NaN where it is zero. Essential components are combinations of inertial parameters, the right
    singular vectors of the matrix of energies about their mean, with a row for each state and a column for each
    parameter (Sheu and Walker 1991, equation 23). Raises `RankError` where the mechanism's rank k cannot be certified.
    """
    squares = np.sort(np.square(task.matrix("components") @ task.parameters))
    tails = np.append(np.cumsum(squares)[::-1], 0.0)
    return np.asarray(100.0 * np.sqrt(tails / tails[0]))


def _two(study: DesignStudy) -> tuple[tuple[str, DesignTask], tuple[str, DesignTask]]:
    return ("as described", study.task), ("with counterweights", study.counterweights.balanced)
