"""An arm of a MuJoCo scene, driven as a robot is: python mujoco_loop.py SCENE [BODY]."""

from __future__ import annotations

import sys

import adaptctl
from adaptctl.hardware import MuJoCoRobot, motion_about, ready_controller, with_rotors


def track(scene: str, body: str | None, duration: float, path: str | None = None) -> adaptctl.DrivenRun:
    """Run of an arm of a scene that learns while it follows a motion about its posture."""
    robot = MuJoCoRobot(scene, body=body)
    reference = motion_about(robot.read().p, robot.limits)
    controller = ready_controller(with_rotors(robot.plant.mechanism), robot.period, reference)
    return adaptctl.drive(robot, controller, reference, duration, path)


if __name__ == "__main__":
    run = track(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else None, 10.0, "run.parquet")
    print(run.stopped or f"{1e3 * run.final_rms_error.max():.2f} mrad at the worst joint in the last two seconds")
