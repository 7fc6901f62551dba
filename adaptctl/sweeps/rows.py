"""Rows of a sweep: one for each run and compared controller, and how they are computed."""

from __future__ import annotations

import platform
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from adaptctl.compilation.lanes import Precision
from adaptctl.errors import (
    AdaptctlError,
    NotCompiledWarning,
    PhysicalConsistencyWarning,
    SimplificationWarning,
)
from adaptctl.experiments.experiment import CheckedSettings, Experiment
from adaptctl.recording import Comparison, ControllerRun
from adaptctl.sweeps.batch import batched, named
from adaptctl.sweeps.measurement import SweepMeasurement, kind_of
from adaptctl.sweeps.outcome import FAILURES, OUTCOME, RunOutcome
from adaptctl.version import __version__

Row = dict[str, Any]
Named = tuple[str, RunOutcome]
TIMES = ("wall_time", "host")
"""Columns that differ from one computer, and one time, to another."""


def rows_of(
    experiment: str,
    runs: Sequence[Mapping[str, Any]],
    controllers: Sequence[str] = (),
    precision: Precision = "double",
) -> list[Row]:
    """Rows of the `runs` of an `experiment` or measurement, given by its name, in the runs' order: one mapping by
    column for each run and controller. Columns are the settings by name, `controller`, the fields of `RunOutcome`
    (status, reason, position errors, divergence, rise of the Lyapunov function), `version` of adaptctl, `wall_time`, s
    a run, and `host`, the computer's name. Each of `runs` maps names of settings to values; others have their defaults.

    `controllers` has the names of the controllers that run, all where empty; `precision`, "double" by default or
    "single", is that of runs that are simulated together in native code. A run that raises an `AdaptctlError`, an
    `ArithmeticError` or NumPy's `LinAlgError` is a row of status "failed" with its reason. Raises `NotFoundError` for
    an unknown experiment, `TypeError` for a setting that it does not have.
    """
    with warnings.catch_warnings():
        for category in (PhysicalConsistencyWarning, SimplificationWarning, NotCompiledWarning):
            warnings.simplefilter("ignore", category)  # an experiment by itself tells them, and not a thousand times
        return _rows(experiment, runs, controllers, precision)


def _rows(
    experiment: str, runs: Sequence[Mapping[str, Any]], controllers: Sequence[str], precision: Precision
) -> list[Row]:
    kind, started = kind_of(experiment), time.perf_counter()
    made: list[CheckedSettings | str] = [_checked(kind, settings) for settings in runs]
    valid = {k: one for k, one in enumerate(made) if isinstance(one, CheckedSettings)}
    found = dict(zip(valid, _outcomes(kind, list(valid.values()), controllers, precision), strict=True))
    about = {
        "version": __version__,
        "wall_time": (time.perf_counter() - started) / max(1, len(runs)),
        "host": platform.node(),
    }
    defaults = {entry.name: _plain(entry.default) for entry in fields(kind)}
    rows: list[Row] = []
    for k, one in enumerate(made):
        outcomes = [("", RunOutcome.failed(one))] if isinstance(one, str) else found[k]
        settings = defaults | {name: _plain(value) for name, value in runs[k].items()}
        rows += [settings | {"controller": name} | outcome._asdict() | about for name, outcome in outcomes]
    return rows


def _outcomes(
    kind: type[CheckedSettings], chosen: Sequence[Any], controllers: Sequence[str], precision: Precision
) -> list[list[Named]]:
    """Outcomes of each run, each with the controller's name."""
    if issubclass(kind, SweepMeasurement):
        return [[("", outcome)] for outcome in kind.outcomes(chosen)]
    together = batched(chosen, controllers, precision)
    return [together[k] if k in together else alone(one, controllers) for k, one in enumerate(chosen)]


def columns_of(kind: type[CheckedSettings]) -> dict[str, tuple[str, str]]:
    """Columns of a sweep's table, in order: a mapping from a column's name to its type, "int64", "double", "bool" or
    "string", and its meaning in words, with the unit. They are the settings of the experiment or measurement of class
    `kind`, `controller`, the fields of `RunOutcome` (status, reason, position errors, divergence, rise of the Lyapunov
    function), `version`, `wall_time` and `host`. Nothing is raised."""
    settings = {entry.name: (_kind(entry.default), entry.metadata["meaning"]) for entry in fields(kind)}
    about = {
        "version": ("string", "of adaptctl"),
        "wall_time": ("double", "s a run, with all that ran with it"),
        "host": ("string", "computer"),
    }
    return settings | {"controller": ("string", "the controller compared")} | OUTCOME | about


def _checked(kind: type[CheckedSettings], settings: Mapping[str, Any]) -> CheckedSettings | str:
    try:
        return kind(**settings)
    except AdaptctlError as error:
        return str(error)


def alone(experiment: Experiment, controllers: Sequence[str]) -> list[Named]:
    """Outcomes of an `experiment` that runs by itself, not with others: pairs of a controller's name and its
    `RunOutcome`, for the controllers named in `controllers`, all where it is empty. Where the experiment compares no
    controllers, or an `AdaptctlError`, an `ArithmeticError` or NumPy's `LinAlgError` is raised, such as `NotFoundError`
    for a name that none of its controllers has, there is one outcome "failed" with the reason and the empty name ""."""
    try:
        compare: Callable[..., Comparison] | None = getattr(experiment, "compare", None)
        if compare is None:
            return [("", RunOutcome.failed(f"{experiment.name} compares no controllers, so that it has no rows"))]
        comparison = compare(lambda what, share: None)
        chosen = named(comparison.runs, controllers)
    except FAILURES as error:
        return [("", RunOutcome.failed(error))]
    return [(run.name, _outcome(run)) for run in chosen]


def _outcome(run: ControllerRun) -> RunOutcome:
    """Outcome of a run that was recorded."""
    error = np.abs(run.rollout.error)
    joint = int(error[-1].argmax()) if run.rollout.terminated and len(error) else -1
    return RunOutcome(
        status="diverged" if run.rollout.terminated else "done",
        reason="the environment ended the run" if run.rollout.terminated else "",
        rms_error=run.rms_error(),
        rms_error_last=None if run.rollout.terminated else run.final_rms_error,
        largest_error=float(error.max()) if error.size else None,
        diverged_at=run.duration if run.rollout.terminated else None,
        diverged_joint=joint + 1 if joint >= 0 else None,
        lyapunov_rise=run.lyapunov_max_increase,
    )


def _plain(value: Any) -> Any:
    return " ".join(map(str, value)) if isinstance(value, tuple) else value


def _kind(default: Any) -> str:
    return {int: "int64", float: "double", bool: "bool"}.get(type(default), "string")
