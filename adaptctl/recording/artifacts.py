"""Files of an experiment's folder: a comparison written into it."""

from __future__ import annotations

from pathlib import Path

from adaptctl.errors import FileError
from adaptctl.files import reason
from adaptctl.recording.comparison import Comparison
from adaptctl.recording.judgement import judged
from adaptctl.recording.result import Progress, Result, silent
from adaptctl.recording.wording import facts, headline, outcome_words

RECORDING, SUMMARY, TRACE, REPORT, FIGURES = (
    "recording.rrd",
    "summary.json",
    "trace.parquet",
    "report.html",
    "figures",
)


def shown(comparison: Comparison) -> Result:
    """The result of an experiment, as the command line shows it, from its comparison: whether it is complete, headline,
    facts and verdict in words, and a function that writes its folder as `write_artifacts` does."""
    return Result(
        complete=comparison.complete,
        headline=headline(outcome_words(comparison), comparison.complete),
        facts=tuple(facts(comparison)),
        verdict=judged(comparison),
        write=lambda folder, progress: write_artifacts(folder, comparison, progress),
    )


def write_artifacts(folder: str | Path, comparison: Comparison, progress: Progress = silent) -> Path:
    """Write recording, summary, trace, figures and report of a comparison into a folder, made where it is missing;
    returns its path.

    The files are recording.rrd, summary.json, trace.parquet and report.html, figures are in the folder `figures`; each
    is written whole or not at all. `progress(what, share)` is called with what is being written, and the share of the
    whole that is done, 0 to 1; nothing is shown unless given. Raises `FileError` where a file cannot be written or a
    folder cannot be made.
    """
    from adaptctl.recording.figures import write_figures
    from adaptctl.recording.report import write_report
    from adaptctl.recording.rerun_recording import write_recording
    from adaptctl.recording.summary import write_summary
    from adaptctl.recording.trace import write_trace

    path = Path(folder)
    for place in (path, path / FIGURES):
        try:
            place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(f"{place}: the folder cannot be made ({reason(error)})") from error
    progress("summary", 0.0)
    write_summary(path / SUMMARY, comparison)
    write_trace(path / TRACE, comparison)
    progress("recording", 0.1)
    write_recording(path / RECORDING, comparison)
    progress("figures", 0.3)
    figures = write_figures(path / FIGURES, comparison)
    progress("report", 0.95)
    write_report(path / REPORT, comparison, figures)
    progress("report", 1.0)
    return path
