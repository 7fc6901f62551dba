"""Axes in which links' vectors are held: nothing but the number of operations depends on them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_inertia, random_pose

import adaptctl
from adaptctl.arrays import Array, stacked
from adaptctl.compilation import compile_function
from adaptctl.control import ReferencePoint
from adaptctl.description import GROUND, Description, Joint, JointKind, Link, Pose, depth_first
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, equation_costs, tree_equations
from adaptctl.dynamics.equations import Equations
from adaptctl.dynamics.recursion.frame_choice import FrameChoice
from adaptctl.dynamics.recursion.segment import Placement, placements
from adaptctl.identifiability import Constraints, constrained
from adaptctl.scalars import Column, Vec, column

TURNS = np.array([[[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]], dtype=np.float64)
QUARTERS = [np.linalg.matrix_power(turn, k) for k in range(4) for turn in TURNS]
seeds = st.integers(0, 2**32 - 1)


def pose(rng: np.random.Generator) -> Pose:
    """Not turned, at right angles or, one in four, anyhow."""
    if rng.random() < 0.25:
        return random_pose(rng)
    first, second = (QUARTERS[k] for k in rng.integers(len(QUARTERS), size=2))
    return Pose(np.eye(3) if rng.random() < 0.5 else first @ second, rng.uniform(-0.5, 0.5, 3))


def link(rng: np.random.Generator, i: int, parent: int) -> Link:
    kind = JointKind.REVOLUTE if rng.random() < 0.8 else JointKind.PRISMATIC
    joint = Joint(f"joint{i}", kind, rng.choice([-1.0, 1.0]) * np.eye(3)[2 if rng.random() < 0.7 else 0])
    return Link(f"link{i}", parent, joint, pose(rng), pose(rng), random_inertia(rng))


def tree(seed: int, links: int) -> Mechanism:
    """A tree in which many joints are parallel or antiparallel to their parents'."""
    rng = np.random.default_rng(seed)
    row = [link(rng, i, int(rng.integers(GROUND, i))) for i in range(links)]
    return Mechanism(Description("tree", depth_first(row), rng.normal(size=3)))


def plane_arm(links: int) -> Mechanism:
    """Joints about z, one after the other, and gravity across them."""
    inertia, out = random_inertia(np.random.default_rng(0)), Pose(np.eye(3), np.array([0.3, 0.0, 0.0]))
    row = (Link(f"link{i}", i - 1, Joint(f"joint{i}"), Pose.identity(), out, inertia) for i in range(links))
    return Mechanism(Description("plane arm", tuple(row), np.array([0.0, -9.81, 0.0])))


def in_own_axes(mechanism: Mechanism, monkeypatch: pytest.MonkeyPatch) -> Mechanism:
    """An equal mechanism whose equations hold every vector in its link's own axes."""
    of = FrameChoice.of
    plain = staticmethod(lambda links: of(links)._replace(unturned=(False,) * len(links)))
    monkeypatch.setattr(FrameChoice, "of", plain)
    return Mechanism(mechanism.description)


def held(mechanism: Mechanism) -> FrameChoice:
    return FrameChoice.of(mechanism.equations.links)


def numbers(u: Vec) -> Array:
    return np.array([float(x) for x in u])


def own(place: Placement, u: Vec) -> Vec:
    """A link's vector in its own axes, from the axes held."""
    return u if place.turn is None else place.turn @ u


def test_joints_along_their_parents_axes_have_a_sense() -> None:
    """Either way; slides, axes across, and joints on the ground have none."""
    still = Pose.identity()
    axes = ([0, 0, 1], [0, 0, 1], [0, 0, -1], [0, 1, 0], [0, 1, 0])
    kinds = (*[JointKind.REVOLUTE] * 4, JointKind.PRISMATIC)
    links = tuple(
        Link(f"l{k}", k - 1, Joint(f"j{k}", kind, axis), still, still)
        for k, (kind, axis) in enumerate(zip(kinds, axes, strict=True))
    )
    assert held(Mechanism(Description("chain", links))).senses == (0.0, 1.0, -1.0, 0.0, 0.0)


@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(1, 8))
def test_held_placements_are_the_placements(seed: int, links: int) -> None:
    axes = held(tree(seed, links))
    q = Column(np.random.default_rng(seed).uniform(-3.0, 3.0, links).tolist())
    found, plain = axes.placements(axes.coordinates(q)), placements(axes.links, q)
    for ours, theirs in zip(found, plain, strict=True):
        np.testing.assert_allclose(numbers(own(ours, ours.shift)), numbers(theirs.shift), atol=1e-14)
        np.testing.assert_allclose(numbers(own(ours, ours.segment.axis)), numbers(theirs.segment.axis), atol=1e-14)
        parent = ours.segment.parent
        for u in (Vec(1.0, 0.0, 0.0), Vec(0.0, 1.0, 0.0), Vec(0.0, 0.0, 1.0)):
            above = u if parent == GROUND else own(found[parent], u)
            np.testing.assert_allclose(numbers(own(ours, ours.down(u))), numbers(theirs.down(above)), atol=1e-14)
        near = ours.near if parent == GROUND else own(found[parent], ours.near)
        np.testing.assert_allclose(numbers(near), numbers(theirs.near), atol=1e-14)


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(1, 7))
def test_torques_are_the_motion_of_the_energies(seed: int, links: int) -> None:
    """By Lagrange's equations: of energies, which are found in the links' own axes."""
    mechanism, rng = tree(seed, links), np.random.default_rng(seed)
    known, h = mechanism.inertial_parameters, 1e-4
    p, v, a = rng.uniform(-3.0, 3.0, (3, links))
    sides = np.vstack([np.eye(links), -np.eye(links)])

    def momentum(time: float) -> Array:
        at, speed = p + time * v + 0.5 * time**2 * a, v + time * a
        energies = mechanism.energy_regressor(np.tile(at, (2 * links, 1)), speed + sides) @ known
        return np.asarray(energies[:links] - energies[links:]) / 2.0

    moving = mechanism.energy_regressor(p + h * sides, np.tile(v, (2 * links, 1))) @ known
    still = mechanism.energy_regressor(p + h * sides, np.zeros((2 * links, links))) @ known
    lagrangian = moving - 2.0 * still
    slope = (lagrangian[:links] - lagrangian[links:]) / (2.0 * h)
    expected = (momentum(h) - momentum(-h)) / (2.0 * h) - slope
    torque = mechanism.inverse_dynamics(p, v, a)
    np.testing.assert_allclose(torque, expected, atol=1e-5 * (1.0 + np.abs(torque).max()))


@settings(max_examples=15, deadline=None)
@given(seeds, st.integers(1, 8))
def test_nothing_but_operations_depends_on_the_axes(seed: int, links: int) -> None:
    mechanism, rng = tree(seed, links), np.random.default_rng(seed)
    p, v, w, a, s = (column(x) for x in rng.uniform(-3.0, 3.0, (5, links)))
    parameters, columns = column(mechanism.inertial_parameters), range(10 * links)

    def all_of(equations: Equations) -> list[list[float]]:
        motion = equations.motion(p, v, w, a)
        rows = [motion.torque(parameters), *motion.regressor(columns), motion.regressor_transpose_product(s, columns)]
        return [list(map(float, row)) for row in (*rows, *equations.mass_matrix(p, parameters))]

    with pytest.MonkeyPatch.context() as monkeypatch:
        expected = all_of(in_own_axes(mechanism, monkeypatch).equations)
    for ours, theirs in zip(all_of(mechanism.equations), expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-12 * (1.0 + np.abs(theirs).max()))


@settings(max_examples=7, deadline=None)
@given(seeds, st.integers(1, 14))
def test_articulated_bodies_on_every_kind_of_scalar(seed: int, links: int) -> None:
    """On arrays and on symbols no value may decide what is computed."""
    rng = np.random.default_rng(seed)
    row = tuple(link(rng, i, i - 1) for i in range(links))
    mechanism = Mechanism(Description("chain", row))
    equations, D = mechanism.equations, column(mechanism.inertial_parameters)
    states = rng.uniform(-1.0, 1.0, (3, 4, links))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tree_equations, "MIN_ARTICULATED_DEPTH", 0.0)
        arrays = stacked(equations.forward_dynamics(*map(column, states), D).of, (4,))
        sizes = {"p": links, "v": links, "torque": links}
        native = compile_function(lambda p, v, torque: equations.forward_dynamics(p, v, torque, D), sizes)
        found = [native(*states[:, k]) for k in range(4)]
    for k in range(4):
        mass = mechanism.mass_matrix(states[0, k])
        bias = mechanism.inverse_dynamics(*states[:2, k], np.zeros(links))
        expected = np.linalg.solve(mass, states[2, k] - bias)
        scale = 1e-13 * np.linalg.cond(mass) * max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(arrays[k], expected, atol=scale)
        np.testing.assert_allclose(found[k], expected, atol=scale)


def test_the_puma_turns_its_forearm_by_the_sum_of_two_angles() -> None:
    axes = held(adaptctl.load("puma560_measured"))
    assert axes.senses == (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    assert axes.unturned == (False, True, False, False, False, True)
    coordinates = axes.coordinates(Column((0.1, 0.2, 0.3, 0.4, 0.5, 0.6)))
    assert coordinates[2] == pytest.approx((np.cos(0.5), np.sin(0.5)))
    assert coordinates[3] == (np.cos(0.4), np.sin(0.4))


def test_links_that_move_in_a_plane_are_held_in_its_axes() -> None:
    assert held(adaptctl.load("semi_direct_drive")).unturned == (False, True, True, True, True)
    assert held(plane_arm(4)).unturned == (False,) * 4  # the ground's: one angle turns each link's vectors already


@pytest.mark.parametrize("name", ["puma560_measured", "puma560_geared", "semi_direct_drive"])
def test_axes_held_cost_fewer_operations(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ours = equation_costs(adaptctl.load(name))
    theirs = equation_costs(in_own_axes(adaptctl.load(name), monkeypatch))
    assert theirs.forward_dynamics is not None
    assert ours.forward_dynamics is not None
    assert ours.forward_dynamics < 0.92 * theirs.forward_dynamics
    assert ours.control_law < 0.96 * theirs.control_law
    assert ours.regressor < 0.97 * theirs.regressor


def test_axes_held_cost_a_plane_arm_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    ours = equation_costs(plane_arm(4))
    assert ours == equation_costs(in_own_axes(plane_arm(4), monkeypatch))


REMEMBERING = {
    "tree": lambda: tree(3, 7),
    "friction": lambda: adaptctl.load("puma560_friction"),
    "loop": lambda: adaptctl.load("semi_direct_drive"),
    "constrained": lambda: constrained(adaptctl.load("puma560_friction"), Constraints({"link3.m": 2.0})),
}


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
@pytest.mark.parametrize("case", REMEMBERING)
def test_a_motion_is_rebuilt_from_what_is_remembered(case: str) -> None:
    mechanism = REMEMBERING[case]()
    equations, memory = mechanism.equations, mechanism.equations.motion_memory
    drawn = np.random.default_rng(0).uniform(-0.3, 0.3, (10, 5, mechanism.dof))
    for p, v, w, a, s in drawn:
        q = mechanism.configuration(mechanism.neutral_configuration + p)
        motion = equations.motion(*map(column, (q, v, w, a)))
        remembered = memory.chosen(motion.numbers)
        assert len(remembered) == len(memory.kept) < len(motion.numbers) == len(memory.sources)
        again = memory.numbers(remembered)
        np.testing.assert_allclose([float(x) for x in again], [float(x) for x in motion.numbers], rtol=0.0, atol=1e-13)
        columns = range(equations.parameters)
        ours, theirs = (
            x.regressor_transpose_product(column(s), columns).of for x in (equations.restored_motion(again), motion)
        )
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-12 * np.abs(theirs).max())


@pytest.mark.parametrize("name", ["puma560_measured", "semi_direct_drive"])
def test_a_tick_learns_as_from_the_whole_motion(name: str) -> None:
    """The estimate's step from the memory against the regressor at the last tick."""
    arm = adaptctl.load(name)
    model = adaptctl.ReducedModel(arm)
    gain = np.full(len(model.columns), 1e-3)
    law: Any = adaptctl.control.Gradient(gain, cap=0.0)
    controller = adaptctl.SlotineLi(model, 4.0, np.full(arm.dof, 1e-4), law, torque_limits=np.inf)
    p, v, v_d, a_d = np.random.default_rng(0).uniform(-0.1, 0.1, (4, arm.dof))
    point = ReferencePoint(arm.neutral_configuration, v_d, a_d)
    _, state = controller.step(
        controller.init(arm.neutral_configuration + p, v), arm.neutral_configuration + p, v, point
    )
    _, after = controller.step(state, arm.neutral_configuration + p, 1.1 * v, point)
    reference = v_d - 4.0 * p, a_d - 4.0 * (v - v_d)
    Y = model.slotine_li_regressor(arm.neutral_configuration + p, v, *reference)
    expected = -1e-3 * gain * (Y.T @ (1.1 * v - reference[0]))
    np.testing.assert_allclose(after.estimate - state.estimate, expected, atol=1e-12 * np.abs(expected).max())


def test_the_memory_holds_no_constants_and_nothing_twice() -> None:
    counts = []
    for name in ("puma560_measured", "semi_direct_drive"):
        memory = adaptctl.load(name).equations.motion_memory
        counts.append((len(memory.kept), len(memory.sources)))
    assert counts == [(65, 84), (38, 76)]


def test_saturated_friction_is_no_constant() -> None:
    """Beyond its ramp the curve of dry friction is 1 to the last bit, but it is not always beyond."""
    memory = tree(0, 1).with_drives(Drive(coulomb=1.0)).equations.motion_memory
    assert len(memory.sources) - 1 in memory.kept
