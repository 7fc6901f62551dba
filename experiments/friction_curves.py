"""Figure of friction over speed, joint by joint: the true one, and what was learned of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from adaptctl.arrays import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 200
COLUMNS = 3


class Curve(NamedTuple):
    """Named tuple of the data of one joint's friction over speed: `joint`, its name; `true` and `learned`, pairs of
    viscous (N m s/rad) and Coulomb (N m) friction; `stribeck`, the excess of static over Coulomb friction, N m;
    `speed`, rad/s, at which half of that is gone; and `speeds` (T,), rad/s, the joint's velocities at T samples of a
    run. `units` are the units, as text, of friction and of speed, "N·m" and "rad/s" by default; for a prismatic joint
    they are "N" and "m/s", and viscous friction is in N s/m. Nothing is checked at construction."""

    joint: str
    true: tuple[float, float]
    """viscous (N m s) and Coulomb (N m)"""
    stribeck: float
    """N m by which static friction exceeds Coulomb's"""
    speed: float
    """rad/s at which half of that is gone"""
    learned: tuple[float, float]
    """as `true`"""
    speeds: Array
    """(T,) rad/s, at which the joint moved"""
    units: tuple[str, str] = ("N·m", "rad/s")
    """of friction and of speed, as text"""


def friction_curves(curves: Sequence[Curve]) -> Figure:
    """Matplotlib figure of friction (N m, N if prismatic) over speed (rad/s, m/s), a panel for each of the `curves`, at
    least one, of a joint: the true friction with Stribeck's excess, the learned one of viscous and Coulomb friction,
    and a shaded histogram of the speeds at which the joint moved. Units are those of the curves. Nothing is checked."""
    from adaptctl.recording.drawing import MUTED, TRUTH, run_color, sheet

    rows = -(-len(curves) // COLUMNS)
    figure = sheet(2.0 * rows + 0.4)
    panels = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axes, curve in zip(panels, curves, strict=False):
        speeds = np.abs(curve.speeds)
        v = np.linspace(0.0, speeds.max(), POINTS)
        often = axes.twinx()
        often.hist(speeds, bins=30, color=MUTED.hex, alpha=0.2)
        often.set_axis_off()
        excess = curve.stribeck / (1.0 + (v / curve.speed) ** 2)
        axes.plot(v, curve.true[0] * v + curve.true[1] + excess, color=TRUTH.hex, label="true, with Stribeck's")
        axes.plot(v, curve.learned[0] * v + curve.learned[1], color=run_color(0).hex, label="learned: viscous, Coulomb")
        axes.set_ylim(bottom=0.0)
        axes.set_title(f"{curve.joint} [{curve.units[0]}]")
    for unused in panels[len(curves) :]:
        unused.set_visible(False)
    units = " or ".join(sorted({curve.units[1] for curve in curves}, reverse=True))
    figure.supxlabel(f"speed [{units}]", size=9)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure
