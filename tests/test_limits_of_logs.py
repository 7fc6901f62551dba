"""Limits of logs, to the last number within them, and what is told of those beyond."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from adaptctl.arrays import MAX_SETTING
from adaptctl.errors import FileError, NotFoundError
from adaptctl.logs import isolated, lerobot, on_disk, parquet, rerun_recording, ros_bag, text
from adaptctl.logs.joint_states_cdr import JointStates
from adaptctl.logs.table import LogTable, table, validate_size, whole_stamps
from adaptctl.logs.text import read_delimited
from adaptctl.logs.text_form import _is_row, form_of


def written(folder: Path, content: str, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_text(content)
    return path


@pytest.mark.parametrize(
    ("rows", "columns", "fits"),
    [
        *((20_000_000, 20, True), (20_000_001, 1, False), (20_000_000, 21, False)),
        *((40_000, 10_000, True), (40_001, 10_000, False), (1, 10_001, False)),
    ],
)
def test_a_table_has_so_many_rows_columns_and_numbers(rows: int, columns: int, fits: bool) -> None:
    if fits:
        validate_size("log", rows, columns)
    else:
        with pytest.raises(FileError, match=f"^log: has {rows} rows.* more than the limit of"):
            validate_size("log", rows, columns)


def test_a_line_has_so_many_cells(tmp_path: Path) -> None:
    assert form_of(written(tmp_path, "1," * 9999 + "1\n")).count == 10_000
    with pytest.raises(FileError, match="has 10001 columns, more than the limit of 10000"):
        form_of(written(tmp_path, "1," * 10_000 + "1\n"))


@pytest.mark.parametrize("largest", [MAX_SETTING, -MAX_SETTING, 1.0 / MAX_SETTING, 0.0])
def test_a_column_has_numbers_of_such_a_size(largest: float) -> None:
    values = np.array([0.0, largest, 0.5 * largest])
    assert table("log", [("x", values)]).column("x", "time") is not None
    if largest:
        beyond = values * (1.01 if abs(largest) > 1.0 else 0.99)
        with pytest.raises(FileError, match=re.escape(f"number, {beyond[1]:g} in row 2, is beyond")):
            table("log", [("x", beyond)]).column("x", "time")


def test_the_first_row_that_is_not_finite_is_told() -> None:
    dated, ended = ({"x": np.array(values)} for values in ([np.nan, np.nan, 2.0], [1.0, np.nan, np.inf]))
    dates, end = (LogTable("log", columns, words={"x": "no\tpe"}) for columns in (dated, ended))
    with pytest.raises(FileError, match=r"2 of 3 rows .* row 1 \(nan\); its first text is") as told:
        dates.column("x", "time")
    assert str(told.value).endswith("write s, or dates as 2026-09-01 12:00:00.005")
    for log, what in ((end, "time"), (dates, "position")):
        with pytest.raises(FileError, match="; use a part of the log"):
            log.column("x", what)


def test_names_that_are_like_a_missing_one_or_the_first_twelve_are_offered() -> None:
    log = LogTable("log", {f"column{k}": np.zeros(1) for k in range(13)} | {"a.long.name": np.zeros(1)})
    with pytest.raises(FileError, match=r"no column 'a' for time; did you mean a.long.name$"):
        log.column("a", "time")
    with pytest.raises(FileError, match=r"columns: column0, .*, column11, \.\.\. \(14 in all\)$"):
        log.column("zzz", "time")
    twelve = LogTable("log", {f"x{k:02d}": np.zeros(1) for k in range(12)})
    assert twelve.listed() == ", ".join(twelve.columns)


def test_columns_of_a_table_are_of_one_length_and_have_names_of_their_own() -> None:
    twice = table("log", [("a", np.zeros(2)), ("ab", np.ones(2)), ("a", np.full(2, 2.0))])
    assert {name: values[0] for name, values in twice.columns.items()} == {"a (1)": 0.0, "ab": 1.0, "a (2)": 2.0}
    assert twice.notes == ("2 columns are named 'a', and are a (1) to a (2) here",)
    with pytest.raises(FileError, match=r"no column 'a' for time; did you mean a \(1\), a \(2\)$"):
        twice.column("a", "time")
    with pytest.raises(FileError, match="names must be unique"):
        table("log", [(name, np.zeros(2)) for name in ("a", "a", "a (1)")])
    with pytest.raises(FileError, match="column 'b' has 3 rows, but 'a' has 2"):
        table("log", [("a", np.zeros(2)), ("b", np.zeros(3))])
    for columns in ([], [("a", np.zeros(0))]):
        with pytest.raises(FileError, match="no rows of numbers"):
            table("log", columns)


def test_lines_of_another_length_are_counted_up_to_ten_thousand(tmp_path: Path) -> None:
    log = read_delimited(written(tmp_path, "a,b\n1,2\n" + 9999 * "#\n" + "3,4\n"))
    assert log.columns["b"].tolist() == [2.0, 4.0]
    assert log.notes == ("9999 lines of comments left out",)
    with pytest.raises(FileError, match="not a text table"):
        read_delimited(written(tmp_path, "a,b\n1,2\n" + 10_000 * "#\n" + "3,4\n"))


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("a,b\n1,2\n3,4,5\n6,7\n", r"line 3 has 3 cells, not 2: '3,4,5'\)"),
        ("a,b\n1,2\n3\n6,7\n", "line 3 has 1 cells, not 2"),
        ("a,b\n1,2\n3\n6,7\n8\n", "line 3 has 1 cells, not 2"),
        ("a,b\n1,2\n3,4,5\n", "line 3 has 3 cells, not 2"),
        ("a,b,\n1,2\n3,4\na,b,\n5,6\n", "line 4 has 3 cells, not 2"),
        ("a,b,c\n1,2\n", "line 1 has 3 names, and line 2 2 numbers"),
        ("", "no rows of numbers"),
    ],
)
def test_a_line_of_another_length_is_named(content: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=told):
        read_delimited(written(tmp_path, content))


def test_a_cut_last_line_is_left_out_and_told(tmp_path: Path) -> None:
    log = read_delimited(written(tmp_path, "a,b\n1,2\n3,4\n5"))
    assert log.columns["b"].tolist() == [2.0, 4.0]
    assert log.notes == ("the last line, which is cut off, was left out",)


def test_a_file_with_blanks_is_rewritten_up_to_a_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, "a   b\n1   2\n  3 4  \n")
    monkeypatch.setattr(text, "MAX_SPACED", path.stat().st_size)
    assert read_delimited(path).columns["b"].tolist() == [2.0, 4.0]
    monkeypatch.setattr(text, "MAX_SPACED", path.stat().st_size - 1)
    with pytest.raises(FileError, match="have to be rewritten; use commas"):
        read_delimited(path)


@pytest.mark.parametrize(
    ("content", "names", "columns"),
    [
        ("a,b\n1,2,\n3,4,\n", ["a", "b", "(3)"], 3),  # rows end with a mark
        ("a,b,\n1,2\n3,4\n", ["a", "b"], 2),  # the names do
        ("# a log\na,b\n1,2\n", ["a", "b"], 2),
        ("# a,b\n1,2\n", ["a", "b"], 2),
        ("# one\n1,2\n", None, 2),  # a comment of a word is no name of two columns
        ("a,b\nx,2\n", ["a", "b"], 2),  # half of the cells are numbers
        ("t,b\ns,rad\n1,2\n", ["t", "b"], 2),
        ("x,y\nt,b\ns,rad\n1,2\n", ["t", "b"], 2),
    ],
)
def test_names_are_those_of_the_last_line_before_the_numbers(
    content: str, names: list[str] | None, columns: int, tmp_path: Path
) -> None:
    form = form_of(written(tmp_path, content))
    assert (form.names, form.count) == (names, columns)
    assert form.units == ({"t": "s", "b": "rad"} if "rad" in content else {})


@pytest.mark.parametrize(
    ("cells", "decimal"),
    [
        *((["1,5", "2"], ","), (["1,5", "2.5"], "."), (["1.5"], "."), (["1.234,5"], ","), (["1,234.5"], ".")),
        *((["1.234.567"], ","), (["1,234,567"], "."), (["1,234"], ","), (["1.234"], ".")),
    ],
)
def test_the_mark_before_decimals_is_told_by_that_after_thousands(
    cells: list[str], decimal: str, tmp_path: Path
) -> None:
    assert form_of(written(tmp_path, "a;b\n" + "".join(f"{cell};1\n" for cell in cells))).decimal == decimal


def test_columns_belong_on_disk_by_the_bytes_of_all_their_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(on_disk, "LARGE", 8 * 12)
    assert [on_disk.is_large(*shape) for shape in ((1, 12), (4, 3), (3, 4), (11, 1))] == [True, True, True, False]


@pytest.mark.parametrize("before", [0.0, 1e3])
def test_stamps_of_two_columns_are_their_sum_in_both(before: float) -> None:
    """However the seconds were begun anew before: both columns are in their own unit and from 0, and tell the rest."""
    columns = {"sec": np.array([5.0, 6.0]), "nanosec": np.array([999_999_998.0, 4.0])}
    found = whole_stamps(LogTable("a", columns, begin={"sec": before} if before else {}))
    for name, unit in (("sec", 1.0), ("nanosec", 1e9)):
        np.testing.assert_allclose(found.columns[name], np.array([0.999999998, 1.000000004]) * unit)
        assert found.begin[name] == (5.0 + before) * unit
    assert found.units == {"sec": "s", "nanosec": "ns"}


@pytest.mark.parametrize("rows", [2, 3])
def test_what_is_large_is_on_disk_and_all_else_in_memory(rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    given_back: list[bool] = []
    monkeypatch.setattr(on_disk, "LARGE", 8 * 4 * 3)
    monkeypatch.setattr(on_disk, "release", lambda: given_back.append(True))
    columns, kept = [np.arange(5.0) + k for k in range(4)], np.arange(5) >= 5 - rows
    wanted = np.array(columns).T[kept]
    chosen = on_disk.chosen(columns, kept)
    made = on_disk.of_columns(chosen, rows, 4), on_disk.rowwise(np.negative, wanted)
    for found, expected in zip((*made, *chosen), (wanted, -wanted, *wanted.T), strict=True):
        np.testing.assert_array_equal(found, expected)
        assert found.flags.writeable == (rows < 3)
    assert len(given_back) == (4 + 4 + 1) * (rows == 3)  # a column at a time, and all rows at once


@pytest.mark.parametrize(
    ("large", "own", "in_batches"), [(0, {}, True), (0, {"sha256": "a"}, False), (2**30, {}, False)]
)
def test_large_files_are_read_in_batches_but_our_own_which_are_verified_whole(
    large: int, own: dict[str, str], in_batches: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(on_disk, "LARGE", large)
    rows = pa.table({"a": [1.0, 2.0], "b": pa.array([None, None], pa.int64())}).replace_schema_metadata(own)
    pq.write_table(rows, path := tmp_path / "log.parquet")
    found = parquet._long(path)
    assert (found is not None) == in_batches
    whole = parquet.arrow_table("log", rows)
    assert np.isnan(whole.columns["b"]).all()  # whole numbers, of which there are none
    assert found is None or found.columns["a"].tolist() == whole.columns["a"].tolist()


def test_parquet_files_that_are_too_long_are_refused_before_they_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({"a": [1.0, 2.0, 3.0]}), path)
    begun: list[int] = []
    monkeypatch.setattr(on_disk, "LARGE", 0)
    monkeypatch.setattr("adaptctl.logs.table.MAX_ROWS", 3)
    assert len(parquet.read_parquet(path)) == len(parquet.read_in_turn("log", [path], ["a"])) == 3
    monkeypatch.setattr(parquet, "Batches", begun.append)
    monkeypatch.setattr("adaptctl.logs.table.MAX_ROWS", 2)
    with pytest.raises(FileError, match="has 3 rows, more than the limit of 2"):
        parquet.read_parquet(path)
    monkeypatch.setattr("adaptctl.logs.table.MAX_ROWS", 5)
    with pytest.raises(FileError, match="log: has 6 rows, more than the limit of 5"):
        parquet.read_in_turn("log", [path, path], ["a"])
    assert not begun


@pytest.mark.parametrize(
    ("line", "is_row"),
    [
        ("1,a,b", True),
        ("a,1", True),
        ("a,b,1", False),
        ("a,1,2,b", True),
        (",1,a,b", True),
        ("# 1,2", False),
        ("a,b", False),
    ],
)
def test_a_line_is_a_row_if_it_begins_with_a_number_or_half_of_it_are(line: str, is_row: bool) -> None:
    assert _is_row(line, ",") is is_row


@pytest.mark.isolated
def test_a_reader_has_memory_and_time_by_the_size_of_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, seen = tmp_path / "log.mcap", list[Any]()
    path.write_bytes(bytes(4_000_000))

    def run(command: list[str], timeout: float, **given: Any) -> Any:
        seen.append((int(command[-2]), float(command[-1]), timeout, given["env"]["OMP_NUM_THREADS"]))
        if len(seen) > 1:
            raise subprocess.TimeoutExpired(command, timeout)
        return SimpleNamespace(returncode=-9)

    monkeypatch.setattr(subprocess, "run", run)
    with pytest.raises(FileError, match=r"within 1.1 GB and the time .*the reader ended with -9"):
        isolated.read_isolated("m:f", path)
    with pytest.raises(FileError, match="was not read within 53 s"):
        isolated.read_isolated("m:f", path)
    assert seen == [(2**30 + 30 * 4_000_000, 11.0, 53.0, "1")] * 2
    (tmp_path / "folder" / "below").mkdir(parents=True)
    for name in ("one", "below/two"):
        (tmp_path / "folder" / name).write_bytes(bytes(7))
    assert isolated._size(tmp_path / "folder") == 14


def test_an_error_of_a_reader_is_one_of_ours_and_of_printable_characters() -> None:
    assert isinstance(isolated._error({"error": "NotFoundError", "message": "x"}), NotFoundError)
    for kind in ("SystemExit", "annotations", "no such"):
        assert type(isolated._error({"error": kind, "message": "x"})) is FileError
    assert str(isolated._error({"error": "FileError", "message": "a\x1b"})) == "a\\x1b"


def test_features_of_a_data_set_are_told_by_words_in_their_names() -> None:
    words = {"position": "pos position q", "velocity": "vel velocity dq", "effort": "effort torque eff tau"}
    for kind, given in words.items():
        for word in given.split():
            assert lerobot._kind(word.upper()) == kind
            assert lerobot._of_feature(f"observation.joint_{word}s") == kind
    assert lerobot._of_feature("observation.state") == "position"
    assert lerobot._of_feature("observation.state.image") is None
    assert [lerobot._unit({"units": ["rad", 1]}, k) for k in range(3)] == ["rad", "", ""]


def test_a_data_set_has_settings_and_files_up_to_a_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "meta").mkdir()
    info = written(tmp_path / "meta", '{"features": 1}'.ljust(2**22), "info.json")
    assert lerobot.is_lerobot(tmp_path)
    assert not lerobot.is_lerobot(tmp_path / "meta")
    assert lerobot._info(tmp_path) == {"features": 1}
    info.write_text(info.read_text() + " ")
    monkeypatch.chdir(tmp_path)  # where long, paths are cut in messages
    with pytest.raises(FileError, match="larger than 4194304 bytes"):
        lerobot._info(Path())
    monkeypatch.setattr(lerobot, "MAX_FILES", 2)
    for k in (10, 9):
        written(tmp_path, "", f"{k}.parquet")
    pattern = {"data_path": "{file_index}.parquet"}
    assert [file.name for file in lerobot._files(tmp_path, pattern)] == ["9.parquet", "10.parquet"]
    written(tmp_path, "", "8.parquet")
    with pytest.raises(FileError, match="more than 2 files"):
        lerobot._files(tmp_path, pattern)


def states(names: list[str], count: int = 1) -> list[tuple[int, Any]]:
    stamp = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0))
    rows = {"position": [1.0] * len(names), "velocity": [], "effort": []}
    return [(5, SimpleNamespace(name=names, header=stamp, **rows))] * count


def test_joint_states_are_those_of_one_robot() -> None:
    many = [f"j{k}" for k in range(1001)]
    assert len(ros_bag.joint_table("bag", states(many[:1000])).columns) == 1001
    with pytest.raises(FileError, match="name 1001 joints, 1001 of them different"):
        ros_bag.joint_table("bag", states(many))
    with pytest.raises(FileError, match="name 2 joints, 1 of them different"):
        ros_bag.joint_table("bag", states(["a", "a"]))
    with pytest.raises(FileError, match="as many messages are for the joints a, b and for c"):
        ros_bag.joint_table("bag", states(["a", "b"], 2) + states(["c"], 2))
    log = ros_bag.joint_table("bag", states(["a", "b"], 3) + states(["c"], 2))
    assert log.notes == ("2 messages of other publishers were left out (c)",)
    assert (
        ros_bag.joint_table("bag", states(["a", "b"], 3) + states(["a"])).notes[0].endswith("left out (fewer joints)")
    )
    with pytest.raises(FileError, match="no joint state has names"):
        ros_bag.joint_table("bag", states([]))


def test_a_bag_is_refused_before_it_is_read_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """By its messages so far, decoded one by one or many at a time."""
    many = JointStates(["a"], np.arange(2), np.arange(2), {field: np.zeros((2, 1)) for field, _ in ros_bag.FIELDS})
    monkeypatch.setattr("adaptctl.logs.table.MAX_ROWS", 3)
    assert len(ros_bag.joint_table("bag", [*states(["a"]), many])) == 3
    unstamped = many._replace(stamps=np.zeros(2, dtype=np.int64), logged=np.array([5, 7]) * 10**9)
    assert ros_bag.joint_table("bag", [unstamped]).columns["time"].tolist() == [0.0, 2.0]
    left = iter([many, many, many])
    with pytest.raises(FileError, match="has 4 rows, more than the limit of 3"):
        ros_bag.joint_table("bag", left)
    assert len(list(left)) == 1


def test_only_joint_states_of_one_topic_are_read() -> None:
    kinds = {"/a": ros_bag.JOINT_STATE, "/b": ros_bag.JOINT_STATE, "/image": "sensor_msgs/msg/Image"}
    a, b, image = (SimpleNamespace(topic=topic, msgtype=kind) for topic, kind in kinds.items())
    assert ros_bag._connections("bag", [image, a, a], None) == [a, a]
    assert ros_bag._connections("bag", [a, b, image], "/b") == [b]
    with pytest.raises(FileError, match="bag: several joint-state topics: /a, /b; select one"):
        ros_bag._connections("bag", [a, b], None)
    with pytest.raises(FileError, match=r"bag: no joint-state topic /image; topics: /a$"):
        ros_bag._connections("bag", [a, image], "/image")


@pytest.mark.parametrize("name", ["zstd", "lz4"])
def test_a_chunk_unpacks_to_a_quarter_of_a_gibibyte_at_most(name: str) -> None:
    from backports import zstd
    from lz4 import frame
    from rosbags.rosbag2 import storage_mcap

    ros_bag._bound_chunks()
    packed = {"zstd": zstd.compress, "lz4": frame.compress}[name](b"content")
    assert storage_mcap.DECOMPRESSORS[name](packed, 7) == b"content"
    assert len(storage_mcap.DECOMPRESSORS[name](packed, 3)) == 4  # one more than declared, which is refused
    assert storage_mcap.DECOMPRESSORS[name](packed, 2**28) == b"content"
    with pytest.raises(ValueError, match="declares 268435457 bytes"):
        storage_mcap.DECOMPRESSORS[name](packed, 2**28 + 1)


@pytest.mark.parametrize(
    ("read", "name", "told"),
    [
        (rerun_recording.read_rrd, "log.rrd", "cannot be read as a recording of rerun"),
        (ros_bag.read_ros_bag, "log.bag", "cannot be read as a ROS bag"),
        (parquet.read_parquet, "log.parquet", "not a Parquet file"),
    ],
)
def test_a_damaged_file_is_told_in_a_line_with_its_name(read: Any, name: str, told: str, tmp_path: Path) -> None:
    path = written(tmp_path, "nothing of the kind", name)
    with pytest.raises(FileError) as refused:
        read(path)
    assert str(refused.value).startswith(f"{path}: {told} (")
    assert len(str(refused.value).splitlines()) == 1
