"""Tensors of a link, such as its inertia, turned into its parent's axes."""

from __future__ import annotations

from adaptctl.dynamics.recursion.segment import AxisRotation, Placement
from adaptctl.scalars import Mat, Vec, dot, product


def symmetric_up(place: Placement, tensor: Mat) -> Mat:
    """A symmetric tensor (3, 3), such as a link's inertia, in the parent link's axes, from the `tensor` in the link's
    axes, in the same unit. `place` is the link's placement in its parent. Nothing is checked."""
    for turn in reversed(place.turns):
        tensor = turned_back(turn, tensor) if isinstance(turn, AxisRotation) else congruent(turn.T, tensor)
    return tensor


def tensor_up(place: Placement, tensor: Mat) -> Mat:
    """A tensor (3, 3), symmetric or not, in the parent link's axes, from the `tensor` in the link's axes, in the same
    unit. `place` is the link's placement in its parent. Nothing is checked."""
    for turn in reversed(place.turns):
        tensor = turned_back(turn, tensor) if isinstance(turn, AxisRotation) else product(product(turn.T, tensor), turn)
    return tensor


def turned_back(turn: AxisRotation, tensor: Mat) -> Mat:
    """The product R' T R (3, 3) of a rotation R about a coordinate axis, `turn`, its transpose R' and a `tensor` T (3,
    3) in any unit: if T is in the axes after the turn, the product is in those before it.

    Let c and s be the cosine and sine of the turn, [[a, b], [e, d]] the entries of T of the two other axes, in cyclic
    order (z, x for y), and t = s (a - d) + c (b + e). Then those entries of the product are [[a - s t, c t - e], [c t -
    b, d + s t]]: four multiplications, where two products of matrices take twelve. Nothing is checked.
    """
    k, c, s = turn.axis, turn.cosine, turn.sine
    i, j = (k + 1) % 3, (k + 2) % 3
    old = [list(row) for row in tensor]
    new = [list(row) for row in tensor]
    t = s * (old[i][i] - old[j][j]) + c * (old[i][j] + old[j][i])
    new[i][i], new[j][j] = old[i][i] - s * t, old[j][j] + s * t
    new[i][j], new[j][i] = c * t - old[j][i], c * t - old[i][j]
    new[k][i], new[k][j] = c * old[k][i] - s * old[k][j], s * old[k][i] + c * old[k][j]
    new[i][k], new[j][k] = c * old[i][k] - s * old[j][k], s * old[i][k] + c * old[j][k]
    return Mat(*(Vec(*row) for row in new))


def congruent(rotation: Mat, s: Mat) -> Mat:
    """The product R S R' (3, 3) of a `rotation` R (3, 3), a symmetric tensor S (3, 3), `s`, in any unit, and the
    transpose R': symmetric, each entry computed once. Nothing is checked."""
    half_x, half_y, half_z = s @ rotation.x, s @ rotation.y, s @ rotation.z
    xy, xz, yz = dot(rotation.x, half_y), dot(rotation.x, half_z), dot(rotation.y, half_z)
    return Mat(
        Vec(dot(rotation.x, half_x), xy, xz),
        Vec(xy, dot(rotation.y, half_y), yz),
        Vec(xz, yz, dot(rotation.z, half_z)),
    )
