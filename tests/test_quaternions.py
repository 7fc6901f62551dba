"""Quaternions of rotations."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from adaptctl.description.pose import quaternion_rotation, rotation_quaternions
from adaptctl.recording.scene import _turned_up


def test_quaternions_are_those_of_scipy_also_of_half_turns() -> None:
    random = Rotation.random(200, rng=0).as_matrix()
    half = Rotation.from_rotvec(np.pi * np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.8, 0], [0, -0.6, 0.8]]))
    rotations = np.concatenate([random, half.as_matrix(), np.eye(3)[None]])
    found = rotation_quaternions(rotations.reshape(2, -1, 3, 3)).reshape(-1, 4)
    given = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
    np.testing.assert_allclose(np.abs((found * given).sum(axis=1)), 1.0, rtol=1e-14)
    np.testing.assert_allclose([quaternion_rotation(one) for one in found], rotations, atol=1e-14)


def test_solids_are_turned_from_the_z_axis() -> None:
    axes = [*np.random.default_rng(0).standard_normal((50, 3)), [0.0, 0.0, 2.0], [0.0, 0.0, -3.0], [1e-9, 0.0, -1.0]]
    for axis in np.array(axes):
        turned = Rotation.from_quat(_turned_up(axis)).apply([0.0, 0.0, 1.0])
        np.testing.assert_allclose(turned, axis / np.linalg.norm(axis), atol=1e-7)
