"""Names of a package that are imported when they are first used (PEP 562).

A program pays for the modules that it uses: a law that is not asked for, or the reader of another kind of file, would
take a sixth of the time until the first torque. The names stand once, in the package's stub `__init__.pyi`, where type
checkers and editors look for them too (as in scientific-python's `lazy_loader`, which however loses a name that is
called as its module is).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from sys import modules
from typing import Any

from adaptctl.packages import needed

_OFFER = re.compile(r"^from (?P<home>[\w.]+) import (?:(?P<name>\w+) as (?P=name)|\*)$", re.MULTILINE)


def homes(stub: Path) -> dict[str, str]:
    """The module of every name that a stub offers, in lines `from MODULE import NAME as NAME`, or `import *` for all
    that the stub of a package below it offers."""
    offered: dict[str, str] = {}
    for offer in _OFFER.finditer(stub.read_text(encoding="utf-8")):
        if offer["name"]:
            offered[offer["name"]] = offer["home"]
        else:
            offered |= homes(stub.parent / offer["home"].rpartition(".")[2] / stub.name)
    return offered


def imported_lazily(package: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """`__all__`, `__getattr__` and `__dir__` of a package that offers the names in its stub.

    What is named like its module is imported at once: importing the module later would put it in the name's place.
    `__getattr__` raises AttributeError for a name that the stub does not have.
    """
    home_of = homes(Path(str(modules[package].__file__)).with_suffix(".pyi"))

    def found(name: str) -> Any:
        if name not in home_of:
            missing = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(missing, name=name, obj=modules[package])
        with needed(f"{package}.{name}"):
            value = getattr(import_module(home_of[name]), name)
        setattr(modules[package], name, value)
        return value

    def listed() -> list[str]:
        return sorted({*vars(modules[package]), *home_of})

    for name, home in home_of.items():
        if home == f"{package}.{name}":
            found(name)
    return sorted(home_of), found, listed
