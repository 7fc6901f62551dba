"""Environment of an arm that presses on a table or a wall, and is pushed (extra `mujoco`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.control.gains.gains import torque_limits
from adaptctl.control.minimum_jerk import quintic
from adaptctl.control.spline import Spline
from adaptctl.description import GROUND
from adaptctl.description.pose import Pose
from adaptctl.description.visual import Box, Visual
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.envs.task import LOOK_AHEAD, control_period_of
from adaptctl.envs.tracking import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.optional_packages import needed
from adaptctl.simulation.mujoco_plant import MuJoCoPlant
from adaptctl.simulation.push import HandPush, validate_pushes
from adaptctl.tuning import with_friction

if TYPE_CHECKING:
    import mujoco

SCENES = ("table", "wall", "air")
WRIST = ("joint4", "joint5", "joint6")
LINKS = ("link1", "link2", "link3")
LINK, TOOL, POSTURE = LINKS[-1], (0.0, 0.0, 0.48935), (0.0, -1.5, 3.0)
"""m: flange of a PUMA 560 whose wrist is straight; rad: where inverse kinematics begins"""
CENTER, SWING, RATE = (0.5, 0.15, 0.55), (0.1, 0.25, 0.1), (0.4, 0.3, 0.5)
"""m, m and Hz: the tool's motion in the air"""
NEARER = (0.45, 0.05, 0.45)
"""m: center of a motion that does not end, whose sinusoids meet at their greatest"""
INTO = {"table": np.array([0.0, 0.0, -1.0]), "wall": np.array([1.0, 0.0, 0.0])}
"""directions into the surfaces"""
TOUCHED = {"table": np.array([0.5, 0.15, 0.35]), "wall": np.array([0.65, 0.15, 0.35])}
"""m: where the tool touches them"""
CLEARANCE, DEPTH = 0.015, 0.05
"""m: of the path, before the surface and behind it"""
WIPE, WIPE_RATE = 0.2, 0.2
"""m and Hz: the tool's motion along the surface"""
STOPS, ABOVE, BEHIND = (5.5, 7.0), (7.0, 9.0), (9.0, 12.0)
"""s: from when to when the motion in the air ends, and the path goes before and behind the surface"""
KNOT, OVERRUN = 0.02, 1.0
"""s: between positions of the path, and after the end"""
RADIUS, THICKNESS, WIDTH, LENGTH = 0.02, 0.02, 0.4, 0.3
"""m: of the tool, a ball, and half of the surface's sizes"""
SURFACE_MASS, DAMPING_RATIO, FRICTION = 0.3, 0.25, (0.2, 0.005, 0.0001)
TIME_STEP, SOFTNESS = 2.5e-4, (0.01, 1.0)
"""s, and MuJoCo's `solref` of the contact"""


class ContactEnv(TrackingEnv):
    """
    Task of a PUMA 560 that presses on a table or a wall, or is pushed by a hand, simulated by MuJoCo.

    Parameters
    ----------
    robot : str or Mechanism, default "puma560_geared"
        A PUMA 560. Its wrist is held straight, so that three joints move; or is locked already.
    scene : {"table", "wall", "air"}, default "table"
        What the tool presses on and wipes after a motion in the air; or nothing, so that the motion goes on.
    surface : float, default 1e4
        Stiffness of the table or wall in N/m, of a stiff foam.
    pushes : sequence of HandPush, optional
        Forces of hands on the links. Those without a body act on the tool. Default: none.
    duration : float, default 20.0
        Length of an episode in s. The tool touches the surface after about 10 s.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    error_bound : float, default 1.0
        Error in rad beyond which an episode ends.
    render_mode : {"human", "rgb_array"}, optional
        "human" shows every step live in the rerun viewer, "rgb_array" draws images; both with the table or wall.
        Default: no pictures.

    Raises
    ------
    InputError
        If a number, a scene or a pushed link is bad, a push begins after the end, or the robot has no joints of a
        PUMA 560.
    MissingExtraError
        If MuJoCo is not installed.

    Notes
    -----
    The path, a spline through inverse kinematics, goes 5 cm behind the surface: how hard the tool presses is the
    controller's choice. `info["flags"]` has the force on the arm in N and its point in m, `contact_force_x` to
    `contact_point_z`. Spaces, reward and options are those of `TrackingEnv`.

    Examples
    --------
    >>> import gymnasium, adaptctl.envs
    >>> gymnasium.spec("adaptctl/Contact-v0").entry_point
    'adaptctl.envs.contact:ContactEnv'
    """

    def __init__(
        self,
        robot: str | Mechanism = "puma560_geared",
        *,
        scene: str = "table",
        surface: float = 1e4,
        pushes: Sequence[HandPush] = (),
        duration: float = 20.0,
        control_period: float = 1e-3,
        error_bound: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        arm = of_three_joints(load(robot) if isinstance(robot, str) else robot)
        validate_scene(scene)
        validate_within(pushes, duration)
        model = beside(arm, scene, positive_number(surface, "surface: expected a stiffness in N/m above 0"))
        limits, body = torque_limits(arm, None, finite=True), arm.links[0].name
        at_tool = tuple(push if push.body else replace(push, body=LINK, point=_tool(arm)) for push in pushes)
        given: Any = {"torque_limits": limits, "model": model, "body": body, "pushes": at_tool}
        plant = MuJoCoPlant(arm, control_period_of(control_period), **given)
        self.surroundings = surroundings_of(scene)
        path = joint_path(arm, duration, scene)
        self._set_task(plant, path, duration, LOOK_AHEAD, error_bound, None, 0.0, render_mode)


def validate_scene(scene: object) -> None:
    """Raise `InputError` unless there is such a scene."""
    if scene not in SCENES:
        raise InputError(f"scene: expected {', '.join(SCENES)}, got {scene!r}")


def validate_within(pushes: Sequence[HandPush], duration: float) -> None:
    """Raise `InputError` unless all are pushes and begin before the end."""
    validate_pushes(pushes)
    if late := [push.start for push in pushes if push.start >= duration]:
        raise InputError(f"push: start: expected a time before {duration:g} s, the end of the run, got {max(late):g}")


def of_three_joints(robot: Mechanism) -> Mechanism:
    """PUMA 560 whose wrist is held straight, with friction to learn."""
    arm = robot.locked(WRIST) if {joint.name for joint in robot.primary_joints} >= set(WRIST) else robot
    if [link.name for link in arm.links] != list(LINKS):
        raise InputError(f"robot: expected a PUMA 560, with joints joint1 to joint6, got {robot.name!r}")
    return with_friction(arm)


def tool_path(time: Array, scene: str = "table") -> Array:
    """Path (T, 3) of the tool in m: in the air, then to behind the surface and along it, if there is one."""
    t, swing = time[:, None], np.array(SWING) * np.sin(2.0 * np.pi * np.array(RATE) * time[:, None])
    if scene == "air":
        return np.asarray(np.array(NEARER) + _rise(t, 0.0, 2.0) * swing)
    in_air = (_rise(t, 0.0, 2.0) - _rise(t, *STOPS)) * swing
    along = _rise(t, BEHIND[1], BEHIND[1] + 2.0) * WIPE * np.sin(2.0 * np.pi * WIPE_RATE * (t - BEHIND[1]))
    there = _rise(t, *ABOVE) * (TOUCHED[scene] - np.array(CENTER) - CLEARANCE * INTO[scene])
    into = _rise(t, *BEHIND) * (CLEARANCE + DEPTH) * INTO[scene]
    return np.asarray(np.array(CENTER) + in_air + there + into + along * np.array([0.0, 1.0, 0.0]))


def _rise(time: Array, start: float, end: float) -> Array:
    """Minimum jerk from 0 to 1."""
    step: Any = quintic((time - start) / (end - start))[0]
    return np.asarray(step)


def joint_path(arm: Mechanism, duration: float, scene: str = "table") -> Spline:
    """Joints along the tool's path."""
    time = np.arange(0.0, duration + OVERRUN + KNOT, KNOT)
    return Spline(Tip(arm, LINK, np.array(TOOL)).joints(tool_path(time, scene), np.array(POSTURE)), time)


def _tool(arm: Mechanism) -> Array:
    """Tool (3,) in the frame of MuJoCo's last body, in m."""
    to_link = arm.links[-1].joint_to_link
    return np.asarray(to_link.rotation @ np.array(TOOL) + to_link.translation)


def surface_box(scene: str) -> tuple[Array, Array]:
    """Center (3,) and half of the lengths (3,) of a table or wall in m."""
    into = INTO[scene]
    return TOUCHED[scene] + (RADIUS + THICKNESS) * into, np.where(into, THICKNESS, [LENGTH, WIDTH, LENGTH])


def surroundings_of(scene: str) -> tuple[Visual, ...]:
    """Table or wall for drawing, if there is one."""
    if scene == "air":
        return ()
    center, half = surface_box(scene)
    x, y, z = (2.0 * half).tolist()
    return (Visual(GROUND, Pose(np.eye(3), center), Box((x, y, z))),)


@needed("the environment adaptctl/Contact-v0")
def beside(arm: Mechanism, scene: str, surface: float) -> mujoco.MjModel:
    """MuJoCo's arm with a ball as its tool, beside a table or wall on a spring."""
    import mujoco

    from adaptctl.description.writers.mujoco_model import mjcf_text

    spec, shape = mujoco.MjSpec.from_string(mjcf_text(arm.description)), mujoco.mjtGeom
    spec.option.timestep = TIME_STEP
    touch = {"friction": FRICTION, "solref": SOFTNESS}
    spec.body(LINK).add_geom(type=shape.mjGEOM_SPHERE, size=[RADIUS, 0, 0], pos=_tool(arm), mass=0, **touch)
    if scene == "air":
        return spec.compile()
    into, (place, sizes) = INTO[scene], surface_box(scene)
    sprung = spec.worldbody.add_body(name=scene, pos=place, gravcomp=1)
    damping = 2.0 * DAMPING_RATIO * np.sqrt(SURFACE_MASS * surface)
    sprung.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=-into, stiffness=surface, damping=damping)
    sprung.add_geom(type=shape.mjGEOM_BOX, size=sizes, mass=SURFACE_MASS, **touch)
    return spec.compile()
