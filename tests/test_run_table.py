"""Table of a folder's runs, read back by pyarrow; recordings carry the same values."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from comparisons import comparison
from rerun.chunk import RrdReader

from adaptctl.cli.main import main
from adaptctl.dynamics import load
from adaptctl.errors import FileError
from adaptctl.recording.rerun_recording import write_recording
from adaptctl.recording.run_table import COLUMNS, find_runs, read_summary
from adaptctl.recording.summary import sealed, summary

SUMMARY = summary(comparison(load("two_link")))


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two experiments, one in a deeper folder, and two files that cannot be read."""
    place = tmp_path_factory.mktemp("results")
    content = json.dumps(sealed(SUMMARY))
    for folder, text in {
        "a": content,
        "deep/er/b": json.dumps(sealed(SUMMARY | {"seed": 11})),
        "broken": "{",
        "old": '{"schema": "adaptctl/summary/3"}',
        "edited": content.replace('"seed": 7', '"seed": 17'),
        "unsealed": json.dumps(SUMMARY),
    }.items():
        (place / folder).mkdir(parents=True)
        (place / folder / "summary.json").write_text(text)
    return place


def test_each_controller_has_a_row_with_the_summary_s_values(results: Path) -> None:
    found = find_runs(results)
    content = SUMMARY
    assert found.table.num_rows == 2 * len(content["runs"])
    for row in found.table.to_pylist():
        run = content["runs"][row["run"]]
        assert row["folder"] in ("a", "deep/er/b")
        assert {name: row[name] for name in ("label", "law", "final_rms_error")} == {
            name: run[name] for name in ("label", "law", "final_rms_error")
        }
        assert row["robot_sha256"] == content["robot_sha256"]
        assert json.loads(row["settings"]) == content["settings"]
    assert sorted(Path(line.partition(":")[0]).parent.name for line in found.broken) == [
        "broken",
        "edited",
        "old",
        "unsealed",
    ]


def test_a_summary_tells_whether_a_run_was_interrupted() -> None:
    interrupted = summary(comparison(load("two_link"), samples=20, complete=False))
    for told, complete in ((SUMMARY, True), (interrupted, False)):
        assert {told["complete"], *(run["complete"] for run in told["runs"].values())} == {complete}


def test_the_written_table_is_typed_and_sorts_as_numbers(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", str(results), "--sort", "seed", "--where", "run=adapt*", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["seed"] for row in told["runs"]] == sorted(row["seed"] for row in told["runs"])
    table = pq.read_table(results / "runs.parquet")
    assert {field.name: field.type for field in table.schema} == {name: kind for name, (kind, _) in COLUMNS.items()}
    assert table.schema.field("rms_error").metadata == {b"unit": b"rad or m"}
    assert pc.max(table["seed"]).as_py() == 11


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["--where", "robot"], "--where: expected COLUMN=PATTERN"),
        (["--where", "robt=x"], "--where: no column 'robt' (did you mean 'robot'?)"),
        (["--sort", "final"], "--sort: no column 'final'"),
    ],
)
def test_unknown_columns_are_refused(
    results: Path, given: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["runs", str(results), *given]) == 2
    assert says in capsys.readouterr().err


def test_what_is_no_summary_of_an_experiment_is_told_from_an_old_one(tmp_path: Path) -> None:
    for schema, says in (
        ("adaptctl/drive/1", "give results of an exp"),
        ("adaptctl/summary/3", "run the experiment ag"),
    ):
        (tmp_path / "summary.json").write_text(json.dumps({"schema": schema}))
        with pytest.raises(FileError, match=f"got '{schema}'; {says}"):
            read_summary(tmp_path / "summary.json")


@pytest.mark.parametrize(("folder", "says"), [("none", "no such folder"), ("empty", "no summary.json in it")])
def test_a_folder_without_runs_is_refused(tmp_path: Path, folder: str, says: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileError, match=says):
        find_runs(tmp_path / folder)


def test_eight_folders_below_the_given_one_are_searched(tmp_path: Path) -> None:
    (deep := tmp_path.joinpath(*"123456789")).mkdir(parents=True)
    (deep / "summary.json").write_text("{")
    assert len(find_runs(tmp_path / "1").broken) == 1
    with pytest.raises(FileError, match=r"no summary\.json in it or below"):
        find_runs(tmp_path)


def test_a_recording_has_the_summary_s_values_as_properties(tmp_path: Path) -> None:
    compared = comparison(load("two_link"))
    write_recording(tmp_path / "a.rrd", compared)
    content: dict[str, Any] = summary(compared)
    chunks = RrdReader(tmp_path / "a.rrd").store().stream().filter(content="/__properties/adaptctl", is_static=True)
    row = {name: cell for chunk in chunks for name, cell in chunk.to_record_batch().to_pylist()[0].items()}
    for name in ("robot", "law", "final_rms_error", "rank", "version"):
        assert row[name] == [content[name]]
    assert row["passed"] == [content["verdict"]["passed"]]
    assert json.loads(row["settings"][0]) == content["settings"]
    assert "wall_time" not in row
