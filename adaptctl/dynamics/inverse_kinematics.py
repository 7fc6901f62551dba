"""Inverse kinematics of a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, stacked, stacked_rows
from adaptctl.caching import sent_as_made
from adaptctl.description.places import place_on_link
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.dynamics.recursion.kinematics import moving_point
from adaptctl.errors import InputError, SingularityError
from adaptctl.scalars import Column, Vec, column

MAX_POINT_STEP = 0.02
"""m between Newton steps, to stay on one branch"""
MAX_JOINT_STEP = 0.2
"""rad or m that a joint moves per step"""
FINAL_NEWTON_STEPS = 4
"""Newton's steps at the goal"""
POSITION_TOLERANCE = 1e-9
"""m"""


@sent_as_made
@dataclass(frozen=True, eq=False)
class Tip:
    """
    Point fixed to a link, such as a tool's tip.

    Parameters
    ----------
    mechanism : Mechanism
        Robot with r primary joints.
    link : str
        Name of the link to which the point is fixed.
    offset : array_like
        Coordinates (3,) of the point in the link's frame in m.

    Raises
    ------
    InputError
        If the link is unknown or the offset has another shape or is not finite.

    Examples
    --------
    >>> from adaptctl.dynamics.inverse_kinematics import Tip
    >>> tip = Tip(arm, "lower", [0.0, 0.0, 0.0])
    >>> [round(float(x), 3) for x in tip.at([0.0, 0.0])]
    [0.7, 0.0, 0.0]
    """

    mechanism: Mechanism
    link: str
    offset: Array

    def __post_init__(self) -> None:
        link, pose = place_on_link(self.mechanism.description, self.link, self.mechanism.name)
        offset = frozen_array(self.offset, (3,), "offset")
        if link != self.link:
            object.__setattr__(self, "link", link)
            offset = frozen_array(pose.rotation @ offset + pose.translation, (3,), "offset")
        object.__setattr__(self, "offset", offset)

    def at(self, p: ArrayLike) -> Array:
        """
        Compute the point's place in the world.

        Parameters
        ----------
        p : array_like
            Positions (..., r) of the primary joints in rad (m if prismatic).

        Returns
        -------
        ndarray
            Coordinates (..., 3) in the world frame in m.

        Raises
        ------
        SingularityError
            If the loops come near a singularity.
        """
        return self._moved(self.mechanism.configuration(p))[0]

    def joints(self, goals: ArrayLike, start: ArrayLike) -> Array:
        """
        Compute joint positions that bring the point to its goals, for three primary joints.

        Parameters
        ----------
        goals : array_like
            Coordinates (..., 3) in the world frame in m.
        start : array_like
            Joint positions (3,) from which each goal is approached along a straight line; they fix the kinematic
            branch.

        Returns
        -------
        ndarray
            Positions (..., 3) in rad (m if prismatic), with the point within 1e-9 m of its goal.

        Raises
        ------
        InputError
            If the mechanism has other than three degrees of freedom, an array is of a wrong shape or not finite, or a
            goal is out of reach or beyond a singularity.
        SingularityError
            If `start` is near a singularity of the loops.

        Examples
        --------
        >>> from adaptctl.dynamics.inverse_kinematics import Tip
        >>> from dataclasses import replace
        >>> puma = adaptctl.load("puma560_measured").description
        >>> tip = Tip(adaptctl.Mechanism(replace(puma, links=puma.links[:3])), "link3", [0.0, 0.0, 0.4])
        >>> start = np.array([0.1, 0.2, 0.3])
        >>> goal = tip.at(start) + [0.01, 0.0, 0.02]
        >>> bool(np.allclose(tip.at(tip.joints(goal, start)), goal))
        True
        """
        aim = np.asarray(goals, dtype=np.float64)
        if self.mechanism.dof != 3 or aim.shape[-1:] != (3,) or not np.isfinite(aim).all():
            raise InputError(
                f"{self.mechanism.name}: expected three degrees of freedom and finite goals (..., 3), "
                f"got {self.mechanism.dof} and {aim.shape}"
            )
        p = np.broadcast_to(frozen_array(start, (3,), "start"), aim.shape)
        q = self.mechanism.configuration(p)
        begin, _ = self._moved(q)
        steps = max(1, int(np.ceil(np.linalg.norm(aim - begin, axis=-1).max(initial=0.0) / MAX_POINT_STEP)))
        for share in np.minimum(np.arange(1, steps + FINAL_NEWTON_STEPS + 1) / steps, 1.0):
            place, jacobian = self._moved(q)
            p = p + self._step(jacobian, begin + share * (aim - begin) - place)
            q = self._closed(p, q)
        self._validate_reached(aim, self._moved(q)[0])
        return p

    def _step(self, jacobian: Array, way: Array) -> Array:
        try:
            step = np.asarray(np.linalg.solve(jacobian, way[..., None])[..., 0], dtype=np.float64)
        except np.linalg.LinAlgError as error:
            raise InputError(f"{self.mechanism.name}: {self.link} is in a singular configuration") from error
        return step / np.maximum(np.abs(step).max(axis=-1, keepdims=True) / MAX_JOINT_STEP, 1.0)

    def _closed(self, p: Array, q: Array) -> Array:
        try:
            return self.mechanism.configuration(p, start=q if self.mechanism.continuation else None)
        except SingularityError as error:
            raise InputError(f"{self.mechanism.name}: {self.link} cannot reach every goal: {error}") from error

    def _validate_reached(self, aim: Array, place: Array) -> None:
        gaps = np.linalg.norm(place - aim, axis=-1)
        if not np.all(gaps < POSITION_TOLERANCE):
            worst = int(np.nan_to_num(gaps, nan=np.inf).argmax())
            goal = np.round(aim.reshape(-1, 3)[worst], 4).tolist()
            raise InputError(f"{self.mechanism.name}: {self.link} cannot reach {goal} m from its start")

    def _moved(self, q: Array) -> tuple[Array, Array]:
        equations, joints = self.mechanism.equations, column(q)
        moving = moving_point(equations.links, joints, self._link, Vec(*self.offset.tolist()))
        units = [Column(float(i == j) for j in range(self.mechanism.dof)) for i in range(self.mechanism.dof)]
        ways = [tuple(moving.velocity(equations.joint_velocities(joints, unit))) for unit in units]
        rows = [Column(way[i] for way in ways) for i in range(3)]
        return stacked(list(moving.position), q.shape[:-1]), stacked_rows(rows, q.shape[:-1])

    @property
    def _link(self) -> int:
        return [link.name for link in self.mechanism.links].index(self.link)
