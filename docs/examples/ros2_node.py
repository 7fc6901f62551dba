"""A ROS 2 node: joint states in, efforts out, for a forward_command_controller of effort interfaces."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import adaptctl

STALE = 0.05
"""s without joint states after which no effort is sent"""


class Tracking:
    """The node's part that needs no ROS: joint states in, efforts out, none where the states are old."""

    def __init__(self, joints: list[str], controller: Any, reference: Any) -> None:
        self.joints, self.controller, self.reference = joints, controller.compile(), reference
        self.state: Any = None
        self.measured: tuple[float, Any, Any] | None = None
        self.begun = 0.0

    def heard(self, now: float, names: list[str], positions: list[float], velocities: list[float]) -> None:
        """Joint states, in whatever order their message has them."""
        places = [names.index(name) for name in self.joints]
        self.measured = now, np.array(positions)[places], np.array(velocities)[places]

    def efforts(self, now: float) -> list[float] | None:
        """The efforts of this period; None where nothing was heard for too long, after which it begins anew."""
        if self.measured is None or now - self.measured[0] > STALE:
            self.state = None
            return None
        _, p, v = self.measured
        if self.state is None:
            self.state, self.begun = self.controller.init(p, v), now
        torque, self.state = self.controller.step(self.state, p, v, self.reference.at(now - self.begun))
        return torque.tolist()


def main(urdf: str) -> None:
    """Spin at 500 Hz."""
    import rclpy  # type: ignore[import-not-found]
    from sensor_msgs.msg import JointState  # type: ignore[import-not-found]
    from std_msgs.msg import Float64MultiArray  # type: ignore[import-not-found]

    arm = adaptctl.load(urdf)
    tuning = adaptctl.tune(arm, period=0.002)
    model = adaptctl.ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
    names = [joint.name for joint in arm.primary_joints]
    tracking = Tracking(names, tuning.controller(model), tuning.reference)
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
        JointState, "/joint_states", lambda m: tracking.heard(now(), list(m.name), m.position, m.velocity), 1
    )
    node.create_timer(0.002, act)
    rclpy.spin(node)


if __name__ == "__main__":
    main(sys.argv[1])
