"""Report of `adaptctl tune` for a person to read."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from adaptctl.cli.output import WrappedTable, titled
from adaptctl.tuning import Tuning


def report(tuning: Tuning) -> Iterator[RenderableType]:
    """Renderable parts, texts and tables of the package rich, of the report that `adaptctl tune` prints, from top to
    bottom: a verdict of failure, where it is one, each joint's gains and reference, what limits the gains, the errors
    of verifying runs, and notes, the last two where there are any. Nothing is raised."""
    if tuning.failed:
        yield Text(f"FAILED: with these gains the arm does not learn: {tuning.verified[0]}", style="bold red")
    method = f"{tuning.substeps} steps of {type(tuning.integrator).__name__} a period of {tuning.period:g} s"
    yield Text.assemble((tuning.mechanism.name, "bold"), f": gains by rule for a rigid arm without noise; {method}")
    yield titled("Gains and reference (SI units)", _joints(tuning))
    yield titled("What limits the gains", _limits(tuning))
    if tuning.verified:
        yield titled("Runs of 20 s, RMS errors of the first second and of the last two", *_runs(tuning))
    if tuning.notes:
        yield titled("Notes", Group(*(Text(note, style="yellow") for note in tuning.notes)))


def _joints(tuning: Tuning) -> WrappedTable:
    rows: list[list[str | Text]] = []
    reference = tuning.reference
    moved = [getattr(reference, name).ravel() for name in ("center", "amplitude", "frequency")]
    for j, joint in enumerate(tuning.mechanism.primary_joints):
        numbers = (tuning.gains.bandwidth[j], tuning.gains.damping[j], *(values[j] for values in moved))
        rows.append([Text(joint.name), *(f"{x:.3g}" for x in numbers), f"{tuning.torque_share[j]:.0%}"])
    return WrappedTable(("joint", "Λ", "K", "centre", "amplitude", "Hz", "torque"), rows)


def _limits(tuning: Tuning) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    for joint, limit in zip(tuning.mechanism.primary_joints, tuning.limited_by, strict=True):
        table.add_row(Text(joint.name), Text(limit))
    return table


def _runs(tuning: Tuning) -> Iterator[Text]:
    for run in tuning.verified:
        yield Text(f"{run}{'' if run.learns else ' (does not learn)'}", style="" if run.learns else "red")
