"""Docstrings of public names: sections that numpydoc accepts, and an example for each class and function."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from enum import Enum
from functools import cache
from typing import Any

from numpydoc.validate import validate

import adaptctl
from adaptctl.errors import MissingExtraError

CHECKED = ("GL", "SS", "PR", "RT", "YD")
"""Kinds of numpydoc's codes: general, summary, parameters, returns, yields."""


@cache
def public() -> dict[str, Any]:
    """Classes and functions that modules of the package offer in `__all__`, by full name."""
    found = {}
    for module in pkgutil.walk_packages(adaptctl.__path__, "adaptctl."):
        if module.name.endswith("__main__"):
            continue
        try:
            home = importlib.import_module(module.name)
        except MissingExtraError:
            continue
        for name in getattr(home, "__all__", ()):
            value = getattr(home, name)
            if inspect.isclass(value) or inspect.isfunction(value):
                found[f"{value.__module__}.{value.__qualname__}"] = value
    return {name: value for name, value in found.items() if name.startswith("adaptctl.")}


def methods(name: str, value: Any) -> Iterator[str]:
    """Full names of the public methods that a class is the first of its bases to define."""
    for method, made in vars(value).items() if inspect.isclass(value) else ():
        is_method = isinstance(made, classmethod | staticmethod | type(methods))
        if is_method and not method.startswith("_") and not any(hasattr(base, method) for base in value.__bases__):
            yield f"{name}.{method}"


def is_called(value: Any) -> bool:
    """Whether users call it to make one: they do not call a class of choices or a protocol."""
    return not (inspect.isclass(value) and (issubclass(value, Enum) or getattr(value, "_is_protocol", False)))


def test_numpydoc_finds_no_fault() -> None:
    names = [each for name, value in public().items() for each in (name, *methods(name, value))]
    ignored = {(name, "PR01") for name, value in public().items() if not is_called(value)}
    found = [(name, *fault) for name in names for fault in validate(name)["errors"] if fault[0][:2] in CHECKED]
    faults = [fault for fault in found if fault[:2] not in ignored]
    assert not faults, f"{len(faults)} faults:\n" + "\n".join(" ".join(fault) for fault in faults)


TOO_SLOW = {"adaptctl.envs.baselines.baselines", "adaptctl.envs.live.LiveView"}
"""What an example of would compile, or write a recording, for many seconds; pages show them."""


def test_every_class_and_function_has_an_example() -> None:
    without = {name for name, value in public().items() if ">>>" not in (inspect.getdoc(value) or "")}
    assert without <= TOO_SLOW, f"{len(without)} without an example: {', '.join(without)}"
