"""How far estimates are from the truth, in the torque that the errors make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.identifiability import ReducedModel
from adaptctl.mechanism.pose import Array
from adaptctl.recording import Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLES = 400
"""of a motion, over which parameters are weighed; and of a curve"""


@dataclass(frozen=True, eq=False)
class ParameterErrors:
    """Errors of estimates, each parameter weighed by the torque it makes."""

    model: ReducedModel
    weights: Array
    """(k,) N m by unit of each parameter"""

    @classmethod
    def along(cls, model: ReducedModel, p: Array, v: Array, a: Array) -> ParameterErrors:
        """Weighed along a motion (T, r)."""
        rows = model.torque_regressor(p, v, a)
        return cls(model, np.sqrt(np.mean(rows**2, axis=(0, 1))))

    def of(self, run: Run) -> Array | None:
        """The error (T,) over a run, in shares of the torque of all parameters; None for a law that knows none."""
        if run.rollout.estimate.shape[1] == 0:
            return None
        return self._apart(self._reduced(run.rollout.estimate), self.model.fundamental_parameters)

    def apart(self, one: Array, other: Array) -> float:
        """How far two estimates (k,) are from each other, likewise."""
        return float(self._apart(self._reduced(one), self._reduced(other)))

    def _reduced(self, estimate: Array) -> Array:
        """Estimates (..., k), of all parameters or of the kept ones, as kept ones."""
        regrouping = self.model.regrouping
        return estimate @ regrouping.T if estimate.shape[-1] == regrouping.shape[1] else estimate

    def _apart(self, one: Array, other: Array) -> Array:
        weighed = np.linalg.norm((one - other) * self.weights, axis=-1)
        return np.asarray(weighed / np.linalg.norm(self.model.fundamental_parameters * self.weights))


def parameter_errors(curves: Sequence[tuple[int, Run, Array]]) -> Figure:
    """Parameter errors over time, on a logarithmic scale."""
    from matplotlib.figure import Figure

    from adaptctl.recording.drawing import DOTS, WIDTH
    from adaptctl.recording.palette import run_color
    from adaptctl.recording.series import thinned

    figure = Figure(figsize=(WIDTH, 4.2), dpi=DOTS, layout="constrained")
    axes = figure.subplots()
    for i, run, values in curves:
        every = thinned(len(values), SAMPLES)
        style = "-" if i < 5 else (0, (4, 2))
        axes.semilogy(run.rollout.time[every], values[every], color=run_color(i).hex, label=run.label, linestyle=style)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("parameter error")
    figure.legend(loc="outside upper left", ncols=4)
    return figure
