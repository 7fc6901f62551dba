"""Layout of a comparison's recording on the screen: its tabs and views."""

from __future__ import annotations

from dataclasses import dataclass

import rerun.blueprint as rrb

from adaptctl.recording import views
from adaptctl.recording.scene import WORLD
from adaptctl.recording.viewpoint import Viewpoint


@dataclass(frozen=True, eq=False)
class ScreenContents:
    """Names, units and ranges of what a comparison's recording shows: what its layout depends on."""

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
    truth_known: bool = True

    @property
    def truth(self) -> str:
        """What estimates' titles say of true values."""
        return "true values pale" if self.truth_known else "true values unknown"


def blueprint(shown: ScreenContents) -> rrb.Blueprint:
    """Tabs: everything at a glance, the controllers, tracking, torque, parameters, and the offline stage."""
    containers = [_overview(shown), _controllers(shown), _tracking(shown), _torques(shown)]
    if shown.links:
        containers.append(_parameters(shown))
    return views.tabs(*containers, _offline())


def _overview(shown: ScreenContents) -> rrb.Container:
    left = rrb.Vertical(_arm(shown), views.text("summary", "Summary"), row_shares=[11, 9])
    curves = [_error(shown, 0), _error(shown, 1)] if len(shown.runs) > 1 else [_error(shown, 0)]
    curves.append(_lyapunov() if shown.has_lyapunov else _energy())
    curves += [_torque_share(), views.curves("/estimate/most_learnt", f"Estimates that moved most · {shown.truth}")]
    right = rrb.Grid(*curves, _spectrum(), grid_columns=2)
    return rrb.Horizontal(left, right, column_shares=[5, 7], name="Overview")


def _controllers(shown: ScreenContents) -> rrb.Container:
    errors = [_error(shown, i) for i in range(len(shown.runs))]
    together = views.curves("/error_decades", f"All controllers: RMS error, powers of ten of a {shown.error_unit}")
    return rrb.Vertical(
        together, rrb.Grid(*errors, grid_columns=min(len(errors), 4)), row_shares=[1, 1], name="Controllers"
    )


def _tracking(shown: ScreenContents) -> rrb.Container:
    joints = [
        views.curves(f"/position/{name}", f"{name}: actual and desired position [{unit}]")
        for name, unit in zip(shown.joints, shown.position_units, strict=True)
    ]
    return rrb.Grid(*joints, grid_columns=3 if len(joints) > 2 else 1, name="Tracking")


def _torques(shown: ScreenContents) -> rrb.Container:
    joints = [
        views.curves(f"/torque/{name}", f"{name}: torque and limits [{unit}]")
        for name, unit in zip(shown.joints, shown.torque_units, strict=True)
    ]
    return rrb.Grid(*joints, grid_columns=3 if len(joints) > 2 else 1, name="Torque")


def _parameters(shown: ScreenContents) -> rrb.Container:
    links = [
        views.curves(f"/estimate/{name}", f"{name}: estimates, {shown.truth} [kg, kg m, kg m²]") for name in shown.links
    ]
    return rrb.Grid(*links, grid_columns=3 if len(links) > 2 else 1, name="Parameters")


def _offline() -> rrb.Container:
    return rrb.Horizontal(
        _spectrum(), views.text("basis/equations", "Independent parameters"), column_shares=[1, 1], name="Offline stage"
    )


def _arm(shown: ScreenContents) -> rrb.View:
    return views.arm(WORLD, "The arm · desired: green ghost · adaptation off: orange ghost", shown.viewpoint)


def _error(shown: ScreenContents, index: int) -> rrb.View:
    return views.curves(
        f"/error/{shown.runs[index]}",
        f"Tracking error [{shown.error_unit}] · {shown.labels[index]}",
        shown.error_range,
    )


def _lyapunov() -> rrb.View:
    return views.curves("/lyapunov", "Lyapunov function [J] · must never rise")


def _energy() -> rrb.View:
    return views.curves("/energy", "Energy [J]")


def _torque_share() -> rrb.View:
    return views.curves("/torque_share", "Torque / limit", (-1.1, 1.1))


def _spectrum() -> rrb.View:
    return views.bars("/basis/spectrum", "Energy spectrum · powers of ten above the threshold")
