"""Colours mean the same in recordings, figures and reports."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import pytest
from comparisons import comparison

from adaptctl.dynamics import load
from adaptctl.experiments.disturbed_arm import LAWS
from adaptctl.recording import Comparison
from adaptctl.recording.colors import GOAL, JOINT_COLORS, LIMIT, RUN_COLORS, Color, run_color
from adaptctl.recording.comparison import color_indices
from adaptctl.recording.drawing import run_style
from adaptctl.recording.report import report


@pytest.fixture(scope="module")
def two() -> Comparison:
    return comparison(load("two_link"), samples=1200)


def apart(one: Color, other: Color) -> float:
    return float(sum((a - b) ** 2 for a, b in zip(one, other, strict=True)) ** 0.5)


def test_adaptation_off_is_orange_wherever_it_stands(two: Comparison) -> None:
    learning, off = two.runs
    others = tuple(replace(learning, name=f"other-{i}", label=f"Other {i}") for i in range(9))
    for runs in ((learning, off, *others), (learning, *others, off)):
        places = replace(two, runs=runs).color_indices
        assert places["adaptive"] == 0
        assert places["adaptation-off"] == 1
        assert [places[run.name] for run in others] == list(range(2, 11))
    assert color_indices((learning, *others))["other-0"] == 2  # orange stays what it is
    assert color_indices((off, *others)) == {"adaptation-off": 0} | {run.name: i for i, run in enumerate(others, 1)}


def test_a_report_shows_each_run_in_its_own_colour(two: Comparison) -> None:
    learning, off = two.runs
    other = replace(learning, name="other", label="Another law")
    page = report(replace(two, runs=(learning, other, off))).html({})
    for place, label in enumerate(("Slotine-Li, &lt;learning&gt;", "Slotine-Li, adaptation off", "Another law")):
        assert f'style="background: {run_color(place).hex}"></i>{label}' in page


def test_so_many_controllers_as_are_compared_can_be_told_apart() -> None:
    assert len(RUN_COLORS) >= len(LAWS)
    for palette in (RUN_COLORS, (*JOINT_COLORS, GOAL, LIMIT)):
        assert min(apart(a, b) for a, b in combinations(palette, 2)) > 30.0


def test_a_color_fades_towards_another_by_a_share() -> None:
    one, other = Color(10, 200, 30), Color(110, 0, 30)
    assert [one.faded(share, other) for share in (0.0, 0.25, 1.0)] == [one, (35, 150, 30), other]


def test_curves_are_dashed_from_the_sixth_run_on() -> None:
    assert [run_style(k)["linestyle"] == "-" for k in range(8)] == [True] * 5 + [False] * 3
    begin, (dash, gap) = run_style(5)["linestyle"]
    assert begin == 0 < gap < dash
    assert [run_style(k)["color"] for k in range(8)] == [run_color(k).hex for k in range(8)]
