"""Links as data, each behind one joint, and their order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from adaptctl.arrays import Array, frozen_array, whole_count
from adaptctl.caching import sent_as_made
from adaptctl.description.drive import MAX_DRIVE_TERM
from adaptctl.description.joint import Joint
from adaptctl.description.pose import Pose
from adaptctl.errors import InputError

GROUND = -1
"""The parent index of a link whose joint is on the ground."""


MAX_INERTIAL_PARAMETER = MAX_DRIVE_TERM
"""Inertial parameter (SI units) that a link may have: energies of larger ones overflow."""
MIN_MASS = 1e-30
"""kg, of a link with mass: moments divided by smaller ones overflow"""


@sent_as_made
@dataclass(frozen=True, eq=False)
class Link:
    """
    Rigid body with the joint that connects it to its parent.

    Parameters
    ----------
    name : str
        Name of the link.
    parent : int
        Zero-based index of the parent link, or -1 for the ground.
    joint : Joint
        Joint that moves the link.
    parent_to_joint : Pose
        Pose of the joint's frame in the parent link's frame, at coordinate zero.
    joint_to_link : Pose
        Pose of the link's frame in the joint's moved frame: the identity in URDF, a Denavit-Hartenberg step for frames
        at the far end.
    inertia : array_like, optional
        Inertial parameters (10,) m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz: mass in kg, first moment in
        kg m, inertia tensor in kg m^2 about the link frame's origin; zero by default.
    massless : bool, default False
        If true, the link only joins two joints, as in a floating base, and has no inertial parameters.

    Raises
    ------
    InputError
        If the inertia has another shape, is not finite, above 1e20 in size, or not zero in a massless link, or if
        the mass is not zero and below 1e-30 kg.

    Examples
    --------
    >>> from adaptctl.description import Joint, Link, Pose
    >>> ten = [1, 0.5, 0, 0, 0, 0, 0.3, 0, 0, 0.3]
    >>> rod = Link("rod", -1, Joint("hinge"), Pose.identity(), Pose.identity(), ten)
    >>> float(rod.inertia[0])
    1.0
    """

    name: str
    parent: int
    joint: Joint
    parent_to_joint: Pose
    joint_to_link: Pose
    inertia: Array = field(default_factory=lambda: np.zeros(10))
    massless: bool = False

    def __post_init__(self) -> None:
        whole_count(self.parent, f"link {self.name!r}: parent", GROUND)
        object.__setattr__(self, "inertia", frozen_array(self.inertia, (10,), f"link {self.name!r}: inertia"))
        if np.abs(self.inertia).max() > MAX_INERTIAL_PARAMETER:
            raise InputError(f"link {self.name!r}: expected inertial parameters of at most {MAX_INERTIAL_PARAMETER:g}")
        if 0.0 < abs(self.inertia[0]) < MIN_MASS:
            raise InputError(
                f"link {self.name!r}: expected a mass of 0 or at least {MIN_MASS:g} kg, got {self.inertia[0]:g}"
            )
        if self.massless and np.any(self.inertia):
            raise InputError(
                f"link {self.name!r}: inertia: expected zero for a massless link, got {self.inertia.tolist()}"
            )


def depth_first(links: Iterable[Link]) -> tuple[Link, ...]:
    """
    Sort links depth-first, as `Description` takes them.

    Parameters
    ----------
    links : iterable of Link
        Links in any order, with the indices of their parents in that order.

    Returns
    -------
    tuple of Link
        Parents first, descendants together, siblings as given; `parent` indices are into the new order.

    Raises
    ------
    InputError
        If a link's chain of parents does not end at the ground.

    Examples
    --------
    >>> from adaptctl.description import depth_first
    >>> [link.name for link in depth_first(arm.links)]
    ['upper', 'lower']
    """
    given = tuple(links)
    order: list[int] = []
    pending = [i for i, link in enumerate(given) if link.parent == GROUND][::-1]
    while pending:
        order.append(pending.pop())
        pending += [i for i, link in enumerate(given) if link.parent == order[-1]][::-1]
    if len(order) != len(given):
        missing = sorted(set(range(len(given))) - set(order))
        raise InputError(
            f"link {given[missing[0]].name!r} is not connected to the ground: its parents are unknown or form a cycle"
        )
    place = {GROUND: GROUND} | {old: new for new, old in enumerate(order)}
    return tuple(replace(given[i], parent=place[given[i].parent]) for i in order)


def weightless_ends(links: Sequence[Link]) -> tuple[str, ...]:
    """Names of end links without inertia and rotor, whose joints' accelerations are not determined."""
    heavy: set[int] = set()
    for i, link in reversed(list(enumerate(links))):
        if i in heavy or np.any(link.inertia) or link.joint.drive.rotor_inertia:
            heavy |= {i, link.parent}
    return tuple(link.name for i, link in enumerate(links) if i not in heavy)


def plain(link: Link) -> list[object]:
    """Content that a link's hash is taken of: names, limits and numbers."""
    joint, limits = link.joint, link.joint.limits
    arrays = (
        joint.axis,
        link.parent_to_joint.rotation,
        link.parent_to_joint.translation,
        link.joint_to_link.rotation,
        link.joint_to_link.translation,
    )
    bounds = [limits.lower, limits.upper, limits.velocity, limits.effort]
    moving = [[float(x) + 0.0 for x in np.ravel(array)] for array in (*arrays, link.inertia)]
    return [link.name, link.parent, joint.name, joint.kind.value, [repr(float(b)) for b in bounds], moving]


def geometry(link: Link) -> list[object]:
    """Content that the hash of a link's geometry is taken of: frames and the kind of its joint."""
    poses = (
        link.parent_to_joint.rotation,
        link.parent_to_joint.translation,
        link.joint_to_link.rotation,
        link.joint_to_link.translation,
    )
    frames = [rounded(array) for array in (link.joint.axis, *poses)]
    return [link.name, link.parent, link.joint.kind.is_revolute, frames]


def rounded(array: Array) -> list[float]:
    """Numbers to twelve places, with one zero."""
    return [round(x, 12) + 0.0 for x in np.ravel(array).tolist()]
