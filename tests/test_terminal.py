"""What the command line shows fits the terminal and loses no number, and scripts get JSON."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import warnings
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy
import pytest
from cyclopts import App
from hypothesis import given
from hypothesis import strategies as st
from nightly import nightly
from rich.console import Console

from adaptctl.cli.doctor import examined
from adaptctl.cli.experiment import _computed
from adaptctl.cli.main import _warnings_as_notes, _write_any_character, main
from adaptctl.cli.output import WrappedTable, listed, titled
from adaptctl.compilation.object_cache import ObjectCache
from adaptctl.errors import ReferenceWarning, TuningWarning

ARM = "puma560_arm3"
EXPERIMENT = ("experiment", "run", "adaptive", "--robot", ARM, "--duration", "0.05")


def told(capsys: pytest.CaptureFixture[str], *command: str) -> dict[str, object]:
    assert main(command) == 0
    return json.loads(capsys.readouterr().out)


def drawn(table: WrappedTable, width: int) -> str:
    console = Console(width=width, force_terminal=False)
    with console.capture() as captured:
        console.print(table)
    return captured.get()


@given(
    width=st.integers(24, 120),
    rows=st.lists(st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6), min_size=1, max_size=4),
)
def test_tables_lose_no_number_whatever_the_width(width: int, rows: list[list[float]]) -> None:
    texts = [[f"{x:.4g}" for x in row] for row in rows]
    table = WrappedTable(("joint", *"abcdef"), [[f"j{i}", *row] for i, row in enumerate(texts)])
    lines = drawn(table, width).splitlines()
    assert max(map(len, lines)) <= width
    for i, row in enumerate(texts):
        shown = [word for line in lines if line.split()[:1] == [f"j{i}"] for word in line.split()[1:]]
        assert shown == row


def test_what_is_below_a_title_is_indented_and_stands_alone(capsys: pytest.CaptureFixture[str]) -> None:
    Console(width=20).print(titled("Title", "one", "two"))
    assert [line.rstrip() for line in capsys.readouterr().out.splitlines()] == ["", "Title", "  one", "  two"]
    Console(width=20).print(listed([("one", "two")], whole=True))
    assert capsys.readouterr().out.split("\n") == ["one  two", ""]


def validate_whole(found: dict[str, object], text: str) -> None:
    assert "…" not in text
    for joint in found["joints"]:  # type: ignore[attr-defined]  # as JSON has them
        for name in ("inertia", "stiffness", "rate", "slotine_li_damping"):
            assert f"{joint[name]:.4g}" in text.split()


@pytest.mark.parametrize("columns", ["40", "80", "200"])
def test_gains_are_whole_at_any_width(
    columns: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = told(capsys, "gains", ARM, "--json")
    monkeypatch.setenv("COLUMNS", columns)
    assert main(["gains", ARM]) == 0
    text = capsys.readouterr().out
    validate_whole(found, text)
    assert max(map(len, text.splitlines())) <= max(int(columns), 80)


@nightly
def test_gains_are_whole_into_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    found = told(capsys, "gains", ARM, "--json")
    command = [sys.executable, "-m", "adaptctl", "gains", ARM]
    validate_whole(found, subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def test_doctor_tells_what_is_there(capsys: pytest.CaptureFixture[str]) -> None:
    found = told(capsys, "doctor", "--json")
    assert found["wrong"] == []
    assert found["packages"]["numpy"] == numpy.__version__  # type: ignore[index]
    assert found["compiler"]["lanes"] in (2, 4, 8)  # type: ignore[index]
    assert main(["doctor"]) == 0
    assert "No problems found." in capsys.readouterr().out


def test_doctor_names_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setenv("ADAPTCTL_CACHE", "off")
    assert examined()["cache"]["folder"] is None
    assert main(["doctor"]) == 1
    assert "wrong: the viewer is missing: pip install rerun-sdk" in capsys.readouterr().out


def test_doctor_names_a_cache_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    for place, cause in (("file", "file exists"), ("file/below", "not a directory")):
        monkeypatch.setenv("ADAPTCTL_CACHE", str(tmp_path / place))
        assert main(["doctor"]) == 1
        told = f"wrong: {tmp_path / place}: nothing can be cached, and all is compiled anew ({cause}): make it writable"
        assert told in capsys.readouterr().out
    cache = ObjectCache(tmp_path / "new")
    assert cache.fault() is None
    assert list(cache.folder.iterdir()) == []
    cache.folder.chmod(0o777)
    assert cache.fault() == "the cache of compiled objects is writable by other users"


def test_completion_knows_commands_experiments_and_flags_and_is_installed_unless_a_file_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    installed: list[str] = []
    monkeypatch.setattr(App, "install_completion", lambda app, shell: installed.append(shell) or "its place")
    words, script = ["install-completion", "--shell", "bash"], tmp_path / "completion.bash"
    assert main([*words, "--out", str(script)]) == 0
    assert (installed, capsys.readouterr().out) == ([], "")
    text = script.read_text()
    for word in ("doctor", "two-arms", "--initial-error", "--energy-error"):
        assert word in text
    subprocess.run(["bash", "-n", str(script)], check=True)
    assert main(words) == 0
    assert (installed, capsys.readouterr().out) == (["bash"], "Written: its place\nIt takes effect in new shells.\n")


@pytest.mark.parametrize(("asked", "has", "drawn"), [(True, True, 1), (False, True, 0), (True, False, 0)])
def test_figures_are_drawn_where_they_are_asked_for(asked: bool, has: bool, drawn: int, tmp_path: Path) -> None:
    places: list[Path] = []
    result = SimpleNamespace(complete=True, write=lambda *_: None, figures=places.append if has else None)
    experiment: Any = SimpleNamespace(run=lambda progress: result)
    interruption: Any = SimpleNamespace(heeded=lambda progress: progress, hold=lambda: None)
    _computed(experiment, tmp_path, interruption, asked)
    assert places == [tmp_path / "figures"] * drawn


def test_experiments_are_told_as_json_and_notes_come_last(tmp_path: Path) -> None:
    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        code = main([*EXPERIMENT, "--out", str(tmp_path / "out"), "--json"])
    text, _, note = said.getvalue().rpartition("}\n")
    found = json.loads(text + "}")
    assert (found["schema"], found["complete"]) == ("adaptctl/experiment/1", True)
    assert found["folder"] == str(tmp_path / "out")
    assert code == (0 if found["verdict"]["passed"] else 3)
    assert note.startswith(f"adaptctl: note: {ARM}: physically inconsistent")


def test_list_is_told_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    found = told(capsys, "experiment", "list", "--json")
    assert {"name", "summary"} == set(found["experiments"][0])  # type: ignore[index]


def test_a_warning_of_ours_is_a_note_and_is_shown_once(capsys: pytest.CaptureFixture[str]) -> None:
    with _warnings_as_notes():
        for text, kind in (("slow", TuningWarning), ("slow", TuningWarning), ("light", ReferenceWarning)):
            warnings.warn(text, kind, stacklevel=1)
    assert capsys.readouterr().err == "adaptctl: note: slow\nadaptctl: note: light\n"


def test_what_an_encoding_has_not_is_written_by_its_number(monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii"))
    _write_any_character()
    print("\u03c9", flush=True)
    assert written.getvalue() == b"\\u03c9\n"
