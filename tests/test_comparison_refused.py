"""Comparisons that cannot be shown are refused, and a folder of one holds all of its files or none."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from adaptctl.dynamics import load
from adaptctl.errors import FileError, InputError, NonFiniteError
from adaptctl.recording import Comparison, Finding, TaskError, write_artifacts
from adaptctl.recording.drawing import Drawing
from adaptctl.recording.figures import lyapunov
from adaptctl.recording.judgement import facts
from adaptctl.recording.result import answers
from adaptctl.recording.summary import summary
from tests.comparisons import comparison

SAMPLES = 1200
FILES = ["figures", "recording.rrd", "report.html", "summary.json", "trace.parquet"]


@pytest.fixture(scope="module")
def shown() -> Comparison:
    return comparison(load("two_link"), SAMPLES)


@pytest.mark.parametrize(
    ("limits", "error", "message"),
    [
        (np.ones(5), InputError, r"torque_limits: expected shape \(..., 2\), got \(5,\)"),
        (np.ones((1, 2)), InputError, "torque_limits: expected 2 positive numbers"),
        (np.array([1.0, -1.0]), InputError, "torque_limits: expected 2 positive numbers"),
        (np.zeros(2), InputError, "torque_limits: expected 2 positive numbers"),
        (np.array([1.0, np.inf]), NonFiniteError, "torque_limits: expected finite numbers, got inf"),
    ],
)
def test_torque_limits_are_positive_and_finite(
    shown: Comparison, limits: np.ndarray, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        replace(shown, torque_limits=limits)


def test_two_runs_of_one_name_are_refused(shown: Comparison) -> None:
    with pytest.raises(InputError, match="runs: expected unique names, got 'adaptive' twice"):
        replace(shown, runs=(shown.subject, shown.subject))


def test_every_run_has_its_task_errors(shown: Comparison) -> None:
    errors = {run.name: np.zeros(SAMPLES) for run in shown.runs}
    assert replace(shown, task_error=TaskError("Distance", "mm", errors)).task_error is not None
    for wrong in ({"adaptive": np.zeros(SAMPLES)}, {**errors, "adaptation-off": np.zeros(3)}):
        with pytest.raises(InputError, match=r"task_error: errors of 'adaptation-off': expected shape \(1200,\), got"):
            replace(shown, task_error=TaskError("Distance", "mm", wrong))


@pytest.mark.parametrize("window", [np.nan, np.inf, -1.0, 0.0, "x"])
def test_windows_are_positive_and_finite(shown: Comparison, window: float) -> None:
    with pytest.raises(InputError, match="window: expected a positive number of s"):
        shown.subject.moving_rms_error(window)


def test_a_window_longer_than_any_run_is_all_that_has_passed(shown: Comparison) -> None:
    assert shown.subject.moving_rms_error(1e300)[-1] == pytest.approx(shown.subject.rms_error(), rel=1e-12)


def test_an_error_is_that_of_some_joint(shown: Comparison) -> None:
    for joints in ([], slice(0, 0)):
        with pytest.raises(InputError, match="joints: expected at least one joint"):
            shown.subject.rms_error(joints=joints)


@pytest.mark.parametrize("hole", [np.nan, np.inf])
def test_a_lyapunov_function_with_holes_is_not_said_to_never_rise(shown: Comparison, hole: float) -> None:
    values = np.linspace(2.0, 1.0, SAMPLES)
    values[7] = hole
    holed = replace(shown, runs=(replace(shown.subject, lyapunov=values), shown.runs[1]))
    assert holed.subject.lyapunov_max_increase is None
    assert summary(holed)["lyapunov_max_increase"] is None
    assert answers(facts(holed))["Lyapunov function"] == "unknown: not finite"
    with np.errstate(invalid="ignore"):
        assert "no step with an increase" not in [
            text.get_text() for axes in lyapunov(holed).axes for text in axes.texts
        ]


def failing() -> Figure:
    raise RuntimeError("it cannot be drawn")


def interrupted(what: str, share: float) -> None:
    if share > 0.9:
        raise KeyboardInterrupt


def not_drawn(folder: Path, shown: Comparison) -> None:
    write_artifacts(folder, replace(shown, more_drawings=(Drawing("bad", "Bad.", failing),)))


def not_finite(folder: Path, shown: Comparison) -> None:
    write_artifacts(folder, replace(shown, duration=np.nan))


def stopped(folder: Path, shown: Comparison) -> None:
    write_artifacts(folder, shown, interrupted)


@pytest.mark.parametrize(
    ("write", "error"), [(not_drawn, RuntimeError), (not_finite, FileError), (stopped, KeyboardInterrupt)]
)
def test_what_fails_leaves_the_folder_as_it_was(
    shown: Comparison, tmp_path: Path, write: Callable[[Path, Comparison], None], error: type[BaseException]
) -> None:
    with pytest.raises(error):
        write(tmp_path / "new", shown)
    assert not (tmp_path / "new").exists()
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "summary.json").write_text("old")
    with pytest.raises(error):
        write(tmp_path / "old", shown)
    assert [path.name for path in (tmp_path / "old").iterdir()] == ["summary.json"]
    assert (tmp_path / "old" / "summary.json").read_text() == "old"


def test_a_failure_names_the_place_that_was_asked_for(shown: Comparison, tmp_path: Path) -> None:
    with pytest.raises(FileError) as told:
        not_finite(tmp_path / "out", shown)
    assert str(told.value).startswith(f"{tmp_path / 'out' / 'summary.json'}: expected a finite number, got nan")


def test_a_finding_that_is_no_number_is_null(shown: Comparison, tmp_path: Path) -> None:
    write_artifacts(tmp_path, replace(shown, findings=(Finding("bad", np.nan, "m", "bad"),)))
    assert json.loads((tmp_path / "summary.json").read_text())["findings"] == {"bad": {"value": None, "unit": "m"}}


def test_a_folder_in_the_place_of_a_file_is_said_before_any_is_written(shown: Comparison, tmp_path: Path) -> None:
    (tmp_path / "trace.parquet").mkdir()
    with pytest.raises(FileError, match=r"trace\.parquet: cannot be written \(is a directory\)"):
        write_artifacts(tmp_path, shown)
    assert [path.name for path in tmp_path.iterdir()] == ["trace.parquet"]


def test_other_files_stay_and_old_ones_are_replaced(shown: Comparison, tmp_path: Path) -> None:
    for name in ("summary.json", "settings.toml"):
        (tmp_path / name).write_text("old")
    write_artifacts(tmp_path, shown)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*FILES, "settings.toml"])
    assert (tmp_path / "summary.json").read_text() != "old"
    assert (tmp_path / "settings.toml").read_text() == "old"
