"""Errors and torque limits of runs whose samples are written down, so that every figure is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from comparisons import comparison

from adaptctl.arrays import Array
from adaptctl.dynamics import load
from adaptctl.recording import Comparison, Failure, judged
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
