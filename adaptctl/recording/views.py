"""Views of which recordings are laid out: an arm, curves, bars, text, a picture."""

from __future__ import annotations

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from adaptctl.recording.palette import Color
from adaptctl.recording.scene import TIMELINE
from adaptctl.recording.viewpoint import Viewpoint

NIGHT = Color(22, 26, 36)
SHORT, LONG = 0.3, 0.7
"""Of a run's length, left empty at the right of curves: the legend, of short or of long names, stands there."""
TRAIL = 4.0
"""s of the tip's path that stay visible."""


def tabs(*containers: rrb.Container) -> rrb.Blueprint:
    """Blueprint of tabs over the whole window, the first one open, time running."""
    return rrb.Blueprint(
        rrb.Tabs(*containers, active_tab=0),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing", loop_mode="all"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_layout=False,
        auto_views=False,
    )


def live(view: rrb.View, curves: Sequence[rrb.View]) -> rrb.Blueprint:
    """Blueprint of an arm beside curves, at the latest time."""
    return rrb.Blueprint(
        rrb.Horizontal(view, rrb.Vertical(*curves)),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_layout=False,
        auto_views=False,
    )


def arm(origin: str, name: str, viewpoint: Viewpoint) -> rrb.View:
    """View of an arm in motion, with its trail, on a grid."""
    window = rr.VisibleTimeRange(
        TIMELINE,
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-TRAIL),
        end=rr.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        origin=f"/{origin}",
        name=name,
        background=NIGHT,
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
    room: float = SHORT,
    start: float = 0.0,
    *,
    legend: bool = True,
) -> rrb.View:
    """View of curves from `start` until `end` (s), on a fixed range if one is given; the legend, if any, comes after
    them.

    Without an end, of what goes on, all that there is is shown.
    """
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=None if end is None else rrb.TimeAxis(view_range=_range(start, end + legend * room * (end - start))),
        axis_y=rrb.ScalarAxis(range=bounds) if bounds else None,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend),
    )


def _range(start: float, end: float) -> rr.TimeRange:
    at = rr.TimeRangeBoundary.absolute
    return rr.TimeRange(start=at(seconds=start), end=at(seconds=end))


def bars(origin: str, name: str) -> rrb.View:
    """View of bars, the same at all times; its name tells what their colours are, since a legend has only paths."""
    return rrb.BarChartView(origin=origin, name=name, plot_legend=rrb.PlotLegend(visible=False))


def text(origin: str, name: str) -> rrb.View:
    """View of a text logged at an entity, with a name, the same at all times."""
    return rrb.TextDocumentView(origin=f"/{origin}", name=name)


def picture(origin: str, name: str) -> rrb.View:
    """View of a picture logged at an entity, with a name, the same at all times."""
    return rrb.Spatial2DView(origin=f"/{origin}", name=name)
