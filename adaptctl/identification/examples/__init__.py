"""Real logs that come with the package, each with its robot, its drives and its licence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path
from typing import NamedTuple

from adaptctl.errors import NotFoundError

NAMES = ("tx40",)


class Example(NamedTuple):
    """An example: the files of one robot."""

    log: Path
    robot: Path
    drives: Path


@contextmanager
def example(name: str) -> Iterator[Example]:
    """The files of an example, there for as long as the block runs. Raises `NotFoundError` for an unknown name."""
    if name not in NAMES:
        raise NotFoundError(f"unknown example {name!r}; there is {', '.join(NAMES)}")
    with as_file(files(__name__) / name) as folder:
        yield Example(folder / "log.parquet", folder / f"{name}.urdf", folder / f"{name}_drives.toml")
