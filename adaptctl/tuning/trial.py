"""Closed loops of one mechanism under many gains at once: one code serves them all."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation.limits import LARGEST_COMPILED
from adaptctl.control import SlotineLi
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import Controller, Reference, ReferencePoint
from adaptctl.control.gains.workspace import Workspace
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, where
from adaptctl.simulation import Plant, Rollouts, simulate_many

EVERY = 50
"""control periods from one sample to the next"""


@dataclass(frozen=True, eq=False)
class Delayed(Controller[AdaptiveState]):
    """Slotine and Li's law, its torques a control period late where `late` is 1, and in time where it is 0."""

    tunable = ("late",)

    of: SlotineLi
    late: float = 0.0

    @property
    def dof(self) -> int:
        """Number of joints r."""
        return self.of.dof

    @property
    def home(self) -> Array:
        """Positions (r,) where loops, if any, are known to close."""
        return self.of.home

    def start(self, p: Array, v: Array) -> AdaptiveState:
        """The memory before the first tick: the law's own."""
        return self.of.start(p, v)

    def law(
        self, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> tuple[Column, AdaptiveState]:
        """The torque (r,) N m of one tick, the last one's or the new one, and the law's memory after it."""
        _, after = self.of.law(p, v, reference, memory)
        late = self.late > 0.5
        return Column(where(late, old, new) for old, new in zip(memory.torque, after.torque, strict=True)), after


class TrialSetting(NamedTuple):
    """Setting of a trial: the gains and true parameters of a closed loop that is tried."""

    bandwidth: Array
    damping: Array
    gain: Array
    """(P,) diagonal of Gamma; zero for adaptation off"""
    parameters: Array
    """(P,) the true ones"""
    late: bool = False


@dataclass(frozen=True, eq=False)
class Trials:
    """Trials on one plant, reference and initial error (r,): Slotine and Li's law on all parameters, from zero.

    Nothing is learned from a period whose torque was limited. It is the law on a reduced model with the mapped gain,
    to round-off.
    """

    plant: Plant
    reference: Reference
    off: Array

    @property
    def possible(self) -> bool:
        """True if the mechanism has few enough links to compile."""
        return len(self.plant.mechanism.links) <= LARGEST_COMPILED

    def run(self, settings: list[TrialSetting], duration: float) -> Rollouts:
        """Runs (M,) of the settings, side by side."""
        p = self.reference(np.zeros(1)).p[0]
        law, parameters = _law(self.plant, tuple(p.tolist())), np.array([one.parameters for one in settings])
        laws = [law.having(_numbers(law, one)) for one in settings]
        start = {"parameters": parameters, "p": p + self.off, "v": np.zeros(law.dof)}
        return simulate_many(self.plant, laws, self.reference, duration=duration, every=EVERY, **start)


def _numbers(law: Delayed, one: TrialSetting) -> dict[str, object]:
    """All of a law's numbers by name, those of a setting among them: as they are, for tuning has judged them."""
    of = {"bandwidth": one.bandwidth, "damping": one.damping, "adaptation.gain": one.gain}
    return {**law.numbers, "late": float(one.late), **{f"of.{name}": value for name, value in of.items()}}


@lru_cache(maxsize=8)
def _law(plant: Plant, p: tuple[float, ...]) -> Delayed:
    """The law of a plant's trials near p, kept, and its code with it; its gains are nobody's."""
    model, few = ReducedModel.full(plant.mechanism), np.full(plant.dof, 1e-9)
    gain, at = np.ones(len(model.columns)), Workspace.along(plant.mechanism, np.array(p), 0.0)
    return Delayed(SlotineLi(model, few, few, gain, None, plant.control_period, at, plant.torque_limits))
