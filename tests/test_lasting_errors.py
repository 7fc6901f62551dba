"""Noise that lasts and torques that are late: what an identification makes of them."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from nightly import nightly
from scipy.signal import lfilter
from synthetic_logs import Known, known

from adaptctl.identification import Identification
from adaptctl.identification.autoregression import ORDER, autoregression
from adaptctl.identification.delay import estimated_delay
from adaptctl.identification.fit import FitSettings
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.gathering import gathered
from adaptctl.identification.identify import identified
from adaptctl.identification.uncertainty import Student, inverse_curvature


def found(case: Known) -> Identification:
    return identified(case.guess, case.drives, [case.log], friction=FrictionModel(), prior_weight=1.0)


def late(case: Known, samples: int) -> Known:
    """The same with torques late by some samples."""
    count = len(case.log.torque)
    torque = case.log.torque[np.clip(np.arange(count) - samples, 0, count - 1)]
    return replace(case, log=replace(case.log, torque=torque))


@nightly
@pytest.mark.parametrize("samples", [4, -5, 15])
def test_a_delay_is_found_said_and_taken_off(samples: int) -> None:
    """At 500 Hz; the estimates then are those of the log without delay, as far as deviations go."""
    case = known(4, links=2, noise=0.01, duration=12.0)
    right, wrong = found(case), found(late(case, samples))
    words = [text for text in wrong.warnings if "than the positions" in text]
    assert len(words) == 1
    told = re.match(r"the torques are (\S+) ms (later|earlier) than the positions", words[0])
    assert told is not None
    assert float(told[1]) == pytest.approx(2.0 * abs(samples), abs=1.0)
    assert told[2] == ("later" if samples > 0 else "earlier")
    assert f"taken as much {'earlier' if samples > 0 else 'later'} in fit" in words[0]
    assert not [text for text in right.warnings if "than the positions" in text]
    assert wrong.validation.relative_error < 1.2 * right.validation.relative_error
    truth = wrong.model.regrouping @ case.truth.inertial_parameters
    assert np.mean(np.abs((wrong.estimate - truth) / wrong.deviations) < 1.96) > 0.85


def test_a_delay_is_as_sure_as_is_said() -> None:
    """Noise is not taken for the torques' own rate, which made it too short by seven deviations at 25 Hz."""
    off = []
    for seed in (1, 2, 3):
        case = late(known(seed, links=2, colour=0.0, noise=0.05, duration=12.0), 2)
        evidence, _, _ = gathered(case.guess, case.drives, [case.log], cutoff=25.0)
        settings, whole = FitSettings(FrictionModel(), 1e-4, 25.0), 0.0
        for _ in range(3):
            moved = evidence.advanced(whole)
            fit = moved.fit(settings, range(moved.blocks))
            delay = estimated_delay(moved, fit, inverse_curvature(moved, fit)[0], Student(moved.blocks))
            whole += delay.value
        off.append((whole - 4e-3) / delay.deviation)
    assert np.sqrt(np.mean(np.square(off))) < 2.5


@pytest.mark.parametrize("persistence", [0.0, 0.5, 0.9])
def test_noise_that_lasts_is_told_from_residuals(persistence: float) -> None:
    """Of an autoregression of first order: its long-run variance is that of its innovations over (1 - a)^2."""
    noise = lfilter([1.0], [1.0, -persistence], np.random.default_rng(1).normal(size=20_000))
    coefficients, variance = autoregression(noise, 10.0)
    assert coefficients.shape == (ORDER,)
    assert variance == pytest.approx(1.0, rel=0.03)
    assert variance / (1.0 - coefficients.sum()) ** 2 == pytest.approx(1.0 / (1.0 - persistence) ** 2, rel=0.1)
    assert not autoregression(np.zeros(50), 1.0)[0].any()
