"""Real logs that come with the package, each with its robot, drives and licence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path
from typing import NamedTuple

from adaptctl.errors import NotFoundError

NAMES = ("tx40",)


class Example(NamedTuple):
    """Paths of an example's log (Parquet), robot (URDF) and drives file (TOML)."""

    log: Path
    robot: Path
    drives: Path


@contextmanager
def example(name: str) -> Iterator[Example]:
    """Context manager with the files of an example, "tx40"; `NotFoundError` for another name."""
    if name not in NAMES:
        raise NotFoundError(f"unknown example {name!r}; examples: {', '.join(NAMES)}")
    with as_file(files(__name__) / name) as folder:
        yield Example(folder / "log.parquet", folder / f"{name}.urdf", folder / f"{name}_drives.toml")
