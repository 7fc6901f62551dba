"""Regrouping equations as text, with equal coefficients factored out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptctl.arrays import Array

NEGLIGIBLE = 1e-9
"""Size below which coefficients are left out: they come from right angles that a file gives to nine digits."""
ALIKE = 1e-9
"""Relative difference below which coefficients are the same one."""


def regrouping_equations(regrouping: Array, columns: Sequence[int], names: Sequence[str]) -> tuple[str, ...]:
    """The regrouping equations, k texts such as ``link2.mc_x* = link2.mc_x + 0.4318 (link3.m + link4.m)``, in SI units,
    one for each kept parameter: its name with a star is the sum of itself and of what is regrouped onto it.

    `regrouping` is the matrix K (k, P), in SI units, that maps all P parameters to the k kept ones with the others
    added, `columns` (k,) the kept ones' zero-based indices, `names` (P,) all names. Coefficients below 1e-9 in size are
    left out; those of one size (to a relative 1e-9), unless it is 1, are put before brackets. Raises `ValueError`
    unless there are k columns.
    """
    return tuple(_equation(row, column, names) for row, column in zip(regrouping, columns, strict=True))


def _equation(row: Array, column: int, names: Sequence[str]) -> str:
    own = names[column]
    return " ".join([f"{own}* = {own}", *(_group(row, group, names) for group in _groups(row, column))])


def _groups(row: Array, column: int) -> list[list[int]]:
    """Groups of parameters whose coefficients have the same size; size 1 first, then in the parameters' order."""
    groups: list[list[int]] = []
    for j in np.flatnonzero(np.abs(row) > NEGLIGIBLE).tolist():
        if j == column:
            continue
        alike = [group for group in groups if _alike(row[group[0]], row[j])]
        if alike:
            alike[0].append(j)
        else:
            groups.append([j])
    return sorted(groups, key=lambda group: not _alike(row[group[0]], 1.0))


def _alike(a: float, b: float) -> bool:
    return abs(abs(a) - abs(b)) <= ALIKE * abs(b)


def _group(row: Array, group: Sequence[int], names: Sequence[str]) -> str:
    """A group such as ``- 0.5 (a - b)``: the first sign outside, the others within; sizes of 1 are signs alone."""
    first = row[group[0]]
    if _alike(first, 1.0):
        return " ".join(f"{_sign(row[j])} {names[j]}" for j in group)
    inner = names[group[0]] + "".join(f" {_sign(first * row[j])} {names[j]}" for j in group[1:])
    return f"{_sign(first)} {abs(first):.6g} " + (f"({inner})" if len(group) > 1 else inner)


def _sign(x: float) -> str:
    return "-" if x < 0.0 else "+"
