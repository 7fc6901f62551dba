"""Adaptive control of a Franka arm at 1 kHz by pylibfranka, whose robot wants a torque each millisecond.

The robot adds gravity compensation to what it is told, so the model here has no gravity. The reference fades in from
the arm's position, and the torque from zero, which is what it has then.

    python franka_loop.py ADDRESS [--any-kernel]

`--any-kernel` goes without a real-time kernel: the robot stops when commands are late.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np

import adaptctl
from adaptctl.control import FadeIn, SafetyFilter

PERIOD = 1e-3
RATE = 950.0
"""N m/s: the robot stops at a change of torque by 1000"""
LEAD_IN = 5.0
"""s from the arm's position to the reference"""


def control(
    robot: Any, torques: Any, controller: Any, reference: Any, duration: float, log: adaptctl.RunLogger
) -> None:
    """Follow a reference, faded in from where the arm is; `torques` makes the robot's command of a list of numbers.

    The robot itself stops when a command is late, so its own clock is the watchdog.
    """
    active, time, state = robot.start_torque_control(), 0.0, None
    try:
        while time < duration:
            measured, passed = active.readOnce()
            p, v = np.asarray(measured.q), np.asarray(measured.dq)
            if state is None:
                state, reference = controller.init(p, v), FadeIn(reference, p, LEAD_IN)
            else:
                time += passed.to_sec()
            point = reference.at(time)
            torque, state = controller.step(state, p, v, point)
            command = torques(torque.tolist())
            command.motion_finished = time >= duration
            active.writeOnce(command)
            log.append(time, p, v, point, torque, estimate=state.inner.estimate)
    except Exception:
        robot.stop()
        raise


def weightless(arm: adaptctl.Mechanism) -> adaptctl.Mechanism:
    """The arm as its own gravity compensation leaves it."""
    return adaptctl.Mechanism(replace(arm.description, gravity=np.zeros(3)))


def prepared(arm: adaptctl.Mechanism) -> tuple[Any, Any]:
    """A guarded adaptive controller, compiled, and a reference within the arm's limits."""
    arm = weightless(arm)
    tuning = adaptctl.tune(arm, control_period=PERIOD)
    model = adaptctl.ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
    guarded = SafetyFilter(
        tuning.controller(model), torque_limits=tuning.torque_limits, rate_limits=RATE, control_period=PERIOD
    )
    return guarded.compile(), tuning.reference


def main(address: str, kernel: str = "") -> None:
    """Drive the arm at an address for ten seconds, and keep what happened."""
    from pylibfranka import RealtimeConfig, Robot, Torques  # type: ignore[import-not-found]

    controller, reference = prepared(adaptctl.load("fr3.urdf"))
    robot = Robot(address, RealtimeConfig.kIgnore if kernel == "--any-kernel" else RealtimeConfig.kEnforce)
    with adaptctl.RunLogger(7, PERIOD, "run.parquet", estimates=controller.inner.model.regrouping.shape[0]) as log:
        control(robot, Torques, controller, reference, 10.0, log)


if __name__ == "__main__":
    main(*sys.argv[1:])
