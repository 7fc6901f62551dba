"""Other estimators: instruments where encoders are noisy, and energy differences, which amplify."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
from nightly import nightly
from synthetic_logs import Known, known, motion

from adaptctl.cli.main import main
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.readers.entries import Tensor
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog
from adaptctl.identification.drives_file import PayloadEntry
from adaptctl.identification.energy_differences import by_energy, energy_rows
from adaptctl.identification.estimator_comparison import compared_estimators, validate_window
from adaptctl.identification.examples import example
from adaptctl.identification.files import _record
from adaptctl.identification.filtered_dynamics import Rows
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.gathering import gathered
from adaptctl.identification.identify import identified
from adaptctl.identification.instruments import freed_of_noise
from adaptctl.identification.least_squares import first_stage, halves, weighted_least_squares
from adaptctl.identification.preparation import prepare
from adaptctl.identification.report import report
from adaptctl.recording import scene, stream, views
from adaptctl.recording.colors import MUTED, joint_color, run_color


def noisy(seed: int, encoder: float) -> Known:
    case = known(seed, rate=200.0)
    off = encoder * np.random.default_rng(seed).normal(size=case.log.position.shape)
    return replace(case, log=replace(case.log, position=case.log.position + off))


@nightly
def test_instruments_forgive_noisy_encoders() -> None:
    errors = []
    for seed in (1, 3, 5):
        clean, case = known(seed, rate=200.0).log, noisy(seed, 1e-3)
        for instruments in (False, True):
            result = identified(
                case.guess,
                case.drives,
                [case.log],
                [clean],
                friction=FrictionModel(),
                cutoff=10.0,
                prior_weight=0.5,
                instrumental_variables=instruments,
            )
            errors.append(result.validation.relative_error)
    plain, instrumental = np.mean(np.reshape(errors, (-1, 2)), axis=0)
    assert instrumental < 0.85 * plain
    assert instrumental < 0.03


def test_instruments_leave_known_payloads_to_themselves() -> None:
    """The rows of a loaded arm are those of the arm alone, for either way of making them."""
    case = known(1)
    entry = PayloadEntry(
        log="synthetic",
        link=case.truth.description.body_names[-1],
        mass=2.0,
        center_of_mass=(0.1, -0.05, 0.02),
        inertia_at_center=Tensor(xx=0.01, yy=0.01, zz=0.01),
    )
    drives = replace(case.drives, payloads=(entry,))
    time, p, v, a = motion(3, np.random.default_rng(2), 5.0, 500.0)
    ten = from_center_of_mass(entry.mass, entry.center_of_mass, entry.inertia_at_center.matrix())
    values = case.truth.inertial_parameters.copy()
    values[20:30] += ten
    loaded = case.truth.with_parameters(values).inverse_dynamics(p, v, a)
    alone, carrying = (
        freed_of_noise(gathered(case.guess, turned, [JointLog("synthetic", time, p, torque)])[0])
        for turned, torque in ((case.drives, case.truth.inverse_dynamics(p, v, a)), (drives, loaded))
    )
    for cutoff, rows in alone.rows.items():
        heavy = np.sqrt(np.mean(rows.torque**2))
        np.testing.assert_allclose(carrying.rows[cutoff].torque, rows.torque, atol=1e-3 * heavy)


@nightly
def test_what_instruments_are_judged_on_begins_where_their_training_ends() -> None:
    case = known(1, rate=300.0, duration=8.0)
    logs = [case.log, case.log]
    freed = freed_of_noise(gathered(case.guess, case.drives, logs)[0])
    log, begins = freed.edges[round(0.6 * freed.blocks)]
    assert log == 1
    found = identified(
        case.guess,
        case.drives,
        logs,
        friction=FrictionModel(),
        cutoff=12.5,
        prior_weight=0.5,
        instrumental_variables=True,
    )
    period = 1.0 / (4.0 * found.validation.cutoff)
    assert begins <= found.validation.time[0] < begins + period


def test_two_stages_take_the_bias_of_noise_out_of_a_slope() -> None:
    """A column seen twice with independent noise of its size: least squares finds half, instruments the whole."""
    rng = np.random.default_rng(0)
    true = rng.normal(size=(20_000, 1, 1))
    first, second = (true + rng.normal(size=true.shape) for _ in range(2))
    torque = 3.0 * true[:, :, 0]
    time = np.arange(len(true)) * 0.01
    here = (np.zeros(len(time), dtype=np.int64), np.ones(len(time), dtype=np.bool_))
    rows, other = (Rows(10.0, time, Y, torque, torque, torque, *here) for Y in (first, second))

    def slope(rows: Rows) -> float:
        return float(np.sum(rows.regressor[:, :, 0] * torque) / np.sum(rows.regressor**2))

    assert abs(slope(rows) - 1.5) < 0.05
    assert abs(slope(first_stage(rows, other)) - 3.0) < 0.1


def test_even_and_odd_samples_are_of_the_same_times() -> None:
    time, p, v, _ = motion(3, np.random.default_rng(1), 4.0, 400.0)
    case = known(1)
    (piece,), _ = prepare(replace(case.log, time=time, position=p, torque=v), case.guess)
    even, odd = halves(piece)
    np.testing.assert_array_equal(even.time, odd.time)
    np.testing.assert_allclose(even.position, odd.position, atol=2e-4)
    np.testing.assert_allclose(even.position, p[2::2][: len(even.time)], atol=1e-12)
    assert even.rate == 0.5 * piece.rate


def test_energy_balance_is_exact_and_an_estimator_that_amplifies() -> None:
    """The work of exact torques is the energy's rise and friction's share; of torques that are off, the estimate from
    it is off many times as much as that from the momenta."""
    exact, off = known(5, noise=0.0), known(5, noise=0.02)
    ratios = {}
    for name, case in (("exact", exact), ("off", off)):
        evidence, _, _ = gathered(case.guess, case.drives, [case.log], cutoff=25.0)
        full, P = evidence.mechanism, len(evidence.mechanism.parameter_names)
        columns = np.array([c for c in evidence.independent(FrictionModel()) if c < P])
        values = dict(zip(case.truth.parameter_names, case.truth.inertial_parameters, strict=True))
        D = np.array([values.get(name, 0.0) for name in full.parameter_names])
        H, work = energy_rows(evidence.motions, full, 0.1)
        if name == "exact":
            assert np.sqrt(np.mean((H @ D - work) ** 2)) < 2e-3 * np.sqrt(np.mean(work**2))
        energetic = by_energy(evidence.motions, full, 0.1, columns)
        equations = evidence.sums(25.0, 0.0).over(range(evidence.blocks))
        by_momentum = weighted_least_squares(equations, columns)[0][:P]
        rows = evidence.rows[25.0]
        wrong = [np.linalg.norm(rows.regressor @ (x - D)) for x in (energetic, by_momentum)]
        ratios[name] = wrong[0] / np.linalg.norm(rows.regressor @ D), wrong[0] / wrong[1]
    assert ratios["exact"][0] < 0.03
    assert ratios["off"][1] > 3.0


def test_a_recording_shows_the_log_from_the_first_of_its_torques(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In the first run's colour, its torques in each joint's, beside what was measured."""
    case = known(5, links=2, duration=8.0, rate=200.0)
    found = identified(case.guess, case.drives, [case.log], [case.log], friction=FrictionModel(), prior_weight=1.0)
    seen = {name: MagicMock() for name in ("log_arm", "log_trail", "log_curves", "curves")}
    seen["curves"].side_effect = views.curves
    for name, spy in seen.items():
        monkeypatch.setattr({"log_curves": stream, "curves": views}.get(name, scene), name, spy)
    _record(found, report(found), tmp_path / "a.rrd", {})
    time = found.validation.time
    assert [call.kwargs["start"] for call in seen["curves"].call_args_list] == [time[0]] * 3
    assert [call.args[2] for call in seen["curves"].call_args_list] == [time[-1]] * 3
    assert [seen[name].call_args.args[-1] for name in ("log_arm", "log_trail")] == [run_color(0)] * 2
    (_, (_, *joints)) = seen["log_curves"].call_args.args
    assert len(joints) == 2
    for j, drawn in enumerate(joints):
        np.testing.assert_array_equal(drawn.values[:, 0], found.validation.measured[:, j])
        np.testing.assert_array_equal(drawn.values[:, 1], found.validation.predicted[:, j])
        assert drawn.colors == (MUTED, joint_color(j))


@nightly
def test_the_comparison_shows_it_on_a_real_log(tmp_path: Path) -> None:
    with example("tx40") as files:
        result = compared_estimators(files.log, files.robot, files.drives)
    exact, one, five, tenth, measured = result.measured
    assert five.off == pytest.approx(5.0 * one.off)
    assert tenth.off == pytest.approx(0.1 * measured.off)
    assert exact.momentum < 1e-3
    assert exact.energy < 0.1
    assert one.energy > 10.0 * one.momentum
    assert measured.energy > 10.0 * measured.momentum
    result.write(tmp_path, lambda what, share: None)
    assert json.loads((tmp_path / "summary.json").read_text())["torques"][-1]["energy"] == measured.energy
    assert (tmp_path / "recording.rrd").stat().st_size > 1000
    assert "energy differences" in (tmp_path / "report.html").read_text()


@nightly
def test_the_command_tells_of_energy_differences(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["identify", "tx40", "--energy-differences", "0.1", "--out", str(tmp_path / "out")]
    assert main([*line, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["energy_differences"]
    assert told[-1]["energy"] > 10.0 * told[-1]["momentum"]
    assert (tmp_path / "out" / "energy-differences" / "report.html").is_file()
    assert (tmp_path / "out" / "report.html").is_file()


def test_windows_that_are_too_long_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "tx40", "--energy-differences", "9", "--out", str(tmp_path / "two")]) == 2
    assert "expected windows of 0.01 to 2 s, got 9" in capsys.readouterr().err
    assert not (tmp_path / "two").exists()
    for window in (0.01, 2.0):
        validate_window(window)
    for window in (0.009, 2.1, float("nan")):
        with pytest.raises(InputError, match="expected windows"):
            validate_window(window)
