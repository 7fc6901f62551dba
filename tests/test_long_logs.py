"""Long logs: their rows are made stretch by stretch, and the normal equations are those of all at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nightly import at_night
from synthetic_logs import Known, known

from adaptctl.identification import long_logs
from adaptctl.identification.columns import JointLog
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.gathering import gathered
from adaptctl.identification.long_logs import LongEvidence


@pytest.fixture(scope="module")
def case() -> Known:
    return known(7, duration=40.0, rate=200.0)


def resting(log: JointLog) -> JointLog:
    """The same log, with a rest of three seconds instead of its last ones."""
    rows = np.insert(np.arange(len(log.time)), 3000, np.full(600, 3000))[: len(log.time)]
    return replace(log, position=log.position[rows], torque=log.torque[rows])


@pytest.fixture
def both(case: Known, monkeypatch: pytest.MonkeyPatch) -> tuple[LogEvidence, LogEvidence]:
    """Evidence of all rows at once, and in stretches."""
    logs = [case.log, resting(case.log)]
    whole = gathered(case.guess, case.drives, logs)[0]
    monkeypatch.setattr(long_logs, "LONG", 0)
    monkeypatch.setattr(long_logs, "KEPT", 7_000_000)
    monkeypatch.setattr(long_logs, "STRETCH", 1500)
    return whole, gathered(case.guess, case.drives, logs)[0]


@pytest.mark.parametrize("delay", [at_night(0.0), 0.004])
def test_sums_over_stretches_are_those_of_all_rows(both: tuple[LogEvidence, LogEvidence], delay: float) -> None:
    whole, long = (one.advanced(delay) if delay else one for one in both)
    assert isinstance(long, LongEvidence)
    assert long.stretches.edges == whole.edges
    for cutoff in whole.rows:
        for slow, lasting in ((0.0, ()), (0.02, ()), (0.02, (0.3, 0.0, 1.0))):
            for part in ("normal", "moment", "square", "count"):
                one, other = (getattr(evidence.sums(cutoff, slow, lasting), part) for evidence in (whole, long))
                np.testing.assert_allclose(other, one, rtol=1e-10, atol=1e-10 * np.abs(one).max())


def test_fits_are_those_of_all_rows_and_fewer_rows_are_kept(both: tuple[LogEvidence, LogEvidence]) -> None:
    settings = FitSettings(FrictionModel(), 1.0, both[0].band)
    whole, long = (evidence.part(range(3, 15)).fit(settings, range(12)).x for evidence in both)
    np.testing.assert_allclose(long, whole, rtol=1e-9, atol=1e-9 * np.abs(whole).max())
    assert len(both[1].rows[both[1].band]) < 0.6 * len(both[0].rows[both[0].band])
