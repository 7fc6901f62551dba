"""`adaptctl basis`: which inertial parameters a robot's motion depends on, and which are enough."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from adaptctl.cli.output import print_json, print_parts, terminal_width

if TYPE_CHECKING:
    from adaptctl.dynamics import Mechanism
    from adaptctl.identifiability import EssentialSpace, FundamentalBasis, Reduction

SCHEMA = "adaptctl/basis/1"


def basis(
    robot: Annotated[str, Parameter(help="A built-in robot's name, or a .urdf, .xml (MJCF) or .toml file.")],
    /,
    *,
    priority: Annotated[
        Path | None,
        Parameter(metavar="FILE", help="TOML file that says which parameters to remove first; else Table 4's rule."),
    ] = None,
    energy_error: Annotated[
        float | None,
        Parameter(
            metavar="PERCENT",
            help="Also tell how many components keep the energy's error below this, within the joints' limits.",
        ),
    ] = None,
    snap: Annotated[
        bool, Parameter(negative=(), help="Make angles between joint axes within 1e-3 rad of right ones exact.")
    ] = False,
    as_is: Annotated[
        bool, Parameter(negative=(), help="Take nearly special angles and lengths as they stand; else they may refuse.")
    ] = False,
    floating_base: Annotated[
        bool, Parameter(help="Let a URDF file's root link float instead of being fixed to the ground.")
    ] = False,
    json: Annotated[bool, Parameter(help="Print JSON instead of tables.")] = False,
    out: Annotated[
        Path | None, Parameter(metavar="FILE", help="Also save the basis, as JSON that adaptctl can load.")
    ] = None,
    overwrite: Annotated[bool, Parameter(negative=(), help="Replace the file of --out, if it exists.")] = False,
) -> None:
    """Find the independent inertial parameters of a robot, and print them, or with `json` a JSON object.

    Table 4, in the options' help, is that of Sheu and Walker (1991); components are combinations of parameters, of
    which few may account for nearly all energy. `out` is a file to save the basis in, which `FundamentalBasis.load`
    reads; one that exists is replaced only with `overwrite`. Angles and lengths are nearly special where the rank would
    be another one if they were exact, such as angles between joint axes within 1e-3 rad of a right one. Raises
    `FileError` for files that cannot be used or written, `NotFoundError` for an unknown robot, `LoopError` where
    kinematic loops cannot be closed, `RankError` where the number of independent parameters cannot be certified or,
    without `as_is`, angles or lengths are nearly special; `InputError` for `floating_base` with a robot that is no URDF
    file and for an `energy_error` below 0.
    """
    from adaptctl.dynamics import load
    from adaptctl.files import require_place
    from adaptctl.identifiability import Priority, essential_space, fundamental_basis

    if out is not None:
        require_place(out, overwrite)
    mechanism = load(robot, floating_base=floating_base, snap=snap)
    order = Priority.default(mechanism) if priority is None else Priority.read(priority, mechanism)
    space = essential_space(mechanism, near="as_is" if as_is else "refuse", prove=True)
    found = fundamental_basis(space, order, prove=True)
    reduction = None if energy_error is None else _reduction(mechanism, energy_error)
    if out is not None:
        found.save(out)
    if json:
        print_json(as_builtins(mechanism, space, found, reduction))
    else:
        from adaptctl.cli.basis_report import report

        print_parts(report(mechanism, space, found, reduction, terminal_width()))


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
        "robot": {"name": mechanism.name, "sha256": space.sha256},
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
            "components": reduction.kept,
            "percent_error": reduction.percent_error,
            "percent_errors": reduction.percent_errors.tolist(),
        }
    return content


def _reduction(mechanism: Mechanism, energy_error: float) -> Reduction:
    """Model reduction within the joints' limits, which is where the robot works."""
    from adaptctl.identifiability import essential_space, reduce, states_within_limits

    states = states_within_limits(mechanism, 2 * len(mechanism.parameter_names) + 1)
    return reduce(essential_space(mechanism, states=states, prove=False), mechanism, energy_error=energy_error)
