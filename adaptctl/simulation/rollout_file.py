"""Parquet files of runs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from adaptctl.arrays import Array, frozen
from adaptctl.content_words import earlier_schema
from adaptctl.errors import FileError, InputError, printable
from adaptctl.files import hashed, replacing, validate_readable
from adaptctl.optional_packages import needed

if TYPE_CHECKING:
    import pyarrow

SCHEMA = "adaptctl/rollout/3"
CHECKSUM = "sha256"
"""entry with the hash of all columns and entries"""
RUN_ENTRIES = ("control_period", "wall_time", "interrupted", "terminated")
"""entries of every run as a whole"""
STORED_ENTRIES = (*RUN_ENTRIES, "every", "position_units")
"""entries in its file"""
POSITION, VELOCITY, FORCE = ("rad", "m"), ("rad/s", "m/s"), ("N m", "N")
"""units of revolute and prismatic joints"""
JOINT_UNITS = {
    "p": POSITION,
    "v": VELOCITY,
    "reference_p": POSITION,
    "reference_v": VELOCITY,
    "reference_a": ("rad/s^2", "m/s^2"),
    "torque": FORCE,
    "applied": FORCE,
    "measured_p": POSITION,
    "measured_v": VELOCITY,
}
"""arrays with one column per joint, and their units"""
SAMPLE_UNITS = {"time": "s", "clipped": "1", "energy": "J", "reward": "1"}
CONTROLLER_ARRAYS = ("estimate", "logged_state")
"""arrays with the controller's number of columns"""


class RolloutFile:
    """Writer of a run's Parquet file, which appears if the context ends without error."""

    def __init__(
        self, path: str | Path, dof: int, joints: Sequence[str] | None = None, position_units: Sequence[str] = ()
    ) -> None:
        with needed("the file of a run"):
            import pyarrow.parquet  # noqa: F401  # at once, and not when the first samples are there
        self._names, self._units = joint_names(dof, joints), stated_units(dof, position_units)
        self._path, self._held = path, ExitStack()
        self._writer: Any = None
        self._checksum = Checksum()
        self.about: dict[str, object] = {}

    def __enter__(self) -> Self:
        self._beside = self._held.enter_context(replacing(self._path))
        return self

    def append(self, columns: Mapping[str, Array | None], flags: Mapping[str, Array]) -> None:
        """Append T samples by array name."""
        import pyarrow.parquet as pq

        if self._writer is not None and not len(columns["time"]):  # type: ignore[arg-type]
            return
        table = rollout_table(columns, flags, self._names, position_units=self._units)
        if self._writer is None:
            style = {"compression": "zstd", "use_dictionary": False, "use_byte_stream_split": True}
            self._writer = self._held.enter_context(pq.ParquetWriter(self._beside, table.schema, **style))
        self._checksum.add(table)
        self._writer.write_table(table)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if kind is not None:
            return self._held.__exit__(kind, error, trace)
        with self._held:
            if self._writer is None:
                raise FileError(f"{self._path}: not written: no samples were appended")
            about = {name: json.dumps(value) for name, value in self.about.items()}
            self._writer.add_key_value_metadata(about | {CHECKSUM: self._checksum.of(about)})
        return None


class Checksum:
    """Hash of a table's columns, which may come in parts, and of the file's entries."""

    def __init__(self) -> None:
        self._columns: dict[str, Any] = {}

    def add(self, table: pyarrow.Table) -> None:
        """Add rows."""
        for name in table.column_names:
            before, values = "\n" if name in self._columns else "", table[name].to_numpy()
            column = self._columns.setdefault(name, hashlib.sha256())
            if values.dtype.kind == "O":
                column.update((before + "\n".join(map(repr, values.tolist()))).encode())
            else:
                column.update(np.ascontiguousarray(values, dtype="<f8"))

    def of(self, about: Mapping[str, str]) -> str:
        """Hash with entries (as JSON)."""
        columns = [[name, column.hexdigest()] for name, column in self._columns.items()]
        return hashed([columns, sorted(about.items())])


def joint_names(dof: int, given: Sequence[str] | None) -> list[str]:
    """Checked names (r,), default joint1, joint2, ..."""
    if given is None:
        return [f"joint{j + 1}" for j in range(dof)]
    names = [] if isinstance(given, str) or not isinstance(given, Iterable) else list(given)
    if not names or not all(isinstance(name, str) for name in names):
        raise InputError(f"joints: expected {dof} names, got {printable(repr(given))}")
    if len(names) != dof:
        raise InputError(f"joints: expected {dof} names, got {len(names)}")
    if len(set(names)) < dof:
        raise InputError(f"joints: expected unique names, got {', '.join(names)}")
    return names


def stated_units(dof: int, given: Sequence[str]) -> tuple[str, ...]:
    """Checked units (r,), "rad" or "m", or empty."""
    if not isinstance(given, Iterable) or isinstance(given, str) or any(unit not in POSITION for unit in given):
        raise InputError(f"position_units: expected {dof} of rad and m, got {printable(repr(given))}")
    if len(given) not in (0, dof):
        raise InputError(f"position_units: expected {dof} of rad and m, got {len(given)}")
    return tuple(given)


def rollout_table(
    columns: Mapping[str, Array | None],
    flags: Mapping[str, Array],
    joints: Sequence[str],
    about: Mapping[str, object] = MappingProxyType({}),
    position_units: Sequence[str] = (),
) -> pyarrow.Table:
    """Arrow table of samples, with units and `about` as metadata."""
    import pyarrow as pa

    slides = [unit == "m" for unit in position_units] or [False] * len(joints)
    stored = dict(_file_columns(columns, flags, dict(zip(joints, slides, strict=True))))
    fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, (unit, _) in stored.items()]
    header = {"schema": SCHEMA, **{name: json.dumps(value) for name, value in about.items()}}
    return pa.Table.from_arrays([pa.array(x) for _, x in stored.values()], schema=pa.schema(fields, metadata=header))


def read_rollout(
    path: str | Path, accept_edited: bool = False
) -> tuple[dict[str, Any], Mapping[str, Array], dict[str, Any]]:
    """Arrays, events and entries of a run's Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    validate_readable(path)
    try:
        with pq.ParquetFile(path) as file:
            metadata, table = file.metadata.metadata or {}, file.read()
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise FileError(f"{path}: cannot be read as Parquet ({str(error).splitlines()[0]})") from error
    about = entries_of(metadata)
    if about.get("schema") != SCHEMA:
        found = about.get("schema")
        more = earlier_schema(str(found), SCHEMA)
        raise FileError(f"{path}: not a run of adaptctl: expected the schema {SCHEMA!r}, got {found!r}{more}")
    try:
        if not accept_edited:
            validate_unchanged(path, table, about, f"Rollout.load({str(path)!r}, accept_edited=True)")
        columns, flags = _arrays(table)
        return columns, flags, {name: json.loads(about[name]) for name in STORED_ENTRIES if name in about}
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: {type(error).__name__}: {error}; the file is incomplete") from error


def checksum_of(table: pyarrow.Table, about: Mapping[str, str]) -> str:
    """Hash of a whole table and its file's entries, schema and hash apart."""
    checksum = Checksum()
    checksum.add(table)
    return checksum.of({name: value for name, value in about.items() if name not in ("schema", CHECKSUM)})


def entries_of(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    """Entries of a Parquet file's metadata as texts."""
    pairs = {key.decode(errors="replace"): value.decode(errors="replace") for key, value in (metadata or {}).items()}
    return {key: value for key, value in pairs.items() if key != "ARROW:schema"}


def validate_own(path: str | Path, table: Any, metadata: Mapping[bytes, bytes] | None) -> None:
    """Raise `FileError` if a file that this package wrote with a checksum has other numbers now."""
    about = entries_of(metadata)
    if CHECKSUM in about and about.get("schema", "").startswith("adaptctl/"):
        plain = f"pq.read_table({str(path)!r}).replace_schema_metadata()"
        validate_unchanged(path, table, about, f"pq.write_table({plain}, {str(path)!r}), pq being pyarrow.parquet")


def validate_unchanged(path: str | Path, table: Any, about: Mapping[str, str], accepting: str) -> None:
    """Raise `FileError` if numbers or entries are not those that were written."""
    if about.get(CHECKSUM) != checksum_of(table, about):
        raise FileError(f"{path}: the numbers are not those that were written; to accept them, use {accepting}")


def _file_columns(
    columns: Mapping[str, Array | None], flags: Mapping[str, Array], joints: Mapping[str, bool]
) -> Iterator[tuple[str, tuple[str, Array]]]:
    yield from ((name, (unit, np.asarray(columns[name]))) for name, unit in SAMPLE_UNITS.items())
    for name, units in JOINT_UNITS.items():
        values = columns[name]
        for (joint, slides), column in zip(joints.items(), () if values is None else values.T, strict=False):
            yield f"{name}.{joint}", (units[slides], np.ascontiguousarray(column))
    for name in CONTROLLER_ARRAYS:
        for i, column in enumerate(np.asarray(columns[name]).T):
            yield f"{name}.{i}", ("", np.ascontiguousarray(column))
    yield from ((f"flag.{name}", ("", values)) for name, values in flags.items())


def _arrays(table: Any) -> tuple[dict[str, Array], Mapping[str, Array]]:
    parts: dict[str, list[Array]] = {name: [] for name in (*JOINT_UNITS, *CONTROLLER_ARRAYS)}
    flags: dict[str, Array] = {}
    for name in table.column_names:
        kind, _, rest = name.partition(".")
        values = table[name].to_numpy()
        if kind == "flag":
            flags[rest] = frozen(values.copy())
        elif rest:
            parts[kind].append(values)
    gathered = {name: frozen(np.stack(columns, axis=-1)) for name, columns in parts.items() if columns}
    single = {name: frozen(table[name].to_numpy().copy()) for name in SAMPLE_UNITS}
    blank = {name: frozen(np.empty((table.num_rows, 0))) for name in CONTROLLER_ARRAYS}
    return blank | single | gathered, MappingProxyType(flags)
