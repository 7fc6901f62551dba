"""Adaptive control of a UR arm by ur_rtde at 500 Hz.

The arm's own controller adds gravity and friction compensation to direct torques: its gravity torque, with the payload
set at the robot, is subtracted.

    python ur_rtde_loop.py ADDRESS

Run it on a stand-alone arm with a hand on the emergency stop.
"""

from __future__ import annotations

import sys

import adaptctl
from adaptctl.hardware import HardwareLimits, URRobot, motion_about, ready_controller, with_rotors


def track(robot: URRobot, arm: adaptctl.Mechanism, duration: float, path: str) -> adaptctl.DrivenRun:
    """Run of an arm that learns while it follows a motion about its posture."""
    reference = motion_about(robot.read().p, robot.limits)
    controller = ready_controller(arm, robot.period, reference, robot.tool, delay=1)
    return adaptctl.drive(robot, controller, reference, duration, path)


if __name__ == "__main__":
    ur = with_rotors(adaptctl.load("ur5e.urdf"))
    run = track(URRobot(sys.argv[1], HardwareLimits.of(ur)), ur, 10.0, "run.parquet")
    print(run.stopped or f"{1e3 * run.final_rms_error.max():.2f} mrad at the worst joint in the last two seconds")
