"""An identification in JSON's types, and its validation as a table."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.files import write_json
from adaptctl.identification import Identification, Validation
from adaptctl.recording.trace import Quantity, parameter_unit, write_columns

SUMMARY_SCHEMA, ESTIMATES_SCHEMA, VALIDATION_SCHEMA = (
    "adaptctl/identification-summary/1",
    "adaptctl/estimates/1",
    "adaptctl/validation/1",
)


def write_summary(path: str | Path, found: Identification) -> None:
    """Write the summary of an identification, as the function `summary` makes it, to the file `path` as JSON, whole or
    not at all: the settings chosen and the prediction errors. Raises `FileError` where it cannot be written, and for
    numbers that are NaN or infinite."""
    write_json(path, summary(found))


def summary(found: Identification) -> dict[str, Any]:
    """Summary, a mapping of JSON's types, of the identification of a robot's inertial and friction parameters from
    logs. `validation` is a mapping with the torque errors, predicted less measured, of the identified robot: `of`, in
    words the rows it is on, `rms_error` in N m (N if prismatic) over all joints and rows, `relative_error`, that
    divided by the root mean square of the measured torques (no unit), `cutoff` of the low-pass filter in Hz, `rows`,
    their number, and `joints`, a mapping from a joint's name to both its errors. `alternatives` maps the names of
    simpler models to such mappings, for the same rows.

    Besides these it has texts: `schema`, `robot`, its name, `robot_sha256`, and `friction`, the friction model's terms;
    numbers: `prior_weight` (no unit), the filter's `cutoff` (Hz), `training_misfit_over_least_squares`, the ratio of
    the fit's residual to that of least squares, and `deviations_over_nominal`, the ratio of the estimates' standard
    deviations to those for white residuals; the truth value `consistent`, True where rigid bodies can have all links'
    parameters; the mapping `essential_components`, of the `rank` and the number `for_energy_to_1_percent`; lists of
    texts: `logs`, `unexcited`, combinations of parameters that the logs hardly excite, and `remarks`; the list `trials`
    of the settings tried, each a mapping of `what`, `candidate`, `rms` (N m; N if all joints are prismatic) and
    `taken`; and the mapping `steps` from the names of the steps of the logs' preparation to their outcomes in words.
    Nothing is raised.
    """
    settings = found.choice.settings
    return {
        "schema": SUMMARY_SCHEMA,
        "robot": found.mechanism.name,
        "robot_sha256": found.mechanism.description.sha256,
        "logs": list(dict.fromkeys(motion.log.source for motion in found.motions)),
        "validation": {"of": found.validation.origin, **_errors(found, found.validation)},
        "alternatives": {name: _errors(found, other) for name, other in found.alternatives.items()},
        "friction": settings.friction.words,
        "prior_weight": settings.weight,
        "cutoff": settings.cutoff,
        "consistent": not found.mechanism.description.inconsistent_links,
        "training_misfit_over_least_squares": found.misfit_ratio,
        "deviations_over_nominal": found.inflation,
        "essential_components": {"rank": found.space.rank, "for_energy_to_1_percent": found.components},
        "unexcited": [combination.words for combination in found.unexcited],
        "trials": [trial._asdict() for trial in found.choice.trials],
        "steps": {step.name: step.outcome for step in found.steps},
        "remarks": list(found.remarks),
    }


def _errors(found: Identification, validation: Validation) -> dict[str, Any]:
    names = [joint.name for joint in found.mechanism.primary_joints]
    each = zip(names, validation.joint_rms_errors.tolist(), validation.joint_relative_errors.tolist(), strict=True)
    return {
        "rms_error": validation.rms_error,
        "relative_error": validation.relative_error,
        "cutoff": validation.cutoff,
        "rows": len(validation.time),
        "joints": {name: {"rms_error": rms, "relative_error": relative} for name, rms, relative in each},
    }


def write_estimates(path: str | Path, found: Identification) -> None:
    """Write initial estimates for an adaptive controller, those of an identification, to the file `path` as JSON, whole
    or not at all. `fundamental` has, by name of each fundamental (base) parameter, in its `unit`, `value`, standard
    `deviation` and `prior_range`, the greatest distance of the true value that is expected, and `gain`, in that unit
    squared per J, the diagonal of the adaptation gain. `parameters` has all inertial and friction parameters, SI units;
    `load_dependent_friction`, by joint, the coefficient of friction proportional to the joint's torque, no unit. The
    `robot`'s name is there too. Raises `FileError` where the file cannot be written, and for numbers that are NaN or
    infinite."""
    joints = [joint.name for joint in found.mechanism.primary_joints]
    columns = zip(
        found.names,
        found.estimate.tolist(),
        found.deviations.tolist(),
        found.prior_ranges.tolist(),
        found.adaptation_gain().tolist(),
        strict=True,
    )
    content = {
        "schema": ESTIMATES_SCHEMA,
        "robot": found.mechanism.name,
        "robot_sha256": found.mechanism.description.sha256,
        "fundamental": {
            name: {
                "value": value,
                "deviation": s,
                "prior_range": wide,
                "gain": gain,
                "unit": parameter_unit(name, found.mechanism),
            }
            for name, value, s, wide, gain in columns
        },
        "parameters": dict(zip(found.mechanism.parameter_names, found.mechanism.inertial_parameters, strict=True)),
        "load_dependent_friction": dict(zip(joints, found.load.tolist(), strict=True)),
    }
    write_json(path, content)


def write_validation(path: str | Path, found: Identification) -> None:
    """Write the torques of an identification's validation to the Parquet file `path`, whole or not at all. It has a row
    for each instant, with `time`, s, as in the log, and for each joint, by its name, `measured_NAME` and
    `predicted_NAME`, N m (N if prismatic), both through the same low-pass filter. Raises `FileError` where it cannot be
    written."""
    about = {"schema": VALIDATION_SCHEMA, "of": found.validation.origin, "cutoff": repr(found.validation.cutoff)}
    write_columns(path, list(_columns(found)), about)


def _columns(found: Identification) -> Iterator[Quantity]:
    validation = found.validation
    yield Quantity("time", "s", "time as in the log", validation.time)
    filtered = f"at the joint, below {validation.cutoff:g} Hz"
    for j, joint in enumerate(found.mechanism.primary_joints):
        unit = joint.kind.effort_unit
        measured, predicted = np.ascontiguousarray(validation.measured[:, j]), validation.predicted[:, j]
        yield Quantity(f"measured_{joint.name}", unit, f"measured torque {filtered}", measured)
        yield Quantity(f"predicted_{joint.name}", unit, f"torque predicted from the motion {filtered}", predicted)
