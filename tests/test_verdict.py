"""The verdict on a run: what failed is said first, and nothing that failed is told as a result."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from nightly import nightly, turn_by_turn

from adaptctl.arrays import Array
from adaptctl.dynamics import load
from adaptctl.experiments.adaptive import AdaptiveTracking
from adaptctl.recording import Comparison, Failure, Finding, TaskError, judged
from adaptctl.recording.figures import joint_errors, lyapunov
from adaptctl.recording.judgement import facts, outcome_words
from adaptctl.recording.report import report, write_artifacts
from adaptctl.recording.rerun_recording import finite_part, summary_markdown
from adaptctl.recording.result import Fault, Verdict, answers
from adaptctl.recording.summary import summary
from tests.comparisons import PERIOD, comparison

SHOWN = comparison(load("puma560_measured"))
LIMITS = SHOWN.torque_limits


def changed(shown: Comparison, run: int = 0, samples: int | None = None, **fields: object) -> Comparison:
    """A comparison one of whose runs has other fields, or ends after some samples."""
    rollout = shown.runs[run].rollout
    if samples is not None:
        arrays = {name: x[:samples] for name, x in vars(rollout).items() if isinstance(x, np.ndarray)}
        rollout = replace(rollout, **arrays)  # type: ignore[arg-type]
    runs = list(shown.runs)
    runs[run] = replace(runs[run], rollout=replace(rollout, **fields))  # type: ignore[arg-type]
    return replace(shown, runs=tuple(runs))


def failures(shown: Comparison) -> list[Failure]:
    """What is judged to have failed."""
    return [fault.failure for fault in judged(shown).faults]


def off_by(error: float, after: float = 0.0) -> Array:
    """Positions with an error from a time (s) on."""
    rollout = SHOWN.subject.rollout
    return rollout.reference_p + np.where(rollout.time[:, None] >= after, error, 0.0)


def test_a_run_that_learned_passes_and_says_what_it_learned() -> None:
    assert failures(SHOWN) == []
    assert judged(SHOWN).passed
    assert re.match(r"Starting from zero .* falls from .* remains at .* times larger\)\.", outcome_words(SHOWN))
    assert summary(SHOWN)["verdict"] == {"passed": True, "faults": []}


def test_a_run_that_stopped_says_so_first_and_has_no_last_two_seconds() -> None:
    stopped = changed(SHOWN, samples=210, terminated=True)
    assert failures(stopped) == [Failure.STOPPED]
    assert outcome_words(stopped).startswith("Failed: Slotine-Li, <learning> was stopped by the environment at 0.42 s")
    bounded = replace(stopped, error_bound=np.array([0.5, 0.5]))
    assert re.search(r" of \S+ rad in joint \w+ \(the bound is 0\.5 rad\)\.", outcome_words(bounded))
    assert summary_markdown(stopped).startswith("Failed: ")
    said = summary(stopped)
    assert said["verdict"]["passed"] is False
    assert (said["first_rms_error"], said["final_rms_error"]) == (None, None)
    assert said["rms_error"] == pytest.approx(float(np.sqrt(np.mean(stopped.subject.rollout.error**2))))
    assert answers(facts(stopped))["RMS error, last 2 s"] == "–"


def test_figures_of_two_seconds_exist_from_two_seconds_on() -> None:
    for samples, first, last in ((499, False, False), (500, True, False), (999, True, False), (1000, True, True)):
        run = changed(SHOWN, samples=samples).subject
        assert ((run.first_rms_error is not None), (run.final_rms_error is not None)) == (first, last)


def test_adaptation_off_that_fell_is_not_said_to_stay() -> None:
    fell = changed(SHOWN, 1, samples=235, terminated=True)
    assert failures(fell) == []
    assert "the same controller was stopped at 0.47 s" in outcome_words(fell)
    assert "remains" not in outcome_words(fell)
    assert answers(facts(fell))["… without adaptation"].startswith("stopped at 0.47 s")
    assert [axes.get_title() for axes in joint_errors(fell).axes[1::2]] == ["the last 2 s", "the last 0.47 s"]


def test_errors_that_no_tracking_has_are_divergence() -> None:
    assert failures(changed(SHOWN, p=off_by(1.5, after=2.0)))[0] is Failure.DIVERGED
    assert Failure.DIVERGED not in failures(changed(SHOWN, p=off_by(1.5) * (SHOWN.subject.rollout.time < 0.5)[:, None]))
    assert Failure.DIVERGED not in failures(changed(SHOWN, p=off_by(0.9, after=2.0)))


def test_an_error_that_is_as_large_without_adaptation_is_not_called_larger() -> None:
    words = outcome_words(changed(SHOWN, 1, p=SHOWN.subject.rollout.p))
    assert "Without adaptation, it remains at " in words
    assert "times larger" not in words


def test_rises_of_a_lyapunov_function_are_counted_beside_its_falls() -> None:
    first, *others = SHOWN.runs
    values = np.linspace(2.0, 1.0, len(first.rollout.time))
    values[[3, 7]] += 0.1
    shown = replace(SHOWN, runs=(replace(first, lyapunov=values), *others))
    legend = lyapunov(shown).axes[1].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["increase, 2 steps"]


@pytest.mark.parametrize("run", [0, 1])
@pytest.mark.parametrize(("hole", "words"), [(np.nan, "not a number"), (np.inf, "infinity")])
def test_a_run_that_diverged_out_of_numbers_is_told_in_words(run: int, hole: float, words: str) -> None:
    lost = changed(SHOWN, run, p=off_by(hole, after=2.0))
    assert (Failure.DIVERGED in failures(lost)) is (run == 0)
    asked = ("RMS error, last 2 s", "… without adaptation")[run]
    assert answers(facts(lost))[asked] == words
    assert ("times larger" in outcome_words(lost)) is False
    assert f" {words} in the last two." in outcome_words(lost) or f"remains at {words}." in outcome_words(lost)
    assert f"| {words} |" in summary_markdown(lost)
    assert words in report(lost).html({})


@pytest.mark.parametrize(("run", "hole"), turn_by_turn([0, 1], [np.nan, np.inf]))
def test_a_run_that_diverged_out_of_numbers_is_written_and_recorded_until_then(
    run: int, hole: float, tmp_path: Path
) -> None:
    lost = changed(SHOWN, run, p=off_by(hole, after=2.0))
    write_artifacts(tmp_path, lost)
    said = json.loads((tmp_path / "summary.json").read_text())
    assert said["verdict"]["passed"] is (run == 1)
    told = said["runs"][lost.runs[run].name]
    assert (told["rms_error"], told["final_rms_error"]) == (None, None)
    assert told["first_rms_error"] == lost.runs[run].first_rms_error
    assert said["runs"][lost.runs[1 - run].name]["final_rms_error"] > 0.0
    drawn = finite_part(lost).runs
    assert [one.duration for one in drawn][run] == pytest.approx(2.0)
    assert drawn[1 - run].duration == SHOWN.runs[1 - run].duration
    assert (tmp_path / "recording.rrd").stat().st_size > 10_000
    assert pq.read_table(tmp_path / "trace.parquet").num_rows == len(SHOWN.subject.rollout.time)


def test_findings_that_are_no_numbers_are_null_and_in_words(tmp_path: Path) -> None:
    """An experiment's hours are not lost for one of them."""
    findings = (Finding("lost", np.nan, "1", "a lost one"), Finding("far", np.inf, "rad", "a far one"))
    write_artifacts(tmp_path, replace(SHOWN, findings=findings))
    said = json.loads((tmp_path / "summary.json").read_text())["findings"]
    assert said == {"lost": {"value": None, "unit": "1"}, "far": {"value": None, "unit": "rad"}}
    text = (tmp_path / "report.html").read_text()
    assert "not a number" in text
    assert "infinity" in text


def test_what_is_finite_is_drawn_as_a_whole_and_errors_of_one_s_own_as_far_as_runs() -> None:
    assert finite_part(SHOWN) is SHOWN
    lost = changed(SHOWN, p=off_by(np.nan, after=2.0))
    errors = {run.name: np.arange(1500.0) for run in lost.runs}
    drawn = finite_part(replace(lost, task_error=TaskError("Distance", "mm", errors)))
    assert drawn.task_error is not None
    assert [len(drawn.task_error.errors[run.name]) for run in drawn.runs] == [1000, 1500]
    never = finite_part(changed(SHOWN, p=off_by(np.nan)))
    assert len(never.subject.rollout.time) == 1


def test_learning_that_gains_nothing_fails() -> None:
    same = changed(SHOWN, p=SHOWN.runs[1].rollout.p)
    assert failures(same) == [Failure.NO_BETTER]
    assert failures(replace(same, complete=False)) == []  # what was interrupted is not compared


@pytest.mark.parametrize("told_by", ["limit", "clipping"])
def test_seconds_at_a_torque_limit_fail_whoever_clips(told_by: str) -> None:
    """A guard that knows the limits leaves the environment nothing to clip: the torque is at its limit all the same."""
    rollout = SHOWN.subject.rollout
    for seconds, failed in ((1.9, []), (2.1, [Failure.SATURATED])):
        long = rollout.time < seconds - 0.5 * PERIOD
        if told_by == "limit":
            at_limit = changed(SHOWN, applied=np.where(long[:, None], LIMITS, 0.5 * LIMITS), clipped=0.0 * rollout.time)
        else:
            at_limit = changed(SHOWN, applied=0.5 * rollout.applied, clipped=long.astype(float))
        steps = round(seconds / PERIOD)
        assert failures(at_limit) == failed
        assert summary(at_limit)["clipped_steps"] == at_limit.limited_steps(at_limit.subject) == steps
        assert answers(facts(at_limit))["Steps at a torque limit"] == f"{steps:,} of 1,500"


def test_a_failure_that_is_the_question_passes_and_is_told_last() -> None:
    weak = changed(SHOWN, clipped=np.ones(1500))
    expected = replace(weak, expected={Failure.SATURATED: "its motors are weak"})
    assert not judged(weak).passed
    assert judged(expected).passed
    assert outcome_words(expected).startswith("Starting from zero parameter estimates")
    assert "As expected (its motors are weak): Slotine-Li" in outcome_words(expected)
    assert summary(expected)["verdict"]["faults"][0]["expected"] == "its motors are weak"
    stopped = changed(expected, terminated=True)
    assert not judged(stopped).passed  # another failure is not excused by it


def test_a_failure_that_is_expected_without_a_reason_is_told_too() -> None:
    verdict = Verdict((Fault(Failure.SATURATED, "It clips.", ""), Fault(Failure.DIVERGED, "It falls.", "no gravity")))
    assert verdict.passed
    assert verdict.before("It learns.") == "It learns. As expected: It clips. As expected (no gravity): It falls."


@nightly
def test_what_an_experiment_compares_with_is_not_judged() -> None:
    """Computed torque without a model falls; the verdict is on the adaptive controller."""
    shown = AdaptiveTracking(duration=3.0, seed=1).compare(lambda what, share: None)
    assert any(run.rollout.terminated for run in shown.runs if run is not shown.subject)
    assert judged(shown).passed
