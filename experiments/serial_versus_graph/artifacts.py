"""The folder of an experiment with several arms, filled."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from adaptctl.experiments.serial_versus_graph.figures import drawings, side_color
from adaptctl.experiments.serial_versus_graph.recording import write_recording
from adaptctl.experiments.serial_versus_graph.result import SideBySide
from adaptctl.experiments.serial_versus_graph.summary import write_summary
from adaptctl.experiments.serial_versus_graph.wording import WHY_NOT_16, facts, rows, verdict
from adaptctl.files import write_text
from adaptctl.recording.artifacts import FIGURES, RECORDING, REPORT, SUMMARY
from adaptctl.recording.drawing import write_drawings
from adaptctl.recording.page import embedded, rendered
from adaptctl.recording.trace import write_trace
from adaptctl.recording.wording import INCOMPLETE


def write_artifacts(folder: Path, result: SideBySide, progress: Callable[[str, float], object]) -> None:
    """Write everything, every file whole or not at all."""
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
    write_text(folder / REPORT, report(result, figures))
    progress("report", 1.0)


def trace_name(side: str) -> str:
    """The file of an arm's adaptive run."""
    return f"trace-{side}.parquet"


def report(result: SideBySide, figures: dict[str, Path]) -> str:
    """The page's HTML."""
    return rendered(
        "report.html",
        package="adaptctl.experiments.serial_versus_graph",
        result=result,
        verdict=verdict(result),
        incomplete=INCOMPLETE,
        why_not_16=WHY_NOT_16,
        facts=list(facts(result)),
        rows=rows(result),
        colors=[side_color(i).hex for i in range(len(result.sides))],
        traces={
            trace_name(side.name): "Every control period of an arm's adaptive run, with units." for side in result.sides
        },
        figures=embedded(drawings(result), figures),
    )
