"""Exact numbers: integers modulo a prime, numbers of sixty digits, and Gaussian elimination with both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

PRIME = 2**31 - 1
"""Products of two residues fit 64 bits. It is 3 modulo 4, so that no square is -1: 1 + t^2 never vanishes."""

Residues = NDArray[np.int64]


BITS = 200
"""after the point: 60 digits"""
ONE = 1 << BITS
_SHORT, _HALVINGS = 26, 8
NOTHING, EXACTLY_NOTHING = 1e-10, 1e-40
"""Sizes of what is left of numbers of sixty digits, relative to what was there, that count as zero. Relations that hold
exactly leave 1e-50; those that a file's floats hold to round-off leave 1e-12; those that nearly hold, by a miss e,
leave e or its square."""
LEAST_COLUMN = 1e-3
"""Floor under the sizes of columns, relative to the largest."""


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


def independent_columns(matrix: Any, order: Sequence[int], nothing: float = 0.0) -> tuple[int, ...]:
    """The zero-based indices of those columns of a `matrix` (m, n) that are independent of the columns before them in
    an `order` of column indices, given in that order, by Gaussian elimination. The matrix is of residues modulo the
    prime 2^31 - 1 (int64), or of Python ints (dtype object) that are its entries times 2^200.

    Of the latter a column is independent where its largest entry, once those taken before are eliminated, is above
    `nothing` (without a unit) times max(a, 1e-3 b), a being the largest entry of the given column and b that of the
    given matrix, in size. Raises `OverflowError` for entries beyond a double, `IndexError` for an index of n or more.
    """
    left, found = matrix[:, list(order)], list[int]()
    least = np.zeros(len(order))
    if matrix.dtype == object:
        sizes = _sizes(matrix).max(axis=0, initial=0.0)
        least = nothing * np.maximum(sizes, LEAST_COLUMN * sizes.max(initial=0.0))[list(order)]
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
    """The sizes, as floats, of the pivots of a `matrix` (m, n) by Gaussian elimination with complete pivoting, in the
    order in which they are found. The matrix is an array of Python ints (dtype object), its entries times 2^200. Pivots
    beyond the matrix's rank are round-off or zero, and the first that is below 1e-40 of the first pivot, the largest
    entry, is the last. Empty for an empty matrix. Raises `OverflowError` for entries beyond a double."""
    left, found = matrix.copy(), list[float]()
    while left.size:
        sizes = _sizes(left)
        row, column = np.unravel_index(int(sizes.argmax()), sizes.shape)
        found.append(float(sizes[row, column]))
        if found[-1] <= EXACTLY_NOTHING * found[0]:
            break
        left[:, [0, column]] = left[:, [column, 0]]
        left = _eliminated(left, int(row), 0)[:, 1:]
    return tuple(found)


def rank(matrix: Any, nothing: float = 0.0) -> int:
    """The rank of a `matrix` (m, n): over the field of residues modulo the prime 2^31 - 1 for one of these (int64); for
    one of Python ints (dtype object), its entries times 2^200, the number of its pivots whose size is above `nothing`
    (no unit) times that of the first, by complete pivoting. Raises `OverflowError` for entries beyond a double."""
    if matrix.dtype != object:
        return len(independent_columns(matrix, range(matrix.shape[1])))
    sizes = pivots(matrix)
    return sum(size > nothing * sizes[0] for size in sizes)


def _sizes(entries: Any) -> Any:
    """Sizes of numbers of sixty digits; of residues, which have none, whether they are not zero."""
    return np.abs(floats(entries)) if entries.dtype == object else entries != 0


def _eliminated(left: Any, pivot: int, place: int) -> Any:
    """The other rows, less as much of the pivot's that their entries from its column on lose that column."""
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
    """The ranks (N,), over the field of residues modulo the prime 2^31 - 1, of N small `matrices` (N, m, n), of m rows
    and n columns each, of these, int64 in 0..2^31 - 2, by Gaussian elimination of all at once. Nothing is checked."""
    left, many = matrices.copy(), np.arange(len(matrices))
    found = np.zeros(len(matrices), dtype=np.int64)
    for place in range(matrices.shape[2]):
        candidates = (left[:, :, place] != 0) & (np.arange(matrices.shape[1]) >= found[:, None])
        pivot = candidates.argmax(axis=1)
        has = candidates[many, pivot]
        top = np.minimum(found, matrices.shape[1] - 1)
        row = left[many, pivot]
        left[many, pivot] = np.where(has[:, None], left[many, top], row)
        scaled = row * inverse(np.where(has, row[:, place], 1))[:, None] % PRIME
        left[many, top] = np.where(has[:, None], scaled, left[many, top])
        below = np.where(np.arange(matrices.shape[1]) > top[:, None], left[:, :, place], 0) * has[:, None]
        left = (left - below[:, :, None] * scaled[:, None, :]) % PRIME
        found += has
    return tuple(found.tolist())
