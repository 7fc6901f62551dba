"""The paper's order and signs of inertial parameters, where its tables are read or written."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.inertia import PARAMETERS
from adaptctl.experiments.replication.printed import BLANK, MARK, Table

NAMES = {"I_x": "I_xx", "I_y": "I_yy", "I_z": "I_zz"}
"""The paper's moments of inertia; its other names are ours."""
PRODUCTS = ("I_xy", "I_xz", "I_yz")
"""In the paper +integral xy dm, here the tensor's own entries."""


def index(row: str, link: str) -> int:
    """Index among all parameters of that in a row of the paper's tables, of link "1", "2", ..."""
    return 10 * (int(link) - 1) + PARAMETERS.index(NAMES.get(row, row))


def sign(row: str) -> float:
    """Sign of a row's parameters in the paper: -1 for products of inertia."""
    return -1.0 if row in PRODUCTS else 1.0


def parameters(table: Table) -> Array:
    """Inertial parameters (10 N,) from a table's numbers, blanks as zeros."""
    out = np.zeros(10 * len(table.columns))
    for row, link, text in table.entries():
        if text != BLANK:
            out[index(row, link)] = sign(row) * float(text)
    return out


def kept(table: Table) -> tuple[int, ...]:
    """Indices of the parameters that a table marks with a cross, or prints at all."""
    entries = table.entries()
    return tuple(sorted(index(row, link) for row, link, text in entries if text == MARK or text != BLANK))


def name(row: str, link: str) -> str:
    """Name here of a parameter of the paper's tables, such as ``link3.I_xx``."""
    return f"link{link}.{NAMES.get(row, row)}"
