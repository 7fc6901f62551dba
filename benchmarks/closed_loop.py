"""The closed loop of one PUMA 560 at 1 kHz, on one core: against the clock, and against NumPy and Pinocchio."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from adaptctl.arrays import Array
from adaptctl.envs import TrackingEnv
from adaptctl.simulation import RungeKutta4, rollout, simulate
from benchmarks.findings import Agreement, Finding, Speedup
from benchmarks.fleet import Fleet
from benchmarks.interleaved import Effort, Race, Spread, Statement, race
from benchmarks.pinocchio_tracking import PinocchioArm
from benchmarks.tasks import PERIOD, puma_at_joints
from benchmarks.tick import peer

SECOND, TEN = 1000, 10.0
"""Ticks in one, and the length of a run that is recorded: to begin it takes as long as a second of it."""


def measure(effort: Effort) -> Iterator[Finding]:
    """Controller, learning and the arm's motion by Runge and Kutta's method."""
    one = Fleet(puma_at_joints(), RungeKutta4(), arms=1, lanes=1)
    yield from _agreements(one)
    timed, recorded, controller = one.course(SECOND), _environment(TEN), one.task.controller
    raced = race(
        {
            "ours": Statement(timed.run, work=SECOND),
            "recorded": Statement(lambda: simulate(recorded, controller), work=10 * SECOND),
            "theirs": Statement(in_python, work=SECOND),
        },
        effort,
    )
    what = "closed loop of one PUMA, RK4 at 1 kHz"
    yield _faster_than_time(what, raced, "ours", 1000.0)
    yield _faster_than_time(f"{what}, all recorded (`simulate`)", raced, "recorded", None)
    yield Speedup.of(what, "NumPy and Pinocchio", raced, "ours", "theirs", 30.0)


def _faster_than_time(what: str, raced: Race, name: str, at_least: float | None) -> Speedup:
    second = Spread(PERIOD, PERIOD, PERIOD)
    return Speedup(what, "real time", raced.time(name), second, Spread.of(PERIOD / raced.seconds[name]), at_least)


def _environment(duration: float) -> TrackingEnv:
    """The same task in Gymnasium, for so many seconds."""
    task = puma_at_joints()
    return TrackingEnv(task.arm, task.reference, duration=duration, initial_error=0.05)


def in_python() -> Array:
    """A second of the same, one call of Pinocchio after the other: where the arm is in the end (r,)."""
    task = puma_at_joints()
    tracker, arm = peer(task), PinocchioArm(task.arm.to_pinocchio(), PERIOD)
    (p,), (v,) = task.starts(1)
    for point in zip(*task.references(SECOND), strict=True):
        p, v = arm.step(p, v, tracker.step(p, v, *point))
    return p


def _agreements(one: Fleet) -> Iterator[Finding]:
    """Differences of arms' states after a second, between ways to compute them."""
    native = one.course(SECOND).run()
    yield _after("native", "NumPy and Pinocchio", native[0], in_python())
    simulated, stepped = (run(_environment(1.0), one.task.controller).p for run in (simulate, rollout))
    yield _after("by `simulate`", "the Gymnasium loop", simulated, stepped)
    many = replace(one, arms=11, lanes=None).course(SECOND).run()
    alone = replace(one, arms=11).course(SECOND).run()
    yield _after("in lanes", "one by one", many, alone)


def _after(what: str, against: str, one: Array, other: Array) -> Agreement:
    difference = float(np.abs(one - other).max())
    return Agreement(f"joints after a second of closed loop, {what}", against, difference, 1e-9, "rad")
