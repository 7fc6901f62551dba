"""A sweep that is ended at any moment, and goes on: nothing is lost, and nothing is computed twice.

`AT_RANDOM=20 pytest tests/test_sweeps_ended.py` tries as many moments of each kind.
"""

from __future__ import annotations

import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pyarrow.parquet as pq
import pytest
from nightly import nightly

RUNS = 6
DURATION = "10"
"""s a run: on any machine some are left when a worker is found."""
TRIALS = int(os.environ.get("AT_RANDOM", "1"))
SWEEP = [
    *(sys.executable, "-m", "adaptctl", "sweep", "puma560-adaptive", "--duration", DURATION),
    *("--controllers", "adaptive", "--seed", f"0..{RUNS - 1}", "--shard-size", "1", "--jobs", "2"),
]


def started(out: Path) -> subprocess.Popen[str]:
    """The sweep and its workers, to be ended together."""
    given = [*SWEEP, "--out", str(out)]
    return subprocess.Popen(given, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


def written(out: Path) -> dict[str, int]:
    """When each shard was written, in ns."""
    return {path.name: path.stat().st_mtime_ns for path in (out / "shards").glob("[!.]*.parquet")}


def until(out: Path, shards: int, sweep: subprocess.Popen[str]) -> None:
    """Wait for so many shards, or for the end."""
    while len(written(out)) < shards and sweep.poll() is None:
        time.sleep(0.01)


def validate_whole(out: Path) -> None:
    """Every run once, in order."""
    assert pq.read_table(out / "sweep.parquet").column("seed").to_pylist() == list(range(RUNS))
    assert len(written(out)) == RUNS
    assert not list(out.rglob(".*"))


def validate_resumed(out: Path) -> None:
    """The same command goes on, and what was there stays as it is."""
    before = written(out)
    subprocess.run([*SWEEP, "--out", str(out)], check=True, capture_output=True)
    validate_whole(out)
    assert {name: moment for name, moment in written(out).items() if name in before} == before


@pytest.fixture(params=range(TRIALS))
def trial(request: pytest.FixtureRequest) -> random.Random:
    """Numbers to draw moments from."""
    return random.Random(int(request.param))


def test_the_whole_sweep_is_killed(tmp_path: Path, trial: random.Random) -> None:
    sweep = started(tmp_path / "out")
    until(tmp_path / "out", trial.randrange(RUNS), sweep)
    time.sleep(trial.uniform(0.0, 0.1))
    os.killpg(sweep.pid, signal.SIGKILL)
    sweep.communicate()
    validate_resumed(tmp_path / "out")


@nightly
def test_a_worker_is_killed(tmp_path: Path, trial: random.Random) -> None:
    """Another takes its place, and the sweep ends as if nothing had been."""
    sweep = started(tmp_path / "out")
    until(tmp_path / "out", trial.randrange(1, RUNS - 3), sweep)
    workers = [
        one for one in psutil.Process(sweep.pid).children(recursive=True) if "spawn_main" in " ".join(one.cmdline())
    ]
    trial.choice(workers).kill()
    said = sweep.communicate(timeout=300)
    assert sweep.returncode == 0, said
    validate_whole(tmp_path / "out")


@nightly
def test_the_disk_is_full(tmp_path: Path, trial: random.Random) -> None:
    """No file may grow beyond some size: the sweep says so in a line, and goes on when there is room."""
    room = int(10.0 ** trial.uniform(2.0, 3.9))
    done = subprocess.run(
        [*SWEEP, "--out", str(tmp_path / "out")],
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
    )
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert "cannot be written" in done.stderr
    validate_resumed(tmp_path / "out")
