"""Figures of the replication: the paper's own, and its tables with all seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from adaptctl.arrays import Array
from adaptctl.experiments.replication.arms import Draws, StatedMotion
from adaptctl.experiments.replication.printed import PrintedTable
from adaptctl.recording.drawing import INK, MUTED, PAPER, Color, Drawing, joint_color, run_color, sheet

PRINTED = run_color(1)
BAND = (5.0, 95.0)
"""percentiles of the inner band; the outer one is all seeds"""
LEAST = 1e-10
"""percent, or (N m)^2: what lies below is drawn at the lower edge"""
BANDS = "Line: median of the seeds; bands: from the 5th to the 95th percentile, and all; crosses: printed"


def singular_values(draws: Draws, numbers: Array) -> Drawing:
    """Drawing of Table 2: singular values (J per SI unit) of all draws, and the k printed `numbers`."""
    caption = f"Table 2: the {draws.rank} singular values that are not round-off. {BANDS}."

    def draw() -> Figure:
        figure = sheet(3.4)
        axes = figure.subplots()
        place = np.arange(1.0, len(numbers) + 1.0)
        _bands(axes, place, draws.singular_values[:, : draws.rank], run_color(0))
        _printed(axes, place, numbers)
        axes.set(yscale="log", xlim=(0.5, len(numbers) + 0.5), xlabel="number", ylabel="singular value")
        axes.legend(loc="lower left")
        return figure

    return Drawing("table-2", caption, draw)


def percent_errors(panels: Mapping[str, Draws], points: Mapping[str, Mapping[int, float]]) -> Drawing:
    """Drawing of Figure 3: energy errors (%) over the number of components, a panel for each of two or three arms'
    draws, with the printed `points` by title and number; a negative one is an upper bound, drawn as an arrow."""
    caption = f"Figure 3: error of the energy over the number of components kept. {BANDS} in Tables 3 and 10; arrows: "
    return Drawing("figure-3", caption + "the text's upper bounds.", partial(_percent_errors, panels, points))


def torque_errors(name: str, table: PrintedTable, errors: Array) -> Drawing:
    """Drawing of Table 3 or 10, called `name` ("table-3"): mean square torque `errors` (seeds, k + 1, r), (N m)^2, over
    the number of components, and those printed in the `table`."""
    title = name.replace("-", " ").title()
    caption = f"{title}: mean square torque errors over the number of components kept, a joint each. {BANDS}."
    return Drawing(name, caption, partial(_torque_errors, table, errors))


def torques(name: str, joint: int, motion: StatedMotion, curves: Mapping[str, Array]) -> Drawing:
    """Drawing of Figure 4 or 6, called `name` ("figure-4"): four torques (T,), N m, of a `joint`, counted from 1, along
    a `motion`, by label in `curves`, the actual one first."""
    caption = (
        f"{name.replace('-', ' ').title()}: torque of joint {joint} along the stated sinusoid, with all parameters and "
        "with the largest components of the first seed's draw; mean square errors in the legend."
    )
    return Drawing(name, caption, partial(_torques, joint, motion, curves))


def two_parameters(c: float, real: Array, essential: Array, independent: Array) -> Drawing:
    """Drawing of Figure 1: the plane of two parameters of which only m1 + `c` m2 matters, with the points (2,) of the
    `real`, the `essential` and the `independent` parameters."""
    caption = (
        f"Figure 1: two parameters of which only m1 + c m2 matters, c = {c:g}. The real parameters, projected onto the "
        "essential space; a null vector leads from there to the independent parameters, where m2 is zero."
    )
    return Drawing("figure-1", caption, partial(_two_parameters, c, real, essential, independent))


def _percent_errors(panels: Mapping[str, Draws], points: Mapping[str, Mapping[int, float]]) -> Figure:
    figure = sheet(3.6)
    row = figure.subplots(1, len(panels), sharey=True)
    for i, (axes, (title, draws)) in enumerate(zip(row, panels.items(), strict=True)):
        errors = draws.percent_errors
        _bands(axes, np.arange(float(errors.shape[1])), np.maximum(errors, LEAST), run_color((0, 2, 3)[i]))
        exact = {s: value for s, value in points[title].items() if value > 0.0}
        _printed(axes, np.array(list(exact)), np.array(list(exact.values())))
        for s, bound in ((s, -value) for s, value in points[title].items() if value < 0.0):
            style = {"arrowstyle": "->", "color": PRINTED.hex, "lw": 1.6}
            axes.annotate("", (s, bound / 6.0), (s, bound), arrowprops=style)
        axes.set(title=title, yscale="log", ylim=(1e-5, 200.0), xlim=(0.0, errors.shape[1] - 0.5))
        axes.set_xlabel("components kept")
    row[0].set_ylabel("energy error [%]")
    row[0].legend(loc="lower left")
    return figure


def _torque_errors(table: PrintedTable, errors: Array) -> Figure:
    rows, columns = -(-errors.shape[-1] // 3), np.array([int(column) for column in table.columns])
    figure = sheet(2.3 * rows + 0.3)
    for j, axes in enumerate(np.ravel(figure.subplots(rows, 3, sharex=True, sharey=True))):
        _bands(axes, np.arange(float(errors.shape[1])), np.maximum(errors[..., j], LEAST), joint_color(j))
        _printed(axes, columns, np.maximum(table.values(f"joint{j + 1}")[0], LEAST))
        axes.set(yscale="log", ylim=(0.5 * LEAST, 3.0 * errors.max()), xlim=(0.0, errors.shape[1] - 0.5))
        axes.set_title(f"joint {j + 1}")
    figure.supxlabel("components kept", size=9)
    figure.supylabel("mean square torque error [(N·m)²]", size=9)
    return figure


def _torques(joint: int, motion: StatedMotion, curves: Mapping[str, Array]) -> Figure:
    figure = sheet(3.6)
    axes = figure.subplots()
    styles: Sequence[tuple[Color, float, object]] = (
        (INK, 3.2, "-"),
        (MUTED, 1.4, "-"),
        (run_color(2), 1.6, "-"),
        (run_color(1), 1.6, (0, (4, 3))),
    )
    for (label, values), (color, width, dashes) in zip(curves.items(), styles, strict=True):
        axes.plot(motion.time, values, color=color.hex, linewidth=width, linestyle=dashes, label=label)
    axes.set(xlim=(0.0, motion.time[-1]), xlabel="time [s]", ylabel=f"torque of joint {joint} [N·m]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def _two_parameters(c: float, real: Array, essential: Array, independent: Array) -> Figure:
    figure = sheet(4.0)
    axes = figure.subplots()
    reach = 1.35 * float(np.abs(independent).max())
    lines = (((1.0, c), 1.0, "essential space", run_color(0)), ((-c, 1.0), 0.5, "null space", MUTED))
    for direction, place, label, color in lines:
        ends = np.outer([-reach, reach], np.array(direction) / np.hypot(1.0, c))
        axes.plot(*ends.T, color=color.hex, linewidth=1.2, linestyle=(0, (5, 4)))
        _label(axes, place * ends[1], label, color)
    axes.plot(*np.stack([real, essential]).T, color=INK.faded(0.5, PAPER).hex, linewidth=1.0, linestyle=":")
    _arrow(axes, essential, independent, MUTED, 1.4)
    _label(axes, 0.5 * (essential + independent), "$b_1 n_1$", MUTED)
    arrows = {"$D_R$, real": (real, INK), "$D_E$, essential": (essential, run_color(0))}
    for label, (point, color) in (arrows | {"$D_I$, independent": (independent, PRINTED)}).items():
        _arrow(axes, np.zeros(2), point, color, 2.0)
        _label(axes, point, label, color)
    for line in (axes.axhline, axes.axvline):
        line(0.0, color=INK.hex, linewidth=0.8)
    axes.set_aspect("equal")
    axes.set(xlim=(-0.45 * reach, 1.3 * reach), ylim=(-0.2 * reach, 0.62 * reach), xlabel="$m_1$", ylabel="$m_2$")
    return figure


def _arrow(axes: Axes, start: Array, end: Array, color: Color, width: float) -> None:
    style = {"arrowstyle": "-|>", "color": color.hex, "lw": width, "shrinkA": 0}
    axes.annotate("", tuple(end), tuple(start), arrowprops=style)


def _label(axes: Axes, point: Array, text: str, color: Color) -> None:
    frame = {"facecolor": PAPER.hex, "edgecolor": "none", "pad": 1.0, "alpha": 0.85}
    axes.annotate(text, tuple(point), xytext=(9, 3), textcoords="offset points", color=color.hex, bbox=frame)


def _bands(axes: Axes, place: Array, values: Array, color: Color) -> None:
    """Median, inner band and range of values (seeds, n)."""
    for low, high, alpha in ((0.0, 100.0, 0.13), (*BAND, 0.22)):
        edges = np.percentile(values, [low, high], axis=0)
        axes.fill_between(place, *edges, color=color.hex, alpha=alpha, linewidth=0)
    axes.plot(place, np.median(values, axis=0), color=color.hex, linewidth=1.8, label="computed")


def _printed(axes: Axes, place: Array, numbers: Array) -> None:
    axes.plot(place, numbers, "x", color=PRINTED.hex, markersize=6.5, markeredgewidth=1.8, label="printed", zorder=5)
