"""Readers of files by suffix and schema, and built-in robots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from itertools import islice
from pathlib import Path

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.errors import (
    FileError,
    InputError,
    NotFoundError,
    PhysicalConsistencyWarning,
    SimplificationWarning,
    shown,
    suggested_name,
    warn,
)
from adaptctl.files import MAX_LISTED, read_toml

Reader = Callable[..., Description]

READERS = {
    ".toml": "registry:read_toml_mechanism",
    ".urdf": "urdf:read_urdf",
    ".xml": "mjcf:read_mjcf",
    ".mjcf": "mjcf:read_mjcf",
}
"""Suffixes of files and their readers, as `module:function` in this folder, imported when a file needs them."""
MJCF = tuple(suffix for suffix, reader in READERS.items() if reader.startswith("mjcf:"))
SCHEMAS = {
    "adaptctl/denavit-hartenberg/1": "denavit_hartenberg:read_denavit_hartenberg",
    "adaptctl/mechanism/1": "mechanism_file:read_mechanism_file",
}
"""The same for TOML files, by the schema that they name."""

_ROBOTS = Path(__file__).parent.parent / "robots"

_ASSIGNED = {
    "puma560": "Table 6 of Sheu and Walker (1991) is not physically consistent: use puma560_measured instead",
    "puma560_arm3": "Table 6 of Sheu and Walker (1991) is not physically consistent",
}


def builtin_names() -> tuple[str, ...]:
    """
    Return the names of the robots that come with adaptctl.

    Returns
    -------
    tuple of str
        Names in alphabetical order, which `read` and `adaptctl.load` accept.

    Examples
    --------
    >>> from adaptctl.description import builtin_names
    >>> "puma560" in builtin_names()
    True
    """
    return tuple(sorted(path.stem for path in _ROBOTS.iterdir()))


def builtin_file(name: str) -> Path:
    """
    Return the file of a robot that comes with adaptctl, a template for one's own.

    Parameters
    ----------
    name : str
        Name of a built-in robot, see `builtin_names`.

    Returns
    -------
    Path
        File in the installed package, .toml or .xml.

    Raises
    ------
    NotFoundError
        If no robot has this name.

    Examples
    --------
    >>> from adaptctl.description import builtin_file
    >>> builtin_file("two_link").name
    'two_link.toml'
    """
    if name not in builtin_names():
        known = ", ".join(builtin_names())
        raise NotFoundError(f"unknown robot {name!r}{suggested_name(name.lower(), builtin_names())}; built-in: {known}")
    return next(_ROBOTS.glob(f"{name}.*"))


class _Head(msgspec.Struct):
    """Field that every TOML file of a mechanism has."""

    schema: str


def read_toml_mechanism(path: str | Path) -> Description:
    """Description of the mechanism in a TOML file, by its `schema`."""
    schema = read_toml(path, _Head).schema
    if schema not in SCHEMAS:
        known = ", ".join(map(repr, SCHEMAS))
        raise FileError(f"{path}: Invalid schema {schema!r} - at `$.schema`; expected one of {known}")
    return _imported(SCHEMAS[schema])(path)


def read(
    source: str | Path,
    *,
    floating_base: bool = False,
    mesh_folders: Sequence[str | Path] = (),
    root: str | None = None,
) -> Description:
    """
    Read a mechanism's description, by the name of a built-in robot or from a file.

    Parameters
    ----------
    source : str or Path
        Name of a built-in robot (see `builtin_names`), or a file: .toml, .urdf, or MJCF as .xml or .mjcf.
    floating_base : bool, default False
        If true, the base floats on six joints: the root link of a URDF file, the root body of an MJCF file. By default
        it is held still, whatever the file says.
    mesh_folders : sequence of str or Path, optional
        Folders with meshes of a URDF file. Default: none besides its own package.
    root : str, optional
        Name of the body of an MJCF scene at which the mechanism begins. Default: the only root body that moves.

    Returns
    -------
    Description
        The mechanism as data.

    Raises
    ------
    NotFoundError
        If the name is unknown.
    FileError
        If a file cannot be read or its contents are wrong.
    InputError
        If an option does not go with the source.
    MissingExtraError
        If the file is MJCF and MuJoCo is not installed.

    Warns
    -----
    PhysicalConsistencyWarning
        If a link has an inertia that no rigid body can have.
    SimplificationWarning
        If a part is left out (springs, tendons, meshes), read otherwise (limits of zero, mimic joints without a leader)
        or doubtful (angles like degrees, links without mass).

    Examples
    --------
    >>> from adaptctl.description import read
    >>> read("puma560_measured")
    <Description 'puma560_measured': 6 links>
    """
    known = isinstance(source, str) and source in builtin_names()
    path = builtin_file(str(source)) if known else source
    suffix = Path(path).suffix.lower()
    if floating_base and suffix not in (".urdf", *MJCF):
        raise InputError(
            f"{source}: floating_base: only for URDF and MJCF files, whose bases have inertias; for others, "
            "with_floating_base(description, name, inertia) makes one in Python"
        )
    if isinstance(mesh_folders, str | Path):
        raise InputError(f"{source}: mesh_folders: expected a list of folders, got {str(mesh_folders)!r}")
    if mesh_folders and suffix != ".urdf":
        raise InputError(f"{source}: mesh_folders: only for URDF files, got {mesh_folders!r}")
    if root is not None and suffix not in MJCF:
        raise InputError(f"{source}: root: only for MJCF files, got {root!r}")
    asked = {"floating_base": floating_base, "mesh_folders": mesh_folders, "root": root}
    description = _reader(path)(path, **{name: x for name, x in asked.items() if x})
    if floating_base:
        text = "the base floats: in closed loop it is pushed by six ideal forces that no robot has"
        warn(f"{source}: {text}", SimplificationWarning)
    _warn_of_inconsistency(description, _ASSIGNED.get(str(source), "") if known else "")
    return description


def read_model(
    model: object,
    *,
    floating_base: bool = False,
    mesh_folders: Sequence[str | Path] = (),
    root: str | None = None,
) -> Description:
    """Description of the mechanism in a loaded `model`, a `pinocchio.Model` or a `mujoco.MjModel`."""
    library = type(model).__module__.partition(".")[0]
    if floating_base or mesh_folders:
        raise InputError("floating_base and mesh_folders: only for files, not for a loaded model, whose base is held")
    if library == "pinocchio" and hasattr(model, "njoints"):
        if root is not None:
            raise InputError(f"root: only for MuJoCo models and MJCF files, got {root!r}")
        description = _imported("pinocchio_model:from_pinocchio")(model)
    elif library == "mujoco" and hasattr(model, "nbody"):
        description = _imported("mujoco_model:from_mujoco")(model, root)
    else:
        raise InputError(f"expected a robot's name, a file, a pinocchio.Model or a mujoco.MjModel, got {shown(model)}")
    _warn_of_inconsistency(description, "")
    return description


def _reader(source: str | Path) -> Reader:
    path = Path(source)
    if path.suffix.lower() in READERS:
        return _imported(READERS[path.suffix.lower()])
    suffixes = ", ".join(READERS)
    if str(source) and path.is_dir():
        raise FileError(f"{source}: is a folder; give a robot file{_within(path)} ({suffixes})")
    if path.suffix:
        way = "; expand it: xacro FILE > FILE.urdf" if path.suffix == ".xacro" else ""
        raise FileError(f"{source}: unknown file type {path.suffix!r}; known: {suffixes}{way}")
    if str(source) and path.exists():
        raise FileError(f"{source}: the file name has no suffix; expected one of {suffixes}")
    files = [f"{source}{suffix}" for suffix in READERS if str(source) and Path(f"{source}{suffix}").is_file()]
    guess = f" (did you mean {files[0]!r}?)" if files else suggested_name(str(source).lower(), builtin_names())
    known = ", ".join(builtin_names())
    raise NotFoundError(f"unknown robot {str(source)!r}{guess}; built-in: {known}; or a path to a file: {suffixes}")


def _within(folder: Path) -> str:
    """Example of a file in a folder."""
    files = sorted(str(path) for path in islice(folder.iterdir(), MAX_LISTED) if path.suffix.lower() in READERS)
    return f", such as {files[0]}" if files else ""


def _imported(reader: str) -> Reader:
    module, _, function = reader.partition(":")
    found: Reader = getattr(import_module(f"adaptctl.description.readers.{module}"), function)
    return found


def _warn_of_inconsistency(description: Description, remark: str) -> None:
    names = [link.name for link in description.links if _is_impossible(link.inertia)]
    if names:
        text = f"{description.name}: physically inconsistent inertial parameters of {', '.join(names)}"
        warn(f"{text}. {remark}".removesuffix(". "), PhysicalConsistencyWarning)


def _is_impossible(ten: Array) -> bool:
    """True where not even a body shrunk to rods, points or nothing has these ten."""
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(ten))
    return bool(eigenvalues[0] < -1e-12 * eigenvalues[-1])
