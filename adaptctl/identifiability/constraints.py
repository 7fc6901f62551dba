"""What a user knows of inertial parameters beforehand: values, and linear relations among them.

Sheu and Walker (1991), section 5.3: three relations that decouple the arm's inertia make 26 parameters into 23.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from adaptctl.errors import FileError, InputError
from adaptctl.files import read_toml

MOST = 1000
"""relations in one file"""


@dataclass(frozen=True, eq=False)
class Relation:
    """A linear relation: sum of weight times parameter = value, in SI units."""

    weights: Mapping[str, float]
    value: float = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", MappingProxyType(dict(self.weights)))
        numbers = [*self.weights.values(), self.value]
        if not any(self.weights.values()) or not all(np.isfinite(number) for number in numbers):
            raise InputError(f"{self}: expected finite weights, one of them at least not zero, and a finite value")

    def __str__(self) -> str:
        terms = " + ".join(f"{weight:g} {name}" for name, weight in list(self.weights.items())[:4])
        return f"relation {self.name!r}" if self.name else f"relation {terms} = {self.value:g}"


@dataclass(frozen=True, eq=False)
class Constraints:
    """Known values of parameters by name, and linear relations among parameters."""

    known: Mapping[str, float] = field(default_factory=dict)
    relations: tuple[Relation, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "known", MappingProxyType(dict(self.known)))
        object.__setattr__(self, "relations", tuple(self.relations))

    @classmethod
    def of(cls, matrix: ArrayLike, names: Sequence[str], values: ArrayLike | None = None) -> Constraints:
        """The relations matrix D = values, a row each, among parameters of these names; values zero if not given."""
        rows = np.atleast_2d(np.asarray(matrix, dtype=np.float64))
        right = np.zeros(len(rows)) if values is None else np.asarray(values, dtype=np.float64)
        if rows.shape[1] != len(names) or right.shape != (len(rows),):
            raise InputError(
                f"relations: expected a matrix (m, {len(names)}) and values (m,), got {rows.shape} and {right.shape}"
            )
        pairs = zip(rows, right.tolist(), strict=True)
        return cls(
            relations=tuple(
                Relation({names[j]: float(row[j]) for j in np.flatnonzero(row).tolist()}, value, f"row {i + 1}")
                for i, (row, value) in enumerate(pairs)
            )
        )

    @classmethod
    def read(cls, path: str | Path) -> Constraints:
        """The constraints that a TOML file states, by parameter::

            schema = "adaptctl/parameter-constraints/1"

            [known]
            link2.mc_z = 0.0

            [[relations]]
            name = "equal forks"
            weights = { link4.m = 1.0, link5.m = -1.0 }
            value = 0.0

        Raises `FileError`.
        """
        content = read_toml(path, _ConstraintsFile)
        try:
            relations = [Relation(_flat(r.weights), r.value, r.name) for r in content.relations]
            return cls(_flat(content.known), tuple(relations))
        except InputError as error:
            raise FileError(f"{path}: {error}") from error

    @property
    def every(self) -> tuple[Relation, ...]:
        """Known values as relations, then the relations."""
        known = (Relation({name: 1.0}, value, f"{name} = {value:g}") for name, value in self.known.items())
        return (*known, *self.relations)


_Nested = dict[str, float | dict[str, float]]


class _RelationEntry(msgspec.Struct, forbid_unknown_fields=True):
    weights: _Nested
    value: float = 0.0
    name: str = ""


class _ConstraintsFile(msgspec.Struct, forbid_unknown_fields=True):
    schema: Literal["adaptctl/parameter-constraints/1"]
    known: _Nested = {}
    relations: Annotated[list[_RelationEntry], msgspec.Meta(max_length=MOST)] = []


def _flat(nested: _Nested) -> dict[str, float]:
    """TOML reads link4.m without quotes as a table within a table."""
    out: dict[str, float] = {}
    for name, value in nested.items():
        out |= {f"{name}.{kind}": x for kind, x in value.items()} if isinstance(value, dict) else {name: value}
    return out
