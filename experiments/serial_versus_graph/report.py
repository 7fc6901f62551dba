"""Report of arms side by side: one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from adaptctl.experiments.serial_versus_graph.figures import drawings, side_color
from adaptctl.experiments.serial_versus_graph.result import SideBySide
from adaptctl.experiments.serial_versus_graph.wording import WHY_NOT_16, facts, outcome_words, rows
from adaptctl.files import write_text
from adaptctl.recording.page import embedded, rendered
from adaptctl.recording.wording import INCOMPLETE


def write_report(path: str | Path, result: SideBySide, figures: Mapping[str, Path]) -> None:
    """Write the report on a comparison of arms, `result`, one HTML page at `path` with the `figures` (PNG files by
    name) inside, whole or not at all; nothing is returned. Raises `FileError` where it cannot be written, `OSError`
    where a figure cannot be read."""
    write_text(path, report(result, figures))


def trace_name(side: str) -> str:
    """Name of the Parquet file with the adaptive run of the arm called `side`, such as "trace-serial.parquet" for
    "serial". Nothing is checked."""
    return f"trace-{side}.parquet"


def report(result: SideBySide, figures: Mapping[str, Path]) -> str:
    """HTML text of the report on a comparison of arms, `result`: one page with the `figures`, PNG files by name,
    inside. Raises `OSError` where a figure cannot be read."""
    return rendered(
        "report.html",
        __package__ or "",
        result=result,
        verdict=outcome_words(result),
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
