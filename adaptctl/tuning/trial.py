"""Closed loops of one mechanism under many gains at once: the gains are memory, and one code serves them all."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation.limits import LARGEST_COMPILED
from adaptctl.control.adaptation.gradient import TINY, Gradient
from adaptctl.control.controller import Controller, Reference, ReferencePoint
from adaptctl.dynamics import Mechanism
from adaptctl.scalars import Column, absolute, clip, where
from adaptctl.simulation import Plant, Rollouts, simulate_many

CAP = Gradient.cap
EVERY = 50
"""control periods from one sample to the next"""


class TrialMemory(NamedTuple):
    """The memory of a trial: that of the law, its gains, and whether its torque comes late."""

    estimate: Any
    q: Any
    motion: Any
    s: Any
    torque: Any
    elapsed: Any
    gain: Any
    damping: Any
    bandwidth: Any
    late: Any
    """(1,) 1 where torques act one control period late, else 0"""


@dataclass(frozen=True, eq=False)
class Trial(Controller[TrialMemory]):
    """Slotine and Li's law with `Gradient` adaptation of all parameters from zero, within torque limits (r,).

    Nothing is learned from a period whose torque was limited. It is `SlotineLi` on a reduced model with the mapped
    gain, to round-off.
    """

    mechanism: Mechanism
    limits: Array
    period: float

    @property
    def dof(self) -> int:
        """Number of joints r."""
        return self.mechanism.dof

    @property
    def home(self) -> Array:
        """Positions (r,), rad or m, where loops, if any, are known to close."""
        return self.mechanism.home

    def start(self, p: Array, v: Array) -> TrialMemory:
        """The memory before the first tick; gains are put into it afterwards."""
        equations, r = self.mechanism.equations, self.dof
        zero, rest, one = np.zeros(equations.parameters), np.zeros(r), np.ones(r)
        motion, q = np.zeros(equations.motion_size), self.mechanism.configuration(p)
        return TrialMemory(zero, q, motion, rest, rest, np.zeros(1), zero, one, one, np.zeros(1))

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: TrialMemory) -> tuple[Column, TrialMemory]:
        """The torque (r,) N m of one tick, now or a period later, and the memory after learning from the period that
        has passed."""
        equations, m = self.mechanism.equations, memory
        q, e, e_rate = equations.closed(p, m.q), p - reference.p, v - reference.v
        v_r, a_r = reference.v - m.bandwidth * e, reference.a - m.bandwidth * e_rate
        s = v - v_r
        slope = equations.remembered(m.motion).powers(s, range(equations.parameters))
        power, taken = s @ (m.damping * s), slope @ (m.gain * slope)
        share = power / (power + (CAP * self.period) * taken + TINY)
        estimate = m.estimate - (m.elapsed[0] * share) * (m.gain * slope)
        motion = equations.motion(q, v, v_r, a_r)
        torque = motion.torque(estimate) - m.damping * s
        limited = Column(map(clip, torque, (-self.limits).tolist(), self.limits.tolist()))
        learning: Any = self.period
        for asked, given in zip(torque, limited, strict=True):
            learning = where(absolute(asked - given) > 0.0, 0.0, learning)
        applied = Column(where(m.late[0] > 0.5, x, y) for x, y in zip(m.torque, limited, strict=True))
        kept = m._replace(estimate=estimate, q=q, motion=motion.numbers, s=s, torque=limited)
        return applied, kept._replace(elapsed=Column((learning,)))


class TrialSetting(NamedTuple):
    """A closed loop that is tried."""

    bandwidth: Array
    damping: Array
    gain: Array
    """(P,) diagonal of Gamma; zero for adaptation off"""
    parameters: Array
    """(P,) the true ones"""
    late: bool = False


@dataclass(frozen=True, eq=False)
class Trials:
    """Trials on one plant, reference and initial error (r,)."""

    plant: Plant
    reference: Reference
    off: Array

    @property
    def possible(self) -> bool:
        """True if the mechanism has few enough links to compile."""
        return len(self.plant.mechanism.links) <= LARGEST_COMPILED

    def run(self, settings: list[TrialSetting], duration: float) -> Rollouts:
        """Runs (M,) of the settings, side by side."""
        trial, M = _trial(self.plant), len(settings)
        first = self.reference(np.zeros(1)).p[0] + self.off
        p, v = np.broadcast_to(first, (M, trial.dof)), np.zeros((M, trial.dof))
        columns = [np.array(rows, dtype=np.float64) for rows in zip(*settings, strict=True)]
        bandwidth, damping, gain, parameters, late = columns
        memory = trial.init(p, v)._replace(bandwidth=bandwidth, damping=damping, gain=gain, late=late[:, None])
        given: dict[str, Any] = {"parameters": parameters, "p": p, "v": v, "memory": memory, "every": EVERY}
        return simulate_many(self.plant, trial, self.reference, duration=duration, **given)


@lru_cache(maxsize=8)
def _trial(plant: Plant) -> Trial:
    """The law of a plant's trials, kept, and its code with it."""
    return Trial(plant.mechanism, np.asarray(plant.torque_limits), plant.control_period)
