"""A base that nothing holds: a quadruped's trunk, a humanoid's pelvis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.description.description import GROUND, Description, Joint, JointKind, Link
from adaptctl.description.pose import Pose
from adaptctl.description.visual import Visual

JOINTS = (
    ("x", JointKind.PRISMATIC, (1.0, 0.0, 0.0)),
    ("y", JointKind.PRISMATIC, (0.0, 1.0, 0.0)),
    ("z", JointKind.PRISMATIC, (0.0, 0.0, 1.0)),
    ("yaw", JointKind.CONTINUOUS, (0.0, 0.0, 1.0)),
    ("pitch", JointKind.CONTINUOUS, (0.0, 1.0, 0.0)),
    ("roll", JointKind.CONTINUOUS, (1.0, 0.0, 0.0)),
)
"""The six that carry what floats: suffixes of names, kinds and axes, from the ground up."""


def with_floating_base(description: Description, name: str, inertia: ArrayLike) -> Description:
    """The description of a mechanism that stands on a floating body, called `name`, instead of on the ground.

    `inertia` (10,) holds the body's m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (mass in kg, first moment
    in kg m, inertia tensor in kg m^2), about the origin and along the axes of its frame, which replaces the ground's
    for all that was fixed to the ground. Six joints lead to it: from the ground, the slides ``name_x``, ``name_y`` and
    ``name_z`` (m) and the hinges ``name_yaw``, ``name_pitch`` and ``name_roll`` (rad), the first six of the primary
    (independent) joints. Raises `InputError` for an inertia of another shape, not finite or above 1e20 in size, and for
    a name that is empty or, itself or with one of these endings, taken.
    """
    links, loops = floating(description.links, name, inertia), description.loops
    if loops is not None:
        closures = tuple(replace(c, first=c.first or name, second=c.second or name) for c in loops.closures)
        primary = (*(link.joint.name for link in links[: len(JOINTS)]), *loops.primary)
        loops = replace(loops, primary=primary, closures=closures)
    frames = tuple(replace(frame, link=frame.link + len(JOINTS)) for frame in description.frames)
    return replace(description, links=links, loops=loops, visuals=above_base(description.visuals), frames=frames)


def floating(links: Sequence[Link], name: str, inertia: ArrayLike) -> tuple[Link, ...]:
    """The links of a mechanism on a floating base: six links for a body that floats, then the given `links`, of which
    those that stood on the ground stand on that body.

    `inertia` (10,) holds the body's m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2), about
    its frame's origin; `name` is the body's. Six joints lead from the ground to the body, three slides, ``name_x``,
    ``name_y`` and ``name_z`` (m), and three hinges, ``name_yaw``, ``name_pitch`` and ``name_roll`` (rad), so that
    positions stay plain vectors; the five links between them are massless and own no parameters. At a pitch of 90
    degrees yaw and roll turn about the same axis, as with any three angles. Raises `InputError` for an inertia of
    another shape, not finite or above 1e20 in size.
    """
    base = tuple(_base_link(i, name, inertia) for i in range(len(JOINTS)))
    above = len(base)
    carried = (replace(link, parent=above - 1 if link.parent == GROUND else link.parent + above) for link in links)
    return (*base, *carried)


def above_base(visuals: Sequence[Visual]) -> tuple[Visual, ...]:
    """The shapes to draw of a mechanism, `visuals`, renumbered for six links of a floating base that come before its
    own: each link index is 6 higher, so that shapes on the ground, -1, are on the floating body, 5. Nothing is
    checked."""
    return tuple(replace(visual, link=visual.link + len(JOINTS)) for visual in visuals)


def _base_link(i: int, name: str, inertia: ArrayLike) -> Link:
    suffix, kind, axis = JOINTS[i]
    joint, identity = Joint(f"{name}_{suffix}", kind, np.array(axis)), Pose.identity()
    if i < len(JOINTS) - 1:
        return Link(f"{name}_{suffix}", i - 1, joint, identity, identity, massless=True)
    return Link(name, i - 1, joint, identity, identity, np.asarray(inertia))
