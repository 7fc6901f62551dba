"""Folder of an identification."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from hashlib import file_digest
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import AdaptctlError
from adaptctl.files import hashed, write_json, write_text
from adaptctl.folders import made_folder
from adaptctl.identification.identification import Identification
from adaptctl.identification.report import best_hypotheses, components, consistency, joint_verdicts, report
from adaptctl.identification.validation import Validation
from adaptctl.identification.written import WrittenRobot, write_robots
from adaptctl.recording.colors import MUTED, joint_color, run_color
from adaptctl.recording.drawing import thinned, write_figures
from adaptctl.recording.page import Report
from adaptctl.recording.result import FIGURES
from adaptctl.recording.wording import parameter_unit, torque_error_unit, torque_units
from adaptctl.stages import stage
from adaptctl.version import __version__

ESTIMATES, VALIDATION = "estimates.json", "validation.parquet"
SUMMARY_SCHEMA, ESTIMATES_SCHEMA, VALIDATION_SCHEMA = (
    "adaptctl/identification-summary/3",
    "adaptctl/estimates/2",
    "adaptctl/validation/1",
)
# At most as many are in the recording
MAX_RECORDED_SAMPLES = 3000


@stage("writing results")
def write_identification(
    folder: str | Path,
    found: Identification,
    robot: str | Path | None = None,
    before: Mechanism | None = None,
    figures: bool = False,
) -> tuple[WrittenRobot, ...]:
    """Write the files of an identification into a folder, all or none; the robots as their files give them again."""
    with TemporaryDirectory() as aside:
        written = tuple(write_robots(Path(aside), found, robot, before))
        whole = written[0].validation
        if not np.allclose(whole.predicted, found.validation.predicted, rtol=1e-6, atol=1e-6 * whole.rms_measured):
            raise AdaptctlError(f"{written[0].name}: predicts other torques than the estimate when it is loaded again")
        found = replace(found, validation=whole)
        shown = report(found, written, figures)
        files: dict[str, Callable[[Path], object]] = {
            **{one.name: partial(copyfile, Path(aside) / one.name) for one in written},
            ESTIMATES: lambda path: write_json(path, estimates(found)),
            **{name: partial(write_text, data=text) for name, text in _payloads(found)},
            VALIDATION: partial(write_validation, found=found),
        }
        content, record = summary(found, written), partial(_record, found, shown)
        shown.write(folder, content, tables=files, record=record, figures=False)
        if figures:
            write_figures(made_folder(Path(folder) / FIGURES), shown.drawings)
    return written


def summary(found: Identification, written: Sequence[WrittenRobot] = ()) -> dict[str, Any]:
    """Summary of an identification in JSON's types."""
    settings, names = found.choice.settings, [joint.name for joint in found.mechanism.primary_joints]
    return {
        "schema": SUMMARY_SCHEMA,
        "version": __version__,
        "robot": found.mechanism.name,
        "robot_sha256": found.mechanism.description.sha256,
        "logs": _logs(motion.log.source for motion in found.motions),
        "validation_logs": _logs(motion.log.source for motion in found.held_out.evidence.motions),
        "verdict": {joint.name: joint.as_builtins() for joint in joint_verdicts(found)},
        "validation": {"of": found.validation.origin, **_errors(found, found.validation)},
        "validation_in_band": _errors(found, found.validation_in_band),
        "files": {one.name: {**_errors(found, one.validation), "cannot_hold": list(one.missing)} for one in written},
        "alternatives": {name: _errors(found, other) for name, other in found.alternatives.items()},
        "friction": settings.friction.words,
        "prior_weight": settings.weight,
        "cutoff": settings.cutoff,
        "masked_below": settings.slow,
        "left_out": [names[j] for j in settings.left_out],
        "consistent": not found.mechanism.description.inconsistent_links,
        "training_misfit_over_least_squares": found.misfit_ratio,
        "optimality_residual": found.residual,
        "deviations_over_nominal": found.deviation_ratio,
        "essential_components": {"rank": found.space.rank, "for_energy_to_1_percent": found.components},
        "unexcited": [combination.words for combination in found.unexcited],
        "trials": [trial._asdict() for trial in found.choice.trials],
        "steps": {step.name: step.outcome for step in found.steps},
        "hypotheses": [trial._asdict() for trial in best_hypotheses(found)],
        "payloads": [payload.as_builtins() for payload in found.payloads],
        "warnings": list(found.warnings),
    }


def _payloads(found: Identification) -> Iterator[tuple[str, str]]:
    """Names and contents of the payloads' files."""
    for k, payload in enumerate(found.payloads):
        name = "payload" if len(found.payloads) == 1 else f"payload_{k + 1}"
        yield f"{name}.urdf", payload.urdf(name)


def _logs(sources: Iterable[str]) -> dict[str, str | None]:
    """SHA-256 hashes of logs by their paths; None of those that are no file."""
    return {source: _sha256(Path(source)) for source in dict.fromkeys(sources)}


def _sha256(path: Path) -> str | None:
    if not path.is_file():
        return None
    with path.open("rb") as file:
        return file_digest(file, "sha256").hexdigest()


def _errors(found: Identification, validation: Validation) -> dict[str, Any]:
    names = [joint.name for joint in found.mechanism.primary_joints]
    each = zip(names, validation.joint_rms_errors.tolist(), validation.joint_relative_errors.tolist(), strict=True)
    return {
        "rms_error": validation.rms_error,
        "relative_error": validation.relative_error,
        "rms_errors": validation.rms_errors,
        "relative_errors": validation.relative_errors,
        "cutoff": validation.cutoff,
        "rows": len(validation.time),
        "joints": {name: {"rms_error": rms, "relative_error": relative} for name, rms, relative in each},
    }


def estimates(found: Identification) -> dict[str, Any]:
    """Initial estimates for an adaptive controller in JSON's types."""
    columns = zip(found.estimate, found.deviations, found.prior_ranges, found.adaptation_gain(), strict=True)
    fundamental = {
        name: {
            **dict(zip(("value", "deviation", "prior_range", "gain"), map(float, row), strict=True)),
            "interval": None if np.isnan(interval).any() else interval.tolist(),
            "unit": parameter_unit(name, found.mechanism),
        }
        for name, row, interval in zip(found.names, columns, found.intervals, strict=True)
    }
    parameters = found.mechanism.inertial_parameters.tolist()
    numbers = {
        "fundamental": fundamental,
        "parameters": dict(zip(found.mechanism.parameter_names, parameters, strict=True)),
    }
    return {
        "schema": ESTIMATES_SCHEMA,
        "robot": found.mechanism.name,
        "robot_sha256": found.mechanism.description.sha256,
        "geometry_sha256": found.mechanism.geometry_sha256,
        **numbers,
        "sha256": hashed(numbers),
    }


def write_validation(path: str | Path, found: Identification) -> None:
    """Write the torques of the validation to a Parquet file, a row for each instant."""
    from adaptctl.recording.trace import Quantity, write_columns

    def columns() -> Iterator[Quantity]:
        validation = found.validation
        yield Quantity("time", "s", "time as in the log", validation.time)
        filtered = f"at the joint, below {validation.cutoff:g} Hz"
        for j, joint in enumerate(found.mechanism.primary_joints):
            unit, measured = joint.kind.effort_unit, np.ascontiguousarray(validation.measured[:, j])
            yield Quantity(f"measured_{joint.name}", unit, f"measured torque {filtered}", measured)
            predicted = validation.predicted[:, j]
            yield Quantity(f"predicted_{joint.name}", unit, f"torque predicted from the motion {filtered}", predicted)

    about = {"schema": VALIDATION_SCHEMA, "of": found.validation.origin, "cutoff": repr(found.validation.cutoff)}
    about["geometry_sha256"] = found.mechanism.geometry_sha256
    write_columns(path, list(columns()), about)


def _record(found: Identification, shown: Report, path: Path, figures: Mapping[str, Path]) -> None:
    import rerun.blueprint as rrb

    from adaptctl.recording import views
    from adaptctl.recording.scene import WORLD, entity, log_arm, log_base, log_trail
    from adaptctl.recording.skeleton import Viewpoint, floor_height, skeleton
    from adaptctl.recording.stream import Curves, log_curves, log_markdown, of_joints, saved_stream

    mechanism, validation, parts = found.mechanism, found.validation, skeleton(found.mechanism)
    (time, p), names = _motion(found), [joint.name for joint in mechanism.primary_joints]
    error = f"All joints: predicted minus measured [{torque_error_unit(mechanism)}]"
    titles = {"error": error}
    curves = [of_joints("error", validation.time, validation.error, names)]
    for j, (name, unit) in enumerate(zip(names, torque_units(mechanism), strict=True)):
        both = np.stack([validation.measured[:, j], validation.predicted[:, j]], axis=-1)
        path_of_joint, colors = f"torque/{entity(name)}", (MUTED, joint_color(j))
        curves.append(Curves(path_of_joint, validation.time, both, ("measured", "predicted"), colors))
        titles[path_of_joint] = f"{name}: torque [{unit}]"
    start, end = float(validation.time[0]), float(validation.time[-1])
    right = [views.curves(place, title, end, start=start) for place, title in titles.items()]
    arm = views.arm(WORLD, "Motion of the log", Viewpoint.of(mechanism, parts, p))
    left = rrb.Vertical(arm, views.text("summary", "Summary"), row_shares=[3, 2])
    both_sides = rrb.Horizontal(left, rrb.Grid(*right, grid_columns=2), column_shares=[2, 3], name="Validation torques")
    layout = views.tabs(both_sides)
    content = np.ascontiguousarray(validation.measured).tobytes()
    with saved_stream(path, shown, content, layout, mechanism) as recording:
        log_markdown(recording, "summary", shown.markdown(consistency(found), components(found)))
        log_base(recording, mechanism, parts, floor_height(mechanism, parts, p))
        tip = log_arm(recording, "logged", mechanism, parts, time, p, run_color(0))
        log_trail(recording, "logged", time, tip, run_color(0))
        log_curves(recording, curves)


def _motion(found: Identification) -> tuple[Array, Array]:
    time = np.concatenate([m.log.time[m.first :: m.every][: len(m.position)] for m in found.motions])
    order = np.argsort(time, kind="stable")[thinned(len(time), MAX_RECORDED_SAMPLES)]
    return time[order], np.concatenate([motion.position for motion in found.motions])[order]
