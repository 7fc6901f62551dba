"""Table of the runs in a folder."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from adaptctl.errors import FileError
from adaptctl.files import read_json, replacing, typed
from adaptctl.recording.result import SUMMARY
from adaptctl.recording.summary import CHECKSUM, SCHEMA, sealed

RUN_TABLE = "runs.parquet"
MAX_DEPTH = 8
"""folders below the given one that are searched"""
MAX_SUMMARY_BYTES = 10_000_000
"""more than any experiment writes"""

COLUMNS: Mapping[str, tuple[pa.DataType, str]] = {
    "folder": (pa.string(), ""),
    "experiment": (pa.string(), ""),
    "robot": (pa.string(), ""),
    "run": (pa.string(), ""),
    "label": (pa.string(), ""),
    "law": (pa.string(), ""),
    "prior_knowledge": (pa.string(), ""),
    "rms_error": (pa.float64(), "rad or m"),
    "first_rms_error": (pa.float64(), "rad or m"),
    "final_rms_error": (pa.float64(), "rad or m"),
    "passed": (pa.bool_(), ""),
    "faults": (pa.string(), ""),
    "complete": (pa.bool_(), ""),
    "terminated": (pa.bool_(), ""),
    "duration": (pa.float64(), "s"),
    "control_period": (pa.float64(), "s"),
    "clipped_steps": (pa.int64(), "1"),
    "rank": (pa.int64(), "1"),
    "seed": (pa.int64(), "1"),
    "robot_sha256": (pa.string(), ""),
    "settings": (pa.string(), "JSON"),
    "version": (pa.string(), ""),
    "wall_time": (pa.float64(), "s"),
}
"""Type and unit of each column."""


class _Schema(msgspec.Struct):
    schema: str


class SummaryRun(msgspec.Struct):
    """Entry `runs` of a summary."""

    label: str
    law: str
    prior_knowledge: str
    complete: bool
    terminated: bool
    duration: float
    rms_error: float | None
    first_rms_error: float | None
    final_rms_error: float | None
    clipped_steps: int
    wall_time: float


class _Fault(msgspec.Struct):
    sentence: str


class _Verdict(msgspec.Struct):
    passed: bool
    faults: list[_Fault]


class Summary(msgspec.Struct):
    """Content of summary.json, as far as it is needed."""

    schema: str
    version: str
    experiment: str
    robot: str
    robot_sha256: str
    seed: int
    control_period: float
    rank: int
    verdict: _Verdict
    settings: dict[str, str]
    runs: dict[str, SummaryRun]


class FoundRuns(NamedTuple):
    """
    Runs in a folder.

    Parameters
    ----------
    table : pyarrow.Table
        One row per controller's run, with the columns of `COLUMNS`, each with its `unit` as metadata.
    broken : tuple of str
        Files that could not be read, each with the reason.
    """

    table: pa.Table
    broken: tuple[str, ...]

    def write(self, path: str | Path) -> None:
        """
        Write the table as Parquet, whole or not at all.

        Parameters
        ----------
        path : str or Path
            Path of the file, which is replaced if it exists.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        with replacing(path) as beside:
            pq.write_table(self.table, beside)


def find_runs(folder: str | Path) -> FoundRuns:
    """
    Read the summaries of all experiments below a folder.

    Parameters
    ----------
    folder : str or Path
        Folder with results of `adaptctl experiment run`, up to 8 folders deep; links are not followed.

    Returns
    -------
    FoundRuns
        Table with a row per controller's run, sorted by folder, and the files that could not be read.

    Raises
    ------
    FileError
        If there is no such folder, or no summary in it.

    Examples
    --------
    >>> from adaptctl.recording.run_table import find_runs
    >>> (tmp / "broken").mkdir()
    >>> _ = (tmp / "broken" / "summary.json").write_text("{")
    >>> found = find_runs(tmp)
    >>> found.table.num_rows, len(found.broken)
    (0, 1)
    """
    place = Path(folder)
    if not place.is_dir():
        raise FileError(f"{folder}: no such folder; give one that experiments were written to")
    rows, broken, summaries = list[dict[str, Any]](), list[str](), sorted(_summaries(place, MAX_DEPTH))
    for path in summaries:
        try:
            rows += _rows(path, path.parent.relative_to(place))
        except FileError as error:
            broken.append(str(error))
    if not summaries:
        raise FileError(f"{folder}: no {SUMMARY} in it or below; adaptctl experiment run writes one")
    return FoundRuns(_table(rows), tuple(broken))


def _summaries(folder: Path, depth: int) -> Iterator[Path]:
    if (path := folder / SUMMARY).is_file():
        yield path
    for inner in folder.iterdir() if depth else ():
        if inner.is_dir() and not inner.is_symlink() and not inner.name.startswith("."):
            yield from _summaries(inner, depth - 1)


def read_summary(path: Path) -> Summary:
    """Summary of an experiment, else `FileError`."""
    written = read_json(path, dict[str, Any], MAX_SUMMARY_BYTES)
    found = typed(path, written, _Schema).schema
    if found != SCHEMA:
        of_another = not found.startswith(SCHEMA.rpartition("/")[0])
        way = "give results of an experiment" if of_another else "run the experiment again"
        raise FileError(f"{path}: schema: expected {SCHEMA!r}, got {found!r}; {way}")
    if written.get(CHECKSUM) != (now := sealed(written)[CHECKSUM]):
        raise FileError(f'{path}: not as it was written; to accept it, write "{CHECKSUM}": "{now}" into it')
    return typed(path, written, Summary)


def _rows(path: Path, folder: Path) -> Iterator[dict[str, Any]]:
    """Rows of an experiment's controllers."""
    read = read_summary(path)
    shared = {name: getattr(read, name) for name in COLUMNS if name in read.__struct_fields__}
    shared |= {
        "folder": folder.as_posix(),
        "passed": read.verdict.passed,
        "faults": "; ".join(fault.sentence for fault in read.verdict.faults),
        "settings": json.dumps(read.settings, ensure_ascii=False),
    }
    for name, run in read.runs.items():
        yield shared | msgspec.structs.asdict(run) | {"run": name}


def _table(rows: list[dict[str, Any]]) -> pa.Table:
    fields = [pa.field(name, kind, metadata={"unit": unit} if unit else None) for name, (kind, unit) in COLUMNS.items()]
    return pa.Table.from_pylist(rows, pa.schema(fields))
