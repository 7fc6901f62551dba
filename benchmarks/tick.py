"""One tick of adaptive control, called from Python, against the same law in NumPy and Pinocchio."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import adaptctl
from adaptctl.control import ReferencePoint
from benchmarks.findings import Agreement, Finding, Speedup
from benchmarks.interleaved import Effort, Statement, race
from benchmarks.pinocchio_tracking import PinocchioArm, PinocchioTracker
from benchmarks.tasks import BANDWIDTH, PERIOD, Task, puma_at_joints

TICKS = 1000


def peer(task: Task) -> PinocchioTracker:
    """The same controller."""
    columns = task.model.columns
    return PinocchioTracker(task.arm.to_pinocchio(), columns, BANDWIDTH, task.damping, task.gain, PERIOD)


def measure(effort: Effort) -> Iterator[Finding]:
    """State and reference in, torque out, estimate updated."""
    task = puma_at_joints()
    yield _agreement(task)
    controller, tracker = task.controller, peer(task)
    (p,), (v,) = task.starts(1)
    reference = ReferencePoint(*task.reference(1.0))
    _, state = controller.step(controller.init(p, v), p, v, reference)
    raced = race(
        {
            "ours": Statement("controller.step(state, p, v, reference)", locals()),
            "theirs": Statement("tracker.step(p, v, *reference)", locals()),
        },
        effort,
    )
    what = "tick of adaptive control of the PUMA, a call"
    yield Speedup.of(what, "the same law in NumPy and Pinocchio", raced, "ours", "theirs", 8.0)


def _agreement(task: Task) -> Agreement:
    """Torques over a second, each controlling its own arm."""
    controller, tracker = task.controller, peer(task)
    plant, arm = adaptctl.Plant(task.arm, PERIOD), PinocchioArm(task.arm.to_pinocchio(), PERIOD)
    (p,), (v,) = task.starts(1)
    ours, state, worst = plant.init(p, v), controller.init(p, v), 0.0
    for point in zip(*task.references(TICKS), strict=True):
        torque, state = controller.step(state, ours.p, ours.v, ReferencePoint(*point))
        theirs = tracker.step(p, v, *point)
        worst = max(worst, float(np.abs(torque - theirs).max() / np.abs(torque).max()))
        ours, (p, v) = plant.step(ours, torque), arm.step(p, v, theirs)
    return Agreement("torques over a second of adaptive control", "NumPy and Pinocchio", worst, 1e-10)
