"""The certificate of a rank: the evidence for it, and angles of the geometry that are nearly right ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import Description
from adaptctl.description.transforms import meeting_axes
from adaptctl.errors import RankError

Method = Literal["automatic", "svd", "transfers"]

Near = Literal["refuse", "as_is"]


NEAR = 1e-3
"""Angle (rad) to a multiple of 90 degrees below which a miss is suspicious."""
EXACT = 1e-11
"""Angle (rad) to a multiple of 90 degrees below which it counts as reached: 1.57079632679 misses by 5e-12."""


SMALLEST_GAP = 1e6
SMALLEST_SINGULAR_VALUE = 1e-9
"""Least sigma_k/sigma_1 of the scaled energy differences."""
ROUND_OFF = 1e-14
"""Values beyond the gap above this, relative to sigma_1, are named: they are more than round-off."""
MAX_RESIDUAL_SINGULAR_VALUE = 1e-8
"""Values beyond the gap above this, relative to sigma_1, are far more than round-off, and refuse the rank: 1e-11 of an
angle, times a thousand where a small column is scaled up."""
LISTED = 80
"""Most singular values in a message."""


@dataclass(frozen=True)
class NearRightAngle:
    """A near right angle: two successive joints, the angle between whose axes is within 1e-3 rad of a multiple of 90
    degrees, but not that multiple.

    `parent` is the name of the joint before, or "gravity" for a joint on the ground, `child` the joint; `degrees` is
    the multiple that is missed (0, 90 or 180), and `miss` the angle beyond it in rad, negative where it falls short,
    less than 1e-3 in size. Nothing is checked at construction.
    """

    parent: str
    child: str
    degrees: int
    deviation: float

    def __str__(self) -> str:
        return (
            f"{self.parent} and {self.child} miss {self.degrees} degrees by {abs(self.deviation):.1e} rad: "
            "if a right angle is meant, write it exactly, or snap it (`snapped`)"
        )


def near_right_angles(description: Description, exact: float = EXACT) -> tuple[NearRightAngle, ...]:
    """The near right angles of a mechanism: a `NearRightAngle` for each pair of successive joint axes of its
    `description` whose angle is within 1e-3 rad of a multiple of 90 degrees, but not within `exact` (rad, 1e-11 by
    default). For a joint on the ground, the direction of gravity replaces the axis before it; without gravity it has no
    pair. Empty where there are no near right angles. Nothing is checked."""
    meeting = list(meeting_axes(description))
    if not meeting:
        return ()
    axes = np.array([pair for _, _, pair in meeting])
    first, second = axes[:, 0], axes[:, 1]
    # The arc tangent is exact at all angles; the arc cosine loses half the digits near 0.
    angles = np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), np.sum(first * second, axis=1))
    quarters = np.round(angles / (np.pi / 2)).astype(int)
    misses = angles - quarters * (np.pi / 2)
    near = np.flatnonzero((exact < np.abs(misses)) & (np.abs(misses) < NEAR)).tolist()
    pairs = ((meeting[i], i) for i in near)
    return tuple(
        NearRightAngle(parent, link.joint.name, 90 * int(quarters[i]), float(misses[i]))
        for (link, parent, _), i in pairs
    )


@dataclass(frozen=True)
class ResidualSingularValue:
    """A singular value after the first k that the rank k counts as zero, though it is more than round-off (above 1e-14
    of the largest).

    `value` is its ratio to the largest, sigma_1, no unit. `parameters` are the names of those that dominate its right
    singular vector, four at most, or, where a tree's rank was found joint by joint, one text with the name of the link
    at whose joint it is. Nothing is checked at construction.
    """

    value: float
    parameters: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.value:.1e} ({', '.join(self.parameters)})"


@dataclass(frozen=True)
class Certificate:
    """Certificate of a mechanism's rank k, the number of identifiable inertial parameters: ranks found in independent
    ways, three from scaled matrices and one in exact arithmetic, and ratios, all without a unit, that say how clear-cut
    they are.

    With singular values sigma_1 >= sigma_2 >= ..., `rank_energy` is the rank of the energy differences at `samples`
    random states, drawn by `seed`, `rank_doubled` that of twice as many, `rank_torque` that of rows of the torque
    regressor, None where the method was transfers (below). `gap` is sigma_k/sigma_k+1 of the energy differences,
    `relative_smallest` sigma_k/sigma_1, both floored at 1e-15 of sigma_1. `null_residual` is the largest torque that
    any null vector (a change of parameters that changes no energy) makes on other samples, relative to the largest that
    a vector of its size can make.

    By transfers, the method that finds a tree's rank joint by joint, `rank_geometry`, which follows from the tree's
    geometry (None otherwise), takes the place of `rank_torque`. Both ratios are then the least over the joints, of the
    energy changes as inertial parameters are moved from a joint's link to the parent link, and `null_residual` is the
    largest change by a combination of these that by geometry makes none, relative to the largest that one of its size
    can make.

    `rank_exact` is that of exact geometry, computed in the arithmetic that `proof_method` names ("a prime field" or "60
    digits"); None, and "", where it was not asked for. `residual_singular_values` are singular values after sigma_k
    that are above 1e-14 of sigma_1, `near_right_angles` pairs of successive joint axes whose angle is within 1e-3 rad
    of a multiple of 90 degrees, but not exactly that; both are empty where there are none. Nothing is checked at
    construction: `faults` and `validate_accepted` judge it.
    """

    rank_energy: int
    rank_doubled: int
    gap: float
    relative_smallest: float
    samples: int
    seed: int
    null_residual: float
    residual_singular_values: tuple[ResidualSingularValue, ...] = ()
    near_right_angles: tuple[NearRightAngle, ...] = ()
    rank_torque: int | None = None
    rank_geometry: int | None = None
    rank_exact: int | None = None
    proof_method: str = ""

    @property
    def rank(self) -> int:
        """The rank k of the energy differences: the number of identifiable inertial parameters, without friction. It is
        certified where this certificate's `faults`, reasons to refuse it, are empty."""
        return self.rank_energy

    @property
    def failures(self) -> tuple[str, ...]:
        """Reasons, as texts, for which the rank k cannot be accepted; empty when it can. These are a ratio
        sigma_k/sigma_k+1 of successive singular values (`gap`) below 1e6, a ratio sigma_k/sigma_1 (`relative_smallest`)
        below 1e-9, ranks found in different ways that are not all equal, and a singular value after sigma_k above 1e-8
        of sigma_1."""
        other, what = self._other
        ranks = (self.rank_energy, other, self.rank_doubled)
        largest = max((leftover.value for leftover in self.residual_singular_values), default=0.0)
        wrong = {
            f"the gap at {self.rank} is {self.gap:.1e}, at least {SMALLEST_GAP:.0e} is needed": (
                self.gap < SMALLEST_GAP
            ),
            f"sigma_k/sigma_1 is {self.relative_smallest:.1e}, at least {SMALLEST_SINGULAR_VALUE:.0e} is needed": (
                self.relative_smallest < SMALLEST_SINGULAR_VALUE
            ),
            f"energies say {ranks[0]}, {what} {ranks[1]}, energies of twice as many samples {ranks[2]}": (
                len(set(ranks)) > 1
            ),
            f"beyond the gap there is {largest:.1e} of sigma_1, far more than round-off": largest
            > MAX_RESIDUAL_SINGULAR_VALUE,
            f"energies say {self.rank_energy}, exact geometry over {self.proof_method} says {self.rank_exact}": (
                self.rank_exact not in (None, self.rank_energy)
            ),
        }
        return tuple(text for text, holds in wrong.items() if holds)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Remarks, as texts, on findings that do not refuse the rank; empty where there are none. They are first one
        for each singular value beyond the rank that is above 1e-14 of the largest, then one for each pair of joint axes
        that meet within 1e-3 rad of a multiple of 90 degrees, but not exactly."""
        residual_singular_values = [
            f"beyond the gap, {leftover} is more than round-off" for leftover in self.residual_singular_values
        ]
        return (*residual_singular_values, *map(str, self.near_right_angles))

    def __str__(self) -> str:
        return (
            f"rank {self.rank} by the energies of {self.samples} and of {2 * self.samples} states and by "
            f"{self._other[1]}; "
            f"gap {self.gap:.1e}, sigma_k/sigma_1 {self.relative_smallest:.1e}"
            + (f"; the same exactly, over {self.proof_method}" if self.rank_exact is not None else "")
        )

    @property
    def _other(self) -> tuple[int | None, str]:
        """The rank that is not found from energies, and where from."""
        if self.rank_geometry is not None:
            return self.rank_geometry, "geometry"
        return self.rank_torque, "torques"

    def validate_accepted(self, mechanism: str, spectrum: Array, suspects: Sequence[object] = ()) -> None:
        """Raise `RankError` unless the rank, the number of identifiable parameters, can be accepted, that is unless
        this certificate's `faults`, reasons to refuse it, are empty. The error's `singular_values` are the n scaled
        singular values `spectrum` (n,), in descending order, no unit, an array that is not checked; its message names
        the `mechanism`, the faults and the `suspects`, possible causes, none by default."""
        if not self.failures:
            return
        hints = "".join(f"; {suspect}" for suspect in suspects)
        raise RankError(
            f"{mechanism}: the rank cannot be certified: {'; '.join(self.failures)}{hints}. "
            f"Scaled singular values over the largest: {_listing(spectrum / spectrum.max(initial=1e-300), self.rank)}",
            tuple(spectrum.tolist()),
        )


def _listing(relative: Array, rank: int) -> str:
    """Text of all values, or of those about the gap where there are very many."""
    if len(relative) <= LISTED:
        return " ".join(f"{x:.1e}" for x in relative)
    first = max(0, rank - LISTED // 2)
    shown = relative[first : first + LISTED]
    return f"(from the {first + 1}th) " + " ".join(f"{x:.1e}" for x in shown)
