"""Report of `adaptctl basis` for a person to read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from adaptctl.cli.output import titled
from adaptctl.description import Link
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import EssentialSpace, FundamentalBasis, Reduction

ROWS = ("m", "mc_x", "mc_y", "mc_z", "I_xx", "I_yy", "I_zz", "I_xy", "I_xz", "I_yz")
"""Kinds of parameters in the order of Table 5 of Sheu and Walker (1991)."""
ROTOR = "rotor_inertia"
"""Of the link's joint, where one is modelled."""
BAR = 32
"""characters of the longest bar of the spectrum"""
ABOUT = 6
"""values of the spectrum shown on either side of its gap, besides the first"""
LOWEST = 1e-18
"""Of the largest: where bars end. What is smaller is round-off, or zero."""


def report(
    mechanism: Mechanism,
    space: EssentialSpace,
    basis: FundamentalBasis,
    reduction: Reduction | None,
    width: int = 80,
) -> Iterator[RenderableType]:
    """Parts of the report from top to bottom, for a terminal of `width` characters."""
    yield header(mechanism, space, basis)
    yield titled("Singular values of the energy differences (log scale)", spectrum(space))
    yield titled("Parameters that are enough", *grid(mechanism, basis, width))
    yield titled("How the others add to them (* is the regrouped parameter; SI units)", equations(basis))
    if reduction is not None:
        yield titled("Model reduction", energy_error(reduction))


def header(mechanism: Mechanism, space: EssentialSpace, basis: FundamentalBasis) -> Group:
    """Heading: the robot, its number of independent parameters, and the certificate of that number."""
    parameters, friction = len(space.parameter_names), len(mechanism.parameter_names) - len(space.parameter_names)
    first = Text.assemble(
        (mechanism.name, "bold"),
        f": {len(mechanism.links)} links, {mechanism.dof} degrees of freedom, {parameters} inertial parameters, "
        "of which ",
        (str(space.rank), "bold green"),
        " are independent",
    )
    certificate = Text(f"{space.certificate}; condition {basis.condition:.3g}", style="dim")
    remarks = [*space.certificate.remarks]
    if friction:
        remarks.append(f"{friction} friction parameters are kept besides: energies say nothing of them")
    return Group(first, certificate, *(Text(f"note: {remark}", style="yellow") for remark in remarks))


def spectrum(space: EssentialSpace) -> Table:
    """Bars of the first singular values, and of those about the gap, on a logarithmic scale."""
    values, k = space.singular_values, space.rank
    table = Table(box=None, show_header=False, pad_edge=False)
    shown = sorted({*range(min(2, k)), *range(max(0, k - ABOUT), min(len(values), k + ABOUT)), len(values) - 1})
    before = -1
    for i in shown:
        if i > before + 1:
            table.add_row("...", "", "")
        if i == k:
            table.add_row("", "", Text(f"---- rank {k}: below is round-off", style="green"))
        bar = Text("#" * _bar(values[i] / values[0]), style="cyan" if i < k else "dim")
        table.add_row(Text(str(i + 1), justify="right"), f"{values[i]:.1e}", bar)
        before = i
    return table


def grid(mechanism: Mechanism, basis: FundamentalBasis, width: int) -> list[Table]:
    """Tables of kinds (rows) and links (columns), x where a parameter is kept; several where links are many."""
    links, tables = list(mechanism.links), []
    while links:
        count = 1
        while count < len(links) and _grid_width(links[: count + 1]) <= width:
            count += 1
        tables.append(_grid(links[:count], set(basis.names)))
        links = links[count:]
    return tables


def equations(basis: FundamentalBasis) -> Group:
    """Regrouping equations, one a row; parameters that nothing is added to are only counted."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, right in (text.split(" = ", 1) for text in basis.equations()):
        if " " in right:
            table.add_row(Text(f"{name} ="), Text(right))
    alone = Text(f"{basis.rank - table.row_count} more are kept to which nothing is added.", style="dim")
    return Group(table, alone)


def energy_error(reduction: Reduction) -> Text:
    """Sentence on the number of components that suffice, and for which motions."""
    return Text(
        f"{reduction.kept} of {len(reduction.weights)} components keep the energy within "
        f"{reduction.percent_error:.3g} % (equation 23 of Sheu and Walker), over {reduction.states}, "
        "with this robot's parameters."
    )


def _bar(share: float) -> int:
    decades = -np.log10(LOWEST)
    return round(float(BAR * max(0.0, 1.0 + np.log10(max(share, LOWEST)) / decades)))


def _grid(links: Sequence[Link], kept: set[str]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("")
    for link in links:
        table.add_column(Text(link.name), justify="center", no_wrap=True)
    for kind in ROWS:
        table.add_row(kind, *("x" if f"{link.name}.{kind}" in kept else "" for link in links))
    if any(link.joint.drive.rotor_inertia is not None for link in links):
        table.add_row(ROTOR, *("x" if f"{link.joint.name}.{ROTOR}" in kept else "" for link in links))
    return table


def _grid_width(links: Sequence[Link]) -> int:
    """Width of a grid in characters: indent, column of kinds, and a column with margins for each link."""
    return 2 + len(ROTOR) + 2 + sum(len(link.name) + 3 for link in links)
