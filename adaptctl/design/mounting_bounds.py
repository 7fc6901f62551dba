"""Bounds of mass on links."""

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

# Margin beyond a link's joints as a share of its length, and the least margin in m.
OFFSET_SHARE, MIN_OFFSET = 0.5, 0.1
# Share of a link's mass that may be added.
MASS_SHARE = 0.2
MAX_RATIO = 1e6
# Distance in m beyond a box that counts as inside.
POSITION_TOLERANCE = 1e-9


@sent_as_made
@dataclass(frozen=True, eq=False)
class MountingBounds:
    """
    Box of positions on a link where a mass may be mounted, and the largest such mass.

    Parameters
    ----------
    link : str
        Name of the link, checked where the bounds are used.
    lower : numpy.ndarray
        Lower corner (3,) in the link's frame in m.
    upper : numpy.ndarray
        Upper corner (3,) in m; a coordinate may equal that of `lower`.
    mass : float
        Largest mass in kg that may be mounted.

    Raises
    ------
    InputError
        If the mass is negative, `lower` is above `upper`, a shape is wrong, or a number is not finite.

    Examples
    --------
    >>> from adaptctl.design import MountingBounds
    >>> MountingBounds("upper", np.full(3, -0.1), np.full(3, 0.1), 2.0).grid(3).shape
    (27, 3)
    """

    link: str
    lower: Array
    upper: Array
    mass: float

    def __post_init__(self) -> None:
        lower = frozen_array(self.lower, (3,), f"{self.link}: lower")
        upper = frozen_array(self.upper, (3,), f"{self.link}: upper")
        if np.any(lower > upper):
            raise InputError(
                f"{self.link}: mounting bounds: expected lower <= upper, got {lower.tolist()}, {upper.tolist()}"
            )
        mass = real_number(self.mass, f"{self.link}: mass")
        if not 0.0 <= mass < np.inf:
            raise InputError(f"{self.link}: expected a mass of at least 0 kg, got {mass}")
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)

    @classmethod
    def for_link(
        cls, mechanism: Mechanism, link: str, mass_ratio: float = MASS_SHARE, max_offset: float = OFFSET_SHARE
    ) -> MountingBounds:
        """
        Return the default bounds of a counterweight on a link.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with the link.
        link : str
            Link that carries the counterweight, by name.
        mass_ratio : float, default 0.2
            Largest mass as a fraction of the link's own, without unit.
        max_offset : float, default 0.5
            Margin around the box of the link's joints and center of mass, as a fraction of that box's diagonal; at
            least 0.1 m, so that short links have room.

        Returns
        -------
        MountingBounds
            Box along the axes of the link's frame.

        Raises
        ------
        InputError
            If the link is unknown or owns no inertia, or a fraction is negative or not finite.

        Examples
        --------
        >>> from adaptctl.design import MountingBounds
        >>> round(MountingBounds.for_link(arm, "lower").mass, 2)
        0.24
        """
        mass_ratio, max_offset = _ratio(mass_ratio, "mass_ratio"), _ratio(max_offset, "max_offset")
        i = _index(mechanism, link)
        own = mechanism.links[i]
        points = [joint_line(own)[0], *attachments(mechanism.description)[i]]
        if own.inertia[0] > 0.0:
            points.append(own.inertia[1:4] / own.inertia[0])
        low, high = np.min(points, axis=0), np.max(points, axis=0)
        margin = max(MIN_OFFSET, max_offset * float(np.linalg.norm(high - low)))
        return cls(link, low - margin, high + margin, mass_ratio * float(own.inertia[0]))

    def validate(self, place: ArrayLike) -> None:
        """
        Raise `InputError` for a position outside the box.

        Parameters
        ----------
        place : array_like
            Position (3,) in the link's frame in m; 1e-9 m outside is accepted.

        Raises
        ------
        InputError
            If the position is outside, or not three finite numbers.

        Examples
        --------
        >>> from adaptctl.design import MountingBounds
        >>> MountingBounds("upper", np.zeros(3), np.ones(3), 2.0).validate([0.5, 0.5, 0.5])
        """
        x = frozen_array(place, (3,), f"{self.link}: place")
        if np.any(x < self.lower - POSITION_TOLERANCE) or np.any(x > self.upper + POSITION_TOLERANCE):
            low, high = np.round(self.lower, 4).tolist(), np.round(self.upper, 4).tolist()
            raise InputError(f"{self.link}: the position {x.tolist()} is outside the bounds {low} to {high} m")

    def grid(self, points_per_edge: int) -> Array:
        """
        Return evenly spaced positions over the box, faces included.

        Parameters
        ----------
        points_per_edge : int
            Number of positions along each edge, 1 to 100; 1 gives the lower corner.

        Returns
        -------
        numpy.ndarray
            Positions (points_per_edge^3, 3) in m, z changing fastest.

        Raises
        ------
        InputError
            If the number is out of range.

        Examples
        --------
        >>> from adaptctl.design import MountingBounds
        >>> MountingBounds("upper", np.zeros(3), np.ones(3), 2.0).grid(2)[:2].tolist()
        [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
        """
        whole_number(points_per_edge, "grid: points_per_edge", 1, 100)
        axes = [np.linspace(a, b, points_per_edge) for a, b in zip(self.lower, self.upper, strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def bounds(
    mechanism: Mechanism, links: Iterable[str], mass_ratio: float = MASS_SHARE, max_offset: float = OFFSET_SHARE
) -> tuple[MountingBounds, ...]:
    """Default bounds of counterweights on several links."""
    names = tuple(links)
    if len(set(names)) < len(names) or not names:
        raise InputError(f"links: expected one or more different links, got {', '.join(names) or 'none'}")
    return tuple(MountingBounds.for_link(mechanism, name, mass_ratio, max_offset) for name in names)


def _ratio(value: object, name: str) -> float:
    ratio = real_number(value, what := f"mounting bounds: {name}")
    if not 0.0 <= ratio <= MAX_RATIO:
        raise InputError(f"{what}: expected a ratio of at least 0, at most {MAX_RATIO:g}, got {ratio}")
    return ratio


def _index(mechanism: Mechanism, link: str) -> int:
    names = mechanism.description.body_names
    if link not in names:
        raise InputError(f"{mechanism.name}: no link {link!r} with inertia; links: {', '.join(names)}")
    return mechanism.description.bodies[names.index(link)]
