"""A ROS 2 node: joint states in, efforts out, for a forward_command_controller of effort interfaces.

The reference fades in from the arm's position; the law starts from the file's parameters, since the arm must be held
against gravity from the first effort on.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import adaptctl
from adaptctl.control import FadeIn, SafetyFilter

PERIOD = 0.002
STALE = 0.05
"""s without joint states after which no effort is sent"""
LEAD_IN = 5.0
"""s from the arm's position to the reference"""


class Tracking:
    """The node's part that needs no ROS: joint states in, efforts out, none where the states are old."""

    def __init__(self, joints: list[str], controller: Any, reference: Any) -> None:
        self.joints, self.controller, self.reference = joints, controller.compile(), reference
        self.state: Any = None
        self.followed: Any = None
        self.measured: tuple[float, Any, Any] | None = None
        self.started = 0.0

    def receive(
        self, now: float, names: Sequence[str], positions: Sequence[float], velocities: Sequence[float]
    ) -> None:
        """Joint states, in whatever order their message has them; a message without all of ours is another's."""
        said = dict(zip(names, zip(positions, velocities, strict=False), strict=False))
        if all(joint in said and np.isfinite(said[joint]).all() for joint in self.joints):
            p, v = np.array([said[joint] for joint in self.joints]).T
            self.measured = now, p, v

    def efforts(self, now: float) -> list[float] | None:
        """The efforts of this period; None without a recent message, after which it restarts."""
        if self.measured is None or now - self.measured[0] > STALE:
            self.state = None
            return None
        _, p, v = self.measured
        if self.state is None:
            self.state, self.started = self.controller.init(p, v), now
            self.followed = FadeIn(self.reference, p, LEAD_IN)
        torque, self.state = self.controller.step(self.state, p, v, self.followed.at(now - self.started))
        return torque.tolist()


def prepared(arm: adaptctl.Mechanism) -> tuple[Any, Any]:
    """A guarded adaptive controller that starts from the file's parameters, and a reference within the arm's limits."""
    tuning = adaptctl.tune(arm, control_period=PERIOD)
    model = adaptctl.ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
    law = replace(tuning.controller(model), initial=model.fundamental_parameters)
    return SafetyFilter(law, torque_limits=tuning.torque_limits), tuning.reference


def main(urdf: str) -> None:
    """Spin at 500 Hz."""
    import rclpy  # type: ignore[import-not-found]
    from sensor_msgs.msg import JointState  # type: ignore[import-not-found]
    from std_msgs.msg import Float64MultiArray  # type: ignore[import-not-found]

    arm = adaptctl.load(urdf)
    tracking = Tracking([joint.name for joint in arm.primary_joints], *prepared(arm))
    rclpy.init()
    node = rclpy.create_node("adaptctl")
    out = node.create_publisher(Float64MultiArray, "/effort_controller/commands", 1)

    def now() -> float:
        return 1e-9 * float(node.get_clock().now().nanoseconds)

    def act() -> None:
        efforts = tracking.efforts(now())
        if efforts is not None:
            out.publish(Float64MultiArray(data=efforts))

    node.create_subscription(
        JointState, "/joint_states", lambda m: tracking.receive(now(), list(m.name), m.position, m.velocity), 1
    )
    node.create_timer(PERIOD, act)
    rclpy.spin(node)


if __name__ == "__main__":
    main(sys.argv[1])
