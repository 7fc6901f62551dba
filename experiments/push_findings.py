"""Findings of a push in a controller's run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.recording import ControllerRun, Finding
from adaptctl.recording.wording import number
from adaptctl.simulation import HandPush

WINDOW = 2.0
"""s over which errors are averaged, before a push and after it"""


def findings_of_push(push: HandPush, run: ControllerRun, distance: Callable[[Array], float]) -> Iterator[Finding]:
    """Errors before, during and after a push, errors of the estimate, and when the push was felt."""
    end = push.start + push.duration
    spans = {
        "error_before": (push.start - WINDOW, push.start, f"in the {WINDOW:g} s before the push"),
        "error_pushed": (push.start, end, "while it is pushed"),
        "error_after": (end, end + WINDOW, f"in the {WINDOW:g} s after it"),
    }
    for name, (start, stop, when) in spans.items():
        error = run.rms_error(start, stop)
        yield _told(run, name, None if error is None else 1e3 * error, "mrad", f"RMS error of joints {when}")
    for name, time, when in (("before", push.start, "before the push"), ("after", np.inf, "at the end")):
        meaning = f"error of the estimate {when}, relative to that of the first"
        yield _told(run, f"parameter_error_{name}", _relative(time, run, distance), "%", meaning)
    if run.rollout.logged_state.shape[1]:
        yield _told(run, "felt_after", _felt(push, run), "s", "time from the push's begin to the first doubt")


def answer_of_push(findings: Sequence[Finding], runs: Sequence[ControllerRun]) -> str | None:
    """Sentence on the errors after a push; None without one, or where no run goes on after it."""
    values = {finding.name: finding.value for finding in findings}
    after = [(values.get(f"error_after.{run.name}", np.nan), run.label) for run in runs]
    errors = [f"{number(value)} mrad ({label})" for value, label in after if np.isfinite(value)]
    return f"After the push, the RMS errors of joints in {WINDOW:g} s are {', '.join(errors)}." if errors else None


def _told(run: ControllerRun, name: str, value: float | None, unit: str, meaning: str) -> Finding:
    return Finding(f"{name}.{run.name}", np.nan if value is None else value, unit, f"{run.label}: {meaning}")


def _relative(time: float, run: ControllerRun, distance: Callable[[Array], float]) -> float | None:
    """Error of the last estimate before a time over that of the first, in %."""
    estimate, last = run.rollout.estimate, int(np.searchsorted(run.rollout.time, time)) - 1
    if not estimate.shape[1] or last < 0 or not (first := distance(estimate[0])):
        return None
    return 100.0 * distance(estimate[last]) / first


def _felt(push: HandPush, run: ControllerRun) -> float | None:
    """Time in s from a push's begin to the first doubt within it."""
    time, decision = run.rollout.time, run.rollout.logged_state[:, 0]
    within = (time >= push.start) & (time < push.start + push.duration) & (decision > 0.0)
    return float(time[within][0] - push.start) if within.any() else None
