"""Linear constraints on inertial parameters (Sheu and Walker 1991, section 5.3)."""

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

# Most relations in one file.
MAX_RELATIONS = 1000
# Least part of a relation, relative to its size, that those before it must leave unsaid.
MIN_INDEPENDENT_PART = 1e-9


_Nested = dict[str, float | dict[str, float]]


@dataclass(frozen=True, eq=False)
class Relation:
    """
    Linear relation: the sum of weight times parameter equals a value.

    Parameters
    ----------
    weights : mapping of str to float
        Weights by parameter name, such as ``link4.m``.
    value : float, default 0.0
        Sum in the SI unit of the terms; zero by default, for parameters in fixed proportions.
    name : str, default ""
        Name in messages; by default empty, and messages state the terms.

    Raises
    ------
    InputError
        If weights are no mapping or all zero, or a number is not finite.

    Examples
    --------
    >>> from adaptctl.identifiability import Relation
    >>> str(Relation({"link4.m": 1.0, "link5.m": -1.0}, name="equal forks"))
    "relation 'equal forks'"
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
            raise InputError(f"{self}: expected finite weights, not all zero, and a finite value")

    def __str__(self) -> str:
        terms = " + ".join(f"{weight:g} {name}" for name, weight in list(self.weights.items())[:4])
        return f"relation {self.name!r}" if self.name else f"relation {terms} = {self.value:g}"


@dataclass(frozen=True, eq=False)
class Constraints:
    """
    Linear equality constraints on inertial parameters.

    Parameters
    ----------
    known : mapping of str to float, optional
        Known values in SI units by parameter name, such as ``link2.mc_z``. None by default.
    relations : tuple of Relation, optional
        Linear relations among parameters. Default: none, where values are known one by one.

    Raises
    ------
    InputError
        If `known` is no mapping from names to numbers, or `relations` holds anything but `Relation`.

    Examples
    --------
    >>> from adaptctl.identifiability import Constraints, constrained
    >>> free = constrained(arm, Constraints(known={"lower.mc_y": 0.0}))
    >>> len(arm.parameter_names), len(free.parameter_names)
    (20, 19)
    """

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
    def from_matrix(cls, matrix: ArrayLike, names: Sequence[str], values: ArrayLike | None = None) -> Constraints:
        """
        Return linear constraints from a matrix: `matrix @ parameters == values`.

        Parameters
        ----------
        matrix : array_like
            Coefficients (m, n) of m relations among n parameters, or (n,) for one relation, in SI units.
        names : sequence of str
            Names (n,) of the parameters, each once.
        values : array_like, optional
            Right-hand sides (m,) in SI units; zeros by default.

        Returns
        -------
        Constraints
            Constraints with a relation for each row.

        Raises
        ------
        InputError
            If a shape is wrong, a name is given twice, a number is not finite, or a row is zero.

        Examples
        --------
        >>> from adaptctl.identifiability import Constraints
        >>> len(Constraints.from_matrix([[1.0, -1.0]], ["upper.m", "lower.m"]).relations)
        1
        """
        rows = np.atleast_2d(numbers(matrix, "relations: matrix"))
        right = np.zeros(len(rows)) if values is None else numbers(values, "relations: values")
        if twice := [name for name in names if list(names).count(name) > 1]:
            raise InputError(f"relations: names: expected unique names, got {twice[0]!r} more than once")
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
        r"""
        Read constraints from a TOML file.

        Parameters
        ----------
        path : str or pathlib.Path
            File with a table `[known]` and tables `[[relations]]`, either of which may be left out.

        Returns
        -------
        Constraints
            The file's constraints; `name` and `value` (0) of a relation are optional.

        Raises
        ------
        FileError
            If the file cannot be read, or an element is wrong, which the message names.

        Examples
        --------
        >>> from adaptctl.identifiability import Constraints
        >>> lines = ['schema = "adaptctl/parameter-constraints/1"', "[known]", "lower.mc_z = 0.0", "[[relations]]",
        ...          'name = "equal forks"', "weights = { upper.m = 1.0, lower.m = -1.0 }", "value = 0.0"]
        >>> _ = (tmp / "constraints.toml").write_text("\n".join(lines))
        >>> dict(Constraints.read(tmp / "constraints.toml").known)
        {'lower.mc_z': 0.0}
        """
        content = read_toml(path, _ConstraintsFile)
        try:
            relations = [Relation(_flat(r.weights), r.value, r.name) for r in content.relations]
            return cls(_flat(content.known), tuple(relations))
        except InputError as error:
            raise FileError(f"{path}: {error}") from error

    @property
    def all_relations(self) -> tuple[Relation, ...]:
        """All constraints as relations, known values first."""
        known = (Relation({name: 1.0}, value, f"{name} = {value:g}") for name, value in self.known.items())
        return (*known, *self.relations)


def constrained(
    mechanism: Mechanism, constraints: Constraints, priority: Priority | None = None
) -> ConstrainedMechanism:
    """
    Return a mechanism whose parameters are those left free by linear constraints.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism that is not constrained yet.
    constraints : Constraints
        Linear constraints; each eliminates one parameter, whose value follows from the others'.
    priority : Priority, optional
        Order in which parameters are eliminated. Default: Table 4 of Sheu and Walker (1991), masses first.

    Returns
    -------
    ConstrainedMechanism
        Mechanism whose essential space, fundamental basis, model and controllers keep to the constraints.

    Raises
    ------
    InputError
        If a relation contradicts others, a known value is not finite, a type is wrong, the priority names a parameter
        twice, or the mechanism is constrained already.
    NotFoundError
        If the mechanism has no inertial parameter of a name.

    Examples
    --------
    >>> from adaptctl.identifiability import Constraints, Relation, constrained
    >>> equal = Relation({"upper.m": 1.0, "lower.m": -1.0})
    >>> constrained(arm, Constraints(relations=(equal,))).num_energy_parameters
    19
    """
    validate_kind(mechanism, Mechanism, "constrained", "as load(...) gives one")
    validate_kind(constraints, Constraints, "constrained", "as Constraints({...}) is one")
    names = mechanism.parameter_names[: mechanism.num_energy_parameters]
    A, b = _system(constraints.all_relations, names)
    scales = length_scales(names, characteristic_length(mechanism))
    kept = _independent(constraints.all_relations, A * scales, b)
    order = or_default(priority).indices(names)
    return ConstrainedMechanism(mechanism, _parametrisation(A[kept] * scales, b[kept], scales, order, mechanism))


def _validate_by_name(given: object, what: str) -> None:
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        raise InputError(f"{what}: expected a mapping from parameters' names to numbers, got {printable(repr(given))}")


def _parametrisation(A: Array, b: Array, scales: Array, order: Sequence[int], mechanism: Mechanism) -> Parametrisation:
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
                raise NotFoundError(f"{relation}: unknown inertial parameter {name!r}; {suggestion(name, names)}")
            row[place[name]] = weight
    return A, np.array([relation.value for relation in relations])


def _independent(relations: Sequence[Relation], A: Array, b: Array) -> list[int]:
    kept: list[int] = []
    for i, row in enumerate(A):
        size = np.linalg.norm(row)
        if kept:
            mix, *_ = np.linalg.lstsq(A[kept].T, row, rcond=None)
            beside = np.linalg.norm(row - mix @ A[kept])
            if beside <= MIN_INDEPENDENT_PART * size:
                if abs(mix @ b[kept] - b[i]) > MIN_INDEPENDENT_PART * max(np.abs(b).max(), size):
                    raise InputError(
                        f"{relations[i]} contradicts those before it, from which its value is {mix @ b[kept]:g}"
                    )
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
    relations: Annotated[list[_RelationEntry], msgspec.Meta(max_length=MAX_RELATIONS)] = []


def _flat(nested: _Nested) -> dict[str, float]:
    """Numbers by full name."""
    out: dict[str, float] = {}
    for name, value in nested.items():
        inner = {f"{name}.{kind}": x for kind, x in value.items()} if isinstance(value, dict) else {name: value}
        if twice := sorted(inner.keys() & out.keys()):
            raise InputError(f"{twice[0]!r} is given twice, with quotes and without; keep one")
        out |= inner
    return out
