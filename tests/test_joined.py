"""Several mechanisms as one: two PUMAs that hold a rod."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike
from random_trees import random_tree

from adaptctl.description import Description, Pose
from adaptctl.description.loops import Closure, ClosureKind, Loops
from adaptctl.description.pose import FrameKind, NamedFrame, rotation_about
from adaptctl.description.transforms import joined
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis

ROD = Pose(rotation_about((1, 0, 0), np.pi), (0.0, 0.0, 0.3))
"""The right hand in the left: 0.3 m ahead, face to face."""
LEFT = (-2.25, -2.36, -0.33, 0.375, 1.436, -0.08)
RIGHT = (2.455, -2.233, -0.116, 1.624, -1.103, -2.392)


@pytest.fixture(scope="module")
def two_arms() -> Mechanism:
    puma = load("puma560_measured").description
    stands = {"left": Pose.identity(), "right": Pose(rotation_about((0, 0, 1), np.pi), (1.1, 0.0, 0.0))}
    reference = {f"left.joint{i + 1}": q for i, q in enumerate(LEFT)}
    reference |= {f"right.joint{i + 1}": q for i, q in enumerate(RIGHT)}
    rod = Closure("rod", "left.link6", "right.link6", ROD, Pose.identity(), ClosureKind.WELD)
    loops = Loops(tuple(f"left.joint{i}" for i in range(1, 7)), (rod,), reference=reference)
    return Mechanism(joined("two_arms", {name: (puma, stand) for name, stand in stands.items()}, loops))


def test_two_arms_that_hold_a_rod_have_six_freedoms(two_arms: Mechanism) -> None:
    assert (two_arms.dof, len(two_arms.links), len(two_arms.parameter_names)) == (6, 12, 120)
    poses = link_poses(two_arms, np.array(LEFT) + 0.05)
    left, right = two_arms.description.links[5].name, two_arms.description.links[11].name
    assert (left, right) == ("left.link6", "right.link6")
    hand = poses.translations[5] + poses.rotations[5] @ ROD.translation
    np.testing.assert_allclose(poses.translations[11], hand, atol=1e-12)
    np.testing.assert_allclose(poses.rotations[11], poses.rotations[5] @ ROD.rotation, atol=1e-12)


def test_their_rank_and_their_dynamics(two_arms: Mechanism) -> None:
    """36 and 36 less what the rod makes one: its ten are those of both hands."""
    basis = fundamental_basis(essential_space(two_arms))
    assert basis.rank == 62
    model = ReducedModel(two_arms, basis)
    rng = np.random.default_rng(0)
    p, v, a = np.array(LEFT) + 0.05 * rng.normal(size=6), rng.normal(size=6), rng.normal(size=6)
    torque = two_arms.inverse_dynamics(p, v, a)
    np.testing.assert_allclose(model.inverse_dynamics(p, v, a), torque, rtol=1e-9)
    np.testing.assert_allclose(two_arms.forward_dynamics(p, v, torque), a, rtol=1e-9)


def test_without_a_loop_the_parts_do_not_feel_one_another() -> None:
    first, second = random_tree(1, 3), random_tree(2, 4)
    first = Mechanism(replace(first.description, gravity=second.description.gravity))
    both = Mechanism(
        joined("both", {name: (part.description, Pose.identity()) for name, part in (("a", first), ("b", second))})
    )
    p, v, a = np.random.default_rng(0).normal(size=(3, 7))
    alone = [part.inverse_dynamics(p[k], v[k], a[k]) for part, k in ((first, slice(3)), (second, slice(3, 7)))]
    np.testing.assert_allclose(both.inverse_dynamics(p, v, a), np.concatenate(alone), rtol=1e-12, atol=1e-12)


def test_named_frames_stay_where_they_are_on_their_parts() -> None:
    stand, place = (
        Pose(rotation_about((0, 0, 1), 0.3), (1.0, 0.0, 0.0)),
        Pose(rotation_about((1, 0, 0), 0.2), (0, 0, 1)),
    )
    frames = (NamedFrame("tool", 1, place), NamedFrame("camera", -1, place, FrameKind.SENSOR))
    arm = replace(random_tree(1, 2).description, frames=frames)
    both = joined("both", {"a": (arm, Pose.identity()), "b": (arm, stand)}, gravity=arm.gravity)
    assert both.frames == (
        NamedFrame("a.tool", 1, place),
        NamedFrame("a.camera", -1, place, FrameKind.SENSOR),
        NamedFrame("b.tool", 3, place),
        NamedFrame("b.camera", -1, stand @ place, FrameKind.SENSOR),
    )


def on_a_wall(arm: Description, gravity: ArrayLike | None) -> Description:
    """An arm beside one like it that is mounted on a wall."""
    wall = Pose(rotation_about((1, 0, 0), 0.5 * np.pi), (0.0, 1.0, 0.0))
    return joined("pair", {"floor": (arm, Pose.identity()), "wall": (arm, wall)}, gravity=gravity)


def test_gravity_is_asked_for_where_a_pose_turns_it() -> None:
    """An arm on the wall: does its file have the gravity of the wall, or of the floor?"""
    arm = load("puma560_measured").description
    message = (
        r"pair: part 'wall' has the gravity \[0.0, 0.0, -9.81\] in its own ground frame, \[0.0, 9.81, .*\] in the "
        r"common ground frame: give `gravity` in the common ground frame, .* \(0, 0, -9.81\)"
    )
    with pytest.raises(InputError, match=message):
        on_a_wall(arm, None)
    down = np.array([0.0, 0.0, -9.81])
    both = Mechanism(on_a_wall(arm, down))
    sideways = Mechanism(replace(arm, gravity=np.array([0.0, -9.81, 0.0])))
    p, v, a = np.random.default_rng(0).normal(size=(3, 12))
    expected = Mechanism(arm).inverse_dynamics(p[:6], v[:6], a[:6])
    np.testing.assert_allclose(both.inverse_dynamics(p, v, a)[:6], expected, rtol=1e-12, atol=1e-12)
    turned = rotation_about((1, 0, 0), 0.5 * np.pi).T @ down
    np.testing.assert_allclose(turned, sideways.description.gravity, atol=1e-14)
    expected = sideways.inverse_dynamics(p[6:], v[6:], a[6:])
    np.testing.assert_allclose(both.inverse_dynamics(p, v, a)[6:], expected, rtol=1e-12, atol=1e-11)


def test_parts_that_do_not_go_together_are_refused(two_arms: Mechanism) -> None:
    with pytest.raises(InputError, match="parts: expected at least one"):
        joined("none", {})
    with pytest.raises(InputError, match="part 'a' has loops"):
        joined("nested", {"a": (two_arms.description, Pose.identity())})
    parts = {name: (random_tree(seed, 2).description, Pose.identity()) for name, seed in (("a", 1), ("b", 2))}
    with pytest.raises(InputError, match=r"apart: part 'b' has the gravity .*, part 'a' \[.*\]: give `gravity`"):
        joined("apart", parts)
    np.testing.assert_array_equal(joined("apart", parts, gravity=(0.0, 0.0, -1.6)).gravity, [0.0, 0.0, -1.6])
    with pytest.raises(InputError, match="gravity"):
        joined("apart", parts, gravity=(0.0, -9.81))
