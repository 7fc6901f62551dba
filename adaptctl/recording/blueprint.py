"""Layout of a comparison's recording on the screen: its tabs and views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import rerun.blueprint as rrb

from adaptctl.recording import views
from adaptctl.recording.scene import WORLD
from adaptctl.recording.viewpoint import Viewpoint

MANY = 8
"""controllers whose small views have no room for a legend of joints, whose colours are those of the overview"""
TALL = 12
"""controllers above which a legend of all of them needs more than half of the window's height"""
LONGEST = 12
"""characters of a short name in a legend"""


@dataclass(frozen=True, eq=False)
class ScreenContents:
    """Names, units and ranges in a comparison's recording, on which its layout on the screen depends.

    `viewpoint` is the camera's position and target. `error_unit`, "mrad", "mm" or "mrad or mm", is the unit of the
    joints' errors and of `error_range`, the lower and upper end of their axis. `links` are the names, as parts of
    entity paths, of the links and joints with parameter estimates, `link_units` the units of each one's as one text,
    such as "kg·m, kg·m²". `joints` are the joints' names, `position_units` and `torque_units` their units. `runs` are
    the names of the runs whose errors are shown, first the one that the comparison is about, and `labels` their titles.
    `lyapunov` is a text on the Lyapunov function, `leading` the title of errors that are shown before the joints', both
    None where there are none. `end`, s, is where the first run ended and time axes end; `truth_known`, True by default,
    says whether true parameters are drawn. Nothing is checked at construction.
    """

    viewpoint: Viewpoint
    error_unit: str
    error_range: tuple[float, float]
    """the errors shown, in that unit"""
    links: tuple[str, ...]
    """entities of the links and joints that have estimates"""
    link_units: tuple[str, ...]
    """units of those estimates, one text a link or joint: ``kg·m, kg·m²``"""
    joints: tuple[str, ...]
    """entities of the joints"""
    position_units: tuple[str, ...]
    torque_units: tuple[str, ...]
    runs: tuple[str, ...]
    """entities of the runs whose errors are shown; the subject first"""
    labels: tuple[str, ...]
    """what those runs are called"""
    lyapunov: str | None
    """what the Lyapunov function does, where there is one"""
    leading: str | None
    """what is shown before the joints' errors, where the experiment is about something else"""
    end: float
    """of the run, s"""
    truth_known: bool = True

    @property
    def truth(self) -> str:
        """Text on true parameters for the titles of views of estimates: "level lines: true values" where `truth_known`
        of these contents is True, else "true values unknown"."""
        return "level lines: true values" if self.truth_known else "true values unknown"


def blueprint(shown: ScreenContents) -> rrb.Blueprint:
    """Blueprint, the layout of a comparison's rerun recording, in tabs: an overview; errors of all controllers;
    positions; torques; parameter estimates, where there are any; and the independent parameters with their equations.
    `shown` are the contents that the layout depends on. Raises `ValueError` where they have another number of units
    than of joints or links, `IndexError` where they have fewer labels than runs."""
    containers = [_overview(shown), _controllers(shown), _tracking(shown), _torques(shown)]
    if shown.links:
        containers.append(_parameters(shown))
    return views.tabs(*containers, _offline())


def _overview(shown: ScreenContents) -> rrb.Container:
    left = rrb.Vertical(_arm(shown), views.text("summary", "Summary"), row_shares=[11, 9])
    curves = [views.curves("/leading", shown.leading, shown.end, room=views.LONG)] if shown.leading else []
    curves += [_error(shown, i) for i in range(min(2 - len(curves), len(shown.runs)))]
    curves.append(_lyapunov(shown) if shown.lyapunov else _energy(shown))
    curves += [
        _torque_share(shown),
        views.curves("/estimate/most_learnt", f"Estimates that moved most · {shown.truth}", shown.end, room=views.LONG),
    ]
    right = rrb.Grid(*curves, _spectrum(), grid_columns=2)
    return rrb.Horizontal(left, right, column_shares=[5, 7], name="Overview")


def _controllers(shown: ScreenContents) -> rrb.Container:
    errors = [_error(shown, i, legend=len(shown.runs) <= MANY) for i in range(len(shown.runs))]
    title = f"All controllers: RMS error of all joints, powers of ten of a {shown.error_unit}"
    together = views.curves("/error_decades", title, shown.end)
    shares = [3, 2] if len(shown.runs) > TALL else [1, 1]
    return rrb.Vertical(
        together, rrb.Grid(*errors, grid_columns=min(len(errors), 4)), row_shares=shares, name="Controllers"
    )


def _tracking(shown: ScreenContents) -> rrb.Container:
    joints = [
        views.curves(f"/position/{name}", f"{name}: actual and desired position [{unit}]", shown.end)
        for name, unit in zip(shown.joints, shown.position_units, strict=True)
    ]
    return rrb.Grid(*joints, grid_columns=3 if len(joints) > 2 else 1, name="Tracking")


def _torques(shown: ScreenContents) -> rrb.Container:
    joints = [
        views.curves(f"/torque/{name}", f"{name}: torque and limits [{unit}]", shown.end)
        for name, unit in zip(shown.joints, shown.torque_units, strict=True)
    ]
    return rrb.Grid(*joints, grid_columns=3 if len(joints) > 2 else 1, name="Torque")


def _parameters(shown: ScreenContents) -> rrb.Container:
    links = [
        views.curves(f"/estimate/{name}", f"{name}: estimates · {shown.truth} [{units}]", shown.end)
        for name, units in zip(shown.links, shown.link_units, strict=True)
    ]
    return rrb.Grid(*links, grid_columns=3 if len(links) > 2 else 1, name="Parameters")


def _offline() -> rrb.Container:
    return rrb.Horizontal(
        _spectrum(), views.text("basis/equations", "Independent parameters"), column_shares=[1, 1], name="Offline stage"
    )


def _arm(shown: ScreenContents) -> rrb.View:
    return views.arm(WORLD, "The arm · desired: green ghost · adaptation off: orange ghost", shown.viewpoint)


def _error(shown: ScreenContents, index: int, *, legend: bool = True) -> rrb.View:
    return views.curves(
        f"/error/{shown.runs[index]}",
        f"{shown.labels[index]} · joints' tracking errors [{shown.error_unit}]",
        shown.end,
        shown.error_range,
        _room(shown.joints),
        legend=legend,
    )


def _lyapunov(shown: ScreenContents) -> rrb.View:
    return views.curves("/lyapunov", f"Lyapunov function [J] · {shown.lyapunov}", shown.end)


def _energy(shown: ScreenContents) -> rrb.View:
    return views.curves("/energy", "Energy [J]", shown.end)


def _torque_share(shown: ScreenContents) -> rrb.View:
    return views.curves("/torque_share", "Torque / limit", shown.end, (-1.1, 1.1), _room(shown.joints))


def _room(names: Sequence[str]) -> float:
    """Room for a legend of these names."""
    return views.LONG if max(map(len, names), default=0) > LONGEST else views.SHORT


def _spectrum() -> rrb.View:
    return views.bars("/basis/spectrum", "Energy spectrum, powers of ten above the threshold · grey: null space")
