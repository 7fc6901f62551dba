"""Semi-direct-drive arms of any lengths, on either assembly branch of the five-bar linkage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import Description, Pose, read
from adaptctl.dynamics import Mechanism

NARROW, WIDE = 0.5236, 2.618
"""Table 9 of Sheu and Walker (1991): the condition on p2 - p3."""


def spread(a: float, b: float, angle: float) -> float:
    """The distance between the ends of links 2 and 3."""
    return float(np.sqrt(a * a + b * b - 2.0 * a * b * np.cos(angle)))


def closes_everywhere(lengths: Array, margin: float = 0.1) -> bool:
    """Whether links 4 and 5 span the ends of links 2 and 3 over all of Table 9, with a share to spare."""
    l2, l3, l4, l5 = lengths
    reaches = l4 + l5 > (1.0 + margin) * spread(l2, l3, WIDE)
    return bool(reaches and abs(l4 - l5) < (1.0 - margin) * spread(l2, l3, NARROW))


def assembly(lengths: Array, near: bool) -> dict[str, float]:
    """Angles of joints 4 and 5 with link 2 upright and link 3 backward; the rod's end on the arm's own side of the
    line between them when `near`, where a parallelogram becomes an antiparallelogram."""
    l2, l3, l4, l5 = lengths
    elbow, crank = np.array([0.0, -l2]), np.array([-l3, 0.0])
    way = elbow - crank
    apart = float(np.linalg.norm(way))
    along = (l4**2 - l5**2 + apart**2) / (2.0 * apart)
    across = np.sqrt(l4**2 - along**2) * (1.0 if near else -1.0)
    tip = crank + (along * way + across * np.array([-way[1], way[0]])) / apart
    rod, forearm = tip - crank, elbow - tip
    first, second = (float(np.arctan2(u[1], u[0])) for u in (rod, forearm))
    return {"joint4": first + np.pi, "joint5": second - first}


def five_bar(lengths: Array, near: bool = False) -> Mechanism:
    """The built-in arm with other lengths (m) of links 2 to 5."""
    l2, l3, l4, l5 = lengths
    arm = read("semi_direct_drive")
    assert arm.loops is not None
    nears = [link.parent_to_joint for link in arm.links[:3]] + [_ahead(l3), _ahead(l4)]
    links = tuple(replace(link, parent_to_joint=pose) for link, pose in zip(arm.links, nears, strict=True))
    closure = replace(arm.loops.closures[0], first_frame=_ahead(l2), second_frame=_ahead(l5))
    reference = {**arm.loops.reference, **assembly(lengths, near)}
    loops = replace(arm.loops, closures=(closure,), reference=reference)
    return Mechanism(Description("five-bar", links, arm.gravity, loops=loops))


def _ahead(length: float) -> Pose:
    return Pose(np.eye(3), np.array([length, 0.0, 0.0]))
