"""Finite part of a comparison: what can be drawn of runs that diverged out of numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from adaptctl.recording.comparison import Comparison, ControllerRun


def finite_part(comparison: Comparison) -> Comparison:
    """The `comparison` with each of its runs cut off before the first sample at which a position, velocity, torque or
    parameter estimate is NaN or infinite; a run keeps at least its first sample. It is the comparison itself where all
    are finite. Nothing is raised."""
    counts = {run.name: _finite_samples(run) for run in comparison.runs}
    if all(counts[run.name] == len(run.rollout.time) for run in comparison.runs):
        return comparison
    leading = comparison.leading
    if leading is not None:
        leading = replace(leading, errors={name: leading.errors[name][:count] for name, count in counts.items()})
    runs = tuple(_beginning(run, counts[run.name]) for run in comparison.runs)
    return replace(comparison, runs=runs, leading=leading)


def _finite_samples(run: ControllerRun) -> int:
    """Number of a run's samples before the first that is not finite, at least 1."""
    rollout = run.rollout
    arrays = (rollout.p, rollout.v, rollout.torque, rollout.applied, rollout.estimate)
    holes = np.flatnonzero(~np.isfinite(np.concatenate(arrays, axis=1)).all(axis=1))
    return max(1, int(holes[0])) if len(holes) else len(rollout.time)


def _beginning(run: ControllerRun, count: int) -> ControllerRun:
    """A run's first samples, so many of them."""
    rollout = run.rollout
    arrays: dict[str, Any] = {name: x[:count] for name, x in vars(rollout).items() if isinstance(x, np.ndarray)}
    marks = {name: values[:count] for name, values in rollout.marks.items()}
    lyapunov = None if run.lyapunov is None else run.lyapunov[:count]
    return replace(run, rollout=replace(rollout, **arrays, marks=marks), lyapunov=lyapunov)
