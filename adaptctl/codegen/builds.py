"""Builds of exported C by the compilers that are here, each run on the ticks recorded from Python."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from adaptctl.codegen.exporting import Exported

COMPILERS = {
    "cc": ("cc",),
    "clang": ("clang",),
    "tcc": ("tcc",),
    "zig cc": (sys.executable, "-m", "ziglang", "cc"),
}
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
PATIENCE = 300.0
"""s for a compiler, or for what it made"""
TOLD = re.compile(r"torques within (\S+) of (\S+) N m")


class Build(NamedTuple):
    """Outcome of building an exported controller by a `compiler` and running its test program: `passed`, True where it
    repeats the torques recorded from Python; `message`, text of the program, or of the compiler's error; `difference`
    and `largest`, the greatest magnitude of its torques' differences from Python's and of Python's torques, N m (N if
    prismatic), None where the message states no such number."""

    compiler: str
    passed: bool
    message: str
    difference: float | None
    largest: float | None


def found_compilers() -> dict[str, str]:
    """C compilers found on this computer, of cc, clang, tcc and zig cc: the first line of each one's version text by
    its name. Raises `subprocess.TimeoutExpired` for one that does not print it within 300 s."""
    found: dict[str, str] = {}
    for name, command in COMPILERS.items():
        if shutil.which(command[0]) is not None:
            done = _run([*command, "-v" if name == "tcc" else "--version"], Path.cwd())
            lines = (done.stdout + done.stderr).strip().splitlines()
            found |= {name: lines[0]} if done.returncode == 0 and lines else {}
    return found


def builds(done: Exported) -> tuple[Build, ...]:
    """Builds of an exported controller by each of the compilers that are here, none where there are none, in a folder
    that is removed again. Raises `subprocess.TimeoutExpired` after 300 s."""
    return tuple(_built(done, compiler) for compiler in found_compilers())


def _built(done: Exported, compiler: str) -> Build:
    flags = FLAGS if compiler != "tcc" else FLAGS[:1]
    sources = [f"{done.name}.c", f"test_{done.name}.c"]
    with tempfile.TemporaryDirectory() as folder:
        program = str(Path(folder) / "test")
        made = _run([*COMPILERS[compiler], *flags, *sources, "-lm", "-o", program], done.directory)
        if made.returncode != 0:
            return Build(compiler, False, f"does not compile: {made.stderr.strip()[:200]}", None, None)
        ran = _run([program], done.directory)
    message = " ".join(ran.stdout.split())[:200]
    told = TOLD.search(message)
    numbers = [float(told[group]) if told else math.nan for group in (1, 2)]
    return Build(compiler, ran.returncode == 0, message, *(x if math.isfinite(x) else None for x in numbers))


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=PATIENCE)
