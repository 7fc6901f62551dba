"""A payload picked up and dropped in mid-motion: how long each law takes to have its error back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.experiments.adaptation_laws import AdaptationLaws
from adaptctl.experiments.contest import Outcome
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.rough_model import deviations
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.mechanism.pose import Array
from adaptctl.recording import Finding, Run

if TYPE_CHECKING:
    import gymnasium

    from adaptctl.simulation.effects import Effect, Payload

WINDOW = 0.5
"""s over which errors are averaged"""
EARLIER = 2.0
"""s before the payload is picked up, whose error is the measure"""
TWICE = 2.0


@dataclass(frozen=True)
class PayloadDrop(AdaptationLaws):
    """All laws from one rough model, an arm that picks up a payload and drops it again."""

    name: ClassVar[str] = "payload-drop"
    title: ClassVar[str] = "{robot}: a payload picked up and dropped"

    duration: float = setting(40.0, "length of every run, s", low=0.01, high=300.0)
    velocity_noise: float = setting(
        0.03, "deviation of what is measured of velocities, rad/s: without it errors fall on and on", low=0.0, high=1.0
    )
    payload: float = setting(2.0, "mass of the payload, kg", low=0.0, high=1e3)
    size: float = setting(0.1, "edge of the payload, a cube, m", low=0.0, high=10.0)
    lever: float = setting(0.05, "its centre before the flange, m", low=-10.0, high=10.0)
    start: float = setting(10.0, "when it is picked up, s", low=0.0, high=300.0)
    stop: float = setting(25.0, "when it is dropped, s", low=0.0, high=300.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not EARLIER <= self.start < self.stop < self.duration:
            raise InputError(
                f"start, stop: expected {EARLIER:g} s before the payload is picked up, and that it is dropped after "
                f"that and within the {self.duration:g} s of the run, got {self.start:g} and {self.stop:g}"
            )

    @property
    def purpose(self) -> str:
        """What is asked."""
        return (
            f"An arm picks up {self.payload:g} kg at {self.start:g} s and drops it at {self.stop:g} s, and nobody "
            "tells its controller. "
            + super().purpose
            + " The measure is the time that a law takes, after either event, "
            f"until its error over {WINDOW:g} s is back below twice what it was in the {EARLIER:g} s before."
        )

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """The tracking environment with the payload; no error ends a run."""
        import gymnasium

        return gymnasium.make(
            "adaptctl.envs:adaptctl/Tracking-v0",
            robot=mechanism,
            reference=self.reference(mechanism),
            duration=self.duration,
            control_period=self.control_period,
            initial_error=self.initial_error,
            error_bound=np.inf,
            effects=tuple(self.effects()),
        )

    def effects(self) -> Iterator[Effect]:
        """The payload, and the noise asked for."""
        from adaptctl.simulation.effects import Encoder, PayloadHeld

        yield PayloadHeld(self._body(), self.start, self.stop)
        if self.velocity_noise:
            yield Encoder(velocity_noise=self.velocity_noise)

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """How long each law takes to return, after each event; where it does not, how far it stays off."""
        for run in outcome.runs:
            before = run.rms_error(self.start - EARLIER, self.start)
            for event, begin, end in (("pickup", self.start, self.stop), ("drop", self.stop, self.duration)):
                if before is None or run.duration <= begin:
                    continue
                time = time_to_return(run, begin, end, TWICE * before)
                if time is not None:
                    meaning = f"{run.label}: time after the {event} until the error is below twice the earlier"
                    yield Finding(f"return_after_{event}.{run.name}", time, "s", meaning)
                else:
                    last = run.rms_error(min(end, run.duration) - EARLIER, end) or np.nan
                    meaning = f"{run.label}: does not return after the {event}; error at the end over the earlier"
                    yield Finding(f"not_back_after_{event}.{run.name}", last / before, "1", meaning)
        yield from super().findings(outcome, basis)

    def _body(self) -> Payload:
        from adaptctl.simulation.effects import Payload

        return Payload(self.payload, np.array([0.0, 0.0, self.lever]), self.payload * self.size**2 / 6.0 * np.eye(3))

    def _deviations(self, model: ReducedModel) -> Array:
        """How far off the rough model may be, a payload like this on the last link included."""
        nothing = np.zeros(len(model.mechanism.parameter_names))
        loaded = self._body().added_to(nothing, len(model.mechanism.description.bodies) - 1)
        return np.hypot(super()._deviations(model), deviations(model, loaded, 1.0))


def time_to_return(run: Run, begin: float, end: float, below: float) -> float | None:
    """s from `begin` until the error, averaged over WINDOW, stays below a bound up to `end`; None for never."""
    time, error = run.rollout.time, run.moving_rms_error(WINDOW)
    inside = (time >= begin) & (time < end)
    above = np.flatnonzero(inside & (error > below))
    if above.size == 0:
        return 0.0
    back = float(time[above[-1]]) + run.rollout.control_period
    return back - begin if back < min(end, run.duration) - WINDOW else None
