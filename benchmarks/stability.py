"""Closed loops of random arms over ten minutes: does what is accepted stay stable? Run: python -m benchmarks.stability

An arm has draws of gains up to the accepted limits, adaptation gains, payloads and references, all in lanes of one
kernel; beside the library's law the same draws run with the trapezium on prior ranges, which it had before.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
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
    estimate_sampling_ratio,
    sampling_ratio,
    typical_inertia,
)
from adaptctl.control.gains.gain_design import largest_with_delay
from adaptctl.control.gains.sampling_ratio import stable_below
from adaptctl.control.gains.workspace import Workspace, everywhere
from adaptctl.control.ringing import Ringing, correlation
from adaptctl.description import Description, Joint, JointKind, Link, Pose
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism
from adaptctl.errors import GainError, InputError, RankError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column
from adaptctl.simulation import simulate_many
from adaptctl.simulation.effects import ControlDelay
from adaptctl.tuning import tune

PERIOD = 1e-3
RINGS = -0.9
"""of rho at the end: finite, but of no use"""


class Listened(NamedTuple):
    """The memory of a law that is listened to; what is recorded as its estimate is how it rings."""

    inner: Any
    ringing: Ringing
    estimate: Any


@dataclass(frozen=True, eq=False)
class Listening(Controller[Listened]):
    """A law, listened to."""

    tunable = ()

    inner: SlotineLi

    @property
    def dof(self) -> int:
        """Number of joints r."""
        return self.inner.dof

    def initial_state(self, p: Array, v: Array) -> Listened:
        """The memory before the first tick."""
        return Listened(self.inner.initial_state(p, v), Ringing.zero(self.dof), np.zeros(self.dof))

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Listened) -> tuple[Column, Listened]:
        """One tick of the law."""
        torque, after = self.inner.law(p, v, reference, memory.inner)
        ringing = memory.ringing.updated(after.s)
        return torque, Listened(after, ringing, correlation(ringing.lag_product, ringing.power))


class LoopSettings(NamedTuple):
    """Gains and first estimates of loops, a row each."""

    bandwidth: Array
    damping: Array
    gain: Array
    initial: Array


def random_arm(rng: np.random.Generator, joints: int | None = None, lighter: float = 0.6) -> Mechanism:
    """An arm of turning joints, 5 to 7, about any axes, its bodies lighter link by link, each some density's."""
    links = []
    for i in range(joints or int(rng.integers(5, 8))):
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
        length, mass = rng.uniform(0.1, 0.5) * 0.8**i, rng.uniform(0.5, 3.0) * lighter**i
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
    """h + H < 2, or what a delay leaves of it"""
    references: list[adaptctl.Sinusoids]
    parameters: Array
    falls: Array
    """refused from another estimate, so that they begin with the description's"""
    delay: int = 0
    """control periods"""

    def first(self, count: int) -> LoopDraws:
        """The first so many of them."""
        settings = LoopSettings(*(values[:count] for values in self.settings))
        rest = (self.before, self.certified, self.references, self.parameters, self.falls)
        return LoopDraws(settings, *(values[:count] for values in rest), self.delay)


class Accepted(NamedTuple):
    """Gains that are accepted, their sampling ratio, and the reference and workspace that they are for."""

    gains: Gains
    hold: float
    reference: Any
    workspace: Workspace


def drawn(model: ReducedModel, rng: np.random.Generator, count: int, delay: int = 0) -> LoopDraws | None:
    """Loops whose gains are accepted, up to the limit; every fifth has those that `tune` offers. Every fourth begins
    with an identified arm's estimate, the others knowing nothing, or the description where that is refused. What is
    refused altogether is left out, None where all are. Raises `InputError` where `tune` offers none."""
    rows, own = [], model.mechanism.inertial_parameters
    offered = _offered(model.mechanism, int(rng.integers(2**31)), delay)
    for k in range(count):
        gains, wanted, reference, workspace = _accepted(model.mechanism, rng, delay) if k % 5 else offered
        within: dict[str, Any] = {"control_period": PERIOD, "workspace": workspace}
        asked = {**within, "gain_scale": 0.6 * 10.0 ** rng.uniform(-3.0, 1.0), "gains": gains, "delay": delay}
        loaded = own.copy()
        loaded[-10:] += rng.uniform(0.0, 1.0) * from_center_of_mass(
            own[-10], rng.uniform(-0.05, 0.05, 3), 1e-4 * own[-10] * np.eye(3)
        )
        by_link = (model.regrouping * loaded).reshape(len(model.columns), -1, 10).sum(axis=2)
        true = by_link.sum(axis=1)
        first = np.zeros(len(true)), np.abs(true)
        if k % 4 == 3:
            first = _identified(by_link, rng, 10.0 ** rng.uniform(-2.5, -0.5))
        if (begun := _begun(model, first, true, asked)) is None:
            continue
        gain, initial, bound, falls = begun
        prior = adaptation_gain(model)
        prior *= numbers(model, gains, gain, reference) / numbers(model, gains, prior, reference)
        held = wanted + estimate_sampling_ratio(model, gain, bound, gains.bandwidth, **within)
        safe = held < stable_below(delay)
        rows.append((gains.bandwidth, gains.damping, gain, initial, prior, safe, reference, loaded, falls))
    if not rows:
        return None
    columns = list(zip(*rows, strict=True))
    settings, (before, certified) = LoopSettings(*map(np.array, columns[:4])), map(np.array, columns[4:6])
    return LoopDraws(settings, before, certified, list(columns[6]), *map(np.array, columns[7:]), delay)


def _begun(
    model: ReducedModel, first: tuple[Array, Array], true: Array, asked: dict[str, Any]
) -> tuple[Array, Array, Array, bool] | None:
    """Gain, first estimate and bound of its errors, and True where the arm falls from another estimate than the
    description's; None where from that too."""
    own = model.fundamental_parameters
    for (initial, bound), falls in ((first, False), ((own, np.abs(true - own)), True)):
        try:
            return adaptation_gain(model, initial=initial, **asked), initial, bound, falls
        except GainError:
            pass
    return None


def _identified(by_link: Array, rng: np.random.Generator, share: float) -> tuple[Array, Array]:
    """A first estimate (k,) of what links contribute to parameters (k, links), each link off by up to a share, and the
    bound of its errors."""
    off = rng.uniform(-share, share, by_link.shape[1])
    return by_link @ (1.0 + off), share * np.abs(by_link).sum(axis=1)


def _accepted(mechanism: Mechanism, rng: np.random.Generator, delay: int) -> Accepted:
    """Gains with a sampling ratio up to the limit, wherever the arm may be."""
    r, bandwidth = mechanism.dof, np.full(mechanism.dof, rng.uniform(4.0, 12.0))
    shape = typical_inertia(mechanism) * 10.0 ** rng.uniform(-0.7, 0.7, r)
    most = largest_with_delay(delay)
    wanted = float(rng.uniform(0.2 * most, most))
    gains = Gains(bandwidth, shape * (wanted - PERIOD * bandwidth[0]) / sampling_ratio(mechanism, shape, PERIOD).value)
    reference = adaptctl.Sinusoids(
        rng.uniform(-1.5, 1.5, r), rng.uniform(0.2, 0.6, r), rng.uniform(0.1, 0.4, r), rng.uniform(-3.0, 3.0, r)
    )
    return Accepted(gains, wanted, reference, everywhere(mechanism))


def _offered(mechanism: Mechanism, seed: int, delay: int) -> Accepted:
    """The gains that `tune` offers, on its reference. Raises `InputError` where it offers none."""
    found = tune(mechanism, control_period=PERIOD, seed=seed, effects=late(delay))
    gains, workspace = found.gains, found.workspace
    held = sampling_ratio(mechanism, gains.damping, PERIOD, gains.bandwidth, workspace=workspace)
    return Accepted(gains, held.value, found.reference, workspace)


def late(delay: int) -> list[ControlDelay]:
    """Effects of torques so many control periods late."""
    return [ControlDelay(delay)] if delay else []


def numbers(model: ReducedModel, gains: Gains, gain: Array, reference: adaptctl.Sinusoids) -> float:
    """The adaptation number a along a reference."""
    point = reference(np.linspace(0.0, 20.0, 100))
    Y = model.slotine_li_regressor(point.p, point.v, point.v, point.a) * np.sqrt(gain)
    return PERIOD * float(np.linalg.norm(Y / np.sqrt(gains.damping)[:, None], ord=2, axis=(1, 2)).max()) ** 2


def outcome(model: ReducedModel, draws: LoopDraws, law: Gradient, gain: Array, duration: float) -> tuple[Array, Array]:
    """Loops (n,) that stay finite, and those that ring in the end."""
    few = np.full(model.mechanism.dof, 1e-6)
    bare = Listening(SlotineLi(model, few, few, law, draws.settings.initial[0], control_period=PERIOD))
    rows = zip(*draws.settings._replace(gain=gain), strict=True)
    names = "inner.bandwidth", "inner.damping", "inner.adaptation.gain", "inner.initial"
    laws = [bare.having(bare.numbers | dict(zip(names, row, strict=True))) for row in rows]  # judged when drawn
    plant = adaptctl.Plant(model.mechanism, PERIOD, effects=late(draws.delay))
    run = simulate_many(
        plant, laws, draws.references, duration=duration, parameters=draws.parameters, record_every=1000
    )
    with np.errstate(invalid="ignore"):
        rings = (run.estimate[-10:] < RINGS).any(axis=(0, 2))
    return run.finite, run.finite & rings


class LoopCounts(NamedTuple):
    """Counts of an arm's loops, or of all arms', by what became of them."""

    arms: int = 0
    offered: int = 0
    """arms for which `tune` offers gains"""
    loops: int = 0
    certified: int = 0
    lost: int = 0
    """not finite"""
    lost_certified: int = 0
    falls: int = 0
    """begun with the description's estimate, as they are refused with less"""
    lost_falls: int = 0
    rings: int = 0
    beside: int = 0
    """loops that also run with the law there was before"""
    before: int = 0
    """not finite with that"""
    rang_before: int = 0

    def __add__(self, other: tuple[Any, ...]) -> LoopCounts:
        return LoopCounts(*map(sum, zip(self, other, strict=True)))

    def __str__(self) -> str:
        return (
            f"{self.loops} loops: {self.lost} not finite, {self.rings} ring; of {self.certified} certified "
            f"{self.lost_certified} not finite; of {self.falls} from the description's "
            f"estimate, refused without, {self.lost_falls}; of {self.beside} with the trapezium on prior ranges "
            f"{self.before} not finite, {self.rang_before} ring; gains offered for {self.offered} of {self.arms} arms"
        )

    @property
    def as_promised(self) -> bool:
        """True if all shares are within what is promised."""
        kept = self.lost_certified == 0 and self.lost <= 1e-3 * self.loops and self.rings <= 1e-2 * self.loops
        return kept and self.offered >= 0.95 * self.arms


def counted(seed: int, count: int, duration: float, beside: int, delay: int = 0) -> LoopCounts:
    """Counts of so many loops of the arm of a seed, of which the first run beside with the law there was before."""
    rng = np.random.default_rng(seed)
    arm = random_arm(rng)
    try:
        model = ReducedModel(arm)
        draws = drawn(model, rng, count, delay)
    except (RankError, InputError):  # no controller is made where kept parameters nearly depend on each other
        return LoopCounts(arms=1)
    if draws is None:
        return LoopCounts(arms=1, offered=1)
    gain, safe = draws.settings.gain, draws.certified
    finite, rings = outcome(model, draws, Gradient(gain[0], delay=delay), gain, duration)
    few = draws.first(beside)
    old, old_rings = outcome(model, few, Gradient(gain[0], 0.5, 0.0), few.before, duration)
    falls = draws.falls.sum(), (~finite & draws.falls).sum()
    ours = (~finite).sum(), (~finite & safe).sum(), *falls, rings.sum()
    beside = len(old)
    return LoopCounts(*map(int, (1, 1, len(gain), safe.sum(), *ours, beside, (~old).sum(), old_rings.sum())))


def main(arguments: list[str]) -> int:
    """Print a line per arm, and the shares of all; 1 where they are beyond what is promised."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    for name, default, meaning in (
        ("arms", 500, "random arms"), ("draws", 20, "loops of each"), ("first", 0, "the first arm's seed"),
        ("beside", 4, "loops of each that also run with the law there was before"),
        ("delay", 0, "control periods by which torques arrive late"),
    ):  # fmt: skip
        parser.add_argument(f"--{name}", type=int, default=default, help=meaning)
    parser.add_argument("--duration", type=float, default=600.0, help="s of each loop")
    asked = parser.parse_args(arguments)
    total = LoopCounts()
    try:
        for seed in range(asked.first, asked.first + asked.arms):
            started = time.process_time()
            total += (found := counted(seed, asked.draws, asked.duration, asked.beside, asked.delay))
            print(f"arm {seed}: {found}; {time.process_time() - started:.0f} s", flush=True)
    except KeyboardInterrupt:
        print("interrupted: of the arms that were done")
    print(f"{asked.duration:g} s each, {total}")
    return int(not total.as_promised)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.exit(main(sys.argv[1:]))
