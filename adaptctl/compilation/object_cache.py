"""Compiled objects kept for other processes: one file each, in the user's own cache folder.

The cache is a convenience: whatever is wrong with it, code is compiled anew and only the log tells. What it holds is
machine code, so nothing is read that anybody else could have written.
"""

from __future__ import annotations

import hashlib
import logging
import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

LIMIT = 256 * 2**20
"""Bytes kept at most, and a 64th more for each process that writes: beyond, what was used longest ago goes."""

SUFFIX = ".object"

_MAGIC = b"adaptctl object 1\n"
_HEAD = len(_MAGIC) + 64

_written: dict[Path, int] = {}
"""Bytes that this process has kept in a folder since it last looked how full that is."""

log = logging.getLogger(__name__)


def cache_folder() -> Path | None:
    """Path of the folder in which compiled objects are kept for other processes, which need not exist: that of the
    environment variable ADAPTCTL_CACHE, or else `adaptctl` in XDG_CACHE_HOME or `~/.cache`; None where ADAPTCTL_CACHE
    is "off", and where the user has no home folder. Nothing is raised."""
    chosen, caches = os.environ.get("ADAPTCTL_CACHE", ""), Path(os.environ.get("XDG_CACHE_HOME", ""))
    if chosen == "off":
        return None
    try:
        if chosen:
            return Path(chosen).expanduser()
        return (caches if caches.is_absolute() else Path.home() / ".cache") / "adaptctl"
    except RuntimeError as error:
        log.info("no compiled objects are kept: %s", error)
        return None


class ObjectCache(NamedTuple):
    """Cache of compiled objects, bytes, on disk: one file in `folder` for each key of 32 bytes. The folder has at most
    `limit` bytes, 256 MiB by default, and a 64th more for each process that writes; what was used longest ago is
    deleted. The folder need not exist. No method raises an error of the file system."""

    folder: Path
    limit: int = LIMIT

    def get(self, key: bytes) -> bytes | None:
        """The bytes kept under `key`, 32 bytes, or None where there are none, they are damaged, or the folder or file
        belongs to another user or could be written by one. A file that is read is marked as used now. The log tells the
        reason for None; no `OSError` is raised."""
        try:
            _require_own(self.folder.stat())
            content = _read(self._path(key))
        except OSError as error:
            log.info("compiled anew: %s", error)
            return None
        data = content[_HEAD:]
        if content[:_HEAD] != _head(key, data):
            log.info("compiled anew: %s is damaged", self._path(key))
            return None
        return data

    def put(self, key: bytes, data: bytes) -> None:
        """Keep `data`, the bytes of a compiled object, under `key`, 32 bytes, for later processes, and delete what was
        used longest ago where the cache is full. Where the folder cannot be made or written, or others could write to
        it, nothing is kept and the log tells the reason; no `OSError` is raised."""
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            _require_own(self.folder.stat())
            _write(self._path(key), _head(key, data) + data)
            if self._may_be_full(_HEAD + len(data)):
                self._shrink()
        except OSError as error:
            log.info("not kept: %s", error)

    def _path(self, key: bytes) -> Path:
        return self.folder / f"{key.hex()}{SUFFIX}"

    def _may_be_full(self, size: int) -> bool:
        """Sign to look how full the folder is, after so many bytes more: at this process's first object, and then at
        every 64th of the limit. To look takes some ten milliseconds where there are thousands of files."""
        written = _written.get(self.folder, self.limit) + size
        due = 64 * written > self.limit
        _written[self.folder] = 0 if due else written
        return due

    def _shrink(self) -> None:
        """Forget what was used longest ago; another process may be doing the same."""
        total = 0
        with os.scandir(self.folder) as entries:
            files = [(entry.stat(follow_symlinks=False), entry.path) for entry in entries if _is_ours(entry)]
        for status, path in sorted(files, key=lambda file: file[0].st_mtime_ns, reverse=True):
            total += status.st_size
            if total > self.limit:
                with suppress(FileNotFoundError):
                    os.unlink(path)  # noqa: PTH108


def _is_ours(entry: os.DirEntry[str]) -> bool:
    return entry.name.endswith(SUFFIX)


def _head(key: bytes, data: bytes) -> bytes:
    return _MAGIC + key + hashlib.sha256(data).digest()


def _require_own(status: os.stat_result) -> None:
    if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise PermissionError("others can write to the cache of compiled objects")


def _read(path: Path) -> bytes:
    """A file's bytes; it is marked as used just now."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as file:
        _require_own(os.fstat(descriptor))
        with suppress(OSError):
            os.utime(descriptor)
        return file.read()


def _write(path: Path, content: bytes) -> None:
    """Write a file beside its place and then move it there, so that no other process reads half of it."""
    beside = path.with_name(f".{os.urandom(8).hex()}{SUFFIX}")
    try:
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(content)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
