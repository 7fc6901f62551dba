"""The C compiler that tests build with: there is always one, since ziglang comes with what they need."""

from __future__ import annotations

import shutil
import subprocess
from functools import cache
from pathlib import Path

from export_builds import GNU, STRICT, UNFUSED, ZIG


@cache
def compiler() -> tuple[str, ...]:
    """gcc or the system's own compiler, with flags under which numbers are Python's to the last bit; else zig's."""
    if gcc := shutil.which("gcc"):
        return gcc, *STRICT, *GNU
    if other := shutil.which("cc"):
        return other, *STRICT, *UNFUSED
    return *ZIG, *STRICT, *UNFUSED


def build(folder: Path, *arguments: str, flags: tuple[str, ...] = ("-O1",)) -> Path:
    """The program that is made of sources in a folder; without warnings, as of what is exported."""
    out = folder / "program"
    subprocess.run([*compiler(), *flags, *arguments, "-lm", "-o", str(out)], cwd=folder, check=True)
    return out


def said(program: Path) -> str:
    """What a program prints, whether or not it fails."""
    return subprocess.run([str(program)], capture_output=True, text=True, check=False).stdout
