"""Page of a contest, in one file that opens from the file system."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from adaptctl.contest.conditions import CONDITIONS
from adaptctl.contest.contest_file import Contest
from adaptctl.contest.laws import PD_GRAVITY, TRUE_MODEL
from adaptctl.contest.ranking import ALL, Ranking
from adaptctl.files import write_text
from adaptctl.optional_packages import needed
from adaptctl.recording.colors import PAPER, Color
from adaptctl.version import __version__

HEADS = (
    *("law", "rank", "{unit}", "over true model", "over PD with gravity", "{unit} at 2 s", "10 s", "20 s", "failed"),
    *("return, s", "torque error, unseen motion", "torque", "its rate, 1/s", "saturated", "operations"),
    *("knows", "gains", "how it fails"),
)
TIME_HEADS = {"step": "step, µs", "compilation": "to compile, s", "making": "to make, tuning included, s"}
CITATION = "Adaptctl: adaptive control of robot mechanisms on minimal inertial parameters (CITATION.cff)."
SETS = "law", "robot", "condition", "seed"
GOOD, BAD, LOST = Color(96, 165, 230), Color(240, 150, 80), Color(214, 196, 214)
"""Colors of a hundredth and a hundredfold error, and of failures."""
DECADES = 2.0
"""Decades from 1 at which colors are full."""


Times: TypeAlias = Mapping[str, Mapping[str, float]]


class PageCell(NamedTuple):
    """Cell of a table: its text, what it is sorted by, a note and a color."""

    text: str
    value: float | str = ""
    note: str = ""
    color: str = ""
    words: bool = False


def short(value: float) -> str:
    """Number with three digits, a dash where there is none."""
    if math.isnan(value) or math.isinf(value):
        return "–" if math.isnan(value) else "∞"
    return f"{digits(value):,.0f}" if abs(value) >= 1e3 else f"{value:.3g}"


def write_page(
    path: Path, contest: Contest, ranking: Ranking, table: list[dict[str, Any]], times: Times = MappingProxyType({})
) -> None:
    """Write the page of a contest with these ranks and, if any, the times of its laws."""
    with needed("the page of a contest"):
        import jinja2
    template = jinja2.Environment(autoescape=True).from_string(Path(__file__).with_suffix(".html").read_text())
    told = content(contest, ranking, table, times)
    write_text(path, template.render(told, data=_data(contest, ranking), folder=shlex.quote(str(path.parent))))


def content(contest: Contest, ranking: Ranking, table: list[dict[str, Any]], times: Times) -> dict[str, Any]:
    """Names of the template and their values."""
    asked, conditions, unit = contest.asked, ranking.conditions, ranking.error_unit
    own = {(row["law"], row["condition"]): row for row in table}
    over = next((name for name in (TRUE_MODEL, PD_GRAVITY) if name in ranking.laws), None)
    return {
        "title": f"Contest of {len(ranking.laws)} laws",
        "purpose": asked.purpose,
        "told": ", ".join(_counted(name, len(getattr(ranking, f"{name}s"))) for name in SETS)
        + f"; {asked.duration:g} s each, plant: {asked.plant}.",
        "difference": f"Differences below {short(ranking.critical_difference)} are not significant (Nemenyi, 5 %)."
        + (f" Between two halves of the seeds: {halves}." if (halves := ranking.halves()) else ""),
        "heads": (*(head.format(unit=unit) for head in HEADS), *(TIME_HEADS.values() if times else ())),
        "rows": [
            {"name": law, "cells": [*_cells(own[law, ALL]), *_timed(times.get(law, {}))]} for law in ranking.order
        ],
        "map_told": f"Median error over that of {over} in equal runs." if over else f"Median error in {unit}.",
        "unit": unit,
        "conditions": [{"name": name, "meaning": CONDITIONS[name].meaning} for name in conditions],
        "cells": [{"name": law, "cells": [_mapped(own[law, x], over) for x in conditions]} for law in ranking.laws],
        "robots": ", ".join(ranking.robots),
        "command": _command(contest),
        "version": __version__,
        "hash": contest.scoring_hash,
        "citation": CITATION,
    }


def _counted(name: str, count: int) -> str:
    return f"{count} {name}" if count == 1 else f"{count} {name}s"


def _cells(row: dict[str, Any]) -> list[PageCell]:
    """Cells of a law's row beside its name."""
    plain = [PageCell(short(row[name]), row[name]) for name in ("error_2_s", "error_10_s", "error_20_s")]
    after = "return_time", "unseen", "torque", "torque_rate", "saturated"
    rest = [PageCell(short(row[name]), row[name]) for name in after]
    return [
        PageCell(f"{row['rank']:.2f}", row["rank"]),
        PageCell(short(row["error"]), row["error"]),
        _over(row, "over_true"),
        _over(row, "over_pd_gravity"),
        *plain,
        PageCell(f"{row['failed']} of {row['runs']}", row["failed"]),
        *rest,
        PageCell(f"{row['operations']:,}", row["operations"]),
        *(PageCell(row[name], row[name]) for name in ("knows", "gains")),
        PageCell(row["failure"], row["failure"], words=True),
    ]


def _timed(times: Mapping[str, float]) -> list[PageCell]:
    """Cells of a law's times, if they were taken."""
    return [PageCell(short(times[name]), times[name]) for name in TIME_HEADS if times]


def _over(row: dict[str, Any], name: str) -> PageCell:
    ends = row[f"{name}_low"], row[f"{name}_high"]
    note = "" if math.isnan(ends[0]) else f"[{short(ends[0])}, {short(ends[1])}]"
    return PageCell(short(row[name]), row[name], note)


def _mapped(row: dict[str, Any], over: str | None) -> PageCell:
    """Cell of the map of a law under a condition."""
    value = row[{TRUE_MODEL: "over_true", PD_GRAVITY: "over_pd_gravity", None: "error"}[over]]
    note = f"{row['failed']} of {row['runs']} failed" if row["failed"] else ""
    return PageCell(short(value), value, note, tint(value, over is not None).hex)


def tint(value: float, is_ratio: bool) -> Color:
    """Background of a ratio: blue below 1, orange above; violet where there is none."""
    if not math.isfinite(value) or value <= 0.0:
        return LOST
    share = min(1.0, abs(math.log10(value)) / DECADES) if is_ratio else 0.0
    return PAPER.faded(0.08 + 0.92 * share, GOOD if value < 1.0 else BAD)


def _command(contest: Contest) -> str:
    """Command of a contest, but for its folder."""
    return f"adaptctl contest {shlex.quote(str(contest.source))}"


def _data(contest: Contest, ranking: Ranking) -> Any:
    """Runs behind the cells as JSON, which no text in it can end."""
    from markupsafe import Markup

    runs, curves = _runs(ranking), _curves(ranking)
    told = {
        **{name: getattr(ranking, name) for name in ("laws", "robots", "conditions", "seeds")},
        "runs": runs,
        "curves": curves,
        "others": [ranking.laws.index(name) for name in (TRUE_MODEL, PD_GRAVITY) if name in ranking.laws],
        "duration": contest.asked.duration,
        "command": _command(contest),
    }
    return Markup(json.dumps(told, separators=(",", ":")).replace("<", "\\u003c"))  # escaped here


def _shape(ranking: Ranking, blank: Any) -> list[Any]:
    axes = ranking.laws, ranking.robots, ranking.conditions
    return [[[blank() for _ in axes[2]] for _ in axes[1]] for _ in axes[0]]


def _places(ranking: Ranking, row: dict[str, Any]) -> tuple[int, int, int]:
    return (
        ranking.laws.index(row["law"]),
        ranking.robots.index(row["robot"]),
        ranking.conditions.index(row["condition"]),
    )


def _runs(ranking: Ranking) -> list[Any]:
    """Error of each run with three digits, or the reason of its failure, by law, robot, condition and seed."""
    found = _shape(ranking, lambda: [None] * len(ranking.seeds))
    for row in ranking.rows:
        i, j, k = _places(ranking, row)
        found[i][j][k][ranking.seeds.index(row["seed"])] = row["reason"] or digits(row["error"])
    return found


def _curves(ranking: Ranking) -> list[Any]:
    """Median courses over seeds, by law, robot and condition."""
    kept = _shape(ranking, list)
    for row in ranking.rows:
        if not row["reason"]:
            i, j, k = _places(ranking, row)
            kept[i][j][k].append(row["curve"])
    return [[[[digits(x) for x in np.median(one, axis=0)] if one else [] for one in b] for b in a] for a in kept]


def digits(value: float) -> float:
    """Number rounded to three digits."""
    return float(f"{value:.3g}")
