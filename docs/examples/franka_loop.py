"""Adaptive control of a Franka arm at 1 kHz by pylibfranka, whose robot wants a torque each millisecond.

The robot adds gravity compensation to what it is told, so the model here has no gravity.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np

import adaptctl
from adaptctl.control import Guarded

PERIOD = 1e-3


def control(
    robot: Any, torques: Any, controller: Any, reference: Any, duration: float, log: adaptctl.RunLogger
) -> None:
    """Follow a reference from where the arm is; `torques` makes the robot's command of a list of numbers.

    The robot itself stops when a command is late, so its own clock is the watchdog.
    """
    active, time, state = robot.start_torque_control(), 0.0, None
    try:
        while time < duration:
            measured, passed = active.readOnce()
            time += passed.to_sec()
            p, v = np.asarray(measured.q), np.asarray(measured.dq)
            state = controller.init(p, v) if state is None else state
            point = reference.at(time)
            torque, state = controller.step(state, p, v, point)
            command = torques(torque.tolist())
            command.motion_finished = time >= duration
            active.writeOnce(command)
            log.append(time, p, v, point, torque, estimate=state.of.estimate)
    except Exception:
        robot.stop()
        raise


def weightless(arm: adaptctl.Mechanism) -> adaptctl.Mechanism:
    """The arm as its own gravity compensation leaves it."""
    return adaptctl.Mechanism(replace(arm.description, gravity=np.zeros(3)))


def prepared(arm: adaptctl.Mechanism) -> tuple[Any, Any]:
    """A guarded adaptive controller, compiled, and a reference within the arm's limits."""
    tuning = adaptctl.tune(arm, period=PERIOD)
    model = adaptctl.ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
    guarded = Guarded(tuning.controller(model), torque_limits=tuning.torque_limits, rate_limits=1000.0, period=PERIOD)
    return guarded.compile(), tuning.reference


def main(address: str) -> None:
    """Drive the arm at an address for ten seconds, and keep what happened."""
    from pylibfranka import Robot, Torques  # type: ignore[import-not-found]

    controller, reference = prepared(weightless(adaptctl.load("fr3.urdf")))
    with adaptctl.RunLogger(7, PERIOD, "run.parquet", estimates=controller.of.model.regrouping.shape[0]) as log:
        control(Robot(address), Torques, controller, reference, 10.0, log)


if __name__ == "__main__":
    main(sys.argv[1])
