"""Report of a design study."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.design.added_mass import AddedMass
from adaptctl.design.driving import Demand, DrivenArm
from adaptctl.design.picture import arm_figure, record
from adaptctl.design.simplifications import Simplification
from adaptctl.design.study import DesignStudy
from adaptctl.design.task import DesignTask
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.identifiability.reduction import percent_errors
from adaptctl.recording.colors import run_color
from adaptctl.recording.drawing import Drawing, sheet, thinned
from adaptctl.recording.figures import MAX_DRAWN_SAMPLES
from adaptctl.recording.page import SHEU_WALKER, Lines, Report, Section, Table, TableLayout
from adaptctl.recording.result import Fact, Progress, silent
from adaptctl.recording.skeleton import skeleton
from adaptctl.recording.wording import coupling_unit, torque_error_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = "adaptctl/design/2"
EXPLANATION = (
    "The energy is its root mean square deviation from its mean over all pairs of states. A body "
    "changes it only by its projection onto the essential space."
)
EACH_ALONE = "Changes are listed separately. The operations are those of one control step of Slotine and Li's law."
IN_LOOP = (
    "Slotine and Li's law tracks one reference before and after, from zero estimates: with all parameters adapted, "
    "with the few components of most energy adapted, and with their true values held."
)
# Largest number of changes whose equations are shown.
MAX_EXPLAINED_CHANGES = 4


def write_study(
    folder: Path,
    study: DesignStudy,
    shown: Report,
    content: Mapping[str, Any],
    runs: Sequence[DrivenArm] = (),
    progress: Progress = silent,
) -> None:
    """Write the files of a design study, all or none."""
    shown.write(folder, content, name="design.json", record=partial(record, study, runs, shown), progress=progress)


def report(study: DesignStudy, detail: AddedMass | None = None, runs: Sequence[DrivenArm] = ()) -> Report:
    """Report of a design study."""
    return Report(
        experiment="design",
        title=f"{study.task.mechanism.name}: effect of added masses",
        outcome=" ".join((_outcome(study), *_run_words(study, runs))),
        facts=tuple(_facts(study)),
        sections=tuple(_sections(study, detail, runs)),
        source=f"Method: {SHEU_WALKER}, section 6.",
    )


def _outcome(study: DesignStudy) -> str:
    found, best = study.counterweights, min(study.links, key=lambda cost: cost.least)
    worst = max(study.links, key=lambda cost: cost.most)
    text = (
        f"An added mass of {study.body.mass:g} kg changes the energy of {study.task.mechanism.name} by "
        f"{change(best.least)} at the best position, on {best.link}, and by {change(worst.most)} at the worst, on "
        f"{worst.link}."
    )
    weights = " and ".join(f"{weight.mass:.3g} kg on {weight.link}" for weight in found.weights)
    if weights:
        text += (
            f" Counterweights of {weights} reduce the {found.objective} by {100.0 * found.relative_reduction:.3g} %."
        )
    return text


def _run_words(study: DesignStudy, runs: Sequence[DrivenArm]) -> Iterator[str]:
    of, unit = {run.name: run.demand for run in runs}, error_unit(study.task.mechanism)
    if of and of["all-before"].work > 0.0:
        share = of["all-after"].work / of["all-before"].work - 1.0
        yield f"In closed loop, the mechanical work of the motors changes by {change(share)}."
    if of:
        old, new = (_late(of[f"few-{when}"], 1e3, f" {unit}") for when in ("before", "after"))
        yield f"With few adapted components, the tracking error of the last two seconds changes from {old} to {new}."


def _facts(study: DesignStudy) -> Iterator[Fact]:
    found = study.counterweights
    before, after = (dict(quantities(task, study.percent)) for task in (study.task, found.balanced_task))
    yield Fact("Base parameters", f"{study.task.basis.rank}, {len(study.task.nonzero_parameters())} nonzero")
    for name in list(before)[2:6]:
        yield Fact(name[0].upper() + name[1:], f"{before[name].split()[0]} → {after[name]}")
    yield Fact("Counterweights", " + ".join(f"{w.mass:.3g} kg" for w in found.weights) or "none")


def quantities(task: DesignTask, percent: float) -> Iterator[tuple[str, str]]:
    """Pairs of a cost's label and its text."""
    of = costs(task, percent)
    yield "base parameters", f"{of['rank']}"
    yield "nonzero base parameters", f"{of['nonzero_parameters']}"
    yield f"components for an energy error of {percent:g} %", f"{of['components']}"
    yield "energy (RMS deviation)", f"{of['energy']:.4g} J"
    yield "torque over its limit (RMS)", f"{100.0 * of['torque']:.3g} %"
    yield "coupling (RMS of off-diagonal entries)", f"{of['coupling']:.3g} {coupling_unit(task.mechanism)}"
    for joint, torque in zip(task.mechanism.primary_joints, of["torques"], strict=True):
        yield f"{joint.name} (RMS)", f"{torque:.3g} {joint.kind.effort_unit}"


def change(share: float) -> str:
    """Percentage with a sign: 0.125 is "+12.5 %"."""
    return f"{100.0 * share:+.3g} %".replace("-", "−")


def _place(x: Array) -> str:
    return f"({', '.join(f'{value:.3f}' for value in x + 0.0)})"


def _sections(study: DesignStudy, detail: AddedMass | None, runs: Sequence[DrivenArm]) -> Iterator[Section]:
    mass, mechanism, task, found = f"{study.body.mass:g} kg", study.task.mechanism, study.task, study.counterweights
    told = (
        f"{mechanism.name}: {len(task.parameters)} inertial parameters, {task.basis.rank} base parameters, "
        f"{len(task.nonzero_parameters())} of them nonzero; over {task.origin}. {EXPLANATION}"
    )
    arm = Drawing(
        "arm",
        f"The arm, coloured by the effect of a point mass of {mass} on the energy: blue where it "
        "decreases, red where it increases. Yellow: the counterweights.",
        partial(arm_figure, study, skeleton(mechanism), mechanism.neutral_configuration),
    )
    yield Section("Added masses", (told, arm, _links(study), _bodies(study)))
    if detail is not None:
        title = f"{detail.body.mass:g} kg on {detail.link} at {_place(detail.body.center)}"
        yield Section(title, (_detail(detail),))
    weights = [f"{w.mass:.3g} kg of steel on {w.link} at {_place(w.place)} m" for w in found.weights]
    components = Drawing(
        "components",
        "Energy error with only the first components (equation 23), without and with the counterweights. "
        f"Dashed: {study.percent:g} %.",
        partial(_components_figure, study),
    )
    listed = Lines(weights, bullets=True) if weights else "No counterweight reduces the cost within these bounds."
    both = _compared(task, found.balanced_task, study.percent, ("as described", "with counterweights"))
    yield Section(f"Counterweights that minimise the {found.objective}", (listed, both, components))
    if runs:
        yield Section("Closed loop", (IN_LOOP, _runs(runs), *_run_drawings(study, runs)))
    equations = [
        Lines(r.equations_before, beside=r.equations_after, title=r.description)
        for r, _ in study.recommended[:MAX_EXPLAINED_CHANGES]
    ]
    yield Section("Eliminated parameters", (EACH_ALONE, _removals(study), *equations))


def _links(study: DesignStudy) -> Table:
    mass = f"effect of {study.body.mass:g} kg"
    heads = ("link", "best at [m]", mass, "at the centre of mass", "worst at [m]", mass, "newly identifiable")
    rows = [
        (
            c.link, _place(c.cheapest), change(c.least), change(c.at_center), _place(c.dearest), change(c.most),
            ", ".join(added.newly_identifiable) or "–",
        )
        for c, added in zip(study.links, study.added, strict=True)
    ]  # fmt: skip
    return Table(heads, rows, align="llrrlr", layout=TableLayout.ROWS)


def _bodies(study: DesignStudy) -> Table:
    names, links = list(study.bodies), [places.link for places in study.bounds]
    rows = [(link, *(change(study.bodies[name][link]) for name in names)) for link in links]
    title = "Effect of common bodies, centred at the centre of mass of the link"
    return Table(("link", *names), rows, title=title, align="l" + "r" * len(names))


def _compared(before: DesignTask, after: DesignTask, percent: float, heads: tuple[str, str]) -> Table:
    both = zip(quantities(before, percent), quantities(after, percent), strict=True)
    return Table(("", *heads), [(what, old, new) for (what, old), (_, new) in both], align="lrr")


def _detail(added: AddedMass) -> Table:
    table = _compared(added.task, added.task.with_parameters(added.parameters), added.percent, ("without", "with"))
    rows = [
        *table.rows,
        ("energy of the body alone", "", f"{added.own_energy:.4g} J"),
        ("newly identifiable", "", ", ".join(added.newly_identifiable) or "none"),
        *((f"{name}*", "", f"{value:+.4g}") for name, value in added.base_parameter_changes),
    ]
    return Table(table.header, rows, align=table.align)


def _removals(study: DesignStudy) -> Table:
    rows = [(r.description, ", ".join(r.eliminated), str(r.rank), str(saved)) for r, saved in study.recommended]
    heads = ("change", "eliminated parameters", "remaining", "operations saved")
    return Table(heads, rows, align="llrr", layout=TableLayout.ROWS)


def _runs(runs: Sequence[DrivenArm]) -> Table:
    rows = [
        (run.label, f"{of.rms_error:.3g}", _late(of), f"{100.0 * of.rms_torque:.3g} %", f"{of.work:.3g} J")
        for run, of in ((run, run.demand) for run in runs)
    ]
    heads = ("run", "error [rad, m]", "last 2 s [rad, m]", "torque over limit", "mechanical work")
    return Table(heads, rows, align="lrrrr", layout=TableLayout.ROWS)


def _late(found: Demand, scale: float = 1.0, unit: str = "") -> str:
    if found.stopped:
        return f"stopped at {found.duration:.3g} s"
    return "–" if found.final_rms_error is None else f"{scale * found.final_rms_error:.3g}{unit}"


def _run_drawings(study: DesignStudy, runs: Sequence[DrivenArm]) -> Iterator[Drawing]:
    mechanism = study.task.mechanism
    kinds: tuple[tuple[str, str, str, Callable[[DrivenArm], Array]], ...] = (
        ("tracking", "tracking errors", error_unit(mechanism), lambda run: 1e3 * run.error),
        ("applied", "torques", torque_error_unit(mechanism), lambda run: run.applied),
    )
    for name, what, unit, values in kinds:
        scale = ", logarithmic" if name == "tracking" else ""
        caption = f"Root mean square {what} of all joints, in {unit}{scale}."
        yield Drawing(name, caption, partial(_curves, runs, values, f"RMS {what} [{unit}]", log=bool(scale)))


def _curves(runs: Sequence[DrivenArm], values: Callable[[DrivenArm], Array], label: str, *, log: bool) -> Figure:
    figure = sheet(3.4)
    axes = figure.subplots()
    for i, run in enumerate(runs):
        every = thinned(len(run.time), MAX_DRAWN_SAMPLES)
        shown = np.sqrt(np.mean(values(run)[every] ** 2, axis=1))
        axes.plot(run.time[every], shown, color=run_color(i).hex, label=run.label, linewidth=1.3)
    axes.set(yscale="log" if log else "linear", xlabel="time [s]", ylabel=label)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return figure


def _components_figure(study: DesignStudy) -> Figure:
    figure = sheet(2.8)
    axes = figure.subplots()
    tasks = {"as described": study.task, "with counterweights": study.counterweights.balanced_task}
    for i, (label, task) in enumerate(tasks.items()):
        errors = percent_errors(np.sort(np.abs(task.cost_matrix("components") @ task.parameters))[::-1])
        shown = errors > 1e-8
        axes.semilogy(np.arange(len(errors))[shown], errors[shown], "o-", ms=3, color=run_color(1 - i).hex, label=label)
    axes.axhline(study.percent, linestyle=(0, (4, 3)), color=run_color(4).hex)
    axes.set(xlabel="components", ylabel="energy error [%]")
    axes.legend(loc="upper right")
    return figure


def as_builtins(study: DesignStudy, detail: AddedMass | None = None, runs: Sequence[DrivenArm] = ()) -> dict[str, Any]:
    """Design study in JSON's types and SI units."""
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
                "mass": added.task.parameters[10 * task.link_index(cost.link)],
                "cheapest": {"place": cost.cheapest.tolist(), "energy_change": cost.least},
                "dearest": {"place": cost.dearest.tolist(), "energy_change": cost.most},
                "at_center_of_mass": _added(added),
            }
            for cost, added in zip(study.links, study.added, strict=True)
        ],
        "counterweights": _counterweights(study),
        "simplifications": [_removal(removal) | {"operations_saved": saved} for removal, saved in study.recommended],
    }
    content |= {} if detail is None else {"added": _added(detail)}
    content["bodies"] = study.bodies
    return content | ({"runs": {run.name: run.demand._asdict() for run in runs}} if runs else {})


def costs(task: DesignTask, percent: float) -> dict[str, Any]:
    """Costs in JSON's types and SI units, without friction."""
    return {
        "rank": task.basis.rank,
        "nonzero_parameters": len(task.nonzero_parameters()),
        "components": task.components(percent),
        "percent": percent,
        **{objective: task.cost(objective) for objective in ("energy", "torque", "coupling")},
        "torques": task.torques().tolist(),
    }


def _added(added: AddedMass) -> dict[str, Any]:
    names = ("own_energy", "energy_change", "torque_change", "components")
    return {
        "link": added.link,
        "place": added.body.center.tolist(),
        "mass": added.body.mass,
        **{name: getattr(added, name) for name in names},
        "torques": added.torques.tolist(),
        "newly_identifiable": list(added.newly_identifiable),
        "changed": dict(added.base_parameter_changes),
    }


def _counterweights(study: DesignStudy) -> dict[str, Any]:
    found = study.counterweights
    bounds = [(p.link, p.lower.tolist(), p.upper.tolist(), p.mass) for p in found.bounds]
    return {
        **{name: getattr(found, name) for name in ("objective", "cost_before", "cost_after", "relative_reduction")},
        "bounds": [dict(zip(("link", "lower", "upper", "mass"), bound, strict=True)) for bound in bounds],
        "weights": [{"link": w.link, "mass": w.mass, "place": w.place.tolist()} for w in found.weights],
        "after": costs(found.balanced_task, found.percent),
        "inconsistent_links": list(found.inconsistent),
    }


def _removal(removal: Simplification) -> dict[str, Any]:
    lists = {
        "eliminated": list(removal.eliminated),
        "before": list(removal.equations_before),
        "after": list(removal.equations_after),
    }
    place = None if removal.place is None else removal.place.tolist()
    what = {"kind": removal.kind, "link": removal.link, "what": removal.description, "rank": removal.rank}
    return what | {"mass": removal.mass, "place": place} | lists
