"""A sweep's folder: what is varied, and shards of finished rows that are there whole or not at all."""

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
from adaptctl.files import hashed, read_json, replacing, write_json
from adaptctl.folders import made_folder
from adaptctl.sweeps.rows import columns_of
from adaptctl.sweeps.study import SweepStudy
from adaptctl.version import __version__

SCHEMA: Literal["adaptctl/sweep/2"] = "adaptctl/sweep/2"
TABLE, STUDY = "sweep.parquet", "study.json"


KINDS = {"int64": pa.int64(), "double": pa.float64(), "bool": pa.bool_(), "string": pa.string()}


class Saved(msgspec.Struct, forbid_unknown_fields=True):
    """Content of the file study.json in a sweep's folder: `version`, that of adaptctl when the sweep began; `sha256`, a
    hash of all that decides the runs; `experiment`, the experiment's name; `question`, what the runs are to answer;
    `command`, the command line's words; `swept`, the names of the settings with several values; `runs`, the number of
    all runs; and `shard`, the number of runs in one file of rows. `schema` is the file format's name. Types are checked
    where a file is read, not at construction."""

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
    """A shard of a sweep: a group of runs that are computed together and whose rows are one file. `runs` has the
    settings of each by name; `key`, 32 hexadecimal digits, is a hash of all that decides their results, and names the
    file. Nothing is checked."""

    key: str
    runs: tuple[Mapping[str, Any], ...]


@dataclass(frozen=True)
class Folder:
    """The folder of a sweep's results: `path`; `study`, the `SweepStudy` whose runs are computed; and `shard`, the
    number of runs in each file of rows (a shard). Made by `Folder.opened`; construction neither checks nor writes."""

    path: Path
    study: SweepStudy
    shard: int

    @classmethod
    def opened(cls, path: Path, study: SweepStudy, shard: int, command: Sequence[str]) -> Folder:
        """The `Folder` of the sweep of a `study` at `path`. A folder that was started earlier keeps its number of runs
        in a shard (a file of rows); a new one is made, with `shard` runs in each, and its study.json written. `command`
        has the command line's words, which study.json records. Raises `InputError` for a folder with the sweep of
        another study or of another version of adaptctl, or with other files; `FileError` where study.json cannot be
        read or written or the folder cannot be made."""
        if (path / STUDY).is_file():
            saved = saved_study(path)
            if saved.sha256 != study.sha256:
                raise InputError(f"{path}: has the sweep of another study, of {saved.experiment}: choose another --out")
            if saved.version != __version__:
                raise InputError(f"{path}: was started by adaptctl {saved.version}, this is {__version__}: use that")
            return cls(path, study, saved.shard)
        if path.is_dir() and any(not one.name.startswith(".") for one in path.iterdir()):
            raise InputError(f"{path}: is not empty, and no sweep's: choose another --out")
        made_folder(path)
        asked = study.sha256, study.experiment, study.question, list(command), list(study.swept), study.count
        write_json(path / STUDY, Saved(SCHEMA, __version__, *asked, shard))
        return cls(path, study, shard)

    def shards(self) -> Iterator[Shard]:
        """Iterator over the shards of the folder's study: its runs, in order, in groups of equal number (the last may
        have fewer), one file each. Raises, unless the study's `sampling` is "grid", `NotFoundError` for an unknown
        experiment and `KeyError` for a setting that the experiment does not have."""
        runs, study = self.study.runs(), self.study
        while some := tuple(islice(runs, self.shard)):
            plain = [{name: list(x) if isinstance(x, tuple) else x for name, x in run.items()} for run in some]
            yield Shard(hashed([study.experiment, sorted(study.controllers), plain, *study.unusual])[:32], some)

    def place(self, shard: Shard) -> Path:
        """Path of the Parquet file with the rows of a `shard`, a group of the sweep's runs; the file need not exist.
        Nothing is raised."""
        return self.path / "shards" / f"{shard.key}.parquet"

    def has(self, shard: Shard) -> bool:
        """True if the file of a `shard`, a group of the sweep's runs, exists, can be read and says that it has the rows
        of all its runs; False otherwise. Nothing is raised."""
        try:
            about = pq.read_metadata(self.place(shard)).metadata or {}
        except (OSError, pa.ArrowInvalid):
            return False
        return bool(about.get(b"runs") == str(len(shard.runs)).encode())

    def keep(self, shard: Shard, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write the Parquet file of a `shard`, a group of the sweep's runs, with their `rows`, mappings by column, in
        the order of the runs; nothing is returned. The file is written whole or not at all. Raises `FileError` where
        the file cannot be written or its folder cannot be made."""
        made_folder(self.path / "shards")
        _write(self.place(shard), table(self.study, rows, len(shard.runs)))

    def finished(self) -> pa.Table:
        """Table (pyarrow) of the rows of all runs, in their order, which is also written to sweep.parquet in the
        folder. Raises `FileError` where the file of a shard, a group of runs, is missing or the table cannot be
        written."""
        shards = list(self.shards())
        if missing := [shard for shard in shards if not self.has(shard)]:
            raise FileError(f"{self.place(missing[0])}: is missing: run the same command again")
        whole = pa.concat_tables([pq.read_table(self.place(shard)) for shard in shards])
        _write(self.path / TABLE, whole)
        return whole


def table(study: SweepStudy, rows: Sequence[Mapping[str, Any]], runs: int) -> pa.Table:
    """Table (pyarrow) of `rows`, mappings by column, of `runs` runs of a `study`. Each column's metadata has its
    meaning, with the unit; the table's metadata has experiment, version, precision and number of runs. What a
    row lacks is null."""
    columns = columns_of(study.kind).items()
    fields = [pa.field(name, KINDS[kind], metadata={"meaning": meaning}) for name, (kind, meaning) in columns]
    about = {"schema": SCHEMA, "experiment": study.experiment, "version": __version__, "runs": str(runs)}
    about |= {"precision": study.precision}
    return pa.Table.from_pylist([dict(row) for row in rows], pa.schema(fields, metadata=about))


def read_table(path: Path) -> pa.Table:
    """Table (pyarrow) of the rows of the sweep in the folder `path`: all, in the runs' order, where the sweep is
    finished, else those computed so far, in the order of their files' names. Raises `FileError` where there are no rows
    or a file cannot be read."""
    whole = path / TABLE
    places = [whole] if whole.is_file() else sorted((path / "shards").glob("[!.]*.parquet"))
    if not places:
        raise FileError(f"{path}: has no finished runs of a sweep")
    try:
        return pa.concat_tables([pq.read_table(place) for place in places])
    except (OSError, pa.ArrowInvalid) as error:
        raise FileError(f"{path}: cannot be read ({error})") from error


def saved_study(path: Path) -> Saved:
    """Content, a `Saved`, of the file study.json in the folder `path`: what the sweep in it varies. Raises `FileError`
    where there is no such file, or it cannot be read or has other content."""
    if not (path / STUDY).is_file():
        raise FileError(f"{path}: is no sweep's folder: {STUDY} is missing")
    return read_json(path / STUDY, Saved)


def _write(path: Path, content: pa.Table) -> None:
    with replacing(path) as beside:
        pq.write_table(content, beside, compression="zstd")
