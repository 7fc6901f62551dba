"""A run drawn: positions on the reference, errors, torques, estimates."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.lyapunov import LearningRun, SampledRun
from adaptctl.simulation.rollout_file import joint_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_SAMPLES = 4000
"""as many a curve are drawn at most"""
LAST = 2.0
"""s at the end over which an error is averaged"""


class DrawnRun(LearningRun, SampledRun, Protocol):
    """Protocol of a closed-loop run that can be drawn, such as a `Rollout`: T samples of r joints, their reference and
    k parameter estimates, and how the run ended. An implementation has, besides the properties here, positions `p`,
    velocities `v`, `reference_p`, `reference_v` and `reference_a`, (T, r) each, in rad, rad/s and rad/s^2 (m, m/s and
    m/s^2 if prismatic), `estimate` (T, k), SI units, and `control_period`, s."""

    @property
    def time(self) -> Array:
        """Times (T,) of the T samples, s, in ascending order."""
        ...

    @property
    def applied(self) -> Array:
        """Torques (T, r), N m (N for a prismatic joint), that drove the r joints in the T control periods sampled,
        those that began at the times of the property `time`."""
        ...

    @property
    def error(self) -> Array:
        """Tracking errors (T, r) of r joints at the T samples, rad (m if prismatic): positions less the reference's."""
        ...

    @property
    def complete(self) -> bool:
        """True if the run went to its end; False when it was cut off."""
        ...

    @property
    def terminated(self) -> bool:
        """True when a tracking error beyond the environment's bound ended the run early, else False."""
        ...


def run_figure(run: DrawnRun, joints: Sequence[str] | None = None) -> Figure:
    """A Matplotlib figure of a `run` of r joints over time (s): positions (rad or m) with the reference dotted,
    tracking errors (mrad or mm), applied torques (N m or N), and parameter estimates (SI units) if there are any. At
    most MOST_SAMPLES (4000) samples of a curve are drawn.

    `joints` (r,) names the curves in the legend, None for joint1, joint2, ... Raises `InputError` for other than r
    different names, `ModuleNotFoundError` without matplotlib.
    """
    from matplotlib.figure import Figure

    names = joint_names(run.p.shape[1], joints)
    panels = 4 if run.estimate.shape[1] else 3
    figure = Figure(figsize=(8.0, 1.9 * panels), layout="constrained")
    axes = figure.subplots(panels, 1, sharex=True)
    every = slice(None, None, max(1, -(-len(run.time) // MOST_SAMPLES)))
    _curves(axes[0], run.time[every], run.p[every], "position [rad or m]")
    axes[0].set_prop_cycle(None)
    axes[0].plot(run.time[every], run.reference_p[every], linestyle=":", linewidth=1.0)
    axes[0].set_title("positions, and dotted the reference", size=9)
    _curves(axes[1], run.time[every], 1e3 * run.error[every], "error [mrad or mm]")
    _curves(axes[2], run.time[every], run.applied[every], "torque [N m or N]")
    if panels == 4:
        _curves(axes[3], run.time[every], run.estimate[every], "estimates")
    axes[-1].set_xlabel("time [s]")
    figure.legend(axes[1].lines, names, loc="outside right upper", fontsize=8)
    return figure


def _curves(axes: Axes, time: Array, values: Array, label: str) -> None:
    axes.plot(time, values, linewidth=1.2)
    axes.set_ylabel(label, size=8)
    axes.grid(alpha=0.3)
    axes.tick_params(labelsize=8)


def run_html(run: DrawnRun) -> str:
    """HTML, as text for a notebook, of a closed-loop `run` such as a `Rollout`: a line of text and the figure of
    `run_figure` as a PNG image, left out where there are no samples. The line has the number of samples, the control
    period, the number of joints, how the run ended (to the end, stopped by an error or cut off) and the root mean
    square of the tracking errors over all joints and the last LAST (2) s, mrad (mm if prismatic). Raises
    `ModuleNotFoundError` without matplotlib, where there are samples."""
    last = run.error[run.time >= run.time[-1] - LAST] if len(run.time) else run.error
    rms = 1e3 * float(np.sqrt(np.mean(last**2))) if last.size else float("nan")
    end = (
        "to the end" if run.complete and not run.terminated else "stopped by an error" if run.terminated else "cut off"
    )
    text = f"{len(run.time):,} control periods of {run.control_period:g} s, {run.p.shape[1]} joints; {end}; "
    head = f"<p><b>Rollout</b> {text}RMS error over the last {LAST:g} s: {rms:.3g} mrad (mm)</p>"
    if not len(run.time):
        return head
    buffer = io.BytesIO()
    run_figure(run).savefig(buffer, format="png", dpi=80)
    picture = base64.b64encode(buffer.getvalue()).decode()
    return (
        f'{head}<img alt="positions, errors, torques and estimates over time" src="data:image/png;base64,{picture}"/>'
    )
