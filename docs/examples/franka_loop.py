"""Adaptive control of a Franka arm at 1 kHz, through Franka's own client.

The arm moves about the posture in which it stands, and holds itself at the end. Its own gravity torque, with the hand
it was told of, is subtracted: what it was not told of is learned.

    python franka_loop.py ADDRESS [--any-kernel]

`--any-kernel` goes without a real-time kernel: the robot stops when commands are late.
"""

from __future__ import annotations

import sys

import adaptctl
from adaptctl.hardware import FrankaRobot, motion_about, ready_controller, with_rotors


def track(robot: FrankaRobot, arm: adaptctl.Mechanism, duration: float, path: str) -> adaptctl.DrivenRun:
    """Run of an arm that learns while it follows a motion about its posture."""
    reference = motion_about(robot.read().p, robot.limits)
    controller = ready_controller(arm, robot.period, reference, robot.tool, delay=1)
    return adaptctl.drive(robot, controller, reference, duration, path)


if __name__ == "__main__":
    run = track(
        FrankaRobot(sys.argv[1], real_time="--any-kernel" not in sys.argv),
        with_rotors(adaptctl.load("fr3.urdf")),
        10.0,
        "run.parquet",
    )
    print(run.stopped or f"{1e3 * run.final_rms_error.max():.2f} mrad at the worst joint in the last two seconds")
