"""Section 5.3: a serial arm and one with a loop on one path."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from adaptctl.control import SlotineLi
from adaptctl.dynamics import Mechanism, equation_costs
from adaptctl.experiments.contest import ADAPTATION_OFF, ADAPTIVE, FULL, NO_MODEL, Contender
from adaptctl.experiments.over_time import over_time
from adaptctl.experiments.task_space import ARMS, ArmWithTip, TaskSpaceTracking
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import Comparison, Progress, Result, judged, write_artifacts
from adaptctl.recording.drawing import Drawing
from adaptctl.recording.page import SHEU_WALKER, Note, Report, Section, Table, files_section
from adaptctl.recording.result import Fact, Verdict
from adaptctl.recording.summary import summary as comparison_summary
from adaptctl.recording.wording import headline, number

START_OFF = np.array([0.05, 0.05, -0.05])
"""m: first error of both tips"""
PURPOSE = (
    "Sheu and Walker compare two arms whose end points move with three degrees of freedom: the PUMA's first three "
    "joints, and the semi-direct-drive arm with a closed loop. This experiment measures the cost of the loop. "
    "Both tips follow one path in space, with the same initial error and from zero estimates. The "
    "wrist of the PUMA is straight, and its tip is the flange."
)
TITLE = "A serial arm and an arm with a loop, on one task"
LAST = "Tip error (RMS), last 2 s"
NOTE = (
    "For the three-joint PUMA the paper prints 16. Energies give this value without differencing, because they "
    "contain the constant part of the potential as an additional parameter. Differences of energies give 15, "
    "and so does the rank of the torque regressor; 7 N − 6 is 15 for three links with gravity along the first axis. "
    "Operations are counted in the compiled equations. A regressor is counted at a configuration that closes the loop; "
    "a control step also closes it, by Newton steps."
)


@dataclass(frozen=True)
class ArmOnPath(TaskSpaceTracking):
    """Experiment of one arm on a path."""

    name: ClassVar[str] = "serial-versus-graph"
    title: ClassVar[str] = "{robot}: tip path in space"

    @property
    def purpose(self) -> str:
        """Question that the experiment answers, in words."""
        return PURPOSE

    def environment(self, mechanism: Mechanism) -> Any:
        """Tracking environment, its tip off the path at first."""
        tip, reference = self.tip(mechanism), self.reference(mechanism)
        first = reference(0.0).p
        return self.tracking(mechanism, reference, initial_error=tip.joints(tip.at(first) + START_OFF, first) - first)

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Controllers to compare. Raises `InputError` for a basis of another geometry."""
        model, full, gains = ReducedModel(mechanism, basis), ReducedModel.full(mechanism), self.gains(mechanism)
        k, everything = len(model.columns), len(full.columns)

        def law(on: ReducedModel, adapts: bool = True) -> SlotineLi:
            gain = self.adaptation(on) if adapts else None
            return SlotineLi(on, gains.bandwidth, gains.damping, gain, control_period=self.control_period)

        return [
            Contender(ADAPTIVE, f"Slotine-Li, {k} parameters", NO_MODEL, partial(law, model)),
            Contender(ADAPTATION_OFF, "Slotine-Li, adaptation off", NO_MODEL, partial(law, model, False)),
            Contender(FULL, f"Slotine-Li, all {everything} parameters", NO_MODEL, partial(law, full)),
        ]


Compared = Mapping[ArmWithTip, Comparison]


def side_by_side(seed: int, duration: float, period: float, progress: Progress) -> Result:
    """Result of both arms, of a `duration` (s), with a control `period` (s)."""
    found, complete = dict[ArmWithTip, Comparison](), False
    try:
        for arm in ARMS:
            one = ArmOnPath(robot=arm.robot, seed=seed, duration=duration, control_period=period)
            found[arm] = one.compare(partial(_told, progress, arm.label))
            if not found[arm].complete:
                break
        else:
            complete = True
    except KeyboardInterrupt:
        if not found:
            raise
    verdict = Verdict.merge(map(judged, found.values()))
    arms = {arm.name: _summary(arm, one) for arm, one in found.items()}
    answers = list(map(_answers, arms.values()))
    rows = [(what, *(one[what] for one in answers)) for what in answers[0]]
    told, words = [Fact(what, " · ".join(each)) for what, *each in rows], verdict.before(_answer(arms))
    about: dict[str, Any] = {"experiment": ArmOnPath.name, "complete": complete, "seed": seed}
    source, sections = f"Section 5.3 of {SHEU_WALKER}.", list(_sections(found, rows))
    page = Report(
        title=TITLE, outcome=words, facts=told, sections=sections, about=f"seed {seed}", source=source, **about
    )
    content = {"schema": "adaptctl/side-by-side/1", "verdict": verdict.as_builtins(), "duration": duration}
    each = {arm.name: partial(write_artifacts, comparison=one) for arm, one in found.items()}

    def write(folder: Path, progress: Progress) -> Path:
        return page.write(folder, content | about | {"arms": arms}, tables=each, progress=progress)

    return Result(complete, headline(words, complete), tuple(told), verdict, write)


def _told(progress: Progress, arm: str, what: str, share: float) -> None:
    progress(f"{arm}: {what}", share)


def _summary(arm: ArmWithTip, comparison: Comparison) -> dict[str, Any]:
    """Summary of an arm's runs."""
    mechanism, columns = comparison.mechanism, comparison.basis.columns
    loops, costs = mechanism.description.loops, {"reduced": equation_costs(mechanism, columns)}
    costs["full"] = equation_costs(mechanism)
    return comparison_summary(comparison) | {
        "label": arm.label,
        "links": len(mechanism.links),
        "joints": len(mechanism.links) + (len(loops.closures) if loops else 0),
        "actuators": mechanism.dof,
        "inertial_parameters": len(mechanism.parameter_names),
        "rank_printed": arm.printed_rank,
        "regressor_flops": {name: cost.regressor for name, cost in costs.items()},
    }


def _answers(arm: dict[str, Any]) -> dict[str, str]:
    """Answers by question."""
    errors = {name: f"{number(finding['value'])} mm" for name, finding in arm["findings"].items()}
    rise = arm["lyapunov_max_increase"]
    return {
        "Links": str(arm["links"]),
        "Joints": str(arm["joints"]),
        "Actuators (primary joints)": str(arm["actuators"]),
        "Inertial parameters": str(arm["inertial_parameters"]),
        "Base parameters": str(arm["rank"]),
        "… as printed (Table 13)": str(arm["rank_printed"]),
        "Operations of the regressor, base and all parameters": "{reduced:,}, {full:,}".format(
            **arm["regressor_flops"]
        ),
        "Operations of an adaptive control step": f"{_flops(arm, ADAPTIVE):,}",
        "… with all parameters": f"{_flops(arm, FULL):,}",
        "Tip error (RMS), first second": errors.get(f"first_tool_error.{ADAPTIVE}", "–"),
        LAST: errors.get(f"final_tool_error.{ADAPTIVE}", "–"),
        "… with all parameters, last 2 s": errors.get(f"final_tool_error.{FULL}", "–"),
        "… without adaptation, last 2 s": errors.get(f"final_tool_error.{ADAPTATION_OFF}", "–"),
        "Lyapunov function rises": "–" if rise is None else f"by {number(rise)} J" if rise else "never",
    }


def _flops(arm: dict[str, Any], run: str) -> int:
    """Operations per control step, 0 where not counted."""
    return ((arm["runs"].get(run) or {}).get("tick") or {}).get("flops") or 0


def _answer(arms: dict[str, dict[str, Any]]) -> str:
    ends = " and ".join(f"{_answers(arm)[LAST]} ({arm['label']})" for arm in arms.values())
    text = f"Starting from zero estimates, the final tip error is {ends} on the common path."
    if "–" in ends.split():
        text = "A run is too short for a final tip error."
    ticks, ranks = ([of(arm) for arm in arms.values()] for of in (partial(_flops, run=ADAPTIVE), itemgetter("rank")))
    if len(ticks) < len(ARMS) or not all(ticks):
        return text
    times = f"A control step of the {ARMS[1].label} takes {number(ticks[1] / ticks[0])} times the operations"
    return f"{text} {times}, for {ranks[1]} base parameters instead of {ranks[0]}."


def _sections(found: Compared, rows: Sequence[Sequence[str]]) -> Iterator[Section]:
    runs = [replace(one.subject, name=arm.name, label=arm.label) for arm, one in found.items()]
    errors = {arm.name: 1e3 * one.task_error.errors[ADAPTIVE] for arm, one in found.items() if one.task_error}
    caption = "Distance of each arm's tip from the common path (logarithmic scale)."
    drawing = Drawing("tip-error", caption, partial(over_time, runs, errors, "distance from the path [mm]"), plain=True)
    table = Table(("what", *(arm.label for arm in found)), rows, note=NOTE, align="lrr")
    where = "its report, recording and trace are in the folder"
    each = [Note(f"{where} {arm.name}.", f"{arm.label}:") for arm in found]
    yield Section("Experiment", (PURPOSE, table, drawing, *each))
    yield files_section("The table and the figure.", "The numbers of both arms, as JSON.")
