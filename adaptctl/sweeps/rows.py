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
from adaptctl.errors import AdaptctlError, NotCompiledWarning, PhysicalConsistencyWarning, SimplificationWarning
from adaptctl.experiments import find
from adaptctl.experiments.experiment import CheckedSettings, Experiment
from adaptctl.recording import Comparison, ControllerRun
from adaptctl.sweeps.batch import FAILURES, RunOutcome, batched, named
from adaptctl.version import __version__

Row = dict[str, Any]
TIMES = ("wall_time", "host")
"""Columns that differ from one computer, and one time, to another."""
OUTCOME = {
    "status": ("string", "done, diverged, or failed"),
    "reason": ("string", "why, where it is not done"),
    "rms_error": ("double", "root mean square of the errors of all joints, rad or m; until it diverged"),
    "rms_error_last": ("double", "the same over the last two seconds, rad or m; None of shorter runs"),
    "largest_error": ("double", "of any joint, rad or m"),
    "diverged_at": ("double", "s"),
    "diverged_joint": ("int64", "from 1"),
    "lyapunov_rise": ("double", "largest rise of the Lyapunov function from one sample to the next, J"),
}
"""Kind and meaning of an outcome's columns."""
ABOUT = {
    "version": ("string", "of adaptctl"),
    "wall_time": ("double", "s a run, with all that ran with it"),
    "host": ("string", "computer"),
}


def rows_of(
    experiment: str,
    runs: Sequence[Mapping[str, Any]],
    controllers: Sequence[str] = (),
    precision: Precision = "double",
) -> list[Row]:
    """Rows of the `runs` of an `experiment`, given by its name, in the runs' order: one mapping by column for each run
    and controller. Columns are the settings by name, `controller`, the fields of `RunOutcome` (status, reason, position
    errors, divergence, rise of the Lyapunov function), `version` of adaptctl, `wall_time`, s a run, and `host`, the
    computer's name. Each of `runs` maps names of settings to values; others have their defaults.

    `controllers` has the names of the controllers that run, all where empty; `precision`, "double" by default or
    "single", is that of runs that are simulated together in native code. A run that raises an `AdaptctlError`, an
    `ArithmeticError` or NumPy's `LinAlgError` is a row of status "failed" with its reason. Raises `NotFoundError` for
    an unknown experiment, `TypeError` for a setting that it does not have.
    """
    kind, started = find(experiment), time.perf_counter()
    with warnings.catch_warnings():
        for category in (PhysicalConsistencyWarning, SimplificationWarning, NotCompiledWarning):
            warnings.simplefilter("ignore", category)  # an experiment by itself tells them, and not a thousand times
        made = [_made(kind, settings) for settings in runs]
        found = _outcomes([one for one in made if not isinstance(one, str)], controllers, precision)
    wall_time = (time.perf_counter() - started) / max(1, len(runs))
    about = {"version": __version__, "wall_time": wall_time, "host": platform.node()}
    defaults = {entry.name: _plain(entry.default) for entry in fields(kind)}
    left, rows = iter(found), list[Row]()
    for one, run in zip(made, runs, strict=True):
        outcomes = [("", RunOutcome.failed(one))] if isinstance(one, str) else next(left)
        known = run if isinstance(one, str) else {name: getattr(one, name) for name in defaults}
        settings = defaults | {name: _plain(value) for name, value in known.items()}
        rows += [settings | {"controller": name} | outcome._asdict() | about for name, outcome in outcomes]
    return rows


def columns_of(kind: type[CheckedSettings]) -> dict[str, tuple[str, str]]:
    """Columns of a sweep's table, in order: a mapping from a column's name to its type, "int64", "double", "bool" or
    "string", and its meaning in words, with the unit. They are the settings of the experiment of class `kind`,
    `controller`, the fields of `RunOutcome`, `version`, `wall_time` and `host`. Nothing is raised."""
    settings = {entry.name: (_kind(entry.default), entry.metadata["meaning"]) for entry in fields(kind)}
    return settings | {"controller": ("string", "the controller compared")} | OUTCOME | ABOUT


def alone(experiment: Experiment, controllers: Sequence[str]) -> list[tuple[str, RunOutcome]]:
    """Outcomes of an `experiment` that runs by itself, not with others: pairs of a controller's name and its
    `RunOutcome`, for the controllers named in `controllers`, all where it is empty. Where the experiment compares no
    controllers, or an `AdaptctlError`, an `ArithmeticError` or NumPy's `LinAlgError` is raised, such as `NotFoundError`
    for a name that none of its controllers has, there is one outcome "failed" with the reason and the empty name ""."""
    compare: Callable[..., Comparison] | None = getattr(experiment, "compare", None)
    if compare is None:
        return [("", RunOutcome.failed(f"{experiment.name} compares no controllers, so that it has no rows"))]
    try:
        chosen = named(compare(lambda what, share: None).runs, controllers)
    except FAILURES as error:
        return [("", RunOutcome.failed(error))]
    return [(run.name, _outcome(run)) for run in chosen]


def _made(kind: type[Experiment], settings: Mapping[str, Any]) -> Experiment | str:
    """The experiment with its settings, or why it cannot be."""
    try:
        return kind(**settings)
    except AdaptctlError as error:
        return str(error)


def _outcomes(
    chosen: Sequence[Experiment], controllers: Sequence[str], precision: Precision
) -> list[list[tuple[str, RunOutcome]]]:
    """Outcomes of each run, each with the controller's name."""
    together = batched(chosen, controllers, precision)
    return [together[k] if k in together else alone(one, controllers) for k, one in enumerate(chosen)]


def _outcome(run: ControllerRun) -> RunOutcome:
    """Outcome of a run that was recorded."""
    error, gone = np.abs(run.rollout.error), run.rollout.terminated
    return RunOutcome(
        status="diverged" if gone else "done",
        reason="the environment ended the run" if gone else "",
        rms_error=run.rms_error(),
        rms_error_last=None if gone else run.final_rms_error,
        largest_error=float(error.max()) if error.size else None,
        diverged_at=run.duration if gone else None,
        diverged_joint=int(error[-1].argmax()) + 1 if gone and len(error) else None,
        lyapunov_rise=run.lyapunov_max_increase,
    )


def _plain(value: Any) -> Any:
    return " ".join(map(str, value)) if isinstance(value, tuple) else value


def _kind(default: Any) -> str:
    return {int: "int64", float: "double", bool: "bool"}.get(type(default), "string")
