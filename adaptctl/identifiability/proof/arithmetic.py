"""Exact arithmetic: integers modulo a prime and 60-digit numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Products of two residues fit 64 bits. It is 3 modulo 4, so that no square is -1: 1 + t^2 never vanishes.
PRIME = 2**31 - 1

Residues = NDArray[np.int64]


# After the point: 60 digits
BITS = 200
ONE = 1 << BITS
_SHORT, _HALVINGS = 26, 8
# Sizes of what is left of numbers of sixty digits, relative to what was there, that count as zero. Relations that hold
# exactly leave 1e-50; those that a file's floats hold to round-off leave 1e-12; those that nearly hold, by a miss e,
# leave e or its square.
ZERO_TOLERANCE, EXACT_ZERO_TOLERANCE = 1e-10, 1e-40
# Floor under the sizes of columns, relative to the largest.
MIN_COLUMN_RATIO = 1e-3


class Modular:
    """Integer modulo the prime 2^31 - 1, or one per sample."""

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
    """Residue of a rational number modulo the prime."""
    exact = Fraction(x)
    return exact.numerator * pow(exact.denominator, -1, PRIME) % PRIME


def modular(x: Fraction) -> Modular | float:
    """Rational number as a scalar."""
    return float(x) if x in (0, 1, -1) else Modular(residue(x))


def inverse(residues: Any) -> Any:
    """Inverses of residues; `ValueError` for zero."""
    if isinstance(residues, int):
        return pow(residues, -1, PRIME)
    values = residues.ravel().tolist()
    before = list(accumulate(values, lambda a, b: a * b % PRIME, initial=1))
    over = pow(before.pop(), -1, PRIME)  # of all together (Montgomery 1987)
    after = accumulate(reversed(values), lambda a, b: a * b % PRIME, initial=over)
    found = [a * b % PRIME for a, b in zip(reversed(before), after, strict=False)]
    return np.array(found[::-1], dtype=np.int64).reshape(residues.shape)


def centred(numbers: Residues) -> Residues:
    """Residues from -2^30 to 2^30: of their products, seven add up within 64 bits."""
    return (numbers + PRIME // 2) % PRIME - PRIME // 2


def random_residues(samples: int | tuple[int, ...], generator: np.random.Generator) -> Modular:
    """Random nonzero residues, one for each sample."""
    return Modular(generator.integers(1, PRIME, samples))


def random_turns(samples: int | tuple[int, ...], generator: np.random.Generator) -> tuple[Modular, Modular]:
    """Random cosines and sines, on the unit circle."""
    t = random_residues(samples, generator)
    square = t * t
    over = 1.0 / (1.0 + square)
    return (1.0 - square) * over, 2.0 * t * over


def stacked_residues(entries: list[Any], samples: int) -> Residues:
    """Residues (samples, n) of n scalars, a column each."""
    out = np.empty((samples, len(entries)), dtype=np.int64)
    for i, entry in enumerate(entries):
        out[:, i] = entry.residues if isinstance(entry, Modular) else residue(entry)
    return out


class Digits:
    """Fixed-point number of 60 decimal digits, or one per sample."""

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
    """Rational number as a scalar."""
    return float(x) if x in (0, 1, -1) else Digits(scaled(x))


def samples_of(values: Any) -> Digits:
    """Fixed-point numbers of floats (samples,)."""
    return Digits(np.array([scaled(float(x)) for x in values], dtype=object))


def scaled(x: Fraction | float) -> int:
    """Number in fixed point: times 2^200, rounded down."""
    n, d = x.as_integer_ratio()
    return (n << BITS) // d


def _exponential(x: Digits) -> tuple[Digits, Digits]:
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
    """Cosine of an angle up to 10 rad, to 55 digits."""
    return _exponential(x)[0]


def sine(x: Digits) -> Digits:
    """Sine of an angle up to 10 rad, to 55 digits."""
    return _exponential(x)[1]


_RULES: dict[np.ufunc, Callable[..., Any]] = {np.cos: cosine, np.sin: sine}


def floats(scaled: Any) -> Any:
    """Floats of fixed-point numbers."""
    return (scaled / ONE).astype(np.float64)


def stacked_digits(entries: list[Any], samples: int) -> Any:
    """Fixed-point numbers (samples, n), a column per scalar."""
    out = np.empty((samples, len(entries)), dtype=object)
    for i, entry in enumerate(entries):
        out[:, i] = entry.scaled if isinstance(entry, Digits) else scaled(entry)
    return out


def independent_columns(matrix: Any, order: Sequence[int], nothing: float = 0.0) -> tuple[int, ...]:
    """Indices of columns independent of those before them in an order."""
    left, found = matrix[:, list(order)], list[int]()
    least = np.zeros(len(order))
    if matrix.dtype == object:
        sizes = _sizes(matrix).max(axis=0, initial=0.0)
        least = nothing * np.maximum(sizes, MIN_COLUMN_RATIO * sizes.max(initial=0.0))[list(order)]
    for place, column in enumerate(order):
        if not len(left):
            break
        rest = _sizes(left[:, place])
        pivot = int(rest.argmax())
        if rest[pivot] > least[place]:
            left = _eliminated(left, pivot, place)
            found.append(column)
    return tuple(found)


def pivots(matrix: Any) -> tuple[float, ...]:
    """Pivot sizes by Gaussian elimination with complete pivoting."""
    left, found = matrix.copy(), list[float]()
    while left.size:
        sizes = _sizes(left)
        row, column = np.unravel_index(int(sizes.argmax()), sizes.shape)
        found.append(float(sizes[row, column]))
        if found[-1] <= EXACT_ZERO_TOLERANCE * found[0]:
            break
        left[:, [0, column]] = left[:, [column, 0]]
        left = _eliminated(left, int(row), 0)[:, 1:]
    return tuple(found)


def rank(matrix: Any, nothing: float = 0.0) -> int:
    """Rank of residues, or number of pivots above `nothing`."""
    if matrix.dtype != object:
        return len(independent_columns(matrix, range(matrix.shape[1])))
    sizes = pivots(matrix)
    return sum(size > nothing * sizes[0] for size in sizes)


def _sizes(entries: Any) -> Any:
    """Sizes of numbers of 60 digits."""
    return np.abs(floats(entries)) if entries.dtype == object else entries != 0


def _eliminated(left: Any, pivot: int, place: int) -> Any:
    row, exact = left[pivot], left.dtype != object
    scaled = row * inverse(int(row[place])) % PRIME if exact else (row << BITS) // row[place]
    left[pivot] = left[0]
    rest = left[1:]
    if exact:
        rest[:, place:] = (rest[:, place:] - rest[:, place, None] * scaled[place:]) % PRIME
    else:
        rest[:, place:] -= rest[:, place, None] * scaled[place:] >> BITS
    return rest


def ranks(matrices: Residues) -> tuple[int, ...]:
    """Ranks (N,) of N small matrices of residues."""
    left, many, rows = matrices.copy(), np.arange(len(matrices)), np.arange(matrices.shape[1])
    found = np.zeros(len(matrices), dtype=np.int64)
    for place in range(matrices.shape[2]):
        candidates = (left[:, :, place] != 0) & (rows >= found[:, None])
        has, top = candidates.any(axis=1), np.minimum(found, rows[-1])
        pivot = np.where(has, candidates.argmax(axis=1), top)
        row = left[many, pivot]
        left[many, pivot], left[many, top] = left[many, top], row
        below = left[:, :, place] * ((rows > top[:, None]) & has[:, None])
        scale = np.where(has, row[:, place], 1)
        # Both products, and their difference, fit 64 bits: no pivot needs an inverse.
        left = (left * scale[:, None, None] - below[:, :, None] * row[:, None, :]) % PRIME
        found += has
    return tuple(found.tolist())
