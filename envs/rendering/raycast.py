"""Round solids seen by a camera: exact intersections of rays with capsules and cylinders, in NumPy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array

FAR = np.inf
"""The distance of what is not met."""


@dataclass(frozen=True, eq=False)
class ConvexPart:
    """A cylinder or capsule to be drawn, of a `radius`, m, whose axis leads from `start` to `end`, (3,) each, m: with
    flat ends if `flat` is True, else with round ones (a capsule); a ball where both points coincide. `color` (3,) is
    red, green and blue in [0, 1]. Nothing is checked."""

    start: Array
    end: Array
    radius: float
    color: Array
    flat: bool = False


class Hits(NamedTuple):
    """First intersections of rays with a solid: `distance` (...), m, along each ray, infinite where the ray does not
    meet the solid, and `normal` (..., 3), the solid's outward unit normal there, arbitrary where there is none. Nothing
    is checked."""

    distance: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera at `eye` (3,) that looks at `target` (3,), in world coordinates, m, the z axis up; `field` is
    the vertical view angle in rad, `width` and `height` the picture's size in pixels. Nothing is checked: a camera that
    looks straight up or down gives NaN."""

    eye: Array
    target: Array
    field: float
    width: int
    height: int

    @property
    def axes(self) -> Array:
        """Axes of the camera in world coordinates, three orthogonal unit vectors as rows (3, 3): right and down in the
        picture, and forward, from `eye` to `target`."""
        forward = _unit(self.target - self.eye)
        right = _unit(np.cross(forward, [0.0, 0.0, 1.0]))
        return np.stack([right, np.cross(forward, right), forward])

    @property
    def focal(self) -> float:
        """Focal length of the camera in pixels: half the picture's height over the tangent of half the vertical view
        angle."""
        return 0.5 * self.height / np.tan(0.5 * self.field)

    def rays(self) -> Array:
        """Directions (height, width, 3) of the rays from the camera through the centres of its height x width pixels,
        unit vectors in world coordinates: rows from the top, columns from the left."""
        x = (np.arange(self.width) + 0.5 - 0.5 * self.width) / self.focal
        y = (np.arange(self.height) + 0.5 - 0.5 * self.height) / self.focal
        right, down, forward = self.axes
        return _unit(x[None, :, None] * right + y[:, None, None] * down + forward)

    def window(self, points: Array, margin: float) -> tuple[slice, slice]:
        """Rectangle of the picture, a pair of slices of rows and of columns in pixels, that covers all balls of radius
        `margin` (m) about n `points` (n, 3), world coordinates, m, and the straight lines between them; the whole
        picture where a point is within 1.5 `margin` of the camera's plane or behind it. Nothing is checked."""
        seen = (points - self.eye) @ self.axes.T
        if seen[:, 2].min() <= 1.5 * margin:
            return slice(0, self.height), slice(0, self.width)
        reach = self.focal * 1.2 * margin / (seen[:, 2] - margin) + 1.0
        x = 0.5 * self.width + self.focal * seen[:, 0] / seen[:, 2]
        y = 0.5 * self.height + self.focal * seen[:, 1] / seen[:, 2]
        return _span(y, reach, self.height), _span(x, reach, self.width)


def intersect(solid: ConvexPart, origin: Array, rays: Array) -> Hits:
    """First intersections, a `Hits`, of rays with a convex `solid`, a `ConvexPart` (Quilez 2016). `rays` (..., 3) are
    unit vectors; `origin`, (3,) for all or (..., 3) for each, m, are their starting points, outside the solid.
    Distances are in m, infinite where a ray does not meet the solid. Nothing is checked."""
    axis, away = solid.end - solid.start, origin - solid.start
    length = float(axis @ axis)
    if length < 1e-12:
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
        ends = _caps(solid, root, (a, b, along, offset, length), (origin, rays))
    on_side = (inside >= 0.0) & (height > 0.0) & (height < length) & (distance > 0.0)
    point = away + distance[..., None] * rays
    side = (point - (height / length)[..., None] * axis) / solid.radius
    return Hits(np.where(on_side, distance, ends.distance), np.where(on_side[..., None], side, ends.normal))


def _caps(
    solid: ConvexPart, root: Array, line: tuple[Array, Array, Array, Array, float], rays: tuple[Array, Array]
) -> Hits:
    a, b, along, offset, length = line
    if not solid.flat:
        start, end = (_ball(point, solid.radius, *rays) for point in (solid.start, solid.end))
        first = start.distance <= end.distance
        return Hits(np.where(first, start.distance, end.distance), np.where(first[..., None], start.normal, end.normal))
    facing = along < 0.0
    distance = (np.where(facing, length, 0.0) - offset) / along
    hit = (np.abs(b + a * distance) < root) & (distance > 0.0)
    outward = np.where(facing[..., None], 1.0, -1.0) * _unit(solid.end - solid.start)
    return Hits(np.where(hit, distance, FAR), outward)


def _ball(center: Array, radius: float, origin: Array, rays: Array) -> Hits:
    away = origin - center
    b = np.vecdot(away, rays)
    inside = b * b - np.vecdot(away, away) + radius**2
    with np.errstate(invalid="ignore"):
        distance = -b - np.sqrt(inside)
        normal = (away + distance[..., None] * rays) / radius
    return Hits(np.where((inside >= 0.0) & (distance > 0.0), distance, FAR), normal)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.sqrt(np.vecdot(vectors, vectors))[..., None])


def _span(centers: Array, reach: Array, size: int) -> slice:
    low, high = (centers - reach).min(), (centers + reach).max()
    return slice(int(np.clip(low, 0, size)), int(np.clip(np.ceil(high), 0, size)))
