"""`adaptctl design`: where a mass may be added to a robot, which counterweights help it, which parameters can go."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from adaptctl.cli.output import Json, Overwrite, Robot, print_json, print_sections
from adaptctl.cli.robot import AS_USUAL, RobotFlags

if TYPE_CHECKING:
    from adaptctl.design import AddedMass, DesignStudy, DesignTask
    from adaptctl.design.driving import DrivenArm

Names = tuple[str, ...]


def design(
    robot: Robot,
    /,
    *,
    mass: Annotated[float | None, Parameter(metavar="KG")] = None,
    body: Annotated[str | None, Parameter(metavar="NAME")] = None,
    link: str | None = None,
    mount: Annotated[tuple[float, float, float] | None, Parameter(metavar="X Y Z")] = None,
    counterweights: Annotated[Names, Parameter(metavar="LINK")] = (),
    objective: str = "energy",
    mass_ratio: float = 0.2,
    max_offset: float = 0.5,
    energy_error: Annotated[float, Parameter(metavar="PERCENT")] = 1.0,
    speed: float = 0.25,
    samples: int = 1000,
    seed: int = 0,
    drive: bool = False,
    duration: float | None = None,
    control_period: float | None = None,
    components: int | None = None,
    reading: RobotFlags = AS_USUAL,
    json: Json = False,
    out: Annotated[Path | None, Parameter(metavar="DIR")] = None,
    overwrite: Overwrite = False,
) -> None:
    """
    Print the costs of added masses on a robot, and the savings by counterweights and symmetry.

    The costs are those of random motions within the joints' limits. See docs/cli.md.

    Parameters
    ----------
    mass : float
        Added point mass, kg. Default: 1.
    body : str
        Added body instead of a point mass: gripper, camera or motor.
    link : str
        Also print all effects of the added mass on this link.
    mount : tuple of float
        Position on that link, m in its frame. Default: its center of mass.
    counterweights : list of str
        Links that may carry counterweights. Default: the heaviest six.
    objective : str
        Quantity to minimise: energy, torque, coupling or components.
    mass_ratio : float
        Largest counterweight mass divided by the mass of its link.
    max_offset : float
        Largest distance of a counterweight beyond the joints of its link, divided by the link's length.
    energy_error : float
        Energy error, %, down to which essential components are counted.
    speed : float
        Speed of the random states, divided by sqrt(g/L) for an arm of length L.
    samples : int
        Number of random states over which energies and torques are evaluated.
    seed : int
        Seed of all random numbers.
    drive : bool
        Also simulate the closed loop, without and with the counterweights.
    duration : float
        Duration of the closed-loop runs, s. Default: 20.
    control_period : float
        Control period of the closed-loop runs, s. Default: 0.001.
    components : int
        Number of essential components that the reduced controllers adapt. Default: 10, or all if fewer.
    out : Path
        Also write design.json, report, figures and recording.

    Raises
    ------
    InputError
        If an argument is out of range or does not go with another.
    NotFoundError
        If the robot or the body is unknown.
    FileError
        If a file cannot be used or written.
    RankError
        If the number of identifiable parameters cannot be certified.
    LoopError
        If kinematic loops cannot be closed.
    """
    from adaptctl.arrays import finite_number, positive_number
    from adaptctl.description.link import MAX_INERTIAL_PARAMETER
    from adaptctl.design import DesignTask, design_study
    from adaptctl.design.report import as_builtins, report, write_study
    from adaptctl.errors import InputError
    from adaptctl.folders import replacing_folder, validate_folder
    from adaptctl.optional_packages import validate_for_results

    if out is not None:
        validate_for_results()
        validate_folder(out, overwrite)
    if mount is not None and link is None:
        raise InputError("--mount is a position on a link: add --link")
    if body is not None and mass is not None:
        raise InputError("--mass is for a point mass, and --body has a mass of its own: give one of them")
    finite_number(energy_error, "--energy-error")
    if mass is not None:
        positive_number(mass, "--mass: expected a mass above 0 kg", most=MAX_INERTIAL_PARAMETER)
    asked = {"duration": duration, "control_period": control_period, "components": components}
    given = {name: value for name, value in asked.items() if value is not None}
    if given and not drive:
        raise InputError(f"--{next(iter(given)).replace('_', '-')} is for closed-loop runs: add --drive")
    added = body or (1.0 if mass is None else mass)
    mechanism = reading.load(robot)
    task = DesignTask.within_limits(mechanism, samples, seed, speed)
    detail = None if link is None else _detail(task, link, added, mount, (mass_ratio, max_offset), energy_error)
    study = design_study(
        task,
        added,
        links=counterweights,
        mass_ratio=mass_ratio,
        max_offset=max_offset,
        objective=objective,
        percent=energy_error,
        seed=seed,
    )
    runs = _driven(study, seed, **given) if drive else ()
    content = as_builtins(study, detail, runs)
    if json and out is None:
        print_json(content)
        return
    shown = report(study, detail, runs)
    if out is not None:
        with replacing_folder(out, overwrite) as folder:
            write_study(folder, study, shown, content, runs)
    if json:
        print_json(content)
    else:
        print_sections(shown.sections)


def _detail(
    task: DesignTask,
    link: str,
    body: str | float,
    at: tuple[float, float, float] | None,
    room: tuple[float, float],
    percent: float,
) -> AddedMass:
    """The costs of a body added at a place of a link, which must be within the link's bounds."""
    from adaptctl.design import MountingBounds, added_mass
    from adaptctl.design.study import named_body

    places = MountingBounds.for_link(task.mechanism, link, *room)
    place = task.center_of_mass(link) if at is None else at
    places.validate(place)
    return added_mass(task, link, named_body(body), place, percent=percent)


def _driven(study: DesignStudy, seed: int, **given: Any) -> tuple[DrivenArm, ...]:
    from adaptctl.cli.experiment import shown_progress
    from adaptctl.design.driving import driven

    with shown_progress() as progress:
        return driven(study, seed=seed, progress=lambda share: progress("Closed-loop runs", share), **given)
