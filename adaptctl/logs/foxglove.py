"""Reader of Foxglove's joint states in MCAP files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import msgspec

from adaptctl.errors import AdaptctlError, FileError
from adaptctl.logs.ros_bag import joint_table, read_ros_bag
from adaptctl.logs.table import LogTable
from adaptctl.optional_packages import needed

SCHEMA = "foxglove.JointStates"
FIELDS = ("position", "velocity", "effort")
TOPIC = "/joint_states"
"""taken where there are several"""


class _Stamp(msgspec.Struct):
    sec: int
    nsec: int


class _JointEntry(msgspec.Struct):
    name: str
    position: float | None = None
    velocity: float | None = None
    effort: float | None = None


class _States(msgspec.Struct):
    timestamp: _Stamp
    joints: list[_JointEntry]


def read_mcap(path: str | Path, topic: str | None = None) -> LogTable:
    """Table of Foxglove's joint states in JSON, or of ROS's, in an MCAP file."""
    try:
        with Path(path).open("rb") as file:
            encodings = _encodings(reader := _reader(file))
            if not encodings and reader.get_header().profile.startswith("ros"):
                return read_ros_bag(path, topic)
            if not encodings:
                raise FileError(f"{path}: no topic of {SCHEMA} or of ROS in it; is the file cut off?")
            return joint_table(path, _messages(reader, _chosen(path, encodings, topic)))
    except (AdaptctlError, MemoryError):
        raise
    except Exception as error:  # the package names no kind of its own for damaged files
        told = (str(error) or type(error).__name__).splitlines()[0]
        raise FileError(f"{path}: cannot be read as MCAP ({told})") from error


def _reader(file: BinaryIO) -> Any:
    with needed("MCAP"):
        from mcap.reader import make_reader
    return make_reader(file)


def _encodings(reader: Any) -> dict[str, str]:
    """Encodings of the topics of joint states; none where they cannot be read."""
    summary = None
    with suppress(Exception):
        summary = reader.get_summary()
    if summary is None:
        return {}
    of = {number for number, schema in summary.schemas.items() if schema.name == SCHEMA}
    return {one.topic: one.message_encoding for one in summary.channels.values() if one.schema_id in of}


def _chosen(path: str | Path, encodings: dict[str, str], topic: str | None) -> str:
    known = ", ".join(sorted(encodings))
    if topic is None and len(encodings) > 1 and TOPIC not in encodings:
        raise FileError(f"{path}: several joint-state topics: {known}; select one with --topic")
    chosen = topic or (TOPIC if TOPIC in encodings else next(iter(encodings)))
    if chosen not in encodings:
        raise FileError(f"{path}: no joint-state topic {chosen}; topics: {known}")
    if encodings[chosen] != "json":
        raise FileError(f"{path}: {chosen} is encoded as {encodings[chosen]}; Foxglove's joint states are read as JSON")
    return chosen


def _messages(reader: Any, topic: str) -> Iterator[tuple[int, Any]]:
    """Stamps and joint states, as ROS has them."""
    decoder = msgspec.json.Decoder(_States)
    for _, _, message in reader.iter_messages(topics=[topic]):
        states = decoder.decode(message.data)
        stamp = SimpleNamespace(sec=states.timestamp.sec, nanosec=states.timestamp.nsec)
        rows = {field: [getattr(joint, field) for joint in states.joints] for field in FIELDS}
        given = {field: [] if None in row else row for field, row in rows.items()}
        names = [joint.name for joint in states.joints]
        yield message.log_time, SimpleNamespace(header=SimpleNamespace(stamp=stamp), name=names, **given)
