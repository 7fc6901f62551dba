"""Results of long computations kept for other processes, beside the compiled objects."""

from __future__ import annotations

import functools
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from adaptctl.compilation.object_cache import ObjectCache, cache_folder
from adaptctl.files import hashed

MOST = 16
"""Results that one process keeps: those of its first searches, and not a hundred thousand of a sweep."""

_CHOOSING = ("OPENBLAS_", "MKL_", "OMP_NUM_THREADS", "ADAPTCTL_PROCESSOR")
"""Beginnings of the names of environment variables that choose between code paths."""

Result = TypeVar("Result")
_left = iter(range(MOST))


def kept(what: str, inputs: object, kind: type[Result], compute: Callable[[], Result]) -> Result:
    """The result of `compute()`, or what an earlier process kept of it, computed under the same name `what` from equal
    `inputs`, by equal source code of this library and on equal hardware and settings.

    `inputs`, in JSON's types, are all that the result depends on; `kind` is the result's type, made of numbers and
    text, which come back to the last bit. A process keeps at most 16 results. Nothing is kept where the cache is off
    (ADAPTCTL_CACHE is "off"), or where the library has no source files on disk. What `compute` raises goes through;
    `TypeError` is raised for inputs that JSON does not have.
    """
    folder, source = cache_folder(), source_state()
    if folder is None or not source:
        return compute()
    cache, key = ObjectCache(folder), bytes.fromhex(hashed([what, inputs, source, arithmetic()]))
    data = cache.get(key)
    if data is not None:
        with suppress(msgspec.DecodeError):
            return msgspec.json.decode(data, type=kind)
    result = compute()
    if next(_left, None) is not None:
        cache.put(key, msgspec.json.encode(result))
    return result


def arithmetic() -> list[str]:
    """Texts that name what decides the last bits of results, a list in this order: NumPy's version, its BLAS, the kind
    of machine, the number of processors that may be used, each instruction set that NumPy sees, and, as NAME=value,
    some environment variables. These are the ones whose names begin with OPENBLAS_, MKL_, OMP_NUM_THREADS or
    ADAPTCTL_PROCESSOR. Nothing is raised."""
    chosen = sorted(f"{name}={value}" for name, value in os.environ.items() if name.startswith(_CHOOSING))
    return [*_here(), *chosen]


@functools.cache
def _here() -> tuple[str, ...]:
    """The part of `arithmetic` that is the same for all of a process."""
    features = getattr(np._core._multiarray_umath, "__cpu_features__", {})  # type: ignore[attr-defined]  # not public
    able = sorted(name for name, has in features.items() if has)
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    return np.__version__, repr(blas), platform.machine(), str(len(cores)), *able


@functools.cache
def source_state() -> str:
    """SHA-256 hash (hexadecimal) of paths, sizes and times of change of the library's source files, which changes with
    them; empty where there are none, as where the library is in an archive. It is computed once in a process; nothing
    is raised."""
    found = sorted(source_files(str(Path(__file__).parent.parent)))
    return hashed(found) if found else ""


def source_files(folder: str) -> Iterator[tuple[str, int, int]]:
    """Iterator over the Python source files below `folder`, at any depth and in no fixed order: path, size in bytes and
    time of change in ns of each. What cannot be read is left out; nothing is raised."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(".py"):
                status = entry.stat()
                yield entry.path, status.st_size, status.st_mtime_ns
            elif entry.is_dir():
                yield from source_files(entry.path)
