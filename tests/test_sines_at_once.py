"""Groups of sines: steps and plain angles mixed in any order, in long routines and in called functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest
from nightly import at_night, mostly_at_night

from adaptctl.compilation import compile_function, compile_step, outlined
from adaptctl.scalars import Column, cos, sin

pytestmark = pytest.mark.usefixtures("optimized")

DT = 2.0**-10

Equation = Callable[..., Column]


def chain_of_steps(q: Column, v: Column) -> Column:
    """The second step is from an angle that the same run of sines turns, the last angle is no step."""
    x = q[0] + DT * v[0]
    z = x + DT * v[1]
    w = 3.0 * q[1]
    return Column([sin(q[0]), sin(x), sin(z), sin(w), cos(z), cos(w)])


def more_than_a_register_holds(q: Column, v: Column) -> Column:
    y = [3.0 * x for x in q]
    return Column(map(sin, [*y[:8], y[0] + DT * v[0], y[8], y[3] + DT * v[1]]))


def from_two_groups(q: Column, v: Column) -> Column:
    """Steps from angles of different groups beside each other."""
    first, second = list(map(sin, q)), sin(2.0 * v[0])
    steps = [q[0] + DT * v[1], 2.0 * v[0] + DT * q[0], q[1] + DT * v[0]]
    return Column([*first, second, *map(sin, steps), *map(cos, steps)])


def long(q: Column, v: Column) -> Column:
    """Of several native functions: the steps' angles are found by the last, the steps themselves are not."""
    later, s = [q[i] + DT * v[i] for i in range(3)], q[0]
    for k in range(7000):
        s = s * 0.999 + v[k % 3] * 0.001
    return Column([s, *map(sin, q), *map(sin, later)])


@outlined
def sine_of_a_sine(x: Column) -> Column:
    return Column((sin(sin(x[0])), cos(x[1])))


def called(q: Column, v: Column) -> Column:
    return sine_of_a_sine(Column((q[0], v[0])))


@outlined
def turned(x: Column) -> Column:
    return Column((2.0 * sin(x[0]) + x[1], 3.0 * cos(x[0])))


def known_sines(q: Column, v: Column) -> Column:
    """A call with the first two arguments as sine and cosine, and one with the constants 0 and 1."""
    if not hasattr(q[0], "with_sine"):
        return Column((2.0 * q[0] + v[2], 3.0 * q[1], v[2], 3.0))
    a, b = v[0].with_sine(q[0], q[1]), v[1].with_sine(0.0, 1.0)
    return Column((*turned(Column((a, v[2]))), *turned(Column((b, v[2])))))


CASES: Mapping[Equation, tuple[int, int]] = {
    chain_of_steps: (2, 2),
    more_than_a_register_holds: (9, 2),
    from_two_groups: (2, 2),
    long: (3, 3),
    called: (1, 1),
    known_sines: (2, 3),
}


@pytest.mark.parametrize("widths", [(1, 8), at_night(((2, 4),))])
@pytest.mark.parametrize("equation", mostly_at_night(CASES, chain_of_steps, long, known_sines))
def test_native_code_finds_what_floats_do(equation: Equation, widths: tuple[int, int]) -> None:
    n, m = CASES[equation]
    rng = np.random.default_rng(0)
    q, v = rng.uniform(-2.0, 2.0, (9, n)), rng.uniform(-2.0, 2.0, (9, m))
    expected = [equation(Column(a), Column(b)).of for a, b in zip(q.tolist(), v.tolist(), strict=True)]
    for lanes in widths:
        arms = compile_step(
            lambda q, v: (equation(q, v),), state={}, constants={"v": m}, per_member_inputs={"q": n}, lanes=lanes
        )
        members = arms.ensemble(9)
        members.held["v"] = v
        np.testing.assert_allclose(members.run(1, {"q": q[None]})[0], expected, rtol=0.0, atol=1e-12)
    kernel = compile_function(equation, {"q": n, "v": m})
    np.testing.assert_allclose(kernel.map(q, v), expected, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose([kernel(a, b) for a, b in zip(q, v, strict=True)], expected, rtol=0.0, atol=1e-12)
