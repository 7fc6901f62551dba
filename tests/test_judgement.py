"""Judgement of control periods: the documented reward, and errors that pass their bounds, one period or many."""

from __future__ import annotations

import numpy as np
import pytest

from adaptctl.envs.task import Judgement, RewardWeights

pytestmark = pytest.mark.usefixtures("optimized")

R = 3
JUDGEMENT = Judgement(RewardWeights(2.0, 0.3, 0.05), np.array([0.5, np.inf, 0.25]), np.array([10.0, 4.0, 1.0]))


def test_rewards_are_minus_the_weighted_squares() -> None:
    p, v, wanted_p, wanted_v, torque = np.random.default_rng(0).normal(size=(5, 40, R))
    reward, lost = JUDGEMENT.kernel.map(p, v, wanted_p, wanted_v, torque)
    e, rate, relative = p - wanted_p, v - wanted_v, torque / JUDGEMENT.torque_limits
    expected = -(2.0 * (e**2).sum(1) + 0.3 * (rate**2).sum(1) + 0.05 * (relative**2).sum(1))
    np.testing.assert_allclose(reward, expected, rtol=1e-13)
    np.testing.assert_array_equal(lost > 0.0, (np.abs(e) > JUDGEMENT.error_bound).any(1))
    one_by_one = [JUDGEMENT.kernel(*period) for period in zip(p, v, wanted_p, wanted_v, torque, strict=True)]
    np.testing.assert_array_equal(np.transpose(one_by_one), (reward, lost))


@pytest.mark.parametrize(("error", "lost"), [(0.5, 0.0), (np.nextafter(0.5, 1.0), 1.0), (-0.6, 1.0), (np.nan, 0.0)])
def test_an_error_on_its_bound_has_not_passed_it(error: float, lost: float) -> None:
    zero = np.zeros(R)
    assert JUDGEMENT.kernel(np.array([error, 9.0, 0.0]), zero, zero, zero, zero).lost == lost
