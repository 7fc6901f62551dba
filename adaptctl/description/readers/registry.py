"""A mechanism from a built-in's name or from a file."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from difflib import get_close_matches
from importlib.resources import as_file, files
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.description.readers.denavit_hartenberg import SCHEMA as DENAVIT_HARTENBERG
from adaptctl.description.readers.denavit_hartenberg import read_denavit_hartenberg
from adaptctl.description.transforms.snapping import snapped
from adaptctl.errors import FileError, InputError, NotFoundError, PhysicalConsistencyWarning
from adaptctl.files import read_toml

Reader = Callable[[str | Path], Description]


class _Head(msgspec.Struct):
    """What every TOML file of a mechanism begins with."""

    schema: Literal["adaptctl/denavit-hartenberg/1", "adaptctl/mechanism/1"]


def read_toml_mechanism(path: str | Path) -> Description:
    """The mechanism of a TOML file, read by the schema that it names. Raises FileError."""
    if read_toml(path, _Head).schema == DENAVIT_HARTENBERG:
        return read_denavit_hartenberg(path)
    from adaptctl.description.readers.mechanism_file import (
        read_mechanism_file,  # readers of other kinds when a file needs them
    )

    return read_mechanism_file(path)


def _read_urdf(path: str | Path, *, floating_base: bool = False) -> Description:
    from adaptctl.description.readers.urdf import read_urdf

    return read_urdf(path, floating_base=floating_base)


def _read_mjcf(path: str | Path) -> Description:
    from adaptctl.description.readers.mjcf import read_mjcf

    return read_mjcf(path)


_READERS: dict[str, Reader] = {
    ".toml": read_toml_mechanism,
    ".urdf": _read_urdf,
    ".xml": _read_mjcf,
    ".mjcf": _read_mjcf,
}
_ROBOTS = files("adaptctl.description") / "robots"

_ASSIGNED = {
    "puma560": "Table 6 of Sheu and Walker (1991) is no physical set: use puma560_measured for physics",
    "puma560_arm3": "Table 6 of Sheu and Walker (1991) is no physical set",
}


def builtin_names() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    return tuple(
        sorted(entry.name.removesuffix(".toml") for entry in _ROBOTS.iterdir() if entry.name.endswith(".toml"))
    )


def read(source: str | Path, *, floating_base: bool = False, snap: bool = False) -> Description:
    """The mechanism of a built-in's name or of a file, which is read by its suffix.

    With `floating_base`, a URDF file's root link floats instead of being fixed to the ground (`floating`). With
    `snap`, angles within 1e-3 rad of right ones are made exact (`snapped`).
    Raises NotFoundError for a name that is neither, FileError for a file that cannot be used.
    Warns (PhysicalConsistencyWarning) of links that no rigid body can be.
    """
    if floating_base:
        description, remark = _read_floating(source), ""
    elif isinstance(source, str) and source in builtin_names():
        with as_file(_ROBOTS / f"{source}.toml") as path:
            description = read_toml_mechanism(path)
        remark = _ASSIGNED.get(source, "")
    else:
        description, remark = _reader(source)(source), ""
    _warn_of_inconsistency(description, remark)
    return snapped(description) if snap else description


def _read_floating(source: str | Path) -> Description:
    if Path(source).suffix.lower() != ".urdf":
        raise InputError(f"{source}: only a URDF file, which has a root link, can be given a floating base")
    return _read_urdf(source, floating_base=True)


def _reader(source: str | Path) -> Reader:
    path = Path(source)
    if path.suffix.lower() in _READERS:
        return _READERS[path.suffix.lower()]
    suffixes = ", ".join(_READERS)
    if path.suffix:
        raise FileError(f"{source}: unknown kind of file {path.suffix!r}; files that are read: {suffixes}")
    if str(source) and path.exists():
        raise FileError(f"{source}: a file's suffix says how to read it; files that are read: {suffixes}")
    close = get_close_matches(str(source).lower(), builtin_names(), n=1)
    guess = f" (did you mean {close[0]!r}?)" if close else ""
    known = ", ".join(builtin_names())
    raise NotFoundError(f"unknown robot {str(source)!r}{guess}; built-in: {known}; or a path to a file: {suffixes}")


def _warn_of_inconsistency(description: Description, remark: str) -> None:
    names = [link.name for link in description.links if _is_impossible(link.inertia)]
    if names:
        text = f"{description.name}: no rigid body has the inertial parameters of {', '.join(names)}"
        warnings.warn(f"{text}. {remark}".removesuffix(". "), PhysicalConsistencyWarning, stacklevel=3)


def _is_impossible(ten: Array) -> bool:
    """Whether not even a body shrunk to rods, points or nothing has these ten: real files hold such bodies."""
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(ten))
    return bool(eigenvalues[0] < -1e-12 * eigenvalues[-1])
