"""A closed-loop run of an arm, simulated or real: what happened in it, kept as arrays."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen
from adaptctl.errors import FileError, InputError, MissingExtraError
from adaptctl.files import replacing

if TYPE_CHECKING:
    import pandas
    import pyarrow
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Rollout:
    """What happened in one closed-loop run of T control periods of r joints; every array is read-only.

    Sample k is the state at `time[k]` and the torque commanded on it; T samples.
    """

    time: Array
    """(T,) s"""
    p: Array
    """(T, r) positions, rad or m: the true ones, where the environment tells them besides what it measures"""
    v: Array
    """(T, r) velocities, likewise"""
    reference_p: Array
    """(T, r)"""
    reference_v: Array
    """(T, r)"""
    reference_a: Array
    """(T, r)"""
    torque: Array
    """(T, r) commanded, N m"""
    applied: Array
    """(T, r) after the limits, N m"""
    clipped: Array
    """(T,) whether a torque was clipped, as 0 and 1"""
    energy: Array
    """(T,) J; NaN where the environment does not tell"""
    reward: Array
    """(T,)"""
    estimate: Array
    """(T, k) the controller's parameter estimates, k = 0 where it has none"""
    control_period: float
    """s"""
    wall_time: float
    """s"""
    complete: bool = True
    """False when the run was interrupted: what was computed is kept."""
    terminated: bool = False
    """True when the environment ended the run early, an error bound having been passed."""
    info: dict[str, object] = field(default_factory=dict)
    """The environment's last info."""
    measured_p: Array | None = None
    """(T, r) positions as the controller was told them; None where those are the true ones"""
    measured_v: Array | None = None
    """(T, r) velocities, likewise"""
    marks: Mapping[str, Array] = field(default_factory=dict)
    """(T,) each: what happened, by name, as the environment and the controller's guards tell"""

    @property
    def error(self) -> Array:
        """Tracking errors p - p_d (T, r)."""
        return self.p - self.reference_p

    @property
    def velocity_error(self) -> Array:
        """v - v_d (T, r)."""
        return self.v - self.reference_v

    def save(self, path: str | Path, joints: Sequence[str] | None = None) -> None:
        """Write the run as Parquet, whole or not at all: a row a control period, columns such as `p.joint1` with their
        units, which `adaptctl identify` reads. `joints` (r,) names them, joint1, joint2, ... by default.

        The environment's last `info` is not kept.
        """
        import pyarrow.parquet as pq

        table = self.to_arrow(joints)
        with replacing(path) as beside:
            pq.write_table(table, beside, compression="zstd", use_dictionary=False, use_byte_stream_split=True)

    def to_arrow(self, joints: Sequence[str] | None = None) -> pyarrow.Table:
        """The run as a table of Arrow: a row a control period, columns such as `p.joint1` with their units."""
        import pyarrow as pa

        names = [f"joint{j + 1}" for j in range(self.p.shape[1])] if joints is None else list(joints)
        if len(names) != self.p.shape[1]:
            raise InputError(f"joints: expected {self.p.shape[1]} names, got {len(names)}")
        columns = dict(_file_columns(self, names))
        fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, (unit, _) in columns.items()]
        about = {"schema": SCHEMA, **{name: json.dumps(getattr(self, name)) for name in KEPT}}
        arrays = [pa.array(values) for _, values in columns.values()]
        return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=about))

    def to_pandas(self, joints: Sequence[str] | None = None) -> pandas.DataFrame:
        """The run as a frame of pandas, with the columns of `to_arrow`. Raises `MissingExtraError` without pandas."""
        try:
            return self.to_arrow(joints).to_pandas()
        except ModuleNotFoundError as error:
            raise MissingExtraError("to_pandas: pandas is not installed: pip install pandas") from error

    def plot(self, joints: Sequence[str] | None = None) -> Figure:
        """A figure of the run: positions on the reference, errors, torques, and estimates where there are any."""
        from adaptctl.simulation.run_plot import run_figure

        return run_figure(self, joints)

    def _repr_html_(self) -> str:
        """How a notebook shows the run: its figure, with the numbers that matter."""
        from adaptctl.simulation.run_plot import run_html

        return run_html(self)

    @classmethod
    def from_arrays(
        cls,
        p: ArrayLike,
        torque: ArrayLike,
        reference_p: ArrayLike,
        control_period: float,
        *,
        v: ArrayLike | None = None,
        reference_v: ArrayLike | None = None,
        reference_a: ArrayLike | None = None,
        applied: ArrayLike | None = None,
        estimate: ArrayLike | None = None,
        time: ArrayLike | None = None,
        complete: bool = True,
    ) -> Rollout:
        """A run that was not simulated here, from positions, torques and the reference's positions, each (T, r).

        Velocities, and the reference's derivatives, are differences of the positions where they are not given;
        `applied` is the torque commanded, `time` (T,) counts control periods (s) from zero, unless given. `estimate`
        (T, k) are the controller's. Energy and reward are not known: NaN, and zero. Raises `InputError` on shapes that
        do not fit, `NonFiniteError` on NaN and infinity.
        """
        from adaptctl.simulation.logged_run import logged_run

        given = {"v": v, "reference_v": reference_v, "reference_a": reference_a, "applied": applied}
        return cls(**logged_run(p, torque, reference_p, control_period, given, estimate, time, complete))

    @classmethod
    def load(cls, path: str | Path) -> Rollout:
        """The run that `save` wrote. Raises `FileError`."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            table = pq.read_table(path)
        except (OSError, pa.ArrowException) as error:
            raise FileError(f"{path}: cannot be read as Parquet ({str(error).splitlines()[0]})") from error
        about = {key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()}
        if about.get("schema") != SCHEMA:
            raise FileError(f"{path}: not a run of ours: expected the schema {SCHEMA!r}, got {about.get('schema')!r}")
        try:
            return cls(**_arrays(table), **{name: json.loads(about[name]) for name in KEPT})
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(f"{path}: {type(error).__name__}: {error}; it is not whole") from error


SCHEMA = "adaptctl/rollout/1"
KEPT = ("control_period", "wall_time", "complete", "terminated")
"""What a run's file says of the whole run."""
OF_JOINTS = {
    "p": "rad",
    "v": "rad/s",
    "reference_p": "rad",
    "reference_v": "rad/s",
    "reference_a": "rad/s^2",
    "torque": "N m",
    "applied": "N m",
    "measured_p": "rad",
    "measured_v": "rad/s",
}
"""A run's arrays of a column a joint, in the units that they have where joints turn."""
OF_TIME = {"time": "s", "clipped": "1", "energy": "J", "reward": "1"}


def _file_columns(run: Rollout, joints: Sequence[str]) -> Iterator[tuple[str, tuple[str, Array]]]:
    """Names of a file's columns, and their units and values."""
    yield from ((name, (unit, getattr(run, name))) for name, unit in OF_TIME.items())
    for name, unit in OF_JOINTS.items():
        values = getattr(run, name)
        for joint, column in zip(joints, () if values is None else values.T, strict=False):
            yield f"{name}.{joint}", (unit, np.ascontiguousarray(column))
    for i, column in enumerate(run.estimate.T):
        yield f"estimate.{i}", ("", np.ascontiguousarray(column))
    yield from ((f"mark.{name}", ("", values)) for name, values in run.marks.items())


def _arrays(table: Any) -> dict[str, Any]:
    """A run's arrays, of the columns of its file."""
    parts: dict[str, list[Array]] = {name: [] for name in (*OF_JOINTS, "estimate")}
    marks: dict[str, Array] = {}
    for name in table.column_names:
        kind, _, rest = name.partition(".")
        values = table[name].to_numpy()
        if kind == "mark":
            marks[rest] = frozen(values.copy())
        elif rest:
            parts[kind].append(values)
    gathered = {name: frozen(np.stack(columns, axis=-1)) for name, columns in parts.items() if columns}
    single = {name: frozen(table[name].to_numpy().copy()) for name in OF_TIME}
    blank = {"estimate": frozen(np.empty((table.num_rows, 0)))}
    return blank | single | gathered | {"marks": MappingProxyType(marks)}
