"""Robots whose files nobody here wrote: their ranks, fixed to the ground and floating."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from robot_files import urdf
from scipy.spatial.transform import Rotation

from adaptctl.description import Description, Pose, read, read_urdf, with_floating_base
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.errors import FileError, InputError
from adaptctl.identifiability import essential_space, fundamental_basis

pytestmark = [
    pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning"),
    pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning"),
]

SERIAL = {"ur5_robot.urdf": 6, "kinova.urdf": 6, "z1_description/z1.urdf": 7, "xarm7.urdf": 7}
"""Arms by their number of joints. Axis 1 is vertical in all."""
FLOATING = {"a1.urdf": 12, "solo12.urdf": 12, "talos_reduced.urdf": 32, "double_pendulum.urdf": 2}
GEARED = {"panda.urdf": (8, 48), "pr2.urdf": (20, 138)}
"""Grippers with mimic joints: joints that are left, and the rank."""


def found(name: str) -> Path:
    return urdf(name.rsplit("/", 1)[-1])


@pytest.mark.parametrize(("name", "joints"), SERIAL.items())
def test_a_serial_arm_with_its_first_axis_upright_holds_7n_less_6(name: str, joints: int) -> None:
    """Mayeda, Yoshida and Osuka (1990): 7n - 4 with gravity across the first axis, 7n - 6 along it."""
    arm = load(found(name))
    space = essential_space(arm)
    assert space.rank == 7 * joints - 6
    assert len(fundamental_basis(space).names) == space.rank
    tilted = essential_space(Mechanism(Description("tilted", arm.links, np.array([3.0, 4.0, -5.0]))))
    assert tilted.rank == 7 * joints - 4


@pytest.mark.parametrize(("name", "joints"), FLOATING.items())
def test_a_floating_base_holds_10_and_7_a_joint(name: str, joints: int) -> None:
    """Every direction of motion is there, so only the pairs at the joints lose three parameters each."""
    robot = load(found(name), floating_base=True)
    space = essential_space(robot)
    assert robot.dof == 6 + joints
    assert len(space.parameter_names) == 10 * (1 + joints)
    assert space.rank == 10 + 7 * joints
    assert space.certificate.gap > 1e9


@pytest.mark.parametrize(("name", "expected"), GEARED.items())
def test_mimic_joints_follow(name: str, expected: tuple[int, int]) -> None:
    robot = load(found(name))
    space = essential_space(robot)
    assert (robot.dof, space.rank) == expected
    assert len(space.parameter_names) == 10 * len(robot.links)


def test_the_floating_links_own_no_parameters() -> None:
    robot = read_urdf(found("solo12.urdf"), floating_base=True)
    assert [link.massless for link in robot.links[:6]] == [True] * 5 + [False]
    assert robot.links[5].name == "base_link"
    assert robot.joint_names[:6] == tuple(f"base_link_{x}" for x in ("x", "y", "z", "yaw", "pitch", "roll"))
    assert robot.parameter_names[0] == "base_link.m"
    assert not any(name.startswith("base_link_") for name in robot.parameter_names)
    assert robot.links[5].inertia[0] > 0.1


def test_floating_energy_and_torques_are_pinocchios_free_flyers() -> None:
    """The same pose and velocity of the trunk by a quaternion and a twist: the same energy, and leg torques."""
    path = found("solo12.urdf")
    robot, rng = load(path, floating_base=True), np.random.default_rng(0)
    model = pinocchio.buildModelFromUrdf(str(path), pinocchio.JointModelFreeFlyer())
    data, h = model.createData(), 1e-6
    legs = [model.getJointId(name) for name in robot.description.joint_names[6:]]

    def flyer(p: np.ndarray) -> np.ndarray:
        poses, q = link_poses(robot, p), pinocchio.neutral(model)
        q[:3] = poses.translations[5]
        q[3:7] = pinocchio.Quaternion(poses.rotations[5]).coeffs()
        q[[model.idx_qs[i] for i in legs]] = p[6:]
        return q

    for _ in range(3):
        p, v, a = rng.uniform(-1, 1, (3, robot.dof))
        q = flyer(p)
        u = pinocchio.difference(model, flyer(p - h * v), flyer(p + h * v)) / (2 * h)
        energy = pinocchio.computeKineticEnergy(model, data, q, u) + pinocchio.computePotentialEnergy(model, data, q)
        assert robot.energy(p, v) == pytest.approx(energy, rel=1e-8)
        h2 = 1e-4
        ahead, behind = (flyer(p + s * v + 0.5 * h2 * h2 * a) for s in (h2, -h2))
        w = (pinocchio.difference(model, q, ahead) + pinocchio.difference(model, q, behind)) / h2**2
        torque = pinocchio.rnea(model, data, q, u, w)[[model.idx_vs[i] for i in legs]]
        np.testing.assert_allclose(robot.inverse_dynamics(p, v, a)[6:], torque, atol=1e-5)


def test_a_body_alone_in_the_air() -> None:
    """A quadrotor's frame has no joint, and all of its ten matter."""
    with pytest.raises(FileError, match="no moving joint"):
        read(found("quadrotor_base.urdf"))
    body = load(found("quadrotor_base.urdf"), floating_base=True)
    assert essential_space(body).rank == 10
    assert len(fundamental_basis(essential_space(body)).names) == 10


def test_only_files_with_a_root_link_can_float() -> None:
    with pytest.raises(InputError, match=r"measured: floating_base: only for URDF and MJCF files.* with_floating_base"):
        read("puma560_measured", floating_base=True)


def test_an_arm_on_a_floating_body_keeps_its_loops() -> None:
    """What was closed onto the ground is closed onto the body."""
    arm = read("semi_direct_drive")
    floating = with_floating_base(arm, "base", np.array([20.0, 0, 0, 0, 1, 0, 1, 0, 0, 1]))
    assert floating.loops is not None
    assert floating.loops.primary[6:] == ("joint1", "joint2", "joint3")
    assert floating.loops.primary[:6] == floating.joint_names[:6]
    whole = Mechanism(floating)
    p = np.array([0.1, 0.2, 0.3, 0.4, -0.5, 0.6, 0.2, -1.4, -3.0])
    np.testing.assert_allclose(whole.configuration(p)[6:], Mechanism(arm).configuration(p[6:]), atol=1e-12)
    assert essential_space(whole).rank > essential_space(Mechanism(arm)).rank


def test_base_parameters_of_a_calibrated_arm_are_of_ordinary_size() -> None:
    """Joints turned by mrad, as a calibration writes them: what nearly depends is not divided by."""
    arm, rng = load(found("xarm7.urdf")).description, np.random.default_rng(2)
    turns = [Pose(Rotation.from_rotvec(3e-3 * rng.standard_normal(3)).as_matrix(), np.zeros(3)) for _ in arm.links]
    links = [replace(x, parent_to_joint=x.parent_to_joint @ turn) for x, turn in zip(arm.links, turns, strict=True)]
    basis = fundamental_basis(essential_space(Mechanism(replace(arm, links=tuple(links))), as_written=True))
    assert basis.rank == 45
    assert np.abs(basis.regrouping).max() < 2.0
