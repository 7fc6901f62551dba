"""Judgement of a comparison: whether the controller that it is about did what was asked."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from adaptctl.recording.comparison import SETTLED, Comparison
from adaptctl.recording.verdict import Failure, Verdict

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
    limited = comparison.limited_steps(run) * run.rollout.spacing
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
