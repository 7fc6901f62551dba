"""Custom experiments: a file, or an entry point, without touching the package."""

from __future__ import annotations

import json
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from adaptctl.cli.main import main
from adaptctl.errors import InputError
from adaptctl.experiments import EXPERIMENTS, GROUP, from_entry_point
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive

OWN = Path("docs/examples/my_experiment.py")


def test_a_file_is_an_experiment(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["experiment", "run", str(OWN), "--duration", "2.5", "--bandwidth", "6", "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["experiment"], summary["settings"]["--bandwidth"]) == ("my-experiment", "6")
    assert (out / "report.html").exists()
    assert "RMS error" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected one class of an experiment, a subclass of Experiment, found 0"),
        ("import nothing_of_that_name", "ModuleNotFoundError: .* \\(line 1\\)"),
        ("x = 1\nx.y", "AttributeError: .* \\(line 2\\)"),
        ("def f(:", "SyntaxError: .* \\(line 1\\)"),
        (f"{OWN.read_text()}\nclass Two(MyExperiment):\n    pass\n", "found 2: MyExperiment, Two"),
    ],
)
def test_files_that_are_refused(text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.py").write_text(text)
    assert main(["experiment", "run", str(tmp_path / "mine.py"), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    with pytest.raises(InputError, match=message):
        raise InputError(line)
    assert not (tmp_path / "out").exists()


def test_notes_of_an_experiment_that_fails_are_shown_before_its_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    failing = """
    def run(self, progress):
        warnings.warn("my_arm: a spring is left out", SimplificationWarning)
        raise InputError("my_arm: it fell over")
"""
    imports = "import warnings\n\nfrom adaptctl.errors import InputError, SimplificationWarning\n"
    (tmp_path / "mine.py").write_text(imports + OWN.read_text() + failing)
    assert main(["experiment", "run", str(tmp_path / "mine.py"), "--out", str(tmp_path / "out")]) == 2
    note, error = capsys.readouterr().err.strip().splitlines()
    assert note == "adaptctl: note: my_arm: a spring is left out"
    assert error == "adaptctl: my_arm: it fell over"


def test_a_file_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["experiment", "run", "none.py"]) == 2
    assert "none.py: no such file" in capsys.readouterr().err


def test_entry_points_name_classes() -> None:
    point = EntryPoint("mine", "adaptctl.experiments.puma560_adaptive:Puma560Adaptive", GROUP)
    assert from_entry_point(point) is Puma560Adaptive
    for value, message in (("adaptctl.cli.main:main", "expected a subclass"), ("nothing:No", "ModuleNotFoundError")):
        with pytest.raises(InputError, match=message):
            from_entry_point(EntryPoint("mine", value, GROUP))


def test_installed_experiments_are_found_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    package = tmp_path / "mine-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (package / "entry_points.txt").write_text("[adaptctl.experiments]\nmine = mine_module:MyExperiment\n")
    (tmp_path / "mine_module.py").write_text(OWN.read_text())
    monkeypatch.syspath_prepend(str(tmp_path))
    assert main(["experiment", "list"]) == 0
    assert "from mine_module:MyExperiment" in capsys.readouterr().out
    assert main(["experiment", "list", "--json"]) == 0
    *built_in, mine = json.loads(capsys.readouterr().out)["experiments"]
    assert [entry["name"] for entry in built_in] == [entry.name for entry in EXPERIMENTS]
    assert mine == {"name": "mine", "summary": "from mine_module:MyExperiment"}
    out = tmp_path / "out"
    assert main(["experiment", "run", "mine", "--duration", "0.2", "--out", str(out)]) == 0
    assert (out / "summary.json").exists()
