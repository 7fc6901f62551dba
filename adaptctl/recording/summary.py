"""Summary of a comparison as JSON: what was run, and the numbers that matter."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from adaptctl.files import finite_or_none, write_json
from adaptctl.recording.comparison import Comparison, ControllerRun
from adaptctl.recording.judgement import judged

SCHEMA = "adaptctl/summary/1"


def write_summary(path: str | Path, comparison: Comparison) -> None:
    """Write the summary of a `comparison` of runs, as the function `summary` makes it, to the file `path` as JSON,
    whole or not at all. Raises `FileError` where it cannot be written, `InputError` for parameter estimates with
    the basis of another mechanism."""
    write_json(path, summary(comparison))


def summary(comparison: Comparison) -> dict[str, Any]:
    """Summary of a `comparison` of runs, a dict in JSON's types, SI units and rad. A number is None where it is not
    known or was not measured, and where it is NaN or infinite, as of a run that diverged.

    `experiment`, `robot`, `robot_sha256`, `seed` and `complete`, False where it was interrupted, say what was run;
    `verdict` has the failures, `findings` and `settings` what the experiment states; `parameters` maps names to the
    `true` value and the last `estimate`, `truth_known` tells whether the former is, and `rank` is the number of
    independent inertial parameters. `runs` has label, end, errors and cost of every run, by name.

    Further numbers are of the first run: `duration`, the one asked for, `duration_run`, the one run, `control_period`,
    and `wall_time`, the time that computing took, s, and `realtime_factor`, simulated seconds in one of computing;
    `rms_error`, the root mean square of the position errors (rad, m) of all joints and samples, `first_rms_error` over
    the first second, `final_rms_error` over the last two, `final_rms_error_adaptation_off` that of the run with
    adaptation off; `lyapunov_initial`, `lyapunov_final` and `lyapunov_max_increase`, J; `peak_torque_share`, the
    largest ratio of a torque to its limit; `clipped_steps`, samples with a torque that was clipped or at its limit.
    Raises `InputError` for parameter estimates with the basis of another mechanism, `ValueError` for a first run of
    another number of joints than there are torque limits.
    """
    subject, baseline = comparison.subject, comparison.baseline
    lyapunov = subject.lyapunov if subject.lyapunov is not None and len(subject.lyapunov) else (None,)
    return {
        "schema": SCHEMA,
        "complete": comparison.complete,
        "verdict": judged(comparison).as_builtins(),
        "experiment": comparison.experiment,
        "robot": comparison.mechanism.name,
        "robot_sha256": comparison.mechanism.description.sha256,
        "seed": comparison.seed,
        "duration": comparison.duration,
        "duration_run": subject.duration,
        "control_period": subject.rollout.control_period,
        **_errors(subject),
        "final_rms_error_adaptation_off": finite_or_none(baseline.final_rms_error) if baseline else None,
        "lyapunov_initial": finite_or_none(lyapunov[0]),
        "lyapunov_final": finite_or_none(lyapunov[-1]),
        "lyapunov_max_increase": subject.lyapunov_max_increase,
        "peak_torque_share": finite_or_none(comparison.peak_torque_shares.max()),
        "clipped_steps": comparison.limited_steps(subject),
        "truth_known": comparison.truth_known,
        "rank": comparison.space.rank,
        "parameters": _parameters(comparison),
        "runs": {run.name: _run(run, comparison) for run in comparison.runs},
        "findings": {one.name: {"value": finite_or_none(one.value), "unit": one.unit} for one in comparison.findings},
        "settings": {setting.name: setting.value for setting in comparison.settings},
        "wall_time": subject.rollout.wall_time,
        "realtime_factor": subject.realtime_factor,
    }


def _parameters(comparison: Comparison) -> dict[str, dict[str, float | None]]:
    final = comparison.subject.rollout.estimate[-1]
    if not len(final):
        return {}
    rows = zip(comparison.model.names, comparison.true_parameters, final, strict=True)
    known = comparison.truth_known
    return {
        name: {"true": float(true) if known else None, "estimate": finite_or_none(found)} for name, true, found in rows
    }


def _errors(run: ControllerRun) -> dict[str, float | None]:
    errors = {
        "rms_error": run.rms_error(),
        "first_rms_error": run.first_rms_error,
        "final_rms_error": run.final_rms_error,
    }
    return {name: finite_or_none(error) for name, error in errors.items()}


def _run(run: ControllerRun, comparison: Comparison) -> dict[str, Any]:
    return {
        "label": run.label,
        "complete": run.rollout.complete,
        "terminated": run.rollout.terminated,
        "duration": run.duration,
        **_errors(run),
        "clipped_steps": comparison.limited_steps(run),
        "lyapunov_max_increase": run.lyapunov_max_increase,
        "tick": asdict(run.cost) if run.cost else None,
        "wall_time": run.rollout.wall_time,
    }
