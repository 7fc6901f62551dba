"""Two arms that hold one rod."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import Pose
from adaptctl.description.loops import Closure, ClosureKind, Loops
from adaptctl.description.pose import rotation_about
from adaptctl.description.transforms import joined
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.puma560_adaptive import DAMPING, Puma560Adaptive
from adaptctl.recording import Setting
from adaptctl.scalars import Column

if TYPE_CHECKING:
    import gymnasium

ROD_LENGTH = 0.3
"""m from hand to hand"""
BASE_DISTANCE = 1.1
"""m from base to base, face to face"""
LEFT = (-2.25, -2.36, -0.33, 0.375, 1.436, -0.08)
RIGHT = (2.455, -2.233, -0.116, 1.624, -1.103, -2.392)
"""rad: two PUMA 560 holding the rod, far from singularities; the right arm's are approximate"""


@dataclass(frozen=True)
class TwoArms(Puma560Adaptive):
    """Experiment of learning to track with two arms."""

    name: ClassVar[str] = "two-arms"
    title: ClassVar[str] = "Two arms and a rod: adaptive tracking of one mechanism"
    joints: ClassVar[int] = 6
    environment_id: ClassVar[str] = "Tracking"
    asks: ClassVar[str] = (
        "Two PUMAs face each other and hold one rod: a mechanism of twelve links with a closed loop and six degrees of "
        "freedom, the joints of the left arm. The torques are the sums of both arms' motor torques, mapped to these "
        "joints; they may be distributed over the motors in any way."
    )

    robot: str = setting("puma560_geared", "robot of which there are two, a PUMA 560 or one of its size")
    damping: tuple[float, ...] = setting(
        (250.0, 250.0, 120.0, 70.0, 50.0, 5.0), DAMPING, symbol="K", low=1e-3, high=1e4
    )
    inertia_range: float = setting(1.0, "prior range of inertias, kg m^2", low=1e-3, high=1e3)
    center: tuple[float, ...] = setting(LEFT, "centre of the sinusoids, rad", low=-10.0, high=10.0)
    amplitude: tuple[float, ...] = setting((0.1,) * 6, "amplitude of the sinusoids, rad", low=0.0, high=3.2)
    initial_error: float = setting(0.05, "initial error of every joint, rad or m", low=-1.0, high=1.0)

    def mechanism(self) -> Mechanism:
        """Two arms that hold one rod."""
        return two_arms(super().mechanism())

    def torque_limits(self, mechanism: Mechanism) -> Array:
        """Torque limits (6,), N m, equivalent to those of both arms."""
        limits = np.array([link.joint.limits.effort for link in mechanism.links])
        if not np.isfinite(limits).all():
            raise InputError(f"robot: {self.robot} has joints without a torque limit: give each joint an effort")
        return np.abs(_slopes(mechanism)) @ limits

    def chosen(self, mechanism: Mechanism, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Chosen settings, with rod and torque limits."""
        yield from super().chosen(mechanism, env)
        yield Setting(
            "rod",
            f"{ROD_LENGTH:g} m",
            f"from hand to hand, between bases {BASE_DISTANCE:g} m apart; part of both hands",
        )
        yield Setting("torque limits", "of both arms' motors together", "in the left arm's joints, at the centre")


def two_arms(robot: Mechanism) -> Mechanism:
    """Mechanism of two arms with a rod welded to both hands."""
    arm = robot.description
    if len(arm.links) != len(LEFT) or arm.loops is not None:
        raise InputError(
            f"robot: {arm.name} has {len(arm.links)} links, but two arms need an arm with six links and no loops"
        )
    mounts = {
        "left": Pose.identity(),
        "right": Pose(rotation_about((0, 0, 1), np.pi), np.array([BASE_DISTANCE, 0.0, 0.0])),
    }
    joints = {side: [f"{side}.{link.joint.name}" for link in arm.links] for side in mounts}
    reference = dict(zip(joints["left"] + joints["right"], LEFT + RIGHT, strict=True))
    left, right = (f"{side}.{arm.links[-1].name}" for side in mounts)
    grip = Pose(rotation_about((1, 0, 0), np.pi), np.array([0.0, 0.0, ROD_LENGTH]))
    rod = Closure("rod", left, right, grip, Pose.identity(), ClosureKind.WELD)
    loops = Loops(tuple(joints["left"]), (rod,), reference=reference)
    return Mechanism(joined("two_arms", {side: (arm, mount) for side, mount in mounts.items()}, loops))


def _slopes(mechanism: Mechanism) -> Array:
    """dU/dp at the reference (r, n), transposed."""
    home = Column(np.asarray(mechanism.configuration(LEFT)).tolist())
    units = np.eye(mechanism.dof).tolist()
    return np.array(
        [list(mechanism.equations.joint_velocities(home, Column(unit))) for unit in units], dtype=np.float64
    )
