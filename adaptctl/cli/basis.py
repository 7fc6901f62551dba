"""`adaptctl basis`: which inertial parameters a robot's motion depends on, and which are enough."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from adaptctl.cli.output import (
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
from adaptctl.cli.robot import AS_USUAL, RobotFlags

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
BAR_LENGTH = 32
"""characters of the longest bar of the spectrum"""
GAP_NEIGHBOURS = 6
"""values of the spectrum shown on either side of its gap, besides the first"""
STATES_PER_PARAMETER = 50
"""to which the components of a reduction are fitted"""
MIN_BAR_RATIO = 1e-18
"""Of the largest: where bars end. What is smaller is round-off, or zero."""


def basis(
    robot: Robot,
    /,
    *,
    priority: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    energy_error: Annotated[float | None, Parameter(metavar="PERCENT")] = None,
    tool: Annotated[
        Literal["pinocchio", "figaroh", "mujoco", "drake"] | None, Parameter(name="--for", show_choices=False)
    ] = None,
    reading: RobotFlags = AS_USUAL,
    json: Json = False,
    out: Annotated[Path | None, Parameter(metavar="FILE")] = None,
    overwrite: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """
    Find the independent inertial parameters of a robot, and print them.

    Table 4 is that of Sheu and Walker (1991); components are combinations of parameters. Angles and lengths are nearly
    special where the rank would be another one if they were exact.

    Parameters
    ----------
    priority : Path
        TOML file with the order in which parameters are removed. Default: Sheu and Walker's Table 4.
    energy_error : float
        Also print how many essential components keep the energy error, %, below this within the joint limits.
    tool : str
        Order of the parameters, and frames, of pinocchio, figaroh, mujoco (mujoco.sysid) or drake.
    out : Path
        Also save the basis, as JSON for `FundamentalBasis.load`.
    overwrite : bool
        Replace the file of --out, if it exists.

    Raises
    ------
    FileError
        If a file cannot be used or written.
    NotFoundError
        If the robot is unknown.
    InputError
        If `energy_error` is below 0, or an option does not go with the robot.
    LoopError
        If kinematic loops cannot be closed.
    RankError
        If the number of parameters cannot be certified or, unless `as_written`, angles or lengths are nearly special.
    """
    from adaptctl.files import validate_output
    from adaptctl.identifiability import Priority, essential_space, fundamental_basis

    if out is not None:
        validate_output(out, overwrite)
    mechanism = reading.load(robot) if tool is None else _in_frames_of(tool, reading.load(robot), robot)
    order = Priority.default(mechanism) if priority is None else Priority.read(priority, mechanism)
    space = essential_space(mechanism, prove=True)
    found = fundamental_basis(space, order, prove=True)
    found = found if tool is None else found.in_order(tool)
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
    """A robot's fundamental basis (base parameters), a dict in JSON's types."""
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
        "names": list(basis.parameter_names),
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


def _in_frames_of(tool: str, mechanism: Mechanism, robot: str) -> Mechanism:
    """The mechanism with frames at its joints, or at MuJoCo's bodies, where MJCF has them."""
    from adaptctl.description import builtin_file, builtin_names
    from adaptctl.description.transforms import with_joint_frames
    from adaptctl.dynamics import Mechanism

    file = builtin_file(robot) if robot in builtin_names() else Path(robot)
    return (
        mechanism if tool == "mujoco" and file.suffix == ".xml" else Mechanism(with_joint_frames(mechanism.description))
    )


def _reduction(mechanism: Mechanism, energy_error: float) -> Reduction:
    """Model reduction within the joints' limits, which is where the robot works."""
    from adaptctl.identifiability import essential_space, reduce, states_within_limits

    states = states_within_limits(mechanism, STATES_PER_PARAMETER * len(mechanism.parameter_names))
    return reduce(essential_space(mechanism, states=states, prove=False), mechanism, energy_error=energy_error)


def report(
    mechanism: Mechanism,
    space: EssentialSpace,
    basis: FundamentalBasis,
    reduction: Reduction | None,
) -> Iterator[RenderableType]:
    """Parts of the report that `adaptctl basis` prints."""
    yield header(mechanism, space, basis)
    yield titled("Singular values of the energy differences (log scale)", spectrum(space))
    yield titled("Base parameters", grid(mechanism, basis))
    yield titled("Regrouping relations (* marks a regrouped parameter; SI units)", equations(basis))
    if reduction is not None:
        yield titled("Model reduction", energy_error(reduction))


def header(mechanism: Mechanism, space: EssentialSpace, basis: FundamentalBasis) -> Group:
    """Heading of the report on a basis."""
    parameters, friction = len(space.parameter_names), len(mechanism.parameter_names) - len(space.parameter_names)
    first = words(
        (mechanism.name, "bold"),
        f": {len(mechanism.links)} links, {mechanism.dof} degrees of freedom, {parameters} inertial parameters, "
        "of which ",
        (str(space.rank), "bold green"),
        " are base parameters",
    )
    certificate = words((f"{space.certificate}; condition {basis.condition:.3g}", "dim"))
    remarks = [*space.certificate.warnings]
    if basis.kept_despite_priority:
        names = ", ".join(basis.kept_despite_priority)
        remarks.append(
            f"{names} come first in the priority, but almost depend on those removed before, so others are removed "
            "instead"
        )
    if space.certificate.taken_as_exact:
        remarks.append(f"taken as exact: {'; '.join(space.certificate.taken_as_exact)}")
    if friction:
        remarks.append(f"{friction} friction parameters do not change the energy, so that all of them are kept")
    return stacked(first, certificate, *(words((f"note: {remark}", "yellow")) for remark in remarks))


def spectrum(space: EssentialSpace) -> Table:
    """Table of the singular values about the gap, with bars."""
    values, k = space.singular_values.tolist(), space.rank
    shown = sorted(
        {*range(min(2, k)), *range(max(0, k - GAP_NEIGHBOURS), min(len(values), k + GAP_NEIGHBOURS)), len(values) - 1}
    )
    rows: list[Sequence[Words]] = []
    for before, i in pairwise([-1, *shown]):
        rows += [("...", "", "")] if i > before + 1 else []
        rows += [("", "", (f"---- rank {k}: below is round-off", "green"))] if i == k else []
        bar = "#" * _bar(values[i] / values[0]), "cyan" if i < k else "dim"
        rows.append((f"{i + 1:>{len(str(len(values)))}}", f"{values[i]:.1e}", bar))
    return listed(rows)


def grid(mechanism: Mechanism, basis: FundamentalBasis) -> WrappedTable:
    """Table of the parameters that a basis keeps: kinds in rows, links in columns."""
    links, kept = mechanism.links, set(basis.names)
    rows = [[kind, *("x" if f"{link.name}.{kind}" in kept else "" for link in links)] for kind in ROWS]
    if any(link.joint.drive.rotor_inertia is not None for link in links):
        rows.append([ROTOR, *("x" if f"{link.joint.name}.{ROTOR}" in kept else "" for link in links)])
    return WrappedTable(("", *(link.name for link in links)), rows)


def equations(basis: FundamentalBasis) -> Group:
    """Regrouping equations, a row for each kept parameter to which others are added."""
    pairs = (text.split(" = ", 1) for text in basis.equations())
    rows = [(f"{name} =", right) for name, right in pairs if " " in right]
    alone = words((f"{basis.rank - len(rows)} more base parameters have nothing regrouped into them.", "dim"))
    return stacked(listed(rows, whole=True), alone)


def energy_error(reduction: Reduction) -> Text:
    """Sentence on the components that a reduction keeps and the error of the energy."""
    return words(
        f"{reduction.num_components} of {len(reduction.weights)} components keep the energy error at "
        f"{reduction.percent_error:.3g} % (equation 23 of Sheu and Walker), over {reduction.states} than those that "
        "the components are fitted to, with this robot's parameters."
    )


def _bar(share: float) -> int:
    return round(BAR_LENGTH * max(0.0, 1.0 - log10(max(share, MIN_BAR_RATIO)) / log10(MIN_BAR_RATIO)))
