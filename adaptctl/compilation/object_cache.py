"""Disk cache of compiled objects."""

from __future__ import annotations

import functools
import hashlib
import os
import platform
import stat
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, TypeVar

import msgspec
import numpy as np

from adaptctl.files import hashed, reason

MAX_CACHE_BYTES = 256 * 2**20
"""Largest size in bytes, plus a 64th per writing process; the oldest objects are deleted."""

TRIAL_BYTES = 2**18
"""size of a large object, for which there should be room"""

SUFFIX = ".object"

_MAGIC = b"adaptctl object 1\n"
_HEAD = len(_MAGIC) + 64

_written: dict[Path, int] = {}
"""Bytes written to a folder since its size was last checked."""


def _log(message: str, *about: object) -> None:
    import logging  # here, since most processes have nothing to tell

    logging.getLogger(__name__).info(message, *about)


def cache_folder() -> Path | None:
    """Folder for compiled objects, which need not exist."""
    chosen, caches = os.environ.get("ADAPTCTL_CACHE", ""), Path(os.environ.get("XDG_CACHE_HOME", ""))
    if chosen == "off":
        return None
    try:
        if chosen:
            return Path(chosen).expanduser()
        return (caches if caches.is_absolute() else Path.home() / ".cache") / "adaptctl"
    except RuntimeError as error:
        _log("compiled objects are not cached: %s", error)
        return None


class ObjectCache(NamedTuple):
    """Compiled objects on disk, one file for each key of 32 bytes."""

    folder: Path
    limit: int = MAX_CACHE_BYTES

    def get(self, key: bytes) -> bytes | None:
        """Bytes of a key; None if missing, damaged or another user's."""
        try:
            _validate_own(self.folder.stat())
            content = _read(self._path(key))
        except OSError as error:
            _log("recompiling: %s", error)
            return None
        data = content[_HEAD:]
        if content[:_HEAD] != _head(key, data):
            _log("recompiling: %s is damaged", self._path(key))
            return None
        return data

    def put(self, key: bytes, data: bytes) -> None:
        """Store bytes under a key; delete the least recently used when full."""
        try:
            self._store(key, data)
            if self._may_be_full(_HEAD + len(data)):
                self._shrink()
        except OSError as error:
            _log("not cached: %s", error)

    def fault(self) -> str | None:
        """Reason why nothing can be stored, found by trying; None where it can."""
        key = os.urandom(32)
        try:
            self._store(key, bytes(TRIAL_BYTES))
            self._path(key).unlink()
        except OSError as error:
            return reason(error)
        return None

    def _store(self, key: bytes, data: bytes) -> None:
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _validate_own(self.folder.stat())
        _write(self._path(key), _head(key, data) + data)

    def _path(self, key: bytes) -> Path:
        return self.folder / f"{key.hex()}{SUFFIX}"

    def _may_be_full(self, size: int) -> bool:
        written = _written.get(self.folder, self.limit) + size
        due = 64 * written > self.limit
        _written[self.folder] = 0 if due else written
        return due

    def _shrink(self) -> None:
        total = 0
        files = stored_objects(self.folder)
        for status, path in sorted(files, key=lambda file: file[0].st_mtime_ns, reverse=True):
            total += status.st_size
            if total > self.limit:
                with suppress(FileNotFoundError):
                    os.unlink(path)  # noqa: PTH108


def stored_objects(folder: Path) -> Iterator[tuple[os.stat_result, str]]:
    """Status and path of each compiled object in a folder, without those that another process removes meanwhile."""
    with os.scandir(folder) as entries:
        for entry in entries:
            with suppress(FileNotFoundError):
                if entry.name.endswith(SUFFIX):
                    yield entry.stat(follow_symlinks=False), entry.path


def _head(key: bytes, data: bytes) -> bytes:
    return _MAGIC + key + hashlib.sha256(data).digest()


def _validate_own(status: os.stat_result) -> None:
    if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise PermissionError("the cache of compiled objects is writable by other users")


def _read(path: Path) -> bytes:
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as file:
        _validate_own(os.fstat(descriptor))
        with suppress(OSError):
            os.utime(descriptor)
        return file.read()


def _write(path: Path, content: bytes) -> None:
    beside = path.with_name(f".{os.urandom(8).hex()}{SUFFIX}")
    try:
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(content)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


MAX_RESULTS_IN_PROCESS = 16
"""Results that one process caches."""

_CHOOSING = ("OPENBLAS_", "MKL_", "OMP_NUM_THREADS", "ADAPTCTL_PROCESSOR", "ADAPTCTL_OPTIMIZATION")
"""Prefixes of environment variables that choose code paths."""

Result = TypeVar("Result")
_left = iter(range(MAX_RESULTS_IN_PROCESS))


def kept(what: str, inputs: object, kind: type[Result], compute: Callable[[], Result]) -> Result:
    """Result of `compute()`, cached by inputs, source code, hardware and settings."""
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
    """Texts that identify what decides results' last bits."""
    chosen = sorted(f"{name}={value}" for name, value in os.environ.items() if name.startswith(_CHOOSING))
    return [*_here(), *chosen]


@functools.cache
def _here() -> tuple[str, ...]:
    features = getattr(np._core._multiarray_umath, "__cpu_features__", {})  # type: ignore[attr-defined]  # not public
    able = sorted(name for name, has in features.items() if has)
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    return np.__version__, repr(blas), platform.machine(), str(len(cores)), *able


@functools.cache
def source_state() -> str:
    """SHA-256 hash of the source files' paths, sizes and times."""
    found = sorted(source_files(str(Path(__file__).parent.parent)))
    return hashed(found) if found else ""


def source_files(folder: str) -> Iterator[tuple[str, int, int]]:
    """Python source files below a folder."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(".py"):
                status = entry.stat()
                yield entry.path, status.st_size, status.st_mtime_ns
            elif entry.is_dir():
                yield from source_files(entry.path)
