"""Adaptive control of a UR arm by ur_rtde at 500 Hz.

The arm's own controller adds gravity and friction compensation to direct torques, so the model here has no gravity. The
reference fades in from the arm's position.

Run it on a stand-alone arm with a hand on the emergency stop, at low gains first.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np

import adaptctl
from adaptctl.control import FadeIn, SafetyFilter

PERIOD = 1 / 500
LEAD_IN = 5.0
"""s from the arm's position to the reference"""
LATE = 5
"""periods in a row that may come late before the loop gives up"""


def control(
    receive: Any, command: Any, controller: Any, reference: Any, duration: float, log: adaptctl.RunLogger
) -> None:
    """Follow a reference for `duration` s, faded in from where the arm is: read, step, write, and stop when the clock
    cannot be kept."""
    controller.compile()
    p, v = np.array(receive.getActualQ()), np.array(receive.getActualQd())
    state, late, reference = controller.init(p, v), 0, FadeIn(reference, p, LEAD_IN)
    started = time.monotonic()
    try:
        for k in range(round(duration / PERIOD)):
            tick = command.initPeriod()
            p, v = np.array(receive.getActualQ()), np.array(receive.getActualQd())
            point = reference.at(k * PERIOD)
            torque, state = controller.step(state, p, v, point)
            if not command.directTorque(torque.tolist()):
                raise RuntimeError("the arm refuses torques: look at the teach pendant")
            log.append(k * PERIOD, p, v, point, torque, estimate=state.inner.estimate)
            late = late + 1 if time.monotonic() - started > (k + 2) * PERIOD else 0
            if late > LATE:
                raise RuntimeError(f"more than {LATE} periods came late: use a real-time kernel, or a longer period")
            command.waitPeriod(tick)
    finally:
        command.stopScript()


def main(address: str) -> None:
    """Drive the arm at an address for ten seconds, and keep what happened."""
    from rtde_control import RTDEControlInterface  # type: ignore[import-not-found]
    from rtde_receive import RTDEReceiveInterface  # type: ignore[import-not-found]

    arm = adaptctl.load("ur5e.urdf")  # with its gravity, which `prepared` takes out
    controller, reference = prepared(arm)
    with adaptctl.RunLogger(6, PERIOD, "run.parquet", estimates=controller.inner.model.regrouping.shape[0]) as log:
        control(RTDEReceiveInterface(address), RTDEControlInterface(address), controller, reference, 10.0, log)


def prepared(arm: adaptctl.Mechanism) -> tuple[Any, Any]:
    """A guarded adaptive controller, and a reference within its limits, for an arm that compensates its weight."""
    arm = adaptctl.Mechanism(replace(arm.description, gravity=np.zeros(3)))
    tuning = adaptctl.tune(arm, control_period=PERIOD)
    model = adaptctl.ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
    return SafetyFilter(
        tuning.controller(model), torque_limits=tuning.torque_limits, velocity_limits=2.0
    ), tuning.reference


if __name__ == "__main__":
    main(sys.argv[1])
