"""Axes in which links' vectors are held: nothing but the number of operations depends on them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_inertia

import adaptctl
from adaptctl.arrays import Array
from adaptctl.description import GROUND, Description, Joint, JointKind, Link, Pose, depth_first
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, equation_costs
from adaptctl.dynamics.recursion import held_axes
from adaptctl.dynamics.recursion.held_axes import angles, continued, held_placements, held_still
from adaptctl.dynamics.recursion.segment import Placement, placements
from adaptctl.scalars import Column, Vec, column

TURNS = np.array([[[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]], dtype=np.float64)
QUARTERS = [np.linalg.matrix_power(turn, k) for k in range(4) for turn in TURNS]
seeds = st.integers(0, 2**32 - 1)


def square_pose(rng: np.random.Generator) -> Pose:
    """At right angles, half of the time not turned at all."""
    first, second = (QUARTERS[k] for k in rng.integers(len(QUARTERS), size=2))
    return Pose(np.eye(3) if rng.random() < 0.5 else first @ second, rng.uniform(-0.5, 0.5, 3))


def square_tree(seed: int, links: int) -> Mechanism:
    """A tree at right angles, most of whose joints are parallel or antiparallel to their parents'."""
    rng, tree = np.random.default_rng(seed), list[Link]()
    for i in range(links):
        kind = JointKind.REVOLUTE if rng.random() < 0.8 else JointKind.PRISMATIC
        joint = Joint(f"joint{i}", kind, rng.choice([-1.0, 1.0]) * np.eye(3)[2 if rng.random() < 0.7 else 0])
        near, far = square_pose(rng), square_pose(rng)
        tree.append(Link(f"link{i}", int(rng.integers(GROUND, i)), joint, near, far, random_inertia(rng)))
    return Mechanism(Description("square", depth_first(tree), rng.normal(size=3)))


def in_own_axes(mechanism: Mechanism, monkeypatch: pytest.MonkeyPatch) -> Mechanism:
    """An equal mechanism whose equations hold every vector in its link's own axes."""
    monkeypatch.setattr(held_axes, "held_still", lambda links: [False] * len(links))
    return Mechanism(mechanism.description)


def numbers(u: Vec) -> Array:
    return np.array([float(x) for x in u])


def own(place: Placement, u: Vec) -> Vec:
    """A link's vector in its own axes, from the axes held."""
    return u if place.turn is None else place.turn @ u


@settings(max_examples=60, deadline=None)
@given(seeds, st.integers(1, 8))
def test_held_placements_are_the_placements(seed: int, links: int) -> None:
    segments = square_tree(seed, links).equations.links
    q = Column(np.random.default_rng(seed).uniform(-3.0, 3.0, links).tolist())
    held, plain = held_placements(segments, angles(segments, q)), placements(segments, q)
    for ours, theirs in zip(held, plain, strict=True):
        np.testing.assert_allclose(numbers(own(ours, ours.shift)), numbers(theirs.shift), atol=1e-14)
        np.testing.assert_allclose(numbers(own(ours, ours.segment.axis)), numbers(theirs.segment.axis), atol=1e-14)
        parent = ours.segment.parent
        for u in (Vec(1.0, 0.0, 0.0), Vec(0.0, 1.0, 0.0), Vec(0.0, 0.0, 1.0)):
            above = u if parent == GROUND else own(held[parent], u)
            np.testing.assert_allclose(numbers(own(ours, ours.down(u))), numbers(theirs.down(above)), atol=1e-14)
        near = ours.segment.near
        near = near if parent == GROUND else own(held[parent], near)
        np.testing.assert_allclose(numbers(near), numbers(theirs.segment.near), atol=1e-14)


@settings(max_examples=40, deadline=None)
@given(seeds, st.integers(1, 7))
def test_torques_are_the_motion_of_the_energies(seed: int, links: int) -> None:
    """By Lagrange's equations: of energies, which are found in the links' own axes."""
    mechanism, rng = square_tree(seed, links), np.random.default_rng(seed)
    p, v, a = rng.uniform(-3.0, 3.0, (3, links))
    h = 1e-4

    def momentum(time: float) -> Array:
        at, speed = p + time * v + 0.5 * time**2 * a, v + time * a
        steps = np.vstack([np.eye(links), -np.eye(links)])
        energies = mechanism.energy_regressor(np.tile(at, (2 * links, 1)), speed + steps) @ known
        kinetic: Array = (energies[:links] - energies[links:]) / 2.0
        return kinetic

    known = mechanism.inertial_parameters
    steps = h * np.vstack([np.eye(links), -np.eye(links)])
    slopes = mechanism.energy_regressor(p + steps, np.tile(v, (2 * links, 1))) @ known
    still = mechanism.energy_regressor(p + steps, np.zeros((2 * links, links))) @ known
    lagrangian = (slopes - 2.0 * still)[:links] - (slopes - 2.0 * still)[links:]
    expected = (momentum(h) - momentum(-h)) / (2.0 * h) - lagrangian / (2.0 * h)
    torque = mechanism.inverse_dynamics(p, v, a)
    np.testing.assert_allclose(torque, expected, atol=1e-5 * (1.0 + np.abs(torque).max()))
    regressor = mechanism.torque_regressor(p, v, a)
    np.testing.assert_allclose(regressor @ known, torque, atol=1e-11 * (1.0 + np.abs(torque).max()))


@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(1, 8))
def test_nothing_but_operations_depends_on_the_axes(seed: int, links: int) -> None:
    mechanism, rng = square_tree(seed, links), np.random.default_rng(seed)
    p, v, w, a, s = rng.uniform(-3.0, 3.0, (5, links))
    with pytest.MonkeyPatch.context() as monkeypatch:
        plain = in_own_axes(mechanism, monkeypatch)
        q, parameters, columns = column(p), column(plain.inertial_parameters), range(10 * links)
        motion = plain.equations.motion(q, column(v), column(w), column(a))
        expected = [motion.torque(parameters), *motion.regressor(columns), motion.powers(column(s), columns)]
        expected += map(Column, plain.equations.mass_matrix(q, parameters))
    motion = mechanism.equations.motion(q, column(v), column(w), column(a))
    found = [motion.torque(parameters), *motion.regressor(columns), motion.powers(column(s), columns)]
    found += map(Column, mechanism.equations.mass_matrix(q, parameters))
    for ours, theirs in zip(found, expected, strict=True):
        scale = 1.0 + max(abs(float(x)) for x in theirs)
        np.testing.assert_allclose([float(x) for x in ours], [float(x) for x in theirs], atol=1e-12 * scale)


def test_the_puma_turns_its_forearm_by_the_sum_of_two_angles() -> None:
    links = adaptctl.load("puma560_measured").equations.links
    assert continued(links) == [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    assert held_still(links) == [False, True, False, False, False, True]
    coordinates = angles(links, Column((0.1, 0.2, 0.3, 0.4, 0.5, 0.6)))
    assert coordinates[2] == pytest.approx((np.cos(0.5), np.sin(0.5)))
    assert coordinates[3] == (np.cos(0.4), np.sin(0.4))


def test_links_that_move_in_a_plane_are_held_in_its_axes() -> None:
    arm = adaptctl.load("semi_direct_drive")
    assert held_still(arm.equations.links) == [False, True, True, True, True]


@pytest.mark.parametrize("name", ["puma560_measured", "puma560_geared", "semi_direct_drive"])
def test_axes_held_cost_fewer_operations(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ours = equation_costs(adaptctl.load(name))
    theirs = equation_costs(in_own_axes(adaptctl.load(name), monkeypatch))
    assert theirs.forward_dynamics is not None
    assert ours.forward_dynamics is not None
    assert ours.forward_dynamics < 0.92 * theirs.forward_dynamics
    assert ours.tick < 0.96 * theirs.tick
    assert ours.regressor < 0.97 * theirs.regressor


@settings(max_examples=40, deadline=None)
@given(seeds, st.integers(1, 8))
def test_a_motion_is_rebuilt_from_what_is_remembered(seed: int, links: int) -> None:
    equations, rng = square_tree(seed, links).equations, np.random.default_rng(seed)
    memory = equations.motion_memory
    motion = equations.motion(*(column(x) for x in rng.uniform(-3.0, 3.0, (4, links))))
    remembered = memory.of_motion(motion.numbers)
    assert len(remembered) == len(memory.kept) <= equations.motion_size == len(motion.numbers)
    again = memory.numbers(remembered)
    np.testing.assert_allclose([float(x) for x in again], [float(x) for x in motion.numbers], rtol=0.0, atol=1e-13)


def test_a_plane_arm_remembers_no_zeros() -> None:
    counts = []
    for name in ("puma560_measured", "semi_direct_drive"):
        equations = adaptctl.load(name).equations
        counts.append((len(equations.motion_memory.kept), equations.motion_size))
    assert counts == [(65, 84), (38, 76)]


def test_saturated_friction_is_no_constant() -> None:
    """Beyond its ramp the curve of dry friction is 1 to the last bit, but it is not always beyond."""
    equations = square_tree(0, 1).with_drives(Drive(coulomb=1.0)).equations
    assert equations.motion_size - 1 in equations.motion_memory.kept
