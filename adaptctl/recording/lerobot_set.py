"""Finished runs as a data set of LeRobot (v3.0), an episode each."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.files import write_json
from adaptctl.folders import made_folder
from adaptctl.recording.finished_trace import FinishedTrace

CHUNK = 1000
"""files in a folder"""
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
"""place of an episode's file"""
EPISODES, TASKS = "meta/episodes/chunk-000/file-000.parquet", "meta/tasks.parquet"
FEATURES: Mapping[str, tuple[tuple[str, str], ...]] = {
    "observation.state": (("p", "pos"), ("v", "vel")),
    "observation.effort": (("applied", "effort"),),
    "observation.environment_state": (("reference_p", "desired_pos"), ("reference_v", "desired_vel")),
    "action": (("torque", "effort"),),
}
"""Kinds of a trace's columns, with the ends of names, of each feature."""
QUANTILES = (1, 10, 50, 90, 99)
"""in percent"""
INDICES = ("frame_index", "episode_index", "index", "task_index")


def write_lerobot(folder: str | Path, traces: Sequence[FinishedTrace]) -> None:
    """
    Write finished runs of one robot as a data set of LeRobot, an episode each.

    Parameters
    ----------
    folder : str or Path
        Empty folder, filled with `meta` and `data`. Numbers and times are 64-bit floats in SI units and rad.
    traces : sequence of FinishedTrace
        Samples of the runs.

    Raises
    ------
    InputError
        If the runs have different robots, joints or sample rates, or the rate is no whole number of Hz.
    FileError
        If a file cannot be written.
    """
    rate = _common(traces)
    tasks = list(dict.fromkeys(map(_task, traces)))
    episodes, content, start = list[dict[str, Any]](), list[dict[str, Array]](), 0
    for i, trace in enumerate(traces):
        content.append(columns := _columns(trace, i, start, tasks.index(_task(trace))))
        place = {"chunk_index": i // CHUNK, "file_index": i % CHUNK}
        _write(
            Path(folder) / DATA.format(**place), pa.table({name: _column(values) for name, values in columns.items()})
        )
        told = {f"data/{key}": value for key, value in place.items()} | {f"meta/episodes/{key}": 0 for key in place}
        length = len(trace.table)
        span = {"dataset_from_index": start, "dataset_to_index": start + length}
        flat = {f"stats/{name}/{key}": x for name, one in _stats([columns]).items() for key, x in one.items()}
        episodes.append({"episode_index": i, "tasks": [_task(trace)], "length": length} | told | span | flat)
        start += length
    _write(Path(folder) / EPISODES, pa.Table.from_pylist(episodes))
    _write(Path(folder) / TASKS, _task_table(tasks))
    write_json(Path(folder) / "meta" / "stats.json", _stats(content))
    write_json(Path(folder) / "meta" / "info.json", _info(traces, rate, start, len(tasks)))


def _common(traces: Sequence[FinishedTrace]) -> int:
    """Samples in a second of all runs."""
    if not traces:
        raise InputError("expected at least one run")
    first = traces[0]
    for trace in traces:
        if any(trace.entry(what) != first.entry(what) for what in ("robot", "geometry_sha256")):
            raise InputError(
                f"a data set has one robot, but {first.folder} is of {first.entry('robot')}, "
                f"and {trace.folder} of {trace.entry('robot')} or another geometry"
            )
    rates = [1.0 / trace.sample_time for trace in traces]
    for trace, rate in zip(traces, rates, strict=True):
        if abs(rate - round(rates[0])) > 1e-6 * rate:
            raise InputError(f"{trace.folder}: {rate:g} samples in a second; a data set has one whole number of them")
    return round(rates[0])


def _task(trace: FinishedTrace) -> str:
    return f"{trace.entry('experiment')}: {trace.entry('run')}"


def _columns(trace: FinishedTrace, episode: int, start: int, task: int) -> dict[str, Array]:
    """Columns (T,) or (T, n) of an episode."""
    count = np.arange(len(trace.table))
    wide = {name: np.hstack([trace.columns(kind) for kind, _ in parts]) for name, parts in FEATURES.items()}
    numbers = dict(zip(INDICES, (count, 0 * count + episode, count + start, 0 * count + task), strict=True))
    return wide | {"timestamp": trace.time - trace.time[0]} | numbers


def _column(values: Array) -> pa.Array:
    if values.ndim == 1 or values.shape[1] == 1:
        return pa.array(values.ravel())
    return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])


def _write(path: Path, table: pa.Table) -> None:
    made_folder(path.parent)
    pq.write_table(table, path)


def _task_table(tasks: Sequence[str]) -> pa.Table:
    """Table that pandas reads with the tasks as its index, as LeRobot looks them up."""
    columns = {"task_index": ("int64", np.arange(len(tasks))), "task": ("unicode", list(tasks))}
    fields: list[dict[str, Any]] = [
        {"name": name, "field_name": name, "pandas_type": kind} for name, (kind, _) in columns.items()
    ]
    whole = {"numpy_type": "object", "metadata": None}
    about = {"index_columns": ["task"], "columns": [field | whole for field in fields], "column_indexes": []}
    table = pa.table({name: values for name, (_, values) in columns.items()})
    return table.replace_schema_metadata({"pandas": json.dumps(about)})


def _stats(episodes: Sequence[Mapping[str, Array]]) -> dict[str, dict[str, list[float]]]:
    """Statistics of each feature over episodes."""
    found = {}
    for name in episodes[0]:
        values = np.concatenate([one[name] for one in episodes]).astype(np.float64)
        values = values.reshape(len(values), -1)
        spread = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
        shares = {f"q{share:02d}": np.quantile(values, share / 100.0, axis=0) for share in QUANTILES}
        found[name] = {key: one.tolist() for key, one in (spread | shares).items()} | {"count": [len(values)]}
    return found


def _info(traces: Sequence[FinishedTrace], rate: int, frames: int, tasks: int) -> dict[str, Any]:
    features: dict[str, Any] = {}
    for name, parts in FEATURES.items():
        columns = [(kind, joint, end) for kind, end in parts for joint in traces[0].names(kind)]
        names = [f"{joint}.{end}" for _, joint, end in columns]
        units = [traces[0].unit(f"{kind}.{joint}") for kind, joint, _ in columns]
        features[name] = {"dtype": "float64", "shape": [len(names)], "names": names, "units": units}
    features["timestamp"] = {"dtype": "float64", "shape": [1], "names": None}
    features |= {name: {"dtype": "int64", "shape": [1], "names": None} for name in INDICES}
    return {
        "codebase_version": "v3.0",
        "robot_type": traces[0].entry("robot"),
        "total_episodes": len(traces),
        "total_frames": frames,
        "total_tasks": tasks,
        "chunks_size": CHUNK,
        "fps": rate,
        "splits": {"train": f"0:{len(traces)}"},
        "data_path": DATA,
        "video_path": None,
        "features": features,
    }
