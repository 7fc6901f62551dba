"""Views of which recordings are laid out: an arm, curves, bars, text, a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from adaptctl.recording.drawing import Color
from adaptctl.recording.skeleton import Viewpoint

TIMELINE = "sim_time"
NIGHT = Color(22, 26, 36)
SHORT, LONG = 0.3, 0.7
"""Of a run's length, left empty at the right of curves: the legend, of short or of long names, stands there."""
TRAIL = 4.0
"""s of the tip's path that stay visible."""


def tabs(*containers: rrb.Container) -> rrb.Blueprint:
    """Blueprint, the layout of a rerun recording, of containers as tabs over the whole window: the first is open, time
    runs in a loop, and the panels of entities and selections are hidden. Nothing is checked."""
    return _alone(rrb.Tabs(*containers, active_tab=0), play_state="playing", loop_mode="all")


def live(view: rrb.View, curves: Sequence[rrb.View]) -> rrb.Blueprint:
    """Blueprint, the layout of a rerun recording, for a live view: the view of an arm on the left, views of curves one
    below the other on the right, and time that follows the newest sample. Nothing is checked."""
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
    """View, for a rerun blueprint, of a moving arm in space on a grid at the floor's height, seen from `viewpoint`. It
    shows the last 4 s of what was logged, such as the trail of the arm's tip. `origin` is the entity path, without the
    first slash, of all that it shows; `name` is its title. Nothing is checked."""
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
    """View, for a rerun blueprint, of the curves below the entity path `origin`, with the title `name`, from `start` (0
    by default) until `end`, s; with an `end` of None all times, as for a run that goes on. The vertical axis has the
    range `bounds`, least and greatest value in the curves' unit, or adapts itself where that is None, the default. With
    a `legend`, as by default, space is left empty for it on the right: `room`, a fraction, times the time range, 0.3 by
    default. Nothing is checked."""
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
    """View, for a rerun blueprint, of the text logged at the entity path `origin`, given without the first slash;
    `name` is its title. Nothing is checked."""
    return rrb.TextDocumentView(origin=f"/{origin}", name=name)


def picture(origin: str, name: str) -> rrb.View:
    """View, for a rerun blueprint, of the picture logged at the entity path `origin`, given without the first slash;
    `name` is its title. Nothing is checked."""
    return rrb.Spatial2DView(origin=f"/{origin}", name=name)
