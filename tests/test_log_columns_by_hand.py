"""Columns of logs: each kind of Arrow's, rerun's and Foxglove's, with numbers by hand."""

from __future__ import annotations

import gc
import json
import mmap
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from adaptctl.errors import FileError
from adaptctl.logs import child, foxglove, isolated, lerobot, on_disk, ros_bag, text, text_columns, text_form
from adaptctl.logs.arrow import LogColumn, forget, numbers
from adaptctl.logs.batches import Batches, UnlikeBeforeError
from adaptctl.logs.rerun_recording import read_rrd
from adaptctl.logs.table import LogTable, whole_stamps
from adaptctl.logs.text import read_delimited
from adaptctl.logs.text_form import TextForm, cells

NAN = float("nan")


def only(column: Any, first: int | None = None) -> LogColumn:
    (found,) = numbers("x", column, "rad", first)
    return found


def same(found: Any, expected: list[float]) -> None:
    np.testing.assert_array_equal(np.asarray(found), np.array(expected))


@pytest.mark.parametrize(("unit", "of_a_second"), [("s", 1), ("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_times_are_in_seconds_and_moments_from_the_first(unit: str, of_a_second: int) -> None:
    counts = [3 * of_a_second, None, 5 * of_a_second]
    lasting, at = (only(pa.array(counts, kind(unit))) for kind in (pa.duration, pa.timestamp))
    np.testing.assert_allclose(lasting.values, [3.0, NAN, 5.0])
    np.testing.assert_allclose(at.values, [0.0, NAN, 2.0])
    assert (lasting.unit, at.unit, lasting.begin, at.first) == ("s", "s", 0.0, 3 * of_a_second)
    assert at.begin == pytest.approx(3.0)
    for one in (lasting, at):
        same(one.empty, [False, True, False])
    later = only(pa.array(counts, pa.timestamp(unit)), 2 * of_a_second)
    np.testing.assert_allclose(later.values, [1.0, NAN, 3.0])


def test_days_are_of_so_many_seconds() -> None:
    found = only(pa.array([2, 3], pa.date32()))
    same(found.values, [0.0, 24.0 * 3600.0])
    assert found.begin == 2 * 24.0 * 3600.0


@pytest.mark.parametrize(
    ("given", "begin"),
    [
        ([2**53 - 1, 0], 0),
        ([2**53, 2**53 + 1], 2**53),  # floating-point numbers have no ones there
        ([-(2**53), 1 - 2**53], -(2**53)),
        ([-(2**61), 2**61 - 1], -(2**61)),
        ([-(2**61), 2**61], 0),  # too far apart to be told from the first
    ],
)
def test_large_whole_numbers_are_from_the_first(given: list[int], begin: int) -> None:
    found = only(pa.array(given, pa.int64()))
    same(found.values, [float(x - begin) for x in given])
    assert (found.begin, found.first or 0, found.empty, found.unit) == (begin, begin, None, "rad")


def test_empty_columns_masks_and_other_numbers() -> None:
    same(only(pa.array([True, False, None])).values, [1.0, 0.0, NAN])
    same(only(pa.chunked_array([[1.5], [2.5]])).values, [1.5, 2.5])
    same(only(pa.array(["a", "b"]).dictionary_encode().indices).values, [0.0, 1.0])
    coded = pa.DictionaryArray.from_arrays(pa.array([1, 0, 1]), pa.array([0.5, 2.5]))
    same(only(coded).values, [2.5, 0.5, 2.5])
    nothing = only(pa.array([None, None], pa.int64()))
    same(nothing.values, [NAN, NAN])
    assert nothing.first is None
    assert list(numbers("x", pa.array(["a"]))) == []


@pytest.mark.parametrize("kind", [pa.list_(pa.int64()), pa.list_(pa.int64(), 2), pa.large_list(pa.float64())], ids=str)
def test_lists_of_one_length_are_a_column_for_each_place(kind: Any) -> None:
    one, two = numbers("x", pa.array([[1, 2], None, [3, 4]], kind), "N m")
    assert (one.name, two.name, one.unit) == ("x[0]", "x[1]", "N m")
    same(one.values, [1.0, NAN, 3.0])
    same(two.values, [2.0, NAN, 4.0])
    same(two.empty, [False, True, False])
    assert next(numbers("x", pa.array([[1, 2]], kind))).empty is None
    assert one.values.base is None  # a copy, not a view of all places


def test_lists_of_several_lengths_of_none_or_of_words_are_no_columns() -> None:
    for column in (
        pa.array([[1], [1, 2]]),
        pa.array([None], pa.list_(pa.int64())),
        pa.array([["a"], ["b"]]),
    ):
        assert list(numbers("x", column)) == []


def test_batches_are_joined_with_their_masks_while_they_are_alike() -> None:
    one = LogColumn("a", np.array([1.0, 2.0]), "rad", np.array([False, True]), first=7)
    two = LogColumn("b[0]", np.array([5.0, 6.0]), first=9)
    read = Batches(4)
    assert read.columns() == []
    read.add([one, two], 2)
    assert (read.first("a"), read.first("b"), read.first("c")) == (7, 9, None)
    read.add([one._replace(empty=None), two], 2)
    a, b = read.columns()
    same(a.values, [1.0, 2.0, 1.0, 2.0])
    same(a.empty, [False, True, False, False])
    assert (b.empty, a.unit, read.rows) == (None, "rad", 4)
    with pytest.raises(UnlikeBeforeError):
        read.add([one, two], 1)  # more than there is room for
    for other in ([one], [two, one], [one._replace(first=8), two]):
        read = Batches(8)
        read.add([one, two], 2)
        with pytest.raises(UnlikeBeforeError):
            read.add(other, 2)


def test_a_column_is_written_whole_wherever_the_system_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    write = on_disk.os.pwrite
    monkeypatch.setattr(on_disk.os, "pwrite", lambda file, data, place: write(file, data[:5], place))
    file = on_disk.ColumnFile(2, 3)
    for column, first, values in ((0, 0, [1.0, 2.0, 3.0]), (1, 1, [5.0])):
        file.write(column, first, np.array(values))
    same(file.columns(3), [[1.0, 2.0, 3.0], [0.0, 5.0, 0.0]])  # type: ignore[list-item]
    same(on_disk.ColumnFile(2, 0).columns(0), [[], []])  # type: ignore[list-item]


def rrd(folder: Path, **timelines: Any) -> Path:
    """Scalars of two entities, of which the second has two and begins later, over one timeline."""
    rr = pytest.importorskip("rerun")
    path = folder / "log.rrd"
    with rr.RecordingStream("by_hand") as stream:
        stream.save(path)
        stream.log("about", rr.Scalars(1.0), static=True)
        ((name, (kind, times)),) = timelines.items()
        for entity, rows in (("arm/p", [[10.0], [11.0], [12.0]]), ("tau", [[1.0, 2.0], [3.0, 4.0]])):
            for time, row in zip(times[3 - len(rows) :], rows, strict=True):
                stream.set_time(name, **{kind: time})
                stream.log(entity, rr.Scalars(row))
    return path


@pytest.mark.parametrize(
    ("kind", "times", "wanted"), [("duration", [1.5, 2.0, 4.0], [0.0, 0.5, 2.5]), ("sequence", [3, 4, 8], [0, 1, 5])]
)
def test_scalars_of_rerun_are_at_their_times_and_empty_elsewhere(
    kind: str, times: list[float], wanted: list[float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = read_rrd(path := rrd(tmp_path, time=(kind, times)))
    assert list(log.columns) == ["time", "arm.p", "tau[0]", "tau[1]"]
    np.testing.assert_allclose(log.columns["time"], wanted)
    for name, values in (("arm.p", [10.0, 11.0, 12.0]), ("tau[0]", [NAN, 1.0, 3.0]), ("tau[1]", [NAN, 2.0, 4.0])):
        same(log.columns[name], values)
    assert log.units == ({"time": "s"} if kind == "duration" else {})
    assert {name: mask.tolist() for name, mask in log.empty.items()} == {
        name: [True, False, False] for name in ("tau[0]", "tau[1]")
    }
    monkeypatch.setattr("adaptctl.logs.table.MAX_ROWS", 2)
    with pytest.raises(FileError, match="has 3 rows, more than the limit of 2"):
        read_rrd(path)


@pytest.mark.parametrize(
    ("topics", "asked", "chosen"),
    [
        ("/a", None, "/a"),
        ("/a /joint_states", None, "/joint_states"),
        ("/a /joint_states", "/a", "/a"),
        ("/a", "/b", "no joint-state topic /b; topics: /a"),
        ("/b /a", None, "several joint-state topics: /a, /b"),
        ("/joint_states /proto", "/proto", "/proto is encoded as protobuf"),
    ],
)
def test_a_topic_of_foxgloves_is_that_asked_for_the_usual_or_the_only_one(
    topics: str, asked: str | None, chosen: str
) -> None:
    encodings = {topic: "protobuf" if topic == "/proto" else "json" for topic in topics.split()}
    if " " in chosen:
        with pytest.raises(FileError, match=chosen):
            foxglove._chosen("log.mcap", encodings, asked)
    else:
        assert foxglove._chosen("log.mcap", encodings, asked) == chosen


def test_joint_states_of_foxglove_have_those_fields_that_all_joints_have() -> None:
    joints = [{"name": "a", "position": 1.0, "effort": 3.0}, {"name": "b", "position": 2.0}]
    data = json.dumps({"timestamp": {"sec": 4, "nsec": 5}, "joints": joints}).encode()
    reader = SimpleNamespace(iter_messages=lambda topics: [(None, topics, SimpleNamespace(data=data, log_time=6))])
    ((logged, message),) = foxglove._messages(reader, "/a")
    assert (logged, message.name, message.position, message.effort) == (6, ["a", "b"], [1.0, 2.0], [])
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.velocity) == (4, 5, [])


def test_what_a_process_has_read_comes_back_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[Any] = []
    monkeypatch.setattr(child, "_bounded", lambda *limits: begun.append(limits))
    monkeypatch.setattr(gc, "disable", lambda: begun.append("quick"))
    monkeypatch.setattr(child, "release", lambda: begun.append("given back"))
    path, told = tmp_path / "log.csv", [str(2**30), "10.5"]
    path.write_text("t,p,q\n1,,abc\n2,0.5,\n")
    child.main(["text:read_delimited", str(path), str(tmp_path), *told])
    assert begun == [(2**30, 10.5), "quick", *["given back"] * 3]
    found, own = isolated._table(tmp_path, isolated._head(tmp_path, path, 0, 0)), read_delimited(path)
    for name, values in own.columns.items():
        same(found.columns[name], values.tolist())
    assert {name: mask.tolist() for name, mask in found.empty.items()} == {"p": [True, False], "q": [False, True]}
    assert (found.source, found.units, found.words, found.numbered) == (str(path), own.units, {"q": "abc"}, False)
    monkeypatch.setattr("adaptctl.logs.table.MAX_COLUMNS", 2)
    monkeypatch.setattr(child, "import_module", lambda name: SimpleNamespace(read=lambda path: own))
    child.main(["any:read", str(path), str(tmp_path), *told])
    assert isolated._head(tmp_path, path, 0, 0)["error"] == "FileError"


@pytest.mark.parametrize(
    ("texts", "decimal", "values"),
    [
        (["01:02:03", "01:02:04,5"], ".", [3723.0, 3724.5]),
        (["1.234,5", "2"], ",", [1234.5, 2.0]),
        (["1'234", "x"], ".", [1234.0, NAN]),
        (["1,234", "5x"], ".", [NAN, NAN]),  # of one mark, which may be decimal
        (["1,234,567", "1,234", "x"], ".", [1234567.0, 1234.0, NAN]),
        (["1 234", "1'234"], ".", [NAN, NAN]),  # two marks are none
        (["1.5", "x"], ",", [NAN, NAN]),
    ],
)
def test_texts_are_times_of_day_or_numbers_with_marks_between_thousands(
    texts: list[str], decimal: str, values: list[float]
) -> None:
    found = text_columns.text_column("x", pa.chunked_array([[*texts, None]]), decimal)
    same(found.values, [*values, NAN])
    same(found.empty, [*[False] * len(texts), True])
    assert found.unit == ("s" if ":" in texts[0] else "")
    assert found.word == next((cell for cell, value in zip(texts, values, strict=True) if np.isnan(value)), None)


@pytest.mark.parametrize(
    ("sec", "nanosec", "joined"),
    [
        ([1.0, 2.0], [0.0, 999_999_999.0], True),
        ([1.0, 2.0], [0.0, 1e9], False),
        ([1.0, 2.0], [-1.0, 5.0], False),
        ([1.0, 2.0], [0.5, 5.0], False),
        ([1.0, 2.5], [0.0, 5.0], False),
        ([NAN, 2.0], [0.5, 5.0], True),  # rows without both do not count
        ([NAN, NAN], [1.0, 5.0], False),
    ],
)
def test_seconds_and_their_rest_are_whole_numbers_in_range(
    sec: list[float], nanosec: list[float], joined: bool
) -> None:
    log = LogTable("a", {"Stamp.Sec": np.array(sec), "stamp.nsec": np.array(nanosec)})
    assert (whole_stamps(log) is not log) is joined
    if joined:
        assert whole_stamps(log).notes == ("Stamp.Sec and stamp.nsec are taken as one stamp",)


def test_rows_are_chosen_with_their_masks_and_a_note() -> None:
    log = LogTable("a", {"x": np.arange(3.0)}, empty={"x": np.array([True, False, False])}, notes=("one",))
    kept = np.array([True, False, True])
    assert log.rows(np.ones(3, dtype=bool), "none") is log
    part = log.rows(kept, "two")
    same(part.columns["x"], [0.0, 2.0])
    same(part.empty["x"], [True, False])
    assert part.notes == ("one", "two")
    assert (len(part), len(LogTable("a", {}))) == (2, 0)


def test_a_joint_of_a_data_set_is_named_by_its_feature_or_number() -> None:
    def names(**about: Any) -> list[str]:
        return list(lerobot._joints({"dtype": "float32", **about}))

    assert names(shape=[2]) == ["1", "2"]
    assert len(names(shape=[1000])) == 1000
    assert names(shape=[2], names={"axes": None, "motors": ["a", "b"]}) == ["a", "b"]
    assert names(shape=[2], names=["a"]) == ["1", "2"]
    for none in ({"shape": [1001]}, {"shape": [0]}, {"shape": [2, 2]}, {"shape": ["2"]}, {"shape": [2], "dtype": "u8"}):
        assert names(**none) == []


def test_quotation_marks_among_blanks_are_taken_off_cells() -> None:
    assert cells('"a"   1 ', " ") == ["a", "1"]
    assert cells('"a;b";1', ";") == ["a;b", "1"]


def form_of(path: Path, *lines: str) -> TextForm:
    path.write_text("\n".join(lines) + "\n")
    return text_form.form_of(path)


def test_a_form_is_told_by_so_many_lines(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    assert [form_of(path, "a;b", *["1;1"] * n, "1,5;1").decimal for n in (4999, 5000)] == [",", "."]
    assert [text_form._mark(["#"] * n + ["1;2", "1,2,3,4"]) for n in (198, 199)] == [",", ";"]
    assert text_form._mark(["7", "a;1;2"]) == ","  # of all cells, not of three in four
    assert form_of(path, *["1,5"] * 150, "x,5").mark == ","  # of cells of both, half a percent counts as none
    assert form_of(path, "# p", "1", "2").names == ["p"]
    apart = form_of(path, "t,b", "", "s,rad", "1,2")
    assert (apart.names, apart.units) == (["s", "rad"], {})


def test_a_sample_ends_with_a_whole_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text_form, "HEAD", 5)
    assert text_form._lines(b"1,2\n3", "utf-8") == ["1,2"]
    assert text_form._lines(b"1,2\n", "utf-8") == ["1,2", ""]
    assert text_form._lines(b"1,234", "utf-8") == ["1,234"]


@pytest.mark.parametrize("large", [0, 2**30])
def test_texts_of_too_many_rows_are_refused(large: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (path := tmp_path / "log.csv").write_text("a,b\n" + "1,2\n" * 4)
    monkeypatch.setattr(on_disk, "LARGE", large)
    monkeypatch.setattr(text, "BLOCK", 9)
    monkeypatch.setattr("adaptctl.logs.table.MAX_ROWS", 4)
    assert len(read_delimited(path)) == 4
    monkeypatch.setattr("adaptctl.logs.table.MAX_ROWS", 3)
    with pytest.raises(FileError, match="has 4 rows, more than the limit of 3"):
        read_delimited(path)


def test_memory_is_given_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given_back: list[int] = []
    pool = SimpleNamespace(release_unused=lambda: given_back.append(0))
    monkeypatch.setattr("pyarrow.default_memory_pool", lambda: pool)
    (path := tmp_path / "log.csv").write_text("a,b\n1,2\n")
    read_delimited(path)
    assert given_back == [0]
    held: list[Any] = [1]
    forget(held)
    assert (held, given_back) == ([], [0, 0])
    monkeypatch.setattr(on_disk, "_maps", [SimpleNamespace(madvise=given_back.append)])
    on_disk.release()
    assert given_back[2:] == [mmap.MADV_DONTNEED]
    assert len(list(on_disk.each_column(np.ones((2, 3))))) == 3
    assert len(given_back) == 6  # after each column


@pytest.mark.parametrize(("error", "told"), [(ValueError("why\nmore"), "(why)"), (ValueError(), "(ValueError)")])
def test_why_a_reader_failed_is_told_in_a_line(
    error: Exception, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*given: Any, **more: Any) -> None:
        raise error

    monkeypatch.setattr(ros_bag, "_rosbags", lambda: SimpleNamespace(AnyReader=fails, typestore=None))
    monkeypatch.setattr(foxglove, "_reader", fails)
    monkeypatch.setattr("rerun.chunk.RrdReader", fails)
    (path := tmp_path / "log").touch()
    for read in (ros_bag.read_ros_bag, foxglove.read_mcap, read_rrd):
        with pytest.raises(FileError, match=re.escape(told) + "$"):
            read(path)


def test_names_that_are_near_are_three_at_most() -> None:
    log = LogTable("log", {f"joint_{k}": np.zeros(1) for k in range(5)})
    assert log.near("joint").count(",") == log.near("j").count(",") == 2
    assert log.near("") == ""


def test_readers_of_bags_unpack_by_bounds_of_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    from rosbags.rosbag2 import storage_mcap

    monkeypatch.setattr(storage_mcap, "DECOMPRESSORS", {})
    ros_bag._rosbags()
    for unpack in (storage_mcap.DECOMPRESSORS[name] for name in ("zstd", "lz4")):
        with pytest.raises(ValueError, match="more than the limit"):
            unpack(b"", ros_bag.MAX_CHUNK + 1)
