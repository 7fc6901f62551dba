"""Logs as they were written."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.arrays import MAX_SETTING, Array
from adaptctl.errors import AdaptctlError, FileError, MissingExtraError
from adaptctl.simulation.rollout_file import validate_own

MAX_ROWS = 20_000_000
# Logs above these sizes are not read.
MAX_BYTES = 4 * 2**30


@dataclass(frozen=True, eq=False)
class LogTable:
    """Columns (n,) of a log by name, in its own units, NaN where a cell has no number."""

    source: str
    columns: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def column(self, name: str, what: str) -> Array:
        """Column (n,) that is finite in each row."""
        if name not in self.columns:
            raise FileError(f"{self.source}: no column {name!r} for {what}; {self._known(name)}")
        values = self.columns[name]
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise FileError(
                f"{self.source}: column {name!r} ({what}): {bad.size} of {len(values)} rows not finite, the first "
                f"is row {int(bad[0]) + 1} ({values[bad[0]]}); use a part of the log without missing numbers"
            )
        size = float(np.abs(values).max(initial=0.0))
        if size != 0.0 and not 1.0 / MAX_SETTING <= size <= MAX_SETTING:
            row = int(np.abs(values).argmax())
            raise FileError(
                f"{self.source}: column {name!r} ({what}): the largest number, {values[row]:g} in row {row + 1}, is "
                f"beyond {1.0 / MAX_SETTING:g} to {MAX_SETTING:g}; expected readings in SI units or those of --units"
            )
        return values

    def _known(self, name: str) -> str:
        names = list(self.columns)
        near = get_close_matches(name, names, 3)
        listed = ", ".join(near or names[:12]) + ("" if near or len(names) <= 12 else f", ... ({len(names)} in all)")
        return f"{'did you mean' if near else 'columns:'} {listed}"


def table(source: str, columns: Iterable[tuple[str, Array]], units: Mapping[str, str] | None = None) -> LogTable:
    """Table of pairs of a name and a column."""
    found: dict[str, Array] = {}
    for name, values in columns:
        if name in found:
            raise FileError(f"{source}: two columns are named {name!r}; names must be unique")
        found[name] = np.asarray(values, dtype=np.float64)
    first, rows = next(((name, len(values)) for name, values in found.items()), ("", 0))
    if not rows:
        raise FileError(f"{source}: no rows of numbers; expected a line of column names and one line per sample")
    for name, values in found.items():
        if len(values) != rows:
            raise FileError(f"{source}: column {name!r} has {len(values)} rows, but {first!r} has {rows}")
    return LogTable(source, found, units or {})


def read_delimited(path: str | Path) -> LogTable:
    """Table of a text file: a line of names, then numbers, separated by commas, semicolons or tabs."""
    from pyarrow import ArrowInvalid
    from pyarrow.csv import ConvertOptions, ParseOptions, read_csv

    try:
        with Path(path).open("rb") as file:
            head, rows = file.readline(1_000_000), file.read(1_000_000)
        mark = max((",", ";", "\t"), key=lambda mark: head.count(mark.encode()))
        read = read_csv(
            path,
            parse_options=ParseOptions(delimiter=mark),
            convert_options=ConvertOptions(
                strings_can_be_null=True,
                null_values=["", "NaN", "nan", "NA", "null"],
                decimal_point="," if mark != "," and _has_decimal_commas(rows) else ".",
            ),
        )
        names = [name.strip() for name in read.column_names]
    except (ArrowInvalid, UnicodeDecodeError) as error:
        raise FileError(f"{path}: not a text table ({str(error).splitlines()[0]})") from error
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({(error.strerror or str(error)).lower()})") from error
    if read.num_rows > MAX_ROWS:
        raise FileError(f"{path}: has {read.num_rows} rows, more than the limit of {MAX_ROWS}")
    return table(str(path), ((name, _text_numbers(read.column(i))) for i, name in enumerate(names)))


def _has_decimal_commas(rows: bytes) -> bool:
    """True if numbers have commas before their decimals, and none has a point there."""
    return re.search(rb"\d,\d", rows) is not None and re.search(rb"\d\.\d", rows) is None


def _text_numbers(column: Any) -> Array:
    from pyarrow import ArrowInvalid, ArrowNotImplementedError, float64

    try:
        return np.asarray(column.cast(float64()).to_numpy(), dtype=np.float64)
    except (ArrowInvalid, ArrowNotImplementedError):
        return np.full(len(column), np.nan)


def read_parquet(path: str | Path) -> LogTable:
    """Table of a Parquet file: columns of numbers and booleans, fixed-size lists split into `name[0]`, `name[1]`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, memory_map=True) as file:
            if file.metadata.num_rows > MAX_ROWS:
                raise FileError(f"{path}: has {file.metadata.num_rows} rows, more than the limit of {MAX_ROWS}")
            read, metadata = file.read(), file.metadata.metadata
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({(error.strerror or str(error)).splitlines()[0].lower()})") from error
    except (pa.ArrowException, UnicodeDecodeError) as error:
        raise FileError(f"{path}: not a Parquet file ({str(error).splitlines()[0]})") from error
    validate_own(path, read, metadata)
    try:
        units = {name: _unit(field) for field in read.schema for name in _names(field)}
        return table(str(path), _parquet_columns(read), {name: unit for name, unit in units.items() if unit})
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: a name or unit is not UTF-8 ({error.reason})") from error


def _unit(field: Any) -> str:
    return str((field.metadata or {}).get(b"unit", b"").decode())


def _names(field: Any) -> list[str]:
    import pyarrow as pa

    if pa.types.is_fixed_size_list(field.type):
        return [f"{field.name}[{i}]" for i in range(field.type.list_size)]
    return [field.name]


def _parquet_columns(read: object) -> Iterator[tuple[str, Array]]:
    import pyarrow as pa

    for entry in read.schema:  # type: ignore[attr-defined]
        column = read.column(entry.name).combine_chunks()  # type: ignore[attr-defined]
        if _holds_numbers(entry.type):
            yield entry.name, _parquet_numbers(column)
            continue
        lists = pa.types.is_fixed_size_list(entry.type) and not column.null_count
        if lists and _holds_numbers(entry.type.value_type):
            cells = _parquet_numbers(column.flatten()).reshape(-1, entry.type.list_size)
            yield from zip(_names(entry), cells.T, strict=True)


def _holds_numbers(kind: Any) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind))


def _parquet_numbers(column: Any) -> Array:
    import pyarrow as pa

    return np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False), dtype=np.float64)


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
        from adaptctl.identification.log_files import read_ros_bag

        return read_ros_bag(path, topic)
    if suffix == ".parquet":
        from adaptctl.identification.log_files import read_parquet

        return read_parquet(path)
    if suffix in TEXT_SUFFIXES:
        from adaptctl.identification.log_files import read_delimited

        return read_delimited(path)
    raise FileError(
        f"{path}: logs are read from {', '.join((*TEXT_SUFFIXES, '.parquet', *BAG_SUFFIXES))} and folders of "
        f"ROS 2 bags, not from {suffix or 'a file without suffix'}"
    )
