"""Mechanisms made of mechanisms: joined, floating, with frames at their joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.description.description import Description
from adaptctl.description.inertia import PARAMETERS, transformed
from adaptctl.description.joint import Joint, JointKind
from adaptctl.description.link import GROUND, Link
from adaptctl.description.loops import Loops
from adaptctl.description.pose import NamedFrame, Pose
from adaptctl.description.visual import Visual
from adaptctl.errors import InputError

if TYPE_CHECKING:
    from adaptctl.description.loops import Closure, Loops


def joined(
    name: str,
    parts: Mapping[str, tuple[Description, Pose]],
    loops: Loops | None = None,
    gravity: ArrayLike | None = None,
) -> Description:
    """Description, called `name`, of one mechanism that consists of several trees."""
    if not parts:
        raise InputError(f"{name}: parts: expected at least one")
    common = _gravity(name, parts) if gravity is None else frozen_array(gravity, (3,), f"{name}: gravity")
    links: list[Link] = []
    visuals: list[Visual] = []
    frames: list[NamedFrame] = []
    for label, (part, mount) in parts.items():
        if part.loops is not None:
            raise InputError(f"{name}: part {label!r} has loops; join its tree, and give all loops in `loops`")
        visuals += [_moved(visual, mount, len(links)) for visual in part.visuals]
        frames += [_renamed_frame(frame, label, mount, len(links)) for frame in part.frames]
        links += [_renamed(link, label, mount, len(links)) for link in part.links]
    source = f"joined from {', '.join(parts)}"
    return Description(name, tuple(links), common, source, loops, tuple(visuals), tuple(frames))


def _gravity(name: str, parts: Mapping[str, tuple[Description, Pose]]) -> Array:
    first, (leading, _) = next(iter(parts.items()))
    common, asked = leading.gravity, "give `gravity` in the common ground frame, such as (0, 0, -9.81)"
    for label, (part, mount) in parts.items():
        own, turned = part.gravity, mount.rotation @ part.gravity
        said = f"{name}: part {label!r} has the gravity {own.tolist()} in its own ground frame"
        if not _alike(own, common):
            raise InputError(f"{said}, part {first!r} {common.tolist()}: {asked}")
        if not _alike(own, turned):
            raise InputError(f"{said}, {turned.tolist()} in the common ground frame: {asked}")
    return common


def _alike(one: Array, other: Array) -> bool:
    return bool(np.abs(one - other).max() <= 1e-9 * np.abs(one).max())


def _renamed(link: Link, label: str, mount: Pose, above: int) -> Link:
    on_ground = link.parent == GROUND
    return replace(
        link,
        name=f"{label}.{link.name}",
        parent=GROUND if on_ground else link.parent + above,
        joint=_renamed_joint(link.joint, label),
        parent_to_joint=mount @ link.parent_to_joint if on_ground else link.parent_to_joint,
    )


def _renamed_joint(joint: Joint, label: str) -> Joint:
    others = tuple((f"{label}.{name}", ratio) for name, ratio in joint.drive.turns_with)
    return replace(joint, name=f"{label}.{joint.name}", drive=replace(joint.drive, turns_with=others))


def _renamed_frame(frame: NamedFrame, label: str, mount: Pose, above: int) -> NamedFrame:
    on_ground = frame.link == GROUND
    link, pose = (GROUND, mount @ frame.pose) if on_ground else (frame.link + above, frame.pose)
    return replace(frame, name=f"{label}.{frame.name}", link=link, pose=pose)


def _moved(visual: Visual, mount: Pose, above: int) -> Visual:
    on_ground = visual.link == GROUND
    return visual.on(GROUND, mount) if on_ground else replace(visual, link=visual.link + above)


FLOATING_JOINTS = (
    ("x", JointKind.PRISMATIC, (1.0, 0.0, 0.0)),
    ("y", JointKind.PRISMATIC, (0.0, 1.0, 0.0)),
    ("z", JointKind.PRISMATIC, (0.0, 0.0, 1.0)),
    ("yaw", JointKind.CONTINUOUS, (0.0, 0.0, 1.0)),
    ("pitch", JointKind.CONTINUOUS, (0.0, 1.0, 0.0)),
    ("roll", JointKind.CONTINUOUS, (1.0, 0.0, 0.0)),
)
"""The six that carry what floats: suffixes of names, kinds and axes, from the ground up."""


def with_floating_base(description: Description, name: str, inertia: ArrayLike) -> Description:
    """
    Put a mechanism on a floating body instead of the ground.

    Parameters
    ----------
    description : Description
        Mechanism on the ground.
    name : str
        Name of the floating body.
    inertia : array_like
        Inertial parameters (10,) of the body, as in `Link`, in its frame, which replaces the ground's.

    Returns
    -------
    Description
        The mechanism with six more primary joints at the front: slides ``name_x``, ``name_y``, ``name_z`` in m and
        hinges ``name_yaw``, ``name_pitch``, ``name_roll`` in rad.

    Raises
    ------
    InputError
        If the inertia has another shape, is not finite or above 1e20 in size, or a name is empty or taken.

    Examples
    --------
    >>> from adaptctl.description import with_floating_base
    >>> body = [10.0, 0, 0, 0, 1, 0, 1, 0, 0, 1]
    >>> adaptctl.Mechanism(with_floating_base(arm.description, "base", body)).dof
    8
    """
    links, loops = floating(description.links, name, inertia), description.loops
    if loops is not None:
        closures = tuple(replace(c, first=c.first or name, second=c.second or name) for c in loops.closures)
        primary = (*(link.joint.name for link in links[: len(FLOATING_JOINTS)]), *loops.primary)
        loops = replace(loops, primary=primary, closures=closures)
    frames = frames_above_base(description.frames)
    return replace(description, links=links, loops=loops, visuals=above_base(description.visuals), frames=frames)


def floating(links: Sequence[Link], name: str, inertia: ArrayLike) -> tuple[Link, ...]:
    """Links of a mechanism on a floating base."""
    base = tuple(_base_link(i, name, inertia) for i in range(len(FLOATING_JOINTS)))
    above = len(base)
    carried = (replace(link, parent=above - 1 if link.parent == GROUND else link.parent + above) for link in links)
    return (*base, *carried)


def above_base(visuals: Sequence[Visual]) -> tuple[Visual, ...]:
    """Shapes renumbered for the six links of a floating base."""
    return tuple(replace(visual, link=visual.link + len(FLOATING_JOINTS)) for visual in visuals)


def frames_above_base(frames: Sequence[NamedFrame]) -> tuple[NamedFrame, ...]:
    """Named frames renumbered for the six links of a floating base."""
    return tuple(replace(frame, link=frame.link + len(FLOATING_JOINTS)) for frame in frames)


def _base_link(i: int, name: str, inertia: ArrayLike) -> Link:
    suffix, kind, axis = FLOATING_JOINTS[i]
    joint, identity = Joint(f"{name}_{suffix}", kind, np.array(axis)), Pose.identity()
    if i < len(FLOATING_JOINTS) - 1:
        return Link(f"{name}_{suffix}", i - 1, joint, identity, identity, massless=True)
    return Link(name, i - 1, joint, identity, identity, np.asarray(inertia))


def with_joint_frames(description: Description) -> Description:
    """Copy with link frames at the joints, where equations take fewest operations."""
    far = {link.name: link.joint_to_link for link in description.links}
    links = tuple(_link(link, description) for link in description.links)
    loops = None if description.loops is None else _loops(description.loops, far)
    return replace(description, links=links, loops=loops, visuals=(), frames=())


def joint_frame_parameters(description: Description) -> Array:
    """Matrix (P, P) to inertial parameters with link frames at the joints."""
    matrix, size = np.eye(len(description.parameter_names)), len(PARAMETERS)
    for k, i in enumerate(description.bodies):
        moved = [transformed(one, description.links[i].joint_to_link) for one in np.eye(size)]
        matrix[size * k : size * (k + 1), size * k : size * (k + 1)] = np.transpose(moved)
    return matrix


def _link(link: Link, description: Description) -> Link:
    near = (
        link.parent_to_joint
        if link.parent == GROUND
        else description.links[link.parent].joint_to_link @ link.parent_to_joint
    )
    return replace(
        link, parent_to_joint=near, joint_to_link=Pose.identity(), inertia=transformed(link.inertia, link.joint_to_link)
    )


def _loops(loops: Loops, far: dict[str, Pose]) -> Loops:
    def moved() -> Iterator[Closure]:
        for closure in loops.closures:
            first = far.get(closure.first or "", Pose.identity()) @ closure.first_frame
            second = far.get(closure.second or "", Pose.identity()) @ closure.second_frame
            yield replace(closure, first_frame=first, second_frame=second)

    return replace(loops, closures=tuple(moved()))
