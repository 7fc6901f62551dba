"""Time from a robot's file to a verdict of an arm nothing is cached of, over that of a loop."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import files
from pathlib import Path

import numpy as np

from adaptctl.errors import MissingExtraError
from benchmarks.findings import Finding, Measurement
from benchmarks.interleaved import Effort, Spread

ADDITIONS = 20_000_000
RUNS = 3


def measure(effort: Effort) -> Iterator[Finding]:
    """Processor time of `experiment run adaptive` on a UR10, in times of 20 million additions beside it."""
    ratios = [_verdict() / _additions() for _ in range(min(effort.rounds, RUNS))]
    yield Measurement("own URDF to verdict, over 20 million additions in Python", Spread.of(np.array(ratios)), "", 5.0)


def _verdict() -> float:
    """Processor seconds of the whole command, its report and recording included, in an empty cache."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "adaptctl", "experiment", "run", "adaptive", "--robot", str(_urdf())]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        cache = {"XDG_CACHE_HOME": folder, "MPLCONFIGDIR": folder}
        subprocess.run(
            [*command, "--out", str(Path(folder) / "run")], env=os.environ | cache, check=True, capture_output=True
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _additions() -> float:
    """Processor seconds of the additions, as a script does them, whose names are global."""
    begin = time.process_time()
    exec(f"total = 0\nfor _ in range({ADDITIONS}):\n    total += 1", {})
    return time.process_time() - begin


def _urdf() -> Path:
    for file in files("example-robot-data") or ():
        if file.name == "ur10_robot.urdf":
            return Path(str(file.locate()))
    raise MissingExtraError("own_robot: ur10_robot.urdf of the package example-robot-data is not installed")
