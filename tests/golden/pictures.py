"""What figures and recordings show, as numbers: places, sizes, colors and styles of what is drawn, without words."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Iterable, Iterator
from copy import copy
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from golden.scenes import scene, sheet

DIGITS = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
HEX = re.compile(r"#([0-9a-f]{2})([0-9a-f]{2})([0-9a-f]{2})")
CURVE, SHAPE = ("color", "linestyle", "linewidth", "marker", "markersize"), ("facecolor", "edgecolor", "linewidth")
GRID = ("visible", "color", "linewidth", "zorder")
WORDS = ("position", "color", "size", "ha", "va", "rotation", "weight")
PROPERTIES = {"Line2D": CURVE, "Text": WORDS, "Polygon": SHAPE, "Rectangle": SHAPE, "AxesImage": ("clim", "extent")}
OF_AXES = ("xlim", "ylim", "xscale", "yscale", "aspect", "visible", "position")
ANCHORS = {"start": "0", "middle": "1", "end": "2"}
UNTOLD = re.compile(
    r"^rerun\.|^log_t|^blueprint$|sha256|start_time|version|media_type|:(names?|contents|query|display_name)$|"
    r":(root_container|active_tab|space_origin)$"
)
"""Columns that are of no entity, hashes, times of day, words and random names"""
NAMED_AT_RANDOM = re.compile(r"[0-9a-f]{8}-[0-9a-f-]{27}")


def pictures() -> dict[str, Any]:
    """Figures by their names, each as what it draws; and a recording, entity by entity."""
    found: dict[str, Any] = {name: of_figure(figure) for name, figure in figures()}
    found |= {f"svg {name}": of_svg(text) for name, text in sheets()}
    return found | {f"recording of a {name}": recording(write) for name, write in recordings()}


def told(values: Any) -> str:
    """Any numbers by four: how many are finite, their mean, their size, and their mean weighted by place."""
    numbers = np.ravel(np.asarray(values, dtype=np.float64))
    if not len(numbers):
        return "none"
    own = np.where(np.isfinite(numbers), numbers, 0.0)
    means = own.mean(), np.sqrt(np.mean(own**2)), np.mean(np.linspace(0.5, 1.5, len(own)) * own)
    return " ".join([str(np.isfinite(numbers).sum()), *(f"{mean:.9g}" for mean in means)])


def of_figure(figure: Any) -> list[Any]:
    """Panels of a figure of Matplotlib, and the figure itself."""
    legends = [f"legend {len(one.get_texts())} {one._ncols} {one._loc_real} {legend(one)}" for one in figure.legends]
    return [told([*figure.get_size_inches(), figure.dpi]), *map(text, figure.texts), *legends, *map(panel, figure.axes)]


def panel(axes: Any) -> dict[str, Any]:
    found: dict[str, Any] = {"axes": looks(axes, OF_AXES)}
    found["ticks"] = [told(axis.get_ticklocs()) for axis in (axes.xaxis, axes.yaxis)]
    lines = zip(
        (axes.get_xgridlines(), axes.get_ygridlines()), (axes.get_xticklines(), axes.get_yticklines()), strict=True
    )
    found["grids"] = [f"{looks(grid[0], GRID)}, {ticks[0].get_markersize()}" for grid, ticks in lines if grid]
    found["spines"] = " ".join(str(spine.get_visible()) for spine in axes.spines.values())
    found["legend"] = legend(axes.get_legend())
    found["over"] = told(axes.titleOffsetTrans.to_values()[5])
    found["labels"] = [text(own) for own in (axes.title, *axes.get_xticklabels()[:1], *axes.get_yticklabels()[:1])]
    return found | {"drawn": [artist(own) for own in axes.get_children() if drawn(own)]}


def legend(own: Any) -> str:
    return "" if own is None else f"{own.get_frame_on()} {own.get_texts()[0].get_size()}"


def drawn(own: Any) -> bool:
    kind = type(own).__name__
    return kind in PROPERTIES or kind.endswith("Collection")


def artist(own: Any) -> str:
    """Kind, place and looks of a curve, an area, an image or a text."""
    kind = type(own).__name__
    common = f"{kind} {own.get_zorder()} {own.get_alpha()}"
    if kind == "Text":
        return f"{common} {text(own)}"
    return f"{common}, {told(points(own))}, {looks(own, PROPERTIES.get(kind, (*SHAPE, 'offsets')))}"


def points(own: Any) -> Any:
    if hasattr(own, "get_xydata"):
        return own.get_xydata()
    if hasattr(own, "get_paths"):
        return np.concatenate([path.vertices.ravel() for path in own.get_paths()] or [np.empty(0)])
    return own.get_path().vertices if hasattr(own, "get_path") else own.get_array()


def text(own: Any) -> str:
    return f"'{' '.join(DIGITS.findall(own.get_text()))}' {looks(own, WORDS)}"


def looks(own: Any, names: Iterable[str]) -> str:
    return ", ".join(str(value(getattr(own, f"get_{name}")())) for name in names)


def value(given: Any) -> Any:
    """A property in JSON's types: texts as they are, anything else by its numbers."""
    if given is None or isinstance(given, str | bool | int | float):
        return given
    flat = np.ravel(np.asarray(given, dtype=object)).tolist()
    return told(flat) if all(isinstance(one, int | float) for one in flat) else str(given)


def of_svg(source: str) -> dict[str, list[str]]:
    """Numbers of all attributes of a kind of element, by both, and in its texts; colors by red, green and blue."""
    found: dict[str, list[str]] = {}
    for tag, attributes, inside in re.findall(r"<(\w+)([^>]*)>([^<]*)", source):
        pairs = [*re.findall(r'([\w-]+)="([^"]*)"', attributes), ("inside", inside)]
        for name, content in pairs:
            found.setdefault(f"{tag} {name}", []).extend(numbers_of(name, content))
    return {name: summary(parts) for name, parts in found.items() if parts}


def numbers_of(name: str, content: str) -> list[str]:
    if name == "text-anchor":
        return [ANCHORS[content]]
    return DIGITS.findall(HEX.sub(rgb, content)) or [content] * name.startswith("fill")


def rgb(color: re.Match[str]) -> str:
    return " ".join(str(int(part, 16)) for part in color.groups())


def summary(parts: list[str]) -> list[str]:
    numbers = [float(part) for part in parts if DIGITS.fullmatch(part)]
    return [told(numbers), *sorted({part for part in parts if not DIGITS.fullmatch(part)})]


def recorded(path: Path) -> dict[str, list[str]]:
    """Components of all entities of a recording and of its layout, each by its rows and numbers."""
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    found: dict[str, list[str]] = {}
    stores = [reader, *(reader.store(store=own) for own in reader.blueprints()[:1])]
    for chunk in (one for store in stores for one in store.stream()):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if not UNTOLD.search(name):
                numbers = list(flat(batch[name].to_pylist()))
                entity = NAMED_AT_RANDOM.sub("*", str(chunk.entity_path))
                rows = "static" if chunk.is_static else str(batch.num_rows)
                found.setdefault(f"{entity} {name}", []).append(f"{rows} {told(numbers)}")
    return {name: sorted(own) for name, own in sorted(found.items())}


def flat(values: Any) -> Iterator[float]:
    """All numbers within lists, mappings, times and texts."""
    if isinstance(values, dict):
        values = list(values.values())
    if hasattr(values, "total_seconds"):
        values = values.total_seconds()
    if isinstance(values, str):
        values = [float(one) for one in DIGITS.findall(values)]
    if isinstance(values, bytes):
        values = [len(values)]
    if isinstance(values, Iterable):
        for one in values:
            yield from flat(one)
    elif isinstance(values, int | float):
        yield float(values)


# What is drawn


def figures() -> Iterator[tuple[str, Any]]:
    """Figures that are drawn by Matplotlib alone, and one that is SVG as well."""
    from matplotlib import rc_context

    from adaptctl.recording.drawing import PAPER_STYLE, STYLE
    from adaptctl.recording.figures import parameters

    with rc_context({**STYLE, **PAPER_STYLE}):
        yield from contests()
    with rc_context(STYLE):
        yield from maps()
        yield from printed()
        yield from designs()
        yield "rollout", compared().subject.rollout._figure()
        yield "parameters", parameters(compared())


def contests() -> Iterator[tuple[str, Any]]:
    from contest_rows import ROWS, rows_of

    from adaptctl.contest.figures import drawings
    from adaptctl.contest.ranking import Ranking

    rows = [{**row, "curve": [3.0 * row["error"], row["error"]]} for row in rows_of(ROWS)]
    hard = [{**row, "condition": "noise", "error": 2.0 * row["error"]} for row in rows]
    third = [{**row, "condition": "payload"} for row in rows]
    ranking = Ranking([*rows, *hard, *third])
    yield from ((f"contest {one.name}", one.draw()) for one in drawings(ranking, ranking.table(), 20.0))


def maps() -> Iterator[tuple[str, Any]]:
    from adaptctl.sweeps.report import SettingsMap, map_figure

    error = np.array([[1.0, 2.0, 4.0], [3.0, np.nan, 8.0]])
    yield "sweep", map_figure(SettingsMap("x", "y", [1.0, 2.0, 3.0], [0.5, 0.75], error, error / 8.0))


def printed() -> Iterator[tuple[str, Any]]:
    from adaptctl.experiments.replication import drawings

    rng, marks = np.random.default_rng(0), {1: 2.0, 3: -0.5}
    panels = {name: (np.exp(rng.normal(size=(9, 5))), marks) for name in "abc"}
    yield "bands", drawings.bands("bands", "", "y", panels, first=1).draw()


def designs() -> Iterator[tuple[str, Any]]:
    from adaptctl.design.report import report

    study, runs = design()
    yield from ((f"design {one.name}", one.draw()) for one in report(study, runs=runs).drawings)


def sheets() -> Iterator[tuple[str, str]]:
    """Figures that are SVG: of a comparison for a page and for a phone, and of others for a page."""
    from adaptctl.experiments.laws import friction_curves
    from adaptctl.experiments.over_time import over_time
    from adaptctl.identification import report
    from adaptctl.recording import compared_report
    from adaptctl.recording.drawing import Drawing
    from adaptctl.recording.figures import drawings

    found = compared()
    for name, one in drawings(found).items():
        yield name, one.svg()
        yield f"{name}, narrow", one.svg(3.45)
    yield from ((f"compared {one.name}", one.svg()) for one in compared_report.drawings([trace("a"), trace("bb")]))
    values = {run.name: np.abs(run.rollout.error[:, 0]) for run in found.runs}
    v = np.linspace(-1.0, 1.0, 51)
    draws = {"over time": partial(over_time, found.runs, values, "y")}
    draws |= {"friction": partial(friction_curves, rubbing(), {"shoulder.viscous": 1.5, "elbow.coulomb": 0.4}, v, 0.2)}
    draws |= {name: partial(getattr(report, name), identified()) for name in ("_torques", "_residuals", "_excitation")}
    yield from ((name, Drawing(name, "", draw, plain=True).svg()) for name, draw in draws.items())
    yield "of everything", sheet()


def trace(folder: str) -> Any:
    """A finished run's table, of two joints that are sampled each hundredth of a second."""
    time = 0.01 * np.arange(100)
    table = {
        f"{kind}.j{j}": np.sin((j + k + len(folder)) * time)
        for k, kind in enumerate(("error", "applied"))
        for j in (1, 2)
    }
    return SimpleNamespace(
        time=time,
        folder=folder,
        sample_time=0.01,
        entry=lambda name: "adaptive",
        names=lambda kind: [name.partition(".")[2] for name in table if name.startswith(kind)],
        columns=lambda kind: np.stack([own for name, own in table.items() if name.startswith(kind)], axis=1),
        column=table.__getitem__,
        unit=lambda name: "rad",
    )


def rubbing() -> Any:
    from adaptctl import load
    from adaptctl.description.drive import Drive

    return load("two_link").with_drives(Drive(viscous=2.0, coulomb=0.5))


def identified() -> Any:
    """What an identification shows of its validation."""
    from adaptctl import load

    time = np.linspace(3.0, 5.0, 80)
    measured, error = (np.stack([np.sin(k * time), np.cos(time / k)], axis=1) for k in (4.0, 31.0))
    fading = np.exp(-np.arange(31.0))[:, None] * [1.0, 0.5]
    validation = SimpleNamespace(
        time=time,
        measured=measured,
        predicted=measured - error,
        error=error,
        autocorrelation=lambda lags: fading[: lags + 1],
    )
    strengths = [SimpleNamespace(strength=x) for x in (1e-9, 0.3, 4.0, 1e3)]
    return SimpleNamespace(mechanism=load("two_link"), validation=validation, combinations=strengths)


@cache
def compared() -> Any:
    """A comparison by hand with forces of a contact, whose singular values are given: round-off differs by machine."""
    from comparisons import comparison

    from adaptctl import load
    from adaptctl.simulation.mujoco_plant import TOUCH_FLAGS

    found = comparison(load("two_link"), samples=200)
    force = np.outer(np.arange(200) % 90 > 40, [3.0, -2.0, 1.0, 0.4, 0.3, 0.2])
    touching = replace(found.subject.rollout, flags=dict(zip(TOUCH_FLAGS, force.T, strict=True)))
    sizes = np.geomspace(1.0, 1e-3, len(found.space.singular_values))
    sizes[found.space.rank :] = 1e-16
    space = copy(found.space)
    vars(space)["singular_values"] = sizes  # which it keeps once computed
    return replace(found, space=space, runs=(replace(found.subject, rollout=touching), *found.runs[1:]))


def recordings() -> Iterator[tuple[str, Callable[[Path], object]]]:
    """What writes recordings: of a comparison, of a report, of a design and of a live view."""
    from adaptctl.design.picture import record
    from adaptctl.design.report import report
    from adaptctl.recording.page import Report
    from adaptctl.recording.rerun_recording import write_recording

    study, runs = design()
    yield "comparison", lambda path: write_recording(path, compared())
    yield "report", lambda path: Report("a", "b", "c").record(path, {})
    yield "design", lambda path: record(study, (), report(study), path, {})
    yield "driven design", lambda path: record(study, runs, report(study), path, {})
    yield "live view", live
    yield "comparison of six", lambda path: write_recording(path, of_six())
    yield "scene", scene


def of_six() -> Any:
    """A comparison of more runs than stand in a row, of a task, of which one is not finite from its middle on."""
    from adaptctl.recording.comparison import TaskError

    found = compared()
    off = found.runs[1]
    runs = (*found.runs, *(replace(off, name=f"more{k}", label=f"more {k}") for k in range(4)))
    p = np.where(np.arange(200)[:, None] < 100, off.rollout.p, np.nan)
    runs = (*runs[:-1], replace(runs[-1], rollout=replace(off.rollout, p=p)))
    errors = {run.name: np.linalg.norm(run.rollout.error, axis=1) for run in runs}
    return replace(found, runs=runs, truth_known=False, task_error=TaskError("Error of the hand", "mm", errors))


@cache
def design() -> tuple[Any, list[Any]]:
    """A study with a counterweight, and runs; none of them was searched for or run."""
    from random_trees import random_chain

    from adaptctl.design import DesignTask
    from adaptctl.design.counterweights import Counterweight, Counterweights
    from adaptctl.design.driving import Demand, DrivenArm
    from adaptctl.design.mounting_bounds import bounds
    from adaptctl.design.study import DesignStudy, named_body

    task = DesignTask.within_limits(random_chain(2, 4), 20)
    every = bounds(task.mechanism, task.mechanism.description.body_names, 0.2, 0.5)
    weight = Counterweight(every[0].link, 0.4, np.array([-0.6, -0.2, 0.1]), 7850.0)
    found = Counterweights(task, "energy", 1.0, every[:1], (weight,), 1)
    time = np.linspace(0.0, 2.0, 21)
    values = np.sin(np.outer(time, [1.0, 3.0, 0.5, 0.2]))
    runs = [
        DrivenArm(name, name, Demand(0.1, 0.05, 0.5, 3.0, 2.0, False), time, values, 0.1 * k * values, 9.0 * values)
        for k, name in enumerate(("all-before", "all-after", "few-before", "few-after"), 1)
    ]
    return DesignStudy(task, named_body(1.0), every, 1.0, found, ()), runs


def live(path: Path) -> None:
    from adaptctl import load
    from adaptctl.recording.live_process import _end
    from adaptctl.recording.motion_recording import draw, started

    mechanism, time = load("two_link"), np.linspace(0.0, 1.0, 6)
    rows = np.column_stack(
        [time, np.outer(time, [0.5, -1.0]), np.outer(time**2, [0.4, -0.9]), np.outer(1 - time, [7, 3])]
    )
    recording, parts = started(mechanism, str(path), rows, "live")
    draw(recording, mechanism, parts, rows)
    _end(recording)


def recording(write: Callable[[Path], object]) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        write(path := Path(folder, "a.rrd"))
        return recorded(path)
