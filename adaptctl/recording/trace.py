"""Traces: runs as tables in Parquet files, one row a sample, named columns with units."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.files import replacing
from adaptctl.recording.comparison import Comparison, ControllerRun
from adaptctl.recording.wording import parameter_unit

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA = "adaptctl/trace/2"
FLAGS = {
    "payload": ("kg", "mass that is held"),
    "torque_limited": ("1", "1 where a limit held a torque back"),
    "rate_limited": ("1", "1 where a torque would have changed too fast"),
    "frozen": ("1", "1 where nothing is learned from the period"),
    "bounded": ("1", "1 where an estimate was brought back to its bounds"),
    "ringing": ("1", "1 where a sliding variable changes its sign every control period"),
    "stopped": ("1", "1 from where the arm is braked"),
}
"""Units and meanings of the flags of plants and guards."""


class Quantity(NamedTuple):
    """A column of a table of samples: its `name`, such as "p.joint1", its `unit`, "1" for a number without one, its
    `meaning` in words, and `values` (T,), a number or a text for each of T samples. Nothing is checked at
    construction."""

    name: str
    unit: str
    meaning: str
    values: Array | NDArray[np.str_]


def write_trace(path: str | Path, comparison: Comparison) -> None:
    """Write the trace of a `comparison`, all samples of its first run, to the Parquet file `path`, whole or not at all.
    Each sample is a row; columns such as `time`, `p.joint1` and `estimate.link2.mc_x` are float64, lossless, with unit
    and meaning as metadata, and the table's metadata name the experiment, robot, run, seed and control period (s).
    Raises `FileError` where the file cannot be written, `InputError` for the basis of another mechanism, `ValueError`
    for a run of another number of joints than the mechanism's."""
    about = {
        "schema": SCHEMA,
        "experiment": comparison.experiment,
        "robot": comparison.mechanism.name,
        "run": comparison.subject.name,
        "seed": str(comparison.seed),
        "control_period": repr(comparison.subject.rollout.control_period),
        "every": str(comparison.subject.rollout.every),
        "complete": str(comparison.complete).lower(),
    }
    write_columns(path, list(quantities(comparison.subject, comparison.mechanism, comparison.model.names)), about)


def write_columns(path: str | Path, columns: Sequence[Quantity], about: dict[str, str]) -> None:
    """Write a table to the Parquet file `path`, whole or not at all: `columns` of one length, of numbers (float64) or
    of texts, each with its unit and meaning as metadata, and `about`, the metadata of the table. Raises `FileError`
    where the file cannot be written, pyarrow's `ArrowInvalid`, a `ValueError`, for columns of different lengths."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = _table(columns, about)
    with replacing(path) as beside:
        pq.write_table(
            table,
            beside,
            compression="zstd",
            use_dictionary=False,
            use_byte_stream_split=[field.name for field in table.schema if field.type == pa.float64()],
        )


def quantities(run: ControllerRun, mechanism: Mechanism, parameters: tuple[str, ...]) -> Iterator[Quantity]:
    """Columns of the table of a `run` of a `mechanism`, each a `Quantity` of T samples: `time` (s), `energy`, kinetic
    plus potential (J), `reward` of the environment (no unit), `clipped`, 1 where a torque was clipped, else 0,
    `lyapunov` (J) where the control law has such a function, and `flag.NAME` for each flag of the plant or the
    controller's guards.

    Flags are 1 where set, else 0: `torque_limited`, `rate_limited`, `frozen` (nothing is learned), `bounded` (an
    estimate brought back to its bounds), `ringing` (a sliding variable changes its sign every control period) and
    `stopped` (the arm is braked); `payload` is the mass held (kg). Columns of a joint end in its name, such as
    `p.joint1`: position `p`, desired position `reference_p` and `error`, position minus desired position, rad (m if
    prismatic), velocity `v` and desired velocity `reference_v`, rad/s (m/s), desired acceleration `reference_a`,
    rad/s^2 (m/s^2), and `torque`, asked for, and `applied`, within the limits, N m (N). `estimate.NAME` are parameter
    estimates in SI units; `parameters` has their names. Raises `ValueError` for a run of another number of joints than
    the mechanism's.
    """
    rollout = run.rollout
    yield Quantity("time", "s", "time since the start", rollout.time)
    yield from _of_joints(run, mechanism)
    yield Quantity("energy", "J", "kinetic plus potential energy", rollout.energy)
    yield Quantity("reward", "1", "reward of the environment", rollout.reward)
    yield Quantity("clipped", "1", "1 where a torque was clipped", rollout.clipped)
    for name, values in rollout.flags.items():
        unit, meaning = FLAGS.get(name, ("1", "set by the plant or by the controller's guards"))
        yield Quantity(f"flag.{name}", unit, meaning, values)
    if run.lyapunov is not None:
        yield Quantity("lyapunov", "J", "Lyapunov function of the adaptive law", run.lyapunov)
    for name, values in zip(parameters, rollout.estimate.T, strict=False):
        yield Quantity(
            f"estimate.{name}", parameter_unit(name, mechanism), "estimate of the fundamental parameter", values
        )


def _of_joints(run: ControllerRun, mechanism: Mechanism) -> Iterator[Quantity]:
    rollout = run.rollout
    kinds = (
        ("p", "", "position", rollout.p),
        ("v", "/s", "velocity", rollout.v),
        ("reference_p", "", "desired position", rollout.reference_p),
        ("reference_v", "/s", "desired velocity", rollout.reference_v),
        ("reference_a", "/s^2", "desired acceleration", rollout.reference_a),
        ("error", "", "position minus desired position", rollout.error),
        ("torque", None, "torque asked for", rollout.torque),
        ("applied", None, "torque within the limits", rollout.applied),
    )
    for name, rate, meaning, values in kinds:
        for joint, column in zip(mechanism.primary_joints, values.T, strict=True):
            unit = joint.kind.effort_unit if rate is None else joint.kind.position_unit + rate
            yield Quantity(f"{name}.{joint.name}", unit, meaning, column)


def _table(columns: Sequence[Quantity], about: dict[str, str]) -> pa.Table:
    import pyarrow as pa

    kinds = [pa.string() if c.values.dtype.kind == "U" else pa.float64() for c in columns]
    fields = [
        pa.field(c.name, kind, nullable=False, metadata={"unit": c.unit, "meaning": c.meaning})
        for c, kind in zip(columns, kinds, strict=True)
    ]
    arrays = [pa.array(c.values, kind) for c, kind in zip(columns, kinds, strict=True)]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=about))
