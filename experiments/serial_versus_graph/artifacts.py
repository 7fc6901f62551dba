"""Files of the arms side by side, written into an experiment's folder."""

from __future__ import annotations

from pathlib import Path

from adaptctl.experiments.serial_versus_graph.result import SideBySide
from adaptctl.experiments.serial_versus_graph.summary import write_summary
from adaptctl.experiments.serial_versus_graph.wording import facts, outcome_words, verdict
from adaptctl.recording.artifacts import FIGURES, RECORDING, REPORT, SUMMARY
from adaptctl.recording.result import Progress, Result
from adaptctl.recording.wording import headline


def shown(result: SideBySide) -> Result:
    """Result of the experiment that compares two arms on one path, a `Result`, as the command line shows it, from the
    arms' runs in `result`, a `SideBySide`: outcome in words, facts (questions with answers), verdict on both
    controllers, and a function that writes the result files into a folder. Nothing is checked."""
    return Result(
        complete=result.complete,
        headline=headline(outcome_words(result), result.complete),
        facts=tuple(facts(result)),
        verdict=verdict(result),
        write=lambda folder, progress: write_artifacts(folder, result, progress),
    )


def write_artifacts(folder: Path, result: SideBySide, progress: Progress) -> None:
    """Write the result files of a comparison of arms, `result`, into an existing `folder`: summary (JSON), a table of
    each arm's adaptive run (Parquet), recording, figures (PNG) and report (HTML), each whole or not at all; nothing is
    returned. `progress(what, share)` is called with what is written and the fraction done, 0 to 1. Raises `FileError`
    where a file cannot be written."""
    from adaptctl.experiments.serial_versus_graph.figures import drawings
    from adaptctl.experiments.serial_versus_graph.recording import write_recording
    from adaptctl.experiments.serial_versus_graph.report import trace_name, write_report
    from adaptctl.recording.drawing import write_drawings
    from adaptctl.recording.trace import write_trace

    progress("summary", 0.0)
    write_summary(folder / SUMMARY, result)
    for side in result.sides:
        write_trace(folder / trace_name(side.name), side.comparison)
    progress("recording", 0.2)
    write_recording(folder / RECORDING, result)
    progress("figures", 0.5)
    (folder / FIGURES).mkdir(exist_ok=True)
    figures = write_drawings(folder / FIGURES, drawings(result))
    progress("report", 0.9)
    write_report(folder / REPORT, result, figures)
    progress("report", 1.0)
