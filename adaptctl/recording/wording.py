"""Sentences and numbers about a comparison, the same in the recording and in the report."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from adaptctl.recording.comparison import Comparison, ControllerRun, Joints
from adaptctl.recording.fact import Fact, Whose
from adaptctl.recording.judgement import judged
from adaptctl.recording.summary import realtime_factor


def number(value: float | None, digits: int = 3) -> str:
    """Number formatted as text with `digits` significant digits, 3 by default, such as "0.0123"; "–", a dash, for None.
    Numbers below 1e-4 or from 1e5 on in size are written with a power of ten, such as "2.80·10⁻¹⁴", and those from 10
    to the power `digits` on as whole numbers; NaN and infinity in words, such as "not a number". Nothing is checked."""
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    if 1e-4 <= abs(value) < 1e5:
        rounded = float(f"{value:.{digits}g}")
        return f"{value:.{digits}g}" if abs(rounded) < 10.0**digits else f"{value:.0f}"
    return scientific(value, digits)


def scientific(value: float, digits: int = 3) -> str:
    """Number formatted as text, as a multiple of a power of ten with `digits` significant digits, 3 by default: 2.8e-14
    is "2.80·10⁻¹⁴". NaN and infinity are in words: "not a number", "infinity", "minus infinity". Nothing is checked."""
    if not math.isfinite(value):
        return "not a number" if math.isnan(value) else "infinity" if value > 0.0 else "minus infinity"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(_RAISED)}"


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def error(value: float | None, unit: str) -> str:
    """Tracking error `value`, given in rad (m if prismatic), formatted as text in thousandths with their `unit`: 0.012
    and "mrad" give "12 mrad". It is "–", a dash, for None, and "not a number" or "infinity", without a unit, for NaN
    and infinity. Nothing is raised."""
    if value is None or not math.isfinite(value):
        return number(value)
    return f"{number(1e3 * value)} {unit}"


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


def headline(outcome_words: str, complete: bool) -> str:
    """The outcome of an experiment as text, `outcome_words`; before it, where `complete` is False, a line that says
    that the experiment was interrupted. Nothing is raised."""
    return outcome_words if complete else f"{INCOMPLETE}\n{outcome_words}"


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
    if (factor := realtime_factor(subject)) is not None:
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


INCOMPLETE = "This run was interrupted. What was computed until then is shown; it is not the whole experiment."

TRUTH_UNKNOWN = (
    "The true values are not known, so nothing is said of how near the estimates are: a small tracking error does not "
    "say that they are near."
)

CONVERGENCE = (
    "The tracking error converges; the estimates need not: they reach the true values only as far as the "
    "motion excites them."
)
