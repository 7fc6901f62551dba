"""The paper's order and signs of inertial parameters, where its tables are read or written."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array, whole_count
from adaptctl.description.inertia import PARAMETERS
from adaptctl.experiments.replication.printed import BLANK, MARK, Table

NAMES = {"I_x": "I_xx", "I_y": "I_yy", "I_z": "I_zz"}
"""The paper's moments of inertia; its other names are ours."""
PRODUCTS = ("I_xy", "I_xz", "I_yz")
"""In the paper +integral xy dm, here the tensor's own entries."""


def index(row: str, link: str) -> int:
    """Index, from 0, of an inertial parameter among all of a mechanism's (ten a link: m, mc_x, mc_y, mc_z, I_xx, I_xy,
    I_yy, I_xz, I_yz, I_zz), from its row and column in Sheu and Walker's (1991) tables. `row` is "m", "mc_x", "mc_y",
    "mc_z", "I_x", "I_y", "I_z", "I_xy", "I_xz" or "I_yz" (or, for I_x, I_y and I_z, this package's "I_xx", "I_yy",
    "I_zz"), `link` the column's label, "1", "2", .... Raises `ValueError` for a row that is no parameter or a link that
    is no whole number, its subclass `InputError` for a link below 1."""
    return 10 * (whole_count(int(link), "link", 1) - 1) + PARAMETERS.index(NAMES.get(row, row))


def sign(row: str) -> float:
    """Sign, 1 or -1, that converts an inertial parameter in a `row` of Sheu and Walker's (1991) tables into this
    package's, which takes the inertia tensor's own entries: -1 for products of inertia ("I_xy", ...), which the paper
    takes as +integral xy dm, and 1 for any other text. Nothing is checked."""
    return -1.0 if row in PRODUCTS else 1.0


def parameters(table: Table) -> Array:
    """Inertial parameters (10 N,) of N links from the numbers of one of Sheu and Walker's (1991) tables, blanks as
    zeros, in SI units and with this package's order and signs: of each link m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy,
    I_xz, I_yz, I_zz, inertias being the tensor's entries. Raises `ValueError` for an entry that is no number."""
    out = np.zeros(10 * len(table.columns))
    for row, link, text in table.entries():
        if text != BLANK:
            out[index(row, link)] = sign(row) * float(text)
    return out


def kept(table: Table) -> tuple[int, ...]:
    """Indices, from 0 and in ascending order, of the inertial parameters that Sheu and Walker (1991) keep as
    independent, among all (ten a link): those for which `table`, one of their tables, has a cross or a number."""
    entries = table.entries()
    return tuple(sorted(index(row, link) for row, link, text in entries if text == MARK or text != BLANK))


def name(row: str, link: str) -> str:
    """Name in this package, such as "link3.I_xx", of the inertial parameter in a `row` of Sheu and Walker's (1991)
    tables, such as "m" or "I_x" (the package's I_xx), and the column of a `link`, such as "3". Nothing is checked."""
    return f"link{link}.{NAMES.get(row, row)}"
