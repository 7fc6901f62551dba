"""Poses in MJCF: positions, and attitudes in MuJoCo's five ways of writing them."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.pose import Pose, exact_right_angles, rotation_about
from adaptctl.description.readers.mjcf.settings import ORIENTATIONS, Settings
from adaptctl.description.readers.xml_elements import numbers
from adaptctl.errors import InputError

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def placed(element: Element, settings: Settings, where: str) -> Pose:
    """The pose (m) that an MJCF element's attributes give, in the frame of the body or <frame> that contains the
    element: pos and one of quat, axisangle, xyaxes, zaxis and euler; the identity where it has none. `settings` say how
    angles are written. Raises `InputError` for more than one attitude, attributes that are not finite numbers, zero
    axes and quaternions, and lengths above 1e9 m; `where` begins the message."""
    position = numbers(element, "pos", 3, where) if "pos" in element.attrib else [0.0] * 3
    return Pose(attitude(element, settings, where), np.array(position))


def attitude(element: Element, settings: Settings, where: str) -> Array:
    """The rotation matrix (3, 3) that an MJCF element's attribute quat, axisangle, xyaxes, zaxis or euler gives, the
    identity where it has none. It turns the element's coordinates into those of the body or <frame> that contains it.
    `settings` say how angles are written. Raises `InputError` for more than one of these attributes, values that are
    not finite numbers, and zero axes and quaternions; `where` begins the message."""
    given = [name for name in ORIENTATIONS if name in element.attrib]
    if len(given) > 1:
        raise InputError(f"{where}: <{element.tag}> has {' and '.join(given)}: keep one")
    if not given:
        return np.eye(3)
    values = np.array(numbers(element, given[0], _COUNTS[given[0]], where))
    if given[0] == "quat":
        return from_quaternion(values, where)
    if given[0] == "axisangle":
        return rotation_about(_unit(values[:3], "axisangle", where), settings.angle(values[3]))
    if given[0] == "euler":
        return _euler([settings.angle(x) for x in values], settings.eulerseq)
    if given[0] == "zaxis":
        return facing(_unit(values, "zaxis", where))
    x = _unit(values[:3], "xyaxes", where)
    y = _unit(values[3:] - (values[3:] @ x) * x, "xyaxes", where)
    return exact_right_angles(np.array([x, y, np.cross(x, y)]).T)


_COUNTS = {"quat": 4, "axisangle": 4, "xyaxes": 6, "zaxis": 3, "euler": 3}


def from_quaternion(values: Array, where: str) -> Array:
    """The rotation matrix (3, 3) of a quaternion `values` (4,), w, x, y, z, of any length from 1e-12; entries within
    1e-15 of 0 and of +-1 are made exact. Raises `InputError` for a shorter one; `where` begins the message."""
    w, x, y, z = _unit(values, "quat", where)
    rotation = np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
    return exact_right_angles(rotation)


def facing(direction: Array) -> Array:
    """The rotation matrix (3, 3) by the least angle that takes the z axis to the unit vector `direction` (3,); half a
    turn about x where it is within 1e-12 of -z. The length of `direction` is not checked."""
    axis = np.cross((0.0, 0.0, 1.0), direction)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.eye(3) if direction[2] > 0.0 else np.diag([1.0, -1.0, -1.0])
    return rotation_about(axis / sine, float(np.arctan2(sine, direction[2])))


def _euler(angles: list[float], sequence: str) -> Array:
    """Small letters turn with the frame, capital ones about the parent's axes."""
    rotation = np.eye(3)
    for angle, letter in zip(angles, sequence, strict=True):
        turn = rotation_about(_AXES[letter.lower()], angle)
        rotation = rotation @ turn if letter.islower() else turn @ rotation
    return exact_right_angles(rotation)


def _unit(vector: Array, name: str, where: str) -> Array:
    length = float(np.linalg.norm(vector))
    if length < 1e-12:
        raise InputError(f"{where}: {name} must not be zero")
    return vector if abs(length - 1.0) <= 1e-15 else vector / length
