"""A fundamental basis as a JSON file."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import FileError, InputError
from adaptctl.files import read_json, write_json
from adaptctl.identifiability.fundamental_basis import FundamentalBasis


class _Robot(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    geometry_sha256: str


class _BasisFile(msgspec.Struct, forbid_unknown_fields=True):
    """`regrouping` names, for every kept parameter, what is added to it, with factors in SI units; parameters over
    `scales` are comparable."""

    schema: Literal["adaptctl/fundamental-basis/1"]
    robot: _Robot
    rank: int
    gap: float
    parameters: list[str]
    scales: list[float]
    regrouping: dict[str, dict[str, float]]


def write_basis(path: str | Path, basis: FundamentalBasis) -> None:
    """Write a basis whole or not at all."""
    rows = zip(basis.columns, basis.names, basis.regrouping, strict=True)
    added = {name: _added(row, column, basis.parameter_names) for column, name, row in rows}
    content = _BasisFile(
        schema="adaptctl/fundamental-basis/1",
        robot=_Robot(basis.mechanism_name, basis.geometry_sha256),
        rank=basis.rank,
        gap=basis.gap,
        parameters=list(basis.parameter_names),
        scales=basis.scales.tolist(),
        regrouping=added,
    )
    write_json(path, content)


def read_basis(path: str | Path) -> FundamentalBasis:
    """Read a basis; raises `FileError` naming the element that is wrong."""
    content = read_json(path, _BasisFile)
    try:
        return _basis(content)
    except InputError as error:
        raise FileError(f"{path}: {error}") from error


def _added(row: Array, column: int, names: tuple[str, ...]) -> dict[str, float]:
    return {names[j]: float(row[j]) for j in np.flatnonzero(row) if j != column}


def _basis(content: _BasisFile) -> FundamentalBasis:
    if len(set(content.parameters)) < len(content.parameters):
        raise InputError("`$.parameters`: a name is given more than once")
    if content.rank != len(content.regrouping):
        raise InputError(f"`$.rank` is {content.rank}, but `$.regrouping` keeps {len(content.regrouping)} parameters")
    place = {name: i for i, name in enumerate(content.parameters)}
    K = np.zeros((content.rank, len(place)))
    for i, (kept, row) in enumerate(content.regrouping.items()):
        for name in (kept, *row):
            if name not in place:
                raise InputError(f"`$.regrouping.{kept}`: {name!r} is not among `$.parameters`")
        if not row.keys().isdisjoint(content.regrouping):
            raise InputError(f"`$.regrouping.{kept}`: kept parameters are not added to one another")
        K[i, [place[name] for name in row]] = list(row.values())
        K[i, place[kept]] = 1.0
    return FundamentalBasis(
        mechanism_name=content.robot.name,
        geometry_sha256=content.robot.geometry_sha256,
        parameter_names=tuple(content.parameters),
        columns=tuple(place[name] for name in content.regrouping),
        regrouping=K,
        scales=np.array(content.scales),
        gap=content.gap,
    )
