"""Folders of results: every file in it, or none."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeAlias

from adaptctl.errors import FileError
from adaptctl.files import cleaned_of_the_dead, name_beside, reason, require_place
from adaptctl.folders import made_folder

RECORDING, SUMMARY, TRACE, REPORT, FIGURES = (
    "recording.rrd",
    "summary.json",
    "trace.parquet",
    "report.html",
    "figures",
)
STAGED = "artifacts"
"""Name of the hidden folder that files are written to before they are moved to their places."""


Progress: TypeAlias = Callable[[str, float], object]
"""Called with what is being done, and the fraction of it (0 to 1) that is done."""


def silent(what: str, share: float) -> None:
    """Progress callback that does nothing, for callers that want no progress shown. Its arguments are those of every
    such callback: `what` is being done, in words, and the fraction of it that is done, `share`, 0 to 1. Nothing is
    raised."""


@contextmanager
def all_or_none(folder: str | Path, last: str = SUMMARY) -> Iterator[Path]:
    """Context manager that gives a hidden folder within `folder`, which is made where it is missing, to write to: when
    the block ends its files are moved into `folder`, over existing ones of their names, the file `last` after all
    others, so that what is half done does not say that it is complete; when the block fails `folder` stays as it was.
    Raises `FileError`, which names the file's own place, where one cannot be written or the folder cannot be made."""
    path, made = Path(folder), list[Path]()
    cleaned_of_the_dead(path, STAGED)
    beside = name_beside(path / STAGED)
    try:
        made += _made(path)
        made_folder(beside)
        yield beside
        for place in beside.rglob("*"):
            made += _made(path / place.relative_to(beside)) if place.is_dir() else []
        _move_in(beside, path, last)
    except FileError as error:
        raise FileError(str(error).replace(str(beside), str(path))) from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
        for place in reversed(made):
            with suppress(OSError):  # It holds files, unless the block has failed.
                place.rmdir()


def _made(place: Path) -> list[Path]:
    """The folder, which is there now, if it was not before; else none. Raises `FileError` where it cannot be made."""
    made = [] if place.is_dir() else [place]
    made_folder(place)
    return made


def _move_in(beside: Path, path: Path, last: str) -> None:
    files = [file for file in beside.rglob("*") if file.is_file()]
    places = [(file, require_place(path / file.relative_to(beside))) for file in files]
    for file, place in sorted(places, key=lambda one: one[0].name == last):
        try:
            shutil.move(file, place)
        except OSError as error:
            raise FileError(f"{place}: cannot be written ({reason(error)})") from error
