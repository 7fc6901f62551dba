"""The comparison of estimators on a log of two links, and its parts on a few numbers."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from synthetic_logs import Known, known

from adaptctl.identification import estimator_comparison
from adaptctl.identification.estimator_comparison import (
    Amplification,
    TorqueCase,
    _error,
    _fitted,
    _torques,
    _until,
    _with_torques,
    compared_estimators,
)
from adaptctl.identification.fit import LogEvidence
from adaptctl.identification.gathering import gathered
from adaptctl.recording.page import Report


@pytest.fixture(scope="module")
def case() -> Known:
    return known(5, links=2, noise=0.02, duration=6.0, rate=100.0)


@pytest.fixture(scope="module")
def evidence(case: Known) -> LogEvidence:
    return gathered(case.guess, case.drives, [case.log], cutoff=25.0)[0]


@pytest.fixture
def read(case: Known, evidence: LogEvidence, monkeypatch: pytest.MonkeyPatch) -> tuple[str, Any, str]:
    """What is compared, as if it were in files."""
    monkeypatch.setattr(estimator_comparison, "read_drives", lambda _: case.drives)
    monkeypatch.setattr(estimator_comparison, "read_log", lambda _: None)
    monkeypatch.setattr(estimator_comparison, "joint_log", lambda *_: case.log)
    monkeypatch.setattr(estimator_comparison, "gathered", lambda *_, cutoff: [evidence])
    return "log.csv", case.guess, "drives.toml"


def true_parameters(case: Known, evidence: LogEvidence) -> Any:
    values = dict(zip(case.truth.parameter_names, case.truth.inertial_parameters, strict=True))
    return np.array([values.get(name, 0.0) for name in evidence.mechanism.parameter_names])


def test_torques_of_true_parameters_are_those_of_the_log_but_for_its_noise(case: Known, evidence: LogEvidence) -> None:
    clean = known(5, links=2, noise=0.0, duration=6.0, rate=100.0).log.torque
    inside = slice(50, -50)
    found = _torques(evidence, true_parameters(case, evidence))
    assert len(found) == len(clean)
    assert np.linalg.norm((found - clean)[inside]) < 5e-3 * np.linalg.norm(clean[inside])


def test_both_estimators_are_fitted_to_five_kinds_of_torques(
    case: Known, evidence: LogEvidence, read: tuple[str, Any, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    model, asked = estimator_comparison._model(evidence), []

    def fitted(own: LogEvidence, window: float) -> tuple[Any, Any]:
        asked.append((own.motions[0].log.torque, window))
        return model, 3.0 * model

    monkeypatch.setattr(estimator_comparison, "_fitted", fitted)
    found = compared_estimators(*read, 0.2, 3)
    (truth, *others), windows = zip(*asked, strict=True)
    residual = case.log.torque - truth
    noise = np.random.default_rng(3).normal(size=truth.shape) * np.sqrt((truth**2).mean(axis=0))
    off = [0.01 * noise, 0.05 * noise, 0.1 * residual, residual]
    np.testing.assert_allclose(truth, _torques(evidence, model), rtol=1e-12)
    np.testing.assert_allclose(np.array(others) - truth, off, atol=1e-9)
    assert [c.off for c in found.measured[1:]] == pytest.approx(
        np.linalg.norm(off, axis=(1, 2)) / np.linalg.norm(truth)
    )
    np.testing.assert_allclose([(c.momentum, c.energy) for c in found.measured], [(0.0, 2.0)] * 5, rtol=1e-12)
    assert (found.measured[0].off, set(windows), found.window, found.seed) == (0.0, {0.2}, 0.2, 3)


def test_rows_have_the_torques_that_a_log_is_given(case: Known, evidence: LogEvidence) -> None:
    doubled = _with_torques(evidence, 2.0 * case.log.torque)
    assert list(doubled.rows) == list(evidence.rows)
    for cutoff, rows in doubled.rows.items():
        np.testing.assert_allclose(rows.torque, 2.0 * evidence.rows[cutoff].torque, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(rows.regressor, evidence.rows[cutoff].regressor)


def test_energies_are_compared_over_the_part_that_filtered_dynamics_is_fitted_to(
    evidence: LogEvidence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three fifths of twenty blocks, up to the beginning of the next one."""
    motion, end = evidence.motions[0], evidence.edges[12][1]
    times = motion.log.time[motion.first :: motion.every][: len(motion.position)]
    for until, count in ((times[7], 7), (times[7] + 1e-6, 8), (np.inf, len(times))):
        short = _until(motion, until)
        np.testing.assert_array_equal(short.position, motion.position[:count])
        np.testing.assert_array_equal(short.velocity, motion.velocity[:count])
    seen: list[Any] = []
    monkeypatch.setattr(estimator_comparison, "by_energy", lambda *given: seen.extend(given))
    x, _ = _fitted(evidence, 0.3)
    assert len(seen[0][0].position) == (times < end).sum() < len(times)
    assert seen[2] == 0.3
    settings = estimator_comparison.SETTINGS
    np.testing.assert_allclose(x, evidence.ordinary(settings, range(12)), rtol=1e-9)
    np.testing.assert_array_equal(seen[3], evidence.independent(settings))


def test_predictions_are_judged_from_the_first_row_that_was_held_out() -> None:
    rng = np.random.default_rng(0)
    Y, truth, x = rng.normal(size=(5, 2, 3)), rng.normal(size=3), rng.normal(size=3)
    rows = SimpleNamespace(time=np.arange(5.0), regressor=Y)
    edges = [(0, float(start)) for start in range(5)]
    found: Any = SimpleNamespace(rows={25.0: SimpleNamespace(moved=rows)}, edges=edges, blocks=5)
    assert _error(found, x, truth) == pytest.approx(np.linalg.norm(Y[3:] @ (x - truth)) / np.linalg.norm(Y[3:] @ truth))


def test_the_report_tells_of_exact_and_of_measured_torques(monkeypatch: pytest.MonkeyPatch) -> None:
    cases = (TorqueCase("exact", 0.0, 0.0012, 0.034), TorqueCase("some", 0.01, 0.02, 0.1))
    found = Amplification("arm", 0.1, (*cases, TorqueCase("measured", 0.05, 0.06, 0.42)), 7)
    report = found.report()
    for number in ("3.40%", "42%", "6.0%", "factor of 7 "):
        assert number in report.outcome
    assert [fact.question for fact in report.facts] == ["exact", "some", "measured"]
    written: list[Any] = []
    monkeypatch.setattr(Report, "write", lambda *given, progress: written.extend(given))
    found.write(Path("out"))
    assert (written[0], written[1]) == (report, Path("out"))
    assert (written[2]["window"], written[2]["torques"][1]["energy"]) == (0.1, 0.1)
