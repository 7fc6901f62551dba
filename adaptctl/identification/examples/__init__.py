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
    """Example of an identification: paths of the files of one robot. `log` is its log (Parquet), `robot` its URDF, and
    `drives` its drives file (TOML: transmission, motors and the log's columns). Made by `example`; nothing is checked
    at construction."""

    log: Path
    robot: Path
    drives: Path


@contextmanager
def example(name: str) -> Iterator[Example]:
    """A context manager that yields the files, an `Example` of paths, of the example of the given `name`: "tx40", a log
    of a Staubli TX40 arm. The files exist for as long as the `with` block runs. Raises `NotFoundError` for another
    name, as the block begins."""
    if name not in NAMES:
        raise NotFoundError(f"unknown example {name!r}; there is {', '.join(NAMES)}")
    with as_file(files(__name__) / name) as folder:
        yield Example(folder / "log.parquet", folder / f"{name}.urdf", folder / f"{name}_drives.toml")
