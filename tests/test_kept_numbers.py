"""What laws and short runs compute, and what rules choose, compared with what is kept in tests/golden."""

from __future__ import annotations

import pytest
from golden import capture, rules, runs
from golden.kept import kept, validate_same

LONG = ("target inertia",)
"""Laws whose check takes longer than all others do"""
LAWS = [f"two: {law}" for law in capture.arms()["two"] if law not in LONG]


@pytest.mark.parametrize("name", ["three: gradient", "three: linear", *LAWS])
def test_exported_c_is_the_one_kept(name: str) -> None:
    """But for what was recorded: its last digits are this processor's."""
    arm, law = name.split(": ")
    own = {"vectors.h": kept("exports")[name]["vectors.h"]}
    validate_same(kept("exports")[name], capture.exported(capture.arms()[arm][law]) | own)


def test_exported_c_of_single_numbers_is_the_one_kept() -> None:
    name = "three: gradient, float"
    own = {"vectors.h": kept("exports")[name]["vectors.h"]}
    validate_same(kept("exports")[name], capture.exported(capture.arms()["three"]["gradient"], scalar="float") | own)


@pytest.mark.filterwarnings("ignore:.*adaptation gain:adaptctl.errors.TuningWarning")
@pytest.mark.parametrize("name", rules.ARMS)
def test_gains_and_references_are_those_kept(name: str) -> None:
    validate_same({name: kept("rules")[name]}, {name: rules.chosen_and_designed(name)})


@pytest.mark.parametrize("name", runs.RUNS)
def test_short_runs_compute_what_is_kept(name: str) -> None:
    validate_same({name: kept("runs")[name]}, {name: runs.RUNS[name]()})
