"""Errors and torque limits of runs whose samples are written down, so that every figure is known."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from comparisons import comparison

from adaptctl.arrays import Array
from adaptctl.dynamics import load
from adaptctl.recording import Comparison, Failure, TaskError, judged
from adaptctl.recording.judgement import facts, outcome_words
from adaptctl.recording.result import answers
from adaptctl.simulation import Rollout

SHOWN = comparison(load("puma560_measured"), samples=60)


def run_of(every: int, period: float, samples: int, error: Array, applied: Array) -> Rollout:
    """One sample in `every` control periods; the same errors (T,) and torques (T,) of all joints."""
    r, time = 6, every * period * np.arange(samples)
    zero = np.zeros((samples, r))
    wide, torque = np.repeat(error[:, None], r, axis=1), np.repeat(applied[:, None], r, axis=1)
    empty, estimate = np.zeros(samples), np.zeros((samples, 0))
    return Rollout(
        *(time, wide, zero, zero, zero, zero, torque, torque, empty, empty, empty, estimate, period, 1.0), every=every
    )


def shown(rollout: Rollout) -> Comparison:
    """A comparison about that run."""
    subject = replace(SHOWN.subject, rollout=rollout, lyapunov=None)
    return replace(
        SHOWN, runs=(subject,), torque_limits=np.array([1.0, 2.0, 4.0, 4.0, 4.0, 4.0]), duration=rollout.duration
    )


def test_windows_of_errors_hold_their_first_instant_and_not_their_last() -> None:
    """Error 0 in the first second, 1 in the next, 2 in the third: a sample at 1 s is of the second second."""
    error = np.repeat([0.0, 1.0, 2.0], 10)
    run = shown(run_of(1, 0.1, 30, error, np.zeros(30))).subject
    assert run.first_rms_error == 0.0
    assert run.rms_error(1.0 - 1e-9, 2.0 - 1e-9) == 1.0
    assert run.rms_error(stop=float(run.rollout.time[15])) == pytest.approx(np.sqrt(5 / 15), rel=1e-15)
    assert run.rms_error(start=float(run.rollout.time[29])) == 2.0
    assert run.rms_error(stop=0.0) is None
    assert run.final_rms_error == pytest.approx(np.sqrt((10 * 1 + 10 * 4) / 20), rel=1e-15)


@pytest.mark.parametrize("every", [1, 5, 50])
@pytest.mark.parametrize(("limited", "fails"), [(1.5, False), (2.0, False), (2.5, True), (4.0, True)])
def test_time_at_a_limit_is_in_seconds_whichever_samples_are_kept(every: int, limited: float, fails: bool) -> None:
    """Six seconds, of which a joint is at its limit of 1 N m for some; above two is too long."""
    period = 0.01
    samples = round(6.0 / (every * period))
    time = every * period * np.arange(samples)
    what = shown(run_of(every, period, samples, np.zeros(samples), np.where(time < limited - 1e-9, 1.0, 0.5)))
    assert what.limited_steps(what.subject) == round(limited / (every * period))
    faults = {fault.failure: fault.sentence for fault in judged(what).faults}
    assert (Failure.SATURATED in faults) is fails
    if fails:
        assert f"for {limited:.1f} of 6.0 s" in faults[Failure.SATURATED]


STILL = np.zeros(60)
"""Six seconds of samples 0.1 s apart"""


@pytest.mark.parametrize(
    ("sample", "size", "fails"), [(40, 1.0, True), (59, -1.0, True), (40, 0.99, False), (39, 5.0, False)]
)
def test_divergence_is_an_error_of_1_rad_in_the_last_two_seconds(sample: int, size: float, fails: bool) -> None:
    error = STILL.copy()
    error[sample] = size
    faults = [fault.failure for fault in judged(shown(run_of(1, 0.1, 60, error, STILL))).faults]
    assert (Failure.DIVERGED in faults) is fails


@pytest.mark.parametrize(("ratio", "fails"), [(0.89, False), (0.91, True), (1.05, True)])
def test_what_learning_left_is_below_nine_tenths_of_what_was_there_without(ratio: float, fails: bool) -> None:
    """In the last two seconds; the first four are better without."""
    learnt, off = (np.where(np.arange(60) < 40, early, late) for early, late in ((0.5, ratio * 0.1), (0.01, 0.1)))
    what = shown(run_of(1, 0.1, 60, learnt, STILL))
    without = replace(SHOWN.runs[1], rollout=run_of(1, 0.1, 60, off, STILL))
    faults = [fault.failure for fault in judged(replace(what, runs=(*what.runs, without))).faults]
    assert faults == ([Failure.NO_BETTER] if fails else [])


@pytest.mark.parametrize(
    ("applied", "clipped", "limited"),
    [([0.0, 1.0], 0.0, 1), ([0.0, -1.0], 0.0, 1), ([1.0 - 1e-6, 0.0], 0.0, 0), ([0.2, 0.3], 1.0, 2)],
)
def test_limited_samples_are_those_at_the_limit_of_either_sign_or_clipped(
    applied: list[float], clipped: float, limited: int
) -> None:
    run = run_of(1, 0.1, 2, np.zeros(2), np.array(applied))
    what = shown(replace(run, clipped=np.full(2, clipped)))
    assert what.limited_steps(what.subject) == limited


def test_peak_torques_are_parts_of_each_joints_own_limit() -> None:
    what = shown(run_of(1, 0.1, 3, np.zeros(3), np.array([0.5, -3.0, 1.0])))
    np.testing.assert_allclose(what.peak_torque_shares, 3.0 / what.torque_limits, rtol=1e-15)
    assert answers(facts(what))["Peak torque"] == "300 % of the limit"


@pytest.mark.parametrize(
    ("count", "told"), [(0, None), (3, "p0, p1, p2"), (4, "p0, p1, p2 and 1 other"), (5, "p0, p1, p2 and 2 others")]
)
def test_three_parameters_are_named_that_a_motion_hardly_excites(
    count: int, told: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Comparison, "open_names", tuple(f"p{k}" for k in range(count)))
    assert answers(facts(SHOWN)).get("Hardly excited") == told


def test_errors_of_joints_that_turn_and_of_those_that_slide_are_told_apart() -> None:
    """3 and 4 rad, 5 m: roots of mean squares, each over its own joints."""
    what = shown(run_of(1, 0.1, 60, STILL, STILL))
    what.subject.rollout.p[:, :3] = [3.0, 4.0, 5.0]
    run = what.subject
    for joints, expected in (([0, 1], np.sqrt(12.5)), ([2], 5.0), (slice(0, 3), np.sqrt(50 / 3)), (slice(3, 6), 0.0)):
        assert run.rms_error(joints=joints) == pytest.approx(expected, rel=1e-14)
        assert run.first_rms_error_of(joints) == pytest.approx(expected, rel=1e-14)
        assert run.final_rms_error_of(joints) == pytest.approx(expected, rel=1e-14)


def test_task_errors_are_of_the_last_two_seconds() -> None:
    errors = np.where(np.arange(60) < 40, 7.0, np.where(np.arange(60) < 50, 3.0, -4.0))
    what = shown(run_of(1, 0.1, 60, STILL, STILL))
    task_error = TaskError("distance", "mm", {"adaptive": errors})
    assert task_error.final_rms(what.subject) == pytest.approx(np.sqrt(12.5), rel=1e-14)
    short = shown(run_of(1, 0.1, 19, np.zeros(19), np.zeros(19))).subject
    assert TaskError("distance", "mm", {"adaptive": errors[:19]}).final_rms(short) is None


@pytest.mark.parametrize(
    ("early", "late", "off", "words"),
    [
        (0.5, 0.05, 0.1, r"falls from 500 mrad in .* to 50 mrad in .* remains at 100 mrad \(2 times larger\)\."),
        (0.05, 0.5, 0.1, r"changes from 50 mrad in .* to 500 mrad in .* remains at 100 mrad\."),
    ],
)
def test_what_learning_was_worth_is_told_in_words(early: float, late: float, off: float, words: str) -> None:
    learnt = np.where(np.arange(60) < 40, early, late)
    what = shown(run_of(1, 0.1, 60, learnt, STILL))
    without = replace(SHOWN.runs[1], rollout=run_of(1, 0.1, 60, np.full(60, off), STILL))
    assert re.search(words, outcome_words(replace(what, runs=(*what.runs, without))))


def test_a_run_of_two_seconds_in_half_a_second_is_four_times_as_fast_as_time() -> None:
    run = run_of(2, 0.1, 10, np.zeros(10), np.zeros(10))
    assert replace(SHOWN.subject, rollout=replace(run, wall_time=0.5)).realtime_factor == pytest.approx(4.0)
    assert replace(SHOWN.subject, rollout=replace(run, wall_time=0.0)).realtime_factor is None
