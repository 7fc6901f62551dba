"""Builds of exported laws by the compilers that are here, each run on ticks recorded from Python."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

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


@dataclass(frozen=True)
class Build:
    """A build of an exported law by one compiler, with one kind of number: whether it repeated the recorded ticks, and
    its message."""

    law: str
    scalar: str
    compiler: str
    passed: bool
    message: str

    @property
    def difference(self) -> float | None:
        """Largest difference of its torques from the recorded ones, N m or N; None where it told of none, or of NaN."""
        return self._told(1)

    @property
    def largest(self) -> float | None:
        """Largest of the recorded torques, N m or N; None where it told of none, or of NaN."""
        return self._told(2)

    def _told(self, group: int) -> float | None:
        found = TOLD.search(self.message)
        value = float(found[group]) if found else math.nan
        return value if math.isfinite(value) else None


def found_compilers() -> dict[str, str]:
    """Compilers that are installed: their versions by name."""
    told = {name: _version(command) for name, command in COMPILERS.items()}
    return {name: version for name, version in told.items() if version}


def _version(command: tuple[str, ...]) -> str:
    """First line that a compiler tells of itself; empty where it does not run."""
    if shutil.which(command[0]) is None:
        return ""
    flag = "-v" if command[0] == "tcc" else "--version"
    done = subprocess.run([*command, flag], capture_output=True, text=True, check=False, timeout=PATIENCE)
    lines = (done.stdout + done.stderr).strip().splitlines()
    return lines[0] if done.returncode == 0 and lines else ""


def built(done: Exported, law: str, scalar: str, compiler: str) -> Build:
    """The build of a package's own test by a compiler, run."""
    sources = [f"{done.name}.c", f"test_{done.name}.c"]
    program = done.directory / f"test_{compiler.replace(' ', '_')}"
    flags = FLAGS if compiler != "tcc" else FLAGS[:1]
    made = _run([*COMPILERS[compiler], *flags, *sources, "-lm", "-o", str(program)], done.directory)
    if made.returncode != 0:
        return Build(law, scalar, compiler, False, f"does not compile: {made.stderr.strip()[:200]}")
    ran = _run([str(program)], done.directory)
    return Build(law, scalar, compiler, ran.returncode == 0, " ".join(ran.stdout.split())[:200])


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=PATIENCE)
