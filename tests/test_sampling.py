"""Ranges of random positions where joints lack limits."""

from __future__ import annotations

import numpy as np
import pytest

from adaptctl.identifiability.sampling import _range


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ((-1.0, 2.0), (-1.0, 2.0)),
        ((-np.inf, 2.0), (-4.0, 2.0)),
        ((-1.0, np.inf), (-1.0, 5.0)),
        ((-np.inf, np.inf), (-2.5, 3.5)),
    ],
)
def test_a_limit_that_lacks_is_a_width_from_the_other_or_both_are_about_the_centre(
    limits: tuple[float, float], expected: tuple[float, float]
) -> None:
    lower, upper = np.array(limits)[:, None]
    found = _range(lower, upper, np.array([6.0]), np.array([0.5]))
    np.testing.assert_array_equal(np.ravel(found), expected)
