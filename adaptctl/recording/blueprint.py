"""How a recording is laid out on the screen: what a person sees without a click."""

from __future__ import annotations

from dataclasses import dataclass

import rerun as rr
import rerun.blueprint as rrb

from adaptctl.mechanism.pose import Array
from adaptctl.recording.palette import Color
from adaptctl.recording.scene import TIMELINE, WORLD

NIGHT = Color(22, 26, 36)
TRAIL = 4.0
"""s of the tip's path that stay visible."""


@dataclass(frozen=True, eq=False)
class Layout:
    """What the layout depends on."""

    eye: Array
    """(3,) where the camera stands, m"""
    target: Array
    """(3,) what it looks at, m"""
    floor: float
    """height of the floor, m"""
    error_unit: str
    error_range: tuple[float, float]
    """the errors shown, in that unit"""
    links: tuple[str, ...]
    """entities of the links that have estimates"""
    joints: tuple[str, ...]
    """entities of the joints"""
    position_units: tuple[str, ...]
    torque_units: tuple[str, ...]
    runs: tuple[str, ...]
    """entities of the runs whose errors are shown; the subject first"""
    labels: tuple[str, ...]
    """what those runs are called"""
    has_lyapunov: bool


def blueprint(layout: Layout) -> rrb.Blueprint:
    """Tabs: everything at a glance, the controllers, tracking, torque, parameters, and the offline stage."""
    tabs = [_overview(layout), _controllers(layout), _tracking(layout), _torques(layout)]
    if layout.links:
        tabs.append(_parameters(layout))
    tabs.append(_offline())
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing", loop_mode="all"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_layout=False,
        auto_views=False,
    )


def _overview(layout: Layout) -> rrb.Container:
    left = rrb.Vertical(_arm(layout), _text("summary", "Summary"), row_shares=[11, 9])
    curves = [_error(layout, 0), _error(layout, 1)] if len(layout.runs) > 1 else [_error(layout, 0)]
    curves.append(_lyapunov() if layout.has_lyapunov else _energy())
    curves += [_torque_share(), _curves("/estimate/most_learnt", "Estimates that moved most · true values pale")]
    right = rrb.Grid(*curves, _spectrum(), grid_columns=2)
    return rrb.Horizontal(left, right, column_shares=[5, 7], name="Overview")


def _controllers(layout: Layout) -> rrb.Container:
    errors = [_error(layout, i) for i in range(len(layout.runs))]
    together = _curves("/error_decades", f"All controllers: RMS error, powers of ten of a {layout.error_unit}")
    return rrb.Vertical(
        together, rrb.Grid(*errors, grid_columns=min(len(errors), 4)), row_shares=[1, 1], name="Controllers"
    )


def _tracking(layout: Layout) -> rrb.Container:
    joints = [
        _curves(f"/position/{name}", f"{name}: actual and desired position [{unit}]")
        for name, unit in zip(layout.joints, layout.position_units, strict=True)
    ]
    return rrb.Grid(*joints, grid_columns=3 if len(joints) > 2 else 1, name="Tracking")


def _torques(layout: Layout) -> rrb.Container:
    joints = [
        _curves(f"/torque/{name}", f"{name}: torque and limits [{unit}]")
        for name, unit in zip(layout.joints, layout.torque_units, strict=True)
    ]
    return rrb.Grid(*joints, grid_columns=3 if len(joints) > 2 else 1, name="Torque")


def _parameters(layout: Layout) -> rrb.Container:
    links = [
        _curves(f"/estimate/{name}", f"{name}: estimates, true values pale [kg, kg m, kg m²]") for name in layout.links
    ]
    return rrb.Grid(*links, grid_columns=3 if len(links) > 2 else 1, name="Parameters")


def _offline() -> rrb.Container:
    return rrb.Horizontal(
        _spectrum(), _text("basis/equations", "Independent parameters"), column_shares=[1, 1], name="Offline stage"
    )


def _arm(layout: Layout) -> rrb.View:
    window = rr.VisibleTimeRange(
        TIMELINE,
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-TRAIL),
        end=rr.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        origin=f"/{WORLD}",
        name="The arm · desired: green ghost · adaptation off: orange ghost",
        background=NIGHT,
        eye_controls=rrb.EyeControls3D(position=layout.eye, look_target=layout.target, eye_up=(0.0, 0.0, 1.0)),
        line_grid=rrb.LineGrid3D(
            visible=True,
            spacing=0.25,
            plane=rr.components.Plane3D((0.0, 0.0, 1.0), layout.floor),
            color=(255, 255, 255, 22),
        ),
        time_ranges=window,
    )


def _error(layout: Layout, index: int) -> rrb.View:
    return _curves(
        f"/error/{layout.runs[index]}",
        f"Tracking error [{layout.error_unit}] · {layout.labels[index]}",
        layout.error_range,
    )


def _lyapunov() -> rrb.View:
    return _curves("/lyapunov", "Lyapunov function [J] · must never rise")


def _energy() -> rrb.View:
    return _curves("/energy", "Energy [J]")


def _torque_share() -> rrb.View:
    return _curves("/torque_share", "Torque / limit", (-1.1, 1.1))


def _spectrum() -> rrb.View:
    return rrb.BarChartView(
        origin="/basis/spectrum",
        name="Energy spectrum · powers of ten above the threshold",
        plot_legend=rrb.Corner2D.RightTop,
    )


def _text(origin: str, name: str) -> rrb.View:
    return rrb.TextDocumentView(origin=f"/{origin}", name=name)


def _curves(origin: str, name: str, bounds: tuple[float, float] | None = None) -> rrb.View:
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_y=rrb.ScalarAxis(range=bounds) if bounds else None,
        plot_legend=rrb.Corner2D.RightTop,
    )
