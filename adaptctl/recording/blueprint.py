"""How a recording is laid out on the screen: what a person sees without a click."""

from __future__ import annotations

from dataclasses import dataclass

import rerun.blueprint as rrb

from adaptctl.recording import views
from adaptctl.recording.scene import WORLD
from adaptctl.recording.viewpoint import Viewpoint


@dataclass(frozen=True, eq=False)
class ScreenContents:
    """What the layout depends on."""

    viewpoint: Viewpoint
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


def blueprint(layout: ScreenContents) -> rrb.Blueprint:
    """Tabs: everything at a glance, the controllers, tracking, torque, parameters, and the offline stage."""
    containers = [_overview(layout), _controllers(layout), _tracking(layout), _torques(layout)]
    if layout.links:
        containers.append(_parameters(layout))
    return views.tabs(*containers, _offline())


def _overview(layout: ScreenContents) -> rrb.Container:
    left = rrb.Vertical(_arm(layout), views.text("summary", "Summary"), row_shares=[11, 9])
    curves = [_error(layout, 0), _error(layout, 1)] if len(layout.runs) > 1 else [_error(layout, 0)]
    curves.append(_lyapunov() if layout.has_lyapunov else _energy())
    curves += [_torque_share(), views.curves("/estimate/most_learnt", "Estimates that moved most · true values pale")]
    right = rrb.Grid(*curves, _spectrum(), grid_columns=2)
    return rrb.Horizontal(left, right, column_shares=[5, 7], name="Overview")


def _controllers(layout: ScreenContents) -> rrb.Container:
    errors = [_error(layout, i) for i in range(len(layout.runs))]
    together = views.curves("/error_decades", f"All controllers: RMS error, powers of ten of a {layout.error_unit}")
    return rrb.Vertical(
        together, rrb.Grid(*errors, grid_columns=min(len(errors), 4)), row_shares=[1, 1], name="Controllers"
    )


def _tracking(layout: ScreenContents) -> rrb.Container:
    joints = [
        views.curves(f"/position/{name}", f"{name}: actual and desired position [{unit}]")
        for name, unit in zip(layout.joints, layout.position_units, strict=True)
    ]
    return rrb.Grid(*joints, grid_columns=3 if len(joints) > 2 else 1, name="Tracking")


def _torques(layout: ScreenContents) -> rrb.Container:
    joints = [
        views.curves(f"/torque/{name}", f"{name}: torque and limits [{unit}]")
        for name, unit in zip(layout.joints, layout.torque_units, strict=True)
    ]
    return rrb.Grid(*joints, grid_columns=3 if len(joints) > 2 else 1, name="Torque")


def _parameters(layout: ScreenContents) -> rrb.Container:
    links = [
        views.curves(f"/estimate/{name}", f"{name}: estimates, true values pale [kg, kg m, kg m²]")
        for name in layout.links
    ]
    return rrb.Grid(*links, grid_columns=3 if len(links) > 2 else 1, name="Parameters")


def _offline() -> rrb.Container:
    return rrb.Horizontal(
        _spectrum(), views.text("basis/equations", "Independent parameters"), column_shares=[1, 1], name="Offline stage"
    )


def _arm(layout: ScreenContents) -> rrb.View:
    return views.arm(WORLD, "The arm · desired: green ghost · adaptation off: orange ghost", layout.viewpoint)


def _error(layout: ScreenContents, index: int) -> rrb.View:
    return views.curves(
        f"/error/{layout.runs[index]}",
        f"Tracking error [{layout.error_unit}] · {layout.labels[index]}",
        layout.error_range,
    )


def _lyapunov() -> rrb.View:
    return views.curves("/lyapunov", "Lyapunov function [J] · must never rise")


def _energy() -> rrb.View:
    return views.curves("/energy", "Energy [J]")


def _torque_share() -> rrb.View:
    return views.curves("/torque_share", "Torque / limit", (-1.1, 1.1))


def _spectrum() -> rrb.View:
    return views.bars("/basis/spectrum", "Energy spectrum · powers of ten above the threshold")
