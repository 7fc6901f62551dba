"""`adaptctl basis`: which inertial parameters a robot's motion depends on, and which are enough."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from adaptctl.cli.output import (
    FloatingBase,
    Json,
    Robot,
    Words,
    WrappedTable,
    listed,
    print_json,
    print_parts,
    stacked,
    titled,
    words,
)

if TYPE_CHECKING:
    from rich.console import Group, RenderableType
    from rich.table import Table
    from rich.text import Text

    from adaptctl.dynamics import Mechanism
    from adaptctl.identifiability import EssentialSpace, FundamentalBasis, Reduction

SCHEMA = "adaptctl/basis/1"
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


def basis(
    robot: Robot,
    /,
    *,
    priority: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    energy_error: Annotated[float | None, Parameter(metavar="PERCENT")] = None,
    snap: Annotated[bool | None, Parameter(negative="--no-snap")] = None,
    floating_base: FloatingBase = False,
    json: Json = False,
    out: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    overwrite: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Find the independent inertial parameters of a robot, and print them, or with `json` a JSON object.

    Table 4, in the options' help, is that of Sheu and Walker (1991); components are combinations of parameters, of
    which few may account for nearly all energy. `out` is a file to save the basis in, which `FundamentalBasis.load`
    reads; one that exists is replaced only with `overwrite`. Angles and lengths are nearly special where the rank would
    be another one if they were exact, such as angles between joint axes within 1e-3 rad of a right one. Raises
    `FileError` for files that cannot be used or written, `NotFoundError` for an unknown robot, `LoopError` where
    kinematic loops cannot be closed, `RankError` where the number of independent parameters cannot be certified or,
    unless `snap` is False, angles or lengths are nearly special; `InputError` for `floating_base` with a robot that is
    no URDF file and for an `energy_error` below 0.

    Args:
        priority: TOML file that says which parameters to remove first; else Table 4's rule.
        energy_error: Also tell how many components keep the energy's error below this, within the joints' limits.
        snap: Make joint angles within 1e-3 rad of a right angle exact, or use them as given; else they may be refused.
        out: Also save the basis, as JSON that adaptctl can load.
        overwrite: Replace the file of --out, if it exists.
    """
    from adaptctl.dynamics import load
    from adaptctl.files import validate_place
    from adaptctl.identifiability import Priority, essential_space, fundamental_basis

    if out is not None:
        validate_place(out, overwrite)
    mechanism = load(robot, floating_base=floating_base, snap=bool(snap))
    order = Priority.default(mechanism) if priority is None else Priority.read(priority, mechanism)
    space = essential_space(mechanism, near_singular="as_is" if snap is False else "refuse", prove=True)
    found = fundamental_basis(space, order, prove=True)
    reduction = None if energy_error is None else _reduction(mechanism, energy_error)
    if out is not None:
        found.save(out)
    if json:
        print_json(as_builtins(mechanism, space, found, reduction))
    else:
        print_parts(report(mechanism, space, found, reduction))


def as_builtins(
    mechanism: Mechanism, space: EssentialSpace, basis: FundamentalBasis, reduction: Reduction | None = None
) -> dict[str, Any]:
    """A robot's fundamental basis (base parameters), a dict in JSON's types. `robot` has its name and hash; `dof` is
    its degrees of freedom, `links` the number of its links. `parameters` is the number P of its inertial parameters,
    `rank` the number k of these that are independent; `independent` has the names of those kept, `columns` their
    zero-based indices among the P. `regrouping` is the matrix K (k, P), SI units, that gives their values K D from all
    P values D. `singular_values` (P,) are those of the energy differences between states, J per SI unit, `gap` the
    ratio of those before and after the rank, no unit, and `certificate` the proof of the rank.

    Friction, which enters no energy, is in none of them. With a `reduction` to essential components, of which the
    parameters are a sum (None by default: without it), there is an entry of that name: `components`, how many are kept,
    `percent_error`, the energy's error with them, `percent_errors`, with 0, 1, ... k of them, and `states`, a text on
    the motions that the errors are over. Nothing is raised.
    """
    from msgspec import to_builtins

    content: dict[str, Any] = {
        "schema": SCHEMA,
        "robot": {"name": mechanism.name, "sha256": mechanism.description.sha256},
        "dof": mechanism.dof,
        "links": len(mechanism.links),
        "parameters": len(space.parameter_names),
        "rank": space.rank,
        "singular_values": space.singular_values.tolist(),
        "gap": space.certificate.gap,
        "independent": list(basis.names),
        "columns": list(basis.columns),
        "regrouping": basis.regrouping.tolist(),
        "certificate": to_builtins(space.certificate),
    }
    if reduction is not None:
        content["reduction"] = {
            "states": reduction.states,
            "components": reduction.num_components,
            "percent_error": reduction.percent_error,
            "percent_errors": reduction.percent_errors.tolist(),
        }
    return content


def _reduction(mechanism: Mechanism, energy_error: float) -> Reduction:
    """Model reduction within the joints' limits, which is where the robot works."""
    from adaptctl.identifiability import essential_space, reduce, states_within_limits

    states = states_within_limits(mechanism, 2 * len(mechanism.parameter_names) + 1)
    return reduce(essential_space(mechanism, states=states, prove=False), mechanism, energy_error=energy_error)


def report(
    mechanism: Mechanism,
    space: EssentialSpace,
    basis: FundamentalBasis,
    reduction: Reduction | None,
) -> Iterator[RenderableType]:
    """Renderable parts, texts and tables of the package rich, of the report that `adaptctl basis` prints, from top to
    bottom: heading, singular values, parameters that are kept, regrouping equations and, unless `reduction` is None,
    the model reduction. Nothing is raised."""
    yield header(mechanism, space, basis)
    yield titled("Singular values of the energy differences (log scale)", spectrum(space))
    yield titled("Parameters that are enough", grid(mechanism, basis))
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
    first = words(
        (mechanism.name, "bold"),
        f": {len(mechanism.links)} links, {mechanism.dof} degrees of freedom, {parameters} inertial parameters, "
        "of which ",
        (str(space.rank), "bold green"),
        " are independent",
    )
    certificate = words((f"{space.certificate}; condition {basis.condition:.3g}", "dim"))
    remarks = [*space.certificate.warnings]
    if basis.kept_despite_priority:
        names = ", ".join(basis.kept_despite_priority)
        remarks.append(f"{names} would go first, but nearly depend on those removed before, so others go instead")
    if friction:
        remarks.append(f"{friction} friction parameters are kept besides: energies say nothing of them")
    return stacked(first, certificate, *(words((f"note: {remark}", "yellow")) for remark in remarks))


def spectrum(space: EssentialSpace) -> Table:
    """Table, of the package rich, of the singular values of an essential `space`, those of a mechanism's energy
    differences between states, J per SI unit. (The space holds the directions of inertial parameters that change
    energies.) Each row has a value's number from 1, the value, and a bar of "#" on a logarithmic scale: the first two,
    six on either side of the gap at the rank (the number of independent inertial parameters), and the last. Nothing is
    raised."""
    values, k = space.singular_values.tolist(), space.rank
    shown = sorted({*range(min(2, k)), *range(max(0, k - ABOUT), min(len(values), k + ABOUT)), len(values) - 1})
    rows: list[Sequence[Words]] = []
    for before, i in pairwise([-1, *shown]):
        rows += [("...", "", "")] if i > before + 1 else []
        rows += [("", "", (f"---- rank {k}: below is round-off", "green"))] if i == k else []
        bar = "#" * _bar(values[i] / values[0]), "cyan" if i < k else "dim"
        rows.append((f"{i + 1:>{len(str(len(values)))}}", f"{values[i]:.1e}", bar))
    return listed(rows)


def grid(mechanism: Mechanism, basis: FundamentalBasis) -> WrappedTable:
    """Table of the inertial parameters that a basis keeps: kinds, such as m (mass) or I_xx (moment of inertia), in
    rows, links in columns, an x where a parameter is kept. Nothing is raised."""
    links, kept = mechanism.links, set(basis.names)
    rows = [[kind, *("x" if f"{link.name}.{kind}" in kept else "" for link in links)] for kind in ROWS]
    if any(link.joint.drive.rotor_inertia is not None for link in links):
        rows.append([ROTOR, *("x" if f"{link.joint.name}.{ROTOR}" in kept else "" for link in links)])
    return WrappedTable(("", *(link.name for link in links)), rows)


def equations(basis: FundamentalBasis) -> Group:
    """Regrouping equations of a basis, SI units, as a group of the package rich: a row for each kept parameter to which
    others are added, and below them the number of those to which nothing is added. Nothing is raised."""
    pairs = (text.split(" = ", 1) for text in basis.equations())
    rows = [(f"{name} =", right) for name, right in pairs if " " in right]
    alone = words((f"{basis.rank - len(rows)} more are kept to which nothing is added.", "dim"))
    return stacked(listed(rows, whole=True), alone)


def energy_error(reduction: Reduction) -> Text:
    """Sentence, a `rich.text.Text`, on a model `reduction`: how many of all essential components (combinations of the
    inertial parameters) are kept, the error of the energy with these, and the motions it is for. The error, in percent,
    is the root mean square, over pairs of successive sampled states, of the error of the energy difference, relative to
    the root mean square of the energy differences themselves. Nothing is raised."""
    return words(
        f"{reduction.num_components} of {len(reduction.weights)} components keep the energy within "
        f"{reduction.percent_error:.3g} % (equation 23 of Sheu and Walker), over {reduction.states}, "
        "with this robot's parameters."
    )


def _bar(share: float) -> int:
    return round(BAR * max(0.0, 1.0 - log10(max(share, LOWEST)) / log10(LOWEST)))
