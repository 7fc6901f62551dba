"""Constraints on inertial parameters, known values and linear relations, and mechanisms that keep to them.

Sheu and Walker (1991), section 5.3: three relations that decouple the arm's inertia make 26 parameters into 23.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, numbers, real_number
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.constrained_mechanism import ConstrainedMechanism, Parametrisation
from adaptctl.errors import FileError, InputError, NotFoundError, printable, validate_kind
from adaptctl.files import read_toml
from adaptctl.identifiability.energy_matrix import length_scales
from adaptctl.identifiability.priority import Priority, or_default, suggestion
from adaptctl.identifiability.regrouping import removable
from adaptctl.identifiability.sampling import characteristic_length

MOST = 1000
"""Most relations in one file."""
INDEPENDENT = 1e-9
"""Least part of a relation, relative to its size, that those before it must leave unsaid."""


_Nested = dict[str, float | dict[str, float]]


@dataclass(frozen=True, eq=False)
class Relation:
    """A linear relation among inertial parameters: sum of weight times parameter = `value`, in SI units.

    `weights` are by parameter name, such as ``link4.m``, `value` is 0 by default; `name` is the relation's name in
    messages, its terms where empty. Raises `InputError` for weights that are no mapping or all zero, and for weights or
    a value that are no numbers or not finite.
    """

    weights: Mapping[str, float]
    value: float = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        what = f"relation {self.name!r}" if self.name else "relation"
        _validate_by_name(self.weights, f"{what}: weights")
        weights = {name: real_number(weight, f"{what}: weight of {name!r}") for name, weight in self.weights.items()}
        object.__setattr__(self, "weights", MappingProxyType(weights))
        object.__setattr__(self, "value", real_number(self.value, f"{what}: value"))
        if not any(weights.values()) or not np.isfinite([*weights.values(), self.value]).all():
            raise InputError(f"{self}: expected finite weights, one of them at least not zero, and a finite value")

    def __str__(self) -> str:
        terms = " + ".join(f"{weight:g} {name}" for name, weight in list(self.weights.items())[:4])
        return f"relation {self.name!r}" if self.name else f"relation {terms} = {self.value:g}"


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints on inertial parameters: `known` values in SI units by parameter name, such as ``link2.mc_z``, and
    linear `relations` among them; both are empty by default. The function `constrained` checks both against a
    mechanism. Raises `InputError` unless `known` is a mapping from names to numbers and `relations` holds `Relation`
    objects."""

    known: Mapping[str, float] = field(default_factory=dict)
    relations: tuple[Relation, ...] = ()

    def __post_init__(self) -> None:
        _validate_by_name(self.known, "known")
        known = {name: real_number(value, f"known: {name!r}") for name, value in self.known.items()}
        object.__setattr__(self, "known", MappingProxyType(known))
        if not isinstance(self.relations, Iterable):
            raise InputError(f"relations: expected Relations, got {printable(repr(self.relations))}")
        object.__setattr__(self, "relations", tuple(self.relations))
        if odd := [relation for relation in self.relations if not isinstance(relation, Relation)]:
            raise InputError(f"relations: expected Relations, got {printable(repr(odd[0]))}")

    @classmethod
    def of(cls, matrix: ArrayLike, names: Sequence[str], values: ArrayLike | None = None) -> Constraints:
        """The constraints that a matrix states on n inertial parameters D (n,) of these `names`: `matrix` times D =
        `values`, a relation for each of its m rows.

        `matrix` is (m, n), or (n,) for one row; `values` (m,), None for zeros; D in SI units; `names` (n,), each once,
        such as ``link4.m``. Raises `InputError` for other shapes, names given twice, values that are not finite, and a
        row of zeros.
        """
        rows = np.atleast_2d(numbers(matrix, "relations: matrix"))
        right = np.zeros(len(rows)) if values is None else numbers(values, "relations: values")
        if twice := [name for name in names if list(names).count(name) > 1]:
            raise InputError(f"relations: names: expected each once, got {twice[0]!r} more often")
        if rows.shape[1:] != (len(names),) or right.shape != (len(rows),):
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
        """The linear equality constraints on inertial parameters that the TOML file at `path` states, a `Constraints`.
        The table `[known]` fixes parameters, by name, at values in SI units; each table `[[relations]]` sets the sum of
        weight times parameter to a value::

            schema = "adaptctl/parameter-constraints/1"

            [known]
            link2.mc_z = 0.0

            [[relations]]
            name = "equal forks"
            weights = { link4.m = 1.0, link5.m = -1.0 }
            value = 0.0

        Both tables, `name` and `value` (0 by default) may be left out. Raises `FileError` for a file that cannot be
        read, or naming the element that is wrong.
        """
        content = read_toml(path, _ConstraintsFile)
        try:
            relations = [Relation(_flat(r.weights), r.value, r.name) for r in content.relations]
            return cls(_flat(content.known), tuple(relations))
        except InputError as error:
            raise FileError(f"{path}: {error}") from error

    @property
    def every(self) -> tuple[Relation, ...]:
        """All constraints as relations (sum of weight times parameter = value): the known values, each with weight 1,
        then the relations. Raises `InputError` for a known value that is not finite."""
        known = (Relation({name: 1.0}, value, f"{name} = {value:g}") for name, value in self.known.items())
        return (*known, *self.relations)


def constrained(
    mechanism: Mechanism, constraints: Constraints, priority: Priority | None = None
) -> ConstrainedMechanism:
    """A mechanism in the inertial parameters that `constraints` leave free: each constraint takes one parameter away,
    whose value follows from the others'.

    The parameter taken away is the one that the `priority`, an order of removal, would remove first and that no other
    constraint has taken. None is the rule of Table 4 in Sheu and Walker (1991): m first, then mc_x, mc_y, mc_z, I_xy,
    I_xz, I_yz, I_xx, I_yy, I_zz, rotor inertias, each from the first link to the last. Essential space, fundamental
    (base) parameters, reduced model and controllers that are made from the result keep to the constraints, and need not
    know of them. The mechanism's own values of parameters taken away are replaced by those that the constraints give.

    Raises `InputError` for `constraints` of another type, naming a relation that contradicts those before it (one that
    follows from them is left out), for a known value that is not finite, a `priority` that is no `Priority` or names a
    parameter twice, and a mechanism that is constrained already. Raises `NotFoundError` for a parameter, of constraints
    or priority, that the mechanism does not have, or that is friction.
    """
    validate_kind(mechanism, Mechanism, "constrained", "as load(...) gives one")
    validate_kind(constraints, Constraints, "constrained", "as Constraints({...}) is one")
    names = mechanism.parameter_names[: mechanism.num_energy_parameters]
    A, b = _system(constraints.every, names)
    scales = length_scales(names, characteristic_length(mechanism))
    kept = _independent(constraints.every, A * scales, b)
    order = or_default(priority).indices(names)
    return ConstrainedMechanism(mechanism, _parametrisation(A[kept] * scales, b[kept], scales, order, mechanism))


def _validate_by_name(given: object, what: str) -> None:
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        raise InputError(f"{what}: expected a mapping from parameters' names to numbers, got {printable(repr(given))}")


def _parametrisation(A: Array, b: Array, scales: Array, order: Sequence[int], mechanism: Mechanism) -> Parametrisation:
    """The solution of scaled relations A x = b, x = D / scales, for the first independent parameters in the order."""
    P, directions = len(mechanism.parameter_names), np.linalg.qr(A.T)[0]
    gone = removable(directions, order, 1e-3 / np.sqrt(len(order))) if len(A) else ()
    taken = set(gone)
    left = tuple(i for i in range(P) if i not in taken)
    inside = [i for i in left if i < len(scales)]
    solved = np.linalg.solve(A[:, list(gone)], np.column_stack([-A[:, inside], b]))
    solved[np.abs(solved) < 1e-12] = 0.0
    N, known = np.zeros((P, len(left))), np.zeros(P)
    N[list(left), range(len(left))] = 1.0
    rows = scales[list(gone)]
    N[np.ix_(list(gone), [left.index(i) for i in inside])] = solved[:, :-1] * rows[:, None] / scales[inside]
    known[list(gone)] = solved[:, -1] * rows
    return Parametrisation(left, N, known)


def _system(relations: Sequence[Relation], names: Sequence[str]) -> tuple[Array, Array]:
    place = {name: i for i, name in enumerate(names)}
    A = np.zeros((len(relations), len(names)))
    for row, relation in zip(A, relations, strict=True):
        for name, weight in relation.weights.items():
            if name not in place:
                raise NotFoundError(f"{relation}: there is no inertial parameter {name!r}; {suggestion(name, names)}")
            row[place[name]] = weight
    return A, np.array([relation.value for relation in relations])


def _independent(relations: Sequence[Relation], A: Array, b: Array) -> list[int]:
    """Indices of relations that do not follow from those before them. Raises `InputError` for a contradiction."""
    kept: list[int] = []
    for i, row in enumerate(A):
        size = np.linalg.norm(row)
        if kept:
            mix, *_ = np.linalg.lstsq(A[kept].T, row, rcond=None)
            beside = np.linalg.norm(row - mix @ A[kept])
            if beside <= INDEPENDENT * size:
                if abs(mix @ b[kept] - b[i]) > INDEPENDENT * max(np.abs(b).max(), size):
                    raise InputError(f"{relations[i]} contradicts those before it: they make it {mix @ b[kept]:g}")
                continue
        kept.append(i)
    return kept


class _RelationEntry(msgspec.Struct, forbid_unknown_fields=True):
    weights: _Nested
    value: float = 0.0
    name: str = ""


class _ConstraintsFile(msgspec.Struct, forbid_unknown_fields=True):
    schema: Literal["adaptctl/parameter-constraints/1"]
    known: _Nested = {}
    relations: Annotated[list[_RelationEntry], msgspec.Meta(max_length=MOST)] = []


def _flat(nested: _Nested) -> dict[str, float]:
    """Numbers by full name; TOML reads link4.m without quotes as a table within a table."""
    out: dict[str, float] = {}
    for name, value in nested.items():
        inner = {f"{name}.{kind}": x for kind, x in value.items()} if isinstance(value, dict) else {name: value}
        if twice := sorted(inner.keys() & out.keys()):
            raise InputError(f"{twice[0]!r} is given twice, with quotes and without: keep one")
        out |= inner
    return out
