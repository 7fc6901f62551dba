"""Reports of sweeps."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow as pa

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.experiments import find
from adaptctl.files import write_text
from adaptctl.folders import made_folder
from adaptctl.recording.drawing import Drawing, sheet, write_drawings
from adaptctl.recording.page import Lines, Report, Section, Table
from adaptctl.recording.result import FIGURES, Fact
from adaptctl.sweeps.folder import Saved, read_table, saved_study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Runs that the report lists, of each controller.
NUM_WORST = 5
# Relative difference of errors that is round-off.
EQUAL_ERROR_TOLERANCE = 1e-9
# Values of a setting in a map, at most: more are put together.
MAX_BINS = 8


class SettingsMap(NamedTuple):
    """Errors and fractions of stable runs over two settings."""

    x: str
    y: str
    across: list[Any]
    down: list[Any]
    error: Array
    stable: Array


@dataclass(frozen=True, eq=False)
class SweepReport:
    """Report of a sweep: its study and the table of its rows."""

    study: Saved
    table: pa.Table

    @classmethod
    def of(cls, path: Path) -> SweepReport:
        """Report of the sweep in a folder, finished or not."""
        return cls(saved_study(path), read_table(path))

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """Rows of the table as mappings by column."""
        return list(self.table.to_pylist())

    @cached_property
    def controllers(self) -> list[str]:
        """Names of the controllers, in the order of their first rows."""
        return list(dict.fromkeys(row["controller"] for row in self.rows if row["controller"])) or [""]

    def of_controller(self, name: str) -> list[dict[str, Any]]:
        """Rows of a controller."""
        return [row for row in self.rows if row["controller"] == name]

    def without_effect(self) -> dict[str, list[str]]:
        """Names of the controllers whose results a setting does not change, by setting."""
        swept = self.study.swept
        found = {x: [name for name in self.controllers if _is_idle(self.of_controller(name), x, swept)] for x in swept}
        return {setting: idle for setting, idle in found.items() if idle}

    def counts(self, rows: Sequence[dict[str, Any]]) -> dict[str, int]:
        """Numbers of rows by status."""
        return {status: sum(row["status"] == status for row in rows) for status in ("done", "diverged", "failed")}

    def worst(self, name: str) -> list[dict[str, Any]]:
        """Rows of a controller's worst runs, at most 5: diverged ones first, then by error."""

        def badness(row: dict[str, Any]) -> tuple[float, float]:
            gone = row["diverged_at"] if row["status"] == "diverged" else np.inf
            return gone, -(_error(row) or row["rms_error"] or 0.0)

        return sorted((row for row in self.of_controller(name) if row["status"] != "failed"), key=badness)[:NUM_WORST]

    def replay(self, row: dict[str, Any]) -> str:
        """Command line that runs a row's settings again, with a recording."""
        words = ["adaptctl", "experiment", "run", self.study.experiment]
        for entry in fields(find(self.study.experiment)):
            value = row[entry.name]
            default = " ".join(map(str, entry.default)) if isinstance(entry.default, tuple) else entry.default
            if value != default:
                words += _flag(entry.name.replace("_", "-"), value, isinstance(entry.default, tuple))
        return shlex.join([*words, "--out", f"results/{self.study.experiment}-replay"])

    def maps(self, name: str) -> Iterator[SettingsMap]:
        """Maps of a controller's outcomes over pairs of numeric settings."""
        rows = [row for row in self.of_controller(name) if row["status"] != "failed"]
        numeric = [s for s in self.study.swept if rows and not isinstance(rows[0][s], str)]
        for x, y in combinations(numeric, 2):
            across, down = _binned([row[x] for row in rows]), _binned([row[y] for row in rows])
            error, stable = np.full((2, len(down), len(across)), np.nan)
            cells: dict[tuple[int, int], list[dict[str, Any]]] = {}
            for row in rows:
                cells.setdefault((_bin(row[y], down), _bin(row[x], across)), []).append(row)
            for place, cell in cells.items():
                kept = [size for row in cell if (size := _error(row)) is not None]
                error[place] = np.mean(kept) if kept else np.nan
                stable[place] = np.mean([row["status"] == "done" for row in cell])
            yield SettingsMap(x, y, across, down, error, stable)

    def facts(self) -> list[Fact]:
        """Questions and answers at the head of the report."""
        counts, rows = self.counts(self.rows), len(self.rows)
        stable = f"{100 * counts['done'] / max(1, rows):.1f} %"
        numbers = (self.study.runs, rows, stable, counts["diverged"], counts["failed"])
        return [
            Fact(*pair)
            for pair in zip(("Runs", "Rows", "Stable", "Diverged", "Failed"), map(str, numbers), strict=True)
        ]

    def text(self) -> str:
        """Report for a terminal."""
        lines = [f"{self.study.experiment}: {len(self.rows)} rows of {self.study.runs} runs"]
        for name in self.controllers:
            rows = self.of_controller(name)
            errors = [size for row in rows if (size := _error(row)) is not None]
            summary = f"median final error {np.median(errors):.3g}, largest {max(errors):.3g}" if errors else ""
            counts = ", ".join(f"{count} {status}" for status, count in self.counts(rows).items() if count)
            lines.append(f"  {name or 'runs'}: {counts}; {summary}".rstrip("; "))
        failed = [row for row in self.rows if row["status"] == "failed"]
        for reason in list(dict.fromkeys(row["reason"] for row in failed))[:NUM_WORST]:
            lines.append(f"  failed: {reason}")
        for setting, idle in self.without_effect().items():
            whose = "" if len(idle) == len(self.controllers) else f" of {', '.join(idle)}"
            lines.append(f"  {setting} has no effect on the results{whose}")
        return "\n".join(lines)


def _flag(name: str, value: object, many: bool) -> list[str]:
    if isinstance(value, bool):
        return [f"--{name}" if value else f"--no-{name}"]
    return [f"--{name}", *(str(value).split() if many else (str(value),))]


def _error(row: dict[str, Any]) -> float | None:
    if row["status"] != "done":
        return None
    found: float | None = row["rms_error" if row["final_rms_error"] is None else "final_rms_error"]
    return found


def write_report(path: Path) -> Path:
    """Write a sweep's report as an HTML page, and return its path."""
    report = SweepReport.of(path)
    told = Section("Results", (Lines(report.text().splitlines()),))
    page = Report(
        experiment=report.study.experiment,
        title=f"Sweep of {report.study.experiment}",
        outcome=report.study.question or "Parameter sweep of one experiment.",
        facts=report.facts(),
        sections=(told, *(_of_controller(report, name) for name in report.controllers)),
        about=f"{report.study.runs} runs",
    )
    figures = made_folder(path / FIGURES) if page.drawings else path
    write_text(path / "report.html", page.html(write_drawings(figures, page.drawings)))
    return path / "report.html"


def _of_controller(report: SweepReport, name: str) -> Section:
    maps = [
        Drawing(f"{name or 'runs'}-{k}", f"{name}: {shown.x} and {shown.y}", partial(map_figure, shown))
        for k, shown in enumerate(report.maps(name))
    ]
    columns = (*report.study.swept, "status", "final_rms_error")
    rows = [(*(str(row[column]) for column in columns), report.replay(row)) for row in report.worst(name)]
    heads = (*report.study.swept, "status", "final error", "command")
    title = "Worst runs, and the commands that reproduce them"
    worst = Table(heads, rows, title=title, align="l" * (len(heads) - 1) + "c")
    return Section(name or "Runs", (*maps, worst))


def map_figure(shown: SettingsMap) -> Figure:
    """Figure of two maps: errors, and fractions of stable runs."""
    canvas = sheet(3.5)
    titles = ("final error [rad or m]", "fraction of stable runs")
    for axes, values, title in zip(canvas.subplots(1, 2), (shown.error, shown.stable), titles, strict=True):
        shares = {"vmin": 0.0, "vmax": 1.0} if title.startswith("fraction") else {}
        image = axes.imshow(values, origin="lower", aspect="auto", cmap="viridis", **shares)
        axes.set_xticks(range(len(shown.across)), [f"{value:.3g}" for value in shown.across], rotation="vertical")
        axes.set_yticks(range(len(shown.down)), [f"{value:.3g}" for value in shown.down])
        axes.set(xlabel=shown.x, ylabel=shown.y, title=title)
        axes.grid(visible=False)
        canvas.colorbar(image, ax=axes)
    return canvas


def _is_idle(rows: Sequence[dict[str, Any]], setting: str, swept: Sequence[str]) -> bool:
    """True if rows that differ in a setting alone have the same results, and there are such."""
    groups: dict[Any, list[tuple[Any, Any]]] = {}
    for row in (row for row in rows if row["status"] != "failed"):
        others = tuple(row[name] for name in swept if name != setting)
        numbers = np.array([row["rms_error"], row["largest_error"]], dtype=np.float64)  # None is NaN
        groups.setdefault(others, []).append((row["status"], numbers))
    pairs = [(group[0], other) for group in groups.values() for other in group[1:]]
    return bool(pairs) and all(
        a[0] == b[0] and np.allclose(a[1], b[1], rtol=EQUAL_ERROR_TOLERANCE, atol=0.0, equal_nan=True) for a, b in pairs
    )


def _binned(values: list[Any]) -> list[Any]:
    different = sorted(set(values))
    if len(different) <= 2 * MAX_BINS:
        return different
    return np.linspace(different[0], different[-1], MAX_BINS + 1)[:-1].tolist()


def _bin(value: Any, lower: list[Any]) -> int:
    return int(np.searchsorted(lower, value, side="right")) - 1
