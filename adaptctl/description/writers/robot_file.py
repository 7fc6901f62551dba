"""Writer of a robot's own file with other inertias, by the file's suffix."""

from __future__ import annotations

import warnings
from pathlib import Path

from adaptctl.description.description import Description
from adaptctl.description.readers.registry import read
from adaptctl.description.writers.mjcf_inertials import write_mjcf
from adaptctl.description.writers.urdf_inertials import write_urdf
from adaptctl.errors import FileError, InputError


def write_robot(path: str | Path, original: str | Path, after: Description, root: str | None = None) -> None:
    """Write to `path` a copy of the URDF or MJCF file `original` with the links' inertias of the description `after`;
    all else stays, byte for byte. `root` names the body of an MJCF scene that the mechanism begins with, None for the
    one root body that moves.

    Raises `InputError` for a file of another suffix than .urdf, .xml and .mjcf, and for a `root` of a URDF file,
    `FileError` where a file cannot be read or written, where the original holds another mechanism than `after`
    describes (joints, frames or names differ), and where its format cannot hold an inertia.
    """
    suffix = Path(original).suffix.lower()
    if suffix not in (".urdf", ".xml", ".mjcf"):
        raise InputError(f"{original}: inertias are written into URDF and MJCF files, got {suffix!r}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # as when it was first read
        before = read(original, root=root)
    if before.geometry_sha256 != after.geometry_sha256:
        raise FileError(f"{original}: it is not the file of {after.name}: its joints, frames or names are others")
    if suffix == ".urdf":
        write_urdf(path, original, before, after)
    else:
        write_mjcf(path, original, before, after, root)
