"""Numbers, errors and outcomes in the words of reports."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from comparisons import PERIOD, comparison

from adaptctl.dynamics import load
from adaptctl.recording import Comparison
from adaptctl.recording.judgement import facts, outcome, outcome_words
from adaptctl.recording.wording import error, number, scientific


@pytest.fixture(scope="module")
def shown() -> Comparison:
    return comparison(load("puma560_measured"))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.0, "0"),
        (0.786, "0.786"),
        (1234.5, "1234"),
        (2.5e-14, "2.50·10⁻¹⁴"),
        (-3.21, "-3.21"),
        (1e6, "1.00·10⁶"),
        (999.4, "999"),
        (999.9, "1000"),
        (-999.9, "-1000"),
        (1000.1, "1000"),
        (99.96, "100"),
        (99999.9, "100000"),
        (9.996e-5, "1.00·10⁻⁴"),
        (math.nan, "not a number"),
        (math.inf, "infinity"),
        (-math.inf, "minus infinity"),
    ],
)
def test_numbers_read_well(value: float | None, text: str) -> None:
    assert number(value) == text


@pytest.mark.parametrize("digits", [1, 2, 4, 5, 6])
def test_numbers_just_below_a_power_of_ten_read_as_it_does(digits: int) -> None:
    for exponent in range(-3, 5):
        assert number(10.0**exponent * (1.0 - 1e-9), digits) == f"{10.0**exponent:.12g}"


def test_errors_that_are_no_numbers_have_no_unit() -> None:
    assert (error(math.nan, "mrad"), error(math.inf, "mm")) == ("not a number", "infinity")
    assert (error(0.9999, "mrad"), scientific(math.nan)) == ("1000 mrad", "not a number")


def test_outcomes_read_well(shown: Comparison) -> None:
    run = shown.subject
    assert outcome(run) == "completed"
    assert outcome(replace(run, rollout=replace(run.rollout, interrupted=True))) == "interrupted at 3.00 s"
    assert outcome(replace(run, rollout=replace(run.rollout, terminated=True))).startswith("stopped at 3.00 s")
    assert math.isfinite(run.final_rms_error or math.nan)


def test_a_notebook_shows_both_errors_of_each_run_in_thousandths() -> None:
    html, time = comparison(load("two_link"))._repr_html_(), PERIOD * np.arange(1500)
    for fade in (4.0, 0.2):
        square = (100.0 * np.exp(-fade * time)) ** 2
        first, last = (f"{np.sqrt(square[part].mean()):.3g}" for part in (time < 1.0, time >= 1.0))
        assert f"<td>{first}</td><td>{last}</td>" in html
    assert "–" in comparison(load("two_link"), samples=50)._repr_html_()


@pytest.mark.parametrize("samples", [400, 750])
def test_a_run_too_short_for_two_errors_tells_the_one_of_all_of_it(samples: int) -> None:
    short = comparison(load("two_link"), samples)
    rms = 100.0 * np.sqrt(np.mean(np.exp(-8.0 * PERIOD * np.arange(samples))))
    assert f"{rms:.3g} mrad over {samples * PERIOD:.2f} s" in outcome_words(short)


def test_only_an_arm_of_several_joints_tells_the_error_of_each(shown: Comparison) -> None:
    alone = comparison(load("two_link").locked(["elbow"]), samples=20)
    for made, told in ((shown, True), (alone, False)):
        assert any("each joint" in fact.question for fact in facts(made, by_joint=True)) is told
