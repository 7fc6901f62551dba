"""Logs of one fault each, and the words of the documentation that name it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from faulty_logs import FAULTS, pattern, told
from nightly import mostly_at_night, nightly

PAGE = Path(__file__).parents[1] / "docs" / "identification.md"
LINKS, SEED = 3, 7


def words() -> dict[str, str]:
    """Words of the page's table by fault."""
    table = PAGE.read_text(encoding="utf-8").split("### Faults and their words")[1].split("|---|---|---|")[1]
    rows = (line.split(" | ") for line in table.strip().split("\n\n")[0].splitlines())
    return {row[0].removeprefix("| ").split(",")[0]: row[1] for row in rows}


def test_the_page_lists_each_fault_in_the_words_that_name_it() -> None:
    said = words()
    assert sorted(said) == sorted(FAULTS)
    for kind, (_, own) in FAULTS.items():
        assert re.search(own.replace("{two}", "j2").replace("{three}", "j3"), said[kind]), kind


@pytest.mark.parametrize("kind", mostly_at_night(FAULTS, "mA for N m", "a mirrored joint"))
def test_a_log_with_a_fault_is_told_it(kind: str, tmp_path: Path) -> None:
    assert re.search(pattern(LINKS, kind, SEED), told(LINKS, kind, tmp_path, SEED))


@nightly
def test_the_sign_of_all_torques_is_told_among_many_meanings_that_least_squares_does_not_tell_apart(
    tmp_path: Path,
) -> None:
    kind = "sign of all torques"
    assert re.search(pattern(6, kind, SEED), told(6, kind, tmp_path, SEED))


def test_a_right_log_is_told_nothing(tmp_path: Path) -> None:
    assert told(LINKS, "", tmp_path, SEED) == ""
