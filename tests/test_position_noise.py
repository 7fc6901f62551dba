"""Noise of positions: its share of accelerations, cut-offs that leave it out, and instruments where none does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_logs import Known, known

from adaptctl.identification.filtered_dynamics import SmoothMotion
from adaptctl.identification.fit import LogEvidence
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.gathering import gathered
from adaptctl.identification.identify import identified
from adaptctl.identification.instruments import without_position_noise
from adaptctl.identification.position_noise import clean_cutoffs, noise_share
from adaptctl.identification.preparation import PreparedLog

QUANTUM = 1e-3


@pytest.fixture(scope="module")
def coarse() -> Known:
    """An arm whose encoders have steps of a milliradian."""
    case = known(1, links=2, colour=0.0, duration=12.0)
    return replace(case, log=replace(case.log, position=np.round(case.log.position / QUANTUM) * QUANTUM))


@pytest.fixture(scope="module")
def evidence(coarse: Known) -> LogEvidence:
    return gathered(coarse.guess, coarse.drives, [coarse.log], cutoff=25.0)[0]


def test_the_share_of_noise_is_that_of_white_noise_beside_a_sine() -> None:
    """Noise of variance s^2 at a rate r has the density 2 s^2/r, and 2 s^2 c^5/(5 r) in f^4 times it up to c."""
    rate, deviation, size, frequency, cutoff = 500.0, 1e-3, 0.3, 2.0, 20.0
    time = np.arange(60_000) / rate
    still = deviation * np.random.default_rng(0).normal(size=len(time))
    p = np.stack([size * np.sin(2.0 * np.pi * frequency * time) + still, still], axis=-1)
    log = PreparedLog("some.csv", rate, time, p, np.zeros_like(p), np.ones(len(time), dtype=np.bool_))
    noise, signal = 2.0 * deviation**2 * cutoff**5 / (5.0 * rate), 0.5 * size**2 * frequency**4
    share = noise_share([SmoothMotion.of(log, 0)], cutoff)
    assert share == pytest.approx([noise / (noise + signal), 0.0], rel=0.1)  # the other joint stands still


def test_cutoffs_that_a_coarse_encoder_is_noise_at_are_not_tried(coarse: Known, evidence: LogEvidence) -> None:
    """The estimate is as good then as with fine encoders; at 25 Hz rotors came out too small by many deviations."""
    assert max(clean_cutoffs(evidence.motions, evidence.rows)) < 20.0
    fine = gathered(coarse.guess, coarse.drives, [known(1, links=2, colour=0.0, duration=12.0).log])[0]
    assert clean_cutoffs(fine.motions, fine.rows) == sorted(fine.rows)
    found = identified(coarse.guess, coarse.drives, [coarse.log], friction=FrictionModel(), prior_weight=1e-3)
    truth = found.model.regrouping @ coarse.truth.inertial_parameters
    z = (found.estimate - truth) / found.deviations
    assert found.choice.settings.cutoff < 20.0
    assert np.mean(np.abs(z) < 2.0) > 0.85
    assert not any("instruments" in warning for warning in found.warnings)


def test_instruments_are_taken_where_a_cutoff_lets_the_noise_in(evidence: LogEvidence) -> None:
    freed, (said,) = without_position_noise(evidence, 25.0, None)
    assert freed.motions[0].log.rate == 0.5 * evidence.motions[0].log.rate
    assert "odd samples are the instruments of even ones" in said
    assert f"a cut-off of {evidence.band:.3g} Hz leaves most of it out" in said
    assert "not weak" in said
    assert without_position_noise(evidence, 25.0, False) == (evidence, ())
    assert without_position_noise(evidence, evidence.band, None) == (evidence, ())
