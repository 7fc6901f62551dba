"""Settings of experiments from files and finished runs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from comparisons import comparison

from adaptctl.cli.main import app, main
from adaptctl.dynamics import load
from adaptctl.errors import InputError
from adaptctl.experiments import EXPERIMENTS, find
from adaptctl.experiments.experiment import Experiment, settings, stated
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.recording.summary import sealed, summary

RUN = ["experiment", "run", "puma560-adaptive"]
SUMMARY = summary(comparison(load("two_link")))


def read(*words: str) -> Experiment:
    """Experiment with the settings that the command line has."""
    _, bound, _ = app.parse_args(words)
    found: Experiment = bound.arguments["settings"]
    return found


def finished(experiment: Experiment, folder: Path) -> Path:
    """Folder with the summary of an experiment."""
    folder.mkdir()
    told = {one.name: one.value for one in stated(experiment)} | {"Λ": "8, 8"}
    (folder / "summary.json").write_text(json.dumps(sealed(SUMMARY | {"settings": told})))
    return folder


def is_allowed(experiment: Any, name: str, value: float) -> bool:
    try:
        replace(experiment, **{name: value})
    except InputError:
        return False
    return True


@pytest.mark.parametrize("name", [entry.name for entry in EXPERIMENTS])
def test_a_finished_run_s_settings_are_read_back_the_same(name: str, tmp_path: Path) -> None:
    first: Any = find(name)()
    thirds = {one.name: getattr(first, one.name) * 4.0 / 3.0 for one in settings(first) if type(one.default) is float}
    changed = replace(first, **{one: value for one, value in thirds.items() if is_allowed(first, one, value)})
    assert read("experiment", "run", name, "--config", str(finished(changed, tmp_path / "a"))) == changed


def test_flags_take_precedence_over_a_file(tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text("duration = 2.5\ndamping = [90, 150, 70.5, 20, 16, 18]\nmeasure_step_time = true\n")
    found = read(*RUN, "--config", str(file), "--duration", "2.25")
    damping = (90.0, 150.0, 70.5, 20.0, 16.0, 18.0)
    assert found == Puma560Adaptive(duration=2.25, damping=damping, measure_step_time=True)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("durations = 1", "durations: no setting of this experiment (did you mean 'duration'?)"),
        ("out = 'a'", "out: no setting of this experiment"),
        ("duration = [1, 2]", "duration: expected one value, got 2"),
        ("damping = {a = 1}", "damping: expected numbers or texts, got {'a': 1}"),
        ("duration = 'a'", "a.toml: --duration: expected a number in s, got 'a'"),
        ("seed = 1.5", "a.toml: --seed: expected a whole number, got '1.5'"),
        ("duration = nan", "expected a finite number, got nan"),
        ("duration = -1", "duration: expected a number from 0.01 to 300, got -1"),
        ("duration = ", "not valid TOML"),
    ],
)
def test_what_a_file_has_wrong_is_named(
    text: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.toml").write_text(text)
    assert main([*RUN, "--config", str(tmp_path / "a.toml"), "--out", str(tmp_path / "out")]) != 0
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert says in line
    assert not (tmp_path / "out").exists()


def test_a_folder_without_settings_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "summary.json").write_text(json.dumps(sealed(SUMMARY | {"settings": {}})))
    assert main([*RUN, "--config", str(tmp_path)]) == 2
    assert "its experiment has no settings" in capsys.readouterr().err
    assert main([*RUN, "--config", str(tmp_path / "none")]) == 2
    assert "cannot be read (no such file or directory)" in capsys.readouterr().err
