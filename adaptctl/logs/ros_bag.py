"""Reader of ROS bags."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import AdaptctlError, FileError, MissingExtraError
from adaptctl.logs.joint_states_cdr import JointStates, joint_states
from adaptctl.logs.table import MAX_ROWS, LogTable, table, validate_size

JOINT_STATE = "sensor_msgs/msg/JointState"
# Fields of a JointState, in the units that its definition states for joints that turn.
FIELDS = (("position", "rad"), ("velocity", "rad/s"), ("effort", "N m"))
MAX_JOINTS, MAX_CHUNK = 1000, 256 * 2**20


def read_ros_bag(path: str | Path, topic: str | None = None) -> LogTable:
    """Table of the JointState messages in a ROS 1 or ROS 2 bag."""
    rosbags = _rosbags()
    try:
        with rosbags.AnyReader([Path(path)], default_typestore=rosbags.typestore) as reader:
            chosen = _connections(path, reader.connections, topic)
            raw = ((stamp, raw) for _, stamp, raw in reader.messages(connections=chosen))
            return joint_table(path, joint_states(raw, lambda data: reader.deserialize(data, JOINT_STATE)))
    except (AdaptctlError, MemoryError):
        raise
    except Exception as error:  # the package reads damaged bags without checks: any error may come of their bytes
        told = (str(error) or type(error).__name__).splitlines()[0]
        raise FileError(f"{path}: cannot be read as a ROS bag ({told})") from error


class _Messages:
    """Stamps and numbers of the messages of some joints, one after the other, in the order of the first."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = list(names)
        self.stamps, self.logged = array("q"), array("q")
        self._rows = {kind: array("d") for kind, _ in FIELDS}
        self._orders: dict[tuple[str, ...], list[int]] = {}
        self._none = np.full(len(names), np.nan)

    def add(self, logged: int, message: Any) -> None:
        """Add a message by the time in ns at which it was logged; fields of another length are empty."""
        given = tuple(message.name)
        if given not in self._orders:
            self._orders[given] = [given.index(name) for name in self.names]
        self.logged.append(logged)
        self.stamps.append(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec)
        for kind, own in self._rows.items():
            row = getattr(message, kind)
            whole = len(row) == len(self.names)
            values = np.asarray(row, dtype=np.float64)[self._orders[given]] if whole else self._none
            own.frombytes(values.tobytes())

    def add_all(self, states: JointStates) -> None:
        """Add messages; fields of another length are empty."""
        order = [list(states.name).index(name) for name in self.names]
        self.logged.frombytes(states.logged.tobytes())
        self.stamps.frombytes(states.stamps.tobytes())
        for kind, own in self._rows.items():
            rows = states.rows[kind]
            whole = rows.shape[1] == len(self.names)
            own.frombytes((rows[:, order] if whole else np.tile(self._none, (len(rows), 1))).tobytes())

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Columns of time from 0, and of the fields that have numbers."""
        stamps = self.stamps if any(self.stamps) else self.logged
        yield "time", 1e-9 * (np.array(stamps) - stamps[0])
        for kind, own in self._rows.items():
            values = np.array(own).reshape(-1, len(self.names))
            if np.isfinite(values).any():
                yield from ((f"{kind}.{name}", column) for name, column in zip(self.names, values.T, strict=True))


def joint_table(path: str | Path, messages: Iterable[tuple[int, Any] | JointStates]) -> LogTable:
    """Table of messages as JointState has them, each with the time in ns at which it was logged, or many."""
    found: dict[tuple[str, ...], _Messages] = {}
    count = 0
    for one in messages:
        names, many = (one.name, len(one.stamps)) if isinstance(one, JointStates) else (one[1].name, 1)
        count += many
        validate_size(path, count, 1)
        if (key := tuple(sorted(names))) not in found:
            found[key] = _Messages(names)
        if isinstance(one, JointStates):
            found[key].add_all(one)
        else:
            found[key].add(*one)
    if not found:
        raise FileError(f"{path}: has 0 joint states; expected 1 to {MAX_ROWS}")
    states, notes = _of_one_robot(path, found)
    units = {"time": "s"} | {f"{field}.{name}": unit for field, unit in FIELDS for name in states.names}
    read = table(str(path), states.columns(), units)
    return LogTable(read.source, read.columns, read.units, notes=tuple(notes))


def _of_one_robot(path: str | Path, found: dict[tuple[str, ...], _Messages]) -> tuple[_Messages, list[str]]:
    """Messages of the most frequent set of joints, and a note on those of other publishers."""
    counts = Counter({names: len(states.stamps) for names, states in found.items() if names})
    if not counts:
        raise FileError(f"{path}: no joint state has names of joints")
    ((most, count), *others) = counts.most_common()
    if len(most) > MAX_JOINTS or len(set(most)) < len(most):
        raise FileError(f"{path}: joint states name {len(most)} joints, {len(set(most))} of them different")
    rivals = [one for one, other in others if other == count]
    if rivals:
        both = " and for ".join(", ".join(one) for one in (most, rivals[0]))
        raise FileError(f"{path}: as many messages are for the joints {both}; give the topic of one source")
    joined = sorted({name for one in counts for name in one} - set(most))
    left = sum(len(states.stamps) for states in found.values()) - count
    note = f"{left} messages of other publishers were left out ({', '.join(joined) or 'fewer joints'})"
    return found[most], [note] if left else []


def _connections(path: str | Path, connections: list[Any], topic: str | None) -> list[Any]:
    states = [c for c in connections if c.msgtype == JOINT_STATE and topic in (None, c.topic)]
    topics = sorted({c.topic for c in connections if c.msgtype == JOINT_STATE})
    if not states:
        known = ", ".join(topics) or f"no topic of {JOINT_STATE}"
        raise FileError(f"{path}: no joint-state topic {topic or ''}".rstrip() + f"; topics: {known}")
    if len({c.topic for c in states}) > 1:
        raise FileError(f"{path}: several joint-state topics: {', '.join(topics)}; select one with --topic")
    return states


def _bound_chunks() -> None:
    """Let chunks of MCAP unpack to no more than they declare, and to no more than a bound."""
    from backports import zstd
    from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]
    from rosbags.rosbag2 import storage_mcap

    def bounded(of: Any) -> Any:
        def unpacked(data: bytes, size: int) -> bytes:
            if size > MAX_CHUNK:
                raise ValueError(f"a chunk declares {size} bytes, more than the limit of {MAX_CHUNK}")
            return bytes(of().decompress(data, size + 1))

        return unpacked

    own = {"zstd": bounded(zstd.ZstdDecompressor), "lz4": bounded(LZ4FrameDecompressor)}
    storage_mcap.DECOMPRESSORS.update(own)


def _rosbags() -> Any:
    try:
        from types import SimpleNamespace

        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingExtraError("ROS bags need rosbags: pip install 'adaptctl[logs]'") from error
    _bound_chunks()
    typestore = get_typestore(Stores.LATEST)
    return SimpleNamespace(AnyReader=AnyReader, AnyReaderError=AnyReaderError, typestore=typestore)
