"""Judgement of a comparison."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from adaptctl.dynamics.joint_units import position_units
from adaptctl.recording.comparison import NO_MODEL, Comparison
from adaptctl.recording.controller_run import FINAL_ERROR_TIME, ControllerRun, Joints
from adaptctl.recording.result import Fact, Failure, RunRole, Verdict
from adaptctl.recording.wording import error, number

# Error in rad or m at the end of a run with which nothing is tracked.
MAX_FINAL_ERROR = 1.0
# Time in s at a torque limit above which motors are saturated.
MAX_SATURATED_TIME = 2.0
# Share of the error with adaptation off below which an error has come from learning.
MAX_ERROR_RATIO = 0.9
# At most so many names in one fact.
FEW_NAMES = 3


def judged(comparison: Comparison) -> Verdict:
    """
    Return the verdict on the first controller of a comparison.

    Parameters
    ----------
    comparison : Comparison
        Comparison whose first run is judged.

    Returns
    -------
    Verdict
        Failures found, with the reason where the comparison expects one.

    Notes
    -----
    The kinds of failure and their bounds are those of `Failure`. That the subject is no better than without adaptation
    is not judged where the comparison was interrupted, or one of the two runs was stopped, is shorter than 2 s or
    missing.

    Examples
    --------
    >>> from adaptctl.recording import compared_runs, judged
    >>> judged(compared_runs(arm, {"adaptive": run})).passed
    True
    """
    return Verdict.of(_failures(comparison), comparison.expected)


def _failures(comparison: Comparison) -> Iterator[tuple[Failure, str]]:
    run = comparison.subject
    if run.rollout.terminated:
        stopped = f"{run.label} was stopped by the environment at {run.duration:.2f} s"
        yield Failure.STOPPED, f"{stopped}, with a tracking error of {_largest(comparison, -1)}."
    elif not (worst := _last_error(comparison)) < MAX_FINAL_ERROR:
        yield Failure.DIVERGED, f"{run.label} diverged: its tracking error reached {worst:.3g} rad or m at the end."
    limited = comparison.limited_steps(run) * run.rollout.sample_time
    if limited > MAX_SATURATED_TIME:
        yield Failure.SATURATED, f"{run.label} was at a torque limit for {limited:.1f} of {run.duration:.1f} s."
    if comparison.complete and not run.rollout.terminated and not _beats_adaptation_off(comparison):
        yield Failure.NO_BETTER, f"{run.label} does not end at a smaller error than without adaptation."


def _largest(comparison: Comparison, sample: int) -> str:
    """Largest error of the subject at a sample, with its unit, joint and bound."""
    error = np.abs(comparison.subject.rollout.error[sample])
    j = int(error.argmax())
    unit = next(unit for unit, joints in comparison.joints_by_unit.items() if j in joints)
    bound = "" if comparison.error_bound is None else f" (the bound is {comparison.error_bound[j]:.3g} {unit})"
    return f"{error[j]:.3g} {unit} in joint {comparison.joint_names[j]}{bound}"


def _last_error(comparison: Comparison) -> float:
    rollout = comparison.subject.rollout
    last = rollout.time >= comparison.subject.duration - FINAL_ERROR_TIME
    return float(np.abs(rollout.error[last]).max())


def _beats_adaptation_off(comparison: Comparison) -> bool:
    """True if the subject's final error is clearly below that without adaptation, or there are not two to compare."""
    baseline, final = comparison.baseline, comparison.subject.final_rms_error
    if baseline is None or baseline is comparison.subject or baseline.rollout.terminated:
        return True
    off = baseline.final_rms_error
    return final is None or off is None or final < MAX_ERROR_RATIO * np.nan_to_num(off, nan=np.inf)


def first_error(comparison: Comparison, run: ControllerRun) -> str:
    """Root mean square error of a run's first second, by unit: "12 mrad and 3 mm"."""
    return _in_each_unit(comparison, run.first_rms_error_of)


def final_error(comparison: Comparison, run: ControllerRun) -> str:
    """Root mean square error of a run's last two seconds, by unit: "12 mrad and 3 mm"."""
    return _in_each_unit(comparison, run.final_rms_error_of)


def _in_each_unit(comparison: Comparison, of: Callable[[Joints], float | None]) -> str:
    return " and ".join(error(of(joints), f"m{unit}") for unit, joints in comparison.joints_by_unit.items())


def joint_errors(comparison: Comparison) -> list[tuple[str, str, str]]:
    """Name of each joint, and its root mean square errors in the subject's first second and last two, with units."""
    run, units = comparison.subject, position_units(comparison.mechanism)
    return [
        (name, error(run.first_rms_error_of([j]), f"m{unit}"), error(run.final_rms_error_of([j]), f"m{unit}"))
        for j, (name, unit) in enumerate(zip(comparison.joint_names, units, strict=True))
    ]


def outcome_words(comparison: Comparison) -> str:
    """Outcome of a comparison in a few sentences."""
    answer = _worth(comparison) if comparison.answer is None else comparison.answer
    return judged(comparison).before(answer)


def _worth(comparison: Comparison) -> str:
    subject = comparison.subject
    first, final = subject.first_rms_error, subject.final_rms_error
    start = {"": "The", NO_MODEL: "Starting from zero parameter estimates, the"}.get(
        subject.prior_knowledge, f"With an initial model ({subject.prior_knowledge}), the"
    )
    if first is None or final is None:
        short = _in_each_unit(comparison, lambda joints: subject.rms_error(joints=joints))
        return f"{start} RMS tracking error is {short} over {subject.duration:.2f} s."
    changes = "falls" if final < first else "changes"
    went = (
        f"{changes} from {first_error(comparison, subject)} in the first second to "
        f"{final_error(comparison, subject)} in the last two"
    )
    return " ".join((f"{start} RMS tracking error {went}.", *_without_adaptation(comparison, final)))


def _without_adaptation(comparison: Comparison, final: float) -> Iterator[str]:
    baseline = comparison.baseline
    if baseline is None:
        return
    if baseline.rollout.terminated:
        yield f"Without adaptation, the same controller was {outcome(baseline)}."
    elif baseline.final_rms_error is not None and final:
        times = [_times_larger(comparison, joints) for joints in comparison.joints_by_unit.values()]
        larger = f" ({' and '.join(number(x, 2) for x in times)} times larger)" if min(times) > 1.0 else ""
        yield f"Without adaptation, it remains at {final_error(comparison, baseline)}{larger}."


def _times_larger(comparison: Comparison, joints: list[int]) -> float:
    """Final error without adaptation over that of the subject; 0 where either is not finite."""
    final, off = (run.final_rms_error_of(joints) for run in (comparison.subject, comparison.baseline) if run)
    return off / final if final and off and math.isfinite(off) and math.isfinite(final) else 0.0


def outcome(run: ControllerRun) -> str:
    """End of a run in words: "completed", or the time and cause of its stop."""
    if run.rollout.interrupted:
        return f"interrupted at {run.duration:.2f} s"
    if run.rollout.terminated:
        return f"stopped at {run.duration:.2f} s: error limit exceeded"
    return "completed"


def facts(comparison: Comparison, by_joint: bool = False) -> Iterator[Fact]:
    """Questions that a person asks first, and their answers in words with units; of each joint too, for a terminal."""
    subject, task_error, baseline = comparison.subject, comparison.task_error, comparison.baseline
    if task_error is not None:
        yield Fact(task_error.meaning, f"{error(task_error.final_rms(subject), task_error.unit)} in the last 2 s (RMS)")
    whose = "RMS error" if task_error is None else "Joint RMS error"
    yield Fact(f"{whose}, first second", first_error(comparison, subject))
    marked = RunRole.SUBJECT if baseline else RunRole.NOBODY
    yield Fact(f"{whose}, last 2 s", final_error(comparison, subject), marked)
    if by_joint and len(comparison.joint_names) > 1:
        yield Fact("… of each joint", ", ".join(f"{name} {last}" for name, _, last in joint_errors(comparison)))
    if baseline:
        fell = baseline.rollout.terminated
        answer = outcome(baseline) if fell else final_error(comparison, baseline)
        yield Fact("… without adaptation", answer, RunRole.BASELINE)
    if comparison.complete:
        yield Fact("Verdict", "passed" if judged(comparison).passed else "failed")
    if subject.lyapunov_max_increase is not None:
        yield Fact("Lyapunov function", lyapunov_words(subject.lyapunov_max_increase))
    elif subject.lyapunov is not None and len(subject.lyapunov):
        yield Fact("Lyapunov function", "unknown: not finite")
    peak = float(comparison.peak_torque_shares.max())
    yield Fact("Peak torque", f"{number(100.0 * peak)} % of the limit")
    yield Fact("Steps at a torque limit", f"{comparison.limited_steps(subject):,} of {len(subject.rollout.time):,}")
    yield Fact("Parameters", parameters(comparison))
    if names := comparison.open_names:
        left = len(names) - FEW_NAMES
        others = f" and {left} other{'s' if left > 1 else ''}" if left > 0 else ""
        yield Fact("Hardly excited", f"{', '.join(names[:FEW_NAMES])}{others}")
    if (factor := subject.realtime_factor) is not None:
        yield Fact("Simulated", f"{number(factor)} times faster than real time")


def lyapunov_words(rise: float) -> str:
    """Sentence on the Lyapunov function's largest rise (J) between samples."""
    return "never rises" if rise == 0.0 else f"rises by at most {number(rise)} J per step"


def parameters(comparison: Comparison) -> str:
    """Numbers of a mechanism's parameters in words."""
    inertial, all_of_them = len(comparison.space.parameter_names), len(comparison.mechanism.parameter_names)
    friction = f", plus {all_of_them - inertial} of friction" if all_of_them > inertial else ""
    base = "base parameter" if comparison.space.rank == 1 else "base parameters"
    return f"{comparison.space.rank} {base} of {inertial} inertial parameters{friction}"


TRUTH_UNKNOWN = (
    "The true parameters are unknown, so the accuracy of the estimates is unknown, too: a small tracking error does "
    "not imply accurate estimates."
)

CONVERGENCE = (
    "Good tracking does not require parameter convergence: estimates converge to the true values only in directions "
    "that the motion excites."
)


def on_truth(comparison: Comparison) -> str:
    """Sentence on how near the estimates are to the true values, or that these are not known."""
    meaning = CONVERGENCE if comparison.truth_known else TRUTH_UNKNOWN
    return f"{meaning} {open_words(comparison)}"


def open_words(comparison: Comparison) -> str:
    """Sentence on the parameters that the subject's motion hardly shows."""
    names = comparison.open_names
    if not names:
        return "This motion shows all of them."
    return f"This motion hardly shows {len(names)} of {len(comparison.model.names)}: {', '.join(names)}."
