"""Logs as they were written."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import AdaptctlError, FileError, MissingExtraError
from adaptctl.identification.log_table import MAX_BYTES, MAX_ROWS, LogTable, table

JOINT_STATE = "sensor_msgs/msg/JointState"
# Fields of a JointState, in the units that its definition states for joints that turn.
FIELDS = (("position", "rad"), ("velocity", "rad/s"), ("effort", "N m"))


def read_ros_bag(path: str | Path, topic: str | None = None) -> LogTable:
    """Table of the JointState messages in a ROS 1 or ROS 2 bag."""
    rosbags = _rosbags()
    try:
        with rosbags.AnyReader([Path(path)], default_typestore=rosbags.typestore) as reader:
            chosen = _connections(path, reader.connections, topic)
            messages = [
                (stamp, reader.deserialize(raw, connection.msgtype))
                for connection, stamp, raw in reader.messages(connections=chosen)
            ]
    except (AdaptctlError, MemoryError):
        raise
    except Exception as error:  # the package reads damaged bags without checks: any error may come of their bytes
        told = (str(error) or type(error).__name__).splitlines()[0]
        raise FileError(f"{path}: cannot be read as a ROS bag ({told})") from error
    if not messages or len(messages) > MAX_ROWS:
        raise FileError(f"{path}: has {len(messages)} joint states; expected 1 to {MAX_ROWS}")
    return table(str(path), _columns(path, messages), {"time": "s"} | _units(messages[0][1].name))


def _columns(path: str | Path, messages: list[tuple[int, Any]]) -> Iterator[tuple[str, Array]]:
    names = list(messages[0][1].name)
    for row, (_, message) in enumerate(messages):
        if list(message.name) != names:
            raise FileError(
                f"{path}: message {row + 1} is for the joints {', '.join(message.name)}, but the first for "
                f"{', '.join(names)}; give the topic of one source of joint states"
            )
    stamps = [message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec for _, message in messages]
    if not any(stamps):
        stamps = [stamp for stamp, _ in messages]
    yield "time", 1e-9 * np.array([stamp - stamps[0] for stamp in stamps], dtype=np.float64)
    for kind, _ in FIELDS:
        rows = [getattr(message, kind) for _, message in messages]
        if all(len(row) == len(names) for row in rows):
            yield from ((f"{kind}.{name}", values) for name, values in zip(names, np.array(rows).T, strict=True))


def _units(names: list[str]) -> dict[str, str]:
    return {f"{field}.{name}": unit for field, unit in FIELDS for name in names}


def _connections(path: str | Path, connections: list[Any], topic: str | None) -> list[Any]:
    states = [c for c in connections if c.msgtype == JOINT_STATE and topic in (None, c.topic)]
    topics = sorted({c.topic for c in connections if c.msgtype == JOINT_STATE})
    if not states:
        known = ", ".join(topics) or f"no topic of {JOINT_STATE}"
        raise FileError(f"{path}: no joint-state topic {topic or ''}".rstrip() + f"; topics: {known}")
    if len({c.topic for c in states}) > 1:
        raise FileError(f"{path}: several joint-state topics: {', '.join(topics)}; select one with --topic")
    return states


def _rosbags() -> Any:
    try:
        from types import SimpleNamespace

        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingExtraError("ROS bags need rosbags: pip install 'adaptctl[logs]'") from error
    typestore = get_typestore(Stores.LATEST)
    return SimpleNamespace(AnyReader=AnyReader, AnyReaderError=AnyReaderError, typestore=typestore)


TEXT_SUFFIXES = (".csv", ".tsv", ".txt")
BAG_SUFFIXES = (".mcap", ".bag", ".db3")


def read_log(path: str | Path, topic: str | None = None) -> LogTable:
    """Table of a log, read by the suffix of its path."""
    place = Path(path)
    suffix = place.suffix.lower()
    if not place.exists():
        raise FileError(f"{path}: does not exist")
    if place.is_file() and place.stat().st_size > MAX_BYTES:
        raise FileError(f"{path}: larger than the limit of {MAX_BYTES} bytes; split it into several logs")
    if place.is_dir() or suffix in BAG_SUFFIXES:
        return read_ros_bag(path, topic)
    if suffix == ".parquet":
        from adaptctl.identification.log_formats.parquet import read_parquet

        return read_parquet(path)
    if suffix in TEXT_SUFFIXES:
        from adaptctl.identification.log_formats.text import read_delimited

        return read_delimited(path)
    raise FileError(
        f"{path}: logs are read from {', '.join((*TEXT_SUFFIXES, '.parquet', *BAG_SUFFIXES))} and folders of "
        f"ROS 2 bags, not from {suffix or 'a file without suffix'}"
    )
