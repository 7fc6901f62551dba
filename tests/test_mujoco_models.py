"""MuJoCo models that are made and changed: limits of one side, and other parameters, whole or not at all."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mjcf_files import chain, mjcf
from random_trees import random_chain

import adaptctl
from adaptctl.description import Description, Joint, JointKind, Limits, Link, Pose
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.readers.mujoco_arm import MujocoArm
from adaptctl.description.writers.mujoco_model import set_parameters
from adaptctl.dynamics import Mechanism


@pytest.mark.parametrize("kind", list(JointKind))
@pytest.mark.parametrize("limits", [Limits(-0.5, 0.7), Limits(lower=-0.5), Limits(upper=0.7), Limits()])
def test_models_that_are_made_keep_limits_of_one_side_too(kind: JointKind, limits: Limits) -> None:
    (link,) = random_chain(1, 1).links
    arm = Mechanism(Description("one", (replace(link, joint=replace(link.joint, kind=kind, limits=limits)),)))
    (joint,) = Mechanism.from_mujoco(arm.to_mujoco()).primary_joints
    assert joint.limits == limits
    assert joint.kind.is_revolute == kind.is_revolute


def test_a_side_of_a_range_that_is_far_away_limits_nothing(tmp_path: Path) -> None:
    for ends in ("-90 1e12", "-1e12 90", "-1e12 1e12"):
        lower, upper = (np.radians(x) if abs(x) < 1e9 else np.copysign(np.inf, x) for x in map(float, ends.split()))
        path = tmp_path / "scene.xml"
        path.write_text(mjcf(chain(f'range="{ends}"')))
        for arm in (adaptctl.load(path), adaptctl.load(mujoco.MjModel.from_xml_path(str(path)))):
            joint = arm.primary_joints[0]
            assert (joint.limits.lower, joint.limits.upper) == pytest.approx((lower, upper))
            free = np.isinf([lower, upper]).all()
            assert joint.kind is (JointKind.CONTINUOUS if free else JointKind.REVOLUTE)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_mujoco_stops_at_a_limit_of_one_side_and_goes_on_at_the_other(side: float) -> None:
    joint = Joint("slide", JointKind.PRISMATIC, limits=Limits(lower=-0.1) if side < 0 else Limits(upper=0.1))
    link = Link("block", -1, joint, Pose.identity(), Pose.identity(), from_center_of_mass(1.0, [0, 0, 0], np.eye(3)))
    for gravity in (-9.81, 9.81):
        model = Mechanism(Description("drop", (link,), np.array([0.0, 0.0, gravity]))).to_mujoco()
        data = mujoco.MjData(model)
        for _ in range(1000):
            mujoco.mj_step(model, data)
        stopped = gravity * side > 0.0
        assert data.qpos[0] == pytest.approx(0.1 * side if stopped else 0.5 * gravity, rel=0.02)


def test_a_model_that_is_refused_other_parameters_is_as_it_was() -> None:
    arm = adaptctl.load("puma560_measured")
    model = arm.to_mujoco()
    before, part = copy.copy(model), MujocoArm.of(model)
    heavier = arm.description.with_parameters(2.0 * np.array(arm.inertial_parameters))
    weightless = replace(heavier.links[5], inertia=np.array([0.0, *heavier.links[5].inertia[1:]]))
    fewer = replace(heavier, links=heavier.links[:5])
    for after in (replace(heavier, links=(*heavier.links[:5], weightless)), fewer):
        with pytest.raises(ValueError, match=r"link 'link6': mass: expected a positive number for MuJoCo, got 0|zip"):
            set_parameters(part, arm.description, after)
        for name in ("body_mass", "body_inertia", "body_ipos", "dof_armature", "dof_damping"):
            np.testing.assert_array_equal(getattr(model, name), getattr(before, name))
    set_parameters(part, arm.description, heavier)
    p, v, a = np.random.default_rng(0).uniform(-1, 1, (3, 5, 6))
    expected, found = (arm.inverse_dynamics(p, v, a) for arm in (Mechanism(heavier), Mechanism.from_mujoco(model)))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
