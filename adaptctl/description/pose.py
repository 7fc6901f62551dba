"""Poses of frames in others, and named frames."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.caching import sent_as_made
from adaptctl.errors import InputError

MAX_LENGTH = 1e9
"""m between two frames of a mechanism: energies of longer ones would overflow"""


def rotation_about(axis: ArrayLike, angle: float) -> Array:
    """Rotation matrix (3, 3) about a unit vector by an angle in rad."""
    x, y, z = np.asarray(axis, dtype=np.float64)
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation = np.eye(3) + np.sin(angle) * hat + (1.0 - np.cos(angle)) * (hat @ hat)
    return exact_right_angles(rotation)


def exact_right_angles(rotation: Array, tolerance: float = 1e-15) -> Array:
    """Copy of a rotation matrix with entries near -1, 0 and 1 made exact."""
    rounded = np.round(rotation)
    return np.where(np.abs(rotation - rounded) <= tolerance, rounded + 0.0, rotation)


def roll_pitch_yaw(angles: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of URDF's roll, pitch and yaw (3,), rad."""
    roll, pitch, yaw = np.asarray(angles, dtype=np.float64)
    product = rotation_about((0, 0, 1), yaw) @ rotation_about((0, 1, 0), pitch) @ rotation_about((1, 0, 0), roll)
    return exact_right_angles(product)


def quaternion_rotation(quaternion: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of a quaternion w, x, y, z of any length from 1e-12."""
    given = np.asarray(quaternion, dtype=np.float64)
    length = float(np.linalg.norm(given))
    if length < 1e-12:
        raise InputError("quat must not be zero")
    w, x, y, z = given if abs(length - 1.0) <= 1e-15 else given / length
    rotation = np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
    return exact_right_angles(rotation)


def rotation_quaternions(rotations: Array) -> Array:
    """Quaternions w, x, y, z (..., 4) of rotations (..., 3, 3), the largest part first (Shepperd 1978)."""
    r, transposed = rotations, np.swapaxes(rotations, -1, -2)
    trace, diagonal = np.trace(r, axis1=-2, axis2=-1)[..., None], np.diagonal(r, axis1=-2, axis2=-1)
    squares = np.concatenate((1.0 + trace, 1.0 - trace + 2.0 * diagonal), axis=-1)
    first = np.stack([r[..., i, j] - r[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1)
    products = np.empty((*r.shape[:-2], 4, 4))
    products[..., 0, 1:], products[..., 1:, 0], products[..., 1:, 1:] = first, first, r + transposed
    parts = np.arange(4)
    products[..., parts, parts] = squares
    largest = squares.argmax(axis=-1)[..., None]
    rows = np.take_along_axis(products, largest[..., None], axis=-2)[..., 0, :]
    return np.asarray(0.5 * (rows / np.sqrt(np.take_along_axis(squares, largest, axis=-1))))


@sent_as_made
@dataclass(frozen=True, eq=False)
class Pose:
    """
    Pose of a child frame in its parent; ``a @ b`` chains two of them.

    Parameters
    ----------
    rotation : array_like
        Rotation matrix (3, 3) without unit that maps coordinates in the child's frame to the parent's.
    translation : array_like
        Origin (3,) of the child in the parent in m.

    Raises
    ------
    InputError
        If a shape is wrong, a value is not finite, the matrix is no rotation within 1e-9, or a length is above 1e9 m.

    Examples
    --------
    >>> from adaptctl.description import Pose
    >>> shift = Pose(np.eye(3), [0.1, 0.0, 0.0])
    >>> (shift @ shift).translation.tolist()
    [0.2, 0.0, 0.0]
    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        rotation = frozen_array(self.rotation, (3, 3), "rotation")
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-9 or np.linalg.det(rotation) < 0.0:
            raise InputError(f"rotation: expected a proper orthogonal matrix, got {rotation.tolist()}")
        translation = frozen_array(self.translation, (3,), "translation")
        if np.abs(translation).max() > MAX_LENGTH:
            raise InputError(f"translation: expected lengths of at most {MAX_LENGTH:g} m, got {translation.tolist()}")
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", translation)

    @classmethod
    def identity(cls) -> Pose:
        """
        Return the identity, the pose of a frame in itself.

        Returns
        -------
        Pose
            Pose with the identity as rotation and zero translation.

        Examples
        --------
        >>> from adaptctl.description import Pose
        >>> Pose.identity().translation.tolist()
        [0.0, 0.0, 0.0]
        """
        return cls(np.eye(3), np.zeros(3))

    def __matmul__(self, inner: Pose) -> Pose:
        """Pose of `inner`'s child in this pose's parent."""
        rotation = exact_right_angles(self.rotation @ inner.rotation)
        return Pose(rotation, self.rotation @ inner.translation + self.translation)

    @property
    def inverse(self) -> Pose:
        """Inverse pose: that of the parent frame in the child frame."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation + 0.0)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Pose):
            return NotImplemented
        same_turn = np.array_equal(self.rotation, other.rotation)
        return same_turn and np.array_equal(self.translation, other.translation)

    def __hash__(self) -> int:
        return hash((self.rotation.tobytes(), self.translation.tobytes()))


class FrameKind(Enum):
    """Kind of a named frame, as Pinocchio's frame types are."""

    OPERATIONAL = "operational"
    FIXED_JOINT = "fixed joint"
    BODY = "body"
    SENSOR = "sensor"


@dataclass(frozen=True)
class NamedFrame:
    """Named frame, such as a tool's, fixed to a link (-1 for the ground)."""

    name: str
    link: int
    pose: Pose
    kind: FrameKind = FrameKind.OPERATIONAL
