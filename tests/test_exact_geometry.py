"""Lengths as exact scalars: in a unit, and equal to those that they are nearly equal to."""

from __future__ import annotations

from fractions import Fraction

import pytest

from adaptctl.identifiability.proof.exact_geometry import Reading
from adaptctl.identifiability.proof.simplest import AS_MEANT


@pytest.mark.parametrize("unit", [Fraction(1), Fraction(1, 1000), Fraction(5, 2)])
def test_a_length_is_told_in_the_unit(unit: Fraction) -> None:
    reading = Reading(lambda x: x, 1.0, unit)
    assert reading.length(0.3) * unit == Fraction(3, 10)
    assert reading.length(-0.3) == -reading.length(0.3)
    assert reading.length(0.0) == 0


def test_a_length_next_to_a_shorter_one_is_that_one_and_keeps_its_sign() -> None:
    """By at most a ten thousandth of the mechanism, here 2 m long; never next to a longer one."""
    reading = Reading(lambda x: x, 2.0, precision=AS_MEANT, equal=(0.25, 0.5))
    for x, expected in ((0.50015, 0.5), (-0.50015, -0.5), (0.25, 0.25), (0.2501, 0.25)):
        assert float(reading.length(x)) == expected
    for x in (0.5003, 0.4999, 0.1):
        assert float(reading.length(x)) != 0.5
        assert float(reading.length(x)) == pytest.approx(x, abs=2e-4)
