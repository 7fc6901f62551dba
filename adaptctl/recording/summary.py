"""Summary of a comparison as JSON: what was run, and the numbers that matter."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from adaptctl.files import write_json
from adaptctl.recording.comparison import Comparison, ControllerRun
from adaptctl.recording.judgement import judged

SCHEMA = "adaptctl/summary/1"


def write_summary(path: str | Path, comparison: Comparison) -> None:
    """Write `summary` as JSON, whole or not at all. Raises FileError where it cannot be written."""
    write_json(path, summary(comparison))


def summary(comparison: Comparison) -> dict[str, Any]:
    """Summary in JSON's types: what was run and how it went; SI units and radians, null for what was not run.

    `rms_error` is the root mean square over all joints and all control periods of the adaptive run,
    `final_rms_error` over the last two seconds, where there are two. `clipped_steps` counts the control periods with a
    torque that was clipped or at its limit.
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
        "rms_error": subject.rms_error(),
        "first_rms_error": subject.first_rms_error,
        "final_rms_error": subject.final_rms_error,
        "final_rms_error_adaptation_off": baseline.final_rms_error if baseline else None,
        "lyapunov_initial": lyapunov[0],
        "lyapunov_final": lyapunov[-1],
        "lyapunov_max_increase": subject.lyapunov_max_increase,
        "peak_torque_share": float(comparison.peak_torque_shares.max()),
        "clipped_steps": comparison.limited_steps(subject),
        "truth_known": comparison.truth_known,
        "rank": comparison.space.rank,
        "parameters": _parameters(comparison),
        "runs": {run.name: _run(run, comparison) for run in comparison.runs},
        "findings": {finding.name: {"value": finding.value, "unit": finding.unit} for finding in comparison.findings},
        "settings": {setting.name: setting.value for setting in comparison.settings},
        "wall_time": subject.rollout.wall_time,
        "realtime_factor": realtime_factor(subject),
    }


def realtime_factor(run: ControllerRun) -> float | None:
    """Simulated seconds in a second of computing; None where that is not known."""
    return run.duration / run.rollout.wall_time if run.rollout.wall_time > 0.0 else None


def _parameters(comparison: Comparison) -> dict[str, dict[str, float | None]]:
    final = comparison.subject.rollout.estimate[-1]
    if not len(final):
        return {}
    rows = zip(comparison.model.names, comparison.true_parameters, final, strict=True)
    known = comparison.truth_known
    return {name: {"true": float(true) if known else None, "estimate": float(found)} for name, true, found in rows}


def _run(run: ControllerRun, comparison: Comparison) -> dict[str, Any]:
    return {
        "label": run.label,
        "complete": run.rollout.complete,
        "terminated": run.rollout.terminated,
        "duration": run.duration,
        "rms_error": run.rms_error(),
        "first_rms_error": run.first_rms_error,
        "final_rms_error": run.final_rms_error,
        "clipped_steps": comparison.limited_steps(run),
        "lyapunov_max_increase": run.lyapunov_max_increase,
        "tick": asdict(run.cost) if run.cost else None,
        "wall_time": run.rollout.wall_time,
    }
