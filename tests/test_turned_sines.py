"""Sines of angles that are a step in time from others, and those that called functions are passed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adaptctl.compilation import compile_function, compile_step, outlined, trace
from adaptctl.compilation.graph import Op
from adaptctl.compilation.lanes import Precision
from adaptctl.compilation.sine import MAX_SINE_STEP
from adaptctl.scalars import Column, Scalar, cos, sin

pytestmark = pytest.mark.usefixtures("optimized")

DT = 2.0**-10


def turning(q: Column, v: Column) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Sine and cosine of an angle q, and of that a step later, whose sum need not be rounded."""
    later = q[0] + DT * v[0]
    return sin(q[0]), cos(q[0]), sin(later), cos(later)


def found(q: np.ndarray, v: np.ndarray, lanes: int, precision: Precision = "double") -> list[np.ndarray]:
    step = compile_step(turning, state={}, constants={"q": 1, "v": 1}, lanes=lanes, precision=precision)
    arms = step.ensemble(len(q))
    arms.held["q"], arms.held["v"] = q[:, None], v[:, None]
    return [part.ravel() for part in arms.run()]


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
@pytest.mark.parametrize("longest", [1e-9, 1e-3, MAX_SINE_STEP, 1.0, 1e4])
def test_steps_turn_to_within_the_last_places_of_one(lanes: int, longest: float) -> None:
    rng = np.random.default_rng(lanes)
    q, step = rng.uniform(-10.0, 10.0, 4000), rng.uniform(-longest, longest, 4000)
    step[:6] = (
        MAX_SINE_STEP,
        -MAX_SINE_STEP,
        np.nextafter(MAX_SINE_STEP, 1.0),
        -np.nextafter(MAX_SINE_STEP, 1.0),
        0.0,
        longest,
    )
    later = q + step
    parts = found(q, step / DT, lanes)
    for values, true in zip(parts, (np.sin(q), np.cos(q), np.sin(later), np.cos(later)), strict=True):
        assert (np.abs(values - true) <= 2.0 * np.spacing(0.5) + 0.5 * np.spacing(np.abs(later))).all()


@pytest.mark.parametrize("lanes", [1, 8, 16])
def test_steps_in_single_precision(lanes: int) -> None:
    rng = np.random.default_rng(lanes)
    q, step = (rng.uniform(-x, x, 4000).astype(np.float32).astype(np.float64) for x in (3.0, 0.07))
    later = q + step
    parts = found(q, step / DT, lanes, "single")
    for values, true in zip(parts, (np.sin(q), np.cos(q), np.sin(later), np.cos(later)), strict=True):
        assert np.abs(values - true).max() <= 6.0 * np.spacing(np.float32(0.5))


@pytest.mark.parametrize("lanes", [1, 8])
def test_a_long_step_and_what_is_not_finite_change_nothing_beside_them(lanes: int) -> None:
    q, v = np.linspace(-3.0, 3.0, 8), np.full(8, 20.0)
    alone = found(q, v, lanes)
    v[[1, 3, 4]], q[6] = (1e9, np.nan, np.inf), np.nan
    parts = found(q, v, lanes)
    calm = [0, 2, 5, 7]
    for values, before in zip(parts, alone, strict=True):
        np.testing.assert_array_equal(values[calm], before[calm])
    assert parts[2][1] == pytest.approx(np.sin(q[1] + DT * 1e9), rel=1e-12)
    assert np.isnan(parts[2][[3, 4, 6]]).all()
    assert np.isnan(parts[3][[3, 4, 6]]).all()


@given(st.floats(-1e6, 1e6), st.floats(-1e9, 1e9))
def test_a_long_way_is_the_sine_of_its_end(q: float, v: float) -> None:
    _, _, s, c = kernel(np.array([q]), np.array([v]))
    assert abs(s - np.sin(q + DT * v)) < 4e-16 + np.spacing(abs(q) + abs(DT * v))
    assert abs(c - np.cos(q + DT * v)) < 4e-16 + np.spacing(abs(q) + abs(DT * v))


kernel = compile_function(turning, {"q": 1, "v": 1})


def test_a_called_function_is_passed_the_sines_of_its_arguments() -> None:
    @outlined
    def inner(x: Column, k: Scalar) -> Scalar:
        return k * sin(x[1]) + sin(x[0] + x[1])

    def whole(x: Column) -> Scalar:
        return inner(x, 2.0) + inner(x, x[0]) + sin(x[1]) + cos(x[0])

    routine = trace(whole, {"x": 2})
    sines = [x for x in routine.body if x.op is Op.SIN]
    assert [x.operands[0].detail for x in sines] == [(0, 1)]
    assert routine.operations[Op.SIN] == 1 + 2  # and that of the sum, in each of two calls
    assert routine.operations[Op.COS] == 1
    x = np.array([0.3, 0.7])
    expected = (2.3 * np.sin(0.7) + 2.0 * np.sin(1.0)) + np.sin(0.7) + np.cos(0.3)
    assert compile_function(whole, {"x": 2})(x) == pytest.approx(expected, abs=1e-15)


def test_sines_go_down_as_many_calls_as_there_are() -> None:
    @outlined
    def deepest(x: Column) -> Column:
        return Column((sin(x[0]), cos(x[0])))

    @outlined
    def middle(x: Column) -> Column:
        return deepest(x)

    def whole(x: Column) -> Column:
        return middle(x)

    routine = trace(whole, {"x": 1})
    assert routine.operations[Op.SIN] == routine.operations[Op.COS] == 1
    assert not any(x.op is Op.SIN for called in routine.subroutines for x in called.body)
    np.testing.assert_array_equal(compile_function(whole, {"x": 1})(np.array([0.5])), np.sin([0.5, 0.5 + np.pi / 2]))


def several(q: Column, v: Column) -> tuple[Column, Column]:
    """Sines and cosines of some angles, and of those a step later: each group is computed at once."""
    later = q + DT * v
    return Column([*map(sin, q), *map(cos, q)]), Column([*map(sin, later), *map(cos, later)])


@pytest.mark.parametrize("lanes", [1, 2, 8])
@pytest.mark.parametrize("n", [1, 2, 3, 8, 11])
def test_one_far_angle_of_a_group_changes_no_other(n: int, lanes: int) -> None:
    rng = np.random.default_rng(n)
    step = compile_step(several, state={}, constants={"q": n, "v": n}, lanes=lanes)
    arms = step.ensemble(9)
    q, v = rng.uniform(-3.0, 3.0, (9, n)), rng.uniform(-1.0, 1.0, (9, n))
    far, long, lost = rng.random((3, 9, n)) < 0.15
    arms.held["q"], arms.held["v"] = q, v
    calm = [part.copy() for part in arms.run()]
    wild_q, wild_v = np.where(far, 1e7 * q, np.where(lost, np.nan, q)), np.where(long, 1e5 * v, v)
    arms.held["q"], arms.held["v"] = wild_q, wild_v
    now, later = arms.run()
    own, own_later = np.tile(far | lost, 2), np.tile(far | lost | long, 2)
    np.testing.assert_array_equal(now[~own], calm[0][~own])
    np.testing.assert_array_equal(later[~own_later], calm[1][~own_later])
    true = np.concatenate([np.sin(wild_q), np.cos(wild_q)], axis=-1)
    np.testing.assert_allclose(now, true, atol=2.5e-16)
    after = wild_q + DT * wild_v
    reached = np.concatenate([np.sin(after), np.cos(after)], axis=-1)
    np.testing.assert_allclose(later, reached, atol=5e-9)  # a spacing of 1e7


def test_passed_sines_turn_as_own_ones_do() -> None:
    """A called function has the same bits as the whole, and computes no sines anew; of other angles it needs one."""
    q, v = np.random.default_rng(0).uniform(-3.0, 3.0, (2, 200, 3))

    def beside(q: Column, v: Column) -> tuple[Scalar, ...]:
        return sin(q[0]), *turning(Column(q[1:2]), v), cos(q[2])

    apart, whole = (
        compile_function(lambda q, v, of=of: of(q, v), {"q": 3, "v": 3}, name="turned")
        for of in (outlined(beside), beside)
    )
    assert np.array_equal([apart(*x) for x in zip(q, v, strict=True)], [whole(*x) for x in zip(q, v, strict=True)])
