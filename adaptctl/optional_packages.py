"""Optional packages."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from sys import modules
from typing import Any

from adaptctl.errors import MissingExtraError, suggested_name

DISTRIBUTIONS = {
    "pydrake": "drake",
    "clarabel": "'adaptctl[consistency]'",
    "cvxpy": "'adaptctl[consistency]'",
    "dask": "'adaptctl[sweep]'",
    "distributed": "'adaptctl[sweep]'",
    "jinja2": "'adaptctl[report]'",
    "matplotlib": "'adaptctl[report]'",
    "mcap": "'adaptctl[logs]'",
    "minari": "'adaptctl[data]'",
    "moviepy": "'adaptctl[video]'",
    "mujoco": "'adaptctl[mujoco]'",
    "optuna": "'adaptctl[search]'",
    "pinocchio": "pin",
    "pyarrow": "'adaptctl[report]'",
    "rerun": "rerun-sdk",
    "rosbags": "'adaptctl[logs]'",
    "rtde_control": "ur_rtde",
    "stable_baselines3": "'adaptctl[rl]'",
    "trossen_arm": "trossen-arm",
}
"""pip names of packages with another import name, or their extras"""
OF_RESULTS = ("jinja2", "matplotlib", "pyarrow", "rerun")
"""packages for result folders"""


@contextmanager
def needed(what: str) -> Iterator[None]:
    """Context or decorator that raises `MissingExtraError` for missing packages."""
    try:
        yield
    except ModuleNotFoundError as error:
        missing = str(error.name).partition(".")[0]
        if missing == "adaptctl":
            raise
        raise MissingExtraError(f"{what} needs {missing}: pip install {DISTRIBUTIONS.get(missing, missing)}") from error


def validate_for_results() -> None:
    """Raise `ModuleNotFoundError` without the packages for result folders."""
    for name in OF_RESULTS:
        if find_spec(name) is None:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def viewer_program() -> str | None:
    """Path of rerun-sdk's viewer program."""
    import shutil

    return shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")


_OFFER = re.compile(r"^from (?P<home>[\w.]+) import (?:(?P<name>\w+) as (?P=name)|\*)$", re.MULTILINE)


def homes(stub: Path) -> dict[str, str]:
    """Modules of the names in a stub file."""
    offered: dict[str, str] = {}
    for offer in _OFFER.finditer(stub.read_text(encoding="utf-8")):
        if offer["name"]:
            offered[offer["name"]] = offer["home"]
        else:
            offered |= homes(stub.parent / offer["home"].rpartition(".")[2] / stub.name)
    return offered


def elsewhere(package: str, name: str) -> str:
    """Words on the folder of a package that has a name, if one does."""
    stubs = Path(str(modules[package].__file__)).parent.glob("*/__init__.pyi")
    places = [f"{package}.{stub.parent.name}.{name}" for stub in sorted(stubs) if name in homes(stub)]
    return f"; there is {' and '.join(places)}" if places else ""


def imported_lazily(package: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """`__all__`, `__getattr__` and `__dir__` of a lazy package."""
    home_of = homes(Path(str(modules[package].__file__)).with_suffix(".pyi"))

    def found(name: str) -> Any:
        if name not in home_of:
            if not name.startswith("_") and find_spec(f"{package}.{name}"):
                return import_module(f"{package}.{name}")
            guess = suggested_name(name, home_of) or elsewhere(package, name)
            missing = f"module {package!r} has no attribute {name!r}{guess}"
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
