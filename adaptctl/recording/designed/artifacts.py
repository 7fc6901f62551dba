"""Files of a study of a design: JSON, figures, a page, a recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun.blueprint as rrb

from adaptctl.arrays import Array
from adaptctl.design import DesignStudy
from adaptctl.files import write_json, write_text
from adaptctl.recording import views
from adaptctl.recording.designed.figures import drawings
from adaptctl.recording.designed.picture import log_costs
from adaptctl.recording.designed.wording import change, facts, header, place, quantities, told
from adaptctl.recording.drawing import write_drawings
from adaptctl.recording.page import embedded, rendered
from adaptctl.recording.result import silent
from adaptctl.recording.scene import WORLD, log_base
from adaptctl.recording.skeleton import skeleton
from adaptctl.recording.stream import log_markdown, log_picture, saved_stream
from adaptctl.recording.viewpoint import Viewpoint, floor_height

PACKAGE = "adaptctl.recording.designed"
TURN, FRAMES = 6.0, 121
"""s that the arm moves in a recording, and positions of it"""


@dataclass(frozen=True)
class Named:
    """What names a study's recording."""

    experiment: str
    title: str
    seed: int = 0
    complete: bool = True


def write_study(
    folder: Path,
    study: DesignStudy,
    content: Mapping[str, Any],
    named: Named | None = None,
    progress: Callable[[str, float], object] = silent,
    name: str = "design.json",
) -> None:
    """Write a study into a folder that is ready, every file whole or not at all. Raises FileError."""
    called = named or Named("design", f"{study.task.mechanism.name}: where a mass may be added")
    write_json(folder / name, content)
    progress("figures", 0.1)
    (folder / "figures").mkdir(exist_ok=True)
    figures = write_drawings(folder / "figures", drawings(study))
    progress("report", 0.7)
    write_text(folder / "report.html", page(study, called, figures))
    progress("recording", 0.8)
    write_recording(folder / "recording.rrd", study, called, figures)
    progress("recording", 1.0)


def page(study: DesignStudy, named: Named, figures: Mapping[str, Path]) -> str:
    """HTML of the page."""
    after = study.counterweights.balanced
    pairs = zip(quantities(study.task, study.percent), quantities(after, study.percent), strict=True)
    return rendered(
        "design.html",
        PACKAGE,
        title=named.title,
        eyebrow=named.experiment,
        lead=told(study),
        facts=list(facts(study)),
        task=header(study),
        mass=f"{study.body.mass:g}",
        links=[
            (c.link, place(c.cheapest), change(c.least), change(c.at_center), place(c.dearest), change(c.most), a)
            for c, a in zip(study.links, study.added, strict=True)
        ],
        weights=[(w.link, f"{w.mass:.3g}", place(w.place)) for w in study.counterweights.weights],
        rows=[(what, old, new) for (what, old), (_, new) in pairs],
        removals=study.worthwhile,
        figures=embedded(drawings(study), figures),
    )


def write_recording(path: Path, study: DesignStudy, named: Named, figures: Mapping[str, Path]) -> None:
    """Write the recording: the arm coloured by cost, in motion, with the counterweights; the tables and figures."""
    mechanism = study.task.mechanism
    parts, p = skeleton(mechanism), _motion(study)
    time = np.linspace(0.0, TURN, len(p))
    floor = floor_height(mechanism, parts, p)
    pictures = [views.picture(f"figures/{name}", name) for name in figures]
    eye = Viewpoint.of(mechanism, parts, p)
    label = (
        f"What {study.body.mass:g} kg costs: blue relieves, red costs · dots: beside the links · dark: counterweights"
    )
    overview = rrb.Horizontal(
        views.arm(WORLD, label, eye), rrb.Vertical(views.text("summary", "Summary"), pictures[1]), name="Overview"
    )
    layout = views.tabs(overview, rrb.Grid(*pictures, name="Figures"))
    with saved_stream(path, named, np.ascontiguousarray(study.task.parameters).tobytes(), layout) as recording:
        log_markdown(recording, "summary", _markdown(study))
        log_base(recording, mechanism, parts, floor)
        log_costs(recording, study, parts, time, p)
        for name, file in figures.items():
            log_picture(recording, f"figures/{name}", file)


def _motion(study: DesignStudy) -> Array:
    """Positions (FRAMES, r) that swing every joint a little about the home position, within reach of the loops."""
    mechanism = study.task.mechanism
    phase = np.linspace(0.0, 2.0 * np.pi, FRAMES)[:, None] * np.arange(1, mechanism.dof + 1).clip(max=3)
    turns = np.array([joint.kind.turns for joint in mechanism.primary_joints])
    swing = np.where(turns, 0.25, 0.05)
    if mechanism.description.loops is not None:
        swing = swing * np.where(np.arange(mechanism.dof) == 0, 1.0, 0.5)
    return np.asarray(mechanism.home + swing * np.sin(phase))


def _markdown(study: DesignStudy) -> str:
    """Summary in Markdown: the outcome, costs before and after, removals."""
    after = study.counterweights.balanced
    pairs = zip(quantities(study.task, study.percent), quantities(after, study.percent), strict=True)
    rows = [f"| {what} | {old} | {new} |" for (what, old), (_, new) in pairs]
    gone = [f"| {r.words} | {', '.join(r.gone)} | {r.rank} | {saved} |" for r, saved in study.worthwhile]
    table = ["| | as described | with counterweights |", "|---|---|---|", *rows]
    more = ["| what to do | parameters that go | left | operations saved |", "|---|---|---|---|", *gone]
    return "\n\n".join((told(study), header(study), "\n".join(table), "\n".join(more))) + "\n"
