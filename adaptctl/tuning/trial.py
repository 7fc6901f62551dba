"""Closed loops of one mechanism under many gains at once: one code serves them all."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation.kernel import LARGEST_COMPILED
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
    """Slotine and Li's law, `of`, whose torques come one control period late where `late` is 1, and in time where it is
    0, the default. `late` is a tunable number, an argument of the native code, so that arms with and without the delay
    share one code. Nothing is checked here."""

    tunable = ("late",)

    of: SlotineLi
    late: float = 0.0

    @property
    def dof(self) -> int:
        """Number r of the joints that the wrapped control law moves."""
        return self.of.dof

    @property
    def home(self) -> Array:
        """Positions (r,) of the r joints, rad (m if prismatic), at the mechanism's home configuration, where its
        kinematic loops are known to close; zeros without loops."""
        return self.of.home

    def start(self, p: Array, v: Array) -> AdaptiveState:
        """The internal state before the first control period, the wrapped law's own, of arms at positions p in rad (m
        if prismatic) and velocities v in rad/s (m/s), (..., r) for r joints; its torque is zero. Raises `InputError` on
        a wrong shape of p, `NonFiniteError` on NaN or infinity in it, `SingularityError` near a singularity of the
        kinematic loops."""
        return self.of.start(p, v)

    def law(
        self, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> tuple[Column, AdaptiveState]:
        """The torque (r,) of r joints, N m (N if prismatic), for one control period, and the wrapped law's internal
        state after it. The torque is the wrapped law's for the last period where torques come late, else its new one.
        Measured positions p are in rad (m) and velocities v in rad/s (m/s), (r,); `reference` has the desired
        positions, velocities and accelerations (r,), in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic);
        `memory` is the internal state of the last control period. Nothing is checked here: the method `step` checks
        shapes."""
        _, after = self.of.law(p, v, reference, memory)
        late = self.late > 0.5
        return Column(where(late, old, new) for old, new in zip(memory.torque, after.torque, strict=True)), after


class TrialSetting(NamedTuple):
    """Setting of one trial run of Slotine and Li's law on r joints: its gains, and the true parameters of the simulated
    arm. Nothing is checked.

    `bandwidth` (r,) is in 1/s and `damping` (r,) in N m s/rad (N s/m if prismatic); `gain` (P,) is the diagonal of the
    adaptation gain on all P inertial and friction parameters, in their units squared per J, zero for adaptation off.
    `parameters` (P,) are the arm's true inertial and friction ones, SI units, in the order of
    `Mechanism.parameter_names`. With `late` True, False by default, torques come a control period late.
    """

    bandwidth: Array
    damping: Array
    gain: Array
    """(P,) diagonal of Gamma; zero for adaptation off"""
    parameters: Array
    """(P,) the true ones"""
    late: bool = False


@dataclass(frozen=True, eq=False)
class Trials:
    """Trial runs on one `plant` and `reference`: simulated closed loops of Slotine and Li's law, which adapts all P
    inertial and friction parameters from an initial estimate of zero. Arms of r joints start at rest; `off` (r,), rad
    (m if prismatic), are their initial positions less the reference's.

    Nothing is learned from a period whose torque was limited. To round-off the law is the same as on a reduced model
    with the adaptation gain mapped to that model's parameters. Nothing is checked.
    """

    plant: Plant
    reference: Reference
    off: Array

    @property
    def possible(self) -> bool:
        """True if the mechanism has at most 100 links, so that native code is made for it: only then can the trials be
        run."""
        return len(self.plant.mechanism.links) <= LARGEST_COMPILED

    def run(self, settings: list[TrialSetting], duration: float) -> Rollouts:
        """Simulated runs, a `Rollouts`, of `duration` seconds, one for each of the M `settings`, computed together in
        native code. Every 50th control period, the first included, is a sample of positions, velocities, torques and
        estimates. Raises `InputError` for a mechanism of more than 100 links and a duration below a control period,
        `SingularityError` where kinematic loops cannot be followed to the start."""
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
