"""Programs and libraries made of exported C by the compilers that are here, and what is known of them."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HARNESS = Path(__file__).parent / "export_harness"
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wdouble-promotion", "-Werror")
UNFUSED = ("-ffp-contract=off",)
GNU = (*UNFUSED, "-fno-tree-slp-vectorize")
ZIG = (sys.executable, "-m", "ziglang", "cc")


@dataclass(frozen=True)
class Toolchain:
    """A compiler with its flags, and what runs what it makes."""

    name: str
    command: tuple[str, ...]
    flags: tuple[str, ...]
    runner: tuple[str, ...] = ()

    @property
    def missing(self) -> str:
        """The first tool that is not here; nothing if all are."""
        for tool in (self.command[0], *self.runner[:1]):
            if shutil.which(tool) is None:
                return tool
        if self.command == ZIG:
            asked = subprocess.run([*ZIG[:3], "version"], capture_output=True, check=False)
            return "" if asked.returncode == 0 else "ziglang"
        return ""


GCC = Toolchain("gcc -O2", ("gcc",), ("-O2", *STRICT, *GNU))
STATIC = ("-static",)
TOOLCHAINS = (
    GCC,
    Toolchain("clang -O2", ("clang",), ("-O2", *STRICT, *UNFUSED)),
    Toolchain("tcc", ("tcc",), ("-std=c99", "-Wall", "-Werror")),
    Toolchain("zig cc -O2", ZIG, ("-O2", *STRICT, *UNFUSED)),
    Toolchain("aarch64 gcc -O2", ("aarch64-linux-gnu-gcc",), ("-O2", *STRICT, *GNU, *STATIC), ("qemu-aarch64",)),
    Toolchain("riscv64 gcc -O2", ("riscv64-linux-gnu-gcc",), ("-O2", *STRICT, *GNU, *STATIC), ("qemu-riscv64",)),
)

CARELESS = {
    "gcc": ("-ffast-math", "-Ofast", "-ffinite-math-only", "-funsafe-math-optimizations", "-freciprocal-math",
            "-fno-signed-zeros", "-mfpmath=387"),
    "clang": ("-ffast-math", "-Ofast", "-ffinite-math-only"),
}  # fmt: skip
"""By compiler, flags that are no IEEE arithmetic, and that the code refuses to be built with."""


def run(command: Sequence[str], data: bytes | None = None) -> bytes:
    """What a command says. Ends the process where it fails."""
    done = subprocess.run(command, input=data, capture_output=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)}\n{done.stdout.decode(errors='replace')}{done.stderr.decode()}")
    return done.stdout


@dataclass(frozen=True)
class Package:
    """An exported package in its folder, and the number of its joints; what is built of it is put beside it."""

    folder: Path
    name: str
    joints: int

    def compiled(self, tool: Toolchain) -> Path:
        """The law as an object, made once by each compiler."""
        out = self._place(tool, ".o")
        if not out.exists():
            more = ("-fstack-usage",) if tool == GCC else ()
            run([*tool.command, *tool.flags, *more, "-c", str(self.folder / f"{self.name}.c"), "-o", str(out)])
        return out

    def replay(self, tool: Toolchain) -> Path:
        """A program that repeats ticks from its standard input."""
        return self._program(tool, "replay", HARNESS / "replay.c", *self.told)

    def tests(self, tool: Toolchain) -> Path:
        """The package's own test."""
        return self._program(tool, "test", self.folder / f"test_{self.name}.c")

    def library(self, tool: Toolchain) -> Any:
        """The harness as a library in this process."""
        out, sources = self._place(tool, ".so"), [str(self.folder / f"{self.name}.c"), str(HARNESS / "replay.c")]
        run([*tool.command, *tool.flags, "-shared", "-fPIC", "-DLIBRARY", *self.told, *sources, "-lm", "-o", str(out)])
        return ctypes.CDLL(str(out))

    @property
    def told(self) -> tuple[str, ...]:
        """What the harness is told."""
        return f"-DNAME={self.name}", f'-DHEADER="{self.name}.h"', f"-DJOINTS={self.joints}", f"-I{self.folder}"

    def stack(self) -> int:
        """Bytes of the frames of a step, its law, and the largest other function of the law, by gcc."""
        usage = [line.split("\t") for line in self.compiled(GCC).with_suffix(".su").read_text().splitlines()]
        frames = {row[0].rsplit(":", 1)[1]: int(row[1]) for row in usage}
        outer = sum(frames.get(f"{self.name}_{part}", 0) for part in ("step", "law"))
        inner = (size for part, size in frames.items() if re.match(rf"{self.name}_(law_\d+|\w+_\d+|sincos)", part))
        return outer + max(inner, default=0)

    def accepted(self) -> Iterator[str]:
        """Careless flags, with their compilers, that the code is built with all the same, or not refused in words."""
        source = str(self.folder / f"{self.name}.c")
        for compiler in filter(shutil.which, CARELESS):
            for flag in CARELESS[compiler]:
                command = [compiler, "-std=c99", "-O2", flag, "-c", source, "-o", str(self.folder / "careless.o")]
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                if done.returncode == 0 or f"{self.name}: n" not in done.stderr or "#error" not in done.stderr:
                    yield f"{compiler} {flag}"

    def _program(self, tool: Toolchain, what: str, source: Path, *more: str) -> Path:
        out, law = self._place(tool, f"_{what}"), str(self.compiled(tool))
        run([*tool.command, *tool.flags, *more, str(source), law, "-lm", "-o", str(out)])
        return out

    def _place(self, tool: Toolchain, end: str) -> Path:
        return self.folder / f"{re.sub(r'[^a-z0-9]', '_', tool.name)}{end}"


def sections(object_file: Path, tool: str = "size") -> dict[str, int]:
    """Bytes of text, data and bss."""
    head, row = run([tool, str(object_file)]).decode().splitlines()[:2]
    return {name: int(value) for name, value in zip(head.split()[:3], row.split()[:3], strict=True)}
