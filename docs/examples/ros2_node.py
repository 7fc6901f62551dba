"""A ROS 2 node as a robot: joint states in, efforts out, for a forward_command_controller of effort interfaces.

python ros2_node.py URDF
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import adaptctl
from adaptctl.hardware import HardwareLimits, RobotReading, motion_about, ready_controller, with_rotors

TORQUE_RATE = 1000.0
"""N m/s"""
PATIENCE = 5
"""periods without joint states, after which there is no measurement"""


class JointStates:
    """Robot behind two topics; `spin_once` hears messages for a time in s, `publish` sends efforts."""

    compensates_gravity = False

    def __init__(
        self,
        arm: adaptctl.Mechanism,
        period: float,
        spin_once: Callable[[float], None],
        publish: Callable[[list[float]], None],
    ) -> None:
        self.period, self.limits = period, HardwareLimits.of(arm, TORQUE_RATE)
        self.joints = [joint.name for joint in arm.primary_joints]
        self._spin_once, self.publish = spin_once, publish
        self._latest: RobotReading | None = None

    def receive(
        self, stamp: float, names: Sequence[str], positions: Sequence[float], velocities: Sequence[float]
    ) -> None:
        """Take joint states, in whatever order their message has them; one without all of ours is another's."""
        said = dict(zip(names, zip(positions, velocities, strict=False), strict=False))
        if all(joint in said and np.isfinite(said[joint]).all() for joint in self.joints):
            p, v = np.array([said[joint] for joint in self.joints]).T
            self._latest = RobotReading(stamp, p, v)

    def read(self) -> RobotReading | None:
        """Next joint states of this arm; None if there are none in time."""
        self._latest, until = None, time.monotonic() + PATIENCE * self.period
        while self._latest is None and time.monotonic() < until:
            self._spin_once(self.period)
        return self._latest

    def write(self, torque: Any) -> None:
        """Send efforts."""
        self.publish(torque.tolist())

    def stop(self) -> None:
        """Send no more efforts: the controller's command timeout takes over."""


def main(urdf: str) -> None:
    """Drive the arm for ten seconds."""
    import rclpy  # type: ignore[import-not-found]
    from sensor_msgs.msg import JointState  # type: ignore[import-not-found]
    from std_msgs.msg import Float64MultiArray  # type: ignore[import-not-found]

    rclpy.init()
    node, arm = rclpy.create_node("adaptctl"), with_rotors(adaptctl.load(urdf))
    out = node.create_publisher(Float64MultiArray, "/effort_controller/commands", 1)
    robot = JointStates(
        arm,
        0.002,
        lambda wait: rclpy.spin_once(node, timeout_sec=wait),
        lambda e: out.publish(Float64MultiArray(data=e)),
    )

    def receive(message: Any) -> None:
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        robot.receive(stamp, list(message.name), message.position, message.velocity)

    node.create_subscription(JointState, "/joint_states", receive, 1)
    here = robot.read()
    if here is None:
        raise SystemExit("no joint states of this arm on /joint_states")
    reference = motion_about(here.p, robot.limits)
    run = adaptctl.drive(robot, ready_controller(arm, robot.period, reference), reference, 10.0, "run.parquet")
    print(run.stopped or f"{1e3 * run.final_rms_error.max():.2f} mrad at the worst joint in the last two seconds")


if __name__ == "__main__":
    main(sys.argv[1])
