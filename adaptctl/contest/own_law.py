"""Law of anyone, from `file.py:Class`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from traceback import extract_tb
from typing import Any

from adaptctl.contest.known import Knowledge, Known
from adaptctl.contest.laws import Entrant, slotine_li
from adaptctl.control import AdaptationLaw, Controller
from adaptctl.errors import FileError, InputError, NotFoundError, suggested_name
from adaptctl.files import hashed, read_text

FREE = tuple(name for name in vars(Known) if isinstance(vars(Known)[name], property))
"""Names of fields that are filled by what is known."""


def is_own(law: str) -> bool:
    """True for a law that is named by its file and class."""
    return ":" in law


def own_name(law: str) -> str:
    """Name in tables of a law by its file and class: its class."""
    return law.rpartition(":")[2]


def source_hash(law: str) -> str:
    """Hash of the file of a law by its file and class."""
    return hashed(read_text(law.rpartition(":")[0]))


def own_entrant(law: str) -> Entrant:
    """
    Law of a class in a Python file, which is run.

    The class is a `Controller` or an `AdaptationLaw`, a dataclass; its fields without defaults get what `Known` has by
    their names. With a class method `enter` it makes itself from a `Known`, by gains of its own.

    Raises `FileError` if the file cannot be imported, `NotFoundError` without such a class, `InputError` for one of
    another kind.
    """
    path, _, name = law.rpartition(":")
    module = _module(Path(path))
    kind = getattr(module, name, None)
    if not isinstance(kind, type):
        known = [key for key, value in vars(module).items() if _is_law(value) and value.__module__ == module.__name__]
        hint = suggested_name(name, known) or (f"; it has {', '.join(known)}" if known else "; it has none")
        raise NotFoundError(f"{path}: no class {name!r}{hint}")
    if not (_is_law(kind) or hasattr(kind, "enter")):
        raise InputError(f"{law}: expected a subclass of Controller or AdaptationLaw, or a class method enter(known)")
    given = str(getattr(kind, "knows", Knowledge.LIMITS.value))
    allowed = [one.value for one in Knowledge if one is not Knowledge.TRUTH]
    if given not in allowed:
        raise InputError(f"{law}: knows: expected one of {', '.join(map(repr, allowed))}, got {given!r}")
    tuned = "by its own gains" if hasattr(kind, "enter") else "by the rule"
    return Entrant(name, Knowledge(given), lambda known: _entered(kind, known), _first_line(kind, name), tuned)


def _first_line(kind: type, name: str) -> str:
    told = (kind.__doc__ or "").strip()
    return name if not told or told.startswith(f"{name}(") else told.splitlines()[0].rstrip(".")


def _is_law(kind: object) -> bool:
    return isinstance(kind, type) and issubclass(kind, Controller | AdaptationLaw)


def _entered(kind: Any, known: Known) -> Controller[Any]:
    made = kind.enter(known) if hasattr(kind, "enter") else kind(**dict(_filled(kind, known)))
    if isinstance(made, AdaptationLaw):
        return slotine_li(known, made)
    if not isinstance(made, Controller):
        raise InputError(f"enter: expected a Controller or an AdaptationLaw, got {type(made).__name__}")
    return made


def _filled(kind: type, known: Known) -> Iterator[tuple[str, Any]]:
    """Fields without defaults, by what is known."""
    for field in fields(kind) if is_dataclass(kind) else ():
        if field.init and field.default is MISSING and field.default_factory is MISSING:
            if field.name not in FREE:
                raise InputError(f"needs {field.name}, which a law may not know or is no name of: {', '.join(FREE)}")
            yield field.name, getattr(known, field.name)


def _module(path: Path) -> Any:
    if not path.is_file():
        raise FileError(f"{path}: no such file: a law of yours is named as FILE.py:CLASS")
    known = hashed([str(path.resolve()), read_text(path)])
    spec = spec_from_file_location(f"adaptctl_law_{path.stem}_{known[:8]}", path)
    if spec is None or spec.loader is None:
        raise FileError(f"{path}: cannot be imported as Python")
    if spec.name in sys.modules:
        return sys.modules[spec.name]
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look their annotations up
    try:
        spec.loader.exec_module(module)
    except BaseException as error:  # whatever the law's own code raises, an exit too
        del sys.modules[spec.name]
        if isinstance(error, KeyboardInterrupt):
            raise
        raise FileError(f"{path}: {type(error).__name__}: {error}{line_in(path, error)}") from error
    return module


def line_in(path: Path, error: BaseException) -> str:
    """Last line of a file that an error came through, in brackets; empty for one from elsewhere."""
    lines = [frame.lineno for frame in extract_tb(error.__traceback__) if Path(frame.filename) == path]
    return f" (line {lines[-1]})" if lines else ""
