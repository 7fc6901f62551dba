"""The folder of a study of a design: its numbers in JSON's types, figures, a page and a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.design.added_mass import AddedMass
from adaptctl.design.counterweights import Counterweights
from adaptctl.design.driving import DrivenArm
from adaptctl.design.picture import log_costs
from adaptctl.design.removals import Removal
from adaptctl.design.report import (
    SOURCE,
    costs_table,
    facts,
    header,
    outcome_words,
    removals_table,
    run_words,
    sections,
)
from adaptctl.design.study import DesignStudy
from adaptctl.design.task import DesignTask
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.recording.drawing import run_color, thinned
from adaptctl.recording.page import Report
from adaptctl.recording.result import Progress, silent
from adaptctl.recording.wording import torque_error_unit

if TYPE_CHECKING:
    import rerun as rr

SCHEMA = "adaptctl/design/1"
TURN, FRAMES, SHOWN = 6.0, 121, 600
"""s that the arm moves where nothing was run, positions of it then, and at most of a run"""
AVERAGE = 0.25
"""s over which errors and torques are averaged"""
TITLES = {
    "arm": "What a mass does anywhere on the arm",
    "links": "What a mass does on every link",
    "torques": "Torques without the counterweights and with them",
    "components": "Energy error by the number of components kept",
    "bodies": "What a gripper, a camera and a motor cost",
    "tracking": "Tracking errors of all joints",
    "applied": "Torques of all joints, all parameters adapted",
}
"""of figures, in the viewer"""


def write_study(
    folder: Path,
    study: DesignStudy,
    content: Mapping[str, Any],
    runs: Sequence[DrivenArm] = (),
    progress: Progress = silent,
) -> None:
    """Write the files of a design `study` into a `folder`, all or none: design.json with the `content`, in JSON's
    types, figures as PNG in the subfolder `figures`, report.html and recording.rrd. `runs` in closed loop, none by
    default, have a section of the page, and curves and their last motion in the recording. `progress(what, share)` is
    called with what is being written and the fraction done, 0 to 1. Raises `FileError` where a file cannot be written,
    and for numbers in `content` that are NaN or infinite, `RankError` where the mechanism's rank, its number of base
    parameters, cannot be certified."""
    shown = Report(
        experiment="design",
        title=f"{study.task.mechanism.name}: where a mass may be added",
        outcome=" ".join((outcome_words(study), *run_words(study, runs))),
        facts=tuple(facts(study)),
        sections=tuple(sections(study, runs)),
        source=SOURCE,
    )
    record = partial(_record, study, runs, shown)
    shown.write(folder, content, name="design.json", record=record, progress=progress)


def _record(
    study: DesignStudy, runs: Sequence[DrivenArm], shown: Report, path: Path, figures: Mapping[str, Path]
) -> None:
    """The arm in motion, coloured at each position on it by the change of the motion's energy by a point mass there,
    its counterweights, errors and torques of the runs, tables and pictures."""
    import rerun.blueprint as rrb

    from adaptctl.recording import views
    from adaptctl.recording.scene import WORLD, log_base
    from adaptctl.recording.skeleton import Viewpoint, floor_height, skeleton
    from adaptctl.recording.stream import log_markdown, log_picture, saved_stream

    mechanism = study.task.mechanism
    parts, (time, p) = skeleton(mechanism), _moved(study, runs)
    label = f"What {study.body.mass:g} kg costs: blue relieves, red costs · yellow: counterweights"
    arm = views.arm(WORLD, label, Viewpoint.of(mechanism, parts, p))
    pictures = [views.picture(f"figures/{name}", TITLES.get(name, name.capitalize())) for name in figures]
    right = rrb.Vertical(views.text("summary", "Summary"), *_beside(study, runs))
    layout = views.tabs(rrb.Horizontal(arm, right, name="Overview"), rrb.Grid(*pictures, name="Figures"))
    content = np.ascontiguousarray(np.concatenate([study.counterweights.parameters, p.ravel()])).tobytes()
    with saved_stream(path, shown, content, layout) as recording:
        text = shown.markdown(header(study), costs_table(study), removals_table(study))
        log_markdown(recording, "summary", text)
        log_base(recording, mechanism, parts, floor_height(mechanism, parts, p))
        log_costs(recording, study, parts, time, p)
        for name, picture in figures.items():
            log_picture(recording, f"figures/{name}", picture)
        for i, run in enumerate(runs):
            _log_run(recording, i, run)


def _beside(study: DesignStudy, runs: Sequence[DrivenArm]) -> list[Any]:
    """Views beside the arm: errors and torques of the runs, or, without any, costs on the links."""
    from adaptctl.recording import views

    if not runs:
        return [views.picture("figures/links", TITLES["links"])]
    error = f"Tracking error of all joints (RMS), powers of ten of a {error_unit(study.task.mechanism)}"
    torque = f"Torque of all joints (RMS over 0.25 s, {torque_error_unit(study.task.mechanism)})"
    end = max(run.demand.duration for run in runs)
    return [views.curves("/error", error, end), views.curves("/torque", torque, end)]


def _log_run(recording: rr.RecordingStream, index: int, run: DrivenArm) -> None:
    from adaptctl.recording.stream import Style, log_series
    from adaptctl.recording.tracking import CURVE_SAMPLES, SMALLEST_ERROR

    every, style = thinned(len(run.time), CURVE_SAMPLES), Style((run.label,), (run_color(index),), width=2.0)
    errors = np.log10(1e3 * np.maximum(_moving(run, run.error), SMALLEST_ERROR))
    for name, values in (("error", errors), ("torque", _moving(run, run.applied))):
        log_series(recording, f"{name}/{run.name}", run.time[every], values[every, None], style)


def _moving(run: DrivenArm, values: Array) -> Array:
    """Root mean squares (T,) of all joints' values (T, r), over AVERAGE about each time."""
    window = min(len(run.time), max(1, round(AVERAGE * len(run.time) / run.demand.duration)))
    mean = np.convolve(np.mean(values**2, axis=1), np.full(window, 1.0 / window), "same")
    return np.asarray(np.sqrt(mean))


def _moved(study: DesignStudy, runs: Sequence[DrivenArm]) -> tuple[Array, Array]:
    """Times (T,) and positions (T, r) of the last run, or of a motion about home where none was run."""
    if not runs:
        p = _motion(study)
        return np.linspace(0.0, TURN, len(p)), p
    every = thinned(len(runs[-1].time), SHOWN)
    return runs[-1].time[every], runs[-1].p[every]


def _motion(study: DesignStudy) -> Array:
    """Positions (FRAMES, r) that swing every joint a little about the home position, within reach of the loops."""
    mechanism = study.task.mechanism
    phase = np.linspace(0.0, 2.0 * np.pi, FRAMES)[:, None] * np.arange(1, mechanism.dof + 1).clip(max=3)
    turns = np.array([joint.kind.turns for joint in mechanism.primary_joints])
    swing = np.where(turns, 0.25, 0.05)
    if mechanism.description.loops is not None:
        swing = swing * np.where(np.arange(mechanism.dof) == 0, 1.0, 0.5)
    return np.asarray(mechanism.home + swing * np.sin(phase))


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
