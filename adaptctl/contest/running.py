"""Contest run on the workers of a sweep, resumed where it was stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adaptctl.contest.contest_file import Contest, law_name
from adaptctl.contest.entries import ContestEntry, Row
from adaptctl.contest.measures import COLUMNS
from adaptctl.contest.own_law import is_own
from adaptctl.contest.own_process import rows_alone
from adaptctl.contest.scene import robot_name
from adaptctl.errors import FileError
from adaptctl.files import write_json
from adaptctl.folders import made_folder
from adaptctl.sweeps.cluster import Cluster
from adaptctl.sweeps.folder import read_checked, write_checked
from adaptctl.version import __version__

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA = "adaptctl/contest/1"
RESULTS, ABOUT, SHARDS = "results.parquet", "contest.json", "shards"


@dataclass(frozen=True)
class ContestFolder:
    """Folder of a contest: shards of an entry each, and the table of all rows."""

    path: Path
    contest: Contest

    def entries(self) -> list[ContestEntry]:
        """Entries of the contest, robot by robot, since a worker keeps what it knows of the last robots."""
        asked = self.contest.asked
        how = tuple(asked.conditions), tuple(asked.seeds), asked.duration, tuple(asked.draws), asked.plant
        robots = [(robot, self.contest.robot_hashes[robot_name(robot)]) for robot in asked.robots]
        return [ContestEntry(law, robot, sha, *how) for robot, sha in robots for law in asked.laws]

    def place(self, entry: ContestEntry) -> Path:
        """Path of an entry's file."""
        return self.path / SHARDS / entry.name

    def has(self, entry: ContestEntry) -> bool:
        """True if an entry's file can be read and is as it was written."""
        if not self.place(entry).is_file():
            return False
        try:
            return read_checked(self.place(entry)).num_rows == len(entry.conditions) * len(entry.seeds)
        except FileError:
            return False

    def fails(self, entry: ContestEntry) -> bool:
        """True if all runs of an entry failed."""
        return "" not in read_checked(self.place(entry))["reason"].to_pylist()

    def run(self, cluster: Cluster, progress: Callable[[float], object], lost: Callable[[str], object]) -> pa.Table:
        """
        Run all entries that are missing, and return the table of all rows.

        Laws of others come first, as they may be wrong: `lost` gets a sentence on one that fails throughout, at once.
        """
        made_folder(self.path)
        made_folder(self.path / SHARDS)
        entries = sorted(self.entries(), key=lambda entry: not is_own(entry.law))
        missing = {f"contest-{entry.name}": entry for entry in entries if not self.has(entry)}
        progress(1.0 - len(missing) / len(entries))
        if missing:
            with cluster.client() as client:
                for entry, rows in computed(client, missing):
                    write_checked(self.place(entry), self._table(rows))
                    progress(1.0 - len(missing) / len(entries))
                    if is_own(entry.law) and all(row["reason"] for row in rows):
                        lost(f"{law_name(entry.law)} fails on {robot_name(entry.robot)}: {rows[0]['reason']}")
        return self._finished(self.entries())

    def _finished(self, entries: Iterable[ContestEntry]) -> pa.Table:
        order = {name: k for k, name in enumerate(self.contest.asked.conditions)}
        whole = [row for entry in entries for row in rows_of_table(read_checked(self.place(entry)))]
        found = self._table(sorted(whole, key=lambda row: order[row["condition"]]))
        write_checked(self.path / RESULTS, found)
        write_json(self.path / ABOUT, self.about())
        return found

    def about(self) -> dict[str, Any]:
        """Content of contest.json: the contest's sets, their hash, and the version."""
        asked = self.contest.asked
        told = {"schema": SCHEMA, "version": __version__, "purpose": asked.purpose, "file": str(self.contest.source)}
        return {**told, "laws": asked.laws, "scoring": self.contest.scoring, "sha256": self.contest.scoring_hash}

    def _table(self, rows: Iterable[Row]) -> pa.Table:
        return rows_as_table(rows, COLUMNS, self.contest.scoring_hash)


def rows_as_table(rows: Iterable[Row], columns: Mapping[str, tuple[str, str, str]], scoring: str) -> pa.Table:
    """Table of rows, with each column's unit and meaning, and the hash of the scoring set; NaN is null in it."""
    import pyarrow as pa

    kinds = {"string": pa.string(), "int64": pa.int64(), "double": pa.float64(), "list": pa.list_(pa.float64())}
    fields = [
        pa.field(name, kinds[kind], metadata={"unit": unit, "meaning": meaning})
        for name, (kind, unit, meaning) in columns.items()
    ]
    about = {"schema": SCHEMA, "version": __version__, "scoring": scoring}
    known = [{name: None if row[name] != row[name] else row[name] for name in columns} for row in rows]
    return pa.Table.from_pylist(known, pa.schema(fields, metadata=about))


def rows_of_table(table: pa.Table) -> list[Row]:
    """Rows of a table, with NaN for numbers that are not known."""
    names = [field.name for field in table.schema if str(field.type) == "double"]
    rows: list[Row] = table.to_pylist()
    return [{**row, **{name: float("nan") for name in names if row[name] is None}} for row in rows]


def rows_of(entry: ContestEntry) -> list[Row]:
    """Rows of an entry, where a worker computes them."""
    return rows_alone(entry) if is_own(entry.law) else entry.rows()


def computed(client: Any, missing: dict[str, ContestEntry]) -> Iterator[tuple[ContestEntry, list[Row]]]:
    """Entries and their rows as they end."""
    import distributed

    futures = [client.submit(rows_of, entry, key=key, pure=False) for key, entry in missing.items()]
    for future in distributed.as_completed(futures):  # type: ignore[no-untyped-call]
        yield missing.pop(future.key), future.result()
        future.release()
