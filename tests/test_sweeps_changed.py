"""Rows of a sweep whose file was changed are not taken for results, and run again."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from nightly import nightly

from adaptctl.errors import FileError
from adaptctl.sweeps.folder import read_table

SWEEP = [
    *(sys.executable, "-m", "adaptctl", "sweep", "puma560-adaptive", "--duration", "0.05", "--controllers", "adaptive"),
    *("--seed", "0..2", "--shard-size", "1", "--jobs", "1"),
]


def number(place: Path) -> None:
    table = pq.read_table(place)
    name = next(field.name for field in table.schema if field.type == pa.float64() and field.name != "duration")
    other = pa.array([0.125] * len(table))
    pq.write_table(table.set_column(table.column_names.index(name), table.schema.field(name), other), place)


def text(place: Path) -> None:
    table = pq.read_table(place)
    name = next(field.name for field in table.schema if field.type == pa.string())
    other = pa.array(["other"] * len(table))
    pq.write_table(table.set_column(table.column_names.index(name), table.schema.field(name), other), place)


def cut(place: Path) -> None:
    place.write_bytes(place.read_bytes()[:-40])


@nightly
def test_shards_that_were_changed_run_again(tmp_path: Path) -> None:
    command = [*SWEEP, "--out", str(tmp_path / "out")]
    subprocess.run(command, check=True, capture_output=True)
    whole = tmp_path / "out" / "sweep.parquet"
    rows = pq.read_table(whole)
    read_table(tmp_path / "out")
    places = sorted((tmp_path / "out" / "shards").glob("[!.]*.parquet"))
    for change, place in zip((number, text, cut), places, strict=True):
        change(place)
    whole.unlink()
    with pytest.raises(FileError, match=r"\.parquet: "):
        read_table(tmp_path / "out")
    subprocess.run(command, check=True, capture_output=True)
    again = pq.read_table(whole)
    timed = {name for name in rows.column_names if "time" in name or "tick" in name}
    assert rows.drop_columns(sorted(timed)).equals(again.drop_columns(sorted(timed)))


@nightly
def test_a_table_with_other_numbers_is_refused_with_the_line_that_accepts_it(tmp_path: Path) -> None:
    command = [*SWEEP, "--out", str(tmp_path / "out")]
    subprocess.run(command, check=True, capture_output=True)
    number(tmp_path / "out" / "sweep.parquet")
    with pytest.raises(FileError, match=r"sweep\.parquet: the numbers are not those that were written") as refused:
        read_table(tmp_path / "out")
    exec(str(refused.value).partition("use ")[2].partition(", pq being")[0], {"pq": pq})
    assert len(read_table(tmp_path / "out")) == 3
