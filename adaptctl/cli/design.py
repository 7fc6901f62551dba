"""`adaptctl design`: where a mass may be added to a robot, which counterweights help it, which parameters can go."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from adaptctl.cli.output import print_json, print_parts

if TYPE_CHECKING:
    from adaptctl.design import AddedMass, DesignTask

Names = tuple[str, ...]


def design(
    robot: Annotated[str, Parameter(help="A built-in robot's name, or a .urdf, .xml (MJCF) or .toml file.")],
    /,
    *,
    mass: Annotated[float | None, Parameter(metavar="KG", help="Mass of the point that is added; else 1.")] = None,
    body: Annotated[
        str | None, Parameter(metavar="NAME", help="A body instead of a point: gripper, camera or motor.")
    ] = None,
    link: Annotated[str | None, Parameter(help="Also tell all that it changes on this link.")] = None,
    at: Annotated[
        tuple[float, float, float] | None,
        Parameter(metavar="X Y Z", help="Where on that link, m in its frame; else its centre of mass."),
    ] = None,
    counterweights: Annotated[
        Names, Parameter(metavar="LINK", help="Links that may carry counterweights; else the heaviest six.")
    ] = (),
    objective: Annotated[
        str, Parameter(help="What they make least: energy, torque, coupling or components.")
    ] = "energy",
    share: Annotated[float, Parameter(help="Largest counterweight over its link's mass.")] = 0.2,
    beyond: Annotated[float, Parameter(help="Room beyond a link's joints over its length.")] = 0.5,
    energy_error: Annotated[float, Parameter(metavar="PERCENT", help="At which components are counted.")] = 1.0,
    speed: Annotated[float, Parameter(help="Of the task's random states, over sqrt(g/L).")] = 0.25,
    samples: Annotated[int, Parameter(help="Number of the task's random states.")] = 1000,
    seed: Annotated[int, Parameter(help="Seed of all that is drawn.")] = 0,
    floating_base: Annotated[
        bool, Parameter(help="Let a URDF file's root link float instead of being fixed to the ground.")
    ] = False,
    json: Annotated[bool, Parameter(help="Print JSON instead of tables.")] = False,
    out: Annotated[
        Path | None, Parameter(metavar="DIR", help="Also write design.json, report, figures and recording.")
    ] = None,
    overwrite: Annotated[bool, Parameter(help="Write into a folder that is not empty.")] = False,
) -> None:
    """Print the costs of added mass at positions on a robot, and the savings by counterweights and symmetry, or with
    `json` a JSON object; with `out`, write them into a folder with report, figures and recording.

    The costs are of random motions within the joints' limits, at speeds of `speed` sqrt(g/L), g being the gravity and L
    the largest distance from a joint to the next or to its link's frame. Components are combinations of inertial
    parameters: those are counted that are needed to keep the error of the energy to `energy_error` percent. Coupling is
    the mass matrix off its diagonal. Masses may be in a box about a link's joints and centre of mass, widened by
    `beyond` of its diagonal.

    Raises `InputError` for unknown links and objectives, numbers out of range, `at` without `link`, a `mass` besides a
    `body`, and positions outside the link's box; `NotFoundError` for an unknown robot or body, `FileError` for a
    robot's file that cannot be used and a folder that is not empty or cannot be written, `RankError` where the number
    of identifiable parameters cannot be certified, `LoopError` where kinematic loops cannot be closed.
    """
    from adaptctl.design import DesignTask, design_study
    from adaptctl.dynamics import load
    from adaptctl.errors import InputError
    from adaptctl.recording.designed.summary import as_builtins

    if at is not None and link is None:
        raise InputError("--at says where on a link: give --link too")
    if body is not None and mass is not None:
        raise InputError("--mass is of a point, and --body has its own: give one of them")
    added = body or (1.0 if mass is None else mass)
    mechanism = load(robot, floating_base=floating_base)
    task = DesignTask.within_limits(mechanism, samples, seed, speed)
    detail = None if link is None else _detail(task, link, added, at, (share, beyond), energy_error)
    study = design_study(
        task,
        added,
        links=counterweights,
        share=share,
        beyond=beyond,
        objective=objective,
        percent=energy_error,
        seed=seed,
    )
    content = as_builtins(study, detail)
    if out is not None:
        from adaptctl.folders import replacing_folder
        from adaptctl.recording.designed.artifacts import write_study

        with replacing_folder(out, overwrite) as folder:
            write_study(folder, study, content)
    if json:
        print_json(content)
    else:
        from adaptctl.cli.design_report import report

        print_parts(report(study, detail))


def _detail(
    task: DesignTask,
    link: str,
    body: str | float,
    at: tuple[float, float, float] | None,
    room: tuple[float, float],
    percent: float,
) -> AddedMass:
    """The costs of a body added at a place of a link, which must be within the link's bounds."""
    from adaptctl.design import PlaceBounds, added_mass
    from adaptctl.design.study import named_body

    places = PlaceBounds.of(task.mechanism, link, *room)
    place = task.center_of_mass(link) if at is None else at
    places.require(place)
    return added_mass(task, link, named_body(body), place, percent=percent)
