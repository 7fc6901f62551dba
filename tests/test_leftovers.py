"""Leftovers: singular values beyond a gap that are more than round-off, with the parameters that they are about."""

from __future__ import annotations

import numpy as np
import pytest

from adaptctl.identifiability.certificate import ROUND_OFF_RATIO, ResidualSingularValue
from adaptctl.identifiability.certification import residual_singular_values

NAMES = tuple("abcdefgh")
SIZES = np.array([0.2, -9.0, 0.8, 8.0, -7.0, 0.91, 6.0, 5.0])
"""Of these the largest four are b, d, e and g, whatever their signs; h is larger than a tenth too."""


@pytest.mark.parametrize("largest", [1.0, 40.0])
def test_a_leftover_is_relative_and_names_at_most_four_parameters_that_dominate(largest: float) -> None:
    spectrum = largest * np.array([1.0, 0.5, 2.0 * ROUND_OFF_RATIO, 0.5 * ROUND_OFF_RATIO, 0.0, 0.0, 0.0, 0.0])
    vectors = np.eye(8)
    vectors[:, 2] = SIZES
    (found,) = residual_singular_values(spectrum, vectors, 2, NAMES)
    assert found == ResidualSingularValue(pytest.approx(2.0 * ROUND_OFF_RATIO, rel=1e-12), ("b", "d", "e", "g"))  # type: ignore[arg-type]


def test_parameters_that_are_a_tenth_of_the_largest_do_not_dominate() -> None:
    vectors = np.eye(3)
    vectors[:, 1] = [0.3, -0.02, 0.031]
    (found,) = residual_singular_values(np.array([1.0, 0.1, 0.0]), vectors, 1, NAMES[:3])
    assert found.parameters == ("a", "c")


def test_nothing_is_left_where_all_is_zero() -> None:
    assert residual_singular_values(np.zeros(3), np.eye(3), 0, NAMES[:3]) == ()
