"""Files of an experiment's folder: a comparison written into it."""

from __future__ import annotations

from pathlib import Path

from adaptctl.recording.comparison import Comparison
from adaptctl.recording.folder import FIGURES as FIGURES
from adaptctl.recording.folder import RECORDING as RECORDING
from adaptctl.recording.folder import REPORT as REPORT
from adaptctl.recording.folder import SUMMARY as SUMMARY
from adaptctl.recording.folder import TRACE as TRACE
from adaptctl.recording.folder import Progress, all_or_none, silent
from adaptctl.recording.judgement import judged
from adaptctl.recording.result import Result
from adaptctl.recording.wording import facts, headline, outcome_words


def shown(comparison: Comparison) -> Result:
    """The `Result` of an experiment, as the command line shows it, made from the `comparison` of its runs: whether it
    is complete, and headline, facts and verdict in words. Its `write(folder, progress)` writes its files (recording,
    summary, trace, figures, report) by `write_artifacts`. Its `failed` is False: whether the adaptive controller did
    what was asked is in its `verdict.passed`. Raises `ValueError` for a first run of another number of joints than
    there are torque limits."""
    return Result(
        complete=comparison.complete,
        headline=headline(outcome_words(comparison), comparison.complete),
        facts=tuple(facts(comparison)),
        verdict=judged(comparison),
        write=lambda folder, progress: write_artifacts(folder, comparison, progress),
    )


def write_artifacts(folder: str | Path, comparison: Comparison, progress: Progress = silent) -> Path:
    """Write the files of a `comparison` of runs into a `folder`, which is made where it is missing, and return its
    path. The files are recording.rrd (for the rerun viewer), summary.json, trace.parquet (all samples of the
    comparison's first run), report.html, and PNG files of figures in the subfolder `figures`.

    Either all are written, each over an existing file of its name, or none, where one cannot be written or `progress`
    raises. `progress(what, share)` is called with the name of the file being written and the fraction of the work that
    is done, 0 to 1; the default does nothing. Of a run whose numbers overflowed to NaN or infinity, the report and the
    summary say so: its numbers in the summary are null, findings too, and its recording ends before them.

    Raises `FileError` where a file cannot be written or the folder cannot be made; `InputError` for a basis of another
    mechanism, and `NonFiniteError`, a subclass of it, for a run whose first positions are NaN or infinite.
    """
    from adaptctl.recording.figures import write_figures
    from adaptctl.recording.report import write_report
    from adaptctl.recording.rerun_recording import write_recording
    from adaptctl.recording.summary import write_summary
    from adaptctl.recording.trace import write_trace

    with all_or_none(folder) as beside:
        progress("summary", 0.0)
        write_summary(beside / SUMMARY, comparison)
        write_trace(beside / TRACE, comparison)
        progress("recording", 0.1)
        write_recording(beside / RECORDING, comparison)
        progress("figures", 0.3)
        (beside / FIGURES).mkdir()
        figures = write_figures(beside / FIGURES, comparison)
        progress("report", 0.95)
        write_report(beside / REPORT, comparison, figures)
        progress("report", 1.0)
    return Path(folder)
