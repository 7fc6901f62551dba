"""Integers modulo a prime, as scalars on which equations run without round-off."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

PRIME = 2**31 - 1
"""Products of two residues fit 64 bits. It is 3 modulo 4, so that no square is -1: 1 + t^2 never vanishes."""

Residues = NDArray[np.int64]


class Modular:
    """An integer modulo the prime 2^31 - 1, or one for each sample, as a scalar for which equations of motion can be
    evaluated without round-off. `residues` is an int or an int64 array (samples,) in 0..2^31 - 2. Nothing is checked at
    construction.

    `+`, `-`, `*` and `/` take a `Modular`, a float or a `Fraction`, which become residues; others raise `TypeError`. A
    product with an exact 0 is the float 0.0, and operations with an exact 0 or 1 cost nothing. Division raises
    `ValueError` by a zero residue, `ZeroDivisionError` by the number 0.
    """

    __slots__ = ("residues",)
    __array_ufunc__ = None

    def __init__(self, residues: Any) -> None:
        self.residues = residues

    def __add__(self, other: Any) -> Any:
        if isinstance(other, Modular):
            return Modular((self.residues + other.residues) % PRIME)
        if not isinstance(other, float | Fraction):
            return NotImplemented
        return self if other == 0 else Modular((self.residues + residue(other)) % PRIME)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, Modular):
            return Modular((self.residues - other.residues) % PRIME)
        if not isinstance(other, float | Fraction):
            return NotImplemented
        return self if other == 0 else Modular((self.residues - residue(other)) % PRIME)

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Modular):
            return Modular(self.residues * other.residues % PRIME)
        if not isinstance(other, float | Fraction):
            return NotImplemented
        if other in (0, 1):
            return self if other == 1 else 0.0
        return -self if other == -1 else Modular(self.residues * residue(other) % PRIME)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, Modular):
            return Modular(self.residues * inverse(other.residues) % PRIME)
        return self * (Fraction(1) / Fraction(other)) if isinstance(other, float | Fraction) else NotImplemented

    def __rtruediv__(self, other: Any) -> Any:
        return Modular(inverse(self.residues)) * other

    def __neg__(self) -> Modular:
        return Modular(-self.residues % PRIME)


@lru_cache(maxsize=4096)
def residue(x: float | Fraction) -> int:
    """The residue, in 0..2^31 - 2, of a rational number `x` modulo the prime 2^31 - 1: its numerator over its
    denominator in that field; every finite float is such a number, exactly. Raises `ValueError` where the prime divides
    its denominator and for NaN, `OverflowError` for infinity."""
    exact = Fraction(x)
    return exact.numerator * pow(exact.denominator, -1, PRIME) % PRIME


def modular(x: Fraction) -> Modular | float:
    """A rational number `x` as a scalar: a `Modular`, its residue modulo the prime 2^31 - 1; a float where it is 0, 1
    or -1, since products with these cost nothing. Raises `ValueError` where the prime divides its denominator."""
    return float(x) if x in (0, 1, -1) else Modular(residue(x))


def inverse(residues: Any) -> Any:
    """The inverses 1/x, in 0..2^31 - 2, of `residues` modulo the prime 2^31 - 1, an int or an int64 array (m,) of m of
    them. Raises `ValueError` for a residue of zero."""
    if isinstance(residues, int):
        return pow(residues, -1, PRIME)
    return np.array([pow(x, -1, PRIME) for x in residues.tolist()], dtype=np.int64)


def random_residues(samples: int, generator: np.random.Generator) -> Modular:
    """Random residues modulo the prime 2^31 - 1, one for each of `samples`, as one `Modular`, drawn with NumPy's
    `generator`, uniform among 1, 2, ... 2^31 - 2, never zero. Nothing is checked."""
    return Modular(generator.integers(1, PRIME, samples))


def stacked_residues(entries: list[Any], samples: int) -> Residues:
    """The int64 array (samples, n) of residues modulo the prime 2^31 - 1 of n scalars `entries`, a column each:
    `Modular` objects, of one number or of `samples`, or floats. Raises `ValueError` for a `Modular` of another number
    of samples."""
    out = np.empty((samples, len(entries)), dtype=np.int64)
    for i, entry in enumerate(entries):
        out[:, i] = entry.residues if isinstance(entry, Modular) else residue(entry)
    return out
