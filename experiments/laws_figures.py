"""Figures of adaptation laws under disturbances: parameter errors, recovery, friction, and stable bandwidths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.laws_measures import Recovery, held_back
from adaptctl.recording import ControllerRun
from adaptctl.recording.drawing import MUTED, TRUTH, run_color, sheet, thinned
from adaptctl.recording.wording import number, typeset

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SAMPLES = 400
"""of a curve"""
NAME_HEIGHT = 0.062
"""of a curve's name, in heights of the axes"""
COLUMNS = 3


def parameter_errors(curves: Sequence[tuple[int, ControllerRun, Array]], marked: bool = False) -> Figure:
    """Matplotlib figure of parameter errors (no unit, logarithmic) over time, s, a line for each of `curves`, at least
    one: the colour's place in the palette, the run, and its errors (T,). Where `marked`, bars below are filled while a
    limit held a run's torque back."""
    figure = sheet(4.2 + 0.22 * len(curves) * marked)
    heights = (3.0, 0.25 * len(curves) + 0.2) if marked else (1.0,)
    panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for k, (i, run, values) in enumerate(curves):
        every = thinned(len(values), SAMPLES)
        style = "-" if i < 5 else (0, (4, 2))
        panels[0].semilogy(run.rollout.time[every], values[every], color=run_color(i).hex, linestyle=style)
        if marked:
            panels[1].broken_barh(spans(run.rollout.time, held_back(run)), (-k - 0.35, 0.7), color=run_color(i).hex)
    if marked:
        panels[1].set_yticks([-k for k in range(len(curves))], [run.label for _, run, _ in curves])
        panels[1].set_title("torque held back")
    panels[-1].set_xlabel("time [s]")
    panels[0].set_ylabel("parameter error")
    panels[0].margins(x=0.01)
    _name_ends(panels[0], curves)
    return figure


def _name_ends(axes: Axes, curves: Sequence[tuple[int, ControllerRun, Array]]) -> None:
    """Names to the right of where curves end, moved apart where they would overlap."""
    low, high = np.log(axes.get_ylim())
    ends = sorted(((np.log(values[-1]) - low) / (high - low), i, run) for i, run, values in curves)
    heights = np.array([end for end, _, _ in ends])
    for k in range(1, len(heights)):
        heights[k] = max(heights[k], heights[k - 1] + NAME_HEIGHT)
    heights -= max(0.0, heights[-1] - 1.0)
    for height, (end, i, run) in zip(heights, ends, strict=True):
        axes.annotate(
            f"{run.label}  {np.exp(low + end * (high - low)):.2g}",
            (1.0, end),
            (1.025, height),
            "axes fraction",
            "axes fraction",
            color=run_color(i).hex,
            fontsize=8.0,
            va="center",
            arrowprops={"arrowstyle": "-", "color": run_color(i).hex, "linewidth": 0.6},
        )


def spans(time: Array, marked: Array) -> list[tuple[float, float]]:
    """Intervals of time (start, length), s, in which `marked` (T,) is positive, in order. `time` (T,), s, is that of
    evenly spaced samples, each of which counts until the next."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], (marked > 0.0).astype(int), [0]))))
    period = float(time[1] - time[0]) if len(time) > 1 else 0.0
    starts, stops = edges[::2], edges[1::2]
    return [(float(time[a]), float(time[b - 1] - time[a]) + period) for a, b in zip(starts, stops, strict=True)]


def recovery_times(found: Sequence[Recovery]) -> Figure:
    """Matplotlib figure of the times, s, that runs took to recover, a panel for each event and a bar for each run, or,
    for one that did not recover, the ratio of its last RMS error to the earlier one."""
    events, runs = (
        list(dict.fromkeys(each)) for each in zip(*((one.event, one.run.label) for one in found), strict=True)
    )
    figure = sheet(1.0 + 0.3 * len(runs))
    panels = figure.subplots(1, len(events), sharey=True, squeeze=False)[0]
    for axes, event in zip(panels, events, strict=True):
        here = [one for one in found if one.event == event]
        longest = max((one.time for one in here if one.time is not None), default=1.0) or 1.0
        for one in here:
            place, time = runs.index(one.run.label), one.time
            label = f"not back: {number(one.left, 2)} × earlier" if time is None else f"{time:.2g}"
            axes.barh(place, time or 0.0, height=0.6, color=run_color(0).hex)
            color = MUTED.hex if time is None else None
            axes.text((time or 0.0) + 0.02 * longest, place, label, va="center", color=color)
        axes.set_xlim(0.0, 1.18 * longest)
        axes.set_title(f"after the {event}")
        axes.set_xlabel("time to return [s]")
    names = {one.run.label: f"{one.run.label}  ({1e3 * one.earlier:.2g})" for one in found}
    panels[0].set_yticks(range(len(runs)), [names[label] for label in runs])
    panels[0].invert_yaxis()
    return figure


def friction_curves(
    mechanism: Mechanism, learned: Mapping[str, float], v: Array, stribeck: float, stribeck_speed: float
) -> Figure:
    """Matplotlib figure of friction (N m, N if prismatic) over speed (rad/s, m/s), a panel for each joint of a
    `mechanism`: the true one with Stribeck's excess, `stribeck` of Coulomb friction, half gone at `stribeck_speed`; the
    `learned` one, by parameter name; and how often the joint moved at each speed in `v` (T, r)."""
    joints = mechanism.primary_joints
    rows = -(-len(joints) // COLUMNS)
    figure = sheet(2.0 * rows + 0.4)
    panels = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axes, joint, moved in zip(panels, joints, np.abs(v).T, strict=False):
        speeds = np.linspace(0.0, moved.max(), 200)
        often = axes.twinx()
        often.hist(moved, bins=30, color=MUTED.hex, alpha=0.2)
        often.set_axis_off()
        viscous, coulomb = joint.drive.viscous or 0.0, joint.drive.coulomb or 0.0
        true = viscous * speeds + coulomb * (1.0 + stribeck / (1.0 + (speeds / stribeck_speed) ** 2))
        found = [learned.get(f"{joint.name}.{kind}", 0.0) for kind in ("viscous", "coulomb")]
        axes.plot(speeds, true, color=TRUTH.hex, label="true, with Stribeck's")
        axes.plot(speeds, found[0] * speeds + found[1], color=run_color(0).hex, label="learned: viscous, Coulomb")
        axes.set_ylim(bottom=0.0)
        axes.set_title(f"{joint.name} [{typeset(joint.kind.effort_unit)}]")
    for unused in panels[len(joints) :]:
        unused.set_visible(False)
    units = " or ".join(sorted({f"{joint.kind.position_unit}/s" for joint in joints}, reverse=True))
    figure.supxlabel(f"speed [{units}]", size=9)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def bandwidths_over_stiffness(lines: Mapping[str, Sequence[float]], stiffness: Sequence[str], least: float) -> Figure:
    """Matplotlib figure of the largest stable bandwidth, 1/s, over the `stiffness` of the joints, N m/rad, as text: a
    line for each law, by label, with a number for each stiffness; 0 is drawn at `least`."""
    figure = sheet(3.6)
    axes = figure.subplots()
    for i, (label, values) in enumerate(lines.items()):
        axes.semilogy(range(len(stiffness)), np.maximum(values, least), "o-", color=run_color(i).hex, label=label)
    axes.set_xticks(range(len(stiffness)), stiffness)
    axes.set_xlabel("stiffness [N·m/rad]")
    axes.set_ylabel("largest stable bandwidth [1/s]")
    figure.legend(loc="outside upper center", ncols=3)
    return figure
