"""Results of `make contest` in the documentation: tables, figures, and the contest's own page."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.contest.conditions import CONDITIONS
from adaptctl.contest.contest_file import Contest
from adaptctl.contest.page import short
from adaptctl.contest.ranking import ALL, Ranking
from adaptctl.contest.resampling import median
from adaptctl.contest.running import RESULTS, rows_of_table
from adaptctl.files import write_text
from adaptctl.sweeps.folder import read_checked
from benchmarks.published import inserted, table

ROOT = Path(__file__).resolve().parents[2]
DOCS, ASKED = ROOT / "docs", ROOT / "benchmarks" / "contest.toml"
PAGE, KEPT, COMMAND = DOCS / "contest.md", DOCS / "_static" / "contest.html", "make contest"
JUDGED_PAGE = DOCS / "adaptation.md"
JUDGED_HEAD = (
    "condition",
    "true, mrad",
    "learning, mrad",
    "over true",
    "over gradient",
    "over PD with gravity",
    "failed",
)
HEAD = "law", "knows", "rank", "mrad", "over the true model", "over PD with gravity", "failed"


def publish(folder: Path) -> None:
    """Keep the page and the figure of a contest, and show its ranks."""
    contest = Contest.of(ASKED)
    ranking = Ranking(rows_of_table(read_checked(folder / RESULTS)), contest.families, contest.error_unit)
    write_text(KEPT, (folder / "index.html").read_text(encoding="utf-8"))
    write_text(DOCS / "images" / "contest-ranks.svg", (folder / "figures" / "ranks.svg").read_text())
    told = "\n".join((_told(ranking, contest), "", ranks(row for row in ranking.table() if row["condition"] == ALL)))
    write_text(PAGE, inserted(PAGE.read_text(encoding="utf-8"), told, COMMAND))


def ranks(rows: Iterable[Mapping[str, Any]]) -> str:
    """Table of laws in the order of their ranks, in Markdown."""
    return table(HEAD, map(_row, rows))


def _row(row: Mapping[str, Any]) -> tuple[str, ...]:
    over = (f"{short(row[name])} [{short(row[f'{name}_low'])}, {short(row[f'{name}_high'])}]" for name in
            ("over_true", "over_pd_gravity"))  # fmt: skip
    failed = f"{row['failed']} of {row['runs']}"
    return f"`{row['law']}`", row["knows"], f"{row['rank']:.2f}", short(row["error"]), *over, failed


def _told(ranking: Ranking, contest: Contest) -> str:
    counts = ", ".join(f"{len(getattr(ranking, name))} {name}" for name in ("laws", "robots", "conditions", "seeds"))
    return (
        f"{counts}. Ranks that differ by less than {ranking.critical_difference:.2f} may be due to chance.\n"
        f"Between two halves of the seeds: {ranking.halves()}. The set's hash: `{contest.scoring_hash[:16]}…`."
    )


def publish_judged(folder: Path) -> None:
    """Show how the default law does under each condition, beside the gradient, PD and the true model."""
    ranking = Ranking(rows_of_table(read_checked(folder / RESULTS)))
    lines = table(JUDGED_HEAD, (_judged(ranking, name) for name in ranking.conditions))
    write_text(JUDGED_PAGE, inserted(JUDGED_PAGE.read_text(encoding="utf-8"), lines, COMMAND))


def _judged(ranking: Ranking, condition: str) -> tuple[str, ...]:
    at, of = ranking.conditions.index(condition), {law: ranking.errors[k] for k, law in enumerate(ranking.laws)}
    errors = {law: found[:, at].ravel() for law, found in of.items()}
    medians = (short(float(median(errors[law]))) for law in ("true", "learning"))
    failed = "/".join(str(np.count_nonzero(np.isinf(errors[law]))) for law in ("learning", "true", "gradient"))
    over = (_ratio(errors["learning"], errors[law]) for law in ("true", "gradient", "pd-gravity"))
    return CONDITIONS[condition].meaning, *medians, *over, failed


def _ratio(one: Array, other: Array) -> str:
    """Median and largest ratio of runs of which neither failed."""
    both = np.isfinite(one) & np.isfinite(other)
    ratios = one[both] / other[both]
    return f"{np.median(ratios):.2g} ({ratios.max():.2g})"


if __name__ == "__main__":
    publish(Path(sys.argv[1]))
    publish_judged(Path(sys.argv[2]))
