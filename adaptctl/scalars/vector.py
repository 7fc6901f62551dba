"""Geometry: three-vectors and three-by-three matrices over scalars of any kind."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, overload

from numpy.typing import ArrayLike

from adaptctl.arrays import checked
from adaptctl.errors import InputError
from adaptctl.scalars.scalar import Scalar


class Vec:
    """A vector (3,) of scalars `x`, `y` and `z` of one kind (floats, arrays of samples, dual numbers or nodes of an
    expression graph), in the coordinates of one frame. `+` and `-` are elementwise, and a scalar may be a factor on the
    left. Nothing is checked at construction."""

    __slots__ = ("x", "y", "z")
    __array_ufunc__ = None  # lets `array * Vec` reach __rmul__

    def __init__(self, x: Scalar, y: Scalar, z: Scalar) -> None:
        self.x, self.y, self.z = x, y, z

    def __add__(self, other: Vec) -> Vec:
        return Vec(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Vec) -> Vec:
        return Vec(self.x - other.x, self.y - other.y, self.z - other.z)

    def __neg__(self) -> Vec:
        return Vec(-self.x, -self.y, -self.z)

    def __rmul__(self, factor: Scalar) -> Vec:
        return Vec(factor * self.x, factor * self.y, factor * self.z)

    def __iter__(self) -> Iterator[Any]:
        return iter((self.x, self.y, self.z))


def dot(a: Vec, b: Vec) -> Any:
    """The inner (dot) product of two vectors a and b (3,) whose entries are scalars of one kind: a scalar of that kind,
    in the product of their units. Nothing is checked."""
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Vec, b: Vec) -> Vec:
    """The vector (cross) product a x b (3,) of two vectors (3,) whose entries are scalars of one kind, in the product
    of their units. Nothing is checked."""
    return Vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


class Mat:
    """A 3 by 3 matrix of scalars of one kind (floats, arrays of samples, dual numbers or nodes of an expression graph),
    given by its rows `x`, `y` and `z`, each a `Vec` (3,). `+` and `-` are elementwise, and `@` multiplies it with a
    `Vec`, which gives a `Vec`, or with a `Mat`, which gives a `Mat`. Nothing is checked at construction."""

    __slots__ = ("x", "y", "z")

    def __init__(self, x: Vec, y: Vec, z: Vec) -> None:
        self.x, self.y, self.z = x, y, z

    @classmethod
    def of(cls, rows: ArrayLike) -> Mat:
        """A matrix (3, 3) of floats from three rows of three numbers, nested sequences or an array (3, 3). Raises
        `InputError` for another shape and for entries that are no numbers, `NonFiniteError` for NaN and infinity."""
        entries = checked(rows, 3, "matrix")
        if entries.shape != (3, 3):
            raise InputError(f"matrix: expected shape (3, 3), got {entries.shape}")
        return cls(*(Vec(*row) for row in entries.tolist()))

    def __add__(self, other: Mat) -> Mat:
        return Mat(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Mat) -> Mat:
        return Mat(self.x - other.x, self.y - other.y, self.z - other.z)

    def __iter__(self) -> Iterator[Vec]:
        return iter((self.x, self.y, self.z))

    @overload
    def __matmul__(self, other: Vec) -> Vec: ...
    @overload
    def __matmul__(self, other: Mat) -> Mat: ...
    def __matmul__(self, other: Vec | Mat) -> Vec | Mat:
        if isinstance(other, Mat):
            return product(self, other)
        return Vec(dot(self.x, other), dot(self.y, other), dot(self.z, other))

    @property
    def T(self) -> Mat:
        """The transpose (3, 3) of this matrix, rows and columns exchanged."""
        a, b, c = self.x, self.y, self.z
        return Mat(Vec(a.x, b.x, c.x), Vec(a.y, b.y, c.y), Vec(a.z, b.z, c.z))


def product(a: Mat, b: Mat) -> Mat:
    """The matrix product a b (3, 3) of two matrices (3, 3), `a` on the left, whose entries are scalars of one kind, in
    the product of their units. Nothing is checked."""
    columns = b.T
    return Mat(*(columns @ row for row in a))


ZERO = Vec(0.0, 0.0, 0.0)
