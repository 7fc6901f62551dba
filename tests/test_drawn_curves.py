"""Curves of the figures of comparisons are the numbers that their axes name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rerun as rr
from comparisons import PERIOD, comparison
from random_trees import random_chain
from recordings import rows

from adaptctl.arrays import Array
from adaptctl.dynamics import load
from adaptctl.experiments.over_time import over_time
from adaptctl.recording import Comparison
from adaptctl.recording.colors import GOAL
from adaptctl.recording.contact_force import contact_forces, contact_points
from adaptctl.recording.drawing import thinned
from adaptctl.recording.figures import _estimate, drawings, spectrum
from adaptctl.recording.motion_recording import record_motion
from adaptctl.recording.rerun_recording import MAX_OVERVIEW_PARAMETERS, _estimates, log_scene
from adaptctl.recording.skeleton import skeleton
from adaptctl.recording.stream import Curves, log_curves
from adaptctl.recording.touches import touches
from adaptctl.recording.vector import Panel
from adaptctl.simulation.mujoco_plant import TOUCH_FLAGS


@pytest.fixture(scope="module")
def shown() -> Comparison:
    return comparison(load("two_link"))


def curves(shown: Comparison, name: str, panel: int) -> list[tuple[Array, Array]]:
    """Places and heights of the lines of a panel of a figure."""
    lines = drawings(shown)[name].draw().axes[panel].lines
    return [(np.asarray(line.get_xdata()), np.asarray(line.get_ydata())) for line in lines]


def test_tracking_errors_are_of_a_quarter_of_a_second_in_thousandths(shown: Comparison) -> None:
    drawn = curves(shown, "tracking-error", 0)
    for run, (time, height) in zip(reversed(shown.runs), drawn, strict=True):
        assert time[-1] == run.rollout.time[-1]
        last = run.rollout.error[-round(0.25 / PERIOD) :]
        assert height[-1] == pytest.approx(1e3 * np.sqrt(np.mean(last**2)), rel=1e-4)


def test_figures_over_time_say_so(shown: Comparison) -> None:
    for name in ("tracking-error", "joint-errors", "torque", "lyapunov"):
        figure = drawings(shown)[name].draw()
        assert "time [s]" in {figure.get_supxlabel(), *(axes.get_xlabel() for axes in figure.axes)}, name


@pytest.mark.parametrize(("samples", "drawn"), [(600, 600), (601, 301), (1201, 401)])
def test_values_over_time_are_six_hundred_at_most(samples: int, drawn: int, shown: Comparison) -> None:
    (run,) = shown.runs[:1]
    (line,) = over_time([run], {run.name: np.ones(samples)}, "y").axes[0].lines
    assert len(np.asarray(line.get_xdata())) == drawn


def test_errors_of_joints_are_drawn_whole_and_in_their_last_two_seconds(shown: Comparison) -> None:
    run = shown.subject.rollout
    whole, end = drawings(shown)["joint-errors"].draw().axes[:2]
    assert (whole.get_xlim(), end.get_xlim()) == ((0.0, run.duration), (run.duration - 2.0, run.duration))
    for panel, first in ((0, 0), (1, round((run.duration - 2.0) / PERIOD))):
        for j, (time, height) in enumerate(curves(shown, "joint-errors", panel)):
            np.testing.assert_allclose(time, run.time[first:])
            np.testing.assert_allclose(height, 1e3 * run.error[first:, j])


def test_falls_of_the_lyapunov_function_are_drawn_where_they_end(shown: Comparison) -> None:
    values = np.array(shown.subject.lyapunov)
    values[700] = values[699] + 0.5
    risen = replace(shown, runs=(replace(shown.subject, lyapunov=values), shown.runs[1]))
    time = shown.subject.rollout.time
    (falls, rises), (whole, *_) = curves(risen, "lyapunov", 1), curves(risen, "lyapunov", 0)
    np.testing.assert_allclose(whole[1], values)
    assert drawings(risen)["lyapunov"].draw().axes[0].collections[0].get_linewidth() == 0.0
    steps = np.diff(values)
    np.testing.assert_allclose(falls[0], time[1:])
    np.testing.assert_allclose(falls[1], np.where(steps < 0.0, -steps, np.nan))
    np.testing.assert_allclose(rises[0], [time[700]])
    np.testing.assert_allclose(rises[1], [0.5])
    whole_run = (0.0, shown.subject.duration)
    assert [axes.get_xlim() for axes in drawings(risen)["lyapunov"].draw().axes] == [whole_run] * 2


def test_torques_and_estimates_are_those_of_the_run(shown: Comparison) -> None:
    run = shown.subject.rollout
    for j, limit in enumerate(shown.torque_limits):
        axes = drawings(shown)["torque"].draw().axes[j]
        np.testing.assert_allclose(axes.lines[0].get_ydata(), run.applied[:, j])
        np.testing.assert_allclose(axes.get_ylim(), [-1.25 * limit, 1.25 * limit])
        beyond = [np.add(part.get_y(), [0.0, part.get_height()]) for part in axes.patches]
        np.testing.assert_allclose(beyond, [[limit, 1.25 * limit], [-1.25 * limit, -limit]])
        assert {part.get_linewidth() for part in axes.patches} == {0.0}
        peak = 100.0 * np.abs(run.applied[:, j]).max() / limit
        assert axes.texts[0].get_text() == f"peak {peak:.0f} %"
    largest = int(np.argmax(np.abs(shown.true_parameters)))
    time, height = curves(shown, "parameters", 0)[-1]
    np.testing.assert_allclose(height, np.interp(time, run.time, run.estimate[:, largest]), rtol=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_estimate_s_panel_reaches_from_zero_to_the_farthest_value_with_margins(sign: float) -> None:
    axes: Any = Panel()
    for values, truth, farthest in (([5.0, 6.0], np.nan, 6.0), ([5.0, 6.0], 7.0, 7.0), ([5.0, 6.0], 2.0, 6.0)):
        ends = _estimate(axes, np.arange(2.0), sign * np.array(values), sign * truth)
        np.testing.assert_allclose(sorted(sign * np.array(ends)), [-0.12 * farthest, 1.12 * farthest])
    assert _estimate(axes, np.arange(2.0), np.zeros(2), 0.0) == (-1.0, 1.0)


def test_parameters_whose_values_are_unknown_stand_in_the_order_of_their_last_estimates(shown: Comparison) -> None:
    rollout, order = shown.subject.rollout, np.random.default_rng(0).permutation(len(shown.model.names))
    estimate = np.zeros_like(rollout.estimate)
    estimate[-1] = np.where(order % 2, -1.0, 1.0) * order
    unknown = replace(
        shown, truth_known=False, runs=(replace(shown.subject, rollout=replace(rollout, estimate=estimate)),)
    )
    panels = drawings(unknown)["parameters"].draw().axes[: len(order)]
    assert [axes.get_title() for axes in panels] == [shown.model.names[i] for i in np.argsort(-order)]


def test_curves_of_figures_are_three_thousand_samples_at_most_and_estimates_five_hundred() -> None:
    for samples, drawn, estimates in ((3000, 3000, 500), (3001, 1501, 429)):
        long = comparison(load("two_link"), samples)
        for name in ("tracking-error", "joint-errors", "lyapunov"):
            assert {len(x) for x, _ in curves(long, name, 0)} == {drawn}
        assert len(curves(long, "parameters", 0)[-1][0]) == estimates


def test_arms_are_recorded_at_two_thousand_times_at_most_and_curves_at_four_thousand(tmp_path: Path) -> None:
    for name, samples, arms, curve in (("all", 2000, 2000, 4000), ("half", 2001, 1001, 2001)):
        long, recording = comparison(load("two_link"), samples), rr.RecordingStream(name, make_default=False)
        recording.save(tmp_path / name)
        log_scene(recording, long, skeleton(long.mechanism), 0.0, GOAL)
        time = np.arange(2000.0 + samples)
        log_curves(recording, [Curves("curve", time, time, ["time"], [GOAL])])
        recording.disconnect()
        for run in ("adaptive", "adaptation-off", "desired"):
            assert len(rows(tmp_path / name, f"/world/{run}/lower", "Transform3D:translation")) == arms
        assert len(rows(tmp_path / name, "/curve", "Scalars:scalars")) == curve


def test_the_overview_has_the_estimates_that_move_most() -> None:
    arm = comparison(random_chain(1, 3), samples=100)
    overview = next(one for one in _estimates(arm) if one.path == "estimate/most_learnt/estimate")
    moved = np.sort(np.ptp(arm.subject.rollout.estimate, axis=0))[-MAX_OVERVIEW_PARAMETERS:]
    np.testing.assert_array_equal(np.sort(np.ptp(overview.values, axis=0)), moved)


def test_a_spectrum_tells_how_far_its_rank_is_above_the_rest() -> None:
    space: Any = SimpleNamespace(singular_values=[4.0, 1.0, 2e-3], rank=2)
    told: Any = SimpleNamespace(space=space)
    whole: Any = SimpleNamespace(space=SimpleNamespace(singular_values=[4.0, 1.0], rank=2))
    assert len(spectrum(whole).axes[0].texts) == 0
    (axes,) = spectrum(told).axes
    assert axes.texts[0].get_text() == "2 of 3 are above the gap, a ratio of 500"
    assert axes.lines[0].get_ydata()[0] == pytest.approx(0.25 / np.sqrt(500.0))


@pytest.mark.parametrize(("period", "every"), [(1e-3, 20), (0.5, 1)])
def test_a_motion_is_recorded_whole_and_fifty_times_a_second_at_most(period: float, every: int, tmp_path: Path) -> None:
    """Of so many samples no process that draws could keep pace with."""
    time, p = period * np.arange(4000.0), np.random.default_rng(0).normal(size=(4000, 2))
    record_motion(tmp_path / "a.rrd", load("two_link"), time, p, 0.5 * p, 9.0 * p)
    np.testing.assert_allclose(rows(tmp_path / "a.rrd", "/torque", "Scalars:scalars"), 9.0 * p[::every])
    assert rows(tmp_path / "a.rrd", "/__properties", "RecordingInfo:name") == [["two_link, motion"]]


def test_forces_of_contacts_are_means_and_points_those_of_the_last_contact(shown: Comparison) -> None:
    """Means of 50 ms, of the contact's three parts; a point stays where the contact opened."""
    rng, count = np.random.default_rng(0), len(shown.subject.rollout.time)
    force, point = rng.normal(size=(count, 3)), rng.normal(size=(count, 3))
    closed = np.arange(-1, count - 1) // 100 % 2 == 0  # from the second sample on
    told = np.concatenate([force, point], axis=1) * closed[:, None]
    run = replace(shown.subject.rollout, flags=dict(zip(TOUCH_FLAGS, told.T, strict=True)))
    width = round(0.05 / PERIOD)
    np.testing.assert_allclose(contact_forces(run)[50], force[51 - width : 51].mean(axis=0))
    points = contact_points(run)
    np.testing.assert_array_equal(points[0], np.zeros(3))
    np.testing.assert_array_equal(points[50], point[50])
    np.testing.assert_array_equal(points[[101, 150, 200]], point[[100] * 3])


def test_forces_of_contacts_are_drawn_by_their_sizes_where_there_are_any(shown: Comparison) -> None:
    rollout = shown.subject.rollout
    closed = np.arange(len(rollout.time)) >= 300
    told = closed[:, None] * [3.0, 0.0, -4.0, 0.0, 0.0, 0.0]
    run = replace(shown.subject, rollout=replace(rollout, flags=dict(zip(TOUCH_FLAGS, told.T, strict=True))))
    touching = replace(shown, runs=(run, shown.runs[1]))
    ((time, size),) = curves(touching, "contact-force", 0)
    np.testing.assert_array_equal(time, rollout.time)
    assert np.isnan(size[:300]).all()
    np.testing.assert_allclose(size[[300, 300 + round(0.05 / PERIOD)]], [5.0 * PERIOD / 0.05, 5.0])


def test_touches_are_told_apart_by_a_second_without_one(shown: Comparison) -> None:
    """Where a torque is above its level, twice within 0.02 s and once 2 s later: by the joint farthest above."""
    rollout = shown.subject.rollout
    told = np.zeros((len(rollout.time), 5))  # one number besides, torques and levels of two joints
    told[:, 3:] = [1.0, 3.0]
    told[100:151, 1], told[160, 2], told[1160:1170, 1:3] = 1.5, -3.2, [1.2, -4.0]
    felt = replace(shown.subject, rollout=replace(rollout, logged_state=told), law="SlotineLi + GuardedLearning")
    names = shown.joint_names
    assert touches(felt, names) == [
        (rollout.time[100], rollout.time[160], names[0], 1.5),
        (rollout.time[1160], rollout.time[1169], names[1], -4.0),
    ]
    assert touches(replace(felt, law="SlotineLi + Gradient"), names) == []


@pytest.mark.parametrize(("samples", "every"), [(1, 1), (30, 1), (31, 2), (60, 2), (61, 3), (90, 3)])
def test_a_curve_is_thinned_by_the_least_that_fits(samples: int, every: int) -> None:
    shown = np.arange(samples)[thinned(samples, 30)]
    assert shown.tolist() == list(range(0, samples, every))
    assert len(shown) <= 30
