"""A mechanism whose links have their frames at their joints, where its equations take fewest operations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import GROUND, Description, Link
from adaptctl.description.inertia import PARAMETERS, transformed
from adaptctl.description.pose import Pose

if TYPE_CHECKING:
    from adaptctl.description.loops import Closure, Loops


def with_joint_frames(description: Description) -> Description:
    """The same mechanism, each link's frame being that of its joint, as in URDF, without shapes and named frames.

    Inertial parameters are about the new frames, as `joint_frame_parameters` makes them of the old.
    """
    far = {link.name: link.far for link in description.links}
    links = tuple(_link(link, description) for link in description.links)
    loops = None if description.loops is None else _loops(description.loops, far)
    return replace(description, links=links, loops=loops, visuals=(), frames=())


def joint_frame_parameters(description: Description) -> Array:
    """The matrix (P, P) from the parameters of a mechanism, SI units, those of drives included, to those of
    `with_joint_frames`."""
    matrix, size = np.eye(len(description.parameter_names)), len(PARAMETERS)
    for k, i in enumerate(description.bodies):
        moved = [transformed(one, description.links[i].far) for one in np.eye(size)]
        matrix[size * k : size * (k + 1), size * k : size * (k + 1)] = np.transpose(moved)
    return matrix


def _link(link: Link, description: Description) -> Link:
    near = link.near if link.parent == GROUND else description.links[link.parent].far @ link.near
    return replace(link, near=near, far=Pose.identity(), inertia=transformed(link.inertia, link.far))


def _loops(loops: Loops, far: dict[str, Pose]) -> Loops:
    def moved() -> Iterator[Closure]:
        for closure in loops.closures:
            first = far.get(closure.first or "", Pose.identity()) @ closure.first_frame
            second = far.get(closure.second or "", Pose.identity()) @ closure.second_frame
            yield replace(closure, first_frame=first, second_frame=second)

    return replace(loops, closures=tuple(moved()))
