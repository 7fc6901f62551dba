"""Names of a package that are imported when they are first used (PEP 562).

A program pays for the modules that it uses: a law that is not asked for, or the reader of another kind of file, would
take a sixth of the time until the first torque.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from sys import modules
from typing import Any


def imported_lazily(
    package: str, homes: Mapping[str, str]
) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """`__all__`, `__getattr__` and `__dir__` of a package that offers names of its modules, ``{"module": "a b"}``.

    What is named like its module is imported at once: importing the module later would put it in the name's place.
    """
    home_of = {name: f"{package}.{home}" for home, own in homes.items() for name in own.split()}

    def found(name: str) -> Any:
        if name not in home_of:
            missing = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(missing, name=name, obj=modules[package])
        value = getattr(import_module(home_of[name]), name)
        setattr(modules[package], name, value)
        return value

    def listed() -> list[str]:
        return sorted({*vars(modules[package]), *home_of})

    for home, own in homes.items():
        if home in own.split():
            found(home)
    return sorted(home_of), found, listed
