"""How recordings of comparisons are laid out, told by the views themselves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from comparisons import comparison

from adaptctl.dynamics import load
from adaptctl.recording import Comparison
from adaptctl.recording.rerun_recording import _error_views, blueprint, legend_room
from adaptctl.recording.skeleton import skeleton
from adaptctl.recording.views import LONG_LEGEND, SHORT_LEGEND


def of_runs(count: int) -> Comparison:
    two = comparison(load("two_link"), samples=50)
    more = (replace(two.runs[1], name=f"more{k}") for k in range(count - 2))
    return replace(two, runs=(*two.runs, *more))


def views_of(shown: Comparison) -> Any:
    """The tabs of a recording."""
    tabs: Any = blueprint(shown, skeleton(shown.mechanism)).root_container
    return tabs.contents


def told(view: Any, part: str, name: str) -> Any:
    """A property of a view."""
    return getattr(view.properties[part], name).as_arrow_array().to_pylist()[0]


def test_legends_of_names_above_twelve_letters_have_more_room() -> None:
    assert legend_room(("joint1", 12 * "x")) == SHORT_LEGEND < legend_room(("joint1", 13 * "x")) == LONG_LEGEND


@pytest.mark.parametrize("count", [8, 9])
def test_small_views_of_more_than_eight_runs_end_with_the_run_and_have_no_legend(count: int) -> None:
    shown = of_runs(count)
    for view in _error_views(shown):
        assert told(view, "PlotLegend", "visible") is (count == 8)
        end = 1e-9 * told(view, "TimeAxis", "view_range")["end"]
        assert end == pytest.approx(shown.subject.duration * (1.0 + SHORT_LEGEND * (count == 8)))


def test_views_of_errors_have_the_range_of_the_subject_and_of_adaptation_off_with_a_margin() -> None:
    shown = of_runs(3)
    larger = replace(shown.runs[2], rollout=replace(shown.runs[2].rollout, p=9.0 + shown.runs[2].rollout.p))
    errors = 1e3 * np.concatenate([run.rollout.error for run in shown.runs[:2]])
    for view in _error_views(replace(shown, runs=(*shown.runs[:2], larger))):
        low, high = told(view, "ScalarAxis", "range")
        above = np.array([errors.min() - low, high - errors.max()]) / np.ptp(errors)
        np.testing.assert_allclose(above, 0.06, rtol=1e-5)


@pytest.mark.parametrize(("count", "shares", "columns"), [(3, [1, 1], 3), (12, [1, 1], 4), (13, [3, 2], 4)])
def test_a_legend_of_more_than_twelve_runs_has_more_than_half_of_the_height(
    count: int, shares: list[int], columns: int
) -> None:
    shown = of_runs(count)
    together = views_of(shown)[1]
    assert together.row_shares == shares
    assert (len(together.contents[1].contents), together.contents[1].grid_columns) == (count, columns)
