"""Builds and tests of exported C."""

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
from adaptctl.stages import stage

COMPILERS = {
    "cc": ("cc",),
    "clang": ("clang",),
    "tcc": ("tcc",),
    "zig cc": (sys.executable, "-m", "ziglang", "cc"),
}
FLAGS = ("-std=c99", "-O1", "-ffp-contract=off")
"""-O2 would schedule and vectorise the one long function for six times as long, for the same numbers"""
TIMEOUT = 300.0
"""s; the default law of a seven-joint arm takes 12 to 20"""
TORQUE_MESSAGE = re.compile(r"torques within (\S+) of (\S+) N m")


class Build(NamedTuple):
    """Outcome of a compiler's build and its test."""

    compiler: str
    passed: bool
    message: str
    difference: float | None
    largest: float | None


def found_compilers() -> dict[str, str]:
    """C compilers found and their versions."""
    found: dict[str, str] = {}
    for name, command in COMPILERS.items():
        if shutil.which(command[0]) is not None:
            done = _run([*command, "-v" if name == "tcc" else "--version"], Path.cwd())
            lines = (done.stdout + done.stderr).strip().splitlines()
            found |= {name: lines[0]} if done.returncode == 0 and lines else {}
    return found


def builds(done: Exported) -> tuple[Build, ...]:
    """Builds by each compiler found, in a temporary folder."""
    return tuple(_built(done, compiler) for compiler in found_compilers())


def _built(done: Exported, compiler: str) -> Build:
    flags = FLAGS if compiler != "tcc" else FLAGS[:1]
    sources = [f"{done.name}.c", f"test_{done.name}.c"]
    with stage(f"compiling with {compiler}"), tempfile.TemporaryDirectory() as folder:
        program = str(Path(folder) / "test")
        try:
            made = _run([*COMPILERS[compiler], *flags, *sources, "-lm", "-o", program], done.directory)
            if made.returncode != 0:
                return Build(compiler, False, f"does not compile: {made.stderr.strip()[:200]}", None, None)
            ran = _run([program], done.directory)
        except subprocess.TimeoutExpired:
            return Build(compiler, False, f"no result within {TIMEOUT:g} s", None, None)
    message = " ".join(ran.stdout.split())[:200]
    told = TORQUE_MESSAGE.search(message)
    numbers = [float(told[group]) if told else math.nan for group in (1, 2)]
    return Build(compiler, ran.returncode == 0, message, *(x if math.isfinite(x) else None for x in numbers))


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=TIMEOUT)
