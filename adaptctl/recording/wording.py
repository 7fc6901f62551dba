"""Sentences and numbers about a comparison, the same in the recording and in the report."""

from __future__ import annotations

from collections.abc import Iterator

from adaptctl.recording.comparison import Comparison, ControllerRun
from adaptctl.recording.summary import realtime_factor


def number(value: float | None, digits: int = 3) -> str:
    """Text of a number with so many significant digits, powers of ten as superscripts; a dash for None."""
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    if 1e-4 <= abs(value) < 1e5:
        return f"{value:.{digits}g}" if abs(value) < 10.0**digits else f"{value:.0f}"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(_RAISED)}"


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def error(value: float | None, unit: str) -> str:
    """Text of a tracking error (rad or m) in thousandths, whose unit is given; a dash for None."""
    return "–" if value is None else f"{number(1e3 * value)} {unit}"


def verdict(comparison: Comparison) -> str:
    """Outcome of a comparison in a sentence or two: its own answer, or what adaptation is worth."""
    if comparison.answer is not None:
        return comparison.answer
    subject, baseline, unit = comparison.subject, comparison.baseline, comparison.error_unit
    first, final = subject.first_rms_error, subject.final_rms_error
    said = (
        f"Knowing {subject.knows} of its inertial parameters, the arm goes from "
        f"{error(first, unit)} of tracking error in the first second to {error(final, unit)} in the last two"
    )
    if baseline is None or baseline.final_rms_error is None or not final:
        return f"{said}."
    ratio = baseline.final_rms_error / final
    return (
        f"{said}. The same controller with adaptation off stays at "
        f"{error(baseline.final_rms_error, unit)}, {number(ratio, 2)} times as much."
    )


def has_failed(comparison: Comparison) -> bool:
    """True where the subject was stopped before its end, or, where that was the question, is no better for adapting."""
    subject, baseline = comparison.subject, comparison.baseline
    if subject.rollout.terminated:
        return True
    final, other = subject.final_rms_error, baseline.final_rms_error if baseline is not None else None
    return (
        comparison.complete and comparison.answer is None and final is not None and other is not None and final >= other
    )


def headline(verdict: str, complete: bool) -> str:
    """A verdict, after a line of warning where the experiment is incomplete."""
    return verdict if complete else f"{INCOMPLETE}\n{verdict}"


def outcome(run: ControllerRun) -> str:
    """End of a run in words: to the end, interrupted, or stopped by an error beyond bounds."""
    if not run.rollout.complete:
        return f"interrupted at {run.duration:.2f} s"
    if run.rollout.terminated:
        return f"stopped at {run.duration:.2f} s: error beyond bounds"
    return "ran to the end"


def facts(comparison: Comparison) -> Iterator[tuple[str, str]]:
    """Questions that a person asks first, and the answers."""
    subject, unit = comparison.subject, comparison.error_unit
    yield "RMS error, first second", error(subject.first_rms_error, unit)
    yield "RMS error, last 2 s", error(subject.final_rms_error, unit)
    if comparison.baseline:
        yield "… with adaptation off", error(comparison.baseline.final_rms_error, unit)
    if subject.lyapunov_max_increase is not None:
        rise = subject.lyapunov_max_increase
        yield "Lyapunov function", "never rises" if rise == 0.0 else f"rises by at most {number(rise)} J a step"
    peak = float(comparison.peak_torque_shares.max())
    yield "Peak torque", f"{100 * peak:.0f} % of the limit"
    yield "Steps clipped", f"{subject.clipped_steps:,} of {len(subject.rollout.time):,}"
    yield "Parameters", f"{comparison.space.rank} independent among {len(comparison.mechanism.parameter_names)}"
    yield "Simulated", f"{number(realtime_factor(subject))} times faster than real time"


INCOMPLETE = "This run was interrupted. What was computed until then is shown; it is not the whole experiment."

CONVERGENCE = (
    "The tracking error converges; the estimates need not: they reach the true values only as far as the "
    "motion excites them."
)
