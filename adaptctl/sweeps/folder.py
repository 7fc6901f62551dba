"""A sweep's folder: what is varied, and shards of finished rows that are there whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from adaptctl.errors import FileError, InputError
from adaptctl.files import hashed, read_json, replacing, write_json
from adaptctl.sweeps.rows import columns_of
from adaptctl.sweeps.study import SweepStudy
from adaptctl.version import __version__

SCHEMA, TABLE, STUDY = "adaptctl/sweep/1", "sweep.parquet", "study.json"


class Saved(msgspec.Struct, forbid_unknown_fields=True):
    """Content of a sweep's `study.json`."""

    schema: Literal["adaptctl/sweep/1"]
    version: str
    sha256: str
    experiment: str
    question: str
    command: list[str]
    swept: list[str]
    runs: int
    shard: int


@dataclass(frozen=True)
class Shard:
    """A shard of a sweep: runs that are computed, and kept, together; `key` is the hash of their settings."""

    key: str
    runs: tuple[Mapping[str, Any], ...]


@dataclass(frozen=True)
class Folder:
    """The folder of a study's sweep, `shard` runs a file."""

    path: Path
    study: SweepStudy
    shard: int

    @classmethod
    def opened(cls, path: Path, study: SweepStudy, shard: int, command: Sequence[str]) -> Folder:
        """The folder, made where there is none. Raises `InputError` for a folder of something else."""
        place = path / STUDY
        if place.is_file():
            saved = read_json(place, Saved)
            if saved.sha256 != study.sha256:
                raise InputError(f"{path}: has the sweep of another study, of {saved.experiment}: choose another --out")
            if saved.version != __version__:
                raise InputError(f"{path}: was begun by adaptctl {saved.version}, this is {__version__}: use that")
            return cls(path, study, saved.shard)
        if path.is_dir() and any(not one.name.startswith(".") for one in path.iterdir()):
            raise InputError(f"{path}: is not empty, and no sweep's: choose another --out")
        path.mkdir(parents=True, exist_ok=True)
        about = Saved(
            schema="adaptctl/sweep/1",
            version=__version__,
            sha256=study.sha256,
            experiment=study.experiment,
            question=study.question,
            command=list(command),
            swept=list(study.swept),
            runs=study.count,
            shard=shard,
        )
        write_json(place, about)
        return cls(path, study, shard)

    def shards(self) -> Iterator[Shard]:
        """The study's shards, in order."""
        runs: list[Mapping[str, Any]] = []
        for settings in self.study.runs():
            runs.append(settings)
            if len(runs) == self.shard:
                yield self._shard(runs)
                runs = []
        if runs:
            yield self._shard(runs)

    def _shard(self, runs: Sequence[Mapping[str, Any]]) -> Shard:
        plain = [{name: list(x) if isinstance(x, tuple) else x for name, x in run.items()} for run in runs]
        decides = [self.study.experiment, sorted(self.study.controllers), plain, *self.study.unusual]
        return Shard(hashed(decides)[:32], tuple(runs))

    def place(self, shard: Shard) -> Path:
        """The file of a shard."""
        return self.path / "shards" / f"{shard.key}.parquet"

    def has(self, shard: Shard) -> bool:
        """True if a shard's file is there, can be read, and has all its runs."""
        try:
            about = pq.read_metadata(self.place(shard)).metadata or {}
        except (OSError, pa.ArrowInvalid):
            return False
        return bool(about.get(b"runs") == str(len(shard.runs)).encode())

    def keep(self, shard: Shard, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write a shard, whole or not at all. Raises FileError where it cannot be written."""
        (self.path / "shards").mkdir(exist_ok=True)
        _write(self.place(shard), table(self.study, rows, len(shard.runs)))

    def finished(self) -> pa.Table:
        """Table of all rows, in order, which is written too. Raises `FileError` while a shard is missing."""
        parts = []
        for shard in self.shards():
            if not self.has(shard):
                raise FileError(f"{self.place(shard)}: is missing: run the same command again")
            parts.append(pq.read_table(self.place(shard)))
        whole = pa.concat_tables(parts)
        _write(self.path / TABLE, whole)
        return whole


def table(study: SweepStudy, rows: Sequence[Mapping[str, Any]], runs: int) -> pa.Table:
    """Rows as a table whose columns tell their meaning."""
    kinds = {"int64": pa.int64(), "double": pa.float64(), "string": pa.string()}
    columns = columns_of(study.kind)
    fields = [pa.field(name, kinds[kind], metadata={"meaning": meaning}) for name, (kind, meaning) in columns.items()]
    about = {"schema": SCHEMA, "experiment": study.experiment, "version": __version__, "runs": str(runs)}
    about |= {"precision": study.precision}
    arrays = [pa.array([row[name] for row in rows], field.type) for name, field in zip(columns, fields, strict=True)]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=about))


def read_table(path: Path) -> pa.Table:
    """The rows of a sweep's folder, so far. Raises `FileError` where there are none."""
    if (path / TABLE).is_file():
        return _read(path / TABLE)
    parts = [_read(place) for place in sorted((path / "shards").glob("[!.]*.parquet"))]
    if not parts:
        raise FileError(f"{path}: has no finished runs of a sweep")
    return pa.concat_tables(parts)


def saved_study(path: Path) -> Saved:
    """The study whose sweep is in a folder. Raises `FileError` for another folder."""
    if not (path / STUDY).is_file():
        raise FileError(f"{path}: is no sweep's folder: {STUDY} is missing")
    return read_json(path / STUDY, Saved)


def _read(path: Path) -> pa.Table:
    try:
        return pq.read_table(path)
    except (OSError, pa.ArrowInvalid) as error:
        raise FileError(f"{path}: cannot be read ({error})") from error


def _write(path: Path, content: pa.Table) -> None:
    with replacing(path) as beside:
        pq.write_table(content, beside, compression="zstd")
