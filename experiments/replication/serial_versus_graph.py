"""Section 5.3 of the paper in closed loop: a serial arm against one with a loop, on one path in space."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from adaptctl.experiments.replication.pages import PAPER
from adaptctl.experiments.replication.sides import COLORS, Side, SideBySide, of_arms
from adaptctl.recording import Progress, Result, views
from adaptctl.recording.comparison import ControllerRun
from adaptctl.recording.drawing import DARK, Color
from adaptctl.recording.page import Lines, Note, Part, Report, Section, Table, files_section, settings_section
from adaptctl.recording.report import summary as comparison_summary
from adaptctl.recording.rerun_recording import joint_errors, log_scene, torque_shares
from adaptctl.recording.result import Fact
from adaptctl.recording.scene import WORLD
from adaptctl.recording.skeleton import Viewpoint, floor_height
from adaptctl.recording.stream import Curves, in_decades, log_curves, log_markdown, saved_stream
from adaptctl.recording.trace import write_trace
from adaptctl.recording.wording import error, headline, number

APART = 1.35
"""m between the arms' bases; each has its own path, the same one"""
PURPOSE = (
    "Sheu and Walker compare two arms whose end points move with three degrees of freedom: the PUMA's first three "
    "joints, and the semi-direct-drive arm, whose forearm follows through a closed loop. How much does the loop cost? "
    "Both tips follow one path in space, and both controllers start knowing nothing, by the same distance off it. The "
    "PUMA's wrist is held straight, its tip is the flange."
)
WHY_NOT_16 = (
    "For the three-joint PUMA the paper prints 16. That is what energies give when they are not differenced: they "
    "then carry the constant part of the potential, which moves nothing, as one more. Differences of energies give 15, "
    "and so does the rank of the torque regressor; 7 N − 6 is 15 for three links with gravity along the first axis."
)
COUNTED = (
    "Operations are counted in the compiled equations. A regressor is counted at a configuration that closes the loop; "
    "a tick closes it too, by Newton's steps. Times are of this machine."
)


def shown(result: SideBySide) -> Result:
    """Result as the command line shows it, which writes summary, traces, figures, recording and report, all or none."""
    words = headline(result.verdict.before(_answer(result)), result.complete)
    return Result(result.complete, words, tuple(facts(result)), result.verdict, partial(_write, result))


def _write(result: SideBySide, folder: Path, progress: Progress) -> None:
    report(result).write(
        folder,
        summary(result),
        tables={_trace(side): partial(_write_trace, side) for side in result.sides},
        record=lambda path, figures: write_recording(path, result),
        progress=progress,
    )


def summary(result: SideBySide) -> dict[str, Any]:
    """Summary in JSON's types: of each arm under "arms" that of its runs, its numbers of links, joints, parameters and
    operations, and its tip's RMS distances from the path, m."""
    return {
        "schema": "adaptctl/side-by-side/1",
        "complete": result.complete,
        "verdict": result.verdict.as_builtins(),
        "experiment": result.experiment,
        "seed": result.seed,
        "duration": result.duration,
        "settings": {setting.name: setting.value for setting in result.settings},
        "arms": {side.arm.name: _arm(side) for side in result.sides},
    }


def _arm(side: Side) -> dict[str, Any]:
    mechanism = side.comparison.mechanism
    return comparison_summary(side.comparison) | {
        "links": len(mechanism.links),
        "joints": side.joints,
        "actuators": mechanism.dof,
        "inertial_parameters": len(mechanism.parameter_names),
        "rank_printed": side.arm.printed_rank,
        "regressor_flops": side.regressor,
        "first_tip_rms_error": side.first(side.subject),
        "final_tip_rms_error": side.final(side.subject),
        "final_tip_rms_errors": {run.name: side.final(run) for run in side.comparison.runs},
    }


def _trace(side: Side) -> str:
    return f"trace-{side.arm.name}.parquet"


def _write_trace(side: Side, path: Path) -> None:
    write_trace(path, side.comparison)


def _answer(result: SideBySide) -> str:
    ends = " and ".join(f"{_millimetres(side.final(side.subject))} ({side.arm.label})" for side in result.sides)
    text = f"From knowing nothing, the tip ends {ends} off the path that both follow."
    ticks = [side.flops(side.subject) for side in result.sides]
    if len(ticks) == 2 and ticks[0] and ticks[1]:
        ranks = [side.comparison.space.rank for side in result.sides]
        text += (
            f" A tick of the {result.sides[1].arm.label} takes {number(ticks[1] / ticks[0])} times the operations, for "
            f"{ranks[1]} independent parameters instead of {ranks[0]}."
        )
    return text


def facts(result: SideBySide) -> Iterator[Fact]:
    """Iterator over what a person asks first, with the answers of all arms."""
    for what in FACTS:
        value = next(value for name, value in QUESTIONS if name == what)
        yield Fact(what, " · ".join(value(side) for side in result.sides if value))


def _millimetres(value: float | None) -> str:
    return error(value, "mm")


def _native(run: ControllerRun | None) -> str:
    return f"{1e9 * run.cost.native:.0f} ns" if run is not None and run.cost and run.cost.native else "–"


def _called(run: ControllerRun) -> str:
    return f"{1e6 * run.cost.called:.1f} µs" if run.cost else "–"


def _rises(side: Side) -> str:
    rise = side.subject.lyapunov_max_increase
    return "–" if rise is None else "never" if rise == 0.0 else f"by {number(rise)} J"


RANK, TICK, NATIVE = "Independent parameters", "Operations of an adaptive tick", "Native, in a loop over many states"
TIP_FIRST, TIP_LAST, LYAPUNOV = "Tip error (RMS), first second", "Tip error (RMS), last 2 s", "Lyapunov function rises"
FACTS = ("Links", "Joints", RANK, TICK, NATIVE, TIP_FIRST, TIP_LAST, LYAPUNOV)
QUESTIONS: tuple[tuple[str, Callable[[Side], str] | None], ...] = (
    ("The mechanism", None),
    ("Links", lambda side: str(len(side.comparison.mechanism.links))),
    ("Joints", lambda side: str(side.joints)),
    ("Actuators, which are the primary joints", lambda side: str(side.comparison.mechanism.dof)),
    ("Inertial parameters", lambda side: str(len(side.comparison.mechanism.parameter_names))),
    (RANK, lambda side: str(side.comparison.space.rank)),
    ("… as the paper prints them (Table 13)", lambda side: str(side.arm.printed_rank)),
    ("Floating-point operations", None),
    ("Slotine-Li regressor, independent parameters", lambda side: f"{side.regressor['reduced']:,}"),
    ("Slotine-Li regressor, all parameters", lambda side: f"{side.regressor['full']:,}"),
    (TICK, lambda side: f"{side.flops(side.subject) or '–':,}"),
    ("… with all parameters", lambda side: f"{side.flops(side.full) or '–':,}"),
    ("Time of an adaptive tick", None),
    (NATIVE, lambda side: _native(side.subject)),
    ("… with all parameters adapted", lambda side: _native(side.full)),
    ("Called from Python", lambda side: _called(side.subject)),
    ("Tracking, from knowing nothing", None),
    (TIP_FIRST, lambda side: _millimetres(side.first(side.subject))),
    (TIP_LAST, lambda side: _millimetres(side.final(side.subject))),
    ("… with all parameters, last 2 s", lambda side: _millimetres(side.final(side.full))),
    ("… with adaptation off, last 2 s", lambda side: _millimetres(side.final(side.comparison.baseline))),
    ("Joint error (RMS), first second", lambda side: error(side.subject.first_rms_error, "mrad")),
    ("Joint error (RMS), last 2 s", lambda side: error(side.subject.final_rms_error, "mrad")),
    (LYAPUNOV, _rises),
    ("Peak torque", lambda side: f"{100 * float(side.comparison.peak_torque_shares.max()):.0f} % of the limit"),
    (
        "Steps at a torque limit",
        lambda side: f"{side.comparison.limited_steps(side.subject):,} of {len(side.subject.rollout.time):,}",
    ),
)


def table(result: SideBySide) -> Table:
    """Table of parameters, operations, times and errors of the arms, those of the paper's Table 13 first."""
    labels = [side.arm.label for side in result.sides]
    rows = [(what, *(value(side) if value else "" for side in result.sides)) for what, value in QUESTIONS]
    headings = [i for i, (_, value) in enumerate(QUESTIONS) if value is None]
    return Table(("what", *labels), rows, note=WHY_NOT_16, align="l" + "r" * len(labels), marked=headings)


def report(result: SideBySide) -> Report:
    """Report: the table of both arms, figures of their tracking, and the parameters that are kept."""
    kept, sources, lives = list[Part](), list[Part](), list[Part]()
    for side in result.sides:
        space, basis, mechanism = side.comparison.space, side.comparison.basis, side.comparison.mechanism
        counts = (
            f"{space.rank} of {len(space.parameter_names)}; a star marks a parameter that others are regrouped into."
        )
        kept += [Note(counts, f"{side.arm.label}:"), Lines(basis.equations())]
        sources.append(Note(mechanism.description.source, f"{mechanism.name}."))
        if isinstance(side.comparison.live, str) and side.comparison.live:
            lives.append(Note(f"There is no live arm of {side.arm.label} on this page: {side.comparison.live}."))
    costs = [drawing for drawing in of_arms(result) if drawing.name == "operations"]
    tracking = [drawing for drawing in of_arms(result) if drawing.name != "operations"]
    traces = {_trace(side): "Every control period of an arm's adaptive run, with units." for side in result.sides}
    return Report(
        result.experiment,
        result.title,
        result.verdict.before(_answer(result)),
        list(facts(result)),
        [
            Section("What was asked", (PURPOSE, table(result), Note(COUNTED), *costs)),
            Section("Tracking", (*tracking, *lives)),
            Section("Which parameters are kept", kept),
            settings_section(result.settings, *sources),
            files_section("Both arms in motion with all curves.", "The figures of this page, for programs.", traces),
        ],
        about=f"seed {result.seed}",
        seed=result.seed,
        complete=result.complete,
        source=f"Section 5.3 of {PAPER}",
    )


def write_recording(path: str | Path, result: SideBySide) -> None:
    """Write the recording, a file .rrd at `path`, whole or not at all: both arms in one scene, with the same curves of
    each. Raises `FileError` where it cannot be written."""
    positions = b"".join(np.ascontiguousarray(side.subject.rollout.p).tobytes() for side in result.sides)
    floor = min(floor_height(side.comparison.mechanism, side.skeleton, side.subject.rollout.p) for side in result.sides)
    page = report(result)
    with saved_stream(path, page, positions, _blueprint(result, floor)) as recording:
        log_markdown(recording, "summary", page.markdown(table(result), WHY_NOT_16))
        for i, (side, color) in enumerate(zip(result.sides, COLORS, strict=False)):
            place = [0.0, APART * (i - 0.5 * (len(result.sides) - 1)), 0.0]  # from left to right, from the front
            recording.log(f"{WORLD}/{side.arm.name}", rr.Transform3D(translation=place), static=True)
            log_scene(recording, side.comparison, side.skeleton, floor, color, f"{side.arm.name}/")
            log_curves(recording, _curves(side, color))


def _curves(side: Side, color: Color) -> Iterator[Curves]:
    name, label, subject, V = side.arm.name, side.arm.label, side.subject, side.subject.lyapunov
    runs = [(subject, "learning", color, 2.0)]
    if (baseline := side.comparison.baseline) is not None:
        runs.append((baseline, "adaptation off", color.faded(0.3, DARK), 1.5))
    for run, how, paint, width in runs:
        errors = in_decades(side.tip_errors(run))
        yield Curves(f"tip_error/{name}_{run.name}", run.rollout.time, errors, (f"{label}, {how}",), (paint,), width)
    yield joint_errors(f"error/{name}", subject, side.comparison.joint_names)
    yield from torque_shares(f"torque_share/{name}", side.comparison)
    if V is not None and V[0] > 0.0:
        yield Curves(f"lyapunov/{name}", subject.rollout.time, V / V[0], (label,), (color,), 2.0)


def _blueprint(result: SideBySide, floor: float) -> rrb.Blueprint:
    """Layout of the screen: both arms and the table on the left, curves on the right."""
    target = np.array([0.2, 0.0, 0.12 + 0.4 * floor])
    away = np.array([1.5, -0.75, 0.6]) * (0.45 - 0.3 * floor + 0.45 * APART * (len(result.sides) - 1))
    names = " · ".join([*(side.arm.label for side in result.sides), "desired: green ghost", "adaptation off: orange"])
    scene = views.arm(WORLD, names, Viewpoint(target + away, target, floor))
    end = max(side.subject.duration for side in result.sides)
    curves = [
        views.curves("/tip_error", "Distance of the tip from its path, powers of ten of a mm", end, room=views.LONG),
        views.curves("/lyapunov", "Lyapunov function over its first value · in theory it never rises", end),
    ]
    for side in result.sides:
        title = f"{side.arm.label}: tracking error [{side.comparison.error_unit}]"
        curves.append(views.curves(f"/error/{side.arm.name}", title, end))
    for side in result.sides:
        title = f"{side.arm.label}: torque / limit"
        curves.append(views.curves(f"/torque_share/{side.arm.name}", title, end, (-1.1, 1.1)))
    left = rrb.Vertical(scene, views.text("summary", "Table"), row_shares=[1, 1])
    return views.tabs(rrb.Horizontal(left, rrb.Grid(*curves, grid_columns=2), column_shares=[5, 7], name="Overview"))
