"""Inverse kinematics: joint positions that bring a point of a link to a place in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, stacked, stacked_rows
from adaptctl.caching import sent_as_made
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.dynamics.recursion.kinematics import moving_point
from adaptctl.errors import InputError, SingularityError
from adaptctl.scalars import Column, Vec, column

LARGEST_STEP = 0.02
"""m a point is moved between two of Newton's steps: small enough to stay on one branch"""
LARGEST_TURN = 0.2
"""rad or m that any joint goes in one of them"""
LAST_STEPS = 4
"""Newton's steps at the goal"""
REACHED = 1e-9
"""m"""


@sent_as_made
@dataclass(frozen=True, eq=False)
class Tip:
    """A point fixed to a link of a mechanism, such as a tool's tip, for its forward and inverse kinematics.

    `mechanism` is the `Mechanism`, `link` the name of the link to which the point is fixed, and `offset` (3,) its
    coordinates in the link's frame, m. Raises `InputError` for an unknown link and for an offset of another shape or
    not finite.
    """

    mechanism: Mechanism
    link: str
    offset: Array

    def __post_init__(self) -> None:
        names = [link.name for link in self.mechanism.links]
        if self.link not in names:
            raise InputError(f"{self.mechanism.name}: there is no link {self.link!r}; links: {', '.join(names)}")
        object.__setattr__(self, "offset", frozen_array(self.offset, (3,), "offset"))

    def at(self, p: ArrayLike) -> Array:
        """Coordinates (..., 3) of the point in the world frame, m, at positions p (..., r) of the mechanism's r primary
        (independent) joints, rad (m if prismatic). Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or
        infinity, `LoopError` where loops cannot be closed, `SingularityError` near a singularity of the loops."""
        return self._moved(self.mechanism.configuration(p))[0]

    def joints(self, goals: ArrayLike, start: ArrayLike) -> Array:
        """Positions p (..., 3) of a mechanism's three primary joints, rad (m if prismatic), by inverse kinematics:
        there the point is within 1e-9 m of `goals` (..., 3), coordinates in the world frame, m. Each goal is approached
        from the positions `start` (3,) along a straight line of the point by Newton steps of at most 0.02 m, on the
        kinematic branch of `start`.

        Raises `InputError` for a mechanism of other than three degrees of freedom, goals or `start` of a wrong shape or
        not finite, goals that are out of reach or beyond a singularity, and where the point's Jacobian is exactly
        singular; `SingularityError` for a `start` near a singularity of the loops, `LoopError` where loops cannot be
        closed.
        """
        aim = np.asarray(goals, dtype=np.float64)
        if self.mechanism.dof != 3 or aim.shape[-1:] != (3,) or not np.isfinite(aim).all():
            raise InputError(
                f"{self.mechanism.name}: expected three freedoms and finite goals (..., 3), "
                f"got {self.mechanism.dof} and {aim.shape}"
            )
        p = np.broadcast_to(frozen_array(start, (3,), "start"), aim.shape)
        q = self.mechanism.configuration(p)
        begin, _ = self._moved(q)
        steps = max(1, int(np.ceil(np.linalg.norm(aim - begin, axis=-1).max(initial=0.0) / LARGEST_STEP)))
        for share in np.minimum(np.arange(1, steps + LAST_STEPS + 1) / steps, 1.0):
            place, jacobian = self._moved(q)
            p = p + self._step(jacobian, begin + share * (aim - begin) - place)
            q = self._closed(p, q)
        self._validate_reached(aim, self._moved(q)[0])
        return p

    def _step(self, jacobian: Array, way: Array) -> Array:
        """Newton's, no joint farther than LARGEST_TURN: beyond reach it would go anywhere."""
        try:
            step = np.asarray(np.linalg.solve(jacobian, way[..., None])[..., 0], dtype=np.float64)
        except np.linalg.LinAlgError as error:
            raise InputError(f"{self.mechanism.name}: {self.link} is in a singular configuration") from error
        return step / np.maximum(np.abs(step).max(axis=-1, keepdims=True) / LARGEST_TURN, 1.0)

    def _closed(self, p: Array, q: Array) -> Array:
        try:
            return self.mechanism.configuration(p, start=q if self.mechanism.continuation else None)
        except SingularityError as error:
            raise InputError(f"{self.mechanism.name}: {self.link} cannot reach every goal: {error}") from error

    def _validate_reached(self, aim: Array, place: Array) -> None:
        gaps = np.linalg.norm(place - aim, axis=-1)
        if not np.all(gaps < REACHED):
            worst = int(np.nan_to_num(gaps, nan=np.inf).argmax())
            goal = np.round(aim.reshape(-1, 3)[worst], 4).tolist()
            raise InputError(f"{self.mechanism.name}: {self.link} cannot reach {goal} m from where it starts")

    def _moved(self, q: Array) -> tuple[Array, Array]:
        """The point (..., 3) and its Jacobian (..., 3, r) at configurations q (..., n)."""
        equations, joints = self.mechanism.equations, column(q)
        moving = moving_point(equations.links, joints, self._link, Vec(*self.offset.tolist()))
        units = [Column(float(i == j) for j in range(self.mechanism.dof)) for i in range(self.mechanism.dof)]
        ways = [tuple(moving.velocity(equations.rates(joints, unit))) for unit in units]
        rows = [Column(way[i] for way in ways) for i in range(3)]
        return stacked(list(moving.position), q.shape[:-1]), stacked_rows(rows, q.shape[:-1])

    @property
    def _link(self) -> int:
        return [link.name for link in self.mechanism.links].index(self.link)
