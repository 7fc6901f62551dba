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
    """The mechanism that a saved basis belongs to."""

    name: str
    geometry_sha256: str


class BasisFile(msgspec.Struct, forbid_unknown_fields=True):
    """The content of a saved basis.

    `regrouping` names, for every kept parameter, what is added to it, with factors in SI units; parameters over
    `scales` are comparable.
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
        """The content of a file. Raises `FileError` naming the element that is wrong."""
        content = read_json(path, cls, MOST_BYTES)
        if fault := content._fault():
            raise FileError(f"{path}: {fault}")
        return content

    def write(self, path: str | Path) -> None:
        """Write the content as JSON, whole or not at all."""
        write_json(path, self)

    @property
    def columns(self) -> tuple[int, ...]:
        """Indices (k,) of the kept parameters."""
        place = {name: i for i, name in enumerate(self.parameters)}
        return tuple(place[name] for name in self.regrouping)

    @property
    def matrix(self) -> Array:
        """The regrouping matrix K (k, P)."""
        place = {name: i for i, name in enumerate(self.parameters)}
        K = np.zeros((len(self.regrouping), len(place)))
        for i, (kept, row) in enumerate(self.regrouping.items()):
            K[i, [place[name] for name in row]] = list(row.values())
            K[i, place[kept]] = 1.0
        return K

    @staticmethod
    def rows(matrix: Array, columns: tuple[int, ...], names: tuple[str, ...]) -> dict[str, dict[str, float]]:
        """The entry `regrouping` of a matrix K (k, P) that keeps columns (k,) of parameters of these names (P,)."""
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
