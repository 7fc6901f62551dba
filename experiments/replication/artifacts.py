"""Files of the replication, written into an experiment's folder."""

from __future__ import annotations

from pathlib import Path

from adaptctl.experiments.replication.result import Replication
from adaptctl.experiments.replication.wording import facts, headline
from adaptctl.recording.artifacts import FIGURES, RECORDING, REPORT, SUMMARY, TRACE
from adaptctl.recording.result import Progress, Result
from adaptctl.recording.verdict import Verdict


def shown(replication: Replication) -> Result:
    """Result of the replication, as the command line shows it: outcome in words, facts (questions with answers), an
    empty verdict (for it is about no controller), and a function that writes the folder of results."""
    return Result(
        complete=replication.complete,
        headline=headline(replication),
        facts=tuple(facts(replication)),
        verdict=Verdict(),
        write=lambda folder, progress: write_artifacts(folder, replication, progress),
    )


def write_artifacts(folder: Path, replication: Replication, progress: Progress) -> None:
    """Write the files of the replication into a `folder` that is there: summary, random draws, figures (PNG), recording
    and report, each whole or not at all. `progress(what, share)` gets what is written and the share done, 0 to 1.
    Raises `FileError` where a file cannot be written."""
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
