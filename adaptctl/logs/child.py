"""Process in which a log of a binary format is read: `READER PATH FOLDER MEMORY SECONDS OPTION...`."""

from __future__ import annotations

import gc
import json
import math
import resource
import sys
from importlib import import_module
from pathlib import Path

import numpy as np

from adaptctl.errors import AdaptctlError
from adaptctl.logs.isolated import CELLS, EMPTY, HEAD
from adaptctl.logs.on_disk import release
from adaptctl.logs.table import LogTable, validate_size


def main(arguments: list[str]) -> None:
    """Read a log within bounds, and write its table or the error that it is refused with."""
    reader, path, folder, memory, seconds, *options = arguments
    _bounded(int(memory), float(seconds))
    gc.disable()  # messages have no cycles, and are looked through for them again and again
    module, _, function = reader.partition(":")
    try:
        found = getattr(import_module(f"adaptctl.logs.{module}"), function)(path, *options)
        validate_size(path, len(found), len(found.columns))
        _written(found, Path(folder))
    except AdaptctlError as error:
        head = {"error": type(error).__name__, "message": str(error)}
        (Path(folder) / HEAD).write_text(json.dumps(head), encoding="utf-8")


def _bounded(memory: int, seconds: float) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds), math.ceil(seconds)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _written(log: LogTable, folder: Path) -> None:
    with (folder / CELLS).open("wb") as file:
        for values in log.columns.values():
            np.ascontiguousarray(values, dtype="<f8").tofile(file)
            release()
    with (folder / EMPTY).open("wb") as file:
        for mask in log.empty.values():
            np.ascontiguousarray(mask, dtype=np.bool_).tofile(file)
    head = {name: getattr(log, name) for name in ("source", "units", "words", "numbered", "notes", "begin")}
    head |= {"names": list(log.columns), "rows": len(log), "empty": list(log.empty)}
    (folder / HEAD).write_text(json.dumps(head), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
