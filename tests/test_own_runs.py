"""Runs that were not simulated here: arrays, a logger, tables, plots, and comparisons that claim no truth."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import adaptctl
from adaptctl.control import ReferencePoint
from adaptctl.errors import FileError, InputError, LostSamplesWarning, NonFiniteError, NotFoundError
from adaptctl.recording import compared_runs, judged, shown, write_artifacts
from adaptctl.recording.result import answers
from adaptctl.recording.summary import summary

PERIOD, COUNT = 1e-3, 3000


def motion(dof: int = 2) -> dict[str, Any]:
    t = PERIOD * np.arange(COUNT)[:, None]
    reference = 0.3 * np.sin(2.0 * t + np.arange(dof))
    return {"p": reference + 0.01 * np.exp(-t), "torque": np.cos(t) * np.ones(dof), "reference_p": reference}


def test_what_is_missing_is_not_known() -> None:
    run = adaptctl.Rollout.from_arrays(**motion(), control_period=PERIOD)
    np.testing.assert_allclose(run.error, 0.01 * np.exp(-run.time)[:, None] * np.ones(2), atol=1e-15)
    assert np.isnan(run.energy).all()
    assert run.estimate.shape == (COUNT, 0)
    assert run.clipped.sum() == run.wall_time == 0
    assert not run.p.flags.writeable


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"p": np.zeros(5)}, InputError, r"p: expected shape \(T, r\)"),
        ({"torque": np.zeros((COUNT, 3))}, InputError, r"torque: expected"),
        ({"torque": np.zeros((7, 2))}, InputError, r"torque: expected shape \(3000, 2\), got \(7, 2\)"),
        ({"reference_p": np.full((COUNT, 2), np.nan)}, NonFiniteError, "reference_p"),
        ({"control_period": 0.0}, InputError, "control_period: expected a positive time"),
        ({"time": np.zeros(COUNT)}, InputError, "time: expected 3000 increasing numbers"),
        ({"estimate": np.zeros((3, 4))}, InputError, r"estimate: expected shape \(3000, 4\)"),
        ({"v": "fast"}, InputError, "v"),
    ],
)
def test_arrays_that_are_refused(change: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        adaptctl.Rollout.from_arrays(**{**motion(), "control_period": PERIOD, **change})


def test_a_run_goes_to_tables_files_and_pictures(tmp_path: Path) -> None:
    run = adaptctl.Rollout.from_arrays(**motion(), control_period=PERIOD, estimate=np.ones((COUNT, 3)))
    table = run.to_arrow(["waist", "elbow"])
    assert {"time", "p.waist", "torque.elbow", "estimate.2"} <= set(table.column_names)
    assert table.schema.field("p.waist").metadata == {b"unit": b"rad"}
    np.testing.assert_array_equal(table["p.elbow"].to_numpy(), run.p[:, 1])
    run.save(tmp_path / "run.parquet")
    np.testing.assert_array_equal(adaptctl.Rollout.load(tmp_path / "run.parquet").estimate, run.estimate)
    figure = replace(run, joints=("waist", "elbow")).plot()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["waist", "elbow"]
    assert len(figure.axes) == 4
    shown = run._repr_html_()
    assert "3,000 control periods of 0.001 s, 2 joints; completed" in shown
    assert "RMS error over the last 2 s: 1.82 mrad" in shown  # 0.01 exp(-t) from 1 s to 3 s
    with pytest.raises(InputError, match="joints: expected 2 names, got 1"):
        run.plot(["waist"])


WITHOUT_PANDAS = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "pandas":
            raise ModuleNotFoundError("No module named 'pandas'", name="pandas")

sys.meta_path.insert(0, Missing())
import numpy as np, adaptctl

p = np.zeros((5, 2))
adaptctl.Rollout.from_arrays(p, p, p, 1e-3).to_pandas()
"""


def test_pandas_is_asked_for_where_it_is_missing() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT_PANDAS], capture_output=True, text=True, timeout=60)
    assert done.stderr.strip().endswith("MissingExtraError: Rollout.to_pandas needs pandas: pip install pandas")


def logged(log: adaptctl.RunLogger, count: int, **more: Any) -> None:
    for k in range(count):
        one = np.full(2, float(k))
        log.append(k * PERIOD, one, 2 * one, ReferencePoint(3 * one, 4 * one, 5 * one), 6 * one, **more)


def test_a_logger_keeps_what_it_was_given(tmp_path: Path) -> None:
    with adaptctl.RunLogger(2, PERIOD, tmp_path / "log.parquet", estimates=3) as log:
        logged(log, 50, estimate=np.arange(3.0), applied=np.zeros(2))
    run = adaptctl.Rollout.load(tmp_path / "log.parquet")
    k = np.arange(50.0)[:, None] * np.ones(2)
    for name, factor in (("p", 1), ("v", 2), ("reference_p", 3), ("reference_v", 4), ("reference_a", 5), ("torque", 6)):
        np.testing.assert_array_equal(getattr(run, name), factor * k)
    assert run.reached_end
    assert run.clipped.sum() == 49
    np.testing.assert_array_equal(run.estimate, np.arange(3.0) * np.ones((50, 1)))


def test_a_full_logger_keeps_the_latest_and_says_so_once(tmp_path: Path) -> None:
    warned = pytest.warns(LostSamplesWarning, match="of 25 samples, 15 were overwritten and 0 omitted")
    with warned, adaptctl.RunLogger(2, PERIOD, tmp_path / "log.parquet", capacity=10) as log:
        logged(log, 25)
        assert log.lost == 15
    run = adaptctl.Rollout.load(tmp_path / "log.parquet")
    np.testing.assert_array_equal(run.p[:, 0], np.arange(15.0, 25.0))


def test_what_does_not_fit_never_stops_a_loop() -> None:
    log, zero = adaptctl.RunLogger(2, PERIOD), np.zeros(2)
    still = ReferencePoint(zero, zero, zero)
    for wrong in (np.zeros(3), np.array([np.nan, 0.0]), "x", None):
        log.append(0.0, wrong, zero, still, zero)
    assert (log.count, log.faulty) == (0, 4)
    with pytest.raises(InputError, match=r"at least 2 samples, got 0 \(4 faulty\)"):
        log.rollout()
    log.append(0.0, zero, zero, still, zero)
    with pytest.raises(InputError, match="at least 2 samples, got 1"):
        log.rollout()
    log.append(PERIOD, zero, zero, still, zero)
    assert len(log.rollout().time) == 2


def test_a_faulty_sample_takes_no_place_in_a_full_log() -> None:
    log, zero = adaptctl.RunLogger(2, PERIOD, capacity=3), np.zeros(2)
    still = ReferencePoint(zero, zero, zero)
    for k in range(4):
        log.append(k * PERIOD, np.full(2, float(k)), zero, still, zero)
    log.append(1.0, np.array([np.nan, 0.0]), zero, still, zero)
    log.append(1.0, np.zeros(3), np.zeros(1), still, zero)
    log.append(1.0, zero, zero, 3, zero)  # type: ignore[arg-type]
    assert (log.count, log.faulty) == (4, 3)
    np.testing.assert_array_equal(log.rollout().p[:, 0], [1.0, 2.0, 3.0])


def test_a_loop_that_fails_leaves_its_log(tmp_path: Path) -> None:
    def failing() -> None:
        with adaptctl.RunLogger(2, PERIOD, tmp_path / "log.parquet") as log:
            logged(log, 5)
            raise RuntimeError("the cable fell out")

    with pytest.raises(RuntimeError, match="cable"):
        failing()
    assert adaptctl.Rollout.load(tmp_path / "log.parquet").interrupted


def test_a_place_that_cannot_be_written_is_refused_before_the_loop(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"no/log\.parquet: the folder .* does not exist"):
        adaptctl.RunLogger(2, PERIOD, tmp_path / "no" / "log.parquet")
    with pytest.raises(FileError, match=r"cannot be written \(is a directory\)"):
        adaptctl.RunLogger(2, PERIOD, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"capacity": 10**12}, r"capacity: 1000000000000 samples need .* GB, but this computer has"),
        ({"capacity": 1}, "capacity: expected a whole number of at least 2, got 1"),
        ({"estimates": -1}, "estimates: expected a whole number"),
        ({"dof": 0}, "dof: expected a whole number"),
        ({"control_period": -1.0}, "control_period"),
    ],
)
def test_loggers_that_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        adaptctl.RunLogger(**{"dof": 2, "control_period": PERIOD, **settings})


def test_a_logged_sample_costs_microseconds() -> None:
    log, zero = adaptctl.RunLogger(6, PERIOD, estimates=36), np.zeros(6)
    point, estimate = ReferencePoint(zero, zero, zero), np.zeros(36)
    started = time.process_time()
    for _ in range(20_000):
        log.append(0.0, zero, zero, point, zero, zero, estimate)
    assert time.process_time() - started < 20_000 * 1e-4  # a tenth of a control period, on any machine


@pytest.fixture(scope="module")
def arm() -> adaptctl.Mechanism:
    return adaptctl.load("two_link")


def runs_of(arm: adaptctl.Mechanism, estimates: int) -> dict[str, adaptctl.Rollout]:
    given = {**motion(arm.dof), "control_period": PERIOD}
    return {
        "bench, learning": adaptctl.Rollout.from_arrays(**given, estimate=np.ones((COUNT, estimates))),
        "bench, off": adaptctl.Rollout.from_arrays(**{**given, "p": given["p"] + 0.05}),
    }


def test_runs_of_an_unknown_truth_claim_nothing_of_it(arm: adaptctl.Mechanism, tmp_path: Path) -> None:
    model = adaptctl.ReducedModel(arm)
    runs = runs_of(arm, len(model.names))
    compared = compared_runs(arm, runs, adaptation_off="bench, off")
    assert compared.title == f"{arm.name}: bench, learning"
    assert [run.name for run in compared.runs] == [f"run{k}" for k in range(1, len(runs) + 1)]
    assert compared_runs(arm, runs, title="On the bench").title == "On the bench"
    assert judged(compared).passed
    told = shown(compared)
    assert "Knowing" not in told.headline
    assert "Without adaptation, it remains at" in told.headline
    assert "Simulated" not in answers(told.facts)
    assert {row["true"] for row in summary(compared)["parameters"].values()} == {None}
    write_artifacts(tmp_path, compared)
    report = (tmp_path / "report.html").read_text()
    assert "The true parameters are unknown" in report
    assert json.loads((tmp_path / "summary.json").read_text())["truth_known"] is False


def test_where_the_truth_is_known_it_is_shown(arm: adaptctl.Mechanism) -> None:
    model = adaptctl.ReducedModel(arm)
    known = summary(compared_runs(arm, runs_of(arm, len(model.names)), truth_known=True))["parameters"]
    assert [row["true"] for row in known.values()] == pytest.approx(model.fundamental_parameters.tolist())


def test_runs_without_estimates_are_shown_too(arm: adaptctl.Mechanism, tmp_path: Path) -> None:
    write_artifacts(tmp_path, compared_runs(arm, runs_of(arm, 0)))
    assert json.loads((tmp_path / "summary.json").read_text())["parameters"] == {}


def test_runs_that_are_refused(arm: adaptctl.Mechanism) -> None:
    with pytest.raises(InputError, match="at least one run"):
        compared_runs(arm, {})
    with pytest.raises(InputError, match=r"expected estimates of .* parameters or none, got 7"):
        compared_runs(arm, runs_of(arm, 7))
    with pytest.raises(NotFoundError, match="unknown run 'none'"):
        compared_runs(arm, runs_of(arm, 0), adaptation_off="none")
    with pytest.raises(InputError, match="expected 6 joints, got"):
        compared_runs(adaptctl.load("puma560_measured"), runs_of(arm, 0))


@pytest.mark.parametrize(
    ("limits", "error", "message"),
    [
        (-1.0, InputError, "torque_limits: expected 2 positive numbers, got"),
        ([1.0, 0.0], InputError, "torque_limits: expected 2 positive numbers, got"),
        (np.inf, NonFiniteError, "torque_limits: expected finite numbers, got inf"),
        (np.nan, NonFiniteError, "torque_limits"),
        (np.ones(5), InputError, "torque_limits: expected a number or 2 of them"),
        ([[1.0], [1.0, 2.0]], InputError, "torque_limits: expected numbers"),
    ],
)
def test_torque_limits_that_are_refused(
    arm: adaptctl.Mechanism, limits: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        compared_runs(arm, runs_of(arm, 0), torque_limits=limits)
