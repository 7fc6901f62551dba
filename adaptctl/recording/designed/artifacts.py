"""Files of a study of a design: JSON, figures, a page, a recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from adaptctl.arrays import Array
from adaptctl.design import DesignStudy
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.files import write_json, write_text
from adaptctl.recording import views
from adaptctl.recording.comparison import ControllerRun
from adaptctl.recording.designed.figures import drawings
from adaptctl.recording.designed.picture import log_costs
from adaptctl.recording.designed.wording import change, facts, header, outcome_words, place, quantities
from adaptctl.recording.drawing import Drawing, write_drawings
from adaptctl.recording.fact import Fact
from adaptctl.recording.folder import silent
from adaptctl.recording.page import Figure, embedded, rendered
from adaptctl.recording.palette import run_color
from adaptctl.recording.scene import WORLD, log_base
from adaptctl.recording.series import Style, log_series, thinned
from adaptctl.recording.skeleton import skeleton
from adaptctl.recording.stream import log_markdown, log_picture, saved_stream
from adaptctl.recording.tracking import CURVE_SAMPLES, log_decades
from adaptctl.recording.units import torque_error_unit
from adaptctl.recording.viewpoint import Viewpoint, floor_height

PACKAGE = "adaptctl.recording.designed"
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


@dataclass(frozen=True)
class Named:
    """Name, title and further contents of a design study, for its files and pages. (Such a study adds masses to an arm,
    places counterweights, and finds changes by which parameters are no longer needed.)

    `experiment` is the name of the experiment or command, `title` that of page and recording. `content` is the name of
    the JSON file with the numbers, "summary.json" by default; `seed`, 0 by default, that of the random numbers;
    `complete`, True by default, is False where the study was interrupted. `outcome_words` and `facts`, where not empty,
    replace the study's own; `drawings` are figures besides its own. `runs` are closed-loop runs whose errors and
    torques the recording shows; its arm makes the motion of the last of them, or, without runs, swings every joint a
    little. Nothing is checked at construction.
    """

    experiment: str
    title: str
    content: str = "summary.json"
    """name of the file with its numbers"""
    seed: int = 0
    complete: bool = True
    outcome_words: str = ""
    """the outcome, where it is not the study's own"""
    facts: tuple[Fact, ...] = ()
    drawings: tuple[Drawing, ...] = ()
    """figures besides the study's own"""
    runs: tuple[ControllerRun, ...] = ()
    """in closed loop; the last is the motion that is shown"""


def write_study(
    folder: Path,
    study: DesignStudy,
    content: Mapping[str, Any],
    named: Named | None = None,
    progress: Callable[[str, float], object] = silent,
) -> None:
    """Write the files of a design `study` into an existing `folder`, each whole or not at all: JSON, figures as PNG in
    the subfolder `figures`, report.html and recording.rrd. `content`, in JSON's types, goes into the JSON file. `named`
    has the files' names, title and further contents; None for those of the command `adaptctl design`, design.json being
    the JSON file. `progress(what, share)` is called with what is being written and the fraction done, 0 to 1; the
    default does nothing. Raises `FileError` where a file cannot be written, and for numbers in `content` that are NaN
    or infinite, `RankError` where the mechanism's rank, its number of base parameters, cannot be certified,
    `ValueError` for runs in `named` with positions that are NaN or infinite."""
    called = named or Named("design", f"{study.task.mechanism.name}: where a mass may be added", "design.json")
    write_json(folder / called.content, content)
    progress("figures", 0.1)
    (folder / "figures").mkdir(exist_ok=True)
    every = (*drawings(study), *called.drawings)
    figures = write_drawings(folder / "figures", every)
    progress("report", 0.7)
    write_text(folder / "report.html", page(study, called, embedded(every, figures)))
    progress("recording", 0.8)
    write_recording(folder / "recording.rrd", study, called, figures)
    progress("recording", 1.0)


def page(study: DesignStudy, named: Named, figures: Mapping[str, Figure]) -> str:
    """HTML, as text, of a design study's page: outcome, changes of the motion's energy by a point mass at positions on
    every link, counterweights, costs of the motion before and after them, and changes by which parameters are no longer
    needed. `named` has title and further contents, `figures` maps the drawings' names to the figures that go into the
    page. Raises `RankError` where the mechanism's rank, its number of base parameters, cannot be certified."""
    after = study.counterweights.balanced
    pairs = zip(quantities(study.task, study.percent), quantities(after, study.percent), strict=True)
    return rendered(
        "design.html",
        PACKAGE,
        title=named.title,
        eyebrow=named.experiment,
        lead=named.outcome_words or outcome_words(study),
        facts=list(named.facts or facts(study)),
        task=header(study),
        mass=f"{study.body.mass:g}",
        links=[
            (c.link, place(c.cheapest), change(c.least), change(c.at_center), place(c.dearest), change(c.most), a)
            for c, a in zip(study.links, study.added, strict=True)
        ],
        weights=[(w.link, f"{w.mass:.3g}", place(w.place)) for w in study.counterweights.weights],
        rows=[(what, old, new) for (what, old), (_, new) in pairs],
        removals=study.worthwhile,
        more=[drawing.name for drawing in named.drawings],
        figures=figures,
    )


def write_recording(path: Path, study: DesignStudy, named: Named, figures: Mapping[str, Path]) -> None:
    """Write the recording of a design `study` for the rerun viewer to the file `path` (.rrd), whole or not at all. It
    shows the arm in motion, coloured at each position on it by the change of the motion's energy by a point mass there,
    its counterweights, the errors and torques of the runs in `named`, tables and pictures. `figures` maps names of
    drawings to their PNG files. Raises `FileError` where the file cannot be written or read back, `OSError` where a PNG
    file cannot be read, `RankError` where the mechanism's rank, its number of base parameters, cannot be certified,
    `ValueError` for runs with positions that are NaN or infinite."""
    mechanism = study.task.mechanism
    parts, (time, p) = skeleton(mechanism), _moved(study, named.runs)
    content = np.ascontiguousarray(np.concatenate([study.counterweights.parameters, p.ravel()])).tobytes()
    with saved_stream(path, named, content, _layout(study, named, figures, Viewpoint.of(mechanism, parts, p))) as file:
        log_markdown(file, "summary", _markdown(study, named))
        log_base(file, mechanism, parts, floor_height(mechanism, parts, p))
        log_costs(file, study, parts, time, p)
        for name, picture in figures.items():
            log_picture(file, f"figures/{name}", picture)
        for i, run in enumerate(named.runs):
            _log_run(file, i, run)


def _layout(study: DesignStudy, named: Named, figures: Mapping[str, Path], eye: Viewpoint) -> rrb.Blueprint:
    label = f"What {study.body.mass:g} kg costs: blue relieves, red costs · yellow: counterweights"
    pictures = [views.picture(f"figures/{name}", TITLES.get(name, name.capitalize())) for name in figures]
    right: list[rrb.View] = [views.text("summary", "Summary")]
    if named.runs:
        unit = error_unit(study.task.mechanism)
        end, error = named.runs[0].duration, f"Tracking error of all joints (RMS), powers of ten of a {unit}"
        right.append(views.curves("/error", error, end))
        torque = f"Torque of all joints (RMS over 0.25 s, {torque_error_unit(study.task.mechanism)})"
        right.append(views.curves("/torque", torque, end))
    else:
        right.append(views.picture("figures/links", TITLES["links"]))
    overview = rrb.Horizontal(views.arm(WORLD, label, eye), rrb.Vertical(*right), name="Overview")
    return views.tabs(overview, rrb.Grid(*pictures, name="Figures"))


def _log_run(recording: rr.RecordingStream, index: int, run: ControllerRun) -> None:
    every = thinned(len(run.rollout.time), CURVE_SAMPLES)
    style = Style((run.label,), (run_color(index),), width=2.0)
    log_decades(recording, f"error/{run.name}", run, run.moving_rms_error(AVERAGE), style)
    squares = np.mean(run.rollout.applied**2, axis=1)
    window = max(1, round(AVERAGE / run.rollout.spacing))
    mean = np.sqrt(np.convolve(squares, np.full(window, 1.0 / window), "same"))
    log_series(recording, f"torque/{run.name}", run.rollout.time[every], mean[every, None], style)


def _moved(study: DesignStudy, runs: Sequence[ControllerRun]) -> tuple[Array, Array]:
    """Times (T,) and positions (T, r) of the last run, or of a motion about home where none was run."""
    if not runs:
        p = _motion(study)
        return np.linspace(0.0, TURN, len(p)), p
    rollout = runs[-1].rollout
    every = thinned(len(rollout.time), SHOWN)
    return rollout.time[every], rollout.p[every]


def _motion(study: DesignStudy) -> Array:
    """Positions (FRAMES, r) that swing every joint a little about the home position, within reach of the loops."""
    mechanism = study.task.mechanism
    phase = np.linspace(0.0, 2.0 * np.pi, FRAMES)[:, None] * np.arange(1, mechanism.dof + 1).clip(max=3)
    turns = np.array([joint.kind.turns for joint in mechanism.primary_joints])
    swing = np.where(turns, 0.25, 0.05)
    if mechanism.description.loops is not None:
        swing = swing * np.where(np.arange(mechanism.dof) == 0, 1.0, 0.5)
    return np.asarray(mechanism.home + swing * np.sin(phase))


def _markdown(study: DesignStudy, named: Named) -> str:
    """Summary in Markdown: the outcome, costs before and after, removals."""
    after = study.counterweights.balanced
    pairs = zip(quantities(study.task, study.percent), quantities(after, study.percent), strict=True)
    rows = [f"| {what} | {old} | {new} |" for (what, old), (_, new) in pairs]
    gone = [f"| {r.words} | {', '.join(r.gone)} | {r.rank} | {saved} |" for r, saved in study.worthwhile]
    table = ["| | as described | with counterweights |", "|---|---|---|", *rows]
    more = ["| what to do | parameters that go | left | operations saved |", "|---|---|---|---|", *gone]
    return (
        "\n\n".join((named.outcome_words or outcome_words(study), header(study), "\n".join(table), "\n".join(more)))
        + "\n"
    )
