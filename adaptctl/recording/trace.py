"""Traces: runs as tables in Parquet files, a row for each sample, named columns with units."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.files import replacing
from adaptctl.recording.comparison import Comparison
from adaptctl.recording.controller_run import ControllerRun
from adaptctl.recording.wording import parameter_unit
from adaptctl.simulation.rollout_file import CHECKSUM, Checksum

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA = "adaptctl/trace/2"
# Rows that are in memory a second time while they are written.
ROWS_AT_ONCE = 4096
# Units and meanings of the flags of plants and guards.
FLAGS = {
    "payload": ("kg", "payload mass"),
    "torque_limited": ("1", "1 where a torque was limited"),
    "rate_limited": ("1", "1 where a torque rate was limited"),
    "frozen": ("1", "1 where adaptation was frozen"),
    "bounded": ("1", "1 where an estimate was projected onto its bounds"),
    "ringing": ("1", "1 where a sliding variable changed its sign every control period"),
    "stopped": ("1", "1 while the arm was braked"),
    **{f"contact_force_{axis}": ("N", "force on the arm by what touches it, in the world's frame") for axis in "xyz"},
    **{f"contact_point_{axis}": ("m", "point at which it acts, 0 without a contact") for axis in "xyz"},
}


class Quantity(NamedTuple):
    """Column of a table of samples: name, unit, meaning in words, and values (T,)."""

    name: str
    unit: str
    meaning: str
    values: Array | NDArray[np.str_]


def write_trace(path: str | Path, comparison: Comparison) -> None:
    """Write all samples of a comparison's first run to a Parquet file, whole or not at all."""
    about = {
        "schema": SCHEMA,
        "experiment": comparison.experiment,
        "robot": comparison.mechanism.name,
        "geometry_sha256": comparison.mechanism.geometry_sha256,
        "run": comparison.subject.name,
        "seed": str(comparison.seed),
        "control_period": repr(comparison.subject.rollout.control_period),
        "every": str(comparison.subject.rollout.every),
        "complete": str(comparison.complete).lower(),
    }
    write_columns(path, list(quantities(comparison.subject, comparison.mechanism, comparison.model.names)), about)


def write_columns(path: str | Path, columns: Sequence[Quantity], about: dict[str, str]) -> None:
    """Write columns with their units, meanings and checksum to a Parquet file, whole or not at all."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    checksum, schema = Checksum(), _schema(columns, about)
    for table in _tables(columns, schema):
        checksum.add(table)
    entries = {name: value for name, value in about.items() if name != "schema"}
    schema = schema.with_metadata(about | {CHECKSUM: checksum.of(entries)})
    numbers = [field.name for field in schema if field.type == pa.float64()]
    style = {"compression": "zstd", "use_dictionary": False, "use_byte_stream_split": numbers}
    with replacing(path) as beside, pq.ParquetWriter(beside, schema, **style) as writer:
        for table in _tables(columns, schema):
            writer.write_table(table)
    pa.default_memory_pool().release_unused()  # which a recording takes beside it


def quantities(run: ControllerRun, mechanism: Mechanism, parameters: tuple[str, ...]) -> Iterator[Quantity]:
    """Columns of a run's table: time, energy, joints' quantities, flags and estimates."""
    rollout = run.rollout
    yield Quantity("time", "s", "time since the start", rollout.time)
    yield from _of_joints(run, mechanism)
    yield Quantity("energy", "J", "kinetic plus potential energy", rollout.energy)
    yield Quantity("reward", "1", "reward of the environment", rollout.reward)
    yield Quantity("clipped", "1", "1 where a torque was clipped", rollout.clipped)
    for name, values in rollout.flags.items():
        unit, meaning = FLAGS.get(name, ("1", "1 where an actuator or safety limit acted"))
        yield Quantity(f"flag.{name}", unit, meaning, values)
    if run.lyapunov is not None:
        yield Quantity("lyapunov", "J", "Lyapunov function of the adaptive law", run.lyapunov)
    for name, values in zip(parameters, rollout.estimate.T, strict=False):
        yield Quantity(f"estimate.{name}", parameter_unit(name, mechanism), "estimate of the base parameter", values)


def _of_joints(run: ControllerRun, mechanism: Mechanism) -> Iterator[Quantity]:
    rollout = run.rollout
    kinds = (
        ("p", "", "position", rollout.p),
        ("v", "/s", "velocity", rollout.v),
        ("reference_p", "", "desired position", rollout.reference_p),
        ("reference_v", "/s", "desired velocity", rollout.reference_v),
        ("reference_a", "/s^2", "desired acceleration", rollout.reference_a),
        ("error", "", "position minus desired position", rollout.error),
        ("torque", None, "commanded torque", rollout.torque),
        ("applied", None, "torque within the limits", rollout.applied),
    )
    for name, rate, meaning, values in kinds:
        for joint, column in zip(mechanism.primary_joints, values.T, strict=True):
            unit = joint.kind.effort_unit if rate is None else joint.kind.position_unit + rate
            yield Quantity(f"{name}.{joint.name}", unit, meaning, column)


def _tables(columns: Sequence[Quantity], schema: pa.Schema) -> Iterator[pa.Table]:
    """Columns in parts of some rows."""
    import pyarrow as pa

    for first in range(0, max(len(columns[0].values), 1), ROWS_AT_ONCE):
        parts = (c.values[first : first + ROWS_AT_ONCE] for c in columns)
        yield pa.Table.from_arrays(list(map(pa.array, parts, schema.types)), schema=schema)


def _schema(columns: Sequence[Quantity], about: dict[str, str]) -> pa.Schema:
    import pyarrow as pa

    kinds = [pa.string() if c.values.dtype.kind == "U" else pa.float64() for c in columns]
    fields = [
        pa.field(c.name, kind, nullable=False, metadata={"unit": c.unit, "meaning": c.meaning})
        for c, kind in zip(columns, kinds, strict=True)
    ]
    return pa.schema(fields, metadata=about)
