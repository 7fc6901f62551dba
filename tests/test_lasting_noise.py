"""Noise of torques that lasts: rows made white are those of generalised least squares, gaps between them included."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_logs import known

from adaptctl.identification.choice import choose
from adaptctl.identification.filtered_dynamics import Rows
from adaptctl.identification.fit import FitSettings
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.gathering import gathered
from adaptctl.identification.lasting_noise import innovations
from adaptctl.identification.noise_choice import lasting_times

RATE = 20.0


def rows() -> Rows:
    """Rows at 20 Hz of two joints and three parameters, of two logs."""
    rng = np.random.default_rng(0)
    time, log = np.r_[np.arange(40), np.arange(30)] / RATE, np.repeat([0, 1], [40, 30])
    Y, (torque, change, velocity) = rng.normal(size=(70, 2, 3)), rng.normal(size=(3, 70, 2))
    return Rows(RATE / 4.0, time, Y, torque, change, velocity, log, np.ones(70, dtype=np.bool_))


def test_white_rows_are_those_of_generalised_least_squares() -> None:
    own, used = rows(), np.random.default_rng(1).random((70, 2)) < 0.7
    white = innovations(own, used, (0.5, 0.0))
    here = used[:, 0]
    apart = np.abs(own.time[here, None] - own.time[here]) + np.where(own.log[here, None] == own.log[here], 0.0, np.inf)
    inverse = np.linalg.inv(np.exp(-apart / 0.5)) * -np.expm1(-2.0 / (0.5 * RATE))
    Y = own.regressor[here, 0]
    np.testing.assert_allclose(white.regressor[here, 0].T @ white.regressor[here, 0], Y.T @ inverse @ Y)
    np.testing.assert_allclose(white.regressor[here, 0].T @ white.torque[here, 0], Y.T @ inverse @ own.torque[here, 0])
    np.testing.assert_array_equal(white.regressor[:, 1], own.regressor[:, 1])
    assert innovations(own, used, ()) is own


@pytest.mark.parametrize(("colour", "lasts"), [(np.exp(-1.0 / 100.0), True), (0.9, False), (0.0, False)])
def test_noise_that_lasts_is_told_from_other(colour: float, lasts: bool) -> None:
    case = known(4, links=2, duration=30.0, rate=100.0, colour=float(colour))
    evidence = gathered(case.guess, case.drives, [case.log])[0]
    settings = FitSettings(FrictionModel(), 1.0, evidence.band, 0.02)
    assert bool(lasting_times(evidence, settings)) is lasts
    assert bool(choose(evidence, FrictionModel(), 1.0, evidence.band).settings.lasting) is lasts
    assert lasting_times(evidence, replace(settings, left_out=(1,)))[1:] in ((), (0.0,))
    assert max(lasting_times(evidence.part(range(6)), settings), default=0.0) < 1.0  # of 9 s


@pytest.mark.parametrize(("time", "seed"), [(0.3, 0), (0.3, 5), (1.0, 0), (1.0, 5)])
def test_how_long_noise_lasts_is_that_of_the_log(time: float, seed: int) -> None:
    case = known(seed, links=2, duration=50.0, rate=100.0, colour=float(np.exp(-0.01 / time)))
    evidence = gathered(case.guess, case.drives, [case.log])[0]
    found = lasting_times(evidence, FitSettings(FrictionModel(), 1.0, evidence.band, 0.02))
    assert set(found) == {time}
