"""Settings of a search for an exciting reference, before it begins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sampled_loops import reduced

from adaptctl.arrays import Array
from adaptctl.control import MotionLimits, PriorRanges
from adaptctl.control.excitation.excitation_trajectory import FourierSearch, _checked, excitation_trajectory
from adaptctl.errors import InputError

MODEL = reduced("puma560_arm3")
K = len(MODEL.columns)


@pytest.mark.parametrize(
    ("scale", "expected"),
    [
        (None, PriorRanges().for_parameters(MODEL.names)),
        (2.0, np.full(K, 2.0)),
        (np.arange(1.0, K + 1.0), np.arange(1.0, K + 1.0)),
    ],
)
def test_ranges_are_one_number_one_a_parameter_or_those_of_the_prior(scale: object, expected: Array) -> None:
    found = _checked(MODEL, 0.2, 1, 1.0, scale, None)  # type: ignore[arg-type]
    np.testing.assert_array_equal(found.scale, expected)


@pytest.mark.parametrize("scale", [np.ones(K + 1), np.ones((1, K)), np.ones(1)])
def test_ranges_of_another_shape_are_refused(scale: Array) -> None:
    with pytest.raises(InputError, match="scale"):
        _checked(MODEL, 0.2, 1, 1.0, scale, None)


def test_limits_may_be_of_oblique_coordinates() -> None:
    """Differences of joints within half a rad: the joints' own speeds and positions follow, in motion and reference."""
    rows = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, -1.0]])
    ends = np.array([1.0, 1.0, 0.5])
    limits = MotionLimits(-ends, ends, np.array([9.0, 9.0, 2.0]), np.full(3, np.inf), np.linalg.inv(rows))
    search = FourierSearch(MODEL, limits, 0.2, 2, np.ones(K))
    x = search.random(np.random.default_rng(0))
    p, v, a = search.motion(x)
    assert np.all(np.abs(p @ rows.T).max(axis=0) <= ends + 1e-12)
    assert np.all(np.abs(v @ rows.T).max(axis=0) <= limits.velocity + 1e-12)
    time = np.arange(len(p)) / (len(p) * 0.2)
    for one, other in zip((p, v, a), search.reference(x)(time), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-10)


@pytest.mark.parametrize("scale", [-1.0, 0.0, np.append(0.0, np.ones(K - 1)), -np.ones(K), np.nan, "a"])
def test_ranges_are_positive_numbers(scale: Any) -> None:
    with pytest.raises(InputError, match=r"^scale: expected "):
        excitation_trajectory(MODEL, scale=scale)


@pytest.mark.parametrize("seed", [-1, 1.5, "a", None, np.nan])
def test_seeds_are_whole_numbers(seed: Any) -> None:
    with pytest.raises(InputError, match=f"^seed: expected a whole number of at least 0, got {seed!r}$"):
        excitation_trajectory(MODEL, seed=seed)


@pytest.mark.parametrize(("harmonics", "share"), [(0, 0.5), (-1, 0.5), (1.5, 0.5), (1, 0.0), (1, 1.1)])
def test_harmonics_are_whole_and_at_least_one_and_shares_at_most_all(harmonics: float, share: float) -> None:
    with pytest.raises(InputError, match="harmonics" if share == 0.5 else "limit_share"):
        _checked(MODEL, 0.2, harmonics, share, None, None)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [0, -1, np.nan, np.inf, "a", None, 2.0])
@pytest.mark.parametrize("name", ["harmonics", "iterations"])
def test_counts_are_whole_numbers(name: str, wrong: Any) -> None:
    with pytest.raises(InputError, match=f"{name}: expected a whole number of at least 1, got"):
        excitation_trajectory(MODEL, **{name: wrong})


@pytest.mark.parametrize("share", [0.0, -1.0, 1.1, np.nan, np.inf, "a", None])
def test_limits_are_a_share_of_the_joints_own(share: Any) -> None:
    with pytest.raises(InputError, match="share: expected a"):
        MotionLimits.from_model(MODEL, share)


ONES, GONE = np.ones(3), np.full(3, np.nan)


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ((-np.ones(2), ONES, ONES, ONES), r"limits: lower: expected shape \(3,\), got \(2,\)"),
        ((-ONES, GONE, ONES, ONES), "limits: upper: expected finite"),
        ((-np.inf * ONES, ONES, ONES, ONES), "limits: lower: expected finite"),
        ((ONES, -ONES, ONES, ONES), "limits: expected lower <= upper for every joint"),
        ((-ONES, ONES, GONE, ONES), "limits: velocity: expected numbers"),
        ((-ONES, ONES, -ONES, ONES), "limits: velocity: expected numbers of at least 0"),
        ((-ONES, ONES, ONES, np.ones(4)), "limits: torque: expected a number or 3"),
        ((-ONES, ONES, ONES, GONE), "limits: torque: expected numbers"),
        ((-ONES, ONES, ONES, 0.0 * ONES), "limits: torque: expected positive numbers"),
    ],
)
def test_limits_that_no_reference_keeps_are_refused(limits: tuple[Array, Array, Array, Array], says: str) -> None:
    with pytest.raises(InputError, match=says):
        excitation_trajectory(MODEL, limits=MotionLimits(*limits))


def searched(torque: float) -> FourierSearch:
    ones = np.ones(3)
    return FourierSearch(MODEL, MotionLimits(-ones, ones, 5.0 * ones, torque * ones), 0.2, 2, np.ones(K))


X = searched(1.0).random(np.random.default_rng(0))
REST, FULL = (searched(1.0).torque_share(X, factor) for factor in (0.0, 1.0))
"""N m, the largest torque at rest and of whole swings"""


def test_swings_are_as_large_as_torques_allow() -> None:
    """Between rest and whole swings just at the limit, and whole where it is above; refused where rest is beyond it."""
    assert REST < FULL
    _, _, share = searched(0.5 * (REST + FULL)).within(X)
    assert 0.999 < share <= 1.0
    whole, _, share = searched(1.1 * FULL).within(X)
    assert share == pytest.approx(1.0 / 1.1, rel=1e-12)
    np.testing.assert_array_equal(whole.amplitude, searched(1.0).reference(X).amplitude)
    with pytest.raises(InputError, match="even at rest torques pass their limits"):
        searched(0.9 * REST).within(X)


def test_a_cost_is_the_logarithm_of_the_condition_and_grows_by_the_square_of_torque_beyond_the_limit() -> None:
    condition, _ = searched(FULL).judged(X)
    costs = [searched(FULL / share).cost(X) for share in (0.5, 1.0 - 1e-9, 1.1, 1.2)]
    np.testing.assert_allclose(costs[:2], np.log(condition), rtol=1e-12)
    assert costs[2] > costs[1]
    assert (costs[3] - costs[1]) / (costs[2] - costs[1]) == pytest.approx(4.0, rel=1e-6)
