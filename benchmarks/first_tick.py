"""Time of a fresh process to the first compiled tick: with nothing cached, and with what the last process left."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.findings import Finding, Measurement
from benchmarks.interleaved import Effort, Spread
from benchmarks.start_up import fresh

PROCESSES = 11


def measure(effort: Effort) -> Iterator[Finding]:
    """The whole, in the processor's time; `python benchmarks/start_up.py` tells the stages."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        fresh(place / "first", place / "bytecode")
        caches = [place / str(k) for k in range(min(effort.rounds, PROCESSES))]
        taken = [[fresh(cache, place / "bytecode")["together"][1] for _ in range(2)] for cache in caches]
        imports = np.array([_imports(place / "bytecode") for _ in (place, *caches)][1:])
    cold, cached = np.array(taken).T
    what = "fresh process to the first compiled tick of the PUMA"
    yield Measurement(f"{what}, nothing cached", Spread.of(cold), "s", 0.5)
    yield Measurement(f"{what}, cached", Spread.of(cached), "s", 0.15)
    yield Measurement(f"{what}, cached, over its imports", Spread.of(cached / imports), "", 1.6)


def _imports(bytecode: Path) -> float:
    """Processor seconds of a fresh process that imports NumPy and LLVM alone, whose bytecode it finds too."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", "import numpy, llvmlite.binding"]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONPYCACHEPREFIX": str(bytecode)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    subprocess.run(command, env=environment, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
