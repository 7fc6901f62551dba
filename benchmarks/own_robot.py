"""Time from a robot's file to a verdict, and of the demo, of what nothing is cached of, over that of a loop."""

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
RUNS = 2
LOOP = "over 20 million additions in Python"


def measure(effort: Effort) -> Iterator[Finding]:
    """Processor time of whole commands, in times of 20 million additions beside each."""
    commands = {
        "own URDF to verdict, UR10": (("adaptive", "--robot", _urdf("ur10_robot.urdf")), 2.6),
        "own URDF to verdict, Panda": (("adaptive", "--robot", _urdf("panda.urdf")), 2.6),
        "demo": (("puma560-adaptive",), 4.0),
    }
    with tempfile.TemporaryDirectory() as bytecode:
        _seconds(("adaptive", "--robot", "puma560_measured", "--duration", "0.1"), bytecode)
        for what, (words, asked) in commands.items():
            ratios = [_seconds(words, bytecode) / _additions() for _ in range(min(effort.rounds, RUNS))]
            yield Measurement(f"{what}, {LOOP}", Spread.of(np.array(ratios)), "", asked)


def _seconds(words: tuple[str, ...], bytecode: str) -> float:
    """Processor seconds of an experiment, its report and recording included, in an empty cache, but with bytecode."""
    with tempfile.TemporaryDirectory() as folder:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        caches = {"ADAPTCTL_CACHE": folder, "MPLCONFIGDIR": folder, "PYTHONPYCACHEPREFIX": bytecode}
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        command = [sys.executable, "-m", "adaptctl", "experiment", "run", *words, "--out", str(Path(folder) / "run")]
        done = subprocess.run(command, env=environment | caches, check=False, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 3):
        raise RuntimeError(f"{' '.join(words)}: {done.stderr.decode()}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _additions() -> float:
    """Processor seconds of the additions, as a script does them, whose names are global."""
    begin = time.process_time()
    exec(f"total = 0\nfor _ in range({ADDITIONS}):\n    total += 1", {})
    return time.process_time() - begin


def _urdf(name: str) -> str:
    for file in files("example-robot-data") or ():
        if file.name == name:
            return str(file.locate())
    raise MissingExtraError(f"own_robot: {name} of the package example-robot-data is not installed")
