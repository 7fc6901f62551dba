"""What `adaptctl gains` prints for a person to read."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rich import box
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from adaptctl.control import GainDesign

METHODS = {"bandwidth": "from a bandwidth and a damping ratio", "poles": "by pole placement", "lqr": "by LQR"}


def report(design: GainDesign) -> Iterator[RenderableType]:
    """The parts from top to bottom."""
    late = f" and a delay of {design.delay}" if design.delay else ""
    yield Text.assemble(
        (design.mechanism.name, "bold"),
        f": gains {METHODS[design.method]}, discretised for a control period of {design.period:g} s{late}",
    )
    yield _titled("Gains (SI units; computed torque has ω and ζ, Slotine and Li's law Λ and K)", _gains(design))
    yield _titled("Margins of each loop alone (inertia is the least there is, over the typical)", _margins(design))
    yield _titled("All joints together", _together(design))


def _gains(design: GainDesign) -> Table:
    table = _table("joint", "inertia", "stiffness", "rate", "ω", "ζ", "Λ", "K")
    cascade = design.gains if design.damped_enough else None
    for i, joint in enumerate(design.mechanism.primary_joints):
        feedback = design.feedback[i]
        numbers = [design.inertia[i], feedback.stiffness, feedback.rate, feedback.bandwidth, feedback.damping_ratio]
        lags = [cascade.bandwidth[i], cascade.damping[i]] if cascade else [math.nan, math.nan]
        table.add_row(Text(joint.name), *map(_number, (*numbers, *lags)))
    return table


def _margins(design: GainDesign) -> Table:
    table = _table("joint", "gain", "inertia", "phase", "delay", "periods", "crossover")
    for i, joint in enumerate(design.mechanism.primary_joints):
        of, least = design.margins[i], float(design.least_inertia[i])
        held = of.gain * least > 1.0
        table.add_row(
            Text(joint.name),
            f"× {_number(of.gain)}",
            Text(f"× {_number(least)}", style="" if held else "red"),
            f"{math.degrees(of.phase):.0f}°",
            f"{1e3 * of.delay:.3g} ms",
            f"{of.delay / design.period:.3g}",
            f"{_number(of.crossover)} rad/s",
        )
    return table


def _together(design: GainDesign) -> Group:
    """What the sampled loop of the whole arm carries."""
    gain = Text.assemble(
        "T_c λ_max(M⁻¹K) = ",
        (f"{design.sampled_gain:.3g}", "bold green"),
        f" over random configurations; up to {design.largest_sampled_gain:.3g} is allowed, the rest is a margin",
    )
    room = Text("The period carries any poles." if math.isinf(design.fastest) else _room(design))
    remark = [] if design.damped_enough else [Text("Λ and K need a damping ratio of at least 1.", style="yellow")]
    return Group(gain, room, *remark)


def _room(design: GainDesign) -> str:
    return (
        f"The period carries poles {design.fastest:.3g} times as fast: the fastest at "
        f"{design.fastest * design.highest:.4g} 1/s instead of {design.highest:.4g}."
    )


def _titled(title: str, part: RenderableType) -> Group:
    return Group(Text(), Text(title, style="bold"), Padding(part, (0, 0, 0, 2), expand=False))


def _table(first: str, *others: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column(first, no_wrap=True)
    for name in others:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _number(value: float) -> str:
    return "–" if math.isnan(value) else "∞" if math.isinf(value) else f"{value:.4g}"
