"""A fundamental basis: the parameters that are kept, what is regrouped onto them, and the file that has them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen_array, positive_number
from adaptctl.caching import cached_property
from adaptctl.compilation import object_cache
from adaptctl.errors import FileError, InputError, RankError, printable, validate_kind
from adaptctl.files import read_json, write_json
from adaptctl.identifiability.essential_space import EssentialSpace
from adaptctl.identifiability.priority import Priority, or_default
from adaptctl.identifiability.regrouping import (
    LARGEST_CONDITION,
    TOLERANCE,
    Regrouping,
    condition,
    regrouping_equations,
)
from adaptctl.markup import table, titled

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


@dataclass(frozen=True, eq=False)
class FundamentalBasis:
    """A fundamental basis: the k of P inertial parameters that are kept (base parameters), and the regrouping of the
    others onto them.

    For all positions p, velocities v and accelerations a, Y(p, v, a) D = Y[:, columns] beta, with the torque regressor
    Y (r, P) of r primary (independent) joints, the inertial parameters D (P,) without friction, and the fundamental
    ones beta = K D, K the `regrouping` (k, P) in SI units. It depends on the geometry and gravity only of the mechanism
    called `mechanism_name`, by their SHA-256 hash `geometry_sha256`: its inertial values may change. `parameter_names`
    are P, `columns` (k,) the zero-based indices in ascending order of the kept ones; parameters divided by `scales`
    (P,), positive and in SI units per J, are comparable; `gap`, positive and without a unit, is the ratio of the
    smallest singular value that counts for the rank to the next; `passed_over` names kept parameters that the priority,
    the order of removal, would remove, but that those removed before determine up to the tolerance (none after `load`).
    Raises `InputError` for columns that are no indices in ascending order, columns, regrouping and scales whose shapes
    do not agree, and scales or a gap that are not positive and finite.
    """

    mechanism_name: str
    geometry_sha256: str
    parameter_names: tuple[str, ...]
    columns: tuple[int, ...]
    regrouping: Array
    scales: Array
    gap: float
    """The gap sigma_k/sigma_k+1 of the rank's certificate."""
    kept_despite_priority: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        P, columns = len(self.parameter_names), self.columns
        whole = isinstance(columns, Iterable) and all(isinstance(j, int | np.integer) for j in columns)
        if not whole or list(columns) != sorted(set(columns)) or not all(0 <= j < P for j in columns):
            raise InputError(f"columns: expected rising indices in 0..{P - 1}, got {printable(repr(columns))}")
        K = frozen_array(self.regrouping, (len(columns), P), "regrouping")
        if not np.array_equal(K[:, columns], np.eye(len(columns))):
            raise InputError("regrouping: every kept parameter must count once for itself and for no other")
        scales = frozen_array(self.scales, (P,), "scales")
        if not (scales > 0.0).all():
            raise InputError(f"scales: expected positive numbers, got {scales.min()}")
        positive_number(self.gap, "gap: expected a positive finite number")
        object.__setattr__(self, "regrouping", K)
        object.__setattr__(self, "scales", scales)

    @property
    def rank(self) -> int:
        """The number k of fundamental (base) parameters: the inertial parameters that are kept, others being regrouped
        onto them; friction is not counted."""
        return len(self.columns)

    @cached_property
    def condition(self) -> float:
        """The condition number, without a unit, of the matrix F2' V2 (P-k, P-k), the removed parameters' rows of
        orthonormal null vectors V2 (P, P-k), where k of P parameters, in SI units, are kept (Sheu and Walker 1991,
        equation 25). It is 1 where none is removed; the larger, the more poorly the removed parameters are determined
        by the kept ones."""
        return condition(np.delete(self.regrouping, self.columns, axis=1))

    @cached_property
    def scaled_condition(self) -> float:
        """The condition number, without a unit, of the removed parameters' rows (P-k, P-k) of the orthonormal null
        vectors (P, P-k), where k of P parameters are kept. The null vectors are directions of the parameters divided by
        this object's `scales` (P,), so that it does not depend on units; 1 where none is removed."""
        scaled = self.regrouping * self.scales / self.scales[list(self.columns), None]
        return condition(np.delete(scaled, self.columns, axis=1))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the k kept inertial parameters, such as ``link2.mc_x``, in the order of the fundamental (base)
        parameters; friction is not among them."""
        return tuple(self.parameter_names[j] for j in self.columns)

    def fundamental_parameters(self, parameters: ArrayLike) -> Array:
        """The k fundamental (base) parameters beta = K D (..., k), in the order of this object's `names`, of P inertial
        `parameters` D (..., P), in that of its `parameter_names` (no friction), in SI units; K (k, P) is its
        `regrouping`. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity."""
        return checked(parameters, len(self.parameter_names), "parameters") @ self.regrouping.T

    def equations(self) -> tuple[str, ...]:
        """The regrouping equations, as texts in SI units, one for each of the k kept parameters. A kept parameter's
        name with a star is its fundamental (base) parameter, the sum of itself and of what is regrouped onto it, such
        as ``link2.mc_x* = link2.mc_x + 0.4318 (link3.m + link4.m)``."""
        return regrouping_equations(self.regrouping, self.columns, self.parameter_names)

    def _repr_html_(self) -> str:
        """Notebook's view of the basis: the kept parameters, and those regrouped into them."""
        text = f"{len(self.names)} parameters are kept; a star marks each with what is regrouped into it"
        rows = [equation.partition(" = ")[::2] for equation in map(str, self.equations())]
        return titled("FundamentalBasis", text) + table(("kept", "is"), rows)

    def save(self, path: str | Path) -> None:
        """Write the fundamental (base) basis to the file `path` as JSON, whole or not at all, for `load` to read; its
        `passed_over`, names of parameters kept against the order of removal, is left out. Raises `FileError` where it
        cannot be written."""
        BasisFile(
            schema="adaptctl/fundamental-basis/1",
            robot=Robot(self.mechanism_name, self.geometry_sha256),
            rank=self.rank,
            gap=self.gap,
            parameters=list(self.parameter_names),
            scales=self.scales.tolist(),
            regrouping=BasisFile.rows(self.regrouping, self.columns, self.parameter_names),
        ).write(path)

    @classmethod
    def load(cls, path: str | Path) -> FundamentalBasis:
        """The fundamental (base) basis in the JSON file `path` that `save` wrote. Raises `FileError` when the file
        cannot be read, holds no fundamental basis, or has been damaged."""
        content = BasisFile.read(path)
        try:
            return cls(
                mechanism_name=content.robot.name,
                geometry_sha256=content.robot.geometry_sha256,
                parameter_names=tuple(content.parameters),
                columns=content.columns,
                regrouping=content.matrix,
                scales=np.array(content.scales),
                gap=content.gap,
            )
        except InputError as error:
            raise FileError(f"{path}: {error}") from error


def fundamental_basis(
    space: EssentialSpace, priority: Priority | None = None, *, tolerance: float = TOLERANCE, prove: bool = False
) -> FundamentalBasis:
    """The fundamental basis of an essential `space` (the directions of P inertial parameters that change energies): a
    choice of k of the P parameters that are kept, the others being removed and regrouped onto them. The values of the k
    kept parameters after regrouping, not those before it, are the base parameters. Others are removed in the order of a
    `priority`, the first first.

    A priority of None is the rule of Table 4 in Sheu and Walker (1991): m first, then mc_x, mc_y, mc_z, I_xy, I_xz,
    I_yz, I_xx, I_yy, I_zz, rotor inertias, each from the first link to the last. A parameter is removed where its row
    of the space's `scaled_null_basis` (P, P-k), less its projection on the rows of those removed before, is longer than
    `tolerance` (without a unit, above 0 and below 1/sqrt(P), 1e-3 by default). Where the space has a proof (a rank on
    exact geometry), the kept parameters are also found there; with `prove` it must have one, or `InputError` is raised.

    Raises `RankError` when exact geometry keeps other parameters and the tolerance does not explain it, when the kept
    parameters have another rank than the space, and when the null vectors determine the regrouping too poorly, the
    condition number of the removed parameters' scaled rows being above 1e4: the priority then removes parameters that
    very nearly depend on each other. Raises `InputError` for another tolerance, and for a `priority` that is no
    `Priority`, or whose names are given twice or (`NotFoundError`) unknown.
    """
    validate_kind(space, EssentialSpace, "fundamental_basis", "as essential_space(mechanism) gives one")
    order = or_default(priority).indices(space.parameter_names)
    inputs = [space.search.inputs, [int(j) for j in order], repr(tolerance), bool(prove)]
    chosen = object_cache.kept("fundamental basis", inputs, Chosen, lambda: _chosen(space, order, tolerance, prove))
    return FundamentalBasis(
        mechanism_name=space.mechanism.name,
        geometry_sha256=space.mechanism.geometry_sha256,
        parameter_names=space.parameter_names,
        columns=chosen.columns,
        regrouping=np.reshape(chosen.regrouping, (len(chosen.columns), len(space.parameter_names))),
        scales=np.array(chosen.scales),
        gap=space.certificate.gap,
        kept_despite_priority=chosen.kept_despite_priority,
    )


class Chosen(NamedTuple):
    """Cached choice of a fundamental (base) basis: the k kept ones of P inertial parameters. `columns` (k,) are their
    zero-based indices in ascending order; `regrouping` (k, P), the regrouping matrix in SI units, and `scales` (P,), SI
    units per J, are lists; `passed_over` has the names of kept parameters that the order of removal would remove.
    Nothing is checked."""

    columns: tuple[int, ...]
    regrouping: list[list[float]]
    scales: list[float]
    kept_despite_priority: tuple[str, ...]


def _chosen(space: EssentialSpace, order: Sequence[int], tolerance: float, prove: bool) -> Chosen:
    found = space.null_space.regrouping(order, tolerance)
    _validate_conditioned(space, found)
    passed_over = {*found.kept_despite_priority, *_kept_against_the_order(space, found, order, prove, tolerance)}
    if found.rank != space.rank:
        raise RankError(
            f"{space.mechanism.name}: the kept columns have rank {found.rank}, not {space.rank}; "
            "pass a larger tolerance"
        )
    names = tuple(space.parameter_names[j] for j in sorted(passed_over))
    return Chosen(found.kept, found.matrix(space.scales).tolist(), space.scales.tolist(), names)


def _kept_against_the_order(
    space: EssentialSpace, found: Regrouping, order: Sequence[int], prove: bool, tolerance: float
) -> tuple[int, ...]:
    """Kept parameters that the order removes on exact geometry, looked for wherever there is a proof of the rank.

    Raises `RankError` where more than the tolerance is left of every row that exact geometry removes: floats should
    have removed them too.
    """
    if space.proof is None:
        if prove:
            raise InputError(f"{space.mechanism.name}: to prove the basis, prove the essential space (prove=True)")
        return ()
    if space.proof.keeps(found.kept, order):
        return ()
    exact = set(space.proof.kept(order))
    rows = space.scaled_null_basis[[j for j in order if j not in exact]]
    others = sorted(set(found.kept) - exact)
    if np.abs(np.diag(np.linalg.qr(rows.T, mode="r"))).min(initial=1.0) > tolerance:
        raise RankError(
            f"{space.mechanism.name}: on exact geometry, over {space.proof.method}, this priority removes "
            f"{', '.join(space.parameter_names[j] for j in others[:4])}, and among floats it does not"
        )
    return tuple(others)


def _validate_conditioned(space: EssentialSpace, found: Regrouping) -> None:
    if found.determined:
        return
    weights = np.linalg.svd(found.coefficients)[2][0]
    names = [space.parameter_names[found.removed[i]] for i in np.argsort(-np.abs(weights))[:3]]
    raise RankError(
        f"{space.mechanism.name}: this priority removes parameters that nearly depend on each other, {names[0]} and "
        f"{names[-1]} among them: the condition of F2' V2 is {found.condition:.1e}, at most {LARGEST_CONDITION:.0e} is "
        "allowed; keep one of them longer, or pass a larger tolerance"
    )
