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
    """Renderable parts, texts and tables of the package rich, of the report that `adaptctl basis` prints, from top to
    bottom: heading, singular values, parameters that are kept, regrouping equations and, unless `reduction` is None,
    the model reduction. `width` is that of the terminal in characters, 80 by default. Nothing is raised."""
    yield header(mechanism, space, basis)
    yield titled("Singular values of the energy differences (log scale)", spectrum(space))
    yield titled("Parameters that are enough", *grid(mechanism, basis, width))
    yield titled("How the others add to them (* is the regrouped parameter; SI units)", equations(basis))
    if reduction is not None:
        yield titled("Model reduction", energy_error(reduction))


def header(mechanism: Mechanism, space: EssentialSpace, basis: FundamentalBasis) -> Group:
    """Heading of the report on a fundamental `basis` (base parameters) of a mechanism's inertial parameters, a group of
    texts of the package rich. It has the name of the `mechanism`, its numbers of links, degrees of freedom and inertial
    parameters, the rank of its essential `space`, which is the number of independent ones, and the certificate of this
    rank. Notes follow, where there are any: on the certificate, on parameters that were passed over in the choice
    because they nearly depend on those removed before, and on the number of friction parameters, which are kept
    besides. Nothing is raised."""
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
    if basis.passed_over:
        names = ", ".join(basis.passed_over)
        remarks.append(f"{names} would go first, but nearly depend on those removed before, so others go instead")
    if friction:
        remarks.append(f"{friction} friction parameters are kept besides: energies say nothing of them")
    return Group(first, certificate, *(Text(f"note: {remark}", style="yellow") for remark in remarks))


def spectrum(space: EssentialSpace) -> Table:
    """Table, of the package rich, of the singular values of an essential `space`, those of a mechanism's energy
    differences between states, J per SI unit. (The space holds the directions of inertial parameters that change
    energies.) Each row has a value's number from 1, the value, and a bar of "#" on a logarithmic scale: the first two,
    six on either side of the gap at the rank (the number of independent inertial parameters), and the last. Nothing is
    raised."""
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
    """Tables, of the package rich, of the inertial parameters that a basis keeps: kinds, such as m (mass) or I_xx
    (moment of inertia), in rows, links in columns, an x where a parameter is kept. There are several where the links
    need more than `width` characters. Nothing is raised."""
    links, tables = list(mechanism.links), []
    while links:
        count = 1
        while count < len(links) and _grid_width(links[: count + 1]) <= width:
            count += 1
        tables.append(_grid(links[:count], set(basis.names)))
        links = links[count:]
    return tables


def equations(basis: FundamentalBasis) -> Group:
    """Regrouping equations of a basis, SI units, as a group of the package rich: a row for each kept parameter to which
    others are added, and below them the number of those to which nothing is added. Nothing is raised."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, right in (text.split(" = ", 1) for text in basis.equations()):
        if " " in right:
            table.add_row(Text(f"{name} ="), Text(right))
    alone = Text(f"{basis.rank - table.row_count} more are kept to which nothing is added.", style="dim")
    return Group(table, alone)


def energy_error(reduction: Reduction) -> Text:
    """Sentence, a `rich.text.Text`, on a model `reduction`: how many of all essential components (combinations of the
    inertial parameters) are kept, the error of the energy with these, and the motions it is for. The error, in percent,
    is the root mean square, over pairs of successive sampled states, of the error of the energy difference, relative to
    the root mean square of the energy differences themselves. Nothing is raised."""
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
