"""Summary of arms side by side as JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from adaptctl.experiments.serial_versus_graph.result import Side, SideBySide
from adaptctl.experiments.serial_versus_graph.wording import verdict
from adaptctl.files import write_json
from adaptctl.recording.summary import summary as comparison_summary

SCHEMA = "adaptctl/side-by-side/1"


def write_summary(path: str | Path, result: SideBySide) -> None:
    """Write the summary of a comparison of arms, `result`, as a JSON file at `path`, whole or not at all; nothing is
    returned. Raises `FileError` where it cannot be written, and for a number that is NaN or infinite."""
    write_json(path, summary(result))


def summary(result: SideBySide) -> dict[str, Any]:
    """Summary of a comparison of arms, `result`, a dict in JSON's types: "schema", "complete", "verdict", "experiment",
    "seed", "duration" (s), "settings", and "arms" by name. Of each arm it has the summary of the comparison of its
    runs, its numbers ("links", "joints", "actuators", "inertial_parameters", "rank_printed", and operations as
    "regressor_flops"), and its tip's RMS distances from the path, m ("first_tip_rms_error" and "final_tip_rms_error" of
    the adaptive run's first second and last two, "final_tip_rms_errors" of every run). Nothing is checked."""
    return {
        "schema": SCHEMA,
        "complete": result.complete,
        "verdict": verdict(result).as_builtins(),
        "experiment": result.experiment,
        "seed": result.seed,
        "duration": result.duration,
        "settings": {setting.name: setting.value for setting in result.settings},
        "arms": {side.name: _arm(side) for side in result.sides},
    }


def _arm(side: Side) -> dict[str, Any]:
    mechanism, runs = side.comparison.mechanism, side.comparison.runs
    return comparison_summary(side.comparison) | {
        "links": len(mechanism.links),
        "joints": side.joints,
        "actuators": mechanism.dof,
        "inertial_parameters": len(mechanism.parameter_names),
        "rank_printed": side.printed_rank,
        "regressor_flops": asdict(side.regressor),
        "first_tip_rms_error": side.first_tip_rms(side.comparison.subject),
        "final_tip_rms_error": side.final_tip_rms(side.comparison.subject),
        "final_tip_rms_errors": {run.name: side.final_tip_rms(run) for run in runs},
    }
