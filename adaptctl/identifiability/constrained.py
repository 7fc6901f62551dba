"""A mechanism under constraints on its parameters, on those that are left."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.constrained_mechanism import ConstrainedMechanism, Parametrisation
from adaptctl.errors import InputError, NotFoundError
from adaptctl.identifiability.constraints import Constraints, Relation
from adaptctl.identifiability.priority import Priority
from adaptctl.identifiability.sampling import characteristic_length
from adaptctl.identifiability.scaling import length_scales
from adaptctl.identifiability.selection import removable

INDEPENDENT = 1e-9
"""What of a relation must be its own, beside those before it."""


def constrained(
    mechanism: Mechanism, constraints: Constraints, priority: Priority | None = None
) -> ConstrainedMechanism:
    """The mechanism on the parameters that the constraints leave: each takes one away.

    A relation takes away the parameter that the priority would remove first (default: Table 4's rule) and that no
    other relation has taken; its value follows from the others'. Essential space, basis, model and controllers that
    are made from the result keep to the constraints, and need not know of them. The mechanism's own values of
    parameters taken away are replaced by what the constraints say.
    Raises `InputError` naming a relation that contradicts those before it; one that follows from them is left out.
    """
    names = mechanism.parameter_names[: mechanism.energetic]
    A, b = _system(constraints.every, names)
    scales = length_scales(names, characteristic_length(mechanism))
    kept = _independent(constraints.every, A * scales, b)
    if len(kept) == len(names):
        raise InputError(f"{mechanism.name}: the constraints leave no parameter")
    order = (priority or Priority()).indices(names)
    return ConstrainedMechanism(mechanism, _parametrisation(A[kept] * scales, b[kept], scales, order, mechanism))


def _parametrisation(A: Array, b: Array, scales: Array, order: Sequence[int], mechanism: Mechanism) -> Parametrisation:
    """Solve scaled relations A x = b, x = D / scales, for the first independent parameters in the order."""
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
                raise NotFoundError(f"{relation}: there is no inertial parameter {name!r}; {_nearest(name, names)}")
            row[place[name]] = weight
    return A, np.array([relation.value for relation in relations])


def _independent(relations: Sequence[Relation], A: Array, b: Array) -> list[int]:
    """Which relations say something new; refused when one contradicts those before it."""
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


def _nearest(name: str, names: Sequence[str]) -> str:
    close = get_close_matches(name, names, n=1)
    return f"did you mean {close[0]!r}?" if close else f"there are {', '.join(names[:10])}, ..."
