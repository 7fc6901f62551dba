"""Comparison of laws on a payload picked up and dropped in mid-motion: how long their errors take to return."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Natural
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.errors import InputError
from adaptctl.experiments.adaptation_laws import AdaptationLaws
from adaptctl.experiments.contest import Outcome
from adaptctl.experiments.experiment import FAR, setting
from adaptctl.experiments.learning import ADAPTATION_OFF, Found
from adaptctl.experiments.recovery import WINDOW, Recovery, recovery, recovery_times
from adaptctl.experiments.rough_model import deviations
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import ControllerRun, Finding

if TYPE_CHECKING:
    from adaptctl.recording.drawing import Drawing
    from adaptctl.simulation.effects import Effect, Payload


@dataclass(frozen=True)
class PayloadDrop(AdaptationLaws):
    """Experiment on a payload that an arm picks up and drops in motion: the time that each adaptation and control law
    takes, from one rough model, until its RMS tracking error over 2 s is below twice that of the 2 s before the pickup.
    The run is divided into `times` equal parts; in each the last link holds the payload from `start` to `stop`, s from
    the part's beginning. In the settings, s as a letter is the sliding variable, the velocity error plus the bandwidth
    times the position error. `error_bound` (100 rad or m) is the joint error that ends a run.

    Raises `InputError` at construction for a payload that is not picked up 2 s or more after the start and dropped
    later within its part of the run, for a law given twice, and for settings of the wrong type or out of their bounds,
    `NotFoundError` for an unknown law or motion, `NonFiniteError` for NaN or infinity.
    """

    name: ClassVar[str] = "payload-drop"
    title: ClassVar[str] = "{robot}: a payload picked up and dropped"

    duration: float = setting(40.0, "length of every run, s", low=0.01, high=1000.0)
    velocity_noise: float = setting(
        0.03, "deviation of what is measured of velocities, rad/s: without it errors fall on and on", low=0.0, high=1.0
    )
    acceleration_gain: float = setting(
        0.02,
        "adaptive computed torque, which learns from accelerations, has this share of the gain",
        low=1e-6,
        high=1.0,
    )
    dead_zone: float = setting(0.08, "width of the dead zone of s, rad/s: wider than the noise", low=1e-6, high=10.0)
    payload: float = setting(2.0, "mass of the payload, kg", low=0.0, high=1e3)
    size: float = setting(0.1, "edge of the payload, a cube, m", low=0.0, high=10.0)
    lever: float = setting(0.05, "its centre before the flange, m", low=-10.0, high=10.0)
    start: float = setting(10.0, "when it is picked up, s", low=0.0, high=300.0)
    stop: float = setting(25.0, "when it is dropped, s", low=0.0, high=300.0)
    times: int = setting(1, "how often it is picked up and dropped, in equal parts of the run", low=1, high=100)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not WINDOW <= self.start < self.stop < self._turn:
            part = "" if self.times == 1 else f"each of {self.times} parts of "
            raise InputError(
                f"start, stop: expected {WINDOW:g} s before the payload is picked up, and that it is dropped after "
                f"that and within {part}the {self.duration:g} s of the run, got {self.start:g} and {self.stop:g}"
            )

    @property
    def _turn(self) -> float:
        """Time (s) from one pickup to the next."""
        return self.duration / self.times

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: how fast the tracking error under
        each law recovers when a payload is picked up and dropped."""
        return (
            f"An arm picks up {self.payload:g} kg at {self.start:g} s and drops it at {self.stop:g} s, and nobody "
            "tells its controller. "
            + super().purpose
            + " The measure is the time that a law takes, after either event, until "
            f"its error over {WINDOW:g} s is back below twice what it was in the {WINDOW:g} s before the pickup. Gains "
            "know that a payload like this may come; natural adaptation, whose gain is its estimate, starts from "
            "half of it. Parameter errors are against the arm alone: while the payload is held they show it."
        )

    error_bound: ClassVar[float] = FAR

    def effects(self) -> Iterator[Effect]:
        """Iterator over the plant's effects besides rigid links: for each of `times` equal parts of the run, the
        payload on the last link from `start` to `stop` (s from the part's beginning); and the noise of measured
        velocities, rad/s, unless it is 0."""
        from adaptctl.simulation.effects import PayloadHeld

        for k in range(self.times):
            yield PayloadHeld(self._body(), self.start + k * self._turn, self.stop + k * self._turn)
        yield from super().effects()

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over the findings, a `Finding` (named number with unit) each. For each law and each event (pickup
        and drop, with more `times` the last of each too): the time, s, until its RMS tracking error over 2 s is less
        than twice that of the 2 s before the first pickup; where it never is, the ratio of its error in the 2 s before
        the next event, or the run's end, to that one (no unit). For each law: the error before the pickup, mrad (mm);
        its parameter error at the end, |w (estimate - true)| / |w true| (no unit), w being the RMS torque that each
        parameter makes along the reference; the fraction of samples (no unit) whose excitation passed the law's
        threshold, if it has one, or, of laws on pseudo-inertias, the least eigenvalue of these, SI units; and the
        median time, us, of computing one torque. `outcome`, an `Outcome`, has the runs, `basis` the fundamental (base)
        parameters. Nothing is checked."""
        for one in self._recoveries(outcome):
            name, event = one.run.name, one.event.replace(" ", "_")
            if one.time is not None:
                meaning = f"{one.run.label}: time after the {event} until the error is below twice the earlier"
                yield Finding(f"return_after_{event}.{name}", one.time, "s", meaning)
            elif one.left is not None:
                meaning = f"{one.run.label}: does not return after the {event}; error at the end over the earlier"
                yield Finding(f"not_back_after_{event}.{name}", one.left, "1", meaning)
        for run in outcome.runs:
            if (earlier := self._earlier(run)) is not None:
                meaning = f"{run.label}: RMS error in the {WINDOW:g} s before the pickup"
                yield Finding(f"earlier_error.{run.name}", 1e3 * earlier, error_unit(outcome.mechanism), meaning)
        yield from super().findings(outcome, basis)

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Sentences for the report with the shortest and the longest time, s, after pickup and after drop until the
        tracking errors of the laws that adapt are back below twice the error before the pickup, and how many never are;
        None where no law adapts. `outcome`, an `Outcome`, has the runs, `found` the findings by name. Nothing is
        checked."""
        adapting = [run for run in outcome.runs if run.rollout.estimate.shape[1] and run.name != ADAPTATION_OFF]
        events = ("pickup", "drop", *(("last pickup", "last drop") if self.times > 1 else ()))
        return " ".join(self._event_words(event, adapting, found) for event in events) if adapting else None

    def _event_words(self, event: str, runs: Sequence[ControllerRun], found: Found) -> str:
        key = event.replace(" ", "_")
        back = found.each(f"return_after_{key}", runs, "s", rising=True)
        lost = found.each(f"not_back_after_{key}", runs)
        span = " to ".join(dict.fromkeys((*back[:1], *back[-1:])))
        parts = [f"errors are below twice what they were before within {span}"] if back else []
        come = "does" if len(lost) == 1 else "do"
        parts += [f"{len(lost)} of {len(runs)} laws {come} not come back"] if lost else []
        return f"After the {event} {', and '.join(parts) or 'no law came so far'}."

    def drawings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Drawing]:
        """Iterator over figures for the report, a `Drawing` (name, caption and function that draws it) each: the times,
        s, until tracking errors are back below twice that before the pickup, then the parameter errors, fractions (no
        unit) of the torque of all parameters, over time, s. `outcome`, an `Outcome`, has the runs, `basis` the
        fundamental (base) parameters by which errors are measured. Nothing is checked."""
        from adaptctl.recording.drawing import Drawing

        found = list(self._recoveries(outcome))
        if found:
            yield Drawing(
                "recovery",
                f"Time from either event until the error over {WINDOW:g} s is below twice the earlier one, which is "
                f"given in brackets, in {error_unit(outcome.mechanism)}: a law that tracked better before has more to "
                "come back to.",
                partial(recovery_times, found),
            )
        yield from super().drawings(outcome, basis)

    def _recoveries(self, outcome: Outcome) -> Iterator[Recovery]:
        """Recovery of every run after the first and the last of each event that it reached, but none of a run without
        an error before, which has nothing to come back to."""
        events = [("pickup", self.start, self.stop), ("drop", self.stop, self._turn)]
        if self.times > 1:
            late = (self.times - 1) * self._turn
            events += [(f"last {event}", begin + late, end + late) for event, begin, end in events]
            events[1] = ("drop", self.stop, self._turn + self.start)
        for run in outcome.runs:
            earlier = self._earlier(run)
            for event, begin, end in events:
                if earlier and run.duration > begin:
                    yield recovery(run, event, earlier, begin, end)

    def _earlier(self, run: ControllerRun) -> float | None:
        return run.rms_error(self.start - WINDOW, self.start)

    def _natural(self, mechanism: Mechanism) -> tuple[Natural, Array]:
        """Natural adaptation from half a payload on the last link, its rate there giving the others' gain."""
        last = len(mechanism.description.bodies) - 1
        rough, law = self.rough(mechanism), super()._natural(mechanism)[0]
        first = self._body(0.5).added_to(rough, last)
        rates = np.full(len(first) - 9 * (last + 1), float(law.rate))
        off = np.hypot(self.parameter_error * rough[10 * last], self.payload)
        rates[last] = self.rate * (off / first[10 * last]) ** 2
        return Natural(rates), first

    def _body(self, share: float = 1.0) -> Payload:
        """Payload as a rigid body, or a share of it."""
        from adaptctl.simulation.effects import Payload

        mass = share * self.payload
        return Payload(mass, np.array([0.0, 0.0, self.lever]), mass * self.size**2 / 6.0 * np.eye(3))

    def deviations(self, model: ReducedModel) -> Array:
        """Standard deviations (k,) of the k parameters of a reduced `model` from their initial estimates, in SI units:
        sqrt(a^2 + b^2) for each, a being its deviation where links and drives are off by the fraction `parameter_error`
        of their size, and b the size of what the payload adds to it while the last link holds it."""
        nothing = np.zeros(len(model.mechanism.parameter_names))
        loaded = self._body().added_to(nothing, len(model.mechanism.description.bodies) - 1)
        return np.hypot(super().deviations(model), deviations(model, loaded, 1.0))
