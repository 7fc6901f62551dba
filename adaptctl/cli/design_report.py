"""Report of `adaptctl design` for a person to read."""

from __future__ import annotations

from collections.abc import Iterator

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from adaptctl.cli.output import titled
from adaptctl.design import AddedMass, DesignStudy, DesignTask
from adaptctl.recording.designed.wording import change, header, place, quantities

EQUATIONS = 3
"""Removals whose equations are printed; all are in the JSON."""


def report(study: DesignStudy, detail: AddedMass | None) -> Iterator[RenderableType]:
    """Renderable parts, texts and tables of the package rich, of the report that `adaptctl design` prints, from top to
    bottom: the task, costs of the mass on every link, counterweights with costs before and after, and changes of links
    (such as symmetry) by which parameters are no longer needed. `detail`, the effect of the body at one position,
    stands second unless None. Raises `RankError` where the mechanism's rank, its number of base parameters, cannot be
    certified."""
    yield Text(header(study))
    if detail is not None:
        yield titled(f"{detail.body.mass:g} kg on {detail.link} at {place(detail.body.center)}", _detail(detail))
    yield titled(f"What {study.body.mass:g} kg does to the energy that is carried, link by link", _links(study))
    found = study.counterweights
    yield titled(f"Counterweights for the least {found.objective}", _weights(study), _before_after(study))
    yield titled("Parameters that can go, each change alone", _removals(study), *_equations(study))


def _links(study: DesignStudy) -> Table:
    table = _table("link", "cheapest at", "", "centre of mass", "dearest at", "", "essential too")
    for cost, added in zip(study.links, study.added, strict=True):
        more = ", ".join(added.becomes_essential) or "-"
        table.add_row(
            Text(cost.link),
            place(cost.cheapest),
            change(cost.least),
            change(cost.at_center),
            place(cost.dearest),
            change(cost.most),
            Text(more),
        )
    return table


def _detail(added: AddedMass) -> Table:
    table = _table("", "before", "with it")
    task = added.task
    pairs = zip(quantities(task, added.percent), quantities(_with(added), added.percent), strict=True)
    for (what, before), (_, after) in pairs:
        table.add_row(what, before, after)
    table.add_row("energy of its own", "", f"{added.own_energy:.4g} J")
    table.add_row("becomes essential", "", Text(", ".join(added.becomes_essential) or "nothing"))
    for name, value in added.changed:
        table.add_row(Text(f"{name}*"), "", f"{value:+.4g}")
    return table


def _with(added: AddedMass) -> DesignTask:
    return added.task.with_parameters(added.parameters)


def _weights(study: DesignStudy) -> RenderableType:
    found = study.counterweights
    if not found.weights:
        return Text("None helps within these bounds.")
    table = _table("link", "mass", "of at most", "at")
    most = {places.link: places.mass for places in found.within}
    for weight in found.weights:
        table.add_row(Text(weight.link), f"{weight.mass:.3g} kg", f"{most[weight.link]:.3g} kg", place(weight.place))
    return table


def _before_after(study: DesignStudy) -> Table:
    table, percent = _table("", "before", "after"), study.percent
    after = study.counterweights.balanced
    for (what, old), (_, new) in zip(quantities(study.task, percent), quantities(after, percent), strict=True):
        table.add_row(what, old, new)
    return table


def _removals(study: DesignStudy) -> Table:
    table = _table("what to do", "parameters that go", "left", "operations saved")
    for removal, saved in study.worthwhile:
        table.add_row(Text(removal.words), Text(", ".join(removal.gone)), str(removal.rank), str(saved))
    return table


def _equations(study: DesignStudy) -> Iterator[Group]:
    for removal, _ in study.worthwhile[:EQUATIONS]:
        old = [Text(f"  - {equation}") for equation in removal.before if equation.partition("*")[0] in removal.gone]
        new = [Text(f"  + {equation}") for equation in removal.after if equation not in removal.before]
        shown = [line for line in new if line.plain.endswith("* = 0") or len(new) <= 2 * len(old)]
        more = len(new) - len(shown)
        rest = [Text(f"    and {more} more equations lose terms", style="dim")] if more else []
        yield Group(Text(removal.words, style="bold"), *old, *shown, *rest)


def _table(*heads: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for head in heads:
        table.add_column(head, overflow="fold")
    return table
