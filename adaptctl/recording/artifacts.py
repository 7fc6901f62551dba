"""The folder of an experiment: made ready before anything is computed, filled when it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from adaptctl.errors import FileError
from adaptctl.files import replacing

if TYPE_CHECKING:
    from adaptctl.recording.comparison import Comparison

RECORDING, SUMMARY, TRACE, REPORT, FIGURES = (
    "recording.rrd",
    "summary.json",
    "trace.parquet",
    "report.html",
    "figures",
)


def prepare_folder(folder: str | Path, overwrite: bool = False) -> Path:
    """The folder, made where it is missing. Raises FileError when it holds something or cannot be written.

    This is asked before the work is done, so that nobody waits for a run that cannot be kept.
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


def write_artifacts(
    folder: str | Path, comparison: Comparison, progress: Callable[[str, float], object] | None = None
) -> Path:
    """Write recording, summary, trace, figures and report into a folder that is ready; returns it.

    Every file is written whole or not at all. `progress` is called with what is being written, and the share
    of this that is done.
    """
    from adaptctl.recording.figures import write_figures
    from adaptctl.recording.report import write_report
    from adaptctl.recording.rerun_recording import write_recording
    from adaptctl.recording.summary import write_summary
    from adaptctl.recording.trace import write_trace

    path, told = Path(folder), progress or _untold
    told("summary", 0.0)
    write_summary(path / SUMMARY, comparison)
    write_trace(path / TRACE, comparison)
    told("recording", 0.1)
    write_recording(path / RECORDING, comparison)
    told("figures", 0.3)
    (path / FIGURES).mkdir(exist_ok=True)
    figures = write_figures(path / FIGURES, comparison)
    told("report", 0.95)
    write_report(path / REPORT, comparison, figures)
    told("report", 1.0)
    return path


def _untold(what: str, share: float) -> None:
    """Nobody asked to be told."""
