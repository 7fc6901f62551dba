"""Forward kinematics against Pinocchio, on trees with link frames anywhere, and against energies."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_tree

from adaptctl.arrays import Array
from adaptctl.description import GROUND, Pose
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import MovingPoint, joint_axes, link_poses, moving_point
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Vec, column


def pinocchio_model(mechanism: Mechanism) -> pinocchio.Model:
    """The joints alone, built by hand; Pinocchio places a joint in its parent joint's frame, we in the link's."""
    model = pinocchio.Model()
    for link in mechanism.links:
        turns = link.joint.kind.is_revolute
        joint = pinocchio.JointModelRevoluteUnaligned if turns else pinocchio.JointModelPrismaticUnaligned
        above = mechanism.links[link.parent].joint_to_link if link.parent != GROUND else Pose.identity()
        model.addJoint(link.parent + 1, joint(link.joint.axis), se3(above @ link.parent_to_joint), link.joint.name)
    return model


def pinocchio_links(mechanism: Mechanism, p: Array) -> list[pinocchio.SE3]:
    model = pinocchio_model(mechanism)
    data = model.createData()
    pinocchio.forwardKinematics(model, data, p)
    return [data.oMi[i + 1] * se3(link.joint_to_link) for i, link in enumerate(mechanism.links)]


def se3(pose: Pose) -> pinocchio.SE3:
    return pinocchio.SE3(pose.rotation, pose.translation)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 7))
def test_link_poses_are_pinocchios(seed: int, links: int) -> None:
    rng, tree = np.random.default_rng(seed), random_tree(seed, links)
    p = rng.uniform(-2, 2, (3, links))
    poses = link_poses(tree, p)
    assert poses.rotations.shape == (3, links, 3, 3)
    for k in range(3):
        for i, placement in enumerate(pinocchio_links(tree, p[k])):
            np.testing.assert_allclose(poses.rotations[k, i], placement.rotation, atol=1e-13)
            np.testing.assert_allclose(poses.translations[k, i], placement.translation, atol=1e-13)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 7))
def test_moving_one_joint_turns_or_shifts_its_link_about_its_axis(seed: int, links: int) -> None:
    rng, tree = np.random.default_rng(seed), random_tree(seed, links)
    p, i, angle = rng.uniform(-2, 2, links), int(rng.integers(links)), 0.7
    axes, before = joint_axes(tree, p), link_poses(tree, p)
    after = link_poses(tree, p + angle * (np.arange(links) == i))
    axis, point, origin = axes.directions[i], axes.positions[i], before.translations[i]
    if tree.links[i].joint.kind.is_revolute:
        turn = rotation_about(axis, angle)
        np.testing.assert_allclose(after.rotations[i], turn @ before.rotations[i], atol=1e-13)
        np.testing.assert_allclose(after.translations[i], point + turn @ (origin - point), atol=1e-13)
    else:
        np.testing.assert_allclose(after.rotations[i], before.rotations[i], atol=1e-13)
        np.testing.assert_allclose(after.translations[i], origin + angle * axis, atol=1e-13)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 7))
def test_a_points_jacobian_is_the_rate_of_its_position(seed: int, links: int) -> None:
    rng, tree = np.random.default_rng(seed), random_tree(seed, links)
    q, rates, link, offset = *rng.uniform(-2, 2, (2, links)), int(rng.integers(links)), rng.uniform(-1, 1, 3)

    def point(q: Array) -> MovingPoint:
        return moving_point(tree.equations.links, column(q), link, Vec(*offset.tolist()))

    poses, h = link_poses(tree, q), 1e-5
    expected = poses.rotations[link] @ offset + poses.translations[link]
    np.testing.assert_allclose([*point(q).position], expected, atol=1e-13)
    ahead, behind = (np.array([*point(q + sign * h * rates).position]) for sign in (1.0, -1.0))
    np.testing.assert_allclose([*point(q).velocity(column(rates))], (ahead - behind) / (2.0 * h), atol=1e-7)


def test_heights_are_the_energy_regressors() -> None:
    """The potential of a unit mass at a link's origin is -g.x: energies and kinematics share one geometry."""
    rng = np.random.default_rng(1)
    tree = random_tree(1, 5)
    p = rng.uniform(-2, 2, (4, 5))
    heights = -link_poses(tree, p).translations @ tree.description.gravity
    np.testing.assert_allclose(tree.energy_regressor(p, np.zeros((4, 5)))[:, ::10], heights, atol=1e-12)


def test_bad_input_is_refused() -> None:
    tree = random_tree(2, 3)
    with pytest.raises(InputError, match=r"p: expected shape \(\.\.\., 3\), got \(2,\)"):
        link_poses(tree, np.zeros(2))
    with pytest.raises(NonFiniteError, match="nan at index"):
        joint_axes(tree, [0.0, float("nan"), 0.0])
