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
    """A copy of a mechanism's `description` with the frame of each link at its joint, as in URDF, where equations of
    motion take fewest operations. Inertial parameters and loop closures are given in the new frames; shapes to draw and
    named frames are left out. Raises `InputError` where a length becomes greater than 1e9 m or an inertial parameter
    than 1e20."""
    far = {link.name: link.far for link in description.links}
    links = tuple(_link(link, description) for link in description.links)
    loops = None if description.loops is None else _loops(description.loops, far)
    return replace(description, links=links, loops=loops, visuals=(), frames=())


def joint_frame_parameters(description: Description) -> Array:
    """The matrix (P, P) that maps the P inertial parameters of a mechanism to those of the same mechanism with link
    frames at the joints (`with_joint_frames`), SI units, in the order of the description's property `parameter_names`.
    They are then about the joint frame's origin and along its axes. Drive parameters, rotor inertia and friction, are
    the same in both. Nothing is raised."""
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
