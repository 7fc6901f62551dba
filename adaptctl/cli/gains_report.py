"""Report of `adaptctl gains` for a person to read."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.text import Text

from adaptctl.cli.output import titled
from adaptctl.cli.tables import WrappedTable
from adaptctl.control import GainDesign

METHODS = {"bandwidth": "from a bandwidth and a damping ratio", "poles": "by pole placement", "lqr": "by LQR"}


def report(design: GainDesign) -> Iterator[RenderableType]:
    """Renderable parts, texts and tables of the package rich, of the report that `adaptctl gains` prints, from top to
    bottom: the method, each joint's gains, the margins of each joint's loop, and of all joints together the sampled
    gain, the control period times the largest eigenvalue of M^-1 K, with the mass matrix M and the velocity gains K.
    Nothing is raised."""
    late = f" and a delay of {design.delay}" if design.delay else ""
    yield Text.assemble(
        (design.mechanism.name, "bold"),
        f": gains {METHODS[design.method]}, discretised for a control period of {design.period:g} s{late}",
    )
    yield titled("Gains (SI units; computed torque has ω and ζ, Slotine and Li's law Λ and K)", _gains(design))
    yield titled("Margins of each loop alone (inertia is the least there is, over the typical)", _margins(design))
    yield titled("All joints together", _together(design))


def _gains(design: GainDesign) -> WrappedTable:
    rows: list[list[str | Text]] = []
    cascade = design.gains if design.damped_enough else None
    for i, joint in enumerate(design.mechanism.primary_joints):
        feedback = design.feedback[i]
        numbers = [design.inertia[i], feedback.stiffness, feedback.rate, feedback.bandwidth, feedback.damping_ratio]
        lags = [cascade.bandwidth[i], cascade.damping[i]] if cascade else [math.nan, math.nan]
        rows.append([Text(joint.name), *map(_number, (*numbers, *lags))])
    return WrappedTable(("joint", "inertia", "stiffness", "rate", "ω", "ζ", "Λ", "K"), rows)


def _margins(design: GainDesign) -> WrappedTable:
    rows: list[list[str | Text]] = []
    for i, joint in enumerate(design.mechanism.primary_joints):
        of, least = design.margins[i], float(design.least_inertia[i])
        held = of.gain * least > 1.0
        rows.append(
            [
                Text(joint.name),
                f"× {_number(of.gain)}",
                Text(f"× {_number(least)}", style="" if held else "red"),
                f"{math.degrees(of.phase):.0f}°",
                f"{1e3 * of.delay:.3g} ms",
                f"{of.delay / design.period:.3g}",
                f"{_number(of.crossover)} rad/s",
            ]
        )
    return WrappedTable(("joint", "gain", "inertia", "phase", "delay", "periods", "crossover"), rows)


def _together(design: GainDesign) -> Group:
    """Sampled gain of the whole arm, and the fastest poles that the period carries."""
    gain = Text.assemble(
        "T_c λ_max(M⁻¹K) = ",
        (f"{design.sampled_gain:.3g}", "bold green"),
        f" at the worst configuration found; up to {design.largest_sampled_gain:.3g} is allowed, the rest is a margin",
    )
    room = Text("The period carries any poles." if math.isinf(design.fastest) else _room(design))
    remark = [] if design.damped_enough else [Text("Λ and K need a damping ratio of at least 1.", style="yellow")]
    return Group(gain, room, *remark)


def _room(design: GainDesign) -> str:
    return (
        f"The period carries poles {design.fastest:.3g} times as fast: the fastest at "
        f"{design.fastest * design.highest:.4g} 1/s instead of {design.highest:.4g}."
    )


def _number(value: float) -> str:
    return "–" if math.isnan(value) else "∞" if math.isinf(value) else f"{value:.4g}"
