"""Ray-cast images of an arm and its reference."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import GROUND
from adaptctl.description.pose import Pose
from adaptctl.description.visual import Box, Visual
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.recording.colors import BASE, BODY, GOAL, INK, RUN_COLORS, Color
from adaptctl.recording.skeleton import ROOT_RADIUS, Solid, skeleton

OVERSAMPLING = 2
"""Rays per pixel and direction."""
SUN = np.array([0.30, -0.55, 0.78])
GHOST_OPACITY, GHOST_SCALE = 0.5, 0.95
"""Less than 1, so that the ghost vanishes inside an arm that tracks."""
BESIDE_OPACITY = 0.35
ZENITH, HORIZON = np.array([0.74, 0.81, 0.90]), np.array([0.95, 0.96, 0.98])
FLOOR, LINE, SHADOW = np.array([0.87, 0.89, 0.91]), np.array([0.70, 0.74, 0.79]), 0.66
PAINT = {Solid.LINK: BODY, Solid.JOINT: RUN_COLORS[0], Solid.TOOL: INK}


class Renderer:
    """Renderer of one mechanism."""

    def __init__(
        self, mechanism: Mechanism, width: int = 640, height: int = 480, surroundings: Sequence[Visual] = ()
    ) -> None:
        self._mechanism, self._parts = mechanism, skeleton(mechanism)
        reach, sun = self._parts.reach, SUN / np.linalg.norm(SUN)
        feet = np.array([link.parent_to_joint.translation for link in mechanism.links if link.parent == GROUND])
        self._floor, self._sun = _floor_height(feet, reach), sun
        self._pedestals = _pedestals(feet, self._floor, 1.15 * ROOT_RADIUS * reach)
        self.camera = _camera(feet, self._floor, reach, (width, height))
        self._rays = self.camera.rays()
        self._backdrop, self._on_floor, self._ground = self._background(reach)
        boxes = [(one.pose, np.array(one.solid.size)) for one in surroundings if isinstance(one.solid, Box)]
        self._beside = [self._box(*box) for box in boxes]
        self._caption = Caption(mechanism.name, {"arm": RUN_COLORS[0], "reference": GOAL}, width, height)

    def image(self, p: Array, goal: Array, time: float) -> NDArray[np.uint8]:
        """RGB image at `p`, with a ghost at `goal` and a caption."""
        return self._caption.over(self.bare_image(p, goal), time)

    def bare_image(self, p: Array, goal: Array) -> NDArray[np.uint8]:
        """RGB image at `p`, with a ghost at `goal`, without a caption."""
        solids = [*self._pedestals, *self._arm(p)]
        picture = self._backdrop.copy()
        depth = np.full(picture.shape[:2], np.inf)  # the floor hides nothing: an arm without stops may sink into it
        self._cast_shadows(picture, solids)
        self._paint(picture, depth, solids)
        ghost, nearer = picture.copy(), depth.copy()
        self._paint(ghost, nearer, self._arm(goal, GOAL))
        seen = nearer < depth
        picture[seen] += GHOST_OPACITY * (ghost[seen] - picture[seen])
        for distance, colors in self._beside:  # translucent, so that it hides no arm
            before = distance < depth
            picture[before] += BESIDE_OPACITY * (colors[before] - picture[before])
        return _pixels(picture)

    def _box(self, pose: Pose, size: Array) -> tuple[Array, Array]:
        """Distances (H, W) and colours (H, W, 3) of a box that stands beside the arm."""
        hits, colors = box_hits(pose, size, self.camera.eye, self._rays), np.zeros_like(self._rays)
        hit = np.isfinite(hits.distance)
        colors[hit] = self._lit(_rgb(BODY), hits.normal[hit], self._rays[hit])
        return hits.distance, colors

    def _arm(self, p: Array, ghost: Color | None = None) -> list[ConvexPart]:
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
        for solid in solids:
            window = self.camera.window(np.stack([solid.start, solid.end]), 1.5 * solid.radius)
            rays = self._rays[window]
            hits = intersect(solid, self.camera.eye, rays)
            nearer = hits.distance < depth[window]
            picture[window][nearer] = self._lit(solid.color, hits.normal[nearer], rays[nearer])
            depth[window][nearer] = hits.distance[nearer]

    def _lit(self, color: Array, normal: Array, rays: Array) -> Array:
        """Colours of a lit surface (n, 3) (Blinn 1977)."""
        halfway = self._sun - rays
        halfway /= np.sqrt(np.vecdot(halfway, halfway))[:, None]
        sun = np.maximum(normal @ self._sun, 0.0)
        gleam = np.maximum(np.vecdot(normal, halfway), 0.0) ** 40 * (sun > 0.0)
        light = 0.42 + 0.13 * normal[:, 2] + 0.55 * sun
        return np.asarray(light[:, None] * color + 0.22 * gleam[:, None])

    def _cast_shadows(self, picture: Array, solids: Iterable[ConvexPart]) -> None:
        shaded = np.zeros(picture.shape[:2], dtype=bool)
        for solid in solids:
            ends = np.stack([solid.start, solid.end])
            on_floor = ends - ((ends[:, 2:] - self._floor) / self._sun[2]) * self._sun
            window = self.camera.window(on_floor, 1.5 * solid.radius / self._sun[2])
            towards = np.broadcast_to(self._sun, self._ground[window].shape)
            shaded[window] |= np.isfinite(intersect(solid, self._ground[window], towards).distance)
        picture[shaded & self._on_floor] *= SHADOW

    def _background(self, reach: float) -> tuple[Array, NDArray[np.bool_], Array]:
        """Picture (H, W, 3), mask of the floor (H, W), and floor points (H, W, 3)."""
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
    steps = range(OVERSAMPLING)
    mean = sum(picture[i::OVERSAMPLING, j::OVERSAMPLING] for i in steps for j in steps) / OVERSAMPLING**2
    return np.clip(255.0 * mean + 0.5, 0.0, 255.0).astype(np.uint8)


def _camera(feet: Array, floor: float, reach: float, size: tuple[int, int]) -> Camera:
    top = float(feet[:, 2].max()) + reach
    target = np.append(feet[:, :2].mean(axis=0), 0.5 * (floor + top) - 0.05 * reach)
    eye = target + 4.2 * reach * np.array([0.74, -0.60, 0.30])
    half = max(0.52 * (top - floor), 0.8 * reach)
    field = 2.0 * np.arctan(half / np.linalg.norm(eye - target))
    return Camera(eye, target, float(field), OVERSAMPLING * size[0], OVERSAMPLING * size[1])


def _floor_height(feet: Array, reach: float) -> float:
    lowest = float(feet[:, 2].min())
    return 0.0 if lowest > 0.05 * reach else lowest - 0.7 * reach


def _pedestals(feet: Array, floor: float, radius: float) -> list[ConvexPart]:
    color, up = _rgb(BASE), np.array([0.0, 0.0, 1.0])
    posts = [ConvexPart(np.append(foot[:2], floor), foot, radius, color, flat=True) for foot in feet]
    plates = [ConvexPart(post.start, post.start + 0.25 * radius * up, 2.2 * radius, color, flat=True) for post in posts]
    return posts + plates


def _grid(points: Array, spacing: float) -> Array:
    off = np.abs((points / spacing + 0.5) % 1.0 - 0.5) * spacing
    return (off.min(axis=-1) < 0.012 * spacing).astype(np.float64)


def _spacing(reach: float) -> float:
    step = 10.0 ** np.floor(np.log10(0.25 * reach))
    return float(step * min((1.0, 2.0, 5.0, 10.0), key=lambda c: abs(np.log(c * step / (0.25 * reach)))))


def _rgb(color: Color) -> Array:
    return np.array(color) / 255.0


MISS_DISTANCE = np.inf
"""Distance of a ray without intersection."""


@dataclass(frozen=True, eq=False)
class ConvexPart:
    """Cylinder, capsule or ball."""

    start: Array
    end: Array
    radius: float
    color: Array
    flat: bool = False


class Hits(NamedTuple):
    """First intersections: distances and outward unit normals."""

    distance: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class Camera:
    """Pinhole camera."""

    eye: Array
    target: Array
    field: float
    width: int
    height: int

    @property
    def axes(self) -> Array:
        """Axes as rows (3, 3): right, down, forward."""
        forward = _unit(self.target - self.eye)
        right = _unit(np.cross(forward, [0.0, 0.0, 1.0]))
        return np.stack([right, np.cross(forward, right), forward])

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return 0.5 * self.height / np.tan(0.5 * self.field)

    def rays(self) -> Array:
        """Unit vectors (height, width, 3)."""
        x = (np.arange(self.width) + 0.5 - 0.5 * self.width) / self.focal
        y = (np.arange(self.height) + 0.5 - 0.5 * self.height) / self.focal
        right, down, forward = self.axes
        return _unit(x[None, :, None] * right + y[:, None, None] * down + forward)

    def window(self, points: Array, margin: float) -> tuple[slice, slice]:
        """Rows and columns that cover balls about points."""
        seen = (points - self.eye) @ self.axes.T
        if seen[:, 2].min() <= 1.5 * margin:
            return slice(0, self.height), slice(0, self.width)
        reach = self.focal * 1.2 * margin / (seen[:, 2] - margin) + 1.0
        x = 0.5 * self.width + self.focal * seen[:, 0] / seen[:, 2]
        y = 0.5 * self.height + self.focal * seen[:, 1] / seen[:, 2]
        return _span(y, reach, self.height), _span(x, reach, self.width)


def intersect(solid: ConvexPart, origin: Array, rays: Array) -> Hits:
    """First intersections of rays with a convex solid (Quilez 2016)."""
    axis, away = solid.end - solid.start, origin - solid.start
    length = float(axis @ axis)
    if not length:
        return _ball(solid.start, solid.radius, origin, rays)
    along, offset = rays @ axis, away @ axis
    a = length - along**2
    b = length * np.vecdot(away, rays) - offset * along
    c = length * (np.vecdot(away, away) - solid.radius**2) - offset**2
    inside = b * b - a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(inside)
        distance = (-b - root) / a
        height = offset + distance * along
        ends = _caps(solid, (a, b, c), (along, offset, length), (origin, rays))
    on_side = (inside >= 0.0) & (height > 0.0) & (height < length) & (distance > 0.0)
    point = away + distance[..., None] * rays
    side = (point - (height / length)[..., None] * axis) / solid.radius
    return Hits(np.where(on_side, distance, ends.distance), np.where(on_side[..., None], side, ends.normal))


def box_hits(pose: Pose, size: Array, origin: Array, rays: Array) -> Hits:
    """First intersections of rays with a box of edge lengths (3,) about a pose (Kay and Kajiya 1986)."""
    start, towards = (origin - pose.translation) @ pose.rotation, rays @ pose.rotation
    towards = np.where(np.abs(towards) < 1e-12, 1e-12, towards)
    low, high = (-0.5 * size - start) / towards, (0.5 * size - start) / towards
    enters, leaves = np.minimum(low, high), np.maximum(low, high)
    distance, side = enters.max(axis=-1), enters.argmax(axis=-1)
    hit = (distance > 0.0) & (distance < leaves.min(axis=-1))
    normal = -np.sign(np.take_along_axis(towards, side[..., None], axis=-1)) * np.eye(3)[side]
    return Hits(np.where(hit, distance, MISS_DISTANCE), normal @ pose.rotation.T)


def _caps(
    solid: ConvexPart,
    off_axis: tuple[Array, Array, Array],
    line: tuple[Array, Array, float],
    rays: tuple[Array, Array],
) -> Hits:
    """First intersections with the ends, where a d^2 + 2 b d + c is negative inside the cylinder."""
    (a, b, c), (along, offset, length) = off_axis, line
    if not solid.flat:
        start, end = (_ball(point, solid.radius, *rays) for point in (solid.start, solid.end))
        first = start.distance <= end.distance
        return Hits(np.where(first, start.distance, end.distance), np.where(first[..., None], start.normal, end.normal))
    facing = along < 0.0
    distance = (np.where(facing, length, 0.0) - offset) / along
    hit = ((a * distance + 2.0 * b) * distance + c < 0.0) & (distance > 0.0)
    outward = np.where(facing[..., None], 1.0, -1.0) * _unit(solid.end - solid.start)
    return Hits(np.where(hit, distance, MISS_DISTANCE), outward)


def _ball(center: Array, radius: float, origin: Array, rays: Array) -> Hits:
    away = origin - center
    b = np.vecdot(away, rays)
    inside = b * b - np.vecdot(away, away) + radius**2
    with np.errstate(invalid="ignore"):
        distance = -b - np.sqrt(inside)
        normal = (away + distance[..., None] * rays) / radius
    return Hits(np.where((inside >= 0.0) & (distance > 0.0), distance, MISS_DISTANCE), normal)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.sqrt(np.vecdot(vectors, vectors))[..., None])


def _span(centers: Array, reach: Array, size: int) -> slice:
    low, high = (centers - reach).min(), (centers + reach).max()
    return slice(int(np.clip(low, 0, size)), int(np.clip(np.ceil(high), 0, size)))


POINT = 100.0 / 72.0
"""Pixels per typographic point."""


class Caption:
    """Text overlay."""

    def __init__(self, name: str, colors: Mapping[str, Color], width: int, height: int) -> None:
        figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100.0)
        figure.patch.set_alpha(0.0)
        self._canvas = FigureCanvasAgg(figure)
        size = 0.026 * height / POINT
        margin, line = 0.035 * height / width, 0.052
        top = 1.0 - 0.035
        figure.text(margin, top, name, size=1.25 * size, weight="bold", color=INK.hex, va="top")
        self._time = figure.text(
            1.0 - margin, top, "", size=1.25 * size, color=INK.hex, va="top", ha="right", family="monospace"
        )
        for i, (meaning, color) in enumerate(colors.items()):
            y = top - line * (i + 1.3)
            figure.text(margin, y, "●", size=size, color=color.hex, va="top")
            figure.text(margin + 0.03, y, meaning, size=size, color=INK.hex, va="top")

    def over(self, picture: NDArray[np.uint8], time: float) -> NDArray[np.uint8]:
        """Copy of the picture with the overlay."""
        self._time.set_text(f"{time:.2f} s")
        self._canvas.draw()  # type: ignore[no-untyped-call]
        words = np.asarray(self._canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        opacity = words[..., 3:] / 255.0
        return np.rint(picture + opacity * (words[..., :3] - picture.astype(np.float64))).astype(np.uint8)
