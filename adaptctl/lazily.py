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
    """The modules of all names that a package's stub file (``__init__.pyi``) offers: module names by offered name. The
    stub offers a name by a line `from MODULE import NAME as NAME`, and by `from PACKAGE import *` all names that the
    stub of that subpackage offers. Other lines are passed over. Raises `OSError` where a stub cannot be read."""
    offered: dict[str, str] = {}
    for offer in _OFFER.finditer(stub.read_text(encoding="utf-8")):
        if offer["name"]:
            offered[offer["name"]] = offer["home"]
        else:
            offered |= homes(stub.parent / offer["home"].rpartition(".")[2] / stub.name)
    return offered


def imported_lazily(package: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """The `__all__`, `__getattr__` and `__dir__` of a package that imports its public names when they are first used: a
    sorted list of names, a function from a name to its value, and a function that lists all names.

    `package` is the full name of the package, whose ``__init__.py`` calls this; its stub ``__init__.pyi`` says which
    names there are, and in which modules. A name that is called as its module is imported at once: importing the module
    later would put the module in the name's place. The `__getattr__` raises `AttributeError` for a name that the stub
    does not have, and `MissingExtraError` where a package that the name needs is not installed.
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
