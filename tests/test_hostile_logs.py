"""Binary logs: as people have them, and hostile ones, which are refused in one line within bounds."""

from __future__ import annotations

import json
import os
import resource
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import rerun as rr
from backports import zstd
from mcap.writer import Writer as McapWriter
from nightly import at_night
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from adaptctl.errors import FileError
from adaptctl.identification.complete_rows import complete_rows
from adaptctl.identification.log_files import read_log
from adaptctl.logs import child, isolated
from adaptctl.logs.foxglove import read_mcap
from adaptctl.logs.lerobot import _joints, read_lerobot
from adaptctl.logs.parquet import _validate_unpacked
from adaptctl.logs.rerun_recording import _timeline
from adaptctl.logs.ros_bag import joint_table, read_ros_bag

COUNT = 200
T = np.arange(COUNT) / 100.0
NAMES = ["shoulder", "elbow"]
TYPES = get_typestore(Stores.LATEST)
STATE, HEADER, STAMP = (
    TYPES.types[name] for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
)


def bag(folder: Path, plugin: StoragePlugin = StoragePlugin.MCAP, gripper: bool = False, late: int = 0) -> Path:
    """Bag of an arm's states, whose efforts begin late, and perhaps of a gripper's on the same topic."""
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/joint_states", STATE.__msgtype__, typestore=TYPES)
        for i, t in enumerate(T):
            order = [1, 0] if gripper and i % 3 == 1 else [0, 1]
            effort = np.array([np.nan, np.nan]) if i < late else np.array([np.cos(t), 2.0 * t])[order]
            states = [([NAMES[k] for k in order], np.array([np.sin(t), t])[order], effort)]
            if gripper and i % 2:
                states.append((["finger"], np.array([0.01]), np.array([])))
            for names, position, torque in states:
                at = HEADER(stamp=STAMP(sec=1_726_000_000 + i // 100, nanosec=i % 100 * 10_000_000), frame_id="")
                message = STATE(header=at, name=names, position=position, velocity=np.array([]), effort=torque)
                writer.write(connection, 10_000_000 * i, TYPES.serialize_cdr(message, STATE.__msgtype__))
    return folder


def lerobot(folder: Path, pattern: str, place: str, features: dict[str, object] | None = None) -> Path:
    about = {"dtype": "float32", "shape": [2], "names": [f"{name}.pos" for name in NAMES]}
    effort = {"dtype": "float32", "shape": [2], "names": {"motors": NAMES}}
    given = {"observation.state": about, "observation.effort": effort, "action": about}
    (folder / "meta").mkdir(parents=True)
    info = {"codebase_version": "v3.0", "fps": 100, "data_path": pattern, "features": features or given}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    half = COUNT // 2
    columns = {
        "timestamp": np.r_[T[:half], T[:half]].astype(np.float32),
        "episode_index": np.repeat([0, 1], half),
        "observation.state": pa.array(np.stack([np.sin(T), T], axis=-1).tolist(), pa.list_(pa.float32(), 2)),
        "observation.effort": pa.array(np.stack([np.cos(T), 2 * T], axis=-1).tolist(), pa.list_(pa.float32())),
    }
    (folder / place).parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), folder / place)
    return folder


V3, FILE = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet", "data/chunk-000/file-000.parquet"


def recording(path: Path) -> Path:
    stream = rr.RecordingStream("log")
    stream.save(path)
    for t in T:
        stream.set_time("time", duration=t)
        for j, name in enumerate(NAMES):
            stream.log(f"position/{name}", rr.Scalars([np.sin(t), t][j]))
            stream.log(f"effort/{name}", rr.Scalars([np.cos(t), 2.0 * t][j]))
    stream.disconnect()
    return path


def foxglove(path: Path, encoding: str = "json", topics: tuple[str, ...] = ("/arm",)) -> Path:
    """Joint states by Foxglove's schema, as its documentation has them."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("foxglove.JointStates", "jsonschema", b"{}")
        channels = [writer.register_channel(topic, encoding, schema) for topic in topics]
        for i, t in enumerate(T):
            joints = [
                {"name": name, "position": [np.sin(t), t][j], "effort": [np.cos(t), 2.0 * t][j]}
                for j, name in enumerate(NAMES)
            ]
            stamp = {"sec": 1_726_000_000 + i // 100, "nsec": i % 100 * 10_000_000}
            data = json.dumps({"timestamp": stamp, "joints": joints}).encode()
            for channel in channels:
                writer.add_message(channel, 10_000_000 * i, data, 10_000_000 * i)
        writer.finish()
    return path


@pytest.mark.isolated
def test_joint_states_of_foxglove_are_read(tmp_path: Path) -> None:
    log = read_mcap(foxglove(tmp_path / "log.mcap"))
    assert list(log.columns) == ["time", *(f"{what}.{name}" for what in ("position", "effort") for name in NAMES)]
    np.testing.assert_allclose(log.columns["time"], T, atol=1e-9)
    np.testing.assert_array_equal(log.columns["effort.elbow"], 2.0 * T)
    assert log.units["effort.elbow"] == "N m"
    two = foxglove(tmp_path / "two.mcap", topics=("/left", "/right"))
    assert len(read_mcap(two, "/right")) == COUNT
    with pytest.raises(FileError, match="several joint-state topics: /left, /right; select one with --topic"):
        read_mcap(two)
    with pytest.raises(FileError, match="no joint-state topic /none; topics: /left, /right"):
        read_mcap(two, "/none")
    with pytest.raises(FileError, match="/arm is encoded as protobuf; Foxglove's joint states are read as JSON"):
        read_mcap(foxglove(tmp_path / "other.mcap", "protobuf"))
    (tmp_path / "cut.mcap").write_bytes((tmp_path / "log.mcap").read_bytes()[:2000])
    with pytest.raises(
        FileError, match=r"cut\.mcap: no topic of foxglove.JointStates or of ROS in it; is the file cut"
    ):
        read_mcap(tmp_path / "cut.mcap")


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_bags_of_several_publishers_in_any_order_are_read(plugin: StoragePlugin, tmp_path: Path) -> None:
    log = read_ros_bag(bag(tmp_path / "bag", plugin, gripper=True, late=7))
    assert log.notes == ("100 messages of other publishers were left out (finger)",)
    used = [f"{what}.{name}" for what in ("position", "effort") for name in NAMES]
    whole = complete_rows(log, used, "time")
    assert whole.notes[1] == "7 rows at the ends that are not finite were left out"
    np.testing.assert_allclose(whole.columns["time"], T[7:], atol=1e-9)
    np.testing.assert_allclose(whole.columns["position.elbow"], T[7:])
    np.testing.assert_allclose(whole.columns["effort.shoulder"], np.cos(T[7:]))
    assert "velocity.elbow" not in whole.columns


def test_messages_are_kept_as_numbers_alone() -> None:
    def messages(count: int) -> Iterator[tuple[int, Any]]:
        for i in range(count):
            header = HEADER(stamp=STAMP(sec=0, nanosec=0), frame_id="")
            p = np.array([1.0, 2.0]) * i
            yield i, STATE(header=header, name=["a" * 40, "b" * 40], position=p, velocity=np.array([]), effort=-p)

    tracemalloc.start()
    found = joint_table("a bag", messages(4000))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 4000 * 400  # bytes
    np.testing.assert_array_equal(found.columns["effort." + "b" * 40], -2.0 * np.arange(4000.0))
    np.testing.assert_allclose(found.columns["time"], 1e-9 * np.arange(4000.0))


@pytest.mark.parametrize(
    ("pattern", "place"),
    [
        (V3, FILE),
        (
            "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
            "data/chunk-000/episode_000000.parquet",
        ),
    ],
)
def test_data_sets_of_lerobot_are_read(pattern: str, place: str, tmp_path: Path) -> None:
    log = read_log(lerobot(tmp_path / "set", pattern, place))
    assert list(log.columns) == [
        "time",
        "episode_index",
        *(f"position.{n}" for n in NAMES),
        *(f"effort.{n}" for n in NAMES),
    ]
    np.testing.assert_allclose(log.columns["position.elbow"], T, atol=1e-6)
    np.testing.assert_allclose(log.columns["effort.shoulder"], np.cos(T), atol=1e-6)
    assert len(complete_rows(log, ["position.elbow"], "time").notes) == 1


@pytest.mark.parametrize(("shape", "count"), [([1], 1), ([3], 3), ([1000], 1000), ([1001], 0), ([0], 0), ([2, 2], 0)])
def test_places_of_a_data_set_without_names_are_numbered_from_one(shape: list[int], count: int) -> None:
    assert list(_joints({"dtype": "float32", "shape": shape})) == [str(i) for i in range(1, count + 1)]


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("../outside/{file_index}.parquet", "expected a path within the data set"),
        ("/etc/{file_index}.parquet", "expected a path within the data set"),
        ("data/{file_index.__class__}.parquet", "expected numbers as in data/"),
        ("data/{file_index:99999999d}.parquet", "expected numbers as in data/"),
        ("data/{0}.parquet", "expected numbers as in data/"),
        ("data/file.parquet", "no files that fit data/file.parquet"),
    ],
)
def test_patterns_of_lerobot_are_not_followed_out_of_the_folder(pattern: str, message: str, tmp_path: Path) -> None:
    folder = lerobot(tmp_path / "set", pattern, FILE)
    with pytest.raises(FileError, match=message):
        read_lerobot(folder)


def test_files_of_a_data_set_follow_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = lerobot(tmp_path / "set", V3, FILE)
    one = read_lerobot(folder)
    rows = pq.read_table(folder / FILE)
    for k, part in enumerate((rows.slice(0, 30), rows.slice(30))):
        pq.write_table(part, folder / FILE.replace("file-000", f"file-00{k}"), row_group_size=70)
    monkeypatch.setattr("adaptctl.logs.on_disk.ROWS_AT_ONCE", 17)
    found = read_lerobot(folder)
    assert list(found.columns) == list(one.columns)
    for name, values in one.columns.items():
        np.testing.assert_array_equal(found.columns[name], values)
    pq.write_table(rows.drop_columns("observation.effort"), folder / FILE.replace("file-000", "file-002"))
    with pytest.raises(FileError, match=r"set: its files have other columns than each other$"):
        read_lerobot(folder)


def test_links_out_of_a_data_set_and_actions_are_no_log(tmp_path: Path) -> None:
    folder = lerobot(tmp_path / "set", V3, FILE)
    (folder / FILE).rename(tmp_path / "file-000.parquet")
    (folder / FILE).symlink_to(tmp_path / "file-000.parquet")
    with pytest.raises(FileError, match="no files that fit"):
        read_lerobot(folder)
    only = {"observation.state": {"dtype": "float32", "shape": [2], "names": NAMES}, "action": {}}
    with pytest.raises(FileError, match=r"an action is no torque; record observation.effort; features: ob"):
        read_lerobot(lerobot(tmp_path / "other", V3, FILE, only))
    many = only | {f"observation.image{k:02d}": {} for k in range(30)}
    with pytest.raises(FileError, match=r"image17$"):  # twenty of them are told
        read_lerobot(lerobot(tmp_path / "many", V3, FILE, many))


def test_recordings_are_read(tmp_path: Path) -> None:
    log = read_log(recording(tmp_path / "log.rrd"))
    assert set(log.columns) == {"time", *(f"{what}.{name}" for what in ("position", "effort") for name in NAMES)}
    np.testing.assert_allclose(log.columns["time"], T, atol=1e-9)
    np.testing.assert_allclose(log.columns["effort.elbow"], 2.0 * T, atol=1e-12)
    assert log.units == {"time": "s"}


def test_files_of_one_log_are_joined(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "q.txt", np.stack([np.sin(T), T], axis=-1))
    np.savetxt(tmp_path / "tau.txt", np.stack([np.cos(T), 2 * T], axis=-1))
    log = read_log(f"{tmp_path}/q.txt+{tmp_path}/tau.txt")
    assert list(log.columns) == ["1", "2", "3", "4"]
    np.testing.assert_allclose(log.columns["4"], 2 * T)
    begin = 1_726_000_000 * 10**9
    for name, late in (("q", 0), ("tau", 3_000_000)):
        stamps = begin + late + (1e9 * T).round().astype(np.int64)
        pq.write_table(pa.table({"time": stamps, "x": stamps - begin}), tmp_path / f"{name}.parquet")
    log = complete_rows(read_log(f"{tmp_path}/q.parquet+{tmp_path}/tau.parquet"), ["q.x", "tau.x"], "time")
    np.testing.assert_allclose(log.columns["tau.x"], log.columns["q.x"], atol=1.0)
    np.testing.assert_allclose(log.columns["time"], log.columns["q.x"], atol=1.0)
    (tmp_path / "short.csv").write_text("a,b\n1,2\n")
    with pytest.raises(FileError, match=r"other numbers of rows \(q.txt 200, short.csv 1\)"):
        read_log(f"{tmp_path}/q.txt+{tmp_path}/short.csv")


@pytest.mark.isolated
def test_a_bomb_is_refused_soon_and_without_memory(tmp_path: Path) -> None:
    place = next(bag(tmp_path / "bag").glob("*.mcap"))
    packed = zstd.compress(bytes(500 * 2**20))
    assert len(packed) < 60_000
    data = place.read_bytes()
    bomb = tmp_path / "bomb.mcap"
    record = (
        bytes(8)
        + (1).to_bytes(8, "little")
        + (500 * 2**20).to_bytes(8, "little")
        + bytes(4)
        + (4).to_bytes(4, "little")
        + b"zstd"
    )
    record += len(packed).to_bytes(8, "little") + packed
    head = data[: 8 + 9 + int.from_bytes(data[9:17], "little")]
    footer = b"\x02" + (20).to_bytes(8, "little") + bytes(20) + b"\x89MCAP0\r\n"
    bomb.write_bytes(head + b"\x06" + len(record).to_bytes(8, "little") + record + footer)
    zeros = pa.table({"time": np.zeros(60_000_000, dtype=np.int8)})
    pq.write_table(zeros, tmp_path / "bomb.parquet", compression="zstd")
    begin = time.monotonic()
    for name in ("bomb.mcap", "bomb.parquet"):
        with pytest.raises(FileError, match=name):
            read_log(tmp_path / name)
    assert time.monotonic() - begin < 20.0


@pytest.mark.isolated
def test_a_reader_that_waits_or_grows_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "log.mcap")
    monkeypatch.setattr(isolated, "TIME", 0.5)
    monkeypatch.setattr(isolated, "WAITING", 1.0)
    with pytest.raises(FileError, match=r"log\.mcap: was not read within 2 s; is it damaged"):
        isolated.read_isolated("foxglove:read_mcap", tmp_path / "log.mcap")
    pq.write_table(pa.table({"time": np.random.default_rng(0).normal(size=1000)}), tmp_path / "log.parquet")
    monkeypatch.setattr(isolated, "TIME", 10.0)
    monkeypatch.setattr(isolated, "WAITING", 20.0)
    monkeypatch.setattr(isolated, "MEMORY", 150 * 2**20)
    with pytest.raises(FileError, match=r"log\.parquet: cannot be read within 0\.15 GB and the time that a file"):
        read_log(tmp_path / "log.parquet")


def real(tmp_path: Path) -> Iterator[Path]:
    yield next(bag(tmp_path / "a").glob("*.mcap"))
    yield next(bag(tmp_path / "b", StoragePlugin.SQLITE3).glob("*.db3"))
    lerobot(tmp_path / "set", V3, FILE)
    yield tmp_path / "set" / FILE
    yield recording(tmp_path / "log.rrd")
    yield foxglove(tmp_path / "foxglove.mcap")


@pytest.mark.isolated
@pytest.mark.parametrize("every", [False, at_night(True)])
def test_mutated_files_are_read_or_refused_in_one_line(every: bool, tmp_path: Path) -> None:
    """By the bounded process: the packages abort on some, or ask for any memory."""
    rng = np.random.default_rng(0)
    for n, place in enumerate(real(tmp_path)):
        data = place.read_bytes()
        for k in (0, 2) if every else (2 * (n % 2),):
            spoilt = bytearray(data)
            for at in rng.integers(0, len(data), size=1 + 3 * k):
                spoilt[at] = rng.integers(256)
            part = spoilt[: int(rng.integers(len(data)))] if k == 2 else spoilt
            bad = tmp_path / f"bad{place.suffix}"
            bad.write_bytes(bytes(part))
            told = ""
            try:
                read_log(bad)
            except FileError as error:
                told = str(error)
            assert not told or (str(bad) in told and "\n" not in told)


@pytest.mark.parametrize(
    ("timelines", "chosen"),
    [
        ([{"time", "tick", "log_time"}, {"time", "log_time"}], "time"),
        ([{"time", "tick"}, {"tick", "time"}], "time"),
        ([{"tick", "log_time", "log_tick"}, {"tick", "log_time"}], "tick"),
        ([{"tick", "step", "log_time"}, {"step", "log_time"}], "step"),
        ([{"tick", "log_time"}, {"step", "log_time"}], "log_time"),
        ([{"tick", "step"}, {"step", "tick"}], "several timelines: step, tick"),
        ([{"tick", "log_time"}, {"step"}], "no timeline in common"),
    ],
)
def test_scalars_are_at_times_of_their_own_before_those_of_their_arrival(
    timelines: list[set[str]], chosen: str
) -> None:
    batches = [
        SimpleNamespace(schema=[SimpleNamespace(name="other", metadata=None), *(timeline(name) for name in names)])
        for names in timelines
    ]
    refused = " " in chosen
    with pytest.raises(FileError, match=chosen) if refused else nullcontext():
        assert _timeline("a.rrd", batches) == chosen


def timeline(name: str) -> SimpleNamespace:
    return SimpleNamespace(name=name, metadata={b"rerun:kind": b"index"})


def test_a_table_may_be_so_many_times_as_large_unpacked_as_its_file(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    path.write_bytes(b"x" * 1000)

    def declared(*sizes: int) -> Any:
        groups = [SimpleNamespace(total_byte_size=size) for size in sizes]
        return SimpleNamespace(num_row_groups=len(sizes), row_group=groups.__getitem__)

    most = 400 * 2**20 + 1000 * 1000
    _validate_unpacked(path, declared(0))
    _validate_unpacked(path, declared(most - 7, 7))
    for sizes in ((most, 1), (-1,)):
        with pytest.raises(FileError, match="more than is read"):
            _validate_unpacked(path, declared(*sizes))
    os.truncate(path, 2**30)  # of zeros, which take no room on disk
    _validate_unpacked(path, declared(8 * 2**30))
    with pytest.raises(FileError, match="more than is read"):
        _validate_unpacked(path, declared(8 * 2**30 + 1))


def test_a_reader_is_bound_in_memory_and_time_and_leaves_no_core(monkeypatch: pytest.MonkeyPatch) -> None:
    limits: dict[int, tuple[int, int]] = {}
    monkeypatch.setattr(resource, "setrlimit", limits.__setitem__)
    child._bounded(12345, 2.5)
    assert limits == {
        resource.RLIMIT_AS: (12345, 12345),
        resource.RLIMIT_CPU: (3, 3),
        resource.RLIMIT_CORE: (0, 0),
    }
