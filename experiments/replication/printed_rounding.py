"""Bounds on whether one printed table follows from another, the digits that neither prints allowed for."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from adaptctl.arrays import Array
from adaptctl.experiments.replication.paper_layout import index, parameters
from adaptctl.experiments.replication.printed import Number, Table
from adaptctl.identifiability import EssentialSpace


def half_units(table: Table) -> Array:
    """Half a unit of every entry's last digit (P,)."""
    out = np.zeros(10 * len(table.columns))
    for row, link, text in table.entries():
        out[index(row, link)] = 0.5 * Number.of(text).unit
    return out


def excess(space: EssentialSpace, real: Table, essential: Table, free: Array) -> float:
    """Least distance of V1 V1' D from the printed essential parameters, in half units of their last digits.

    D may be anything that rounds to the printed real parameters where `free` (P,), and is as printed elsewhere. At most
    1 means that the two tables agree. A linear program. Raises ArithmeticError where the linear program is not solved.
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
