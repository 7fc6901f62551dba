"""Traces of finished experiments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from adaptctl.arrays import Array
from adaptctl.dynamics.joint_units import either
from adaptctl.errors import FileError
from adaptctl.files import validate_readable
from adaptctl.recording.result import TRACE
from adaptctl.simulation.rollout_file import validate_own

OF_JOINTS = ("p", "v", "reference_p", "reference_v", "reference_a", "error", "torque", "applied")
MAX_SAMPLES = 1_000_000
"""rows of a trace; experiments have at most 300,000"""


class FinishedTrace(NamedTuple):
    """Samples of the first run in a results folder."""

    folder: str
    table: pa.Table

    @property
    def time(self) -> Array:
        """Times (T,) in s."""
        return self.column("time")

    @property
    def sample_time(self) -> float:
        """Time between samples in s."""
        return float(self.time[1] - self.time[0]) if len(self.time) > 1 else float(self.entry("control_period"))

    def entry(self, name: str) -> str:
        """Entry of the file, such as `robot`."""
        return str((self.table.schema.metadata or {}).get(name.encode(), b"").decode())

    def column(self, name: str) -> Array:
        """Values (T,) of a column."""
        return np.asarray(self.table[name].to_numpy())

    def columns(self, kind: str) -> Array:
        """Values (T, n) of the columns of a kind."""
        return np.column_stack([self.column(f"{kind}.{name}") for name in self.names(kind)])

    def names(self, kind: str) -> list[str]:
        """Names of what a kind has columns of, such as the joints of `error`."""
        names = (name.partition(".") for name in self.table.column_names)
        return [of for what, dot, of in names if what == kind and dot]

    def unit(self, name: str) -> str:
        """Unit of a column."""
        return _unit(self.table.schema.field(name))


def read_trace(folder: str | Path) -> FinishedTrace:
    """Trace in a results folder, else `FileError`."""
    path = Path(folder) / TRACE
    with _opened(path) as file:
        found = FinishedTrace(str(folder), file.read())
    if not _is_run(found):
        raise FileError(f"{path}: has no samples of a run; give the results folder of one run")
    validate_own(path, found.table, found.table.schema.metadata)
    return found


def _is_run(trace: FinishedTrace) -> bool:
    """True for a table with times and all of each joint's quantities, in numbers."""
    joints, columns = trace.names("p"), {field.name: field.type for field in trace.table.schema}
    needed = ["time", *(f"{kind}.{joint}" for kind in OF_JOINTS for joint in joints)]
    return bool(len(trace.table) and joints) and all(columns.get(name) == pa.float64() for name in needed)


def read_traces(folders: Iterable[str | Path]) -> list[FinishedTrace]:
    """Traces in results folders, else `FileError`."""
    return [read_trace(folder) for folder in folders]


def error_unit(folder: str | Path) -> str:
    """Unit of the position errors in a trace, "rad" or "m", or both."""
    with _opened(Path(folder) / TRACE) as file:
        return either(_unit(field) for field in file.schema_arrow if field.name.startswith("error."))


def _unit(field: pa.Field) -> str:
    return str((field.metadata or {}).get(b"unit", b"").decode(errors="replace"))


@contextmanager
def _opened(path: Path) -> Iterator[pq.ParquetFile]:
    if not path.exists():
        raise FileError(f"{path}: does not exist; give a results folder of adaptctl experiment run")
    validate_readable(path)
    try:
        with pq.ParquetFile(path) as file:
            if file.metadata.num_rows > MAX_SAMPLES:
                raise FileError(f"{path}: {file.metadata.num_rows} rows are more than an experiment has")
            yield file
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        reason = str(error).splitlines()[0]
        raise FileError(f"{path}: cannot be read ({reason}); run the experiment again") from error
