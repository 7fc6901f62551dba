"""Views of which recordings are laid out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from adaptctl.recording.colors import Color
from adaptctl.recording.skeleton import Viewpoint

TIMELINE = "sim_time"
BACKGROUND = Color(22, 26, 36)
# Shares of a run's length, left empty for a legend of short or of long names.
SHORT_LEGEND, LONG_LEGEND = 0.3, 0.7
# Time in s that the tip's path stays visible.
TRAIL_TIME = 4.0


def tabs(*containers: rrb.Container) -> rrb.Blueprint:
    """Layout of containers as tabs over the whole window, the first open."""
    return _alone(rrb.Tabs(*containers, active_tab=0), play_state="playing", loop_mode="all")


def live(view: rrb.View, curves: Sequence[rrb.View]) -> rrb.Blueprint:
    """Layout of a live view: an arm on the left, curves on the right, time follows the newest sample."""
    return _alone(rrb.Horizontal(view, rrb.Vertical(*curves)), play_state="following")


def _alone(content: rrb.Container, **time: Any) -> rrb.Blueprint:
    return rrb.Blueprint(
        content,
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", **time),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_layout=False,
        auto_views=False,
    )


def arm(origin: str, name: str, viewpoint: Viewpoint) -> rrb.View:
    """View of a moving arm on a grid at the floor's height, with its trail of the last 4 s."""
    window = rr.VisibleTimeRange(
        TIMELINE,
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_TIME),
        end=rr.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        origin=f"/{origin}",
        name=name,
        background=BACKGROUND,
        eye_controls=rrb.EyeControls3D(position=viewpoint.eye, look_target=viewpoint.target, eye_up=(0.0, 0.0, 1.0)),
        line_grid=rrb.LineGrid3D(
            visible=True,
            spacing=0.25,
            plane=rr.components.Plane3D((0.0, 0.0, 1.0), viewpoint.floor),
            color=(255, 255, 255, 22),
        ),
        time_ranges=window,
    )


def curves(
    origin: str,
    name: str,
    end: float | None,
    bounds: tuple[float, float] | None = None,
    room: float = SHORT_LEGEND,
    start: float = 0.0,
    *,
    legend: bool = True,
) -> rrb.View:
    """View of the curves below a path from `start` to `end` (s), with room for a legend on the right."""
    at = rr.TimeRangeBoundary.absolute
    last = start if end is None else end + legend * room * (end - start)
    shown = rr.TimeRange(start=at(seconds=start), end=at(seconds=last))
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=None if end is None else rrb.TimeAxis(view_range=shown),
        axis_y=rrb.ScalarAxis(range=bounds) if bounds else None,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend),
    )


def text(origin: str, name: str) -> rrb.View:
    """View of the text logged at a path."""
    return rrb.TextDocumentView(origin=f"/{origin}", name=name)


def picture(origin: str, name: str) -> rrb.View:
    """View of the picture logged at a path."""
    return rrb.Spatial2DView(origin=f"/{origin}", name=name)
