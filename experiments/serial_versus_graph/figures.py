"""Figures of the report on arms side by side."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from matplotlib.figure import Figure

from adaptctl.experiments.serial_versus_graph.result import Side, SideBySide
from adaptctl.recording.comparison import ControllerRun
from adaptctl.recording.drawing import Drawing, sheet
from adaptctl.recording.palette import GOAL, INK, RUNS, Color
from adaptctl.recording.series import thinned

DESIRED = GOAL.faded(0.45, INK)
"""the colour of what is desired, dark enough for paper"""
SAMPLES = 3000
"""At most as many samples are drawn."""
VIEWS = ((1, 2, "from the front"), (0, 2, "from the side"), (0, 1, "from above"))
AXES = "xyz"


def side_color(index: int) -> Color:
    """Colour, in all figures and recordings, of the arm of an `index`, from 0, among those compared; three colours in
    turn. Nothing is checked."""
    return (RUNS[0], RUNS[3], RUNS[2])[index % 3]


def drawings(result: SideBySide) -> Iterator[Drawing]:
    """Iterator over drawings for the report on a comparison of arms, `result`, each a `Drawing` (name, caption and
    function that makes the figure), in order: numbers of operations (where they were counted), paths of the tips, tip
    errors, and Lyapunov functions. Nothing is checked."""
    if all(side.comparison.subject.cost for side in result.sides):
        yield Drawing(
            "operations",
            "Floating-point operations on the independent parameters (full) and on all (pale).",
            partial(operations, result),
        )
    yield Drawing(
        "tip-path",
        "The path that both tips are to follow (dashed), and where they went while learning, from the start off it.",
        partial(tip_path, result),
    )
    yield Drawing(
        "tip-error",
        "Distance of the tip from where it should be (logarithmic scale): learning, and with adaptation off (dashed).",
        partial(tip_error, result),
    )
    yield Drawing(
        "lyapunov",
        "The Lyapunov function over its first value, along the adaptive runs. In theory it never rises.",
        partial(lyapunov, result),
    )


def operations(result: SideBySide) -> Figure:
    """Matplotlib figure of numbers of floating-point operations, as bars: of each arm's regressor and adaptive control
    tick (the computation of one torque), on the fundamental (base) parameters and on all. Nothing is checked."""
    figure = sheet(2.7)
    panels = figure.subplots(1, 2)
    for axes, title, counts in zip(
        panels, ("Slotine-Li regressor", "Adaptive tick"), (_regressors(result), _ticks(result)), strict=True
    ):
        for i, (reduced, full) in enumerate(counts):
            for place, value, alpha in ((2.4 * i, reduced, 1.0), (2.4 * i + 1.0, full, 0.4)):
                axes.barh(place, value, color=side_color(i).hex, alpha=alpha, height=0.85)
                axes.text(value, place, f" {value:,}", va="center", size=8)
        axes.set_yticks([2.4 * i + 0.5 for i in range(len(counts))], [side.label for side in result.sides])
        axes.invert_yaxis()
        axes.margins(x=0.18)
        axes.grid(visible=False, axis="y")
        axes.set_title(f"{title} [operations]")
    panels[1].set_yticklabels([])
    return figure


def tip_path(result: SideBySide) -> Figure:
    """Matplotlib figure of the paths of both arms' tips in their adaptive runs, m, and of the desired path, seen from
    the front (y, z), the side (x, z) and above (x, y). Nothing is checked."""
    figure = sheet(3.4)
    for axes, (across, up, view) in zip(figure.subplots(1, 3), VIEWS, strict=True):
        for i, side in enumerate(result.sides):
            tip = side.tips[side.comparison.subject.name]
            axes.plot(tip[:, across], tip[:, up], color=side_color(i).hex, linewidth=1.4, label=side.label)
        path = result.sides[0].desired[result.sides[0].comparison.subject.name]
        axes.plot(
            path[:, across],
            path[:, up],
            color=GOAL.faded(0.45, INK).hex,
            linewidth=1.2,
            linestyle=(0, (4, 3)),
            label="desired",
        )
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(f"{AXES[across]} [m]")
        axes.set_ylabel(f"{AXES[up]} [m]")
        axes.set_title(view)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=3)
    return figure


def tip_error(result: SideBySide) -> Figure:
    """Matplotlib figure of the distances of both arms' tips from the desired path (mm, logarithmic) over time, s,
    learning and with adaptation off. Nothing is checked."""
    figure = sheet(3.6)
    axes = figure.subplots()
    for i, side in enumerate(result.sides):
        for run, label, width, line in _shown(side):
            every = thinned(len(run.rollout.time), SAMPLES)
            values = 1e3 * side.tip_errors(run)[every]
            style = {"color": side_color(i).hex, "linewidth": width, "linestyle": line}
            axes.semilogy(run.rollout.time[every], values, label=f"{side.label}, {label}", **style)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("distance from the path [mm]")
    axes.set_xlim(0.0, max(side.comparison.subject.duration for side in result.sides))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def lyapunov(result: SideBySide) -> Figure:
    """Matplotlib figure of V / V(0) (no unit) over time, s, in both arms' adaptive runs: V is the Lyapunov function
    s'Ms/2 + e'Gamma^-1 e/2, with the mass matrix M, the sliding variable s, the parameters' error e (estimate less
    true) and the adaptation gain Gamma, V(0) its initial value; s' and e' are transposes. Nothing is checked."""
    figure = sheet(2.6)
    axes = figure.subplots()
    for i, side in enumerate(result.sides):
        run = side.comparison.subject
        if run.lyapunov is not None and run.lyapunov[0] > 0.0:
            every = thinned(len(run.lyapunov), SAMPLES)
            share = run.lyapunov[every] / run.lyapunov[0]
            axes.plot(run.rollout.time[every], share, color=side_color(i).hex, linewidth=2.0, label=side.label)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("V / V(0)")
    axes.set_ylim(0.0, 1.05)
    axes.legend(loc="lower left")
    return figure


def _regressors(result: SideBySide) -> list[tuple[int, int]]:
    return [(side.regressor.reduced, side.regressor.full) for side in result.sides]


def _ticks(result: SideBySide) -> list[tuple[int, int]]:
    runs = [(side.comparison.subject, side.full) for side in result.sides]
    return [(_flops(reduced), _flops(full)) for reduced, full in runs]


def _flops(run: ControllerRun | None) -> int:
    return run.cost.flops or 0 if run is not None and run.cost else 0


def _shown(side: Side) -> Iterator[tuple[ControllerRun, str, float, object]]:
    yield side.comparison.subject, "learning", 1.8, "-"
    if side.comparison.baseline is not None:
        yield side.comparison.baseline, "adaptation off", 1.2, (0, (4, 3))
