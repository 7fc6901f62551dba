"""`adaptctl runs`: table of the experiments in a folder."""

from __future__ import annotations

import sys
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from adaptctl.cli.output import Json, WrappedTable, print_json, print_parts
from adaptctl.errors import InputError, suggested_name

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adaptctl.recording.run_table import FoundRuns

DONE = 0
RUNS_SCHEMA = "adaptctl/runs/1"
SHOWN = ("folder", "robot", "label", "first_rms_error", "final_rms_error", "outcome")
HEADS = ("folder", "robot", "controller", "first second", "last 2 s", "outcome")


def runs(
    folder: Annotated[Path, Parameter(name="DIR")],
    /,
    *,
    where: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    sort: str = "final_rms_error",
    json: Json = False,
) -> int:
    """
    Print the runs of all experiments in a folder, and keep them as runs.parquet.

    Errors are root mean squares in mrad (mm).

    Parameters
    ----------
    folder : Path
        Folder with results of experiments, also in folders below.
    where : tuple of str
        Conditions COLUMN=PATTERN, such as robot=puma560* or passed=True; all must hold.
    sort : str
        Column to sort by; runs without a value come last.
    json : bool
        Print JSON instead of text, with all columns in SI units.
    """
    from adaptctl.recording.run_table import RUN_TABLE, find_runs

    found = find_runs(folder)
    rows = _selected(found, where, sort)
    found.write(folder / RUN_TABLE)
    for one in found.broken:
        print(f"adaptctl: passed over: {one}", file=sys.stderr)
    if json:
        print_json({"schema": RUNS_SCHEMA, "runs": rows, "broken": list(found.broken)})
    else:
        _print(rows, folder / RUN_TABLE)
    return DONE


def _selected(found: FoundRuns, where: Sequence[str], sort: str) -> list[dict[str, Any]]:
    """Rows that fulfil the conditions, sorted."""
    columns = found.table.column_names
    conditions = [condition.partition("=") for condition in where]
    for (name, equals, _), given in zip(conditions, where, strict=True):
        if not equals:
            raise InputError(f"--where: expected COLUMN=PATTERN, such as robot=puma560*, got {given!r}")
        _validate_column("--where", name, columns)
    _validate_column("--sort", sort, columns)
    rows = [
        row
        for row in found.table.to_pylist()
        if all(fnmatchcase(str(row[name]), pattern) for name, _, pattern in conditions)
    ]
    return sorted(rows, key=lambda row: (row[sort] is None, row[sort] if row[sort] is not None else 0))


def _validate_column(flag: str, name: str, columns: Sequence[str]) -> None:
    if name not in columns:
        raise InputError(f"{flag}: no column {name!r}{suggested_name(name, columns)}; there are: {', '.join(columns)}")


def _print(rows: list[dict[str, Any]], path: Path) -> None:
    cells = [[_text((row | {"outcome": _outcome(row)})[name]) for name in SHOWN] for row in rows]
    print_parts([WrappedTable(HEADS, cells)])
    print(f"\n{len(rows)} runs; all columns in {path}")


def _outcome(row: dict[str, Any]) -> str:
    if row["terminated"]:
        return f"ended after {row['duration']:.3g} s"
    if not row["complete"]:
        return "interrupted"
    return "" if row["passed"] else "experiment failed"


def _text(value: Any) -> str:
    return "–" if value is None else f"{1e3 * value:.3g}" if isinstance(value, float) else str(value)
