"""`adaptctl design`: where a mass may be added to a robot, which counterweights help it, which parameters can go."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from adaptctl.cli.output import WrappedTable, headed, print_json, print_parts, stacked, titled, words

if TYPE_CHECKING:
    from rich.console import Group, RenderableType
    from rich.table import Table

    from adaptctl.design import AddedMass, DesignStudy, DesignTask
    from adaptctl.design.driving import DrivenArm

Names = tuple[str, ...]
EQUATIONS = 3
"""Removals whose equations are printed; all are in the JSON."""


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
    drive: Annotated[
        bool, Parameter(help="Also run it in closed loop, as it is described and with the counterweights.")
    ] = False,
    duration: Annotated[float | None, Parameter(help="Length of these runs, s; else 20.")] = None,
    period: Annotated[float | None, Parameter(help="Their control period, s; else 0.001.")] = None,
    components: Annotated[int | None, Parameter(help="That their small controllers carry; else 10, or all.")] = None,
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
    `beyond` of its diagonal. With `drive`, Slotine and Li's law follows one reference before and after, with the gains
    of `adaptctl tune`: adapting all parameters, adapting the few components of most energy, and with their true values.

    Raises `InputError` for unknown links and objectives, numbers out of range, `at` without `link`, a `mass` besides a
    `body`, and positions outside the link's box; `NotFoundError` for an unknown robot or body, `FileError` for a
    robot's file that cannot be used and a folder that is not empty or cannot be written, `RankError` where the number
    of identifiable parameters cannot be certified, `LoopError` where kinematic loops cannot be closed; with `drive`
    `InputError` for a robot with friction, and what `adaptctl tune` raises.
    """
    from adaptctl.design import DesignTask, design_study
    from adaptctl.design.files import as_builtins
    from adaptctl.dynamics import load
    from adaptctl.errors import InputError
    from adaptctl.packages import require_for_results

    if out is not None:
        require_for_results()
    if at is not None and link is None:
        raise InputError("--at says where on a link: give --link too")
    if body is not None and mass is not None:
        raise InputError("--mass is of a point, and --body has its own: give one of them")
    asked = {"duration": duration, "period": period, "components": components}
    given = {name: value for name, value in asked.items() if value is not None}
    if given and not drive:
        raise InputError(f"--{next(iter(given))} is of runs in closed loop: give --drive too")
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
    runs = _driven(study, seed, **given) if drive else ()
    content = as_builtins(study, detail) | {"bodies": study.bodies}
    content |= {"runs": {run.name: run.demand._asdict() for run in runs}} if runs else {}
    if out is not None:
        from adaptctl.design.files import write_study
        from adaptctl.folders import replacing_folder

        with replacing_folder(out, overwrite) as folder:
            write_study(folder, study, content, runs=runs)
    if json:
        print_json(content)
    else:
        print_parts(report(study, detail, runs))


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


def _driven(study: DesignStudy, seed: int, **given: Any) -> tuple[DrivenArm, ...]:
    """Runs in closed loop, which a person sees going on."""
    from adaptctl.cli.experiment import shown_progress
    from adaptctl.design.driving import driven

    with shown_progress() as progress:
        return driven(study, seed=seed, progress=lambda share: progress("Runs in closed loop", share), **given)


def report(
    study: DesignStudy, detail: AddedMass | None = None, runs: Sequence[DrivenArm] = ()
) -> Iterator[RenderableType]:
    """Renderable parts, texts and tables of the package rich, of the report that `adaptctl design` prints, from top to
    bottom: the task, costs of the mass on every link and of common bodies, counterweights with costs before and after,
    the closed-loop `runs`, if there are any, and changes of links (such as symmetry) by which parameters are no longer
    needed. `detail`, the effect of the body at one position, stands second unless None. Raises `RankError` where the
    mechanism's rank, its number of base parameters, cannot be certified."""
    from adaptctl.design.report import header, place

    yield words(header(study))
    if detail is not None:
        yield titled(f"{detail.body.mass:g} kg on {detail.link} at {place(detail.body.center)}", _detail_table(detail))
    yield titled(f"What {study.body.mass:g} kg does to the energy that is carried, link by link", _links(study))
    yield titled("What common bodies do to it, their centre at the link's centre of mass", _bodies(study))
    found = study.counterweights
    yield titled(f"Counterweights for the least {found.objective}", _weights(study), _before_after(study))
    if runs:
        yield titled("In closed loop, root mean squares", _runs(runs))
    yield titled("Parameters that can go, each change alone", _removals(study), *_equations(study))


def _links(study: DesignStudy) -> Table:
    from adaptctl.design.report import change, place

    heads = ("link", "cheapest at", "", "centre of mass", "dearest at", "", "essential too")
    return headed(
        heads,
        (
            (c.link, place(c.cheapest), change(c.least), change(c.at_center), place(c.dearest), change(c.most), more)
            for c, more in zip(study.links, (", ".join(a.becomes_essential) or "-" for a in study.added), strict=True)
        ),
    )


def _bodies(study: DesignStudy) -> Table:
    from adaptctl.design.report import change

    names, links = list(study.bodies), [places.link for places in study.within]
    return headed(("link", *names), ((link, *(change(study.bodies[name][link]) for name in names)) for link in links))


def _detail_table(added: AddedMass) -> Table:
    from adaptctl.design.report import quantities

    task = added.task
    after = quantities(task.with_parameters(added.parameters), added.percent)
    rows = [(what, old, new) for (what, old), (_, new) in zip(quantities(task, added.percent), after, strict=True)]
    rows.append(("energy of its own", "", f"{added.own_energy:.4g} J"))
    rows.append(("becomes essential", "", ", ".join(added.becomes_essential) or "nothing"))
    return headed(
        ("", "before", "with it"), rows + [(f"{name}*", "", f"{value:+.4g}") for name, value in added.changed]
    )


def _weights(study: DesignStudy) -> RenderableType:
    from adaptctl.design.report import place

    found = study.counterweights
    most = {places.link: f"{places.mass:.3g} kg" for places in found.within}
    rows = [(w.link, f"{w.mass:.3g} kg", most[w.link], place(w.place)) for w in found.weights]
    return headed(("link", "mass", "of at most", "at"), rows) if rows else words("None helps within these bounds.")


def _before_after(study: DesignStudy) -> Table:
    from adaptctl.design.report import quantities

    pairs = (quantities(task, study.percent) for task in (study.task, study.counterweights.balanced))
    rows = ((what, old, new) for (what, old), (_, new) in zip(*pairs, strict=True))
    return headed(("", "before", "after"), rows)


def _runs(runs: Sequence[DrivenArm]) -> WrappedTable:
    """A row a run: its error, that of its last two seconds, or when it was stopped, and what its motors did."""
    from adaptctl.design.report import run_rows

    return WrappedTable(("rad, m", "error", "last 2 s", "torque, of limit", "work"), run_rows(runs))


def _removals(study: DesignStudy) -> Table:
    rows = ((r.words, ", ".join(r.gone), str(r.rank), str(saved)) for r, saved in study.worthwhile)
    return headed(("what to do", "parameters that go", "left", "operations saved"), rows)


def _equations(study: DesignStudy) -> Iterator[Group]:
    for removal, _ in study.worthwhile[:EQUATIONS]:
        old = [f"  - {equation}" for equation in removal.before if equation.partition("*")[0] in removal.gone]
        new = [f"  + {equation}" for equation in removal.after if equation not in removal.before]
        shown = [line for line in new if line.endswith("* = 0") or len(new) <= 2 * len(old)]
        more = len(new) - len(shown)
        rest = [words((f"    and {more} more equations lose terms", "dim"))] if more else []
        yield stacked(words((removal.words, "bold")), *map(words, (*old, *shown)), *rest)
