"""The folder of an identification."""

from __future__ import annotations

from pathlib import Path

from adaptctl.description.writers.mechanism_file import write_mechanism
from adaptctl.description.writers.urdf_inertials import write_urdf
from adaptctl.dynamics import Mechanism
from adaptctl.identification import Identification
from adaptctl.recording.artifacts import FIGURES, RECORDING, REPORT, SUMMARY
from adaptctl.recording.identified.figures import write_figures
from adaptctl.recording.identified.report import write_report
from adaptctl.recording.identified.rerun_recording import write_recording
from adaptctl.recording.identified.tables import write_estimates, write_summary, write_validation

ROBOT, URDF, ESTIMATES, VALIDATION = "robot.toml", "robot.urdf", "estimates.json", "validation.parquet"


def write_identification(
    folder: str | Path, found: Identification, robot: str | Path | None = None, before: Mechanism | None = None
) -> Path:
    """Write robot, estimates, validation, summary, recording, figures and report into a folder that is ready.

    Where the `robot` that was identified came from a URDF file (as `before`), a copy of it with the new inertials is
    among them. Every file is written whole or not at all.
    """
    path = Path(folder)
    write_mechanism(path / ROBOT, found.mechanism.description)
    if robot is not None and before is not None and Path(robot).suffix.lower() == ".urdf":
        write_urdf(path / URDF, robot, before.description, found.mechanism.description)
    write_estimates(path / ESTIMATES, found)
    write_validation(path / VALIDATION, found)
    write_recording(path / RECORDING, found)
    (path / FIGURES).mkdir(exist_ok=True)
    write_report(path / REPORT, found, write_figures(path / FIGURES, found))
    write_summary(path / SUMMARY, found)
    return path
