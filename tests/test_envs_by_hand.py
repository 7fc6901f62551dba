"""Environments' wrappers and scenes at numbers that are written by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest

import adaptctl
from adaptctl.arrays import Array
from adaptctl.envs.contact import beside, of_three_joints, surface_box, tool_path
from adaptctl.envs.controlled import _share
from adaptctl.envs.gain_tuning import GainRange
from adaptctl.envs.learning import NormalisedView
from adaptctl.envs.live import LiveView
from adaptctl.envs.rendering import _floor_height, _grid, _pedestals, _span
from adaptctl.errors import GainError, InputError, NotFoundError


def jerk_free(u: Any) -> Array:
    """Minimum jerk from 0 to 1 (Flash and Hogan 1985)."""
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)


@pytest.mark.parametrize(
    ("scene", "into", "touched"),
    [("table", [0.0, 0.0, -1.0], [0.5, 0.15, 0.35]), ("wall", [1.0, 0.0, 0.0], [0.65, 0.15, 0.35])],
)
def test_the_tool_swings_in_the_air_and_then_wipes_behind_the_surface(
    scene: str, into: list[float], touched: list[float]
) -> None:
    center, ahead, at = np.array([0.5, 0.15, 0.55]), np.array(into), np.array(touched)

    def place(t: float) -> Array:
        return tool_path(np.array([t]), scene)[0]

    def swing(t: float) -> Array:
        return np.array([0.1, 0.25, 0.1]) * np.sin(2.0 * np.pi * np.array([0.4, 0.3, 0.5]) * t)

    np.testing.assert_allclose(place(0.0), center)
    np.testing.assert_allclose(place(0.7), center + jerk_free(0.35) * swing(0.7))
    np.testing.assert_allclose(place(3.3), center + swing(3.3))
    np.testing.assert_allclose(place(6.0), center + (1.0 - jerk_free(0.5 / 1.5)) * swing(6.0))
    np.testing.assert_allclose(place(7.0), center, atol=1e-12)
    before = at - 0.015 * ahead
    np.testing.assert_allclose(place(7.6), center + jerk_free(0.3) * (before - center))
    np.testing.assert_allclose(place(9.0), before)
    np.testing.assert_allclose(place(10.2), before + jerk_free(0.4) * 0.065 * ahead)
    behind = at + 0.05 * ahead
    np.testing.assert_allclose(place(12.0), behind)
    for t, risen in ((12.8, jerk_free(0.4)), (15.0, 1.0)):
        along = risen * 0.2 * np.sin(2.0 * np.pi * 0.2 * (t - 12.0))
        np.testing.assert_allclose(place(t), np.add(behind, [0.0, along, 0.0]))


def test_a_motion_in_the_air_does_not_end() -> None:
    times = np.array([0.0, 0.8, 30.0])
    swing = np.array([0.1, 0.25, 0.1]) * np.sin(2.0 * np.pi * np.array([0.4, 0.3, 0.5]) * times[:, None])
    risen = jerk_free(times / 2.0)[:, None]
    np.testing.assert_allclose(tool_path(times, "air"), [0.45, 0.05, 0.45] + risen * swing)


def test_a_surface_is_as_thick_and_wide_as_it_is_told() -> None:
    place, half = surface_box("table")
    np.testing.assert_allclose([place, half], [[0.5, 0.15, 0.35 - 0.04], [0.3, 0.4, 0.02]])
    place, half = surface_box("wall")
    np.testing.assert_allclose([place, half], [[0.65 + 0.04, 0.15, 0.35], [0.02, 0.4, 0.3]])


def test_the_model_has_a_ball_as_its_tool_and_its_surfaces_material() -> None:
    arm = of_three_joints(adaptctl.load("puma560_geared"))
    model = beside(arm, "table", 1e4)
    ball, box = (int(model.body(name).geomadr[0] + model.body(name).geomnum[0] - 1) for name in ("link3", "table"))
    assert model.opt.timestep == 2.5e-4
    assert model.geom_size[ball][0] == 0.02
    for geom in (ball, box):
        np.testing.assert_allclose(model.geom_friction[geom], [0.2, 0.005, 0.0001])
        np.testing.assert_allclose(model.geom_solref[geom], [0.01, 1.0])
    assert model.body("table").mass[0] == pytest.approx(0.3)
    assert model.body_gravcomp[model.body("table").id] == 1.0
    with pytest.raises(KeyError):
        beside(arm, "air", 1e4).body("table")


def test_a_live_view_shows_each_step_with_its_time_and_the_torque_that_acted() -> None:
    shown: list[Any] = []
    box = gymnasium.spaces.Box(-9.0, 9.0, (4,))
    told: dict[str, Any] = {}

    class Plain(gymnasium.Env[Any, Any]):
        control_period, observation_space, action_space = 0.25, box, box
        observation_slices = {"p": slice(0, 1), "reference_p": slice(2, 3)}  # noqa: RUF012

        def reset(self, **given: Any) -> Any:
            return np.zeros(4), {}

        def step(self, action: Any) -> Any:
            return np.array([1.0, 2.0, 3.0, 4.0]), 5.0, True, False, told

    live: Any = SimpleNamespace(show=lambda *of: shown.append([np.asarray(one).tolist() for one in of]))
    env = LiveView(Plain(), live)
    env.reset(seed=0)
    assert env.step(np.array([7.0]))[1:4] == (5.0, True, False)
    env.step(np.array([7.0]))
    told |= {"time": 9.0, "applied_torque": [8.0]}
    env.step(np.array([7.0]))
    assert shown == [[0.25, [1.0], [3.0], [7.0]], [0.5, [1.0], [3.0], [7.0]], [9.0, [1.0], [3.0], [8.0]]]
    del told["time"]
    env.reset()
    env.step(np.array([7.0]))
    assert shown[-1][0] == 0.25
    for wrong in ({"control_period": None}, {"observation_slices": {"p": slice(1)}}, {"observation_slices": None}):
        with pytest.raises(InputError, match="cannot be shown live"):
            LiveView(type("Other", (Plain,), wrong)(), live)


def test_actions_scale_gains_up_to_what_is_carried_and_down_as_far_as_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a controller whose damping may be twice as large at most."""
    law = adaptctl.SlotineLi(adaptctl.ReducedModel(adaptctl.load("two_link")), 5.0, [6.0, 2.0])

    def tuned(self: Any, gains: Any) -> Any:
        if np.max(np.asarray(gains.get("damping", 0.0)) / law.damping) > 2.0:
            raise GainError("too high")

    monkeypatch.setattr(adaptctl.SlotineLi, "tuned", tuned)
    found = GainRange.of(law, ["damping"], 4.0)
    assert found.lowest == 0.25
    assert 2.0 * 4.0 ** (-1.0 / 2**12) * (1.0 - 1e-9) <= found.highest <= 2.0  # twelve halvings of log 4
    for action, factor in (
        (-9.0, 0.25),
        (-1.0, 0.25),
        (-0.5, 0.5),
        (0.0, 1.0),
        (1.0, found.highest),
        (9.0, found.highest),
    ):
        np.testing.assert_allclose(found.gains(np.full(2, action))["damping"], factor * np.array([6.0, 2.0]))
    wide = GainRange.of(law, "damping", 1.5)
    assert wide.highest == pytest.approx(1.5)
    for wrong in (1.0, 0.5):
        with pytest.raises(InputError, match="expected a number above 1"):
            GainRange.of(law, "damping", wrong)
    with pytest.raises(NotFoundError, match="expected at least one of"):
        GainRange.of(law, [], 2.0)


def test_a_residual_is_a_share_of_the_limits_up_to_all() -> None:
    assert _share(1.0) == 1.0
    for wrong in (0.0, 1.0001):
        with pytest.raises(InputError, match="expected a number above 0, at most 1"):
            _share(wrong)


def test_the_floor_is_at_zero_below_a_base_that_is_raised_and_else_lower() -> None:
    assert _floor_height(np.array([[0.0, 0.0, 0.051], [1.0, 0.0, 0.4]]), 1.0) == 0.0
    assert _floor_height(np.array([[0.0, 0.0, 0.05], [1.0, 0.0, 0.4]]), 1.0) == pytest.approx(0.05 - 0.7)
    posts = _pedestals(np.array([[0.1, 0.2, 0.5]]), -0.3, 0.04)
    np.testing.assert_allclose([posts[0].start, posts[0].end], [[0.1, 0.2, -0.3], [0.1, 0.2, 0.5]])
    np.testing.assert_allclose([posts[1].start, posts[1].end], [[0.1, 0.2, -0.3], [0.1, 0.2, -0.29]])
    assert [post.radius for post in posts] == pytest.approx([0.04, 0.088])
    assert all(post.flat for post in posts)


def test_lines_of_the_floor_pass_through_the_origin_and_are_thin() -> None:
    across = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 0.5], [0.49, 0.5], [0.5, 0.5], [0.5, -0.0119], [0.0121, 0.5]])
    assert _grid(2.0 * across, 2.0).tolist() == [1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]


def test_observations_and_actions_of_learners_are_from_minus_one_to_one() -> None:
    seen = NormalisedView({}, np.zeros(2), np.ones(7)).space
    law = adaptctl.SlotineLi(adaptctl.ReducedModel(adaptctl.load("two_link")), 5.0, [6.0, 2.0])
    moved = GainRange(law, ("damping",), 0.5, 2.0).space
    for space, shape in ((seen, (7,)), (moved, (2,))):
        assert (space.shape, space.dtype) == (shape, np.float32)
        assert (set(space.low), set(space.high)) == ({-1.0}, {1.0})


@pytest.mark.parametrize(
    ("center", "rows"), [(1.0, (0, 4)), (5.2, (2, 9)), (9.5, (6, 10)), (-20.0, (0, 0)), (30.0, (10, 10))]
)
def test_a_window_ends_at_the_edges_of_the_image(center: float, rows: tuple[int, int]) -> None:
    assert _span(np.array([center]), np.array([3.0]), 10) == slice(*rows)
