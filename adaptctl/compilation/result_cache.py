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
    """The result of a computation, or what an earlier process computed from equal inputs by equal code and arithmetic.

    `inputs`, in JSON's types, are all that the result depends on; `kind` is its type, of numbers and text alone, which
    come back to the last bit. Errors are not kept. Nothing is kept where the cache is off.
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
    """The arithmetic that decides last bits: NumPy and its BLAS, the processor, settings that choose its code."""
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
    """A hash of the sizes and times of change of the library's source files, by which Python trusts its bytecode too;
    empty where the library is in an archive."""
    found = sorted(source_files(str(Path(__file__).parent.parent)))
    return hashed(found) if found else ""


def source_files(folder: str) -> Iterator[tuple[str, int, int]]:
    """Path, size and time of change (ns) of every source file below a folder."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(".py"):
                status = entry.stat()
                yield entry.path, status.st_size, status.st_mtime_ns
            elif entry.is_dir():
                yield from source_files(entry.path)
