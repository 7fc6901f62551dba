"""Pictures: rays against geometry, and the arm where kinematics says it is."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.image import imread
from random_trees import random_tree

from adaptctl.arrays import Array
from adaptctl.description.pose import Pose
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.envs import Puma560TrackingEnv
from adaptctl.envs.contact import surroundings_of
from adaptctl.envs.rendering import (
    BESIDE_OPACITY,
    GHOST_SCALE,
    HORIZON,
    OVERSAMPLING,
    ZENITH,
    Camera,
    ConvexPart,
    Renderer,
    _pixels,
    _spacing,
    box_hits,
    intersect,
)
from adaptctl.recording.colors import GOAL
from adaptctl.recording.skeleton import Solid, skeleton, tip_path

CENTER = np.array([0.0, -0.6, 0.8, 0.0, 0.5, 0.0])
RAISED = np.array([0.0, -1.6, 1.6, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


@pytest.fixture(scope="module")
def renderer(puma: Mechanism) -> Renderer:
    return Renderer(puma)


@pytest.fixture
def fine(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many rays a pixel as users' images have."""
    monkeypatch.setattr("adaptctl.envs.rendering.OVERSAMPLING", OVERSAMPLING)


def depth_in(solid: ConvexPart, points: Array) -> Array:
    """How far points (..., 3) are inside a solid, negative outside (the signed distance up to a factor)."""
    axis = solid.end - solid.start
    length = np.linalg.norm(axis)
    along = (points - solid.start) @ axis / length
    if not solid.flat:
        nearest = solid.start + np.clip(along, 0.0, length)[..., None] * axis / length
        return solid.radius - np.linalg.norm(points - nearest, axis=-1)
    off_axis = np.linalg.norm(points - solid.start - along[..., None] * axis / length, axis=-1)
    return np.minimum(solid.radius - off_axis, np.minimum(along, length - along))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_rays_meet_boxes_first_at_their_surface(seed: int) -> None:
    """As points along the rays, inside the box or not, tell."""
    rng = np.random.default_rng(seed)
    turned, size = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.uniform(0.2, 1.0, 3)
    pose, eye = Pose(turned * np.linalg.det(turned), rng.uniform(-0.5, 0.5, 3)), np.array([4.0, 0.5, -0.3])
    aimed = rng.uniform(-1.0, 1.0, (50, 3)) - eye
    rays = aimed / np.linalg.norm(aimed, axis=1, keepdims=True)
    hits, away = box_hits(pose, size, eye, rays), np.linspace(0.0, 8.0, 4001)
    own = (eye + away[:, None, None] * rays - pose.translation) @ pose.rotation
    inside = np.all(np.abs(own) <= 0.5 * size, axis=-1)
    assert np.all(np.isfinite(hits.distance) | (inside.sum(axis=0) <= 2))  # a ray along an edge may pass between points
    met = inside.any(axis=0)
    np.testing.assert_allclose(hits.distance[met], away[inside.argmax(axis=0)][met], atol=2.1e-3)
    assert np.all(np.vecdot(hits.normal[met], rays[met]) < 0.0)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_rays_meet_solids_first_at_their_surface(seed: int, flat: bool) -> None:
    rng = np.random.default_rng(seed)
    start, end = rng.uniform(-1, 1, (2, 3))
    solid = ConvexPart(start, end, float(rng.uniform(0.1, 0.5)), np.ones(3), flat)
    eye = np.array([4.0, 0.0, 0.0]) + rng.uniform(-1, 1, 3)
    aimed = rng.uniform(-1.2, 1.2, (50, 3)) - eye
    rays = aimed / np.linalg.norm(aimed, axis=1, keepdims=True)
    hits = intersect(solid, eye, rays)
    met = np.isfinite(hits.distance)
    path = eye + np.linspace(0.0, 8.0, 4001)[:, None, None] * rays
    inside = depth_in(solid, path).max(axis=0)
    assert np.all(met[inside > 1e-9])
    assert not np.any(met[inside < -3e-3])
    points = eye + hits.distance[met, None] * rays[met]
    np.testing.assert_allclose(depth_in(solid, points), 0.0, atol=1e-9)
    short = eye + (np.linspace(0.0, 1.0 - 1e-6, 300)[:, None] * hits.distance[met])[..., None] * rays[met]
    assert np.all(depth_in(solid, short) < 1e-9)
    np.testing.assert_allclose(np.linalg.norm(hits.normal[met], axis=1), 1.0, atol=1e-9)
    assert np.all(np.vecdot(hits.normal[met], rays[met]) <= 1e-9)
    outside = depth_in(solid, points + 1e-6 * hits.normal[met])
    np.testing.assert_allclose(outside, -1e-6, atol=2e-8)


def test_a_ball_is_a_capsule_of_no_length() -> None:
    ball = ConvexPart(np.zeros(3), np.zeros(3), 0.5, np.ones(3))
    hits = intersect(ball, np.array([2.0, 0.0, 0.0]), np.array([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    np.testing.assert_allclose(hits.distance, [1.5, np.inf])
    np.testing.assert_allclose(hits.normal[0], [1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("start", "end", "flat", "distance"),
    [
        ([2.0, 0.0, -0.5], [2.0, 0.0, 0.5], True, 1.5),  # a side
        ([2.0, 0.0, -0.5], [2.0, 0.0, 0.5], False, 1.5),
        ([2.0, 0.0, 0.0], [3.0, 0.0, 0.0], True, 2.0),  # an end, along the axis
        ([3.0, 0.4, 0.0], [2.0, 0.4, 0.0], True, 2.0),
        ([3.0, 0.0, 0.0], [2.0, 0.0, 0.0], False, 1.5),
        ([2.0, 0.0, 0.0], [2.0, 0.0, 0.0], False, 1.5),
    ],
)
def test_what_is_behind_the_eye_is_not_hit(start: list[float], end: list[float], flat: bool, distance: float) -> None:
    solid = ConvexPart(np.array(start), np.array(end), 0.5, np.ones(3), flat)
    ahead, eyes = np.array([1.0, 0.0, 0.0]), np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    assert intersect(solid, eyes, np.stack([ahead] * 3)).distance == pytest.approx([distance, distance - 1.0, np.inf])
    assert intersect(solid, eyes, np.stack([-ahead] * 3)).distance[:2].tolist() == [np.inf, np.inf]


def test_a_window_is_not_much_larger_than_a_far_ball() -> None:
    camera = Camera(np.array([10.0, 0.0, 0.0]), np.zeros(3), 0.9, 400, 300)
    assert camera.focal == pytest.approx(150.0 / np.tan(0.45))
    for place, row, column in (([0.0, 0.0, 0.0], 150, 200), ([0.0, 1.0, 0.5], 134.5, 231)):
        rows, columns = camera.window(np.array([place]), 0.3)
        assert 0.5 * (rows.start + rows.stop) == pytest.approx(row, abs=1.0)
        assert 0.5 * (columns.start + columns.stop) == pytest.approx(column, abs=1.0)
        across = 2.0 * camera.focal * 0.3 / 10.0
        for span in (rows, columns):
            assert across < span.stop - span.start < 1.5 * across + 2
    wide = replace(camera, field=2.2, width=300)
    for depth in (1.6, 2.0, 5.0):  # in radii, where a ball ends at tan(asin(1 / depth)) from the middle
        near = wide.window(np.array([[10.0 - 0.3 * depth, 0.0, 0.0]]), 0.3)
        half = wide.focal / np.sqrt(depth**2 - 1.0)
        assert all(part.start <= 150.0 - half < 150.0 + half <= part.stop for part in near)
    assert camera.window(np.array([[9.8, 0.0, 0.0]]), 0.3) == (slice(0, 300), slice(0, 400))  # about the eye


@pytest.mark.parametrize("reach", [0.01, 0.3, 0.7, 1.0, 2.5, 7.9, 40.0])
def test_lines_on_the_floor_are_a_round_number_apart(reach: float) -> None:
    found = _spacing(reach)
    assert np.sqrt(0.4) <= found / (0.25 * reach) <= np.sqrt(2.5)
    assert float(f"{found:e}".partition("e")[0]) in (1.0, 2.0, 5.0)


@pytest.mark.usefixtures("fine")
def test_pixels_are_the_means_of_their_rays() -> None:
    rays = np.arange(24.0).reshape(2 * OVERSAMPLING, OVERSAMPLING, 3) / 30.0
    means = rays.reshape(2, OVERSAMPLING, OVERSAMPLING, 3).mean(axis=(1, 2))
    np.testing.assert_array_equal(_pixels(rays)[:, 0], np.rint(255.0 * means))
    assert _pixels(np.full((2, 2, 3), 1.7)).tolist() == [[[255, 255, 255]]]


@pytest.mark.usefixtures("fine")
def test_the_picture_is_the_one_that_was_looked_at(puma: Mechanism) -> None:
    """Made with `matplotlib.image.imsave`: an arm, its shadow and pedestal, a ghost, a floor with lines, and words."""
    kept = 255.0 * imread(Path(__file__).parent / "golden" / "puma560.png")[..., :3]
    now = Renderer(puma, 160, 120).image(CENTER, RAISED, 12.25)
    blocks = np.abs((now - kept).reshape(30, 4, 40, 4, 3).mean(axis=(1, 3))).max(axis=-1)
    blocks[:6, :14] /= 4.0  # words, drawn by one release of a library or another
    blocks[:3, 34:] /= 4.0
    assert np.mean(blocks > 2.0) < 2e-3, "if it is meant, look at the picture and save it anew"


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_window_covers_all_pixels_that_see_the_solid(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = Camera(np.array([3.0, -2.0, 1.5]), np.zeros(3), 0.9, 40, 30)
    start, end = rng.uniform(-1.5, 1.5, (2, 3))
    solid = ConvexPart(start, end, float(rng.uniform(0.01, 0.4)), np.ones(3), flat=bool(rng.integers(2)))
    seen = np.isfinite(intersect(solid, camera.eye, camera.rays()).distance)
    covered = np.zeros_like(seen)
    covered[camera.window(np.stack([start, end]), 1.5 * solid.radius)] = True
    assert not np.any(seen & ~covered)


def pixel(renderer: Renderer, point: Array) -> tuple[int, int]:
    """Row and column at which a picture shows a point (3,) of the world, by projection."""
    camera = renderer.camera
    x, y, z = camera.axes @ (point - camera.eye)
    shown = 0.5 * np.array([camera.height, camera.width]) + camera.focal * np.array([y, x]) / z
    row, column = (shown * [480 / camera.height, 640 / camera.width]).astype(int)
    return int(row), int(column)


def test_the_tip_is_drawn_where_kinematics_has_it(renderer: Renderer, puma: Mechanism) -> None:
    parts = skeleton(puma)
    for p in (CENTER, RAISED, np.array([0.5, -0.3, 0.5, 0.3, 0.3, 0.0])):
        row, column = pixel(renderer, tip_path(parts, *link_poses(puma, p)))
        tip = renderer.image(p, p, 0.0)[row, column]
        assert tip.astype(int).max() < 90, "the tool's ball is dark, everything around it is not"


def test_solids_are_the_skeletons_and_a_ghosts_are_thinner(renderer: Renderer, puma: Mechanism) -> None:
    """Round ends come out of a cylinder by its radius, so that a ghost's reach no further than the arm's own."""
    rotations, origins = link_poses(puma, RAISED)
    for color, scale in ((None, 1.0), (GOAL, GHOST_SCALE)):
        solids = renderer._arm(RAISED, color)
        for shape, solid in zip(skeleton(puma).shapes, solids, strict=True):
            start, end = (rotations[shape.link] @ x + origins[shape.link] for x in (shape.start, shape.end))
            short = 0.5 * (1.0 - scale) * (end - start) * (shape.solid is Solid.JOINT)
            np.testing.assert_allclose(solid.start, start + short, atol=1e-12)
            np.testing.assert_allclose(solid.end, end - short, atol=1e-12)
            assert solid.radius == scale * shape.radius


def test_the_ghost_is_where_the_arm_should_be(renderer: Renderer, puma: Mechanism) -> None:
    alone, both = renderer.image(CENTER, CENTER, 0.0), renderer.image(CENTER, RAISED, 0.0)
    changed = np.argwhere((alone != both).any(axis=-1))
    tip = pixel(renderer, tip_path(skeleton(puma), *link_poses(puma, RAISED)))
    assert np.abs(changed - tip).max(axis=1).min() <= 2
    tinted = both[tip].astype(float) - alone[tip]
    assert tinted @ (np.array(GOAL) - alone[tip]) > 0.0
    assert 1000 < len(changed) < 0.2 * alone.shape[0] * alone.shape[1]


def test_an_arm_that_tracks_hides_its_ghost(renderer: Renderer) -> None:
    """No speckles: the ghost's share of pixels falls with the error, to almost nothing at a milliradian."""
    exact = renderer.image(CENTER, CENTER, 0.0).astype(int)
    near = renderer.image(CENTER, CENTER + 1e-3, 0.0).astype(int)
    assert np.mean(np.abs(exact - near).max(axis=-1) > 8) < 1e-4


def test_the_time_is_written(renderer: Renderer) -> None:
    early, late = renderer.image(CENTER, CENTER, 1.25), renderer.image(CENTER, CENTER, 17.5)
    rows, columns = np.nonzero((early != late).any(axis=-1))
    assert rows.max() < 50
    assert columns.min() > 500


@pytest.mark.parametrize("seed", range(3))
def test_any_mechanism_can_be_drawn(seed: int) -> None:
    mechanism = random_tree(seed, 4)
    picture = Renderer(mechanism, 160, 120).image(np.zeros(4), np.full(4, 0.3), 0.0)
    assert picture.shape == (120, 160, 3)
    assert picture.std() > 5.0


def test_the_environment_renders_its_state() -> None:
    env = Puma560TrackingEnv(render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    assert picture is not None
    assert (picture.shape, picture.dtype) == ((480, 640, 3), np.uint8)
    np.testing.assert_array_equal(picture, env.render())
    for _ in range(100):
        env.step(np.array([90.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    moved = env.render()
    assert np.mean((picture != moved).any(axis=-1)) > 0.005
    assert env.metadata["render_fps"] == 1000.0


def test_without_a_mode_nothing_is_rendered() -> None:
    env = Puma560TrackingEnv()
    env.reset()
    with pytest.warns(UserWarning, match="render_mode='rgb_array'"):
        assert env.render() is None


def test_a_wall_is_drawn_before_and_behind_the_arm(puma: Mechanism) -> None:
    """Where its center is seen the picture is another one, and beside it the same."""
    (wall,) = surroundings_of("wall")
    bare, walled = (Renderer(puma, 160, 120, surroundings=given) for given in ((), (wall,)))
    pictures = [one.image(CENTER, CENTER, 0.0).astype(int) for one in (bare, walled)]
    changed = np.abs(pictures[1] - pictures[0]).max(axis=-1) > 0
    camera = replace(bare.camera, width=160, height=120)
    seen = (wall.pose.translation - camera.eye) @ camera.axes.T
    x, y = camera.focal * seen[:2] / seen[2] + [80.0, 60.0]
    assert changed[int(y), int(x)]
    assert 0.02 < changed.mean() < 0.5
    assert not changed[:, :40].any()


def test_a_wall_lets_through_what_is_behind_it(puma: Mechanism) -> None:
    """Of two pictures' difference, what its opacity leaves: an arm behind it, or the ground where the arm is not."""
    walls = surroundings_of("wall")
    bare, walled = (
        [Renderer(puma, 160, 120, surroundings=given).bare_image(p, p).astype(float) for p in (CENTER, RAISED)]
        for given in ((), walls)
    )
    before = [np.abs(one - other).max(axis=-1) > 8.0 for one, other in zip(walled, bare, strict=True)]
    both = (before[0] & before[1])[..., None] & (np.abs(bare[0] - bare[1]) > 60.0)
    assert both.sum() > 20
    shares = (walled[0] - walled[1])[both] / (bare[0] - bare[1])[both]
    assert np.median(shares) == pytest.approx(1.0 - BESIDE_OPACITY, abs=0.03)


def test_the_sky_darkens_upwards_and_the_floor_fades_into_its_foot(renderer: Renderer) -> None:
    """By where rays end: straight up, less than half as steep, above the horizon, and far away on the floor."""
    seen = copy(renderer)
    slopes = np.array([1.0, 0.41, 0.2, 1e-12, -1e-3])
    seen._rays = np.stack([np.sqrt(1.0 - slopes**2), 0.0 * slopes, slopes], axis=-1)[None]
    (colors,), (on_floor,), (ground,) = seen._background(1.0)
    np.testing.assert_array_equal(on_floor, [False] * 4 + [True])
    expected = [ZENITH, ZENITH, 0.5 * (HORIZON + ZENITH), HORIZON, HORIZON]
    np.testing.assert_allclose(colors, expected, atol=1e-9)
    assert ground[-1, 2] == pytest.approx(seen._floor)
