"""Dyads: two links that close a loop in a plane, against Newton's steps; and angles known by sine and cosine."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_loops import RECIPES, equations, gaps, random_loop
from test_loops_in_closed_form import four_bar, planar_platform

from adaptctl.compilation import Op, compile_function
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.loops.dyad import Dyad
from adaptctl.scalars import Column, Dual, angle, column, cos, sin

KINDS = {
    "cut at an outer pivot, five bars": ("five-bar", 4), "cut at an outer pivot, four": ("four-bar", 2),
    "cut in the middle": ("four-bar", 3), "gears": ("gears alone", 0),
}  # fmt: skip


def of_kind(kind: str) -> tuple[Mechanism, Any]:
    """A mechanism whose loops close in closed form, and a closed configuration of it."""
    recipe, seed = KINDS[kind]
    return random_loop(seed, RECIPES[recipe])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("turns", [0, 1, -3])
def test_closed_form_is_where_newton_ends(kind: str, turns: int) -> None:
    mechanism, q = of_kind(kind)
    loops = equations(mechanism)
    assert loops.rules
    stepped = replace(loops, rules=())
    around = 2.0 * math.pi * turns * np.array([isinstance(rule, Dyad) for rule in loops.rules for _ in rule.joints])
    guess = q.copy()
    guess[[joint for rule in loops.rules for joint in rule.joints]] += around
    for away in np.random.default_rng(0).uniform(-0.01, 0.01, (20, mechanism.dof)):
        p = column(q[list(loops.closing.primary)] + away)
        found, newton = (np.array(one.closed(p, column(guess)).of, dtype=np.float64) for one in (loops, stepped))
        np.testing.assert_allclose(found, newton, rtol=0, atol=1e-12)
        assert np.abs(gaps(mechanism.description, found)).max() < 1e-13


def test_each_cut_of_a_dyad_is_found() -> None:
    cuts = {kind: [rule.is_cut_in_the_middle for rule in equations(of_kind(kind)[0]).rules if isinstance(rule, Dyad)]
            for kind in KINDS}  # fmt: skip
    assert list(cuts.values()) == [[False], [False], [True], []]


@pytest.mark.parametrize("recipe", ["planar weld", "spatial point", "spatial hinge", "spatial weld"])
def test_other_loops_are_left_to_newton(recipe: str) -> None:
    assert equations(random_loop(0, RECIPES[recipe])[0]).rules == ()


def test_a_platform_is_no_dyad() -> None:
    assert equations(planar_platform()).rules == ()


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
    q = stuck.closed(Column((2.5,)), Column((2.5, -1.0, 1.5)))
    assert all(math.isfinite(x) for x in q)
    assert max(abs(float(x)) for x in stuck.residual(q)) > 1e-2


def test_sines_of_joints_that_follow_cost_nothing() -> None:
    """Five bars behind a vertical axis, closed and moving: sines of the primary joints that move them, no others."""
    loops = equations(load("semi_direct_drive"))

    def torque(p: Column, q: Column, v: Column, parameters: Column) -> Column:
        closed = loops.closed(p, q)
        return loops.inverse_dynamics(closed, v, v, v, parameters)

    sizes = {"p": 3, "q": 5, "v": 3, "parameters": loops.parameters}
    counts = compile_function(torque, sizes).operations
    assert (counts[Op.SIN], counts[Op.COS]) == (2, 2)


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
