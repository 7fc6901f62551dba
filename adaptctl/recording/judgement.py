"""Judgement of a comparison: whether the controller that it is about did what was asked, in words and as facts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from adaptctl.recording.comparison import SETTLED, Comparison, ControllerRun, Joints
from adaptctl.recording.result import Fact, Failure, Verdict, Whose
from adaptctl.recording.wording import error, number

ASTRAY = 1.0
"""rad or m: an error at the end of a run with which nothing is tracked"""
SATURATED = 2.0
"""s at a torque limit, above which a run is one of saturated motors"""
BETTER = 0.9
"""Of the error with adaptation off: one that is not below this has not come from learning."""


def judged(comparison: Comparison) -> Verdict:
    """The verdict on the subject of a `comparison`, its first run: the failures found, each with a sentence, and with
    the reason where the comparison expects it.

    Failures are STOPPED, the environment ended the run early; else DIVERGED, a joint's position error was 1 rad (1 m if
    prismatic) or more, or NaN, in the run's last two seconds; SATURATED, a torque was at its limit for over 2 s in all;
    NO_BETTER, the RMS position error of all joints over the last two seconds is not below 0.9 times that with
    adaptation off, in which NaN counts as infinite. NO_BETTER is not judged where the comparison was interrupted, where
    one of the two runs was stopped or is shorter than 2 s, or where no other run has adaptation off. Raises
    `ValueError` for a run of another number of joints than there are torque limits.
    """
    return Verdict.of(_failures(comparison), comparison.expected)


def _failures(comparison: Comparison) -> Iterator[tuple[Failure, str]]:
    run = comparison.subject
    if run.rollout.terminated:
        yield Failure.STOPPED, f"{run.label} was stopped at {run.duration:.2f} s, an error being beyond bounds."
    elif not (worst := _last_error(comparison)) < ASTRAY:
        yield Failure.DIVERGED, f"{run.label} diverged: an error of {worst:.3g} rad or m at the end."
    limited = comparison.limited_steps(run) * run.rollout.sample_time
    if limited > SATURATED:
        yield Failure.SATURATED, f"{run.label} was at a torque limit for {limited:.1f} of {run.duration:.1f} s."
    if comparison.complete and not run.rollout.terminated and not _beats_adaptation_off(comparison):
        yield Failure.NO_BETTER, f"{run.label} ends no better than the same controller with adaptation off."


def _last_error(comparison: Comparison) -> float:
    """Largest error (rad or m) of the subject in its last two seconds."""
    rollout = comparison.subject.rollout
    last = rollout.time >= comparison.subject.duration - SETTLED
    return float(np.abs(rollout.error[last]).max())


def _beats_adaptation_off(comparison: Comparison) -> bool:
    """True if the subject's final error is clearly smaller than that with adaptation off, or if there are not two to
    compare."""
    baseline, final = comparison.baseline, comparison.subject.final_rms_error
    if baseline is None or baseline is comparison.subject or baseline.rollout.terminated:
        return True
    off = baseline.final_rms_error
    return final is None or off is None or final < BETTER * np.nan_to_num(off, nan=np.inf)


def first_error(comparison: Comparison, run: ControllerRun) -> str:
    """Root mean square tracking error of a `run` over its first second, over all joints of each unit, formatted as
    text: "12 mrad", or "12 mrad and 3 mm". It has a dash for the number where the run is shorter, and words for NaN and
    infinity. Raises `IndexError` for a run of fewer joints than the comparison's mechanism."""
    return _in_each_unit(comparison, run.first_rms_error_of)


def final_error(comparison: Comparison, run: ControllerRun) -> str:
    """Root mean square tracking error of a `run` over its last two seconds, over all joints of each unit, formatted as
    text: "12 mrad", or "12 mrad and 3 mm". It has a dash for the number where the run is shorter, and words for NaN and
    infinity. Raises `IndexError` for a run of fewer joints than the comparison's mechanism."""
    return _in_each_unit(comparison, run.final_rms_error_of)


def _in_each_unit(comparison: Comparison, of: Callable[[Joints], float | None]) -> str:
    return " and ".join(error(of(joints), f"m{unit}") for unit, joints in comparison.joints_by_unit.items())


def outcome_words(comparison: Comparison) -> str:
    """The outcome of a `comparison` of runs in a few sentences. First come the failures of its first run, if any, after
    "Failed:", then the comparison's own `answer`, or where that is None the tracking errors with and without
    adaptation, then the failures that were expected. Raises `ValueError` for a first run of another number of joints
    than there are torque limits."""
    answer = _worth(comparison) if comparison.answer is None else comparison.answer
    return judged(comparison).before(answer)


def _worth(comparison: Comparison) -> str:
    """A sentence or two on the subject's error with adaptation."""
    subject = comparison.subject
    first, final = subject.first_rms_error, subject.final_rms_error
    knowing = f"Knowing {subject.knows} of its inertial parameters, the arm" if subject.knows else "The arm"
    if first is None or final is None:
        short = _in_each_unit(comparison, lambda joints: subject.rms_error(joints=joints))
        return f"{knowing} has {short} of tracking error in {subject.duration:.2f} s."
    went = (
        f"goes from {first_error(comparison, subject)} of tracking error in the first second to "
        f"{final_error(comparison, subject)} in the last two"
    )
    return " ".join((f"{knowing} {went}.", *_without_adaptation(comparison, final)))


def _without_adaptation(comparison: Comparison, final: float) -> Iterator[str]:
    """Sentences on the same controller with adaptation off, beside the subject's final error (rad or m)."""
    baseline = comparison.baseline
    if baseline is None:
        return
    if baseline.rollout.terminated:
        yield f"The same controller with adaptation off is {outcome(baseline)}."
    elif (off := baseline.final_rms_error) is not None and final:
        comparable = len(comparison.joints_by_unit) == 1 and math.isfinite(off) and math.isfinite(final)
        times = f", {number(off / final, 2)} times as much" if comparable else ""
        yield f"The same controller with adaptation off stays at {final_error(comparison, baseline)}{times}."


def outcome(run: ControllerRun) -> str:
    """The end of a run in words: "ran to the end", "interrupted at 3.20 s", or "stopped at 3.20 s: error beyond bounds"
    where the environment ended it. Nothing is raised."""
    if not run.rollout.complete:
        return f"interrupted at {run.duration:.2f} s"
    if run.rollout.terminated:
        return f"stopped at {run.duration:.2f} s: error beyond bounds"
    return "ran to the end"


def facts(comparison: Comparison) -> Iterator[Fact]:
    """Facts of a comparison of runs, each a `Fact`: a question that a person asks first, and its answer in words, with
    units. They are of the first run: its tracking errors, Lyapunov function, torques, number of parameters and speed of
    simulation; the final error with adaptation off comes after its own, and the field `whose` of these two says which
    is which. Raises `ValueError` for a first run of another number of joints than there are torque limits."""
    subject, leading, baseline = comparison.subject, comparison.leading, comparison.baseline
    if leading is not None:
        yield Fact(leading.meaning, f"{error(leading.final_rms(subject), leading.unit)} in the last 2 s (RMS)")
    whose = "RMS error" if leading is None else "Joints' RMS error"
    yield Fact(f"{whose}, first second", first_error(comparison, subject))
    marked = Whose.SUBJECT if baseline else Whose.NOBODY
    yield Fact(f"{whose}, last 2 s", final_error(comparison, subject), marked)
    if baseline:
        fell = baseline.rollout.terminated
        answer = outcome(baseline) if fell else final_error(comparison, baseline)
        yield Fact("… with adaptation off", answer, Whose.BASELINE)
    if subject.lyapunov_max_increase is not None:
        yield Fact("Lyapunov function", lyapunov_words(subject.lyapunov_max_increase))
    elif subject.lyapunov is not None and len(subject.lyapunov):
        yield Fact("Lyapunov function", "not known: it holds NaN or infinity")
    peak = float(comparison.peak_torque_shares.max())
    yield Fact("Peak torque", f"{number(100.0 * peak)} % of the limit")
    yield Fact("Steps at a torque limit", f"{comparison.limited_steps(subject):,} of {len(subject.rollout.time):,}")
    yield Fact("Parameters", parameters(comparison))
    if (factor := subject.realtime_factor) is not None:
        yield Fact("Simulated", f"{number(factor)} times faster than real time")


def lyapunov_words(rise: float) -> str:
    """Text on a Lyapunov function, from its largest rise from one sample to the next, `rise`, J: "never rises" for 0,
    as theory predicts, else such as "rises by at most 2.1 J a step". Nothing is raised."""
    return "never rises" if rise == 0.0 else f"rises by at most {number(rise)} J a step"


def parameters(comparison: Comparison) -> str:
    """Text on a mechanism's numbers of parameters: how many of its inertial parameters are independent, and how many of
    friction there are besides, such as "36 independent among 60 inertial, and 12 of friction". Nothing is raised."""
    inertial, all_of_them = len(comparison.space.parameter_names), len(comparison.mechanism.parameter_names)
    friction = f", and {all_of_them - inertial} of friction" if all_of_them > inertial else ""
    return f"{comparison.space.rank} independent among {inertial} inertial{friction}"


TRUTH_UNKNOWN = (
    "The true values are not known, so nothing is said of how near the estimates are: a small tracking error does not "
    "say that they are near."
)

CONVERGENCE = (
    "The tracking error converges; the estimates need not: they reach the true values only as far as the "
    "motion excites them."
)


def on_truth(comparison: Comparison) -> str:
    """A sentence on how near the estimates are to the true values, or that these are not known. Nothing is raised."""
    return CONVERGENCE if comparison.truth_known else TRUTH_UNKNOWN
