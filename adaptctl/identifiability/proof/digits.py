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
    """Fixed-point numbers of many samples (an array of ints) or of all (an int): values times 2^200."""

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
    """A rational number as a scalar: a float where it is 0, 1 or -1, for products with these cost nothing."""
    return float(x) if x in (0, 1, -1) else Digits(scaled(x))


def samples_of(values: Any) -> Digits:
    """Exact fixed-point numbers of floats (samples,)."""
    return Digits(np.array([scaled(float(x)) for x in values], dtype=object))


def scaled(x: Fraction | float) -> int:
    """A rational number times 2^200."""
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
    """Cosine of an angle (rad)."""
    return _exponential(x)[0]


def sine(x: Digits) -> Digits:
    """Sine of an angle (rad)."""
    return _exponential(x)[1]


_RULES: dict[np.ufunc, Callable[..., Any]] = {np.cos: cosine, np.sin: sine}


def floats(scaled: Any) -> Any:
    """Scaled ints (an array of objects) as floats."""
    return (scaled / ONE).astype(np.float64)


def stacked_digits(entries: list[Any], samples: int) -> Any:
    """Scalars, floats among them, as columns (samples, n) of scaled ints."""
    out = np.empty((samples, len(entries)), dtype=object)
    for i, entry in enumerate(entries):
        out[:, i] = entry.scaled if isinstance(entry, Digits) else scaled(entry)
    return out
