"""Settings of a search for an exciting reference, before it begins."""

from __future__ import annotations

import numpy as np
import pytest
from sampled_loops import reduced

from adaptctl.arrays import Array
from adaptctl.control import PriorRanges
from adaptctl.control.excitation.exciting_reference import _checked
from adaptctl.errors import InputError

MODEL = reduced("puma560_arm3")
K = len(MODEL.columns)


@pytest.mark.parametrize(
    ("scale", "expected"),
    [(None, PriorRanges().of(MODEL.names)), (2.0, np.full(K, 2.0)), (np.arange(1.0, K + 1.0), np.arange(1.0, K + 1.0))],
)
def test_ranges_are_one_number_one_a_parameter_or_those_of_the_prior(scale: object, expected: Array) -> None:
    found = _checked(MODEL, 0.2, 1, 1.0, scale, None)  # type: ignore[arg-type]
    np.testing.assert_array_equal(found.scale, expected)


@pytest.mark.parametrize("scale", [np.ones(K + 1), np.ones((1, K)), np.ones(1)])
def test_ranges_of_another_shape_are_refused(scale: Array) -> None:
    with pytest.raises(InputError, match="scale"):
        _checked(MODEL, 0.2, 1, 1.0, scale, None)


@pytest.mark.parametrize(("harmonics", "share"), [(0, 0.5), (-1, 0.5), (1.5, 0.5), (1, 0.0), (1, 1.1)])
def test_harmonics_are_whole_and_at_least_one_and_shares_at_most_all(harmonics: float, share: float) -> None:
    with pytest.raises(InputError, match="harmonics" if share == 0.5 else "share"):
        _checked(MODEL, 0.2, harmonics, share, None, None)  # type: ignore[arg-type]
