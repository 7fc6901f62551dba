"""Tables and estimates that the package writes say whose they are, and logs whose numbers were changed are refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from nightly import mostly_at_night

from adaptctl.errors import FileError, InputError
from adaptctl.identification.log_files import read_log
from adaptctl.recording.trace import Quantity, write_columns
from adaptctl.simulation import Rollout

TIME = 0.01 * np.arange(50)


def rollout(path: Path) -> Path:
    p = np.sin(TIME)[:, None] * [1.0, 2.0]
    Rollout.from_arrays(p, np.cos(p), 0.0 * p, 0.01).save(path)
    return path


@pytest.mark.parametrize("name", ["run.csv", "run.xyz"])
def test_a_run_is_not_saved_under_another_type(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ends in \.parquet, got .*; as text: pyarrow\.csv\.write_csv\(run\.to_arrow"):
        rollout(tmp_path / name)
    assert not list(tmp_path.iterdir())


def trace(path: Path) -> Path:
    words = Quantity("words", "1", "a text", np.array(["a", "bc"] * 25))
    columns = [Quantity("time", "s", "time", TIME), Quantity("p.a", "rad", "position", np.sin(TIME)), words]
    write_columns(path, columns, {"schema": "adaptctl/trace/2", "robot": "arm"})
    return path


def rewritten(path: Path, **changes: float) -> Path:
    """The file with one number of some columns changed, by a program that keeps what it does not know."""
    table = pq.read_table(path)
    metadata = pq.ParquetFile(path).metadata.metadata
    for name, value in changes.items():
        column = table[name].to_numpy().copy()
        column[7] = value
        table = table.set_column(table.column_names.index(name), table.schema.field(name), pa.array(column))
    pq.write_table(table.replace_schema_metadata({k: v for k, v in metadata.items() if k != b"ARROW:schema"}), path)
    return path


@pytest.mark.isolated
@pytest.mark.parametrize("made", mostly_at_night([rollout, trace], trace))
def test_own_tables_are_read_as_logs(tmp_path: Path, made: object) -> None:
    file = made(tmp_path / "run.parquet")  # type: ignore[operator]
    np.testing.assert_allclose(read_log(file).column("time", "time"), TIME, atol=1e-15)
    np.testing.assert_allclose(read_log(rewritten(file)).column("time", "time"), TIME, atol=1e-15)


@pytest.mark.parametrize("made", mostly_at_night([rollout, trace], rollout))
def test_own_tables_with_other_numbers_are_refused_with_the_line_that_accepts_them(
    tmp_path: Path, made: object
) -> None:
    file = rewritten(made(tmp_path / "run.parquet"), time=0.0701)  # type: ignore[operator]
    with pytest.raises(FileError, match=r"run\.parquet: the numbers are not those that were written") as refused:
        read_log(file)
    line = str(refused.value).partition("use ")[2].partition(", pq being")[0]
    exec(line, {"pq": pq})
    assert read_log(file).column("time", "time")[7] == 0.0701


@pytest.mark.parametrize("rows", [7, 50])
def test_a_table_written_in_parts_has_the_checksum_of_the_whole(
    rows: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = pq.read_metadata(trace(tmp_path / "whole.parquet")).metadata
    monkeypatch.setattr("adaptctl.recording.trace.ROWS_AT_ONCE", rows)
    file = trace(tmp_path / "parts.parquet")
    assert pq.read_metadata(file).metadata[b"sha256"] == whole[b"sha256"]
    assert pq.read_metadata(file).num_row_groups == -(-50 // rows)
    assert len(read_log(file).column("time", "time")) == 50


def test_a_text_or_an_entry_that_was_changed_is_noticed(tmp_path: Path) -> None:
    file = trace(tmp_path / "run.parquet")
    table, metadata = pq.read_table(file), pq.ParquetFile(file).metadata.metadata
    texts = pa.array(["ab", "c"] * 25)
    swapped = table.set_column(2, table.schema.field("words"), texts)
    pq.write_table(swapped, tmp_path / "swapped.parquet")
    pq.write_table(table.replace_schema_metadata({**metadata, b"robot": b"other"}), tmp_path / "renamed.parquet")
    for name in ("swapped", "renamed"):
        with pytest.raises(FileError, match="are not those that were written"):
            read_log(tmp_path / f"{name}.parquet")


def test_tables_of_others_are_read_as_they_are(tmp_path: Path) -> None:
    table = pa.table({"time": TIME, "q": np.sin(TIME)})
    for k, metadata in enumerate([None, {"sha256": "00"}, {"schema": "other/1", "sha256": "00"}]):
        pq.write_table(table.replace_schema_metadata(metadata), tmp_path / f"{k}.parquet")
        assert len(read_log(tmp_path / f"{k}.parquet").column("q", "position")) == 50


def test_names_that_are_no_text_are_refused(tmp_path: Path) -> None:
    data = rollout(tmp_path / "run.parquet").read_bytes()
    (tmp_path / "bad.parquet").write_bytes(data.replace(b"reference_a.joint1", b"reference_a.join\xc3\x31"))
    readers: list[Callable[[Path], object]] = [read_log, Rollout.load]
    for read in readers:
        with pytest.raises(FileError):
            read(tmp_path / "bad.parquet")
