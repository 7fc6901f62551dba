"""Logs of ROS: bags of ROS 1 and 2, db3 and MCAP, with sensor_msgs/JointState."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import FileError, MissingExtraError
from adaptctl.identification.reading.table import MAX_ROWS, LogTable, table

JOINT_STATE = "sensor_msgs/msg/JointState"
FIELDS = (("position", "rad"), ("velocity", "rad/s"), ("effort", "N m"))
"""Fields of a JointState, in the units that its definition states for joints that turn."""


def read_ros_bag(path: str | Path, topic: str | None = None) -> LogTable:
    """The table of a log in a ROS 1 or ROS 2 bag, a `LogTable`: from its JointState messages the columns `time` (s),
    `position.J`, and, where all messages have them, `velocity.J` and `effort.J`, for every joint J. Their stated units
    are rad, rad/s and N m, also of prismatic joints, since messages do not tell the kind.

    Time is the messages' own stamp where they have one, else when they were recorded, in s from the first. `topic`
    names the topic of the messages; None takes the only one. Raises `FileError` for a bag that cannot be read, has no
    such topic, or several where none is named, has no messages or more than 20 million, or messages of different
    joints, and `MissingExtraError` where rosbags is not installed.
    """
    rosbags = _rosbags()
    try:
        with rosbags.AnyReader([Path(path)], default_typestore=rosbags.typestore) as reader:
            chosen = _connections(path, reader.connections, topic)
            messages = [
                (stamp, reader.deserialize(raw, connection.msgtype))
                for connection, stamp, raw in reader.messages(connections=chosen)
            ]
    except (rosbags.AnyReaderError, OSError, KeyError) as error:
        raise FileError(f"{path}: cannot be read as a ROS bag ({str(error).splitlines()[0]})") from error
    if not messages or len(messages) > MAX_ROWS:
        raise FileError(f"{path}: holds {len(messages)} joint states; expected 1 to {MAX_ROWS}")
    return table(str(path), _columns(path, messages), {"time": "s"} | _units(messages[0][1].name))


def _columns(path: str | Path, messages: list[tuple[int, Any]]) -> Iterator[tuple[str, Array]]:
    names = list(messages[0][1].name)
    for row, (_, message) in enumerate(messages):
        if list(message.name) != names:
            raise FileError(
                f"{path}: message {row + 1} is of joints {', '.join(message.name)}, the first of {', '.join(names)}; "
                "name the topic of one source of joint states"
            )
    stamps = [message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec for _, message in messages]
    if not any(stamps):
        stamps = [stamp for stamp, _ in messages]
    yield "time", 1e-9 * np.array([stamp - stamps[0] for stamp in stamps], dtype=np.float64)
    for field, _ in FIELDS:
        rows = [getattr(message, field) for _, message in messages]
        if all(len(row) == len(names) for row in rows):
            yield from ((f"{field}.{name}", values) for name, values in zip(names, np.array(rows).T, strict=True))


def _units(names: list[str]) -> dict[str, str]:
    return {f"{field}.{name}": unit for field, unit in FIELDS for name in names}


def _connections(path: str | Path, connections: list[Any], topic: str | None) -> list[Any]:
    states = [c for c in connections if c.msgtype == JOINT_STATE and topic in (None, c.topic)]
    topics = sorted({c.topic for c in connections if c.msgtype == JOINT_STATE})
    if not states:
        known = ", ".join(topics) or f"no topic of {JOINT_STATE}"
        raise FileError(f"{path}: there is no joint state topic {topic or ''}".rstrip() + f"; there is {known}")
    if len({c.topic for c in states}) > 1:
        raise FileError(f"{path}: several topics hold joint states: {', '.join(topics)}; name one with --topic")
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
