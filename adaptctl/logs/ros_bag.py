"""Reader of ROS bags."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import AdaptctlError, FileError, MissingExtraError
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
            messages = []
            for connection, stamp, raw in reader.messages(connections=chosen):
                messages.append((stamp, reader.deserialize(raw, connection.msgtype)))
                validate_size(path, len(messages), 1)
    except (AdaptctlError, MemoryError):
        raise
    except Exception as error:  # the package reads damaged bags without checks: any error may come of their bytes
        told = (str(error) or type(error).__name__).splitlines()[0]
        raise FileError(f"{path}: cannot be read as a ROS bag ({told})") from error
    return joint_table(path, messages)


def joint_table(path: str | Path, messages: list[tuple[int, Any]]) -> LogTable:
    """Table of stamped messages as JointState has them."""
    if not messages:
        raise FileError(f"{path}: has 0 joint states; expected 1 to {MAX_ROWS}")
    messages, notes = _of_one_robot(path, messages)
    names = list(messages[0][1].name)
    units = {"time": "s"} | {f"{field}.{name}": unit for field, unit in FIELDS for name in names}
    found = table(str(path), _columns(messages, names), units)
    return LogTable(found.source, found.columns, found.units, notes=tuple(notes))


def _of_one_robot(path: str | Path, messages: list[tuple[int, Any]]) -> tuple[list[tuple[int, Any]], list[str]]:
    """Messages of the most frequent set of joints, and a note on those of other publishers."""
    sets = [tuple(sorted(message.name)) for _, message in messages]
    counts = Counter(one for one in sets if one)
    if not counts:
        raise FileError(f"{path}: no joint state has names of joints")
    ((most, count), *others) = counts.most_common()
    if len(most) > MAX_JOINTS or len(set(most)) < len(most):
        raise FileError(f"{path}: joint states name {len(most)} joints, {len(set(most))} of them different")
    rivals = [one for one, other in others if other == count]
    if rivals:
        both = " and for ".join(", ".join(one) for one in (most, rivals[0]))
        raise FileError(f"{path}: as many messages are for the joints {both}; give the topic of one source")
    kept = [one for one, own in zip(messages, sets, strict=True) if own == most]
    joined = sorted({name for one in counts for name in one} - set(most))
    left = len(messages) - len(kept)
    note = f"{left} messages of other publishers were left out ({', '.join(joined) or 'fewer joints'})"
    return kept, [note] if left else []


def _columns(messages: list[tuple[int, Any]], names: list[str]) -> Iterator[tuple[str, Array]]:
    stamps = [message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec for _, message in messages]
    if not any(stamps):
        stamps = [stamp for stamp, _ in messages]
    yield "time", 1e-9 * np.array([stamp - stamps[0] for stamp in stamps], dtype=np.float64)
    orders = [[list(message.name).index(name) for name in names] for _, message in messages]
    for kind, _ in FIELDS:
        rows = [getattr(message, kind) for _, message in messages]
        if not any(len(row) == len(names) for row in rows):
            continue
        values = np.full((len(rows), len(names)), np.nan)
        for i, (row, order) in enumerate(zip(rows, orders, strict=True)):
            if len(row) == len(names):
                values[i] = np.asarray(row)[order]
        if np.isfinite(values).any():
            yield from ((f"{kind}.{name}", column) for name, column in zip(names, values.T, strict=True))


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
