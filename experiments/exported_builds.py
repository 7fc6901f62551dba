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
    """Outcome of building one exported control law and running its test program: `law`, the law's name; `scalar`, the
    kind of number ("double" or "float"); `compiler`, the compiler's name; `passed`, True if the program reproduced the
    torques recorded from Python within its tolerance; and `message`, what the program printed, or the compiler's error.
    Nothing is checked at construction."""

    law: str
    scalar: str
    compiler: str
    passed: bool
    message: str

    @property
    def difference(self) -> float | None:
        """Largest magnitude, over all joints and samples, of the differences of the build's torques from those recorded
        from Python, N m (N for a prismatic joint); None where the program's message states no such number, or NaN."""
        return self._told(1)

    @property
    def largest(self) -> float | None:
        """Largest magnitude among all joints and samples of the torques recorded from Python, N m (N for a prismatic
        joint); None where the program's message states no such number, or NaN."""
        return self._told(2)

    def _told(self, group: int) -> float | None:
        found = TOLD.search(self.message)
        value = float(found[group]) if found else math.nan
        return value if math.isfinite(value) else None


def found_compilers() -> dict[str, str]:
    """C compilers found on this computer, a mapping from their names, of those that the export check knows (cc, clang,
    tcc, zig cc), to the first line of each one's version text. Raises `subprocess.TimeoutExpired` for one that does not
    print its version within 300 s."""
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
    """Outcome, a `Build`, of compiling an exported package's own test program with `compiler` ("cc", "clang", "tcc" or
    "zig cc") in the package's folder and then running it. `done` is the exported package, an `Exported`; `law` and
    `scalar`, the law's name and the kind of number, are copied to the `Build`. A program that does not compile, or
    fails, gives a build that did not pass. Raises `KeyError` for another compiler, `FileNotFoundError` for cc, clang or
    tcc where it is not installed, `subprocess.TimeoutExpired` after 300 s."""
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
