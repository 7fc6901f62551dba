"""Vectors and matrices of three coordinates."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, overload

from numpy.typing import ArrayLike

from adaptctl.arrays import checked
from adaptctl.errors import InputError
from adaptctl.scalars.scalar import Scalar


class Vec:
    """
    Vector (3,) of scalars, such as a position or force in one frame.

    Parameters
    ----------
    x, y, z : float, array, Dual or symbolic scalar
        Coordinates along the frame's axes, in one unit. ``+`` and ``-`` are elementwise, and a scalar may be a factor
        on the left.

    Examples
    --------
    >>> from adaptctl.scalars import Vec
    >>> (2.0 * Vec(1.0, 2.0, 3.0)).z
    6.0
    """

    __slots__ = ("x", "y", "z")
    __array_ufunc__ = None  # lets `array * Vec` reach __rmul__

    def __init__(self, x: Scalar, y: Scalar, z: Scalar) -> None:
        self.x, self.y, self.z = x, y, z

    def __add__(self, other: Vec) -> Vec:
        if other is ZERO:
            return self
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
    """
    Compute the inner product of two vectors.

    Parameters
    ----------
    a, b : Vec
        Vectors (3,) of scalars of one kind.

    Returns
    -------
    float, array, Dual or symbolic scalar
        Inner product, in the product of their units.

    Examples
    --------
    >>> from adaptctl.scalars import Vec, dot
    >>> dot(Vec(1.0, 2.0, 3.0), Vec(0.0, 1.0, 1.0))
    5.0
    """
    if b is ZERO:
        return 0.0
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Vec, b: Vec) -> Vec:
    """
    Compute the vector product of two vectors.

    Parameters
    ----------
    a, b : Vec
        Vectors (3,) of scalars of one kind.

    Returns
    -------
    Vec
        Product a x b (3,), in the product of their units.

    Examples
    --------
    >>> from adaptctl.scalars import Vec, cross
    >>> cross(Vec(1.0, 0.0, 0.0), Vec(0.0, 1.0, 0.0)).z
    1.0
    """
    if b is ZERO:
        return ZERO
    return Vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


class Mat:
    """
    Matrix (3, 3) of scalars, such as a rotation or inertia tensor, given by its rows.

    Parameters
    ----------
    x, y, z : Vec
        Rows. ``+`` and ``-`` are elementwise; ``@`` multiplies with a `Vec` or a `Mat`.

    Examples
    --------
    >>> from adaptctl.scalars import Mat, Vec
    >>> (Mat.of(2.0 * np.eye(3)) @ Vec(1.0, 2.0, 3.0)).z
    6.0
    """

    __slots__ = ("x", "y", "z")

    def __init__(self, x: Vec, y: Vec, z: Vec) -> None:
        self.x, self.y, self.z = x, y, z

    @classmethod
    def of(cls, rows: ArrayLike) -> Mat:
        """
        Make a matrix of floats from numbers.

        Parameters
        ----------
        rows : array_like
            Three rows of three numbers, (3, 3), in any unit.

        Returns
        -------
        Mat
            Matrix (3, 3).

        Raises
        ------
        InputError
            If the shape is wrong or an entry is not a number.
        NonFiniteError
            If an entry is NaN or infinite.

        Examples
        --------
        >>> from adaptctl.scalars import Mat
        >>> Mat.of([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).T.x.y
        1.0
        """
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
        """Transpose (3, 3)."""
        a, b, c = self.x, self.y, self.z
        return Mat(Vec(a.x, b.x, c.x), Vec(a.y, b.y, c.y), Vec(a.z, b.z, c.z))


def product(a: Mat, b: Mat) -> Mat:
    """
    Compute the product of two matrices.

    Parameters
    ----------
    a, b : Mat
        Matrices (3, 3) of scalars of one kind, `a` on the left.

    Returns
    -------
    Mat
        Product (3, 3), in the product of their units.

    Examples
    --------
    >>> from adaptctl.scalars import Mat, product
    >>> half = Mat.of(0.5 * np.eye(3))
    >>> product(half, half).x.x
    0.25
    """
    columns = b.T
    return Mat(*(columns @ row for row in a))


ZERO = Vec(0.0, 0.0, 0.0)
