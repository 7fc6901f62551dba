"""Lengths along a mechanism's links, and how far joints reach."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.link import GROUND, Link

JOINT_DISTANCE_TOLERANCE = 1e-6
"""m from its joint within which a link's frame is at the joint, and does not say where the link ends"""
MIN_LENGTH = 1e-6
"""m: shorter lengths are none"""


def joint_line(link: Link) -> tuple[Array, Array]:
    """Point (3,) on the axis of a link's joint and its direction, in the link's frame."""
    return link.joint_to_link.inverse.translation, link.joint_to_link.rotation.T @ link.joint.axis


def link_end(link: Link) -> Array:
    """Point (3,) where a `link` ends, in its frame, m."""
    start, _ = joint_line(link)
    if np.linalg.norm(start) > JOINT_DISTANCE_TOLERANCE or link.inertia[0] <= 0.0:
        return np.zeros(3)
    return link.inertia[1:4] / link.inertia[0]


def attachments(description: Description) -> list[list[Array]]:
    """Attachment points of every link of the mechanism of a `description`."""
    points: list[list[Array]] = [[] for _ in description.links]
    for link in description.links:
        if link.parent != GROUND:
            points[link.parent].append(link.parent_to_joint.translation)
    place = {link.name: i for i, link in enumerate(description.links)}
    for closure in description.loops.closures if description.loops else ():
        for name, frame in ((closure.first, closure.first_frame), (closure.second, closure.second_frame)):
            if name is not None:
                points[place[name]].append(frame.translation)
    return [_with_end(own, link) for own, link in zip(points, description.links, strict=True)]


def _with_end(points: list[Array], link: Link) -> list[Array]:
    """Points of a link, with its end where it reaches beyond the others."""
    (joint, _), end = joint_line(link), link_end(link)
    farthest = max((float(np.linalg.norm(point - joint)) for point in points), default=0.0)
    part_of_joint = bool(points) and farthest <= MIN_LENGTH
    beyond = np.linalg.norm(end - joint) > farthest + MIN_LENGTH
    return points if part_of_joint or (points and not beyond) else [*points, end]


def depths(parents: Iterable[int]) -> list[int]:
    """Numbers of joints from the ground to each of a tree's n links."""
    found: list[int] = []
    for parent in parents:
        found.append(1 if parent == GROUND else 1 + found[parent])
    return found


def chain_reach(links: Sequence[Link], index: int) -> float:
    """Length in m of the chain from the first joint to a link's end."""
    length = _length(links[index])
    while (parent := links[index].parent) != GROUND:
        length += _step(links, index)
        index = parent
    return length


def reach_behind(links: Sequence[Link]) -> Array:
    """Greatest distances (n,) in m from each joint to the end of what it moves."""
    longest = np.array([_length(link) for link in links])
    for i in reversed(range(len(links))):
        if (parent := links[i].parent) != GROUND:
            longest[parent] = max(longest[parent], _step(links, i) + longest[i])
    return longest


def _length(link: Link) -> float:
    return float(np.linalg.norm(link_end(link) - joint_line(link)[0]))


def _step(links: Sequence[Link], index: int) -> float:
    return float(np.linalg.norm(links[index].parent_to_joint.translation - joint_line(links[links[index].parent])[0]))
