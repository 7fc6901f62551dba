"""Figures of an identification: torques, what is left of them, parameters, and what was excited."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from adaptctl.identification import Identification
from adaptctl.recording.drawing import WIDTH, Drawing, write_drawings
from adaptctl.recording.palette import MUTED, run_color
from adaptctl.recording.units import torque_error_unit, typeset

LAGS = 60
DRAWN = 3000
"""points of a curve"""


def drawings(found: Identification) -> Iterator[Drawing]:
    """Figures of an identification, each a `Drawing` with name, caption and drawing function, in the order of the
    report. They are torques measured and predicted, their residuals, errors of simpler models, and how well
    combinations of parameters are excited. Nothing is drawn, nor raised, before a drawing's function is called."""
    validation = found.validation
    yield Drawing(
        "torques",
        f"Measured and predicted torque of every joint on {validation.origin}, below {validation.cutoff:g} Hz. "
        "Predictions use the measured motion alone.",
        partial(_torques, found),
    )
    yield Drawing(
        "residuals",
        "What the prediction leaves of the measured torques: over time, and how much of it is there again some rows "
        "later. White noise would leave nothing.",
        partial(_residuals, found),
    )
    yield Drawing(
        "alternatives",
        "Root mean square error of this estimate and of simpler ones, all joints, on the same rows.",
        partial(_alternatives, found),
    )
    yield Drawing(
        "excitation",
        "How much the logs say of every combination of fundamental parameters: its prior range over the deviation "
        "that the logs leave, if residuals were white.",
        partial(_excitation, found),
    )


def write_figures(folder: str | Path, found: Identification) -> dict[str, Path]:
    """Write the figures of an identification as PNG files into an existing folder, each whole or not at all; returns
    the files' paths by the figures' names, such as "torques" for torques.png. Raises `FileError` where a file cannot be
    written."""
    return write_drawings(folder, drawings(found))


def _rows(found: Identification, columns: int, height: float) -> tuple[Figure, Any]:
    r = found.mechanism.dof
    figure = Figure(figsize=(WIDTH, height * r), layout="constrained")
    axes: Any = figure.subplots(r, columns, sharex="col", squeeze=False)
    for joint, row in zip(found.mechanism.primary_joints, axes, strict=True):
        row[0].set_title(joint.name)
        row[0].set_ylabel(typeset(joint.kind.effort_unit))
    return figure, axes


def _torques(found: Identification) -> Figure:
    figure, axes = _rows(found, 1, 1.25)
    v = found.validation
    every = slice(None, None, max(1, len(v.time) // DRAWN))
    for j, (ax,) in enumerate(axes):
        ax.plot(v.time[every], v.measured[every, j], ".", color=MUTED.hex, markersize=2.5, label="measured")
        ax.plot(v.time[every], v.predicted[every, j], color=run_color(0).hex, linewidth=1.2, label="predicted")
    axes[0][0].legend(loc="upper right", ncols=2)
    axes[-1][0].set_xlabel("time in the log, s")
    return figure


def _residuals(found: Identification) -> Figure:
    figure, axes = _rows(found, 2, 1.1)
    v = found.validation
    correlation = v.autocorrelation(LAGS)
    every = slice(None, None, max(1, len(v.time) // DRAWN))
    for j, (over_time, over_lags) in enumerate(axes):
        over_time.plot(v.time[every], v.error[every, j], color=run_color(0).hex, linewidth=0.9)
        over_lags.bar(np.arange(len(correlation)), correlation[:, j], color=run_color(0).hex, width=0.8)
        over_lags.set_ylim(-0.5, 1.05)
    axes[-1][0].set_xlabel("time in the log, s")
    axes[-1][1].set_xlabel("rows later")
    return figure


def _alternatives(found: Identification) -> Figure:
    named = {"this estimate": found.validation, **found.alternatives}
    figure = Figure(figsize=(WIDTH, 0.42 * len(named) + 0.5), layout="constrained")
    ax: Any = figure.subplots()
    values = [other.rms_error for other in named.values()]
    colors = [run_color(0).hex] + [MUTED.hex] * (len(named) - 1)
    bars = ax.barh(list(named), values, color=colors, height=0.6)
    unit = torque_error_unit(found.mechanism)
    ax.bar_label(bars, [f"{v.rms_error:.3g} {unit}, {v.relative_error:.1%}" for v in named.values()], padding=3)
    ax.set_xlim(0.0, 1.35 * max(values))
    ax.invert_yaxis()
    return figure


def _excitation(found: Identification) -> Figure:
    figure = Figure(figsize=(WIDTH, 2.4), layout="constrained")
    ax: Any = figure.subplots()
    strengths = np.maximum([c.strength for c in found.combinations][::-1], 1e-6)
    ax.semilogy(np.arange(1, len(strengths) + 1), strengths, ".", color=run_color(0).hex)
    ax.set_xlabel("combination, by how well it is excited")
    return figure
