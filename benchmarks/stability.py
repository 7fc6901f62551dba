"""Closed loops of random arms over ten minutes: does what is accepted stay stable? Run: python -m benchmarks.stability

An arm has draws of gains up to the accepted limits, adaptation gains, payloads and references, all in lanes of one
kernel; beside the library's law the same draws run with the trapezium on prior ranges, which it had before.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from copy import copy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import adaptctl
from adaptctl.arrays import Array
from adaptctl.control import (
    Controller,
    Gains,
    Gradient,
    ReferencePoint,
    SlotineLi,
    adaptation_gain,
    estimate_hold,
    hold_number,
    typical_inertia,
)
from adaptctl.control.gains.hold import LARGEST_SAMPLED_GAIN
from adaptctl.control.ringing import Ringing, correlation
from adaptctl.description import Description, Joint, JointKind, Link, Pose
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column
from adaptctl.simulation import SemiImplicitEuler, simulate_many

PERIOD = 1e-3
RINGS = -0.9
"""of rho at the end: finite, but of no use"""


class LaneNumbers(Column):
    """Numbers of a lane where a law has its settings."""

    __slots__ = ()
    ndim = 1

    def tolist(self) -> list[Any]:
        """The entries as a list."""
        return list(self.of)


class LoopSettings(NamedTuple):
    """A lane's settings, remembered instead of compiled."""

    bandwidth: Any
    damping: Any
    gain: Any


class Tested(NamedTuple):
    """The memory of a loop under test; what is recorded as its estimate is how it rings."""

    of: Any
    settings: LoopSettings
    heard: Ringing
    estimate: Any


@dataclass(frozen=True, eq=False)
class UnderTest(Controller[Tested]):
    """Slotine and Li's law with its gains in memory, listened to."""

    of: SlotineLi

    @property
    def dof(self) -> int:
        """Number of joints r."""
        return self.of.dof

    def start(self, p: Array, v: Array) -> Tested:
        """The memory before the first tick."""
        own = LoopSettings(np.array(self.of.bandwidth), np.array(self.of.damping), np.array(self._gradient.gain))
        return Tested(self.of.start(p, v), own, Ringing.silent(self.dof), np.zeros(self.dof))

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Tested) -> tuple[Column, Tested]:
        """The torque (r,) N m of one tick of the law that has these settings, and its memory."""
        law, gradient = copy(self.of), copy(self._gradient)
        object.__setattr__(gradient, "gain", LaneNumbers(memory.settings.gain))
        for name in ("bandwidth", "damping"):
            object.__setattr__(law, name, LaneNumbers(getattr(memory.settings, name)))
        object.__setattr__(law, "adaptation_law", gradient)
        torque, after = law.law(p, v, reference, memory.of)
        heard = memory.heard.heard(after.s)
        return torque, Tested(after, memory.settings, heard, correlation(heard.product, heard.square))

    @property
    def _gradient(self) -> Gradient:
        law = self.of.adaptation_law
        assert isinstance(law, Gradient)
        return law


def random_arm(rng: np.random.Generator) -> Mechanism:
    """An arm of 5 to 7 turning joints about any axes, its bodies lighter link by link, each some density's."""
    links = []
    for i in range(int(rng.integers(5, 8))):
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
        length, mass = rng.uniform(0.1, 0.5) * 0.8**i, rng.uniform(0.5, 3.0) * 0.6**i
        points = np.array([length, 0.0, 0.0]) * rng.random((6, 1)) + rng.normal(scale=0.15 * length, size=(6, 3))
        inertia = np.sum([from_center_of_mass(mass / 6.0, x, np.zeros((3, 3))) for x in points], axis=0)
        turn = rotation_about(np.eye(3)[rng.integers(3)], rng.choice([0.0, 0.5 * np.pi, -0.5 * np.pi]))
        near = Pose(turn, np.array([0.0 if i == 0 else length / 0.8, 0.0, 0.0]))
        joint = Joint(f"joint{i + 1}", JointKind.REVOLUTE, axis)
        links.append(Link(f"link{i + 1}", i - 1, joint, near, Pose(np.eye(3), np.zeros(3)), inertia))
    return Mechanism(Description("arm", tuple(links)))


@dataclass(frozen=True, eq=False)
class LoopDraws:
    """Loops of one arm: a row each."""

    settings: LoopSettings
    before: Array
    """adaptation gains of the law there was before"""
    certified: Array
    """h + H < 2"""
    references: list[adaptctl.Sinusoids]
    parameters: Array


def drawn(model: ReducedModel, rng: np.random.Generator, count: int) -> LoopDraws:
    """Loops whose gains are accepted, up to the limit."""
    mechanism, rows = model.mechanism, []
    r, own = mechanism.dof, mechanism.inertial_parameters
    for _ in range(count):
        bandwidth = np.full(r, rng.uniform(4.0, 12.0))
        shape = typical_inertia(mechanism) * 10.0 ** rng.uniform(-0.7, 0.7, r)
        wanted = rng.uniform(0.3, LARGEST_SAMPLED_GAIN)
        free = hold_number(mechanism, shape, PERIOD).value
        damping = shape * (wanted - PERIOD * bandwidth[0]) / free
        gains = Gains(bandwidth, damping)
        gain = adaptation_gain(model, rate=0.6 * 10.0 ** rng.uniform(-3.0, 1.0), gains=gains, period=PERIOD)
        reference = adaptctl.Sinusoids(
            rng.uniform(-1.5, 1.5, r), rng.uniform(0.2, 0.6, r), rng.uniform(0.1, 0.4, r), rng.uniform(-3.0, 3.0, r)
        )
        prior = adaptation_gain(model)
        prior *= numbers(model, gains, gain, reference) / numbers(model, gains, prior, reference)
        held = wanted + estimate_hold(model, gain, np.abs(model.fundamental_parameters), bandwidth, PERIOD)
        loaded = own.copy()
        loaded[-10:] += rng.uniform(0.0, 1.0) * from_center_of_mass(
            own[-10], rng.uniform(-0.05, 0.05, 3), 1e-4 * own[-10] * np.eye(3)
        )
        rows.append((bandwidth, damping, gain, prior, held < 2.0, reference, loaded))
    columns = list(zip(*rows, strict=True))
    settings = LoopSettings(*map(np.array, columns[:3]))
    return LoopDraws(settings, np.array(columns[3]), np.array(columns[4]), list(columns[5]), np.array(columns[6]))


def numbers(model: ReducedModel, gains: Gains, gain: Array, reference: adaptctl.Sinusoids) -> float:
    """The adaptation number a along a reference."""
    point = reference(np.linspace(0.0, 20.0, 100))
    Y = model.slotine_li_regressor(point.p, point.v, point.v, point.a) * np.sqrt(gain)
    return PERIOD * float(np.linalg.norm(Y / np.sqrt(gains.damping)[:, None], ord=2, axis=(1, 2)).max()) ** 2


def outcome(model: ReducedModel, draws: LoopDraws, law: Gradient, gain: Array, duration: float) -> tuple[Array, Array]:
    """Masks (n,) of the loops that stay finite, and of those that ring in the end."""
    one = LoopSettings(*(part[0] for part in draws.settings))
    controller = UnderTest(SlotineLi(model, one.bandwidth, one.damping, law, period=PERIOD))
    plant = adaptctl.Plant(model.mechanism, PERIOD, integrator=SemiImplicitEuler())
    start = [reference(0.0) for reference in draws.references]
    memory = controller.init(np.array([x.p for x in start]), np.array([x.v for x in start]))
    memory = memory._replace(settings=draws.settings._replace(gain=gain))
    run = simulate_many(
        plant, controller, draws.references, duration=duration, memory=memory, parameters=draws.parameters, every=1000
    )
    with np.errstate(invalid="ignore"):
        rings = (run.estimate[-10:] < RINGS).any(axis=(0, 2))
    return run.finite, run.finite & rings


def main(arguments: list[str]) -> int:
    """Print a line an arm, and the shares of all; 1 where they are beyond what is promised."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    for name, default, meaning in (
        ("arms", 500, "random arms"), ("draws", 20, "loops of each"), ("first", 0, "the first arm's seed"),
    ):  # fmt: skip
        parser.add_argument(f"--{name}", type=int, default=default, help=meaning)
    parser.add_argument("--duration", type=float, default=600.0, help="s of each loop")
    asked = parser.parse_args(arguments)
    total = np.zeros(6, dtype=int)
    for seed in range(asked.first, asked.first + asked.arms):
        started = time.process_time()
        rng = np.random.default_rng(seed)
        arm = random_arm(rng)
        model = ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
        draws = drawn(model, rng, asked.draws)
        gain = draws.settings.gain
        finite, rings = outcome(model, draws, Gradient(gain[0]), gain, asked.duration)
        old, old_rings = outcome(model, draws, Gradient(gain[0], 0.5, 0.0), draws.before, asked.duration)
        lost = ~finite
        total += [
            len(lost),
            draws.certified.sum(),
            lost.sum(),
            (lost & draws.certified).sum(),
            rings.sum(),
            (~old).sum(),
        ]
        print(
            f"arm {seed}: {arm.dof} joints, {lost.sum()} of {len(lost)} not finite, {rings.sum()} ring; before "
            f"{(~old).sum()} not finite, {old_rings.sum()} ring; {time.process_time() - started:.0f} s",
            flush=True,
        )
    loops, certified, lost_count, lost_certified, ringing, before = total.tolist()
    print(
        f"{loops} loops of {asked.duration:g} s: {lost_count} not finite, {ringing} ring; of {certified} certified "
        f"{lost_certified} not finite; with the trapezium on prior ranges {before} not finite"
    )
    return int(lost_certified > 0 or lost_count > 1e-3 * loops or ringing > 1e-2 * loops)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.exit(main(sys.argv[1:]))
