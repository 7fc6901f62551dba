"""Runs as data, in tools that nobody here wrote: `make check-data`.

A hundred runs of five robots are asked for the best law of each robot, by DuckDB from runs.parquet and by rerun's
catalog from the recordings: both answer the same within a second. LeRobot opens a data set in an environment of its
own, Minari one of an expert and a learning controller, and moviepy a video. Names each tool that is missing, with the
command that brings it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from comparisons import comparison

import adaptctl
from adaptctl.control import ComputedTorque
from adaptctl.dynamics import load
from adaptctl.envs import VideoRecorder, write_minari
from adaptctl.errors import PhysicalConsistencyWarning
from adaptctl.files import write_json
from adaptctl.folders import made_folder
from adaptctl.identifiability import ReducedModel
from adaptctl.recording import ControllerRun
from adaptctl.recording.finished_trace import read_trace
from adaptctl.recording.lerobot_set import write_lerobot
from adaptctl.recording.live import HOST
from adaptctl.recording.rerun_recording import write_recording
from adaptctl.recording.run_table import RUN_TABLE, find_runs
from adaptctl.recording.summary import sealed, summary
from adaptctl.recording.trace import write_trace
from adaptctl.simulation import rollout

ROBOTS, SEEDS = ("two_link", "puma560_arm3", "puma560_measured", "semi_direct_drive", "puma560"), 20
LAWS = ("SlotineLi + Gradient", "SlotineLi + Composite", "SlotineLi + GuardedLearning")
SAMPLES = 1100
"""for errors of the last 2 s"""
SINGLE = 1e-6
"""rad, of numbers that LeRobot gives in single precision"""
MAX_TIME = 1.0
"""s, of a query"""
QUERY = """SELECT DISTINCT ON (robot) robot, law, final_rms_error FROM runs
WHERE prior_knowledge = 'gains only' ORDER BY robot, final_rms_error"""
LEROBOT = """
import json, sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
found = LeRobotDataset("local/set", root=sys.argv[1], delta_timestamps={"observation.state": [-0.002, 0.0]})
row = found[len(found) - 1]
print(json.dumps([len(found), found.num_episodes, row["observation.state"][1].tolist(), row["task"]]))
"""
LEROBOT_HOME = Path(__file__).resolve().parent.parent / ".venv-lerobot"


def write_runs(folder: Path) -> dict[str, tuple[str, float]]:
    """Write recordings and summaries; the best law of each robot, and its error."""
    found: dict[str, list[tuple[str, float]]] = {robot: [] for robot in ROBOTS}
    rng = np.random.default_rng(0)
    for robot in ROBOTS:
        with warnings.catch_warnings(action="ignore", category=PhysicalConsistencyWarning):
            made = comparison(load(robot), SAMPLES)
        for seed in range(SEEDS):
            scale = 10.0 ** rng.uniform(-2.0, 1.0)
            runs = tuple(scaled(run, scale, LAWS[(seed + i) % 3]) for i, run in enumerate(made.runs))
            one, place = replace(made, runs=runs, seed=seed), folder / f"{robot}-{seed}"
            place.mkdir()
            write_recording(place / "recording.rrd", one)
            write_json(place / "summary.json", sealed(summary(one)))
            found[robot] += [(run.law, run.final_rms_error or np.inf) for run in runs]
    return {robot: min(errors, key=lambda entry: entry[1]) for robot, errors in found.items()}


def scaled(run: ControllerRun, scale: float, law: str) -> ControllerRun:
    """Run with larger or smaller errors, under another law's name."""
    rollout = run.rollout
    return replace(run, law=law, rollout=replace(rollout, p=rollout.reference_p + scale * rollout.error))


def by_duckdb(folder: Path) -> tuple[float, list[tuple[Any, ...]]]:
    """Time in s of the query on runs.parquet, and rows."""
    import duckdb

    off = {"autoinstall_known_extensions": False, "autoload_known_extensions": False}
    with duckdb.connect(config=off) as connection:
        begin = time.perf_counter()
        connection.execute(f"CREATE VIEW runs AS FROM '{folder / RUN_TABLE}'")
        rows = connection.execute(QUERY).fetchall()
        return time.perf_counter() - begin, rows


def by_catalog(folder: Path) -> tuple[float, list[tuple[Any, ...]]]:
    """Time in s of the query on the recordings' properties, and rows."""
    from datafusion import col
    from rerun.server import Server

    files = [str(path.resolve()) for path in folder.rglob("recording.rrd")]
    with Server(host=HOST, datasets={"runs": files}) as server:
        client, begin = server.client(), time.perf_counter()
        table, each = client.get_dataset("runs").segment_table(), ("law", "prior_knowledge", "final_rms_error")
        named = (col(f'"property:adaptctl:runs_{name}"').alias(name) for name in each)
        rows = table.select(col('"property:adaptctl:robot"').alias("robot"), *named)
        client.ctx.register_view("runs", rows.unnest_columns("robot").unnest_columns(*each))
        found = client.ctx.sql(QUERY).to_pydict()
        return time.perf_counter() - begin, list(zip(*found.values(), strict=True))


def check_queries(folder: Path) -> Iterator[str]:
    """Failures of the query in either tool."""
    best = write_runs(folder)
    find_runs(folder).write(folder / RUN_TABLE)
    expected = [(robot, *best[robot]) for robot in sorted(best)]
    tools: tuple[tuple[str, str, Callable[[Path], tuple[float, list[tuple[Any, ...]]]]], ...] = (
        ("duckdb", "duckdb", by_duckdb),
        ("rerun-sdk[catalog]", "datafusion", by_catalog),
    )
    for tool, package, query in tools:
        if find_spec(package) is None:
            yield f"{tool} is missing: .venv-data/bin/pip install '{tool}'"
            continue
        took, rows = min((query(folder) for _ in range(3)), key=lambda one: one[0])  # a machine may be busy
        print(f"{tool}: best law of {len(rows)} robots in {len(ROBOTS) * SEEDS} runs, {took:.2f} s")
        if rows != expected or took > MAX_TIME:
            yield f"{tool}: {rows} in {took:.2f} s, not {expected} within {MAX_TIME:g} s"


def check_lerobot(folder: Path) -> Iterator[str]:
    """Failures of LeRobot with a data set of two episodes."""
    python = LEROBOT_HOME / "bin" / "python"
    if not python.exists() or subprocess.run([python, "-c", "import lerobot"], check=False).returncode:
        yield "lerobot is missing: .venv-lerobot/bin/pip install lerobot"
        return
    run = comparison(load("two_link"), SAMPLES)
    write_trace(folder / "trace.parquet", run)
    write_lerobot(folder / "set", [read_trace(folder), read_trace(folder)])
    offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(folder / "cache")}
    command = [python, "-c", LEROBOT, str(folder / "set")]
    done = subprocess.run(command, env=os.environ | offline, capture_output=True, text=True, check=False)
    if done.returncode:
        yield f"lerobot: {done.stderr.strip().splitlines()[-1]}"
        return
    frames, episodes, last, task = json.loads(done.stdout.strip().splitlines()[-1])
    off = np.abs(np.array(last) - np.r_[run.subject.rollout.p[-1], run.subject.rollout.v[-1]]).max()
    print(f"lerobot: {episodes} episodes, {frames} frames, task {task!r}; the last state differs by {off:.1e}")
    if (frames, episodes) != (2 * SAMPLES, 2) or off > SINGLE:
        yield f"lerobot: {frames} frames of {episodes} episodes, differences of {off:g}"


def check_episodes(folder: Path) -> Iterator[str]:
    """Failures of Minari with episodes of two controllers, and of moviepy with a video of one."""
    arm = load("two_link")
    tuning = adaptctl.tune(arm)
    laws = {"expert": ComputedTorque(arm, 8.0), "learning": tuning.controller(ReducedModel(arm))}
    settings: dict[str, Any] = {"robot": arm, "reference": tuning.reference, "duration": 0.4}
    if find_spec("minari") is None:
        yield "minari is missing: .venv-data/bin/pip install 'minari[create]'"
    else:
        os.environ["MINARI_DATASETS_PATH"] = str(folder / "minari")
        import minari

        write_minari("adaptctl/two_link/mixed-v0", gymnasium.make("adaptctl/Tracking-v0", **settings), laws)
        returns = [one.rewards.sum() for one in minari.load_dataset("adaptctl/two_link/mixed-v0").iterate_episodes()]
        print(f"minari: returns of an expert and a learning episode {returns[0]:.3g} and {returns[1]:.3g}")
        if len(returns) != 2 or not 0.0 > returns[0] > returns[1]:
            yield f"minari: returns {returns}"
    if find_spec("moviepy") is None:
        yield "moviepy is missing: .venv-data/bin/pip install moviepy"
        return
    from moviepy import VideoFileClip

    env = gymnasium.make("adaptctl/Tracking-v0", render_mode="rgb_array", **settings)
    with closing(VideoRecorder(env, folder / "videos")) as recorder:
        rollout(recorder, laws["expert"], seed=0)
    with VideoFileClip(str(folder / "videos" / "episode-0.mp4")) as clip:
        print(f"moviepy: {clip.duration:.2f} s at {clip.fps:g} frames per second, {clip.size}")
        if abs(clip.duration - 11 / 25) > 0.05 or clip.size != [640, 480]:
            yield f"moviepy: {clip.duration} s of {clip.size}"


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        failures = list(check_queries(made_folder(Path(folder) / "runs")))
        failures += check_lerobot(made_folder(Path(folder) / "lerobot"))
        failures += check_episodes(made_folder(Path(folder) / "episodes"))
    print(*failures, sep="\n", end="\n" if failures else "")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
