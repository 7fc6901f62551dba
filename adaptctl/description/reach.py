"""Lengths along a mechanism's links: where a link's joint is, where the link ends, how far a chain reaches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import GROUND, Link

AT_JOINT = 1e-6
"""m from its joint within which a link's frame is at the joint, and does not say where the link ends"""


def joint_line(link: Link) -> tuple[Array, Array]:
    """A point (3,) on the axis of a link's joint, m, and the axis' direction (3,), both in the link's frame."""
    return link.far.inverse.translation, link.far.rotation.T @ link.joint.axis


def link_end(link: Link) -> Array:
    """The end of a link (3,), m, in its frame: the frame's origin, or the centre of mass if that is at the joint."""
    start, _ = joint_line(link)
    if np.linalg.norm(start) > AT_JOINT or link.inertia[0] <= 0.0:
        return np.zeros(3)
    return link.inertia[1:4] / link.inertia[0]


def chain_reach(links: Sequence[Link], index: int) -> float:
    """Length (m) of the chain from its first joint to the end of a link, joint by joint."""
    length = _length(links[index])
    while (parent := links[index].parent) != GROUND:
        length += _step(links, index)
        index = parent
    return length


def reach_behind(links: Sequence[Link]) -> Array:
    """From every link's joint to the farthest end behind it, joint by joint (N,), m."""
    longest = np.array([_length(link) for link in links])
    for i in reversed(range(len(links))):
        if (parent := links[i].parent) != GROUND:
            longest[parent] = max(longest[parent], _step(links, i) + longest[i])
    return longest


def _length(link: Link) -> float:
    return float(np.linalg.norm(link_end(link) - joint_line(link)[0]))


def _step(links: Sequence[Link], index: int) -> float:
    """From the parent's joint to a link's own."""
    return float(np.linalg.norm(links[index].near.translation - joint_line(links[links[index].parent])[0]))
