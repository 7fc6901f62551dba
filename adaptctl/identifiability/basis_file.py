"""File of a fundamental basis: its names, scales and regrouping."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import FileError
from adaptctl.files import hashed, read_json, write_json

# Size of a file that is read, and parameters in it: 256 links, all with rotors, have 2,816.
MAX_BYTES, MAX_PARAMETERS = 8 * 2**20, 4_000


class Robot(msgspec.Struct, forbid_unknown_fields=True):
    """Mechanism of a saved basis: its name, and the hash of its geometry."""

    name: str
    geometry_sha256: str


class BasisFile(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """Content of a basis file (JSON)."""

    schema: Literal["adaptctl/fundamental-basis/2"]
    robot: Robot
    rank: int
    gap: float
    parameters: Annotated[list[str], msgspec.Meta(max_length=MAX_PARAMETERS)]
    scales: list[float]
    regrouping: dict[str, dict[str, float]]
    sha256: str = ""
    kept_despite_priority: list[str] = []

    @classmethod
    def read(cls, path: str | Path) -> BasisFile:
        """Read the content of a basis file."""
        content = read_json(path, cls, MAX_BYTES)
        if fault := content._fault():
            raise FileError(f"{path}: {fault}")
        return content

    def write(self, path: str | Path) -> None:
        """Write the content and its hash to a file, atomically."""
        write_json(path, msgspec.structs.replace(self, sha256=self._hash))

    @property
    def _hash(self) -> str:
        content = msgspec.to_builtins(self)
        return hashed({name: value for name, value in content.items() if name not in ("schema", "sha256")})

    @property
    def columns(self) -> tuple[int, ...]:
        """Indices (k,) of the kept parameters."""
        place = {name: i for i, name in enumerate(self.parameters)}
        return tuple(place[name] for name in self.regrouping)

    @property
    def matrix(self) -> Array:
        """Regrouping matrix K (k, P) in SI units."""
        place = {name: i for i, name in enumerate(self.parameters)}
        K = np.zeros((len(self.regrouping), len(place)))
        for i, (kept, row) in enumerate(self.regrouping.items()):
            K[i, [place[name] for name in row]] = list(row.values())
            K[i, place[kept]] = 1.0
        return K

    @staticmethod
    def rows(matrix: Array, columns: tuple[int, ...], names: tuple[str, ...]) -> dict[str, dict[str, float]]:
        """Return the entry `regrouping` for K (k, P), without zeros."""
        pairs = zip(columns, matrix, strict=True)
        return {names[i]: {names[j]: float(row[j]) for j in np.flatnonzero(row) if j != i} for i, row in pairs}

    def _fault(self) -> str:
        known = set(self.parameters)
        if len(known) < len(self.parameters):
            return "`$.parameters`: a name is given more than once"
        if not self.gap > 0.0:
            return f"`$.gap`: expected a positive number, got {self.gap}"
        if len(self.scales) != len(self.parameters) or not all(scale > 0.0 for scale in self.scales):
            return f"`$.scales`: expected {len(self.parameters)} positive numbers, one per parameter"
        if self.rank != len(self.regrouping):
            return f"`$.rank` is {self.rank}, but `$.regrouping` keeps {len(self.regrouping)} parameters"
        for name in self.kept_despite_priority:
            if name not in self.regrouping:
                return f"`$.kept_despite_priority`: {name!r} is not kept in `$.regrouping`"
        for kept, row in self.regrouping.items():
            for name in (kept, *row):
                if name not in known:
                    return f"`$.regrouping.{kept}`: {name!r} is not in `$.parameters`"
            if not row.keys().isdisjoint(self.regrouping):
                return f"`$.regrouping.{kept}`: kept parameters cannot be regrouped into each other"
        if self.sha256 != self._hash:
            return f'the basis was changed; to accept it, write "sha256": "{self._hash}"'
        return ""
