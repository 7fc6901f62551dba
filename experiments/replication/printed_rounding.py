"""Bounds on whether one printed table follows from another, the digits that neither prints allowed for."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from adaptctl.arrays import Array
from adaptctl.experiments.replication.paper_layout import index, parameters
from adaptctl.experiments.replication.printed import Number, Table
from adaptctl.identifiability import EssentialSpace


def half_units(table: Table) -> Array:
    """Half a unit of the last printed digit (10 N,) of every inertial parameter of N links in a table, in the
    parameters' SI units. Raises `InputError` for a blank."""
    out = np.zeros(10 * len(table.columns))
    for row, link, text in table.entries():
        out[index(row, link)] = 0.5 * Number.of(text).unit
    return out


def excess(space: EssentialSpace, real: Table, essential: Table, free: Array) -> float:
    """Least possible distance, in half units of their last printed digits (no unit), of the essential parameters V1 V1'
    D from those of the table `essential`, where D (P,) is any vector of inertial parameters that rounds to the table
    `real`.

    D may differ from the printed numbers only where `free` (P,), of bools, is True. V1 (P, k) is the basis of `space`,
    the k directions of parameters that change energies. At most 1 means that the two tables agree. It is the solution
    of a linear program; raises `ArithmeticError` where that is not solved, `InputError` for a blank in a table.
    """
    project, D, goal = space.basis @ space.basis.T, parameters(real), parameters(essential)
    tolerance, slack = half_units(essential), np.where(free, half_units(real), 0.0)
    off = project @ D - goal
    rows = np.concatenate([project / tolerance[:, None], -project / tolerance[:, None]])
    found = linprog(
        np.append(np.zeros(len(D)), 1.0),
        A_ub=np.column_stack([rows, -np.ones(len(rows))]),
        b_ub=np.concatenate([-off / tolerance, off / tolerance]),
        bounds=[*((-x, x) for x in slack), (0.0, None)],
    )
    if found.fun is None:
        raise ArithmeticError(f"the linear program was not solved: {found.message}")
    return float(found.fun)
