"""Atomically replaced result folders."""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from adaptctl.errors import FileError
from adaptctl.files import (
    flush,
    is_stale_temporary,
    name_beside,
    real_place,
    reason,
    remove_stale_temporaries,
    validate_regular,
)

RESULT_SUFFIXES = (".rrd", ".mcap", ".json", ".parquet", ".html", ".png", ".toml", ".csv", ".urdf", ".yaml")
"""suffixes of a run's files, which the next run replaces"""
FIGURES = "figures"
RUN_FILES = ("summary.json", "forecast.json", "comparison.json", "recording.rrd")
"""files that mark a run's folder; without any of them nothing is replaced"""
AT_FDCWD, RENAME_EXCHANGE = -100, 2
"""arguments of Linux's renameat2"""


@contextmanager
def replacing_folder(path: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """Context with a temporary folder that replaces `path` at success."""
    target = real_place(path)
    missing = [above for above in target.parents if not above.exists()]
    _validate_place(path, target, overwrite)
    _validate_alone(path, target)
    beside = _beside(target)
    try:
        _make(path, beside)  # here, so that Ctrl-C just then leaves nothing
        yield beside
        _validate_regular(target / entry.relative_to(beside) for entry in _files(beside))
        _flush_all(beside)
        _swap(path, beside, target, overwrite)
    except OSError as error:
        if isinstance(error.filename, str) and not Path(error.filename).is_relative_to(target.parent):
            raise
        raise FileError(f"{path}: cannot be written ({reason(error)})") from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
        with suppress(OSError):  # not empty, after success
            for above in missing:
                above.rmdir()


def validate_folder(path: str | Path, overwrite: bool = False) -> None:
    """Raise `FileError` where `replacing_folder` could not write."""
    with suppress(_Tried), replacing_folder(path, overwrite):
        raise _Tried


class _Tried(Exception):  # noqa: N818  # no error
    """End of a trial, which leaves nothing."""


def made_folder(path: Path) -> Path:
    """Create a folder with parents; return its path."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{path}: the folder cannot be made ({reason(error)}); choose another") from error
    return path


def _validate_place(path: str | Path, target: Path, overwrite: bool) -> None:
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        occupied = target.exists() and any(target.iterdir())
    except (FileExistsError, NotADirectoryError) as error:
        what = "is a file" if target.is_file() else "is below a file"
        raise FileError(f"{path}: {what}; give a folder") from error
    except OSError as error:
        raise FileError(f"{path}: cannot be made or read ({reason(error)}); choose another folder") from error
    if occupied and not overwrite:
        raise FileError(f"{path}: the folder is not empty; choose another or allow it with --overwrite")
    if occupied:
        _validate_regular(target / name for name in RUN_FILES)
    if occupied and (others := _of_no_run(target)):
        raise FileError(
            f"{path}: holds {others[0]}, and no run's {RUN_FILES[0]}: it is not replaced; choose another folder"
        )


def _of_no_run(folder: Path) -> list[str]:
    """Names that a run would replace, but did not write."""
    if any((folder / mark).is_file() for mark in RUN_FILES) or any(
        is_stale_temporary(e.name) for e in folder.iterdir()
    ):
        return []
    return [entry.name for entry in _files(folder) if _is_result(entry, folder)]


def _validate_regular(places: Iterable[Path]) -> None:
    """Refuse pipes, devices and the like where a run writes."""
    for place in places:
        validate_regular(place, place, "another folder")


def _files(folder: Path) -> list[Path]:
    return sorted(inner for inner in folder.rglob("*") if inner.is_symlink() or not inner.is_dir())


def _validate_alone(path: str | Path, target: Path) -> None:
    """Remove remains of killed runs, refuse beside a live one."""
    for folder in (target.parent, target):
        if not folder.is_dir():
            continue
        for left in remove_stale_temporaries(folder, target.name):
            raise FileError(
                f"{path}: another run is writing it, or was cut off on another host or before a restart: wait for it,"
                f" delete {left}, or choose another folder"
            )


def _beside(target: Path) -> Path:
    """Path of a folder beside the target, or within it if immovable."""
    fixed = target == Path.cwd() or target.is_mount() or not os.access(target.parent, os.W_OK)
    return name_beside(target / target.name if fixed and target.is_dir() else target)


def _make(path: str | Path, beside: Path) -> None:
    try:
        beside.mkdir()
    except OSError as error:
        raise FileError(f"{path}: cannot be written ({reason(error)}); choose another folder") from error


def _swap(path: str | Path, beside: Path, target: Path, overwrite: bool) -> None:
    if beside.parent == target:
        _move_in(beside, target)
        return
    try:
        beside.rename(target)  # where nothing is, or an empty folder
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
        if not overwrite:
            raise FileError(f"{path}: is not empty any more; choose another folder") from error
        _exchange(beside, target)
        _keep_others(beside, target)
    flush(target.parent)


def _exchange(beside: Path, target: Path) -> None:
    """Exchange two folders, atomically on Linux."""
    if sys.platform == "linux":
        done = ctypes.CDLL(None, use_errno=True).renameat2
        if done(AT_FDCWD, os.fsencode(beside), AT_FDCWD, os.fsencode(target), RENAME_EXCHANGE) == 0:
            return
    between = name_beside(target)
    target.rename(between)
    beside.rename(target)
    between.rename(beside)


def _keep_others(old: Path, target: Path) -> None:
    """Move entries of no run into the new folder."""
    for entry in _files(old):
        place = target / entry.relative_to(old)
        if not _is_result(entry, old) and not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            entry.rename(place)


def _is_result(entry: Path, folder: Path) -> bool:
    """True if a run may have written this entry."""
    *above, _ = parts = entry.relative_to(folder).parts
    regular = entry.is_symlink() or entry.is_file()
    return regular and (
        any(map(is_stale_temporary, parts)) or (above in ([], [FIGURES]) and entry.suffix in RESULT_SUFFIXES)
    )


def _move_in(beside: Path, target: Path) -> None:
    """Move file by file, the summary last."""
    new = sorted(_files(beside), key=lambda entry: entry.name == "summary.json")
    old = [entry for entry in _files(target) if not entry.is_relative_to(beside) and _is_result(entry, target)]
    for entry in sorted(old, key=lambda entry: entry.name != "summary.json"):
        entry.unlink()
    for entry in new:
        place = target / entry.relative_to(beside)
        place.parent.mkdir(parents=True, exist_ok=True)
        entry.rename(place)


def _flush_all(folder: Path) -> None:
    for inner in [folder, *folder.rglob("*")]:
        with suppress(OSError):  # Some file systems do not flush folders.
            flush(inner)
