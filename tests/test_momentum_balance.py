"""Regressors by momenta: packed, by NumPy and by native code; and the normal equations of these."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_logs import known, motion

from adaptctl.arrays import Array
from adaptctl.identification.filtered_dynamics import Rows
from adaptctl.identification.friction_model import with_all_friction
from adaptctl.identification.momentum_balance import MomentumBalance, PackedRegressor
from adaptctl.identification.normal_equations import NormalEquations


def test_native_code_gives_the_regressor_of_numpy_and_of_accelerations() -> None:
    case, rate = known(3), 1000.0
    mechanism = with_all_friction(case.truth, case.drives)
    _, p, v, a = motion(mechanism.dof, np.random.default_rng(1), 0.6, rate)
    plain = MomentumBalance(mechanism).at(p, v, rate)
    native = MomentumBalance(mechanism, many=True)
    native.at(p[:9], v[:9], rate)  # tells the entries
    found = native.at(p, v, rate)
    np.testing.assert_array_equal(found.entries, plain.entries)
    np.testing.assert_allclose(found.values, plain.values, rtol=1e-11, atol=1e-11 * np.abs(plain.values).max())
    whole = mechanism.torque_regressor(p, v, a)[2:-2]
    np.testing.assert_allclose(found.whole, whole, rtol=1e-6, atol=1e-6 * np.abs(whole).max())
    x: Array = np.asarray(np.random.default_rng(2).normal(size=whole.shape[-1]))
    np.testing.assert_allclose(found.torques(x), found.whole @ x, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("many", [False, True])
def test_torques_of_known_parameters_are_those_of_the_regressor(many: bool) -> None:
    case, rate = known(3), 1000.0
    mechanism = case.truth
    _, p, v, _ = motion(mechanism.dof, np.random.default_rng(1), 0.2, rate)
    known_torques = MomentumBalance(mechanism, many, known=True)
    known_torques.at(p[:9], v[:9], rate)
    told = MomentumBalance(mechanism).at(p, v, rate).torques(mechanism.inertial_parameters)
    found = known_torques.at(p, v, rate).torques(np.ones(1))
    np.testing.assert_allclose(found, told, rtol=1e-11, atol=1e-11 * np.abs(told).max())


def test_sums_are_those_of_the_rows_that_a_mask_has() -> None:
    rng = np.random.default_rng(4)
    Y, torque, block = rng.normal(size=(60, 2, 5)), rng.normal(size=(60, 2)), np.repeat([0, 2, 3], 20)
    Y[:, 0, 3:] = 0.0
    packed, used = PackedRegressor.of(Y), rng.random((60, 2)) < 0.7
    assert packed.values.shape == (60, 8)
    np.testing.assert_array_equal(packed.whole, Y)
    found = NormalEquations.zero(4, 2, 5)
    for half in (used & (np.arange(60) % 3 > 0)[:, None], used & (np.arange(60) % 3 == 0)[:, None]):
        found.add(packed, torque, block, half)
    rows = Rows(1.0, np.zeros(60), Y, torque, torque, torque, block, block > 0)
    here = [used & (block == b)[:, None] for b in range(4)]
    for sums in (found, NormalEquations.of(rows, block, 4, used)):
        np.testing.assert_allclose(sums.normal, [np.einsum("nj,njp,njq->jpq", m, Y, Y) for m in here], atol=1e-12)
        np.testing.assert_allclose(sums.moment, [np.einsum("nj,njp,nj->jp", m, Y, torque) for m in here], atol=1e-12)
        np.testing.assert_allclose(sums.square, [(m * torque**2).sum(axis=0) for m in here], atol=1e-12)
        np.testing.assert_array_equal(sums.count, [m.sum(axis=0) for m in here])
