"""Figures and a table of a contest for a paper: a column wide, as PDF, SVG, PNG and LaTeX."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.contest.laws import PD_GRAVITY, TRUE_MODEL
from adaptctl.contest.page import short, tint
from adaptctl.contest.ranking import ALL, Ranking
from adaptctl.files import write_text
from adaptctl.folders import made_folder
from adaptctl.recording.colors import INK, MUTED
from adaptctl.recording.drawing import COLUMN_WIDTH, Drawing, run_style, write_for_paper
from adaptctl.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES, TABLE, CITATION = "figures", "table.tex", "cite.bib"
MAX_CURVES, PANEL_COLUMNS = 6, 2
"""laws whose errors are drawn over time, the first in rank, and panels in a row"""


def write_paper(folder: Path, ranking: Ranking, table: list[dict[str, Any]], duration: float) -> None:
    """Write the figures, a LaTeX table of the ranks, and what to cite."""
    made_folder(folder / FIGURES)
    write_for_paper(folder / FIGURES, drawings(ranking, table, duration))
    write_text(folder / TABLE, latex(table, ranking.error_unit))
    entry = "@software{adaptctl,\n  title = {adaptctl},\n  author = {{The adaptctl developers}},\n"
    write_text(folder / CITATION, f"{entry}  version = {{{__version__}}},\n}}\n")


def drawings(ranking: Ranking, table: list[dict[str, Any]], duration: float) -> Iterator[Drawing]:
    """Figures of a contest: ranks, law by condition, and errors over time."""
    if len(ranking.laws) > 1:
        yield Drawing("ranks", "Mean ranks; a bar as long as the critical difference.", partial(ranks, ranking))
    yield Drawing("map", "Errors by law and condition.", partial(law_by_condition, ranking, table))
    yield Drawing("course", "Median errors over time.", partial(course, ranking, duration))


def _figure(height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(COLUMN_WIDTH, height), layout="constrained")


def ranks(ranking: Ranking) -> Figure:
    """Mean ranks from the best to the worst, and the critical difference (Demšar 2006)."""
    order = ranking.order
    values = [float(ranking.mean_ranks[ranking.laws.index(law)]) for law in order]
    figure = _figure(0.75 + 0.17 * len(order))
    axes = figure.subplots()
    rows = np.arange(len(order))
    axes.hlines(rows, 0.0, values, color=MUTED.hex, linewidth=0.8)
    axes.plot(values, rows, "o", color=INK.hex, markersize=4)
    end = values[0] + ranking.critical_difference
    axes.plot([values[0], end], [-1.0, -1.0], color=INK.hex, linewidth=2.0, solid_capstyle="butt")
    axes.text(end, -1.0, f"  CD {short(ranking.critical_difference)}", va="center", size=7)
    axes.set_yticks(rows, order)
    axes.set_ylim(len(order) - 0.4, -1.6)
    axes.set_xlim(0.0, max(len(order) + 0.5, 1.35 * end))
    axes.set_xlabel("mean rank")
    axes.grid(visible=False, axis="y")
    return figure


def law_by_condition(ranking: Ranking, table: list[dict[str, Any]]) -> Figure:
    """Errors of laws under conditions, over the true-model controller or PD with gravity if they are there."""
    names = {TRUE_MODEL: "over_true", PD_GRAVITY: "over_pd_gravity"}
    over = next((name for name in names if name in ranking.laws), None)
    column = names[over] if over else "error"
    found = {(row["law"], row["condition"]): row for row in table}
    laws, conditions = ranking.order, ranking.conditions
    figure = _figure(0.9 + 0.19 * len(laws))
    axes = figure.subplots()
    for i, law in enumerate(laws):
        for j, name in enumerate(conditions):
            value = found[law, name][column]
            color = tint(value, over is not None).hex
            axes.fill([j - 0.5, j + 0.5, j + 0.5, j - 0.5], [i - 0.5, i - 0.5, i + 0.5, i + 0.5], color=color)
            axes.text(j, i, short(value), ha="center", va="center", size=min(6.5, 26.0 / len(conditions)))
    axes.set_yticks(range(len(laws)), laws)
    axes.set_xticks(range(len(conditions)), conditions, rotation=45, ha="right", rotation_mode="anchor")
    axes.set_xlim(-0.5, len(conditions) - 0.5)
    axes.set_ylim(len(laws) - 0.5, -0.5)
    axes.grid(visible=False)
    axes.set_title(f"median error over that of {over}" if over else f"median error [{ranking.error_unit}]", size=8)
    return figure


def course(ranking: Ranking, duration: float) -> Figure:
    """Median errors over time, a panel for each condition."""
    conditions, ran = ranking.conditions, {row["law"] for row in ranking.rows if not row["reason"]}
    laws = [law for law in ranking.order if law in ran][:MAX_CURVES]
    columns = min(PANEL_COLUMNS, len(conditions))
    lines = -(-len(conditions) // columns)
    figure = _figure(0.7 + 1.1 * lines)
    panels = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, name in zip(panels, conditions, strict=False):
        for k, law in enumerate(laws):
            values = _median_course(ranking, law, name)
            times = duration * (np.arange(len(values)) + 0.5) / max(1, len(values))
            axes.semilogy(times, values, label=law, **{**run_style(k), "linewidth": 1.0})
        axes.set_title(name, size=7)
    for unused in panels[len(conditions) :]:
        unused.set_visible(False)
    for axes in panels[len(conditions) - columns : len(conditions)]:
        axes.set_xlabel("time [s]")
        axes.tick_params(labelbottom=True)
    figure.supylabel(f"median RMS error [{ranking.error_unit}]", size=8)
    if laws:
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=6.5)
    return figure


def _median_course(ranking: Ranking, law: str, condition: str) -> Array:
    chosen = [r["curve"] for r in ranking.rows if (r["law"], r["condition"]) == (law, condition) and not r["reason"]]
    return np.median(chosen, axis=0) if chosen else np.empty(0)


def latex(table: list[dict[str, Any]], unit: str) -> str:
    """Table of the ranks in LaTeX, for the package booktabs."""
    rows = [row for row in table if row["condition"] == ALL]
    heads = ("law", "knows", "rank", f"error [{unit}]", "over true model", "over PD with gravity", "failed")
    body = [
        (
            *(_escaped(row[name]) for name in ("law", "knows")),
            f"{row['rank']:.2f}",
            _number(row["error"]),
            *(_interval(row, name) for name in ("over_true", "over_pd_gravity")),
            f"{row['failed']} of {row['runs']}",
        )
        for row in rows
    ]
    lines = [" & ".join(line) + r" \\" for line in body]
    top = [r"\begin{tabular}{llrrrrr}", r"\toprule", " & ".join(heads) + r" \\", r"\midrule"]
    return "\n".join(["% needs \\usepackage{booktabs}", *top, *lines, r"\bottomrule", r"\end{tabular}", ""])


def _interval(row: dict[str, Any], name: str) -> str:
    value, low, high = (_number(row[f"{name}{end}"]) for end in ("", "_low", "_high"))
    return value if value == "--" else f"{value} [{low}, {high}]"


def _number(value: float) -> str:
    """Number with three digits in LaTeX."""
    if math.isnan(value):
        return "--"
    if math.isinf(value):
        return r"$\infty$"
    mantissa, _, exponent = f"{value:.3g}".partition("e")
    return rf"${mantissa}\times10^{{{int(exponent)}}}$" if exponent else mantissa


def _escaped(text: str) -> str:
    return re.sub(r"([&%$#_{}])", r"\\\1", text)
