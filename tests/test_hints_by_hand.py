"""Hints of the command line: which words belong together, which commands have a flag, and what angles change."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from adaptctl.cli import robot
from adaptctl.cli.main import app
from adaptctl.cli.refusals import _commands_with, _joined
from adaptctl.cli.robot import MAX_RANKED, note_on
from adaptctl.description import builtin_file, read
from adaptctl.errors import RankError, RoundedAnglesWarning
from adaptctl.identifiability.proof import exact_energies


@pytest.mark.parametrize(
    ("given", "words", "joined"),
    [
        ("--friction viscous coulomb", "coulomb", "--friction viscous,coulomb."),
        (
            "identify a.csv --friction viscous coulomb spring --json",
            "coulomb spring",
            "--friction viscous,coulomb,spring.",
        ),
        ("--json viscous coulomb", "spring", ""),
        ("identify a.csv coulomb", "coulomb", ""),
        ("--friction --json coulomb", "coulomb", ""),
        ("a coulomb", "coulomb", ""),
    ],
)
def test_words_after_the_value_of_a_flag_are_more_of_its_values(given: str, words: str, joined: str) -> None:
    hint = _joined(words.split(), given.split())
    assert hint.endswith(joined)
    assert bool(hint) == bool(joined)


def test_commands_are_found_by_their_flags() -> None:
    assert list(_commands_with("--poles", app)) == ["gains"]
    assert list(_commands_with("--without-safety-filter", app)) == ["export"]
    assert not list(_commands_with("--help", app))  # which is no argument of any
    assert {"tune", "gains", "export"} < set(_commands_with("--control-period", app))


def described(rank: int, parameters: int = MAX_RANKED, loops: Any = None) -> Any:
    return SimpleNamespace(rank=rank, num_energy_parameters=parameters, loops=loops)


@pytest.mark.parametrize(
    ("meant", "written", "told"),
    [
        (described(36), described(38), "a tilt: rank 36; --as-written for 38"),
        (described(36), described(36), "a tilt; --as-written keeps them"),
        (described(36), described(38, MAX_RANKED + 1), "a tilt; --as-written keeps them"),
        (described(36, loops=()), described(38), "a tilt; --as-written keeps them"),
        (described(36), described(-1), "a tilt; --as-written keeps them"),
    ],
)
def test_a_note_on_rounded_angles_has_both_ranks_where_they_are_known_and_differ(
    meant: Any, written: Any, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ranked(description: Any, strict: bool) -> Any:
        assert strict
        if description.rank < 0:
            raise RankError("not certain")
        return description

    monkeypatch.setattr("adaptctl.dynamics.Mechanism", lambda description: description)
    monkeypatch.setattr(exact_energies, "ExactEnergies", ranked)
    assert note_on(RoundedAnglesWarning("a tilt", written, meant)) == told


def test_the_rank_of_a_note_is_exact() -> None:
    assert robot._rank(read(builtin_file("puma560_measured"))) == 36
    assert note_on(UserWarning("as it is")) == "as it is"
