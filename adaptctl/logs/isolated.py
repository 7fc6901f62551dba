"""Readers of binary formats in a process of their own, bounded in memory and time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from adaptctl import errors
from adaptctl.errors import AdaptctlError, FileError
from adaptctl.logs.on_disk import columns_of_file
from adaptctl.logs.table import LogTable

MEMORY, TIME = 2**30, 10.0
"""bytes and processor s for a small file"""
WAITING = 20.0
"""s that a busy machine may take besides, for three times the processor's"""
MEMORY_PER_BYTE, BYTES_PER_SECOND = 30.0, 4e6
"""more of both for the bytes of large ones"""
HEAD, CELLS, EMPTY = "head.json", "cells.f8", "empty.b1"
"""names of what the process writes"""


def read_isolated(reader: str, path: str | Path, *options: str) -> LogTable:
    """Table that `module:function` of this folder reads from a file or folder, in a bounded process."""
    size = _size(Path(path))
    memory, time = int(MEMORY + MEMORY_PER_BYTE * size), TIME + size / BYTES_PER_SECOND
    with TemporaryDirectory() as folder:
        told = _run([reader, str(path), folder, str(memory), str(time), *options], path, time)
        head = _head(Path(folder), path, told, memory)
        if "error" in head:
            raise _error(head)
        return _table(Path(folder), head)


def _size(path: Path) -> int:
    files = [path] if path.is_file() else [one for one in path.rglob("*") if one.is_file()]
    return sum(one.stat().st_size for one in files)


def _run(arguments: list[str], path: str | Path, time: float) -> int:
    """Code with which the process ended; `FileError` where it took too long."""
    few = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "ARROW_DEFAULT_MEMORY_POOL": "system"}
    home = str(Path(errors.__file__).parent.parent)
    paths = os.pathsep.join([home, *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-P", "-m", "adaptctl.logs.child", *arguments]
    try:
        done = subprocess.run(
            command,
            env=os.environ | few | {"PYTHONPATH": paths, "PYTHONWARNINGS": "ignore"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=3.0 * time + WAITING,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise FileError(f"{path}: was not read within {3.0 * time + WAITING:.0f} s; is it damaged?") from error
    return done.returncode


def _head(folder: Path, path: str | Path, code: int, memory: int) -> dict[str, object]:
    try:
        return dict(json.loads((folder / HEAD).read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        raise FileError(
            f"{path}: cannot be read within {memory / 2**30:.2g} GB and the time that a file of its size needs "
            f"(the reader ended with {code}); it is damaged, or not what its name says"
        ) from error


def _error(head: dict[str, object]) -> AdaptctlError:
    kind = getattr(errors, str(head["error"]), FileError)
    known = isinstance(kind, type) and issubclass(kind, AdaptctlError)
    found: AdaptctlError = (kind if known else FileError)(head["message"])
    return found


def _table(folder: Path, head: dict[str, object]) -> LogTable:
    names: list[str] = list(head["names"])  # type: ignore[call-overload]
    rows = int(head["rows"])  # type: ignore[call-overload]
    cells = columns_of_file(folder / CELLS, (len(names), rows))
    masked: list[str] = list(head["empty"])  # type: ignore[call-overload]
    masks = np.fromfile(folder / EMPTY, dtype=np.bool_).reshape(len(masked), rows)
    return LogTable(
        str(head["source"]),
        dict(zip(names, cells, strict=True)),
        dict(head["units"]),  # type: ignore[call-overload]
        dict(zip(masked, masks, strict=True)),
        dict(head["words"]),  # type: ignore[call-overload]
        bool(head["numbered"]),
        tuple(head["notes"]),  # type: ignore[arg-type]
        dict(head["begin"]),  # type: ignore[call-overload]
    )
