"""Dyads: two links that close a loop in a plane, against Newton's steps; and angles known by sine and cosine."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import mostly_at_night
from random_loops import RECIPES, equations, gaps, random_loop
from random_trees import random_inertia, random_pose
from test_loops_in_closed_form import four_bar, planar_platform

from adaptctl.arrays import Array
from adaptctl.compilation import Op, compile_function
from adaptctl.description import GROUND, Closure, ClosureKind, Coupling, Description, Joint, Link, Loops, Pose
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.loop_equations import LoopEquations
from adaptctl.dynamics.loops.dyad import Dyad, _rule
from adaptctl.errors import SingularityError
from adaptctl.scalars import Column, Dual, angle, column, cos, sin
from adaptctl.simulation import Plant

KINDS = {
    "cut at an outer pivot, five bars": ("five-bar", 4), "cut at an outer pivot, four": ("four-bar", 2),
    "cut in the middle": ("four-bar", 3), "gears": ("gears alone", 0),
}  # fmt: skip


def of_kind(kind: str) -> tuple[Mechanism, Array]:
    """A mechanism whose loops close in closed form, and a closed configuration of it."""
    if kind in KINDS:
        recipe, seed = KINDS[kind]
        return random_loop(seed, RECIPES[recipe])
    bars = four_bar(0.2, 0.55, 0.45, 0.6)
    mechanism = {"six bars": six_bars, "along x": lambda: along_x(bars)}.get(
        kind, lambda: turned_in_space(bars, int(kind[-1]))
    )()
    assert mechanism.continuation is not None
    return mechanism, mechanism.continuation.reference


def turned_in_space(mechanism: Mechanism, seed: int) -> Mechanism:
    """The same mechanism in other frames: of the ground and of every link, joints turning either way about their
    axes."""
    rng, old = np.random.default_rng(seed), mechanism.description
    ways = {link.name: random_pose(rng).rotation for link in old.links} | {None: random_pose(rng).rotation}
    signs = dict(zip(old.joint_names, rng.choice([-1.0, 1.0], len(old.links)).tolist(), strict=True))

    def seen(name: str | None, pose: Pose) -> Pose:
        return Pose(ways[name].T @ pose.rotation, ways[name].T @ pose.translation)

    def turned(link: Link) -> Link:
        parent = None if link.parent == GROUND else old.links[link.parent].name
        joint = replace(link.joint, axis=signs[link.joint.name] * link.joint.axis)
        far = Pose(link.joint_to_link.rotation @ ways[link.name], link.joint_to_link.translation)
        return replace(link, joint=joint, parent_to_joint=seen(parent, link.parent_to_joint), joint_to_link=far)

    assert old.loops is not None
    closures = tuple(
        replace(c, first_frame=seen(c.first, c.first_frame), second_frame=seen(c.second, c.second_frame))
        for c in old.loops.closures
    )
    reference = {name: signs[name] * x for name, x in old.loops.reference.items()}
    loops = replace(old.loops, closures=closures, reference=reference)
    return Mechanism(replace(old, links=tuple(map(turned, old.links)), loops=loops))


def along_x(mechanism: Mechanism) -> Mechanism:
    """The same mechanism with axes along x, from one along z."""
    cycled = np.roll(np.eye(3), 1, axis=0)
    links = mechanism.description.links
    placed = (
        replace(
            one, parent_to_joint=Pose(cycled @ one.parent_to_joint.rotation, cycled @ one.parent_to_joint.translation)
        )
        if one.parent == GROUND
        else one
        for one in links
    )
    return Mechanism(replace(mechanism.description, links=tuple(placed)))


def six_bars() -> Mechanism:
    """A four-bar whose rocker drives another one, closed by hinges, and by a gear a wheel: Watt's chain."""
    rng, still = np.random.default_rng(0), Pose.identity()

    def at(x: float, y: float = 0.0, z: float = 0.0) -> Pose:
        return Pose(np.eye(3), np.array([x, y, z]))

    def link(name: str, parent: int, near: Pose) -> Link:
        return Link(name, parent, Joint(name), near, still, random_inertia(rng))

    links = (
        link("crank", -1, still), link("coupler", 0, at(0.2, 0.0, 0.1)), link("rocker", -1, at(0.6)),
        link("second coupler", 2, at(0.25, 0.1)), link("second rocker", -1, at(1.1, 0.0, 0.2)),
        link("wheel", -1, still),
    )  # fmt: skip
    closures = (
        Closure("pin", "coupler", "rocker", at(0.55), at(0.45, 0.0, 0.1), ClosureKind.AXIS),
        Closure("hinge", "second coupler", "second rocker", at(0.5), at(0.4, 0.0, -0.2), ClosureKind.AXIS),
    )
    gear = Coupling("gear", "wheel", "second rocker", -2.5, 0.3)
    reference = {"crank": 1.5, "coupler": -1.0, "rocker": 1.5, "second coupler": -1.5, "second rocker": 2.0}
    return Mechanism(Description("six bars", links, loops=Loops(("crank",), closures, (gear,), reference)))


@pytest.mark.parametrize("kind", [*KINDS, "six bars", "along x", "turned 0", "turned 1", "turned 2", "turned 3"])
@pytest.mark.parametrize("turns", mostly_at_night([0, 1, -3], 0, -3))
def test_closed_form_is_where_newton_ends(kind: str, turns: int) -> None:
    mechanism, q = of_kind(kind)
    loops = equations(mechanism)
    assert loops.rules
    stepped = replace(loops, rules=())
    around = 2.0 * math.pi * turns * np.array([isinstance(rule, Dyad) for rule in loops.rules for _ in rule.joints])
    guess = q.copy()
    guess[[joint for rule in loops.rules for joint in rule.joints]] += around
    native = compile_function(lambda p, q: (loops.closed(p, q),), {"p": mechanism.dof, "q": len(q)})
    places = q[list(loops.closing.primary)] + np.random.default_rng(0).uniform(-0.01, 0.01, (20, mechanism.dof))
    at_once = np.array(loops.closed(Column(places.T), Column(np.repeat(guess[:, None], 20, axis=1))).of).T
    if turns and any(not isinstance(rule, Dyad) for rule in loops.rules) and kind != "gears":
        return  # a gear's follower is not around as often
    for p, in_arrays in zip(places, at_once, strict=True):
        found, newton = (np.array(one.closed(column(p), column(guess)).of, dtype=float) for one in (loops, stepped))
        np.testing.assert_allclose(found, newton, rtol=0, atol=1e-12)
        np.testing.assert_allclose(in_arrays, found, rtol=0, atol=1e-13)
        np.testing.assert_allclose(native.call(p, guess)[0], found, rtol=0, atol=1e-13)
        assert np.abs(gaps(mechanism.description, found)).max() < 1e-13


@pytest.mark.parametrize("kind", ["six bars", "turned 0", "cut at an outer pivot, five bars"])
def test_motion_is_newtons(kind: str) -> None:
    """Torques and accelerations in native code, whose sines of joints that follow are those of the triangle."""
    mechanism, q = of_kind(kind)
    loops, r, rng = equations(mechanism), mechanism.dof, np.random.default_rng(1)
    v, a = rng.normal(size=(2, r))
    given = q[list(loops.closing.primary)] + 0.01, q, v, a, mechanism.inertial_parameters

    def motion(one: LoopEquations) -> list[Array]:
        def both(p: Column, q: Column, v: Column, a: Column, parameters: Column) -> tuple[Column, Column]:
            closed = one.closed(p, q)
            torque = one.inverse_dynamics(closed, v, v, a, parameters)
            return torque, one.forward_dynamics(closed, v, a, parameters)

        sizes = {"p": r, "q": len(q), "v": r, "a": r, "parameters": loops.parameters}
        return list(compile_function(both, sizes).call(*given))

    for found, newton in zip(motion(loops), motion(replace(loops, rules=())), strict=True):
        np.testing.assert_allclose(found, newton, rtol=1e-10, atol=1e-12)


def test_the_branch_is_that_of_the_configuration_nearby() -> None:
    """From a crossed four-bar it stays crossed, and a parallelogram that swings through its dead point keeps its
    energy and its shape."""
    bars = equations(four_bar(0.2, 0.55, 0.45, 0.6))
    crossed = np.array([1.5, -2.610195, -2.432009])
    q = np.array(bars.closed(Column((1.51,)), column(crossed)).of)
    assert np.abs(q - crossed).max() < 0.05
    assert float(bars.residual(column(q))[0]) == pytest.approx(0.0, abs=1e-13)


@pytest.mark.parametrize("speed", [-1.7, -2.003, -2.31])
def test_a_dead_point_is_passed_as_before(speed: float) -> None:
    """A parallelogram, swung through the configuration in which all its bars lie in a line, keeps shape and energy."""
    bars = Mechanism(replace(four_bar(0.3, 0.6, 0.3, 0.6, crank=0.5).description, gravity=np.zeros(3)))
    plant = Plant(bars, 1e-3)
    state = plant.init([0.5], [speed])
    energy = plant.energy(state)
    for _ in range(500):
        state = plant.step(state, [0.0])
    assert state.p[0] < -0.2
    assert plant.energy(state) == pytest.approx(energy, rel=1e-5)
    np.testing.assert_allclose(state.q[1:], [-state.p[0], state.p[0]], atol=1e-6)


def test_what_starts_beyond_a_dead_point_is_not_followed_past_it() -> None:
    bars = four_bar(0.3, 0.6, 0.3, 0.6, crank=0.15)
    for beyond in (-0.05, -0.3, -1.0):
        with pytest.raises(SingularityError):
            bars.configuration([beyond])


def test_each_cut_of_a_dyad_is_found() -> None:
    cuts = {kind: [rule.is_cut_in_the_middle for rule in equations(of_kind(kind)[0]).rules if isinstance(rule, Dyad)]
            for kind in KINDS}  # fmt: skip
    assert list(cuts.values()) == [[False], [False], [True], []]


def test_a_dyad_between_two_cranks_is_of_the_outer_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("adaptctl.dynamics.loops.dyad._dyad", lambda sides, joints, places: joints)
    loop: Any = SimpleNamespace(first=SimpleNamespace(links=(0, 1)), second=SimpleNamespace(links=(2, 3)))
    assert _rule(loop, {0, 2}, {}) == (1, 3)
    assert _rule(loop, {0, 1}, {}) == (2, 3)
    assert _rule(loop, {0}, {}) is None
    long: Any = SimpleNamespace(first=SimpleNamespace(links=(0, 1, 2)), second=SimpleNamespace(links=(3, 4, 5)))
    for joints in ((2, 5), (1, 2), (4, 5)):
        assert _rule(long, set(range(6)) - {*joints}, {}) == joints
    assert _rule(long, {1, 2, 4, 5}, {}) is None


@pytest.mark.parametrize("recipe", ["planar weld", "spatial point", "spatial hinge", "spatial weld"])
def test_other_loops_are_left_to_newton(recipe: str) -> None:
    assert equations(random_loop(0, RECIPES[recipe])[0]).rules == ()


def test_a_platform_is_no_dyad() -> None:
    assert equations(planar_platform()).rules == ()


@settings(max_examples=20)
@given(phi=st.floats(-20.0, 20.0))
def test_a_crank_goes_round_and_round(phi: float) -> None:
    """Every joint stays within half a turn of the configuration nearby, however often the crank has been around."""
    bars = equations(four_bar(0.2, 0.55, 0.45, 0.6))
    start = bars.closed(Column((1.5,)), Column((1.5, -1.0, 1.5)))
    turns = 2.0 * math.pi * round((phi - 1.5) / (2.0 * math.pi))
    near = Column((phi, start[1] - turns, start[2]))
    q = bars.closed(Column((phi,)), near)
    assert all(abs(q[i] - near[i]) <= math.pi + 1e-12 for i in (1, 2))
    assert float(bars.residual(q)[0]) == pytest.approx(0.0, abs=1e-13)


def test_what_cannot_close_is_left_open_and_finite() -> None:
    """A four-bar beyond where it stretches out: finite, and its gap is there for others to see."""
    stuck = equations(four_bar(0.5, 0.3, 0.4, 0.6, crank=0.8))
    native = compile_function(lambda p, q: (stuck.closed(p, q),), {"p": 1, "q": 3})
    given = np.array([2.5]), np.array([2.5, -1.0, 1.5])
    for q in (stuck.closed(*map(column, given)), column(native.call(*given)[0])):
        assert all(math.isfinite(x) for x in q)
        assert max(abs(float(x)) for x in stuck.residual(q)) > 1e-2


def test_sines_of_joints_that_follow_cost_nothing() -> None:
    """Five bars behind a vertical axis: of the two primary joints that move them, and of one nearby, for its side."""
    loops = equations(load("semi_direct_drive"))

    def torque(p: Column, q: Column, v: Column, parameters: Column) -> Column:
        closed = loops.closed(p, q)
        return loops.inverse_dynamics(closed, v, v, v, parameters)

    sizes = {"p": 3, "q": 5, "v": 3, "parameters": loops.parameters}
    counts = compile_function(torque, sizes).operations
    assert (counts[Op.SIN], counts[Op.COS]) == (3, 3)


@given(x=st.floats(-1e3, 1e3), near=st.floats(-1e3, 1e3))
def test_an_angle_has_its_sine_and_is_near(x: float, near: float) -> None:
    found = angle(math.sin(x), math.cos(x), near)
    assert abs(found - near) <= math.pi + 1e-9
    assert math.remainder(found - x, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)
    (native,) = compile_function(lambda y: Column((angle(sin(y[0]), cos(y[0]), y[1]),)), {"y": 2}).call(
        np.array([x, near])
    )
    assert native == pytest.approx(found, abs=1e-12) or abs(abs(native - near) - math.pi) < 1e-9


def test_an_angles_derivative_is_the_angles() -> None:
    x = Dual(2.0, 1.0)
    found = angle(sin(x), cos(x), Dual(8.0, 5.0))
    assert (found.value, found.slope) == (pytest.approx(2.0 + 2.0 * math.pi), pytest.approx(1.0))
