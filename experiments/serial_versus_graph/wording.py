"""Sentences and rows about arms side by side, the same in the recording and in the report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from adaptctl.experiments.serial_versus_graph.result import Side, SideBySide
from adaptctl.recording.comparison import ControllerRun
from adaptctl.recording.fact import Fact
from adaptctl.recording.judgement import judged
from adaptctl.recording.verdict import Verdict
from adaptctl.recording.wording import error, number

WHY_NOT_16 = (
    "For the three-joint PUMA the paper prints 16. That is what energies give when they are not differenced: they "
    "then carry the constant part of the potential, which moves nothing, as one more. Differences of energies give 15, "
    "and so does the rank of the torque regressor; 7 N − 6 is 15 for three links with gravity along the first axis."
)


class Row(NamedTuple):
    """Row of the table that compares arms: its label `what`, the values' texts in `values`, one for each arm in order,
    and `section`, True for a heading, whose values are empty. Nothing is checked."""

    what: str
    values: tuple[str, ...]
    section: bool = False


def outcome_words(result: SideBySide) -> str:
    """Summary of a comparison of arms, `result`, in a few sentences, failures first: both tips' RMS errors in the last
    two seconds (mm), operations and numbers of parameters. Nothing is checked."""
    return verdict(result).before(_answer(result))


def verdict(result: SideBySide) -> Verdict:
    """Verdict, a `Verdict`, on the adaptive controllers of all arms in `result` together: their failures, such as a
    divergence or a stop, and whether these are expected. Nothing is checked."""
    return Verdict.together(judged(side.comparison) for side in result.sides)


def _answer(result: SideBySide) -> str:
    learnt = " and ".join(
        f"{_millimetres(side.final_tip_rms(side.comparison.subject))} ({side.label})" for side in result.sides
    )
    text = f"From knowing nothing, the tip ends {learnt} off the path that both follow."
    ticks = [_flops(side.comparison.subject) for side in result.sides]
    if len(ticks) == 2 and ticks[0] and ticks[1]:
        ranks = [side.comparison.space.rank for side in result.sides]
        text += (
            f" A tick of the {result.sides[1].label} takes {number(ticks[1] / ticks[0])} times the operations, for "
            f"{ranks[1]} independent parameters instead of {ranks[0]}."
        )
    return text


def facts(result: SideBySide) -> Iterator[Fact]:
    """Iterator over the facts of a comparison of arms, `result`, a `Fact` each: questions that a person asks first,
    each with one answer, made of the values for all arms. Nothing is checked."""
    for what in FACTS:
        yield Fact(what, " · ".join(next(row for row in rows(result) if row.what == what).values))


def rows(result: SideBySide) -> list[Row]:
    """Rows of the table that compares the arms in `result`, a `Row` each, with a label and a text for each arm: those
    of Table 13 of Sheu and Walker (1991), which count parameters and operations, then floating-point operations of a
    control tick, its time (ns), and RMS tracking errors (mm, mrad). Nothing is checked."""
    found = []
    for what, value in QUESTIONS:
        found.append(Row(what, ()) if value is None else Row(what, tuple(value(side) for side in result.sides)))
    return [row._replace(section=not row.values) for row in found]


def _flops(run: ControllerRun | None) -> int | None:
    return run.cost.flops if run is not None and run.cost else None


def _count(value: int | None) -> str:
    return "–" if value is None else f"{value:,}"


def _millimetres(value: float | None) -> str:
    return error(value, "mm")


def _native(run: ControllerRun | None) -> str:
    return f"{1e9 * run.cost.native:.0f} ns" if run is not None and run.cost and run.cost.native else "–"


def _called(run: ControllerRun | None) -> str:
    return f"{1e6 * run.cost.called:.1f} µs" if run is not None and run.cost else "–"


def _rises(side: Side) -> str:
    rise = side.comparison.subject.lyapunov_max_increase
    return "–" if rise is None else "never" if rise == 0.0 else f"by {number(rise)} J"


def _subject(value: Callable[[Side, ControllerRun], str]) -> Callable[[Side], str]:
    return lambda side: value(side, side.comparison.subject)


TIP_FIRST, TIP_LAST = "Tip error (RMS), first second", "Tip error (RMS), last 2 s"
RANK, TICK = "Independent parameters", "Operations of an adaptive tick"

QUESTIONS: tuple[tuple[str, Callable[[Side], str] | None], ...] = (
    ("The mechanism", None),
    ("Links", lambda side: str(len(side.comparison.mechanism.links))),
    ("Joints", lambda side: str(side.joints)),
    ("Actuators, which are the primary joints", lambda side: str(side.comparison.mechanism.dof)),
    ("Inertial parameters", lambda side: str(len(side.comparison.mechanism.parameter_names))),
    (RANK, lambda side: str(side.comparison.space.rank)),
    ("… as the paper prints them (Table 13)", lambda side: str(side.printed_rank)),
    ("Floating-point operations", None),
    ("Slotine-Li regressor, independent parameters", lambda side: _count(side.regressor.reduced)),
    ("Slotine-Li regressor, all parameters", lambda side: _count(side.regressor.full)),
    (TICK, lambda side: _count(_flops(side.comparison.subject))),
    ("… with all parameters", lambda side: _count(_flops(side.full))),
    ("Time of an adaptive tick", None),
    ("Native, in a loop over many states", lambda side: _native(side.comparison.subject)),
    ("… with all parameters adapted", lambda side: _native(side.full)),
    ("Called from Python", lambda side: _called(side.comparison.subject)),
    ("Tracking, from knowing nothing", None),
    (TIP_FIRST, _subject(lambda side, run: _millimetres(side.first_tip_rms(run)))),
    (TIP_LAST, _subject(lambda side, run: _millimetres(side.final_tip_rms(run)))),
    ("… with all parameters, last 2 s", lambda side: _millimetres(side.final_tip_rms(side.full))),
    ("… with adaptation off, last 2 s", lambda side: _millimetres(side.final_tip_rms(side.comparison.baseline))),
    ("Joint error (RMS), first second", _subject(lambda side, run: error(run.first_rms_error, "mrad"))),
    ("Joint error (RMS), last 2 s", _subject(lambda side, run: error(run.final_rms_error, "mrad"))),
    ("Lyapunov function rises", _rises),
    ("Peak torque", lambda side: f"{100 * float(side.comparison.peak_torque_shares.max()):.0f} % of the limit"),
    (
        "Steps at a torque limit",
        _subject(lambda side, run: f"{side.comparison.limited_steps(run):,} of {len(run.rollout.time):,}"),
    ),
)
FACTS = (
    "Links",
    "Joints",
    RANK,
    TICK,
    "Native, in a loop over many states",
    TIP_FIRST,
    TIP_LAST,
    "Lyapunov function rises",
)
