"""Folder of a sweep."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from adaptctl.errors import FileError, InputError
from adaptctl.files import hashed, read_json, replacing, validate_readable, write_json
from adaptctl.folders import made_folder
from adaptctl.simulation.rollout_file import CHECKSUM, checksum_of, entries_of, validate_own
from adaptctl.sweeps.rows import columns_of
from adaptctl.sweeps.study import SweepStudy
from adaptctl.version import __version__

SCHEMA: Literal["adaptctl/sweep/2"] = "adaptctl/sweep/2"
TABLE, STUDY = "sweep.parquet", "study.json"


KINDS = {"int64": pa.int64(), "double": pa.float64(), "bool": pa.bool_(), "string": pa.string()}


class Saved(msgspec.Struct, forbid_unknown_fields=True):
    """Content of study.json: what a sweep varies, and how it was started."""

    schema: Literal["adaptctl/sweep/2"]
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
    """Group of a sweep's runs that share a file of rows."""

    key: str
    runs: tuple[Mapping[str, Any], ...]


@dataclass(frozen=True)
class Folder:
    """Folder of a sweep."""

    path: Path
    study: SweepStudy
    shard: int

    @classmethod
    def opened(cls, path: Path, study: SweepStudy, shard: int, command: Sequence[str]) -> Folder:
        """Folder of a study's sweep."""
        if (path / STUDY).is_file():
            saved = saved_study(path)
            if saved.sha256 != study.sha256:
                raise InputError(f"{path}: has another sweep, of {saved.experiment}: give another --out")
            if saved.version != __version__:
                raise InputError(
                    f"{path}: was started by adaptctl {saved.version}, but this is {__version__}: use that version"
                )
            return cls(path, study, saved.shard)
        if path.is_dir() and any(not one.name.startswith(".") for one in path.iterdir()):
            raise InputError(f"{path}: is not empty and has no sweep: give another --out")
        made_folder(path)
        asked = study.sha256, study.experiment, study.question, list(command), list(study.swept), study.count
        write_json(path / STUDY, Saved(SCHEMA, __version__, *asked, shard))
        return cls(path, study, shard)

    def shards(self) -> Iterator[Shard]:
        """Shards of the study's runs, in order."""
        runs, study = self.study.runs(), self.study
        while some := tuple(islice(runs, self.shard)):
            plain = [{name: list(x) if isinstance(x, tuple) else x for name, x in run.items()} for run in some]
            yield Shard(hashed([study.experiment, sorted(study.controllers), plain, *study.unusual])[:32], some)

    def place(self, shard: Shard) -> Path:
        """Path of the Parquet file of a shard."""
        return self.path / "shards" / f"{shard.key}.parquet"

    def has(self, shard: Shard) -> bool:
        """True if a shard's file can be read, is as it was written, and has the rows of all its runs."""
        try:
            about = entries_of(read_checked(self.place(shard)).schema.metadata)
        except FileError:
            return False
        return CHECKSUM in about and about.get("runs") == str(len(shard.runs))

    def keep(self, shard: Shard, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write the rows of a shard, whole or not at all."""
        made_folder(self.path / "shards")
        write_checked(self.place(shard), table(self.study, rows, len(shard.runs)))

    def finished(self) -> pa.Table:
        """Table of all rows in the runs' order, also written to sweep.parquet."""
        shards = list(self.shards())
        if missing := [shard for shard in shards if not self.has(shard)]:
            raise FileError(f"{self.place(missing[0])}: is missing: run the command again")
        whole = pa.concat_tables([read_checked(self.place(shard)) for shard in shards])
        write_checked(self.path / TABLE, whole)
        return whole


def table(study: SweepStudy, rows: Sequence[Mapping[str, Any]], runs: int) -> pa.Table:
    """Table of rows, with each column's meaning and the study as metadata."""
    columns = columns_of(study.kind).items()
    fields = [pa.field(name, KINDS[kind], metadata={"meaning": meaning}) for name, (kind, meaning) in columns]
    about = {"schema": SCHEMA, "experiment": study.experiment, "version": __version__, "runs": str(runs)}
    about |= {"precision": study.precision}
    return pa.Table.from_pylist([dict(row) for row in rows], pa.schema(fields, metadata=about))


def read_table(path: Path) -> pa.Table:
    """Table of a sweep's rows, finished or so far."""
    whole = path / TABLE
    places = [whole] if whole.is_file() else sorted((path / "shards").glob("[!.]*.parquet"))
    if not places:
        raise FileError(f"{path}: has no finished runs of a sweep")
    return pa.concat_tables([read_checked(place) for place in places])


def read_checked(place: Path) -> pa.Table:
    """Table of a Parquet file of rows; `FileError` where it is damaged or was changed."""
    validate_readable(place)
    try:
        with pq.ParquetFile(place) as file:
            found, metadata = file.read(), file.metadata.metadata
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        raise FileError(f"{place}: cannot be read ({(str(error) or 'damaged').splitlines()[0]})") from error
    validate_own(place, found, metadata)
    return found


def saved_study(path: Path) -> Saved:
    """Content of a sweep's study.json."""
    if not (path / STUDY).is_file():
        raise FileError(f"{path}: is not the folder of a sweep: {STUDY} is missing")
    return read_json(path / STUDY, Saved)


def write_checked(path: Path, content: pa.Table) -> None:
    """Write a Parquet file with a hash of its content."""
    about = {name: text for name, text in entries_of(content.schema.metadata).items() if name != CHECKSUM}
    content = content.replace_schema_metadata(about | {CHECKSUM: checksum_of(content, about)})
    with replacing(path) as beside:
        pq.write_table(content, beside, compression="zstd")
