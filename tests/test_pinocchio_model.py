"""Pinocchio's models: in from any order of joints, out with the same torques."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adaptctl.description import (
    GROUND,
    Description,
    Joint,
    JointKind,
    Limits,
    Link,
    Pose,
    depth_first,
    from_pinocchio,
    to_pinocchio,
)
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import from_center_of_mass, inertia_tensor, transformed
from adaptctl.description.pose import rotation_about
from adaptctl.errors import InputError, SimplificationWarning

KINDS = tuple(JointKind)


def random_pose(rng: np.random.Generator) -> Pose:
    axis = rng.normal(size=3)
    return Pose(rotation_about(axis / np.linalg.norm(axis), rng.uniform(-3, 3)), rng.uniform(-1, 1, 3))


def random_inertia(rng: np.random.Generator) -> np.ndarray:
    points = rng.uniform(-0.5, 0.5, (5, 3))
    return sum(from_center_of_mass(m, c, np.zeros((3, 3))) for m, c in zip(rng.uniform(0.1, 2, 5), points, strict=True))


def random_tree(seed: int, n: int) -> Description:
    rng = np.random.default_rng(seed)
    links = []
    for i in range(n):
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
        limits = Limits(-1.0 - rng.random(), 1.0 + rng.random(), 3.0, 40.0)
        kind = KINDS[rng.integers(3)]
        joint = Joint(f"j{i}", kind, axis, Limits(velocity=2.0) if kind is JointKind.CONTINUOUS else limits)
        parent = int(rng.integers(GROUND, i)) if i else GROUND
        links.append(Link(f"l{i}", parent, joint, random_pose(rng), random_pose(rng), random_inertia(rng)))
    return Description("tree", depth_first(links), rng.normal(size=3))


def torques(model: pinocchio.Model, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    return pinocchio.rnea(model, model.createData(), q, v, a)


def close(ours: np.ndarray, theirs: np.ndarray) -> bool:
    return bool(np.abs(ours - theirs).max() <= 1e-12 * max(1.0, np.abs(theirs).max()))


def plain_recursion(d: Description, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Torques by virtual work in world axes, with nothing of Pinocchio: sum of J' times the rate of momentum."""
    n, step = len(d.links), 1e-5

    def momenta(time: float) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        place, speed = q + v * time + a * time**2 / 2, v + a * time
        frames, jacobians, out = [], [], []
        for i, link in enumerate(d.links):
            base = Pose.identity() if link.parent == GROUND else frames[link.parent]
            joint, axis = base @ link.parent_to_joint, link.joint.axis
            turn = rotation_about(axis, place[i]) if link.joint.kind.is_revolute else np.eye(3)
            slide = np.zeros(3) if link.joint.kind.is_revolute else axis * place[i]
            frames.append(joint @ Pose(turn, slide) @ link.joint_to_link)
            inherited = [] if link.parent == GROUND else jacobians[link.parent]
            jacobians.append([*inherited, (i, joint.rotation @ axis, joint.translation)])
            linear, angular = np.zeros((3, n)), np.zeros((3, n))
            for k, world_axis, point in jacobians[i]:
                turning = d.links[k].joint.kind.is_revolute
                angular[:, k] = world_axis if turning else 0.0
                arm = frames[i].translation - point
                linear[:, k] = np.cross(world_axis, arm) if turning else world_axis
            ten = transformed(link.inertia, Pose(frames[i].rotation, np.zeros(3)))
            m, c, tensor = ten[0], ten[1:4], inertia_tensor(ten)
            u, w = linear @ speed, angular @ speed
            out.append((linear, angular, m * u + np.cross(w, c), np.cross(c, u) + tensor @ w, c, u, m))
        return out

    before, now, after = momenta(-step), momenta(0.0), momenta(step)
    total = np.zeros(n)
    for past, here, future in zip(before, now, after, strict=True):
        force = (future[2] - past[2]) / (2 * step) - here[6] * d.gravity
        moment = (future[3] - past[3]) / (2 * step) + np.cross(here[5], here[2]) - np.cross(here[4], d.gravity)
        total += here[0].T @ force + here[1].T @ moment
    return total


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 9))
def test_outgoing_model_moves_like_the_description(seed: int, n: int) -> None:
    tree = random_tree(seed, n)
    q, v, a = np.random.default_rng(seed).uniform(-1, 1, (3, n))
    expected = torques(to_pinocchio(tree), q, v, a)
    assert np.abs(plain_recursion(tree, q, v, a) - expected).max() <= 1e-6 * max(1.0, np.abs(expected).max())


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 9))
def test_there_and_back(seed: int, n: int) -> None:
    tree = random_tree(seed, n)
    model = to_pinocchio(tree)
    back = from_pinocchio(model)
    q, v, a = np.random.default_rng(seed).uniform(-1, 1, (3, n))
    assert close(torques(to_pinocchio(back), q, v, a), torques(model, q, v, a))
    assert back.parents == tree.parents
    assert [k.name for k in back.links] == [k.name for k in tree.links]
    assert [k.joint.name for k in back.links] == [k.joint.name for k in tree.links]
    assert [k.joint.limits for k in back.links] == [k.joint.limits for k in tree.links]
    assert [k.joint.kind for k in back.links] == [k.joint.kind for k in tree.links]
    np.testing.assert_array_equal(back.gravity, tree.gravity)
    assert back.name == tree.name


def shuffled(tree: Description, rng: np.random.Generator) -> pinocchio.Model:
    """The same tree, its joints added to Pinocchio's model in any order that keeps parents first."""
    model, places, waiting = pinocchio.Model(), {GROUND: 0}, list(range(len(tree.links)))
    model.gravity.linear = np.array(tree.gravity)
    reference = to_pinocchio(tree)
    while waiting:
        ready = [i for i in waiting if tree.links[i].parent in places]
        i = ready[rng.integers(len(ready))]
        waiting.remove(i)
        placement, inertia = reference.jointPlacements[i + 1], reference.inertias[i + 1]
        parent = places[tree.links[i].parent]
        places[i] = model.addJoint(parent, reference.joints[i + 1], placement, tree.links[i].joint.name)
        model.appendBodyToJoint(places[i], inertia, pinocchio.SE3.Identity())
    return model


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(2, 9))
def test_joints_added_in_any_order_come_in_depth_first(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    model = shuffled(random_tree(seed, n), rng)
    description = from_pinocchio(model)
    q, v, a = rng.uniform(-1, 1, (3, n))
    order = [model.getJointId(k.joint.name) - 1 for k in description.links]
    ours = torques(to_pinocchio(description), q[order], v[order], a[order])
    assert close(ours, torques(model, q, v, a)[order])


def test_mass_matrix_is_right_where_pinocchio_is_silently_wrong() -> None:
    tree = random_tree(7, 8)
    for seed in range(20):
        model = shuffled(tree, np.random.default_rng(seed))
        description = from_pinocchio(model)
        q, zero = np.random.default_rng(seed).uniform(-1, 1, 8), np.zeros(8)
        order = [model.getJointId(k.joint.name) - 1 for k in description.links]
        rest = torques(model, q, zero, zero)
        columns = np.array([torques(model, q, zero, unit) - rest for unit in np.eye(8)]).T
        ours = to_pinocchio(description)
        upper = np.triu(pinocchio.crba(ours, ours.createData(), q[order]))
        np.testing.assert_allclose(upper, np.triu(columns[np.ix_(order, order)]), atol=1e-11)


@pytest.mark.parametrize("letter", ["X", "Y", "Z"])
@pytest.mark.parametrize("kind", ["R", "P", "RUB"])
def test_aligned_joints_come_in(kind: str, letter: str) -> None:
    model = pinocchio.Model()
    model.addJoint(0, getattr(pinocchio, f"JointModel{kind}{letter}")(), pinocchio.SE3.Random(), "only")
    joint = from_pinocchio(model).links[0].joint
    np.testing.assert_array_equal(joint.axis, np.eye(3)["XYZ".index(letter)])
    assert joint.kind is (JointKind.PRISMATIC if kind == "P" else JointKind.CONTINUOUS)
    assert joint.limits == Limits()


def test_unbounded_joint_turns_by_its_angle() -> None:
    model = pinocchio.Model()
    model.addJoint(0, pinocchio.JointModelRUBY(), pinocchio.SE3.Random(), "only")
    model.appendBodyToJoint(1, pinocchio.Inertia.Random(), pinocchio.SE3.Identity())
    ours, angle, v, a = to_pinocchio(from_pinocchio(model)), 0.7, np.array([0.3]), np.array([-0.4])
    theirs = torques(model, np.array([math.cos(angle), math.sin(angle)]), v, a)
    assert close(torques(ours, np.array([angle]), v, a), theirs)


@pytest.mark.parametrize("kind", ["FreeFlyer", "Spherical", "SphericalZYX", "Planar", "Translation", "HX", "Universal"])
def test_other_joints_are_refused_by_name(kind: str) -> None:
    model = pinocchio.Model()
    model.name = "odd"
    made = getattr(pinocchio, f"JointModel{kind}")
    arguments = {"HX": (0.1,), "Universal": (np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))}.get(kind, ())
    model.addJoint(0, made(*arguments), pinocchio.SE3.Identity(), "strange")
    with pytest.raises(InputError, match=f"odd: joint 'strange' is a JointModel{kind}; only revolute and prismatic"):
        from_pinocchio(model)


def test_composite_joint_is_refused_by_name() -> None:
    model, composite = pinocchio.Model(), pinocchio.JointModelComposite()
    composite.addJoint(pinocchio.JointModelRX())
    model.addJoint(0, composite, pinocchio.SE3.Identity(), "strange")
    with pytest.raises(InputError, match="joint 'strange' is a JointModelComposite"):
        from_pinocchio(model)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_drives_go_out_and_come_back(seed: int, n: int) -> None:
    """Armature is in Pinocchio's inverse dynamics; damping and dry friction are held, and left out of it."""
    tree, rng = random_tree(seed, n), np.random.default_rng(seed)
    values = rng.uniform(0.1, 2.0, (n, 3)) * (rng.random((n, 3)) < 0.7)
    drives = [Drive(*(x or None for x in row)) for row in values.tolist()]
    links = [replace(link, joint=replace(link.joint, drive=d)) for link, d in zip(tree.links, drives, strict=True)]
    model = to_pinocchio(replace(tree, links=tuple(links)))
    q, v, a = rng.normal(size=(3, n))
    np.testing.assert_allclose(torques(model, q, v, a), torques(to_pinocchio(tree), q, v, a) + values[:, 0] * a)
    np.testing.assert_array_equal(model.damping, values[:, 1])
    assert [link.joint.drive for link in from_pinocchio(model).links] == drives


def test_negative_armature_is_refused_by_name() -> None:
    model = pinocchio.Model()
    model.addJoint(0, pinocchio.JointModelRX(), pinocchio.SE3.Identity(), "geared")
    model.armature = np.array([-0.2])
    with pytest.raises(InputError, match="joint 'geared': rotor_inertia: expected a finite number of at least 0"):
        from_pinocchio(model)


def limited(effort: float, velocity: float, lower: float, upper: float) -> pinocchio.Model:
    model, bounds = pinocchio.Model(), [np.array([b]) for b in (effort, velocity, lower, upper)]
    model.name = "short"
    model.addJoint(0, pinocchio.JointModelRX(), pinocchio.SE3.Identity(), "stiff", *bounds)
    return model


@pytest.mark.parametrize("bounds", [(0, 0, 0, 0), (1, 0, -1, 1), (0, 1, -1, 1), (1, 1, 0, 0)])
def test_limits_of_zero_are_no_limits_but_said(bounds: tuple[float, ...]) -> None:
    with pytest.warns(SimplificationWarning, match="short: limits of zero are read as no limits: stiff \\("):
        description = from_pinocchio(limited(*bounds))
    limits = description.links[0].joint.limits
    assert math.inf in (limits.upper, limits.velocity, limits.effort)


@pytest.mark.parametrize("bounds", [(1, 1, 1, -1), (1, 1, 1, 1)])
def test_impossible_limits_are_refused_by_name(bounds: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match=r"short: joint 'stiff': .*expected"):
        from_pinocchio(limited(*bounds))


def test_empty_model_is_refused() -> None:
    with pytest.raises(InputError, match="links: expected at least one"):
        from_pinocchio(pinocchio.Model())


def one_link(ten: list[float]) -> Description:
    return Description("one", (Link("l", GROUND, Joint("j"), Pose.identity(), Pose.identity(), np.array(ten)),))


def test_first_moment_without_mass_cannot_go_out() -> None:
    with pytest.raises(InputError, match="link 'l': first moment without mass is not supported"):
        to_pinocchio(one_link([0, 1, 0, 0, 1, 0, 1, 0, 0, 1]))


@pytest.mark.parametrize("ten", [[0.0] * 10, [0, 0, 0, 0, 1, 0.1, 1, 0.2, 0.3, 1], [2, 0.1, 0, 0, 1, 0, -1, 0, 0, 1]])
def test_odd_inertias_survive_there_and_back(ten: list[float]) -> None:
    np.testing.assert_allclose(from_pinocchio(to_pinocchio(one_link(ten))).inertial_parameters, ten, atol=1e-15)


def test_reading_needs_no_pinocchio() -> None:
    code = "import sys, adaptctl.description as m; m.read('puma560_measured'); sys.exit('pinocchio' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
