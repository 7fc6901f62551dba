"""Numbers of sixty digits after the point, as scalars on which equations run."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

BITS = 200
"""after the point: 60 digits"""
ONE = 1 << BITS
_SHORT, _HALVINGS = 26, 8


class Digits:
    """Fixed-point number with 200 binary, that is 60 decimal, digits after the point, or an array of them, one for each
    sample: a scalar for which equations of motion can be evaluated. `scaled`, an int or an array (samples,) of Python
    ints (dtype object), is the value times 2^200. Nothing is checked at construction.

    `+`, `-`, `*` and `/` take a `Digits` or a float and return a `Digits`, products and quotients rounded down; other
    operands raise `TypeError`, division by zero `ZeroDivisionError`. A product with the float 0.0 is that float.
    `np.cos` and `np.sin` return a `Digits`; other NumPy functions raise `TypeError`.
    """

    __slots__ = ("scaled",)

    def __init__(self, scaled: Any) -> None:
        self.scaled = scaled

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        rule = _RULES.get(ufunc)
        if rule is None or method != "__call__" or options:
            return NotImplemented
        return rule(*inputs)

    def __add__(self, other: Any) -> Any:
        if isinstance(other, Digits):
            return Digits(self.scaled + other.scaled)
        return Digits(self.scaled + scaled(other)) if isinstance(other, float) else NotImplemented

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self + -other if isinstance(other, Digits | float) else NotImplemented

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Digits):
            return Digits(self.scaled * other.scaled >> BITS)
        if not isinstance(other, float):
            return NotImplemented
        if other in (0.0, 1.0):
            return self if other == 1.0 else 0.0
        return Digits(self.scaled * scaled(other) >> BITS)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, Digits):
            return Digits((self.scaled << BITS) // other.scaled)
        return Digits((self.scaled << BITS) // scaled(other)) if isinstance(other, float) else NotImplemented

    def __rtruediv__(self, other: Any) -> Any:
        return Digits((scaled(other) << BITS) // self.scaled)

    def __neg__(self) -> Digits:
        return Digits(-self.scaled)


def digits(x: Fraction | float) -> Digits | float:
    """A rational number `x` as a scalar: a `Digits`, a fixed-point number of 60 decimal digits, rounded down; a float
    where it is 0, 1 or -1, since products with these cost nothing. Raises `ValueError` for NaN, `OverflowError` for
    infinity."""
    return float(x) if x in (0, 1, -1) else Digits(scaled(x))


def samples_of(values: Any) -> Digits:
    """Fixed-point numbers of 60 decimal digits for floats `values` (samples,), to within 2^-200, as one `Digits`.
    Raises `ValueError` for NaN, `OverflowError` for infinity."""
    return Digits(np.array([scaled(float(x)) for x in values], dtype=object))


def scaled(x: Fraction | float) -> int:
    """The whole number that represents a number `x` in fixed point: x times 2^200, rounded down. Raises `ValueError`
    for NaN, `OverflowError` for infinity."""
    n, d = x.as_integer_ratio()
    return (n << BITS) // d


def _exponential(x: Digits) -> tuple[Digits, Digits]:
    """Cosine and sine of an angle of a few radians: Taylor's series of its 256th part, doubled eight times."""
    small = x.scaled >> _HALVINGS
    term, parts = ONE + 0 * small, [0 * small, 0 * small]
    parts[0] = parts[0] + term
    for k in range(1, _SHORT):
        term = (term * small >> BITS) // k
        parts[k % 2] = parts[k % 2] + (term if k % 4 < 2 else -term)
    c, s = Digits(parts[0]), Digits(parts[1])
    for _ in range(_HALVINGS):
        c, s = c * c - s * s, 2.0 * (c * s)
    return c, s


def cosine(x: Digits) -> Digits:
    """The cosine of an angle `x`, a `Digits` (fixed-point numbers of 60 decimal digits, one or one for each sample), in
    rad, as a `Digits` of the same shape. It is right to about 55 decimal digits for |x| of at most 10 rad; beyond,
    digits are lost. Nothing is checked, and nothing is raised."""
    return _exponential(x)[0]


def sine(x: Digits) -> Digits:
    """The sine of an angle `x`, a `Digits` (fixed-point numbers of 60 decimal digits, one or one for each sample), in
    rad, as a `Digits` of the same shape. It is right to about 55 decimal digits for |x| of at most 10 rad; beyond,
    digits are lost. Nothing is checked, and nothing is raised."""
    return _exponential(x)[1]


_RULES: dict[np.ufunc, Callable[..., Any]] = {np.cos: cosine, np.sin: sine}


def floats(scaled: Any) -> Any:
    """The float64 array, of the same shape, of fixed-point numbers, an array `scaled` of Python ints (dtype object)
    that are values times 2^200. Raises `OverflowError` for values beyond a double."""
    return (scaled / ONE).astype(np.float64)


def stacked_digits(entries: list[Any], samples: int) -> Any:
    """The array (samples, n) of Python ints (dtype object), values times 2^200, of n scalars `entries`, a column each:
    `Digits`, of one number or of `samples`, or floats. Raises `ValueError` for a `Digits` of another number of
    samples."""
    out = np.empty((samples, len(entries)), dtype=object)
    for i, entry in enumerate(entries):
        out[:, i] = entry.scaled if isinstance(entry, Digits) else scaled(entry)
    return out
