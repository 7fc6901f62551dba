"""Pictures of an arm and of its reference."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import GROUND
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.envs.rendering.caption import Caption
from adaptctl.envs.rendering.raycast import Camera, ConvexPart, intersect
from adaptctl.recording.drawing import BASE, BODY, GOAL, INK, RUNS, Color
from adaptctl.recording.skeleton import ROOT_RADIUS, Solid, skeleton

OVERSAMPLING = 2
"""Rays a pixel in each direction."""
SUN = np.array([0.30, -0.55, 0.78])
GHOST_OPACITY, GHOST_SCALE = 0.5, 0.95
"""The ghost is a little smaller, so that it vanishes inside an arm that tracks well instead of speckling it."""
ZENITH, HORIZON = np.array([0.74, 0.81, 0.90]), np.array([0.95, 0.96, 0.98])
FLOOR, LINE, SHADOW = np.array([0.87, 0.89, 0.91]), np.array([0.70, 0.74, 0.79]), 0.66
"""Colours of the floor and of its lines, and the brightness of a shadow on it."""
PAINT = {Solid.LINK: BODY, Solid.JOINT: RUNS[0], Solid.TOOL: INK}


class Renderer:
    """Renderer of images of one `mechanism`, a `Mechanism`, from a fixed viewpoint, in front and a little above, with
    all that the arm can reach in view. `width` and `height`, 640 and 480 by default, are those of the images in pixels.
    Background, floor and pedestals are computed once, at construction; the attribute `camera` is the `Camera`, with
    twice as many pixels in each direction, of which each four are averaged. Nothing is checked at construction."""

    def __init__(self, mechanism: Mechanism, width: int = 640, height: int = 480) -> None:
        self._mechanism, self._parts = mechanism, skeleton(mechanism)
        reach, sun = self._parts.reach, SUN / np.linalg.norm(SUN)
        feet = np.array([link.near.translation for link in mechanism.links if link.parent == GROUND])
        self._floor, self._sun = _floor_height(feet, reach), sun
        self._pedestals = _pedestals(feet, self._floor, 1.15 * ROOT_RADIUS * reach)
        self.camera = _camera(feet, self._floor, reach, (width, height))
        self._rays = self.camera.rays()
        self._backdrop, self._on_floor, self._ground = self._background(reach)
        self._caption = Caption(mechanism.name, {"arm": RUNS[0], "reference": GOAL}, width, height)

    def image(self, p: Array, goal: Array, time: float) -> NDArray[np.uint8]:
        """RGB image (height, width, 3), uint8, of the arm at positions `p` (r,) of its r primary (independent) joints,
        with a translucent ghost of it at positions `goal` (r,), rad (m if prismatic), its shadow on the floor and a
        text overlay with the `time`, s. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity,
        `LoopError` where kinematic loops cannot be closed, `SingularityError` near a singularity of the loops."""
        solids = [*self._pedestals, *self._arm(p)]
        picture = self._backdrop.copy()
        depth = np.full(picture.shape[:2], np.inf)  # the floor hides nothing: an arm without stops may sink into it
        self._cast_shadows(picture, solids)
        self._paint(picture, depth, solids)
        ghost, nearer = picture.copy(), depth.copy()
        self._paint(ghost, nearer, self._arm(goal, GOAL))
        seen = nearer < depth
        picture[seen] += GHOST_OPACITY * (ghost[seen] - picture[seen])
        return self._caption.over(_pixels(picture), time)

    def _arm(self, p: Array, ghost: Color | None = None) -> list[ConvexPart]:
        """The mechanism's shapes in the world."""
        rotations, origins = link_poses(self._mechanism, p)
        solids = []
        for shape in self._parts.shapes:
            flat, scale = shape.solid is Solid.JOINT, GHOST_SCALE if ghost else 1.0
            half, middle = 0.5 * (shape.end - shape.start), 0.5 * (shape.end + shape.start)
            shrink = scale if flat else 1.0  # round ends shrink with the radius
            ends = middle + np.outer([-shrink, shrink], half)
            start, end = ends @ rotations[shape.link].T + origins[shape.link]
            solids.append(ConvexPart(start, end, scale * shape.radius, _rgb(ghost or PAINT[shape.solid]), flat))
        return solids

    def _paint(self, picture: Array, depth: Array, solids: Iterable[ConvexPart]) -> None:
        """Draw solids into a picture (H, W, 3) where they are nearer than its depth (H, W)."""
        for solid in solids:
            window = self.camera.window(np.stack([solid.start, solid.end]), 1.5 * solid.radius)
            rays = self._rays[window]
            hits = intersect(solid, self.camera.eye, rays)
            nearer = hits.distance < depth[window]
            picture[window][nearer] = self._lit(solid.color, hits.normal[nearer], rays[nearer])
            depth[window][nearer] = hits.distance[nearer]

    def _lit(self, color: Array, normal: Array, rays: Array) -> Array:
        """Sun, sky and floor light on a surface (n, 3), and the sun's gleam (Blinn 1977)."""
        halfway = self._sun - rays
        halfway /= np.sqrt(np.vecdot(halfway, halfway))[:, None]
        sun = np.maximum(normal @ self._sun, 0.0)
        gleam = np.maximum(np.vecdot(normal, halfway), 0.0) ** 40 * (sun > 0.0)
        light = 0.42 + 0.13 * normal[:, 2] + 0.55 * sun
        return np.asarray(light[:, None] * color + 0.22 * gleam[:, None])

    def _cast_shadows(self, picture: Array, solids: Iterable[ConvexPart]) -> None:
        """Darken the floor where solids stand between it and the sun."""
        shaded = np.zeros(picture.shape[:2], dtype=bool)
        for solid in solids:
            ends = np.stack([solid.start, solid.end])
            on_floor = ends - ((ends[:, 2:] - self._floor) / self._sun[2]) * self._sun
            window = self.camera.window(on_floor, 1.5 * solid.radius / self._sun[2])
            towards = np.broadcast_to(self._sun, self._ground[window].shape)
            shaded[window] |= np.isfinite(intersect(solid, self._ground[window], towards).distance)
        picture[shaded & self._on_floor] *= SHADOW

    def _background(self, reach: float) -> tuple[Array, NDArray[np.bool_], Array]:
        """Sky and floor: the picture (H, W, 3), where it is floor (H, W), and the floor's points (H, W, 3)."""
        slope = self._rays[..., 2]
        on_floor = slope < 0.0
        distance = np.where(on_floor, (self._floor - self.camera.eye[2]) / np.minimum(slope, -1e-9), 0.0)
        ground = self.camera.eye + distance[..., None] * self._rays
        sky = HORIZON + np.clip(slope * 2.5, 0.0, 1.0)[..., None] * (ZENITH - HORIZON)
        floor = FLOOR + _grid(ground[..., :2], _spacing(reach))[..., None] * (LINE - FLOOR)
        away = np.linalg.norm(ground[..., :2] - self.camera.target[:2], axis=-1) / reach
        floor += np.clip((away - 1.2) / 3.0, 0.0, 1.0)[..., None] * (HORIZON - floor)
        return np.where(on_floor[..., None], floor, sky), on_floor, ground


def _pixels(picture: Array) -> NDArray[np.uint8]:
    """The mean of each pixel's rays, as bytes."""
    steps = range(OVERSAMPLING)
    mean = sum(picture[i::OVERSAMPLING, j::OVERSAMPLING] for i in steps for j in steps) / OVERSAMPLING**2
    return np.clip(255.0 * mean + 0.5, 0.0, 255.0).astype(np.uint8)


def _camera(feet: Array, floor: float, reach: float, size: tuple[int, int]) -> Camera:
    """Far enough to see all that the arm can reach, seen from the front and a little above."""
    top = float(feet[:, 2].max()) + reach
    target = np.append(feet[:, :2].mean(axis=0), 0.5 * (floor + top) - 0.05 * reach)
    eye = target + 4.2 * reach * np.array([0.74, -0.60, 0.30])
    half = max(0.52 * (top - floor), 0.8 * reach)
    field = 2.0 * np.arctan(half / np.linalg.norm(eye - target))
    return Camera(eye, target, float(field), OVERSAMPLING * size[0], OVERSAMPLING * size[1])


def _floor_height(feet: Array, reach: float) -> float:
    """The world's zero where the arm stands above it, else low enough for an arm on a pedestal (m)."""
    lowest = float(feet[:, 2].min())
    return 0.0 if lowest > 0.05 * reach else lowest - 0.7 * reach


def _pedestals(feet: Array, floor: float, radius: float) -> list[ConvexPart]:
    """A post on a plate under every link that hangs on the ground."""
    color, up = _rgb(BASE), np.array([0.0, 0.0, 1.0])
    posts = [ConvexPart(np.append(foot[:2], floor), foot, radius, color, flat=True) for foot in feet]
    plates = [ConvexPart(post.start, post.start + 0.25 * radius * up, 2.2 * radius, color, flat=True) for post in posts]
    return posts + plates


def _grid(points: Array, spacing: float) -> Array:
    """1.0 on the lines of a grid over points (..., 2) of the floor, else 0.0."""
    off = np.abs((points / spacing + 0.5) % 1.0 - 0.5) * spacing
    return (off.min(axis=-1) < 0.012 * spacing).astype(np.float64)


def _spacing(reach: float) -> float:
    """A round length of about a quarter of the reach (m)."""
    step = 10.0 ** np.floor(np.log10(0.25 * reach))
    choices: Sequence[float] = (1.0, 2.0, 5.0, 10.0)
    return float(step * min(choices, key=lambda c: abs(np.log(c * step / (0.25 * reach)))))


def _rgb(color: Color) -> Array:
    return np.array(color) / 255.0
