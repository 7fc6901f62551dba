"""Figures of a comparison's report."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identifiability import EssentialSpace
from adaptctl.recording.colors import INK, LIMIT, MUTED, PAPER, TRUTH, joint_color, run_color
from adaptctl.recording.comparison import Comparison
from adaptctl.recording.contact_force import AVERAGING_TIME as CONTACT_AVERAGING
from adaptctl.recording.contact_force import contact_forces, touched
from adaptctl.recording.controller_run import FINAL_ERROR_TIME, ControllerRun
from adaptctl.recording.drawing import FIGURE_WIDTH, Drawing, is_narrow, run_style, sheet, thinned
from adaptctl.recording.wording import number, torque_units

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# At most as many samples are drawn.
MAX_DRAWN_SAMPLES = 3000
# Time in s over which errors are averaged where they are compared on a logarithmic scale
AVERAGING_TIME = 0.25


def drawings(comparison: Comparison) -> dict[str, Drawing]:
    """Figures of a comparison by name, in the order of the report."""
    captions: dict[str, tuple[str, Callable[[Comparison], Figure]]] = {
        "tracking-error": (
            f"Root mean square tracking error of all joints, averaged over {AVERAGING_TIME:g} s, one line per "
            "controller (logarithmic scale).",
            tracking_error,
        ),
        "joint-errors": (
            f"Tracking errors of all joints, {comparison.error_unit}: {_labels(comparison)}; and their "
            "ends on a scale of their own.",
            joint_errors,
        ),
        "lyapunov": (
            "Lyapunov function of the adaptive run, and its decrease in every control period. In "
            "theory it never increases.",
            lyapunov,
        ),
        "contact-force": (
            f"Force on the arm by what it touches, averaged over {1e3 * CONTACT_AVERAGING:g} ms, one line per "
            "controller (logarithmic scale).",
            contact_force,
        ),
        "torque": ("Torques of the adaptive run. Shaded: beyond the limits.", torque),
        "parameters": (
            "Estimates of the base parameters (solid), and their true values (dashed), the largest first. "
            "Shaded: the motion hardly shows them. The scales differ; units are kg, kg·m and kg·m².",
            parameters,
        ),
        "spectrum": (
            "Singular values of the energy differences. The gap determines the number of base parameters.",
            spectrum,
        ),
    }
    subject = comparison.subject
    missing = {"lyapunov"} if subject.lyapunov is None else set()
    missing |= set() if subject.is_estimating else {"parameters"}
    missing |= set() if touched(comparison) else {"contact-force"}
    shown = {name: one for name, one in captions.items() if name not in missing}
    return {
        name: Drawing(name, caption, partial(draw, comparison), plain=True) for name, (caption, draw) in shown.items()
    }


def _labels(comparison: Comparison) -> str:
    """Names of the runs whose joint errors are drawn."""
    above, below = comparison.subject, comparison.baseline
    return above.label if below is None else f"{above.label} above, {below.label} below"


def tracking_error(comparison: Comparison) -> Figure:
    """Figure of the root mean square errors of all runs over a moving window of 0.25 s."""
    figure = sheet(4.2)
    axes = figure.subplots()
    for run in reversed(comparison.runs):
        i = comparison.color_indices[run.name]
        every, foremost = thinned(len(run.rollout.time), MAX_DRAWN_SAMPLES), run is comparison.subject
        axes.semilogy(
            run.rollout.time[every],
            1e3 * run.moving_rms_error(AVERAGING_TIME)[every],
            **run_style(i),
            linewidth=2.6 if foremost else 1.5,
            label=run.label,
            zorder=3 if foremost else 2,
        )
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"RMS tracking error [{comparison.error_unit}]")
    axes.set_xlim(0.0, comparison.subject.duration)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside upper left", ncols=3)
    return figure


def contact_force(comparison: Comparison) -> Figure:
    """Figure of the contact forces of all runs that touch something."""
    figure = sheet(3.6)
    axes = figure.subplots()
    for run in touched(comparison):
        force = np.linalg.norm(contact_forces(run.rollout), axis=1)
        every = thinned(len(force), MAX_DRAWN_SAMPLES)
        shown = np.where(force > 0.0, force, np.nan)[every]
        axes.semilogy(run.rollout.time[every], shown, label=run.label, **run_style(comparison.color_indices[run.name]))
    axes.set_xlabel("time [s]")
    axes.set_ylabel("contact force [N]")
    axes.set_xlim(0.0, comparison.subject.duration)
    figure.legend(loc="outside upper left", ncols=3)
    return figure


def joint_errors(comparison: Comparison) -> Figure:
    """Figure of every joint's tracking error, with and without adaptation: whole, and its end on a scale of its own."""
    runs = [run for run in (comparison.subject, comparison.baseline) if run is not None]
    panels = 2 * len(runs) if is_narrow() else len(runs)
    figure = sheet(2.3 * panels + 0.4)
    grid = figure.subplots(panels, 1 if is_narrow() else 2, squeeze=False).reshape(len(runs), 2)
    for (whole, end), run in zip(grid, runs, strict=True):
        _errors_from(whole, comparison, run, 0.0)
        _errors_from(end, comparison, run, max(0.0, run.duration - FINAL_ERROR_TIME))
        whole.set_title(run.label)
        end.set_title(f"the last {min(FINAL_ERROR_TIME, run.duration):.2g} s")
        whole.set_ylabel(f"error [{comparison.error_unit}]")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    figure.legend(*whole.get_legend_handles_labels(), loc="outside upper right", ncols=8)
    return figure


def _errors_from(axes: Axes, comparison: Comparison, run: ControllerRun, start: float) -> None:
    """Draw a run's joint errors from a time on."""
    time = run.rollout.time
    shown = time >= start
    every = thinned(int(shown.sum()), MAX_DRAWN_SAMPLES)
    errors = 1e3 * run.rollout.error[shown][every]
    for j, name in enumerate(comparison.joint_names):
        axes.plot(time[shown][every], errors[:, j], color=joint_color(j).hex, label=name, linewidth=1.3)
    axes.set_xlim(start, run.duration if start else comparison.subject.duration)


def lyapunov(comparison: Comparison) -> Figure:
    """Figure of the subject's Lyapunov function and its fall between samples."""
    values, time = comparison.subject.lyapunov, comparison.subject.rollout.time
    if values is None:
        raise ValueError("the run has no Lyapunov function")
    figure = sheet(5.8 if is_narrow() else 2.9)
    whole, steps = figure.subplots(*((2, 1) if is_narrow() else (1, 2)))
    every = thinned(len(time), MAX_DRAWN_SAMPLES)
    whole.plot(time[every], values[every], color=run_color(0).hex, linewidth=2.2)
    whole.fill_between(time[every], values[every], color=run_color(0).hex, alpha=0.08, linewidth=0)
    whole.set_ylim(bottom=0.0)
    whole.set_title("Lyapunov function V [J]")
    falls = -np.diff(values)
    steps.semilogy(time[1:], np.where(falls > 0.0, falls, np.nan), color=run_color(0).hex, linewidth=1.0)
    rises = falls < 0.0
    if rises.any():
        label = f"increase, {np.count_nonzero(rises)} steps"
        steps.semilogy(time[1:][rises], -falls[rises], ".", color=INK.hex, markersize=3, label=label)
        steps.legend(loc="upper right")
    else:
        told = (
            "not finite in all samples"
            if comparison.subject.lyapunov_max_increase is None
            else "no step with an increase"
        )
        steps.text(0.98, 0.94, told, transform=steps.transAxes, ha="right", va="top", weight="bold")
    steps.set_title("Decrease of V per control period [J]")
    for axes in (whole, steps):
        axes.set_xlabel("time [s]")
        axes.set_xlim(0.0, comparison.subject.duration)
    return figure


def torque(comparison: Comparison) -> Figure:
    """Figure of the subject's torques, the region beyond the limits shaded."""
    rollout, dof = comparison.subject.rollout, len(comparison.joint_names)
    time = rollout.time
    figure, panels = small_multiples(dof, columns=3, height=1.75, bottom=0.48)
    units = torque_units(comparison.mechanism)
    for j, axes in enumerate(panels):
        limit, name = comparison.torque_limits[j], comparison.joint_names[j]
        axes.plot(time, rollout.applied[:, j], color=joint_color(j).hex, linewidth=1.3)
        for low, high in ((limit, 1.25 * limit), (-1.25 * limit, -limit)):
            axes.axhspan(low, high, color=LIMIT.hex, alpha=0.4, linewidth=0)
        axes.set_ylim(-1.25 * limit, 1.25 * limit)
        axes.set_xlim(0.0, comparison.subject.duration)
        share = np.abs(rollout.applied[:, j]).max() / limit
        axes.set_title(f"{name} [{units[j]}]")
        axes.text(0.985, 0.97, f"peak {100 * share:.0f} %", transform=axes.transAxes, ha="right", va="top", size=7.5)
    figure.supxlabel("time [s]", size=9)
    return figure


def parameters(comparison: Comparison) -> Figure:
    """Figure of the subject's parameter estimates, beside true values where known."""
    names, rollout, truth = comparison.model.names, comparison.subject.rollout, comparison.true_parameters
    every = thinned(len(rollout.time), MAX_DRAWN_SAMPLES // 6)
    figure, panels = small_multiples(len(names), columns=6, height=1.12, bottom=0.22)
    sizes = np.abs(np.where(np.isnan(truth), rollout.estimate[-1], truth))
    for axes, i in zip(panels, np.argsort(-sizes, kind="stable").tolist(), strict=True):
        low, high = _estimate(axes, rollout.time[every], rollout.estimate[every, i], truth[i])
        if comparison.is_open[i]:
            axes.axhspan(low, high, color=LIMIT.hex, alpha=0.4, linewidth=0)
        axes.set_title(f"{names[i]}", size=7.5, pad=3.0, y=1.0)  # to search for a place takes a third of the time
        if (ticks := getattr(axes, "yaxis", None)) is not None:  # a power of ten is opposite the title
            ticks.get_offset_text().set(x=1.0, ha="right")
        axes.set_xlim(0.0, comparison.subject.duration)
        axes.tick_params(labelsize=6.5, pad=1.5)
        axes.locator_params(nbins=3)
    return figure


def spectrum(comparison: Comparison) -> Figure:
    """Figure of the singular values of the energy differences, with the gap that decides the rank."""
    values, rank = shares(comparison.space), comparison.space.rank
    figure = sheet(3.3)
    axes = figure.subplots()
    place, floor = np.arange(1, len(values) + 1), values.min() / 10.0
    colors = [run_color(0).hex if i <= rank else MUTED.faded(0.35, PAPER).hex for i in place]
    axes.bar(place, values - floor, bottom=floor, color=colors, width=0.72)
    axes.set_yscale("log")
    axes.set_ylim(floor, 8.0)
    axes.axhline(threshold(comparison.space), color=INK.hex, linestyle=(0, (4, 3)), linewidth=1.3)
    if rank < len(values):
        ratio = number(float(values[rank - 1] / values[rank]), 2)
        text = f"{rank} of {len(values)} are above the gap, a ratio of {ratio}"
        axes.text(len(values) + 0.5, threshold(comparison.space) * 3.0, text, ha="right", color=INK.hex)
    axes.set_xlim(0.3, len(values) + 0.7)
    axes.set_xlabel("number")
    axes.set_ylabel("singular value over largest")
    axes.grid(visible=False, axis="x")
    return figure


def small_multiples(count: int, columns: int, height: float, bottom: float) -> tuple[Figure, list[Axes]]:
    """Panels in rows, the last row as long as it needs to be; half as many columns on a phone."""
    columns = -(-columns // 2) if is_narrow() else columns
    rows = -(-count // columns)
    tall = height * rows + 0.3
    figure = sheet(tall, layout=None)
    margins = {
        "left": 0.45 / FIGURE_WIDTH,
        "right": 1.0 - 0.08 / FIGURE_WIDTH,
        "bottom": bottom / tall,
        "top": 1.0 - 0.25 / tall,
    }
    gaps = {"wspace": 0.42, "hspace": 0.42}
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw=margins | gaps).ravel()
    for inner in axes[:-columns]:
        inner.tick_params(labelbottom=False)
    for unused in axes[count:]:
        unused.set_visible(False)
    return figure, list(axes[:count])


def _estimate(axes: Axes, time: Array, values: Array, truth: float) -> tuple[float, float]:
    """Draw an estimate and its true value, and return the axis' range."""
    if not np.isnan(truth):
        axes.axhline(truth, color=TRUTH.hex, linestyle=(0, (3, 2)), linewidth=1.2)
    axes.plot(time, values, color=run_color(0).hex, linewidth=1.3)
    low, high = np.nanmin([values.min(), truth, 0.0]), np.nanmax([values.max(), truth, 0.0])
    margin = 0.12 * (high - low) or 1.0
    axes.set_ylim(low - margin, high + margin)
    return low - margin, high + margin


# Values below this share of the largest are drawn as this: they are round-off, or zero.
MIN_DRAWN_RATIO = 1e-18


def shares(space: EssentialSpace) -> Array:
    """Singular values (P,) over the largest, floored at 1e-18."""
    values = np.asarray(space.singular_values)
    return np.maximum(values / values[0], MIN_DRAWN_RATIO)


def threshold(space: EssentialSpace) -> float:
    """Threshold in the gap between singular values that count and round-off."""
    values = shares(space)
    beyond = values[space.rank] if space.rank < len(values) else MIN_DRAWN_RATIO
    return float(np.sqrt(values[space.rank - 1] * beyond))
