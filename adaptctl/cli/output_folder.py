"""The folder that a command writes: ready before the work, gone where nothing came of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def output_folder(out: Path, overwrite: bool) -> Iterator[Path]:
    """The folder, ready; gone again where nothing came of it and it was not there before."""
    from adaptctl.recording import prepare_folder

    there = out.exists()
    folder = prepare_folder(out, overwrite)
    try:
        yield folder
    except BaseException:
        if not there:
            with suppress(OSError):
                folder.rmdir()
        raise
