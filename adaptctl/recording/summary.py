"""Summary of a comparison."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from adaptctl.files import finite_or_none, hashed
from adaptctl.recording.comparison import Comparison
from adaptctl.recording.controller_run import ControllerRun
from adaptctl.recording.judgement import judged
from adaptctl.recording.touches import touches
from adaptctl.version import __version__

SCHEMA, CHECKSUM = "adaptctl/summary/4", "sha256"
OF_RUNS = ("law", "prior_knowledge", "first_rms_error", "final_rms_error")
VARYING = ("schema", "wall_time", "realtime_factor")  # not in recordings, so that equal runs give equal ones


def summary(comparison: Comparison) -> dict[str, Any]:
    """Summary of a comparison in JSON's types, SI units and rad."""
    subject, baseline = comparison.subject, comparison.baseline
    lyapunov = subject.lyapunov if subject.lyapunov is not None and len(subject.lyapunov) else (None,)
    return {
        "schema": SCHEMA,
        "version": __version__,
        "complete": comparison.complete,
        "verdict": judged(comparison).as_builtins(),
        "experiment": comparison.experiment,
        "robot": comparison.mechanism.name,
        "robot_sha256": comparison.mechanism.description.sha256,
        "law": subject.law,
        "seed": comparison.seed,
        "duration": comparison.duration,
        "duration_run": subject.duration,
        "control_period": subject.rollout.control_period,
        **_errors(subject),
        "first_rms_error_adaptation_off": finite_or_none(baseline.first_rms_error) if baseline else None,
        "final_rms_error_adaptation_off": finite_or_none(baseline.final_rms_error) if baseline else None,
        "lyapunov_initial": finite_or_none(lyapunov[0]),
        "lyapunov_final": finite_or_none(lyapunov[-1]),
        "lyapunov_max_increase": subject.lyapunov_max_increase,
        "peak_torque_share": finite_or_none(comparison.peak_torque_shares.max()),
        "clipped_steps": comparison.limited_steps(subject),
        "truth_known": comparison.truth_known,
        "rank": comparison.space.rank,
        "parameters": _estimated(comparison),
        "runs": {run.name: _run(run, comparison) for run in comparison.runs},
        "findings": {one.name: {"value": finite_or_none(one.value), "unit": one.unit} for one in comparison.findings},
        "settings": {setting.name: setting.value for setting in comparison.settings},
        "wall_time": subject.rollout.wall_time,
        "realtime_factor": subject.realtime_factor,
    }


def sealed(content: Mapping[str, Any]) -> dict[str, Any]:
    """Content of summary.json with a hash of all that it says."""
    plain = {name: value for name, value in content.items() if name != CHECKSUM}
    return plain | {CHECKSUM: hashed(plain)}


def properties(comparison: Comparison) -> dict[str, str | float | bool | list[Any]]:
    """Numbers and texts of the summary that a recording carries; settings as JSON, each controller's in lists."""
    content = summary(comparison)
    faults, settings = content["verdict"]["faults"], json.dumps(content["settings"], ensure_ascii=False)
    plain = {name: x for name, x in content.items() if isinstance(x, str | float | bool | int) and name not in VARYING}
    told = {"passed": content["verdict"]["passed"], "faults": "; ".join(one["sentence"] for one in faults)}
    runs = {f"runs_{name}": [_listed(run[name]) for run in content["runs"].values()] for name in OF_RUNS}
    return plain | told | {"settings": settings, "runs": list(content["runs"])} | runs


def _listed(value: str | float | None) -> str | float:
    """Value of a list in a recording, which has no null."""
    return math.nan if value is None else value


def _estimated(comparison: Comparison) -> dict[str, dict[str, float | None]]:
    rows = zip(
        comparison.model.names, comparison.true_parameters, comparison.subject.rollout.estimate[-1], strict=False
    )
    return {name: {"true": finite_or_none(true), "estimate": finite_or_none(found)} for name, true, found in rows}


def _errors(run: ControllerRun) -> dict[str, float | None]:
    errors = run.rms_error(), run.first_rms_error, run.final_rms_error
    return dict(zip(("rms_error", "first_rms_error", "final_rms_error"), map(finite_or_none, errors), strict=True))


def _run(run: ControllerRun, comparison: Comparison) -> dict[str, Any]:
    return {
        "label": run.label,
        "law": run.law,
        "prior_knowledge": run.prior_knowledge,
        "complete": not run.rollout.interrupted,
        "terminated": run.rollout.terminated,
        "duration": run.duration,
        **_errors(run),
        "clipped_steps": comparison.limited_steps(run),
        "lyapunov_max_increase": run.lyapunov_max_increase,
        "touches": [touch._asdict() for touch in touches(run, comparison.joint_names)],
        "tick": asdict(run.cost) if run.cost else None,
        "wall_time": run.rollout.wall_time,
    }
