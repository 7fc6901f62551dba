"""The contest in the documentation is of the set that is judged on now, and its runs can be repeated."""

from __future__ import annotations

import html
import json
import re
from typing import Any

import numpy as np
import pytest

from adaptctl.contest.contest_file import Contest
from adaptctl.contest.entries import ContestEntry
from adaptctl.contest.running import ContestFolder
from docs.making.contest import ASKED, KEPT, PAGE, ROOT

pytestmark = pytest.mark.filterwarnings("ignore::adaptctl.errors.RoundedAnglesWarning")
TEXT = KEPT.read_text(encoding="utf-8")


def table() -> dict[str, list[str]]:
    """Cells of each law in the contest's own page."""
    rows = re.findall(r'<tr><th scope="row">([^<]*)</th>(.*?)</tr>', TEXT.partition('id="map"')[0], re.DOTALL)
    found = {law: re.findall(r"<td[^>]*>(.*?)</td>", cells) for law, cells in rows}
    return {law: [html.unescape(re.sub("<small>.*?</small>", "", x)) for x in cells] for law, cells in found.items()}


def test_the_published_contest_is_of_the_set_that_is_judged_on_now() -> None:
    contest = Contest.of(ASKED)
    assert contest.scoring_hash in TEXT
    assert set(table()) == set(contest.asked.laws)
    assert len(TEXT) < 3e6


def test_the_documented_ranks_are_those_of_the_contests_page() -> None:
    lines = [line.split(" | ") for line in PAGE.read_text().splitlines() if line.startswith("| `")]
    rows = [(law[3:-1], *rest[1:3], rest[-1].removesuffix(" |")) for law, *rest in lines if len(rest) == 6]
    cells = table()
    assert [law for law, *_ in rows if law in cells] == list(cells)
    for law, rank, error, failed in rows:
        if law in cells:
            assert [rank, error] == cells[law][:2]
            assert failed == cells[law][7]


def test_the_figure_shows_every_law() -> None:
    shown = (ROOT / "docs" / "images" / "contest-ranks.svg").read_text()
    assert all(f">{law}<" in shown or f"<!-- {law} -->" in shown for law in table())


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("law", "robot", "condition"), [("gradient", "ur3_robot", "clean"), ("learning", "so101", "push")]
)
def test_a_published_run_can_be_repeated(law: str, robot: str, condition: str) -> None:
    told: dict[str, Any] = json.loads(re.findall(r'id="data">(.*?)</script>', TEXT, re.DOTALL)[0])
    at = told["laws"].index(law), told["robots"].index(robot), told["conditions"].index(condition)
    published = told["runs"][at[0]][at[1]][at[2]]
    contest = Contest.of(ASKED).only({"law": law, "robot": robot, "condition": condition})
    entry: ContestEntry = ContestFolder(ROOT / "unused", contest).entries()[0]
    np.testing.assert_allclose([row["error"] for row in entry.rows()], published, rtol=0.01)
