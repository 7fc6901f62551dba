"""Reports of sweeps: how many runs were stable, where errors are large, and how to see the worst again."""

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

WORST = 5
"""Runs that the report lists, of each controller."""
SAME = 1e-9
"""Relative difference of errors that is round-off."""
BINS = 8
"""Values of a setting in a map, at most: more are put together."""


class SettingsMap(NamedTuple):
    """Map of the outcomes of a sweep's runs over two of its settings, named `x` and `y`. `across` (c,) and `down` (d,)
    have c values of x and d of y, in ascending order, or the lower ends of bins of them. `error` (d, c) has root mean
    square errors of joint positions, rad or m, over the last two seconds (over all of a shorter run), as their mean
    over the runs of status "done"; `stable` (d, c) has the fraction of runs of status "done", 0 to 1; NaN where there
    are none. Nothing is checked."""

    x: str
    y: str
    across: list[Any]
    down: list[Any]
    error: Array
    stable: Array


@dataclass(frozen=True, eq=False)
class SweepReport:
    """Report of a sweep, finished or not: `study`, the content of its study.json, a `Saved`, and `table` (pyarrow), the
    rows of the runs computed so far, one for each run and controller. Made by `SweepReport.of`; nothing is checked at
    construction."""

    study: Saved
    table: pa.Table

    @classmethod
    def of(cls, path: Path) -> SweepReport:
        """The `SweepReport` of the sweep in the folder `path`, finished or not. Raises `FileError` for a folder without
        a sweep or without a finished row, and for files that cannot be read."""
        return cls(saved_study(path), read_table(path))

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """Rows of the sweep's table, one for each run and controller, as a list of mappings by column."""
        return list(self.table.to_pylist())

    @cached_property
    def controllers(self) -> list[str]:
        """Names of the controllers that the sweep compares, in the order in which they first occur in the rows; one
        empty name where no row has any, as where all runs failed."""
        return list(dict.fromkeys(row["controller"] for row in self.rows if row["controller"])) or [""]

    def of_controller(self, name: str) -> list[dict[str, Any]]:
        """Rows of the sweep of the controller called `name`, as a list of mappings by column; empty for a name that no
        row has. Nothing is raised."""
        return [row for row in self.rows if row["controller"] == name]

    def without_effect(self) -> dict[str, list[str]]:
        """Mapping from the names of swept settings to lists of the names of the controllers whose results the setting
        does not change; settings that change the results of all are left out. It is found from runs that differ in that
        setting alone, as a grid has: their status is equal, and their columns `rms_error` and `largest_error`, of joint
        positions, differ by at most 1e-9 of their size; failed runs are left out. Nothing is raised."""
        swept = self.study.swept
        found = {x: [name for name in self.controllers if _is_idle(self.of_controller(name), x, swept)] for x in swept}
        return {setting: idle for setting, idle in found.items() if idle}

    def counts(self, rows: Sequence[dict[str, Any]]) -> dict[str, int]:
        """Numbers of `rows` by status: a mapping from "done", "diverged" and "failed" to how many rows have it. Nothing
        is raised."""
        return {status: sum(row["status"] == status for row in rows) for status in ("done", "diverged", "failed")}

    def worst(self, name: str) -> list[dict[str, Any]]:
        """Rows, at most 5, of the worst runs of the controller called `name`, mappings by column: those that diverged,
        the soonest first, then those with the largest root mean square position errors over the last two seconds (over
        all of a shorter run). Failed runs are left out. Nothing is raised."""

        def badness(row: dict[str, Any]) -> tuple[float, float]:
            gone = row["diverged_at"] if row["status"] == "diverged" else np.inf
            return gone, -(_error(row) or row["rms_error"] or 0.0)

        return sorted((row for row in self.of_controller(name) if row["status"] != "failed"), key=badness)[:WORST]

    def replay(self, row: dict[str, Any]) -> str:
        """Command line, as text for a shell, that runs the settings of a `row` again, with a recording in a folder
        below results/. Raises `NotFoundError` where the experiment is not built in."""
        words = ["adaptctl", "experiment", "run", self.study.experiment]
        for entry in fields(find(self.study.experiment)):
            value = row[entry.name]
            default = " ".join(map(str, entry.default)) if isinstance(entry.default, tuple) else entry.default
            if value != default:
                words += _flag(entry.name.replace("_", "-"), value, isinstance(entry.default, tuple))
        return shlex.join([*words, "--out", f"results/{self.study.experiment}-replay"])

    def maps(self, name: str) -> Iterator[SettingsMap]:
        """Iterator over maps of the outcomes of the controller called `name`, one `SettingsMap` for each pair of swept
        settings that are numbers, the one that the study names first across (x). Settings of more than 16 values are
        put together in 8 bins of equal width; failed runs are left out. Nothing is raised."""
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
        """List of the facts at the head of the report's page, a `Fact` each, a question with its answer in words: the
        numbers of runs and rows, the percentage of rows of status "done", and the numbers of those that diverged or
        failed. Nothing is raised."""
        counts, rows = self.counts(self.rows), len(self.rows)
        stable = f"{100 * counts['done'] / max(1, rows):.1f} %"
        numbers = (self.study.runs, rows, stable, counts["diverged"], counts["failed"])
        return [
            Fact(*pair)
            for pair in zip(("Runs", "Rows", "Stable", "Diverged", "Failed"), map(str, numbers), strict=True)
        ]

    def text(self) -> str:
        """The report as text of several lines for a terminal: for each controller the number of rows of each status,
        and the median and the largest of the root mean square position errors, rad or m, over the last two seconds of
        runs that are done (over all of a shorter one); up to 5 reasons of failed runs; and settings that change no
        result. Nothing is raised."""
        lines = [f"{self.study.experiment}: {len(self.rows)} rows of {self.study.runs} runs"]
        for name in self.controllers:
            rows = self.of_controller(name)
            errors = [size for row in rows if (size := _error(row)) is not None]
            summary = f"median error at the end {np.median(errors):.3g}, largest {max(errors):.3g}" if errors else ""
            counts = ", ".join(f"{count} {status}" for status, count in self.counts(rows).items() if count)
            lines.append(f"  {name or 'runs'}: {counts}; {summary}".rstrip("; "))
        failed = [row for row in self.rows if row["status"] == "failed"]
        for reason in list(dict.fromkeys(row["reason"] for row in failed))[:WORST]:
            lines.append(f"  failed: {reason}")
        for setting, idle in self.without_effect().items():
            whose = "" if len(idle) == len(self.controllers) else f" of {', '.join(idle)}"
            lines.append(f"  {setting} changes no result{whose}")
        return "\n".join(lines)


def _flag(name: str, value: object, many: bool) -> list[str]:
    """Words of a command line that give a setting its value."""
    if isinstance(value, bool):
        return [f"--{name}" if value else f"--no-{name}"]
    return [f"--{name}", *(str(value).split() if many else (str(value),))]


def _error(row: dict[str, Any]) -> float | None:
    """A run's error over its last two seconds, over all of a shorter one; None where it was not done."""
    if row["status"] != "done":
        return None
    found: float | None = row["rms_error" if row["final_rms_error"] is None else "final_rms_error"]
    return found


def write_report(path: Path) -> Path:
    """Write the report of the sweep in the folder `path` as an HTML page, report.html in that folder, and return the
    page's path. Raises `FileError` for a folder without a sweep or without a finished row, for files that cannot be
    read, and where the page cannot be written."""
    report = SweepReport.of(path)
    told = Section("What came of the runs", (Lines(report.text().splitlines()),))
    page = Report(
        experiment=report.study.experiment,
        title=f"Sweep of {report.study.experiment}",
        outcome=report.study.question or "Many runs of one experiment.",
        facts=report.facts(),
        sections=(told, *(_of_controller(report, name) for name in report.controllers)),
        about=f"{report.study.runs} runs",
    )
    figures = made_folder(path / FIGURES) if page.drawings else path
    write_text(path / "report.html", page.html(write_drawings(figures, page.drawings)))
    return path / "report.html"


def _of_controller(report: SweepReport, name: str) -> Section:
    """Maps of the settings, and the worst runs with the commands that repeat them."""
    maps = [
        Drawing(f"{name or 'runs'}-{k}", f"{name}: {shown.x} and {shown.y}", partial(map_figure, shown))
        for k, shown in enumerate(report.maps(name))
    ]
    columns = (*report.study.swept, "status", "final_rms_error")
    rows = [(*(str(row[column]) for column in columns), report.replay(row)) for row in report.worst(name)]
    heads = (*report.study.swept, "status", "error at the end", "command")
    title = "The worst, and how to see them again"
    worst = Table(heads, rows, title=title, align="l" * (len(heads) - 1) + "c")
    return Section(name or "Runs", (*maps, worst))


def map_figure(shown: SettingsMap) -> Figure:
    """Figure (Matplotlib) of the two maps in `shown` side by side, that of root mean square position errors, rad or m,
    and that of the fraction of stable runs, those of status "done". Nothing is checked."""
    canvas = sheet(3.5)
    titles = ("error at the end, rad or m", "share of stable runs")
    for axes, values, title in zip(canvas.subplots(1, 2), (shown.error, shown.stable), titles, strict=True):
        shares = {"vmin": 0.0, "vmax": 1.0} if title.startswith("share") else {}
        image = axes.imshow(values, origin="lower", aspect="auto", cmap="viridis", **shares)
        axes.set_xticks(range(len(shown.across)), [f"{value:.3g}" for value in shown.across], rotation=45)
        axes.set_yticks(range(len(shown.down)), [f"{value:.3g}" for value in shown.down])
        axes.set(xlabel=shown.x, ylabel=shown.y, title=title)
        axes.grid(visible=False)
        canvas.colorbar(image, ax=axes)
    return canvas


def _is_idle(rows: Sequence[dict[str, Any]], setting: str, swept: Sequence[str]) -> bool:
    """True if rows that differ in a setting alone have the same results, and there are such; failed ones have none."""
    groups: dict[Any, list[tuple[Any, Any]]] = {}
    for row in (row for row in rows if row["status"] != "failed"):
        others = tuple(row[name] for name in swept if name != setting)
        numbers = np.array([row["rms_error"], row["largest_error"]], dtype=np.float64)  # None is NaN
        groups.setdefault(others, []).append((row["status"], numbers))
    pairs = [(group[0], other) for group in groups.values() for other in group[1:]]
    return bool(pairs) and all(
        a[0] == b[0] and np.allclose(a[1], b[1], rtol=SAME, atol=0.0, equal_nan=True) for a, b in pairs
    )


def _binned(values: list[Any]) -> list[Any]:
    """Lower ends of the bins of a map's side: the values themselves where they are few."""
    different = sorted(set(values))
    if len(different) <= 2 * BINS:
        return different
    return np.linspace(different[0], different[-1], BINS + 1)[:-1].tolist()


def _bin(value: Any, lower: list[Any]) -> int:
    return int(np.searchsorted(lower, value, side="right")) - 1
