"""Saturated motors: adaptation frozen while a torque is held back, and not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Guarded
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit, position_unit
from adaptctl.errors import InputError
from adaptctl.experiments.contest import Contender, Outcome
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.learning import ADAPTATION_OFF, ADAPTIVE, Found
from adaptctl.experiments.marked_errors import Marked, marked_errors
from adaptctl.experiments.on_real_plant import OnRealPlant
from adaptctl.experiments.parameter_errors import SAMPLES, ParameterErrors
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import ControllerRun, Failure, Finding, wording
from adaptctl.recording.comparison import color_places

if TYPE_CHECKING:
    from adaptctl.recording.drawing import Drawing
    from adaptctl.simulation.effects import Effect

WITHOUT_FREEZE = "without-freeze"
END = 2.0
"""s: the end of a run, over which its last error is averaged"""


@dataclass(frozen=True)
class Saturation(OnRealPlant):
    """Experiment on saturated motors: an arm carries, for a while, a payload that is too heavy for its weak motors,
    under Slotine and Li's law with adaptation frozen while a torque is limited, never frozen, and off.

    The question is which tracking error is left when the payload is gone. `first_estimate` describes the initial
    estimate, for the report; `expected` maps failures of the first controller that the experiment is meant to show to
    the reasons why. Raises `InputError` at construction for a payload that is not dropped after it is picked up and
    within the run, where a setting that it inherits, the reference's `center`, `amplitude` or `frequency`, has not six
    entries, and for settings of the wrong type or out of their bounds, `NonFiniteError` for NaN or infinity.
    """

    name: ClassVar[str] = "saturation"
    title: ClassVar[str] = "{robot}: saturated motors, with and without adaptation frozen"
    first_estimate: ClassVar[str] = "a rough model: every link off by --parameter-error, up or down by seed"

    expected: ClassVar[Mapping[Failure, str]] = {
        Failure.SATURATED: "the payload is more than its motors can carry",
    }

    strength: float = setting(0.3, "the motors have this share of their torque limits", low=0.01, high=1.0)
    rate_limit: float = setting(2e4, "torques change by at most this, N m/s", low=1.0, high=1e9)
    payload: float = setting(4.0, "mass that is held for a while, kg", low=0.0, high=1e3)
    start: float = setting(6.0, "when it is picked up, s", low=0.0, high=300.0)
    stop: float = setting(9.0, "when it is dropped, s", low=0.0, high=300.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.start < self.stop <= self.duration:
            raise InputError(
                f"stop: expected a time after the start, {self.start:g} s, and within the {self.duration:g} s of the "
                f"run, got {self.stop:g}"
            )

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: whether adaptation should be frozen
        while motors saturate."""
        return (
            f"An arm whose motors have {100 * self.strength:.0f} % of their strength holds {self.payload:g} kg from "
            f"{self.start:g} to {self.stop:g} s, more than it can carry. While a motor saturates, the error says "
            "nothing of the parameters: an estimate that goes on learning from it winds up, as an integrator does. "
            "All controllers have the same gains; only one freezes its adaptation while its torque is held back."
        )

    def effects(self, mechanism: Mechanism) -> Sequence[Effect]:
        """Effects of the plant besides rigid links: a payload, a point of mass `payload` (kg) at the origin of the
        frame of the last link that has mass, from `start` to `stop` (s), and a limit of the torques' rate of change,
        `rate_limit`, N m/s (N/s for a prismatic joint). `mechanism` is not used."""
        from adaptctl.simulation.effects import PayloadHeld, TorqueRateLimit

        return (PayloadHeld(self.payload, self.start, self.stop), TorqueRateLimit(self.rate_limit))

    def torque_limits(self, mechanism: Mechanism) -> Array:
        """Torque limits (r,) of the weak motors at the r primary (independently moving) joints of a `mechanism`, N m (N
        if prismatic): the fraction `strength` of the arm's own."""
        return self.strength * super().torque_limits(mechanism)

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """List of the controllers to compare, a `Contender` (name, label and controller) each, in the order in which
        they run: Slotine and Li's law with adaptation frozen while a torque is limited, the experiment's subject; with
        adaptation off; and never frozen. `basis`, a `FundamentalBasis`, has the mechanism's k fundamental (base)
        parameters.

        Torques are limited by a `Guarded` around the law: the law itself has no limits, since with them it would always
        stop learning at a limit. Raises `GainError` for gains too large for the control period, `InputError` for a
        basis of another geometry than the mechanism's.
        """
        model = ReducedModel(mechanism, basis)
        law, off = (
            replace(self.from_rough(model, adapting=adapting), torque_limits=np.inf) for adapting in (True, False)
        )
        limits, knows = self.torque_limits(mechanism), f"links within {100 * self.parameter_error:.0f} %"
        return [
            Contender.of(ADAPTIVE, "Frozen while saturated", knows, Guarded(law, limits, self.rate_limit)),
            Contender.of(ADAPTATION_OFF, "Adaptation off", knows, Guarded(off, limits, self.rate_limit)),
            Contender.of(WITHOUT_FREEZE, "Never frozen", knows, Guarded(law, limits, self.rate_limit, freeze=False)),
        ]

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over the findings, a `Finding` (named number with unit) each. Of each run: the RMS tracking error of
        all joints from the payload's drop on, rad (m if prismatic; none for a run that ended before); the fraction of
        samples (no unit) with a limited torque; and the largest magnitude of any estimated parameter, SI units. Once:
        the RMS error of all joints over the whole run with adaptation frozen, divided by that with it never frozen (no
        unit; none where a run is missing or the latter is 0). `outcome`, an `Outcome`, has the runs; `basis` is not
        used."""
        runs = {run.name: run for run in outcome.runs}
        for run in outcome.runs:
            meaning = f"{run.label}: RMS error of all joints from the drop on"
            if (after := run.rms_error(start=self.stop)) is not None:
                yield Finding(f"rms_error_after.{run.name}", after, position_unit(outcome.mechanism), meaning)
        frozen, never = (runs[name].rms_error() if name in runs else None for name in (ADAPTIVE, WITHOUT_FREEZE))
        if frozen is not None and never:
            meaning = "RMS error of the whole run, frozen over never frozen"
            yield Finding("freeze_over_none", frozen / never, "1", meaning)
        for run in outcome.runs:
            share, moved = float(np.mean(held_back(run))), float(np.abs(run.rollout.estimate).max(initial=0.0))
            yield Finding(f"saturated.{run.name}", share, "1", f"{run.label}: share of periods with a torque held back")
            yield Finding(
                f"largest_estimate.{run.name}", moved, "SI", f"{run.label}: largest estimate of any parameter"
            )

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Sentences for the report, never None here, with the RMS tracking errors of all joints, mrad (mm), of the
        whole run with adaptation frozen and never frozen, and, if these come after the payload's drop, of its last two
        seconds with adaptation frozen and off. `outcome`, an `Outcome`, has the runs; `found`, the findings by name, is
        not used. Raises `KeyError` where one of the three runs is missing."""
        runs, unit = {run.name: run for run in outcome.runs}, error_unit(outcome.mechanism)
        frozen, never = (wording.error(runs[name].rms_error(), unit) for name in (ADAPTIVE, WITHOUT_FREEZE))
        text = (
            f"With adaptation frozen while motors saturate, the RMS error of the run is {frozen}, never frozen {never}."
        )
        if min(runs[name].duration for name in (ADAPTIVE, ADAPTATION_OFF)) < self.stop + END:
            return text
        return (
            f"{text} In the last {END:g} s, the payload long gone, it is "
            f"{wording.error(runs[ADAPTIVE].final_rms_error, unit)}, with adaptation off "
            f"{wording.error(runs[ADAPTATION_OFF].final_rms_error, unit)}."
        )

    def drawings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Drawing]:
        """Iterator over one figure for the report, a `Drawing` (name, caption and function that draws it): the
        parameter error |w (estimate - true)| / |w true| (no unit) of each run over time, s, w being the RMS torque that
        each parameter makes along the first run's motion, and when a torque was limited. `outcome`, an `Outcome`, has
        the runs, `basis` the fundamental (base) parameters of which the errors are. Nothing is checked."""
        from adaptctl.recording.drawing import Drawing

        points = outcome.runs[0].rollout
        every = slice(None, None, max(1, len(points.time) // SAMPLES))
        errors = ParameterErrors.along(
            ReducedModel(outcome.mechanism, basis), *(x[every] for x in (points.p, points.v, points.reference_a))
        )
        found, places = ((run, errors.of(run)) for run in outcome.runs), color_places(outcome.runs)
        curves = [Marked(run, e, held_back(run), places[run.name]) for run, e in found if e is not None]
        yield Drawing(
            "saturation",
            "Parameter errors in shares of the torque of all parameters, and when limits held a torque back.",
            partial(marked_errors, curves, "torque held back"),
        )


def held_back(run: ControllerRun) -> Array:
    """Flags (T,) for the T samples of a `run`: 1 where the limits of the torque or of its rate of change, or the plant,
    reduced a torque that the control law asked for, else 0. Nothing is checked."""
    marks = [run.rollout.marks[name] for name in ("torque_limited", "rate_limited") if name in run.rollout.marks]
    return np.asarray(np.max([run.rollout.clipped, *marks], axis=0))
