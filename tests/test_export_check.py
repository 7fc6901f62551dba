"""`adaptctl export --check` builds the C that it writes, and says which builds repeat Python's ticks."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from adaptctl.cli.export import _lasting
from adaptctl.cli.main import main
from adaptctl.codegen import builds
from adaptctl.codegen.builds import COMPILERS, Build, found_compilers
from adaptctl.codegen.exporting import Exported

LINE = ("export", "two_link", "--law", "computed-torque", "--check", "--anyway")


def test_compilers_are_those_on_the_path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert set(found_compilers()) <= {"zig cc"}
    (tmp_path / "tcc").write_text('#!/bin/sh\n[ "$1" = -v ] && echo tcc version 1\n')
    (tmp_path / "tcc").chmod(0o755)
    (tmp_path / "clang").write_text("#!/bin/sh\necho broken; exit 1\n")
    (tmp_path / "clang").chmod(0o755)
    (tmp_path / "cc").write_text('#!/bin/sh\n[ "$1" = --version ] && echo cc 1\n')
    (tmp_path / "cc").chmod(0o755)
    found = found_compilers()
    assert found == {"tcc": "tcc version 1", "cc": "cc 1"} | {k: v for k, v in found.items() if k == "zig cc"}


def compiler(folder: Path, program: str) -> str:
    """A compiler that makes a program of its own: a script."""
    made = folder / "cc"
    made.write_text(
        f'#!/bin/sh\nfor last; do :; done\nprintf \'#!/bin/sh\\n{program}\\n\' > "$last"\nchmod +x "$last"\n'
    )
    made.chmod(0o755)
    return str(made)


def test_builds_are_told_and_what_differs_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    right = compiler(tmp_path, "echo passed: torques within 2.84e-14 of 151 N m")
    monkeypatch.setattr(builds, "COMPILERS", {"cc": (right,)})
    monkeypatch.setattr(builds, "found_compilers", lambda: {"cc": "cc 1"})
    assert main([*LINE, "--json", "--out", str(tmp_path / "one")]) == 0
    (told,) = json.loads(capsys.readouterr().out)["builds"]
    assert told == Build("cc", True, "passed: torques within 2.84e-14 of 151 N m", 2.84e-14, 151.0)._asdict()
    assert not [path for path in (tmp_path / "one").iterdir() if path.name.startswith("test_cc")]
    compiler(tmp_path, "echo FAILED: torques within nan of 9 N m; exit 1")
    assert main([*LINE, "--out", str(tmp_path / "two")]) == 3
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "note:" not in line]
    assert line.endswith("two: the compiled code fails its test: cc: FAILED: torques within nan of 9 N m")
    (tmp_path / "cc").write_text("#!/bin/sh\necho no such flag >&2; exit 1\n")
    assert main([*LINE, "--out", str(tmp_path / "three")]) == 3
    assert "does not compile: no such flag" in capsys.readouterr().err


@pytest.mark.parametrize("slow", ["cc", "program"])
def test_a_build_that_does_not_end_is_a_failure(slow: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    made = compiler(tmp_path, "sleep 20")
    if slow == "cc":
        (tmp_path / "cc").write_text("#!/bin/sh\nexec sleep 20\n")
    monkeypatch.setattr(builds, "COMPILERS", {"cc": (made,)})
    monkeypatch.setattr(builds, "found_compilers", lambda: {"cc": "cc 1"})
    monkeypatch.setattr(builds, "TIMEOUT", 0.2)
    (build,) = builds.builds(Exported(tmp_path, "arm", (), {}))
    assert build == Build("cc", False, "no result within 0.2 s", None, None)


def test_without_a_compiler_it_says_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(builds, "found_compilers", dict[str, Any])
    assert main([*LINE, "--out", str(tmp_path / "none")]) == 0
    told = capsys.readouterr()
    assert f"not built: found none of these compilers: {', '.join(COMPILERS)}" in told.out
    assert re.search(r"initial RMS error \S+ mrad, final \S+ mrad$", told.out, re.MULTILINE)
    assert "up to 5 s" in told.err, "before it is waited for"


@pytest.mark.parametrize(("parameters", "told"), [(5, "5 s"), (20, "10 s"), (36, "30 s"), (97, "4 minutes")])
def test_a_check_takes_a_fortieth_of_a_second_a_square(parameters: int, told: str) -> None:
    assert _lasting(parameters) == told
