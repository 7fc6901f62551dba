"""Bounds on whether one printed table follows from another, the digits that neither prints allowed for."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from adaptctl.arrays import Array
from adaptctl.experiments.replication.paper_layout import index, parameters
from adaptctl.experiments.replication.printed import Number, Table
from adaptctl.identifiability import EssentialSpace


def half_units(table: Table) -> Array:
    """Half a unit of the last printed digit (10 N,) of every inertial parameter of N links in a printed `table`, in the
    parameters' SI units: of each link m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz. Raises `InputError` for
    a blank."""
    out = np.zeros(10 * len(table.columns))
    for row, link, text in table.entries():
        out[index(row, link)] = 0.5 * Number.of(text).unit
    return out


def excess(space: EssentialSpace, real: Table, essential: Table, free: Array) -> float:
    """Least possible value (no unit) of max_i |(V1 V1' D)_i - E_i| / h_i, over all vectors D (P,) of P inertial
    parameters that round to the numbers of the printed table `real`. E (P,) are the essential parameters that the
    printed table `essential` has, and h_i is half a unit of the last printed digit of E_i.

    D may differ from the printed numbers only where `free` (P,), of bools, is True. V1 (P, k) is the basis of `space`,
    the k directions of parameters that change energies, and V1' its transpose. A value of at most 1 means that the two
    tables agree. It is found by a linear program. Raises `ArithmeticError` where that is not solved, `InputError` for a
    blank in a table.
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
