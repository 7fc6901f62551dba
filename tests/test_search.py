"""A search over a study's settings: which controller runs, and a file of what it found that is read as it was."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import nightly

from adaptctl.errors import InputError
from adaptctl.files import toml_string
from adaptctl.sweeps.search import BestSettings, search, write_settings
from adaptctl.sweeps.study import SweepStudy

SHORT = {"duration": "0.05"}


@nightly
def test_a_search_whose_first_runs_fail_runs_the_first_controller_that_there_is() -> None:
    """No bandwidth but one is slow enough for the control period, so that few runs have a controller to tell of."""
    study = SweepStudy.named("puma560-adaptive", {**SHORT, "bandwidth": "4000,3000,2000,1000,4"})
    found = search(study, "rms_error", 10)
    assert found.settings["bandwidth"] == 4.0
    assert found.controller == "learning"


def test_a_search_of_runs_that_all_fail_says_so() -> None:
    study = SweepStudy.named("puma560-adaptive", {**SHORT, "bandwidth": "1000,2000"})
    with pytest.raises(InputError, match="none of 3 runs of puma560-adaptive completed with a value of rms_error"):
        search(study, "rms_error", 3)


def test_what_was_found_is_read_as_it_was(tmp_path: Path) -> None:
    settings = {
        "robot": 'C:\\arms, "old" and new\\arm.toml ',
        "laws": ("gradient", "composite"),
        "duration": 0.1,
        "seed": 3,
    }
    study = SweepStudy.named("laws", {}, precision="single")
    write_settings(tmp_path / "best.toml", study, BestSettings(settings, "composite", 1.0, 4))
    again = SweepStudy.named(str(tmp_path / "best.toml"), {})
    assert list(again.runs()) == [settings]
    assert (again.experiment, again.controllers, again.precision) == ("laws", ("composite",), "single")


@given(st.text())
def test_a_string_of_toml_is_read_as_the_text(text: str) -> None:
    assert tomllib.loads(f"text = {toml_string(text)}")["text"] == text
