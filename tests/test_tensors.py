"""Tensors turned from link to link: the short way about a coordinate axis is the product of matrices."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from adaptctl.compilation import trace
from adaptctl.compilation.graph import Op
from adaptctl.dynamics.recursion.segment import AxisRotation, about, congruent, turned_back
from adaptctl.scalars import Column, Mat, Vec, cos, product, sin

entries = st.lists(st.floats(-10.0, 10.0), min_size=9, max_size=9)
AXES = [Vec(*(sign * float(i == k) for i in range(3))) for k in range(3) for sign in (1.0, -1.0)]


def array(m: Mat) -> np.ndarray:
    return np.array([[*row] for row in m])


@given(entries, st.floats(-7.0, 7.0), st.sampled_from(AXES))
def test_any_tensor_is_turned_as_by_two_products(numbers: list[float], angle: float, axis: Vec) -> None:
    turn, tensor = about(axis, cos(angle), sin(angle)), Mat.of(np.reshape(numbers, (3, 3)))
    assert isinstance(turn, AxisRotation)
    expected = array(product(product(turn.T, tensor), turn))
    np.testing.assert_allclose(array(turned_back(turn, tensor)), expected, atol=1e-13)


@given(entries, st.floats(-7.0, 7.0), st.sampled_from(AXES))
def test_a_symmetric_tensor_stays_exactly_symmetric(numbers: list[float], angle: float, axis: Vec) -> None:
    half = np.reshape(numbers, (3, 3))
    turn, tensor = about(axis, cos(angle), sin(angle)), Mat.of(half + half.T)
    found = array(turned_back(turn, tensor))  # type: ignore[arg-type]
    np.testing.assert_array_equal(found, found.T)
    np.testing.assert_allclose(found, array(congruent(turn.T, tensor)), atol=1e-13)


@given(st.floats(-7.0, 7.0), st.sampled_from(AXES))
def test_coordinate_axes_turn_as_any_axis_does(angle: float, axis: Vec) -> None:
    a, c, s = np.array([*axis]), np.cos(angle), np.sin(angle)
    across = np.array([[0.0, a[2], -a[1]], [-a[2], 0.0, a[0]], [a[1], -a[0], 0.0]])
    rodrigues = np.outer(a, a) + c * (np.eye(3) - np.outer(a, a)) + s * across
    np.testing.assert_allclose(array(about(axis, c, s)), rodrigues, atol=1e-15)


def test_it_takes_eight_multiplications() -> None:
    def turned(cs: Column, s: Column) -> Column:
        a, b, c, d, e, f = s
        tensor = Mat(Vec(a, b, c), Vec(b, d, e), Vec(c, e, f))
        turn = about(Vec(0.0, 0.0, 1.0), *cs)
        return Column(x for row in turned_back(turn, tensor) for x in row)  # type: ignore[arg-type]

    assert trace(turned, {"cs": 2, "s": 6}).operations[Op.MULTIPLY] == 8
