"""Frames on joints' axes: the same in any unit of length, also where offsets are next to nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from random_trees import random_chain

from adaptctl.identifiability.inertial_transfers import twist_entries, twist_matrices
from adaptctl.identifiability.proof.joint_frames import AS_GIVEN, FloatFrame, _axis_frame, _upright
from adaptctl.scalars import Mat, Vec

UPRIGHT = Mat(Vec(1.0, 0.0, 0.0), Vec(0.0, 1.0, 0.0), Vec(0.0, 0.0, 1.0))


@pytest.mark.parametrize("tilt", [0.0, 1e-9, 0.3])
@pytest.mark.parametrize("offset", [3e-12, 0.1])
def test_a_frame_on_an_axis_scales_with_the_unit_of_length(tilt: float, offset: float) -> None:
    """An offset of less than 1e-11 of the mechanism slides no foot, however little the axis is tilted."""
    axis = Vec(math.sin(tilt), 0.0, math.cos(tilt))

    def frame(unit: float) -> FloatFrame:
        standing = FloatFrame(UPRIGHT, Vec(0.5 * unit * offset, unit * offset, 0.3 * unit))
        return _axis_frame(standing, axis, True, unit, AS_GIVEN)

    one = frame(1.0)
    for unit in (2.0**-12, 2.0**12):
        other = frame(unit)
        np.testing.assert_allclose([*other.origin], [unit * x for x in one.origin], rtol=1e-12, atol=1e-15 * unit)
        np.testing.assert_allclose([[*row] for row in other.rotation], [[*row] for row in one.rotation], atol=1e-15)
    np.testing.assert_allclose([*(one.rotation @ Vec(0.0, 0.0, 1.0))], [*axis], atol=1e-15)


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_twists_are_matrices_and_back_in_stacks_of_any_shape(shape: tuple[int, ...]) -> None:
    twists = np.random.default_rng(0).normal(size=(*shape, 6))
    matrices = twist_matrices(twists)
    assert matrices.shape == (*shape, 4, 4)
    np.testing.assert_array_equal(twist_entries(matrices), twists)
    point = np.array([0.3, -0.2, 0.5])
    turned = np.cross(twists[..., :3], point) + twists[..., 3:]
    np.testing.assert_allclose((matrices @ np.append(point, 1.0))[..., :3], turned, atol=1e-15)


@pytest.mark.parametrize(
    "gravity", [(0.0, 0.0, -9.81), (0.0, 9.81, 0.0), (-1.6, 0.0, 0.0), (1.0, -2.0, 3.0), (0.0,) * 3]
)
def test_the_world_is_turned_about_its_origin_until_z_is_up(gravity: tuple[float, ...]) -> None:
    frame = _upright(replace(random_chain(0, 1).description, gravity=np.array(gravity)))
    rotation = np.array([[*row] for row in frame.rotation])
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-15)
    strength = float(np.linalg.norm(gravity))
    np.testing.assert_allclose(
        rotation[:, 2], -np.array(gravity) / strength if strength else [0.0, 0.0, 1.0], atol=1e-15
    )
    assert [*frame.origin] == [0.0, 0.0, 0.0]
