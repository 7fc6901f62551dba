"""Runs of closed loops as Parquet files, written whole or as they come."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from adaptctl.arrays import Array, frozen
from adaptctl.errors import FileError, InputError, printable
from adaptctl.files import earlier_schema, replacing
from adaptctl.optional_packages import needed

if TYPE_CHECKING:
    import pyarrow

SCHEMA = "adaptctl/rollout/2"
WHOLE = ("control_period", "wall_time", "complete", "terminated")
"""Entries on the whole run that every run has."""
KEPT = (*WHOLE, "every", "position_units")
"""Entries on the whole run in a run's file."""
POSITION, VELOCITY, FORCE = ("rad", "m"), ("rad/s", "m/s"), ("N m", "N")
"""Units of a joint's position, of its velocity and of its torque or force: where it is revolute, where prismatic."""
OF_JOINTS = {
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
"""Arrays of a run that have a column a joint, by name, with their units where a joint is revolute, where prismatic."""
OF_TIME = {"time": "s", "clipped": "1", "energy": "J", "reward": "1"}
OF_LAWS = ("estimate", "logged_state")
"""A run's arrays of as many columns as the controller has."""


class RolloutFile:
    """Writer of a run's Parquet file at `path`, a context manager to which samples are appended as they come: a row for
    each sample, columns of float64 such as `time`, `p.joint1`, `estimate.0` and `flag.payload`, with their units as
    metadata.

    When the context ends the file appears, whole; after an error there is none, and a file that was there before stays.
    `joints` (r,) names the r = `dof` joints, None for joint1, joint2, ..., and `position_units` (r,) has "rad" for
    revolute joints and "m" for prismatic ones; empty, the default, as if all were revolute. The attribute `about`, a
    dict to be set before the end, maps names to what the file says of the whole run, in numbers and texts that JSON can
    hold.

    Raises `InputError` for other than r different names and for other than r of these units, `MissingExtraError`
    without pyarrow; entering or leaving the context raises `FileError` where the file cannot be written or nothing was
    appended.
    """

    def __init__(
        self, path: str | Path, dof: int, joints: Sequence[str] | None = None, position_units: Sequence[str] = ()
    ) -> None:
        with needed("the file of a run"):
            import pyarrow.parquet  # noqa: F401  # at once, and not when the first samples are there
        self._names, self._units = joint_names(dof, joints), stated_units(dof, position_units)
        self._path, self._held = path, ExitStack()
        self._writer: Any = None
        self.about: dict[str, object] = {}

    def __enter__(self) -> Self:
        self._beside = self._held.enter_context(replacing(self._path))
        return self

    def append(self, columns: Mapping[str, Array | None], flags: Mapping[str, Array]) -> None:
        """Append T samples of r joints to the file. `columns` maps the names of a `Rollout`'s arrays to their values in
        SI units: "time", "clipped", "energy" and "reward" (T,); "p", "v", "reference_p", "reference_v", "reference_a",
        "torque", "applied", "measured_p" and "measured_v" (T, r), None for one that the file is to leave out;
        "estimate" (T, k), the controller's k parameter estimates, and "logged_state" (T, l), the l numbers that the
        adaptation law records of its internal state. `flags` maps names of events to arrays (T,). Both have the same
        names at every call; later calls without samples write nothing.

        Raises `KeyError` where an array is missing, `ValueError` for other columns than at the first call, and
        `OSError` where writing fails.
        """
        import pyarrow.parquet as pq

        if self._writer is not None and not len(columns["time"]):  # type: ignore[arg-type]
            return
        table = rollout_table(columns, flags, self._names, position_units=self._units)
        if self._writer is None:
            style = {"compression": "zstd", "use_dictionary": False, "use_byte_stream_split": True}
            self._writer = self._held.enter_context(pq.ParquetWriter(self._beside, table.schema, **style))
        self._writer.write_table(table)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if kind is not None:
            return self._held.__exit__(kind, error, trace)
        with self._held:
            if self._writer is None:
                raise FileError(f"{self._path}: not written: expected samples of a run, and none were appended")
            self._writer.add_key_value_metadata({name: json.dumps(value) for name, value in self.about.items()})
        return None


def joint_names(dof: int, given: Sequence[str] | None) -> list[str]:
    """Names (r,) of r = `dof` joints: those `given`, or joint1, joint2, ... for None. Raises `InputError` unless there
    are r different texts."""
    if given is None:
        return [f"joint{j + 1}" for j in range(dof)]
    names = [] if isinstance(given, str) or not isinstance(given, Iterable) else list(given)
    if not names or not all(isinstance(name, str) for name in names):
        raise InputError(f"joints: expected {dof} names, got {printable(repr(given))}")
    if len(names) != dof:
        raise InputError(f"joints: expected {dof} names, got {len(names)}")
    if len(set(names)) < dof:
        raise InputError(f"joints: expected different names, got {', '.join(names)}")
    return names


def stated_units(dof: int, given: Sequence[str]) -> tuple[str, ...]:
    """Units of position of r = `dof` joints, a tuple (r,): those `given`, "rad" (revolute) or "m" (prismatic) each; an
    empty tuple where none are given. Raises `InputError` for another number of units, for others, and for a text."""
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
    """The samples of a run as an Arrow table: a row for each of T samples, columns of float64 such as `time`,
    `p.joint1`, `estimate.0` and `flag.payload`. Units are the columns' metadata; the entries of `about`, which JSON
    must be able to hold, are the table's own metadata, none by default.

    `columns` maps the names of a `Rollout`'s arrays to their values in SI units: "time", "clipped", "energy" and
    "reward" (T,); "p", "v", "reference_p", "reference_v", "reference_a", "torque", "applied", "measured_p" and
    "measured_v" (T, r), None for one that is left out; "estimate" (T, k), the controller's k parameter estimates, and
    "logged_state" (T, l), the l numbers that the adaptation law records of its internal state. `flags` maps names of
    events to arrays (T,); `joints` (r,) names the r joints, and `position_units` (r,) has "rad" for revolute joints and
    "m" for prismatic ones; empty, the default, as if all were revolute. Raises `KeyError` where an array is missing,
    `ValueError` for other than r units, and `ModuleNotFoundError` without pyarrow.
    """
    import pyarrow as pa

    slides = [unit == "m" for unit in position_units] or [False] * len(joints)
    stored = dict(_file_columns(columns, flags, dict(zip(joints, slides, strict=True))))
    fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, (unit, _) in stored.items()]
    header = {"schema": SCHEMA, **{name: json.dumps(value) for name, value in about.items()}}
    return pa.Table.from_arrays([pa.array(x) for _, x in stored.values()], schema=pa.schema(fields, metadata=header))


def read_rollout(path: str | Path) -> tuple[dict[str, Any], Mapping[str, Array], dict[str, Any]]:
    """The contents of a run's Parquet file at `path`, a tuple of three mappings by name: arrays, events, and entries on
    the whole run. The first has the arrays of a `Rollout` of T samples of r joints in SI units, read-only: "time",
    "clipped", "energy" and "reward" (T,); "p", "v", "reference_p", "reference_v", "reference_a", "torque", "applied",
    "measured_p" and "measured_v" (T, r), in the file's order of joints; and "estimate" (T, k), the controller's k
    parameter estimates, and "logged_state" (T, l), the l numbers that the adaptation law records of its internal state.
    The second has arrays (T,) of events, 1 where there was one. The third has, of the whole run, "control_period" and
    "wall_time", s, "complete" and "terminated", bools, "every", the number of control periods from one sample to the
    next, and "position_units", a list of "rad" or "m" for each joint, empty where they are not known. Arrays of joints,
    events and entries that the file lacks are missing; "estimate" and "logged_state" are then (T, 0).

    Raises `FileError` for a file that cannot be read, was not written as a run by this package or is damaged, and
    `ModuleNotFoundError` without pyarrow.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            metadata, table = file.metadata.metadata or {}, file.read()
    except (OSError, pa.ArrowException) as error:
        raise FileError(f"{path}: cannot be read as Parquet ({str(error).splitlines()[0]})") from error
    about = {key.decode(): value.decode() for key, value in metadata.items() if key != b"ARROW:schema"}
    if about.get("schema") != SCHEMA:
        found = about.get("schema")
        more = earlier_schema(str(found), SCHEMA)
        raise FileError(f"{path}: not a run of ours: expected the schema {SCHEMA!r}, got {found!r}{more}")
    try:
        columns, flags = _arrays(table)
        return columns, flags, {name: json.loads(about[name]) for name in KEPT if name in about}
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: {type(error).__name__}: {error}; it is not whole") from error


def _file_columns(
    columns: Mapping[str, Array | None], flags: Mapping[str, Array], joints: Mapping[str, bool]
) -> Iterator[tuple[str, tuple[str, Array]]]:
    """Names of a file's columns, and their units and values, of joints that slide or turn."""
    yield from ((name, (unit, np.asarray(columns[name]))) for name, unit in OF_TIME.items())
    for name, units in OF_JOINTS.items():
        values = columns[name]
        for (joint, slides), column in zip(joints.items(), () if values is None else values.T, strict=False):
            yield f"{name}.{joint}", (units[slides], np.ascontiguousarray(column))
    for name in OF_LAWS:
        for i, column in enumerate(np.asarray(columns[name]).T):
            yield f"{name}.{i}", ("", np.ascontiguousarray(column))
    yield from ((f"flag.{name}", ("", values)) for name, values in flags.items())


def _arrays(table: Any) -> tuple[dict[str, Array], Mapping[str, Array]]:
    """A run's arrays and its flags, of the columns of its file."""
    parts: dict[str, list[Array]] = {name: [] for name in (*OF_JOINTS, *OF_LAWS)}
    flags: dict[str, Array] = {}
    for name in table.column_names:
        kind, _, rest = name.partition(".")
        values = table[name].to_numpy()
        if kind == "flag":
            flags[rest] = frozen(values.copy())
        elif rest:
            parts[kind].append(values)
    gathered = {name: frozen(np.stack(columns, axis=-1)) for name, columns in parts.items() if columns}
    single = {name: frozen(table[name].to_numpy().copy()) for name in OF_TIME}
    blank = {name: frozen(np.empty((table.num_rows, 0))) for name in OF_LAWS}
    return blank | single | gathered, MappingProxyType(flags)
