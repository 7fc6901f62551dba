"""Files of an experiment's folder: the folder made ready before anything is computed, a comparison written into it."""

from __future__ import annotations

from pathlib import Path

from adaptctl.errors import FileError
from adaptctl.files import replacing
from adaptctl.recording.comparison import Comparison
from adaptctl.recording.judgement import judged
from adaptctl.recording.result import Progress, Result, silent
from adaptctl.recording.wording import facts, headline, told

RECORDING, SUMMARY, TRACE, REPORT, FIGURES = (
    "recording.rrd",
    "summary.json",
    "trace.parquet",
    "report.html",
    "figures",
)


def prepare_folder(folder: str | Path, overwrite: bool = False) -> Path:
    """Path of an empty folder that can be written, made where it is missing.

    Raises FileError where it holds something, unless `overwrite`, and where it cannot be written. This is asked
    before the work is done, so that nobody waits for a run that cannot be kept.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
        occupied = any(path.iterdir())
    except FileExistsError as error:
        raise FileError(f"{path}: is a file; give a folder") from error
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise FileError(f"{path}: cannot be made or read ({reason}); choose another folder") from error
    if occupied and not overwrite:
        raise FileError(f"{path}: the folder is not empty; choose another or allow it with --overwrite")
    with replacing(path / ".writable") as probe:
        probe.touch()
    (path / ".writable").unlink()
    return path


def shown(comparison: Comparison) -> Result:
    """A comparison as an experiment's result."""
    return Result(
        complete=comparison.complete,
        headline=headline(told(comparison), comparison.complete),
        facts=tuple(facts(comparison)),
        verdict=judged(comparison),
        write=lambda folder, progress: write_artifacts(folder, comparison, progress),
    )


def write_artifacts(folder: str | Path, comparison: Comparison, progress: Progress = silent) -> Path:
    """Write recording, summary, trace, figures and report into a folder that is ready; returns it.

    Every file is written whole or not at all. `progress` is called with what is being written, and the share
    of this that is done. Raises FileError.
    """
    from adaptctl.recording.figures import write_figures
    from adaptctl.recording.report import write_report
    from adaptctl.recording.rerun_recording import write_recording
    from adaptctl.recording.summary import write_summary
    from adaptctl.recording.trace import write_trace

    path = Path(folder)
    progress("summary", 0.0)
    write_summary(path / SUMMARY, comparison)
    write_trace(path / TRACE, comparison)
    progress("recording", 0.1)
    write_recording(path / RECORDING, comparison)
    progress("figures", 0.3)
    (path / FIGURES).mkdir(exist_ok=True)
    figures = write_figures(path / FIGURES, comparison)
    progress("report", 0.95)
    write_report(path / REPORT, comparison, figures)
    progress("report", 1.0)
    return path
