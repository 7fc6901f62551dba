"""Logs of one fault each, and the words of the documentation that name it."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import faulty_logs
import numpy as np
import pytest
from faulty_logs import FAULTS, pattern, put, told
from nightly import mostly_at_night, nightly

from adaptctl.description.drive import Drive

PAGE = Path(__file__).parents[1] / "docs" / "identification.md"
LINKS, SEED, HEAVY = 3, 7, 120.0


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


@nightly
def test_a_sign_that_turns_is_told_of_one_joint_of_many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kind = "a sign that turns"
    monkeypatch.setattr(faulty_logs, "JOINT", 6)
    half = partial(put, what="torque", rows=slice(2000, None), value=np.negative)
    monkeypatch.setitem(FAULTS, kind, (half, ""))
    assert re.search(
        r"column 'torque.joint6' has the other sign from (10|9[.]9)[.0-9]* s on", told(7, kind, tmp_path, 5)
    )


@nightly
def test_a_sign_that_turns_is_told_of_a_joint_whose_friction_outweighs_its_links(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(faulty_logs, "Drive", lambda *_: Drive(0.1, 2.0, HEAVY))
    kind, early = "a sign that turns", partial(put, what="torque", rows=slice(1600, None), value=np.negative)
    monkeypatch.setitem(FAULTS, kind, (early, "column 'torque.{two}' has the other sign from (8|7[.]9)[.0-9]* s on"))
    assert re.search(pattern(LINKS, kind, SEED), told(LINKS, kind, tmp_path, SEED))


def test_a_right_log_is_told_nothing(tmp_path: Path) -> None:
    assert told(LINKS, "", tmp_path, SEED) == ""
