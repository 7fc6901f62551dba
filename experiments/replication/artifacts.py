"""Files of the replication, written into an experiment's folder."""

from __future__ import annotations

from pathlib import Path

from adaptctl.experiments.replication.result import Replication
from adaptctl.experiments.replication.wording import facts, headline
from adaptctl.recording.artifacts import FIGURES, RECORDING, REPORT, SUMMARY, TRACE
from adaptctl.recording.result import Progress, Result
from adaptctl.recording.verdict import Verdict


def shown(replication: Replication) -> Result:
    """Result of the experiment that replicates Sheu and Walker (1991), a `Result`, as the command line shows it, from a
    finished `replication`: outcome in words, facts (questions with answers), an empty verdict, since no controller
    runs, and a function that writes the result files into a folder. Its `complete` is False where the replication was
    interrupted. Nothing is raised."""
    return Result(
        complete=replication.complete,
        headline=headline(replication),
        facts=tuple(facts(replication)),
        verdict=Verdict(),
        write=lambda folder, progress: write_artifacts(folder, replication, progress),
    )


def write_artifacts(folder: Path, replication: Replication, progress: Progress) -> None:
    """Write the result files of a `replication` of Sheu and Walker (1991) into an existing `folder`: summary (JSON),
    random draws (Parquet), figures (PNG), recording and report (HTML), each whole or not at all; nothing is returned.
    `progress(what, share)` is called with what is written and the fraction done, 0 to 1. Raises `FileError` where a
    file cannot be written."""
    from adaptctl.experiments.replication.draws_table import write_draws
    from adaptctl.experiments.replication.recording import write_recording
    from adaptctl.experiments.replication.report import write_report
    from adaptctl.experiments.replication.summary import write_summary
    from adaptctl.recording.drawing import write_drawings

    progress("summary", 0.0)
    write_summary(folder / SUMMARY, replication)
    write_draws(folder / TRACE, replication.study)
    (folder / FIGURES).mkdir(exist_ok=True)
    progress("figures", 0.1)
    drawings = [drawing for item in replication.items for drawing in item.drawings]
    figures = write_drawings(folder / FIGURES, drawings)
    progress("recording", 0.7)
    write_recording(folder / RECORDING, replication, figures)
    progress("report", 0.9)
    write_report(folder / REPORT, replication, figures)
    progress("report", 1.0)
