"""MountingBounds on links where mass may be: boxes in the links' frames."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, real_number, whole_number
from adaptctl.caching import sent_as_made
from adaptctl.description.reach import attachments, joint_line
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError

BEYOND, LEAST = 0.5, 0.1
"""Share of a link's length that places reach beyond its joints, and the least that they do, m."""
SHARE = 0.2
"""Of a link's mass that may be added."""
SLACK = 1e-9
"""m beyond a box within which a place is in it still"""


@sent_as_made
@dataclass(frozen=True, eq=False)
class MountingBounds:
    """Bounds of a counterweight on the link named `link`: the box of positions of its centre from `lower` (3,) to
    `upper` (3,), m in the link's frame, and its greatest `mass` (kg).

    Raises `InputError` for masses that are no numbers or below zero, for a `lower` above `upper` in a coordinate (equal
    ones are allowed), for ends that are not of shape (3,) and for numbers that are not finite. The link's name is
    checked only where the bounds are used.
    """

    link: str
    lower: Array
    upper: Array
    mass: float

    def __post_init__(self) -> None:
        lower = frozen_array(self.lower, (3,), f"{self.link}: lower")
        upper = frozen_array(self.upper, (3,), f"{self.link}: upper")
        if np.any(lower > upper):
            raise InputError(f"{self.link}: places: expected lower <= upper, got {lower.tolist()}, {upper.tolist()}")
        mass = real_number(self.mass, f"{self.link}: mass")
        if not 0.0 <= mass < np.inf:
            raise InputError(f"{self.link}: expected a mass of at least 0 kg, got {mass}")
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)

    @classmethod
    def of(
        cls, mechanism: Mechanism, link: str, mass_ratio: float = SHARE, max_offset: float = BEYOND
    ) -> MountingBounds:
        """Default bounds of a counterweight on the link named `link` of a mechanism. Its positions are a box along the
        axes of the link's frame: the smallest around the link's joint, the points where other links or loops join it,
        the frame's origin where that is farther from the joint than these points, and the centre of mass, widened on
        all sides by the fraction `beyond` (unitless, by default 0.5) of the box's diagonal, and by 0.1 m at least.

        Its greatest mass (kg) is the fraction `share` (unitless, by default 0.2) of the link's own. Raises `InputError`
        for a link that is unknown or owns no inertia and for a fraction that is no number, below zero or not finite.
        """
        mass_ratio, max_offset = real_number(mass_ratio, "places: share"), real_number(max_offset, "places: beyond")
        if not 0.0 <= mass_ratio < np.inf or not 0.0 <= max_offset < np.inf:
            raise InputError(
                f"places: expected shares of at least 0, got {mass_ratio} of mass and {max_offset} of length"
            )
        i = _index(mechanism, link)
        own = mechanism.links[i]
        points = [joint_line(own)[0], *attachments(mechanism.description)[i]]
        if own.inertia[0] > 0.0:
            points.append(own.inertia[1:4] / own.inertia[0])
        low, high = np.min(points, axis=0), np.max(points, axis=0)
        margin = max(LEAST, max_offset * float(np.linalg.norm(high - low)))
        return cls(link, low - margin, high + margin, mass_ratio * float(own.inertia[0]))

    def validate(self, place: ArrayLike) -> None:
        """Raise `InputError`, which states the box, unless a position `place` (3,), m in the link's frame, is within
        the box from this object's `lower` to its `upper` or at most 1e-9 m outside it in each coordinate; `InputError`
        too for a position that is not three finite numbers. Nothing is returned."""
        x = frozen_array(place, (3,), f"{self.link}: place")
        if np.any(x < self.lower - SLACK) or np.any(x > self.upper + SLACK):
            low, high = np.round(self.lower, 4).tolist(), np.round(self.upper, 4).tolist()
            raise InputError(f"{self.link}: the place {x.tolist()} is outside the bounds {low} to {high} m")

    def grid(self, each: int) -> Array:
        """Positions (each^3, 3), m in the link's frame, evenly spaced over the box from this object's `lower` to its
        `upper`, faces included, with `each` of them along every edge, z changing fastest, then y, then x; for 1, the
        corner `lower` alone. Raises `InputError` for an `each` other than a whole number from 1 to 100."""
        whole_number(each, "grid: places along an edge", 1, 100)
        axes = [np.linspace(a, b, each) for a, b in zip(self.lower, self.upper, strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def bounds(
    mechanism: Mechanism, links: Iterable[str], mass_ratio: float = SHARE, max_offset: float = BEYOND
) -> tuple[MountingBounds, ...]:
    """Default bounds of counterweights, a tuple of one `MountingBounds` for each of the `links` named, in their order:
    a greatest mass (kg), the fraction `share` (unitless, by default 0.2) of the link's own, and a box of positions, m
    in its frame, around its joints and centre of mass, widened on all sides by the fraction `beyond` (unitless, by
    default 0.5) of the box's diagonal, and by 0.1 m at least. Raises `InputError` for no links or one given twice,
    links that are unknown or own no inertia, and fractions that are no numbers, below zero or not finite."""
    names = tuple(links)
    if len(set(names)) < len(names) or not names:
        raise InputError(f"links: expected at least one, each once, got {', '.join(names) or 'none'}")
    return tuple(MountingBounds.of(mechanism, name, mass_ratio, max_offset) for name in names)


def _index(mechanism: Mechanism, link: str) -> int:
    names = mechanism.description.body_names
    if link not in names:
        raise InputError(f"{mechanism.name}: there is no link {link!r} with inertia; links: {', '.join(names)}")
    return mechanism.description.bodies[names.index(link)]
