"""Forecast deviations: those of least squares, and infinite where a motion tells nothing of a parameter."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.cli.excite import as_builtins
from adaptctl.control.adaptation import PriorRanges
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.files import write_json
from adaptctl.identification.robot_motion import RobotMotion
from adaptctl.identification.uncertainty import Combination, Forecast, combinations, forecast, unexcited

NOISE = 0.5
POSE = [0.1, -0.7, 0.5, 0.2, 0.3, -0.1]


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


@pytest.fixture(scope="module")
def told_by_one_joint(puma: Mechanism) -> Forecast:
    return forecast(puma, moving(1), NOISE)


def moving(*joints: int) -> RobotMotion:
    """Some joints swing, each with five harmonics; the others rest."""
    rng = np.random.default_rng(3)
    amplitude, phase = np.zeros((5, 6)), rng.uniform(0.0, 2.0 * np.pi, (5, 6))
    amplitude[:, joints] = 0.2
    frequency = 0.1 * np.arange(1.0, 6.0)[:, None] * np.ones(6)
    pose = np.array(POSE)
    return RobotMotion(Sinusoids(pose, amplitude, frequency, phase), pose, pose, 10.0, 2.0)


def regressor(told: Forecast, motion: RobotMotion) -> Array:
    """The stacked torque regressor in deviations of the noise."""
    _, p, v, a, _ = motion.sampled(50.0)
    return told.model.torque_regressor(p, v, a).reshape(-1, len(told.model.names)) / NOISE


def own_part(Y: Array, j: int) -> float:
    """Length of what a column has that no other columns make up, over the length of the column (0 for a column of
    zeros): by one least-squares problem for each column (Frisch and Waugh 1933)."""
    size = np.linalg.norm(Y, axis=0)
    others = np.delete(Y / np.maximum(size, 1e-9), j, axis=1)
    left = Y[:, j] - others @ np.linalg.lstsq(others, Y[:, j], rcond=1e-9)[0]
    return float(np.linalg.norm(left) / max(size[j], 1e-9))


def test_deviations_are_infinite_exactly_where_other_columns_make_up_a_parameters_own(
    told_by_one_joint: Forecast,
) -> None:
    Y = regressor(told_by_one_joint, moving(1))
    own = np.array([own_part(Y, j) for j in range(Y.shape[1])])
    seen = own > 1e-6
    assert 0 < np.sum(seen) < len(seen)
    np.testing.assert_array_equal(np.isfinite(told_by_one_joint.deviations), seen)
    expected = 1.0 / (own[seen] * np.linalg.norm(Y[:, seen], axis=0))
    np.testing.assert_allclose(told_by_one_joint.deviations[seen], expected, rtol=1e-8)


def test_one_joint_alone_leaves_most_parameters_unknown(told_by_one_joint: Forecast) -> None:
    assert told_by_one_joint.condition == np.inf
    last = told_by_one_joint.model.names.index("link6.I_zz")
    assert told_by_one_joint.deviations[last] == np.inf
    assert np.sum(told_by_one_joint.relative < 0.1) < 6


def test_more_excitation_makes_deviations_finite_and_those_of_the_covariance(puma: Mechanism) -> None:
    told = forecast(puma, moving(0, 1, 2, 3, 4, 5), NOISE)
    Y = regressor(told, moving(0, 1, 2, 3, 4, 5))
    np.testing.assert_allclose(told.deviations, np.sqrt(np.diag(np.linalg.inv(Y.T @ Y))), rtol=1e-8)
    assert told.condition == pytest.approx(np.linalg.cond(Y / np.linalg.norm(Y, axis=0)), rel=1e-9)


def test_residuals_are_a_fiftieth_of_each_joints_torque_and_of_a_hundredth_of_the_largest_at_least(
    puma: Mechanism,
) -> None:
    motion = moving(0, 1, 2)
    _, p, v, a, _ = motion.sampled(50.0)
    largest = np.abs(puma.inverse_dynamics(p, v, a)).max(axis=0)
    expected = 0.02 * np.maximum(largest, 0.01 * largest.max())
    assert largest.min() < 0.01 * largest.max() < np.median(largest)
    np.testing.assert_allclose(forecast(puma, motion).deviations, forecast(puma, motion, expected).deviations)


@pytest.mark.parametrize("inflation", [1.0, 2.5])
def test_combinations_worth_less_than_three_deviations_are_unexcited(inflation: float) -> None:
    weak, strong = (Combination(words, x * inflation) for words, x in (("weak", 2.99), ("strong", 3.01)))
    assert unexcited([weak, strong], inflation) == [weak]


def test_combinations_are_eigenvectors_of_what_is_scaled_by_ranges() -> None:
    """Two masses of which a log tells the difference well and the sum badly, in kg: by the eigenvalues 1 and 9."""
    curvature = np.array([[5.0, -4.0], [-4.0, 5.0]])
    for ranges, factor in (
        (PriorRanges(), float(PriorRanges().for_parameters(("a.m", "b.m"))[0])),
        (PriorRanges(mass=7.0), 7.0),
    ):
        found = combinations(curvature, ("a.m", "b.m"), ranges)
        assert [one.strength for one in found] == pytest.approx([factor, 3.0 * factor])
        assert sorted(re.findall(r"0\.71 [ab]\.m", found[0].words)) == ["0.71 a.m", "0.71 b.m"]
        assert ("-" in found[0].words, "-" in found[1].words) == (False, True)


def test_units_of_length_do_not_decide_what_is_excited(puma: Mechanism, told_by_one_joint: Forecast) -> None:
    """With a noise of any size the same parameters are told."""
    for noise in (1e-6, 1e6):
        told = forecast(puma, moving(1), noise)
        np.testing.assert_allclose(told.deviations, told_by_one_joint.deviations * noise / NOISE, rtol=1e-9)


def test_infinite_deviations_are_null_in_the_file(told_by_one_joint: Forecast, tmp_path: Path) -> None:
    write_json(tmp_path / "forecast.json", as_builtins("puma", {"excitation": moving(1)}, told_by_one_joint, False))
    content = json.loads((tmp_path / "forecast.json").read_text())
    assert content["condition"] is None
    assert content["parameters"]["link6.I_zz"] == {"deviation": None, "relative": None}
    known = [entry for entry in content["parameters"].values() if entry["deviation"] is not None]
    assert len(known) == np.sum(np.isfinite(told_by_one_joint.deviations))


def test_relative_deviations_of_parameters_that_are_zero(told_by_one_joint: Forecast) -> None:
    """Of a value 0 a deviation above 0 is infinitely large, and none at all is none."""
    value = told_by_one_joint.model.fundamental_parameters
    none = replace(told_by_one_joint, deviations=np.zeros(len(value)))
    np.testing.assert_array_equal(none.relative, 0.0)
    some = replace(told_by_one_joint, deviations=np.ones(len(value)))
    np.testing.assert_array_equal(some.relative[value == 0.0], np.inf)
    np.testing.assert_allclose(some.relative[value != 0.0], 1.0 / np.abs(value[value != 0.0]), rtol=1e-15)
    assert np.any(value == 0.0)


def test_a_motion_without_torque_needs_a_noise() -> None:
    arm = Mechanism(replace(load("puma560_measured").description, gravity=np.zeros(3)))
    with pytest.raises(InputError, match="noise: the motion needs no torque"):
        forecast(arm, moving())
    assert np.all(np.isinf(forecast(arm, moving(), NOISE).deviations))
