"""Long logs are read batch by batch and kept on disk: what is read and prepared is what it is of all rows at once."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from nightly import nightly
from synthetic_logs import Known, known

from adaptctl.arrays import Array
from adaptctl.errors import FileError
from adaptctl.identification import convolution, long_logs, preparation
from adaptctl.identification.columns import joint_log
from adaptctl.identification.fit import FitSettings
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.gathering import gathered
from adaptctl.identification.log_checks import checked_log
from adaptctl.logs import on_disk, text, text_form
from adaptctl.logs.arrow import numbers
from adaptctl.logs.batches import Batches, UnlikeBeforeError
from adaptctl.logs.parquet import read_parquet
from adaptctl.logs.table import LogTable, table
from adaptctl.logs.text import read_delimited

Change = Callable[[list[list[str]]], None]


def _at_once(*args: object) -> None:
    raise AssertionError("the log was read at once")


def by_batches(read: Callable[[Path], LogTable], path: Path, at_once: str, allowed: bool = False) -> LogTable:
    """Log as it is read by batches of some rows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(on_disk, "LARGE", 0)
        patch.setattr(on_disk, "ROWS_AT_ONCE", 50)
        patch.setattr(text, "BLOCK", 4096)
        if not allowed:
            patch.setattr(at_once, _at_once)
        return read(path)


def assert_same(one: LogTable, other: LogTable) -> None:
    assert list(one.columns) == list(other.columns)
    for name, values in other.columns.items():
        np.testing.assert_array_equal(one.columns[name], values, err_msg=name)
    for part in ("units", "words", "numbered", "notes", "begin"):
        assert getattr(one, part) == getattr(other, part), part
    assert one.empty.keys() == other.empty.keys()
    assert all(np.array_equal(one.empty[name], mask) for name, mask in other.empty.items())


def put(row: int, column: int, cell: str) -> Change:
    def change(rows: list[list[str]]) -> None:
        rows[row][column] = cell

    return change


CHANGES: dict[str, Change] = {
    "as it is": lambda rows: None,
    "a number with a point after whole ones": put(900, 2, "0.5"),
    "NaN late": put(800, 1, "nan"),
    "an empty cell": put(700, 2, ""),
    "a text late": put(900, 3, "error"),
    "a comment": lambda rows: rows.insert(500, ["# a remark"]),
    "a last line cut off": lambda rows: rows.append(["999"]),
    "only empty cells first": lambda rows: [row.__setitem__(3, "") for row in rows[:600]] and None,
    "stamps in ns": lambda rows: (
        [row.__setitem__(0, str(1_790_000_000_000_000_000 + 1_000_003 * k)) for k, row in enumerate(rows)] and None
    ),
    "words from the first": lambda rows: [row.__setitem__(3, "moving") for row in rows] and None,
    "times of day": lambda rows: [row.__setitem__(0, f"10:00:{k % 60:02d}.5") for k, row in enumerate(rows)] and None,
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_text_file_in_batches_is_that_of_all_rows(tmp_path: Path, change: str) -> None:
    rows = [[str(k), f"{np.sin(0.01 * k):.6f}", str(k % 7), f"{0.1 * k:.3f}"] for k in range(1000)]
    CHANGES[change](rows)
    path = tmp_path / "log.csv"
    path.write_text("\n".join(",".join(row) for row in [["time", "p", "count", "tau"], *rows]))
    assert_same(by_batches(read_delimited, path, "adaptctl.logs.text._read"), read_delimited(path))


@pytest.mark.parametrize("change", ["as it is", "a text late", "a comment", "a last line cut off", "stamps in ns"])
def test_a_file_with_blanks_between_its_numbers_is_read_in_batches(tmp_path: Path, change: str) -> None:
    rows = [[str(k), f"{np.sin(0.01 * k):.6f}", str(k % 7), f"{0.1 * k:.3f}"] for k in range(1000)]
    CHANGES[change](rows)
    path = tmp_path / "log.txt"
    path.write_text("\n".join("  " + " \t ".join(row) + " " for row in [["time", "p", "count", "tau"], *rows]))
    assert_same(by_batches(read_delimited, path, "adaptctl.logs.text._read"), read_delimited(path))


@pytest.mark.parametrize("count", [1, 2, 5])
def test_cells_of_a_digit_each_are_read_in_batches(count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """More rows than any other file of its size has."""
    room: list[int] = []
    monkeypatch.setattr(text, "Batches", lambda rows: room.append(rows) or Batches(rows))
    path = tmp_path / "short.csv"
    digits = np.arange(2000 * count).reshape(-1, count) % 7
    path.write_text("\n".join(",".join(map(str, row)) for row in [list("abcde")[:count], *digits.tolist()]) + "\n")
    log = by_batches(read_delimited, path, "adaptctl.logs.text._read")
    np.testing.assert_array_equal(np.stack(list(log.columns.values()), axis=-1), digits)
    assert 8 * count * room[0] < 5 * path.stat().st_size


def test_a_longer_line_among_blanks_is_refused_under_the_files_own_name(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_text("\n".join(["time  p", *(f"{k}  {0.1 * k:.6f}{' 9' * (k == 900)}" for k in range(1000))]))
    with pytest.raises(FileError, match=f"{path}: not a text table .line 902 has 3 cells"):
        by_batches(read_delimited, path, "adaptctl.logs.text._read")


def test_a_file_that_repeats_its_names_is_read_at_once(tmp_path: Path) -> None:
    rows = [f"{k},{0.1 * k:.6f}" for k in range(1000)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time,p", *rows[:700], "time,p", *rows[700:]]))
    found = by_batches(read_delimited, path, "", allowed=True)
    assert_same(found, read_delimited(path))
    assert "repeat" in found.notes[0]


@pytest.mark.parametrize("content", ["a,a\n1,2\n", "a,b\n1,2\na,b\n3,4\n"])
def test_names_that_are_given_twice_are_not_read_in_batches(content: str, tmp_path: Path) -> None:
    (path := tmp_path / "log.csv").write_text(content)
    with pytest.raises(UnlikeBeforeError):
        text._kinds(path, text_form.form_of(path))


def test_a_column_that_turns_out_to_be_texts_is_told_by_its_number() -> None:
    told = "In CSV column #{}: CSV conversion error to double"
    assert text._changed(told.format(1), ["a", "b"]) == "b"
    for other in (told.format(2), "In CSV column #1: another error"):
        with pytest.raises(UnlikeBeforeError):
            text._changed(other, ["a", "b"])


def test_a_longer_line_in_a_late_batch_is_refused_with_its_number(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time,p", *(f"{k},{0.1 * k:.6f}{',9' * (k == 900)}" for k in range(1000))]))
    with pytest.raises(FileError, match="line 902 has 3 cells"):
        by_batches(read_delimited, path, "adaptctl.logs.text._read")


@pytest.mark.parametrize("large", [0, 2**30])
def test_a_line_that_is_no_text_is_refused_alone(
    tmp_path: Path, large: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(on_disk, "LARGE", large)
    monkeypatch.setattr(text_form, "HEAD", 4096)
    rows = [f"{k},{0.1 * k:.6f}\n".encode() for k in range(1000)]
    (tmp_path / "log.csv").write_bytes(b"time,p\n" + b"".join([*rows[:900], b"\x01\xff\xfe\n", *rows[900:]]))
    with pytest.raises(FileError, match="not a text table"):
        read_delimited(tmp_path / "log.csv")
    assert capsys.readouterr().err == ""


def test_a_parquet_file_in_batches_is_that_of_all_rows(tmp_path: Path) -> None:
    stamps = 1_790_000_000_000_000_000 + 1_000_003 * np.arange(400)
    holes = pa.array([None if 120 <= k < 200 else 0.1 * k for k in range(400)])
    pairs = pa.array(np.arange(800.0).reshape(400, 2).tolist(), type=pa.list_(pa.float64(), 2))
    columns = {"t": stamps, "date": pa.array(stamps, type=pa.timestamp("ns")), "p": holes, "both": pairs}
    columns |= {"on": pa.array([k % 2 == 0 for k in range(400)]), "name": pa.array(["arm"] * 400)}
    pq.write_table(pa.table(columns), tmp_path / "log.parquet", row_group_size=130)
    found = by_batches(read_parquet, tmp_path / "log.parquet", "adaptctl.logs.parquet.read_arrow")
    assert_same(found, read_parquet(tmp_path / "log.parquet"))
    np.testing.assert_array_equal(found.columns["t"], stamps - stamps[0])  # of which floats hold each
    assert found.begin["t"] == stamps[0]
    assert found.begin.keys() <= {"t", "date"}  # all others begin where their file says


@pytest.mark.parametrize("kind", [pa.list_(pa.float64()), pa.large_list(pa.float64()), pa.list_(pa.float64(), 2)])
def test_lists_of_any_kind_are_a_column_a_place(kind: pa.DataType) -> None:
    found = {one.name: one.values.tolist() for one in numbers("p", pa.array([[1.0, 2.0], [3.0, 4.0]], kind))}
    assert found == {"p[0]": [1.0, 3.0], "p[1]": [2.0, 4.0]}


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_durations_and_moments_are_in_seconds(unit: str) -> None:
    ticks = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    (lasted,) = numbers("t", pa.array([ticks, 86400 * ticks], pa.duration(unit)))
    (moment,) = numbers("t", pa.array([0, 86400 * ticks], pa.timestamp(unit)))
    (day,) = numbers("t", pa.array([0, 1], pa.date32()))
    assert (lasted.unit, lasted.values.tolist()) == ("s", [1.0, 86400.0])
    assert (np.diff(moment.values), np.diff(day.values)) == (86400.0, 86400.0)


def test_lists_that_get_longer_are_left_out_in_batches_too(tmp_path: Path) -> None:
    lists = [[1.0, 2.0]] * 200 + [[1.0, 2.0, 3.0]] * 200
    pq.write_table(pa.table({"t": np.arange(400.0), "both": lists}), tmp_path / "log.parquet", store_schema=False)
    found = by_batches(read_parquet, tmp_path / "log.parquet", "", allowed=True)
    assert list(found.columns) == ["t"]


@pytest.fixture(scope="module")
def case() -> Known:
    return known(7, links=2, duration=40.0, rate=100.0)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=nightly), pytest.param(2, marks=nightly)])
@pytest.mark.parametrize("messy", [True, pytest.param(False, marks=nightly)])
def test_a_fit_to_a_log_on_disk_is_that_to_the_whole(
    case: Known, seed: int, messy: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(seed)
    time = case.log.time + (1e-4 * np.sin(900.0 * case.log.time) if messy else 0.0)
    position = np.angle(np.exp(1j * case.log.position)) if messy else case.log.position
    columns = {"time": time}
    for j, motor in enumerate(case.drives.motors):
        columns |= {motor.position: position[:, j], motor.torque: case.log.torque[:, j]}
    log = table("a log", columns.items())
    whole = _fitted(case, log)
    for module, name in ((on_disk, "LARGE"), (long_logs, "LONG")):
        monkeypatch.setattr(module, name, 0)
    for module, name, most in (
        (on_disk, "ROWS_AT_ONCE", 2000),
        (preparation, "SAMPLES_AT_ONCE", 2000),
        (convolution, "SEGMENTS_AT_ONCE", 3),
        (long_logs, "STRETCH", 1000),
    ):
        monkeypatch.setattr(module, name, int(rng.integers(most // 10 + 1, most)))
    found = _fitted(case, log)
    np.testing.assert_allclose(found, whole, rtol=1e-9, atol=1e-9 * np.abs(whole).max())


def _fitted(case: Known, log: LogTable) -> Array:
    checked, _ = checked_log(joint_log(log, case.drives), case.guess)
    evidence = gathered(case.guess, case.drives, [checked])[0]
    return evidence.fit(FitSettings(FrictionModel(), 1.0, evidence.band), range(evidence.blocks)).x


def test_memory_of_columns_on_disk_is_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(on_disk, "LARGE", 0)
    values = on_disk.rowwise(lambda own: np.stack([own, 2.0 * own], axis=-1), np.arange(3e5))
    assert values[:, 1].sum() == 3e5 * (3e5 - 1.0)
    before = _resident()
    on_disk.release()
    assert before - _resident() > 2e6
    assert values[-1].tolist() == [3e5 - 1.0, 6e5 - 2.0]


def _resident() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return 4096 * pages


def test_a_full_disk_is_named_with_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*args: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("os.pwrite", full)
    (tmp_path / "log.csv").write_text("time,p\n0.0,1.0\n0.1,2.0\n")
    with pytest.raises(FileError, match=r"no space left.*TMPDIR"):
        by_batches(read_delimited, tmp_path / "log.csv", "adaptctl.logs.text._read")
