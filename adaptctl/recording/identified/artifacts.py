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
    """Write the files of an identification into an existing `folder`, each whole or not at all, and return the folder's
    path. The files are robot.toml, the identified robot, estimates.json, validation.parquet (torques), recording.rrd,
    report.html, PNG files in the folder `figures`, and summary.json, the last.

    Where `robot`, the file that was identified, is a URDF file and `before` is the mechanism that it describes,
    robot.urdf is a copy of it with the identified inertias; without them, by default, there is none. Raises `FileError`
    where a file cannot be written or the URDF file not be read, for numbers that are NaN or infinite, and for an
    inertia without mass, which URDF does not allow; `KeyError` for a link that the URDF file does not have.
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
