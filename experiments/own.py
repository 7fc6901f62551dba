"""Experiments of one's own: found in a file, or offered by an installed package as an entry point."""

from __future__ import annotations

import inspect
import sys
from importlib.metadata import EntryPoint
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from adaptctl.errors import FileError, InputError
from adaptctl.experiments.experiment import Experiment


def from_entry_point(point: EntryPoint) -> type[Experiment]:
    """Class of the experiment that the entry point `point` of an installed package names, a subclass of `Experiment`;
    the package is imported. Raises `InputError` where the import fails, where the entry point names anything else, and
    for a class without a `name` and a `title`, texts."""
    try:
        found = point.load()
    except Exception as error:  # whatever the other package raises when it is imported
        raise InputError(f"entry point {point.name!r} ({point.value}): {type(error).__name__}: {error}") from error
    return _experiment(found, f"entry point {point.name!r} ({point.value})")


def from_file(path: str | Path) -> type[Experiment]:
    """Class of the experiment, a subclass of `Experiment`, that the Python file at `path` defines; the file is run.
    Raises `FileError` where there is no such file, where it cannot be imported, and where it defines no such class or
    several; `InputError` for a class without a `name` and a `title`, texts."""
    file = Path(path)
    if not file.is_file():
        raise FileError(f"{path}: there is no such file")
    spec = spec_from_file_location(f"adaptctl_own_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise FileError(f"{path}: cannot be imported as Python")
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look their annotations up
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever the user's own code raises
        raise FileError(f"{path}: {type(error).__name__}: {error} (line {_line(error, file)})") from error
    own = [value for value in vars(module).values() if _is_own(value, spec.name)]
    if len(own) != 1:
        names = f": {', '.join(kind.__name__ for kind in own)}" if own else ""
        raise FileError(
            f"{path}: expected one class of an experiment, a subclass of Experiment, found {len(own)}{names}"
        )
    return _experiment(own[0], str(path))


def _is_own(value: object, module: str) -> bool:
    is_kind = isinstance(value, type) and issubclass(value, Experiment)
    return is_kind and value.__module__ == module and not inspect.isabstract(value)


def _experiment(found: object, where: str) -> type[Experiment]:
    if not (isinstance(found, type) and issubclass(found, Experiment)):
        raise InputError(f"{where}: expected a subclass of adaptctl.experiments.experiment.Experiment, got {found!r}")
    for name in ("name", "title"):
        if not isinstance(getattr(found, name, None), str):
            raise InputError(f"{where}: class {found.__name__} needs a {name}: {name}: ClassVar[str] = ...")
    return found


def _line(error: BaseException, file: Path) -> int | str:
    """The last line of the file that the error passed through."""
    trace, line = error.__traceback__, getattr(error, "lineno", None) or "unknown"
    while trace is not None:
        if Path(trace.tb_frame.f_code.co_filename) == file:
            line = trace.tb_lineno
        trace = trace.tb_next
    return line
