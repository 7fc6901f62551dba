"""Parameter errors of runs, weighed by the torque that they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identifiability import ReducedModel
from adaptctl.recording import ControllerRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SAMPLES = 400
"""of a motion, over which parameters are weighed; and of a curve"""
NAME_HEIGHT = 0.062
"""of a curve's name, in heights of the axes"""


@dataclass(frozen=True, eq=False)
class ParameterErrors:
    """Measure of the errors of estimates of the k parameters of a reduced `model`: each error is weighed by the root
    mean square torque that one SI unit of its parameter makes along a motion, over the motion's samples and all joints.
    `weights` (k,) are in N m for each SI unit of the parameter. Nothing is checked at construction."""

    model: ReducedModel
    weights: Array
    """(k,) N m by unit of each parameter"""

    @classmethod
    def along(cls, model: ReducedModel, p: Array, v: Array, a: Array) -> ParameterErrors:
        """Measure of estimates' errors, a `ParameterErrors`, weighed along a motion: by each parameter's root mean
        square torque, N m a unit, over all joints and T samples. The motion of the r joints of a reduced `model` is
        given by positions `p`, rad (m if prismatic), velocities `v`, rad/s (m/s), and accelerations `a`, rad/s^2
        (m/s^2), (T, r) each. Raises `InputError` for other shapes, `NonFiniteError` for NaN or infinity."""
        rows = model.torque_regressor(p, v, a)
        return cls(model, np.sqrt(np.mean(rows**2, axis=(0, 1))))

    def of(self, run: ControllerRun) -> Array | None:
        """Parameter error (T,) of a `run` at its T samples, |w (estimate - true)| / |w true| (no unit), w (k,) being
        this object's `weights` of the model's k parameters; None for a run whose controller has no estimate. Estimates
        of all P parameters are regrouped into the k first. Raises `ValueError` for estimates of another number of
        parameters than k or P."""
        if run.rollout.estimate.shape[1] == 0:
            return None
        return self._apart(self._reduced(run.rollout.estimate), self.model.fundamental_parameters)

    def apart(self, one: Array, other: Array) -> float:
        """Distance |w (one - other)| / |w true| (no unit) between two estimates, `one` and `other`, (k,) each in SI
        units, w (k,) being this object's `weights` of the model's k parameters. Estimates (P,) of all parameters are
        regrouped into the k first. Raises `ValueError` for another number of parameters."""
        return float(self._apart(self._reduced(one), self._reduced(other)))

    def _reduced(self, estimate: Array) -> Array:
        """Estimates (..., k), of all parameters or of the kept ones, as kept ones."""
        regrouping = self.model.regrouping
        return estimate @ regrouping.T if estimate.shape[-1] == regrouping.shape[1] else estimate

    def _apart(self, one: Array, other: Array) -> Array:
        weighed = np.linalg.norm((one - other) * self.weights, axis=-1)
        return np.asarray(weighed / np.linalg.norm(self.model.fundamental_parameters * self.weights))


def parameter_errors(curves: Sequence[tuple[int, ControllerRun, Array]]) -> Figure:
    """Matplotlib figure of parameter errors (no unit, logarithmic) over time, s, a line for each of `curves`, at least
    one: triples of the colour's index from 0 in the palette, the run, and its errors (T,) at T samples. Each line's
    label and last value are written at its end. Nothing is checked."""
    from adaptctl.recording.drawing import run_color, sheet, thinned

    figure = sheet(4.2)
    axes = figure.subplots()
    for i, run, values in curves:
        every = thinned(len(values), SAMPLES)
        style = "-" if i < 5 else (0, (4, 2))
        axes.semilogy(run.rollout.time[every], values[every], color=run_color(i).hex, linestyle=style)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("parameter error")
    axes.margins(x=0.01)
    _name_ends(axes, curves)
    return figure


def _name_ends(axes: Axes, curves: Sequence[tuple[int, ControllerRun, Array]]) -> None:
    """Names to the right of where curves end, moved apart where they would overlap."""
    from adaptctl.recording.drawing import run_color

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
