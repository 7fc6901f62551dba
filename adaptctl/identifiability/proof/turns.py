"""Rotations as turns about coordinate axes, so chosen that entries that are zero come back as exact zeros."""

from __future__ import annotations

import math
from typing import Any

from adaptctl.identifiability.proof.simplest import Precision
from adaptctl.scalars import Mat, Vec

Turns = tuple[tuple[int, float], ...]
"""Axes (0, 1, 2 for x, y, z) and angles (rad): the product of the turns about them, in this order."""
QUARTER = math.pi / 2


def turns_of(rotation: Mat, precision: Precision) -> Turns:
    """The two or three turns about coordinate axes, pairs of an axis (0, 1, 2 for x, y, z) and an angle in rad, whose
    product, in this order, is a `rotation` matrix R (3, 3) of floats. Entries of R, and differences of angles from
    right ones, that are below the `precision`'s angle in rad count as zero. Nothing is checked.

    The turns are chosen so that zeros of R come back as exact ones, with R_i(a) the turn by a about axis i. For a zero
    off the diagonal, in row i and column j, R = R_i(a) R_j(g). For one on the diagonal, in row i, R = R_i(a) R_j(90
    degrees) R_i(g), j being the axis after i. Without zeros, R = R_z(a) R_x(b) R_z(g). A rotation with more than one
    zero has at least four, all of which the two turns keep.
    """
    R = [list(row) for row in rotation]
    size, row, column = min((abs(R[i][j]), i, j) for i in range(3) for j in range(3))
    if size > precision.angle:
        tilt = math.atan2(math.hypot(R[0][2], R[1][2]), R[2][2])
        return (2, math.atan2(R[0][2], -R[1][2])), (0, tilt), (2, math.atan2(R[2][0], R[2][1]))
    j, k = (row + 1) % 3, (row + 2) % 3
    if row == column:
        a, g = math.atan2(R[j][row], -R[k][row]), math.atan2(R[row][j], R[row][k])
        return (row, bearing(a, precision)), (j, QUARTER), (row, bearing(g, precision))
    third = 3 - row - column
    sign = 1.0 if column == j else -1.0
    a, g = math.atan2(sign * R[third][column], R[column][column]), math.atan2(sign * R[row][third], R[row][row])
    return (row, bearing(a, precision)), (column, bearing(g, precision))


def bearing(angle: float, precision: Precision) -> float:
    """The `angle`, in rad, made the nearest multiple of a right angle where it is within the `precision`'s `angle` of
    that, else as given. Raises `ValueError` for NaN, `OverflowError` for infinity."""
    quarters = round(angle / QUARTER)
    return quarters * QUARTER if abs(angle - quarters * QUARTER) <= precision.angle else angle


def turned(axis: int, c: Any, s: Any) -> Mat:
    """The rotation matrix R (3, 3) of a turn about a coordinate `axis` (0, 1, 2 for x, y, z), from the cosine `c` and
    the sine `s` of its angle, scalars of any kind. It maps the coordinates y (3,) of a vector in the turned frame to
    those in the frame before the turn, R y. Nothing is checked."""
    if axis == 0:
        return Mat(Vec(1.0, 0.0, 0.0), Vec(0.0, c, -s), Vec(0.0, s, c))
    if axis == 1:
        return Mat(Vec(c, 0.0, s), Vec(0.0, 1.0, 0.0), Vec(-s, 0.0, c))
    return Mat(Vec(c, -s, 0.0), Vec(s, c, 0.0), Vec(0.0, 0.0, 1.0))
