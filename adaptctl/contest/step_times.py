"""Times of the laws of a contest, one after the other on a machine that does nothing else."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.contest.conditions import CONDITIONS
from adaptctl.contest.entries import ContestEntry, Row, entrant_of
from adaptctl.contest.known import Known
from adaptctl.contest.running import ContestFolder, rows_as_table, rows_of_table
from adaptctl.contest.scene import scene_of
from adaptctl.contest.trial import in_time
from adaptctl.control import Controller
from adaptctl.control.controller import Reference, compiled_law
from adaptctl.errors import FileError
from adaptctl.sweeps.cluster import Cluster
from adaptctl.sweeps.folder import read_checked, write_checked

if TYPE_CHECKING:
    import pyarrow as pa

TIMES = "times.parquet"
NAMES = ("making", "compilation", "step")
TIME_COLUMNS = {
    "entry": ("string", "", "file of the rows of this law on this robot"),
    "law": ("string", "", "law"),
    "robot": ("string", "", "robot"),
    "making": ("double", "s", "time to make the law, its own tuning included; null of a law that fails"),
    "compilation": ("double", "s", "time to compile the law, with nothing cached"),
    "step": ("double", "µs", "median time of a control step, called from Python"),
}
"""Kind, unit and meaning of each column of times.parquet."""
STEPS, LIMIT = 2000, 120.0
"""control steps that are timed, and s that compilation and steps may take"""


def write_times(folder: ContestFolder, progress: Callable[[float], object]) -> None:
    """Write the times of all entries that have none yet, in a process of their own."""
    known, entries = {row["entry"]: row for row in kept_times(folder)}, folder.entries()
    known |= {entry.name: _untimed(entry) for entry in entries if folder.fails(entry)}
    missing = [entry for entry in entries if entry.name not in known]
    if missing:
        with Cluster(jobs=1).client() as client:
            for k, entry in enumerate(missing):
                progress(k / len(missing))
                known[entry.name] = client.submit(times_of, entry, pure=False).result()
    rows = [known[entry.name] for entry in entries]
    write_checked(folder.path / TIMES, rows_as_table(rows, TIME_COLUMNS, folder.contest.scoring_hash))


def kept_times(folder: ContestFolder) -> list[Row]:
    """Rows of times.parquet that are of the contest's entries as they are now; none without that file."""
    if not (folder.path / TIMES).is_file():
        return []
    try:
        table: pa.Table = read_checked(folder.path / TIMES)
    except FileError:
        return []
    names = {entry.name for entry in folder.entries()}
    return [row for row in rows_of_table(table) if row["entry"] in names]


def slowest(rows: list[Row]) -> dict[str, Row]:
    """Longest times over the robots, by law; NaN of a law that has none."""
    laws = dict.fromkeys(row["law"] for row in rows)
    return {
        law: {name: float(np.fmax.reduce([row[name] for row in rows if row["law"] == law])) for name in NAMES}
        for law in laws
    }


def _untimed(entry: ContestEntry) -> Row:
    about = entry.about("", 0)
    return {"entry": entry.name, "law": about["law"], "robot": about["robot"], **dict.fromkeys(NAMES, float("nan"))}


def times_of(entry: ContestEntry) -> Row:
    """Times of an entry, where a worker takes them."""
    warnings.simplefilter("ignore")
    os.environ["ADAPTCTL_CACHE"] = "off"
    found = _untimed(entry)
    try:
        return found | in_time(lambda: _measured(entry), LIMIT)
    except Exception:  # whatever the law's own code raises; its rows have the reason
        return found


def _measured(entry: ContestEntry) -> Row:
    entrant, condition = entrant_of(entry.law), CONDITIONS["clean"]
    scene = scene_of(entry.robot, condition.control_period)
    seed = entry.seeds[0]
    known = Known.of(scene, entrant.knows, seed, condition.parameters(scene, seed))
    entrant_of("gradient").make(known)  # with what all laws share
    compiled_law.cache_clear()  # as laws of other parameters may have left theirs
    began = perf_counter()
    law = entrant.make(known)
    made = perf_counter()
    law.compile()
    return {
        "making": made - began,
        "compilation": perf_counter() - made,
        "step": _step_time(law, scene.reference(seed)),
    }


def _step_time(law: Controller[Any], reference: Reference) -> float:
    """Median time of a control step in µs."""
    point, times = reference(0.0), list[float]()
    memory = law.init(point.p, point.v)
    for k in range(STEPS):
        point = reference(k * 1e-3)
        began = perf_counter()
        _, memory = law.step(memory, point.p, point.v, point)
        times.append(perf_counter() - began)
    return 1e6 * float(np.median(times))
