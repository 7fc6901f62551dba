"""The JSON file of a fundamental basis."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import FileError
from adaptctl.files import read_json, write_json

MOST_BYTES, MOST_PARAMETERS = 8 * 2**20, 4_000
"""Size of a file that is read, and parameters in it: 256 links, all with rotors, have 2,816."""


class Robot(msgspec.Struct, forbid_unknown_fields=True):
    """The mechanism for which a saved fundamental (base) basis was found: its `name`, and `geometry_sha256`, the
    hexadecimal SHA-256 hash of the data that decide the basis (gravity, joints, frames, link names, loops, drive terms
    and constraints, but no parameters' values). Nothing is checked at construction."""

    name: str
    geometry_sha256: str


class BasisFile(msgspec.Struct, forbid_unknown_fields=True):
    """The content of the JSON file of a fundamental (base) basis, which keeps k of P inertial parameters and regroups
    the others onto them.

    `schema` is the file format's name, `robot` the mechanism; `rank` is k; `gap`, positive and without a unit, the
    ratio of the smallest singular value that counts for the rank to the next. `parameters` are the names of all P, at
    most 4000, such as ``link3.m``; `scales` are P positive numbers in SI units per J: parameters divided by these are
    comparable. `regrouping` has for each kept parameter, by name, the removed ones that are added to it, by name, with
    their coefficients in SI units. Nothing is checked at construction; the method `read` checks.
    """

    schema: Literal["adaptctl/fundamental-basis/1"]
    robot: Robot
    rank: int
    gap: float
    parameters: Annotated[list[str], msgspec.Meta(max_length=MOST_PARAMETERS)]
    scales: list[float]
    regrouping: dict[str, dict[str, float]]

    @classmethod
    def read(cls, path: str | Path) -> BasisFile:
        """The content of the JSON file of a fundamental (base) basis at `path`. Raises `FileError` when the file cannot
        be read or is above 8 MiB, and, naming the element, where one is wrong or contradicts another."""
        content = read_json(path, cls, MOST_BYTES)
        if fault := content._fault():
            raise FileError(f"{path}: {fault}")
        return content

    def write(self, path: str | Path) -> None:
        """Write the content of a saved fundamental (base) basis to the file `path` as JSON, whole or not at all. Raises
        `FileError` where it cannot be written, and for numbers that are NaN or infinite."""
        write_json(path, self)

    @property
    def columns(self) -> tuple[int, ...]:
        """Zero-based indices (k,) of the k kept parameters among all P that the file of a fundamental (base) basis
        names, in the order of its `regrouping`. Raises `KeyError` for a kept name that is not among them, which `read`
        excludes."""
        place = {name: i for i, name in enumerate(self.parameters)}
        return tuple(place[name] for name in self.regrouping)

    @property
    def matrix(self) -> Array:
        """The regrouping matrix K (k, P) of a saved fundamental (base) basis, in SI units, which maps all P inertial
        parameters to the k fundamental ones. Rows follow the file's `regrouping`, columns its `parameters`. Raises
        `KeyError` for a name that is not among them, which `read` excludes."""
        place = {name: i for i, name in enumerate(self.parameters)}
        K = np.zeros((len(self.regrouping), len(place)))
        for i, (kept, row) in enumerate(self.regrouping.items()):
            K[i, [place[name] for name in row]] = list(row.values())
            K[i, place[kept]] = 1.0
        return K

    @staticmethod
    def rows(matrix: Array, columns: tuple[int, ...], names: tuple[str, ...]) -> dict[str, dict[str, float]]:
        """The entry `regrouping` of a basis file, {kept name: {removed name: coefficient}}, for a regrouping `matrix` K
        (k, P) in SI units, which maps all P inertial parameters to the k fundamental (base) ones. `columns` (k,) are
        the zero-based indices of the kept parameters, `names` (P,) the names of all. Coefficients of 0 are left out.
        Raises `ValueError` unless there are as many columns as rows of K."""
        pairs = zip(columns, matrix, strict=True)
        return {names[i]: {names[j]: float(row[j]) for j in np.flatnonzero(row) if j != i} for i, row in pairs}

    def _fault(self) -> str:
        """The first contradiction among the elements; empty where there is none."""
        known = set(self.parameters)
        if len(known) < len(self.parameters):
            return "`$.parameters`: a name is given more than once"
        if not self.gap > 0.0:
            return f"`$.gap`: expected a positive number, got {self.gap}"
        if len(self.scales) != len(self.parameters) or not all(scale > 0.0 for scale in self.scales):
            return f"`$.scales`: expected {len(self.parameters)} positive numbers, one a parameter"
        if self.rank != len(self.regrouping):
            return f"`$.rank` is {self.rank}, but `$.regrouping` keeps {len(self.regrouping)} parameters"
        for kept, row in self.regrouping.items():
            for name in (kept, *row):
                if name not in known:
                    return f"`$.regrouping.{kept}`: {name!r} is not among `$.parameters`"
            if not row.keys().isdisjoint(self.regrouping):
                return f"`$.regrouping.{kept}`: kept parameters are not added to one another"
        return ""
