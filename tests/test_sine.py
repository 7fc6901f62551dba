"""Sine and cosine in native code and in lanes, against sums of their series in exact arithmetic."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from nightly import mostly_at_night
from numpy.typing import NDArray

from adaptctl.compilation import compile_function, compile_step
from adaptctl.compilation.native import Processor
from adaptctl.compilation.sine import DOUBLE
from adaptctl.scalars import Column, cos, sin

pytestmark = pytest.mark.usefixtures("optimized")

Array = NDArray[np.float64]
Pair = Callable[[Array], tuple[Array, Array]]

ONE = 1 << 320
"""Numbers below are whole numbers of this many parts."""


def arctangent_of_inverse(n: int) -> int:
    total, power, k = 0, ONE // n, 1
    while power:
        total += power // k if k % 4 == 1 else -(power // k)
        power, k = power // (n * n), k + 2
    return total


PI = 16 * arctangent_of_inverse(5) - 4 * arctangent_of_inverse(239)  # Machin (1706)


def series(x: int, term: int, k: int) -> int:
    """The sum of x^k/k! - x^(k+2)/(k+2)! + ..., from its first term."""
    total = 0
    while term:
        total += term
        term, k = -(term * x // ONE * x // ONE) // ((k + 1) * (k + 2)), k + 2
    return total


def exact(x: float) -> tuple[int, int]:
    """Sine and cosine of x, to 90 digits."""
    angle = int(Fraction(x) * ONE)
    quarters = (2 * angle + PI // 2) // PI
    rest = angle - quarters * PI // 2
    s, c = series(rest, rest, 1), series(rest, ONE, 0)
    return [(s, c), (c, -s), (-s, -c), (-c, s)][quarters % 4]


def ulps(computed: float, true: int) -> float:
    return abs(Fraction(computed) - Fraction(true, ONE)) / Fraction(math.ulp(true / ONE))


def worst(pair: Pair, angles: Array) -> float:
    sines, cosines = pair(angles)
    true = [exact(x) for x in angles.tolist()]
    return max(max(ulps(s, a), ulps(c, b)) for s, c, (a, b) in zip(sines.tolist(), cosines.tolist(), true, strict=True))


def compiled(lanes: int | None, processor: Processor | None = None) -> Pair:
    def both(x: Column) -> tuple[float, float]:
        return sin(x[0]), cos(x[0])

    stepper = compile_step(both, state={}, constants={"x": 1}, lanes=lanes, processor=processor)

    def evaluate(angles: Array) -> tuple[Array, Array]:
        ensemble = stepper.ensemble(len(angles))
        ensemble.held["x"] = angles[:, None]
        sines, cosines = ensemble.run()
        return sines, cosines

    return evaluate


def beside_others() -> Pair:
    """As one arm's joints: all sines of a call together."""
    stepper = compile_step(
        lambda x: (Column(map(sin, x)), Column(map(cos, x))), state={}, constants={"x": 8}, lanes=1, name="joints"
    )

    def evaluate(angles: Array) -> tuple[Array, Array]:
        ensemble = stepper.ensemble(-(-len(angles) // 8))
        ensemble.held["x"] = np.resize(angles, (ensemble.members, 8))
        sines, cosines = (part.ravel()[: len(angles)] for part in ensemble.run())
        return sines, cosines

    return evaluate


PAIRS: dict[str, Callable[[], Pair]] = {
    "eight joints of one arm": beside_others,
    "1 lane": lambda: compiled(1),
    "2 lanes": lambda: compiled(2),
    "4 lanes": lambda: compiled(4),
    "8 lanes": lambda: compiled(8),
    "without fused operations": lambda: compiled(None, Processor("generic", "")),
    "8 lanes without registers for them": lambda: compiled(8, Processor("generic", "")),
}


@pytest.fixture(
    scope="module",
    params=mostly_at_night(PAIRS, *list(PAIRS)[::2]),
)
def pair(request: pytest.FixtureRequest) -> Pair:
    return PAIRS[request.param]()


def multiples(largest: float) -> Array:
    """The doubles next to multiples of a quarter turn, where few digits of the rest are left, and their neighbours."""
    k = np.arange(1, int(largest / (math.pi / 2.0)), 37).tolist()
    nearest = np.array([float(Fraction(i * PI, 2 * ONE)) for i in [1, 2, 3, 4, *k]])
    return np.concatenate([nearest, -nearest, np.nextafter(nearest, 0.0)])


def test_two_units_in_the_last_place(pair: Pair) -> None:
    rng = np.random.default_rng(0)
    sizes = 10.0 ** rng.uniform(-12.0, 5.0, 1000) * rng.choice([-1.0, 1.0], 1000)
    assert worst(pair, np.concatenate([rng.uniform(-1e5, 1e5, 3000), rng.uniform(-4.0, 4.0, 1000), sizes])) < 2.0


def test_next_to_multiples_of_a_quarter_turn(pair: Pair) -> None:
    assert worst(pair, multiples(1e5)) < 1.0


def test_worst_known_angles(pair: Pair) -> None:
    """The nearest to a multiple below 1e6 rad (29 quarter turns and 6e-19), and where the polynomials are worst."""
    angles = [45.553093477052, 97086.9596601543, -66099.85996663987, 71417.03374791465, math.pi / 4.0, 0.0]
    assert worst(pair, np.array(angles)) < 2.0


def test_tiny_angles(pair: Pair) -> None:
    tiny = np.array([0.0, -0.0, 5e-324, -5e-324, 1e-310, 2.2250738585072014e-308, 1e-300, -1e-160, 1e-30, -1e-9])
    sines, cosines = pair(tiny)
    np.testing.assert_array_equal(sines, tiny)
    np.testing.assert_array_equal(cosines, 1.0)


@pytest.mark.parametrize("joints", [2, 3, 5, 8, 9, 17])
def test_as_many_joints_as_there_are(joints: int) -> None:
    def both(x: Column) -> tuple[Column, Column]:
        return Column(map(sin, x)), Column(map(cos, x))

    angles = np.random.default_rng(joints).uniform(-7.0, 7.0, joints)
    angles[0], angles[-1] = 1e7, -2e-9
    for found, function in zip(compile_function(both, {"x": joints})(angles), (np.sin, np.cos), strict=True):
        np.testing.assert_allclose(found, function(angles), rtol=4.5e-16, atol=0.0)


def test_up_to_the_limit(pair: Pair) -> None:
    rng = np.random.default_rng(1)
    angles = np.concatenate([rng.uniform(-DOUBLE.farthest, DOUBLE.farthest, 1000), [DOUBLE.farthest, -DOUBLE.farthest]])
    assert worst(pair, angles) < 2.0


@pytest.mark.parametrize("lanes", [1, 4, 8])
def test_farther_angles_are_the_c_librarys_whatever_is_beside_them(lanes: int) -> None:
    angles = np.array([np.nextafter(DOUBLE.farthest, np.inf), -1e7, 1e10, -1e22, 1.7e308, 0.5, -3.0, 2.0**60])
    sines, cosines = compiled(lanes)(angles)
    np.testing.assert_allclose(sines, [math.sin(x) for x in angles.tolist()], rtol=4.5e-16, atol=0.0)
    np.testing.assert_allclose(cosines, [math.cos(x) for x in angles.tolist()], rtol=4.5e-16, atol=0.0)


@pytest.mark.parametrize("lanes", [1, 4, 8])
def test_what_is_not_finite_has_no_sine(lanes: int) -> None:
    angles = np.array([0.5, np.nan, np.inf, -np.inf, -0.5, 1e300, 3.0, 0.0])
    for values, function in zip(compiled(lanes)(angles), (math.sin, math.cos), strict=True):
        np.testing.assert_array_equal(np.isnan(values), ~np.isfinite(angles))
        finite = np.isfinite(angles)
        np.testing.assert_allclose(values[finite], [function(x) for x in angles[finite].tolist()], rtol=4.5e-16)


def test_lanes_agree_to_the_last_places() -> None:
    """Each is right to 2 units; which multiplications fuse with additions is the compiler's choice, lane by lane."""
    angles = np.random.default_rng(2).uniform(-100.0, 100.0, 1000)
    one, four, eight = (np.concatenate(compiled(lanes)(angles)) for lanes in (1, 4, 8))
    np.testing.assert_array_max_ulp(four, one, 4)
    np.testing.assert_array_max_ulp(eight, one, 4)
