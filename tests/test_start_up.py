"""From a fresh process to the first adaptive tick: nothing is imported or compiled that it does not need."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from cyclopts import App

from adaptctl.cli.main import main

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"

PROGRAM = """
import json, sys
from start_up import stages
named = list(stages())
print(json.dumps([named, sorted(sys.modules)]))
"""
HEAVY = {"scipy", "control", "pinocchio", "matplotlib", "rerun", "pyarrow", "gymnasium", "cvxpy", "mujoco"}
UNUSED = {
    "adaptctl.control.adaptation.composite",
    "adaptctl.control.safety_filter",
    "adaptctl.control.task_space",
    "adaptctl.dynamics.loop_equations",
    "adaptctl.identifiability.consistency",
    "adaptctl.description.readers.mjcf",
    "adaptctl.description.readers.urdf",
    "adaptctl.compilation.loops",
    "adaptctl.compilation.recorded_loops",
    "adaptctl.simulation",
    "numpy.ma",
    "xml",
}
"""Other laws, what only loops need, readers of other files."""
RESULTS = ("certificate", "fundamental basis", "whether it keeps energies", "sampling ratio")
"""Results that are kept beside the tick's object."""
SEARCHING = {
    "adaptctl.description.loops",
    "adaptctl.identifiability.certification",
    "adaptctl.identifiability.proof.exact_energies",
    "adaptctl.identifiability.sampling",
    "numpy.random",
    "threadpoolctl",
}
"""Modules that only finding them needs."""


def first_tick(cache: Path) -> tuple[list[str], set[str]]:
    """The stages of a fresh process, and what it imports."""
    environment = os.environ | {"ADAPTCTL_CACHE": str(cache)}
    command = [sys.executable, "-W", "ignore", "-c", PROGRAM]
    process = subprocess.run(command, cwd=BENCHMARKS, env=environment, capture_output=True, text=True, timeout=60)
    assert process.returncode == 0, process.stderr
    stages, modules = json.loads(process.stdout)
    return stages, set(modules)


def test_the_first_tick_needs_one_kernel_and_no_heavy_package(tmp_path: Path) -> None:
    stages, modules = first_tick(tmp_path / "cache")
    assert stages[-1] == "first tick"
    assert not (HEAVY | UNUSED) & modules
    kept = {path: path.stat() for path in (tmp_path / "cache").iterdir()}
    assert len(kept) == 1 + len(RESULTS)
    assert sum(b"ELF" in path.read_bytes() or b"__text" in path.read_bytes() for path in kept) == 1
    _, modules = first_tick(tmp_path / "cache")
    after = {path: path.stat() for path in (tmp_path / "cache").iterdir()}
    assert kept.keys() == after.keys()
    for path, before in kept.items():
        assert after[path].st_ino == before.st_ino  # not written anew
        assert after[path].st_mtime_ns > before.st_mtime_ns  # but read
    assert not SEARCHING & modules


HELPED = ("basis", "design", "doctor", "excite", "experiment", "export", "gains", "identify", "sweep", "tune")
COMMANDS = """
import sys
from adaptctl.cli.main import main
for line in sys.argv[1:]:
    main(line.split())
    print(*sorted(sys.modules), file=sys.stderr)
"""


def imported_after(*lines: str) -> list[set[str]]:
    """What one process has imported after each of its command lines."""
    command = [sys.executable, "-W", "ignore", "-c", COMMANDS, *lines]
    process = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert process.returncode == 0, process.stderr
    return [set(line.split()) for line in process.stderr.splitlines()]


def test_help_needs_no_array() -> None:
    for command, modules in zip(HELPED, imported_after(*(f"{name} --help" for name in HELPED)), strict=True):
        assert not {"numpy", "llvmlite", "msgspec", *HEAVY} & modules, command


def test_flags_are_read_once_for_help(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Both for the line on usage and for the panels."""
    read, commands = App.assemble_argument_collection, list[App]()

    def counted(command: App, **how: Any) -> Any:
        commands.append(command)
        return read(command, **how)

    monkeypatch.setattr(App, "assemble_argument_collection", counted)
    assert main(["identify", "--help"]) == 0
    assert len(commands) == 1
    assert App.assemble_argument_collection is counted
    said = capsys.readouterr().out
    assert "Usage: adaptctl identify [OPTIONS]" in said
    assert "--payload-mass" in said


def test_base_parameters_need_no_compiler_and_no_second_certificate() -> None:
    imported_after("basis two_link")
    [modules] = imported_after("basis two_link")
    assert not {"llvmlite", "adaptctl.identifiability.energy_matrix", *SEARCHING, *HEAVY} & modules
