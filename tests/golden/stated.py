"""Numbers that modules state: constants, class attributes, and defaults of parameters and fields."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
FOLDERS = ("cli", "contest", "envs", "experiments", "hardware", "logs", "recording")
CHANGED = ("OVERSAMPLING",)
"""for tests, which draw coarse images"""
ABSENT = ("sb3.py",)
"""for a package that the test environment has not"""
KINDS = (bool, int, float, tuple, list, dict, np.ndarray)
"""of values that are kept"""


def numbers() -> dict[str, dict[str, Any]]:
    """Values by module and name, of the modules of some folders and of the package itself."""
    places = [path for name in FOLDERS for path in (ROOT / "adaptctl" / name).rglob("*.py") if path.name not in ABSENT]
    places += [path for path in (ROOT / "adaptctl").glob("*.py") if not path.name.startswith("__")]
    found = {".".join(path.relative_to(ROOT).with_suffix("").parts): dict(stated(path)) for path in sorted(places)}
    return {name: own for name, own in found.items() if own}


def stated(path: Path) -> Iterator[tuple[str, Any]]:
    """What a module itself assigns and defines, not what it imports."""
    module = import_module(".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"))
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)]
            for name in sorted({*names}.difference(CHANGED)):
                yield from numeric(name, getattr(module, name))
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield from inside(node.name, getattr(module, node.name))


def inside(name: str, thing: Any) -> Iterator[tuple[str, Any]]:
    """Class attributes, fields' defaults and defaults of parameters."""
    if isinstance(thing, type):
        for key, value in [*vars(thing).items(), *getattr(thing, "_field_defaults", {}).items()]:
            if not key.startswith("__"):
                yield from numeric(f"{name}.{key}", value)
                yield from inside(f"{name}.{key}", value) if callable(value) else ()
    elif inspect.isfunction(thing):
        for one in inspect.signature(thing).parameters.values():
            yield from numeric(f"{name}({one.name})", one.default)


def numeric(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, KINDS) and (own := [one for one in flat(value) if one == one]):
        yield name, own[0] if len(own) == 1 else own


def flat(value: Any) -> Iterator[bool | int | float | str]:
    """Numbers within tuples, lists and dictionaries; those as words that comparisons' tolerances are too large for."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, tuple | list | np.ndarray):
        for one in value:
            yield from flat(one)
    elif isinstance(value, bool | int | float | np.number):
        beyond = isinstance(value, float) and (0.0 < abs(value) < 1e-6 or np.isinf(value))
        yield f"={value:.9g}" if beyond else value if isinstance(value, bool | int) else float(value)
