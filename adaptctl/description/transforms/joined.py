"""Several mechanisms as one: arms that hold an object, cells with more than one robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.description.description import GROUND, Description, Joint, Link
from adaptctl.description.loops import Loops
from adaptctl.description.named_frame import NamedFrame
from adaptctl.description.pose import Pose
from adaptctl.description.visual import Visual
from adaptctl.errors import InputError


def joined(
    name: str,
    parts: Mapping[str, tuple[Description, Pose]],
    loops: Loops | None = None,
    gravity: ArrayLike | None = None,
) -> Description:
    """The description, called `name`, of one mechanism that consists of several trees: `parts` has, by label, each
    part's description and the pose of its ground frame in the common ground frame.

    Links, joints and named frames get their part's label in front, as in ``left.link3``, and `loops`, by default none,
    uses these names: so two hands are welded to one object (Sheu and Walker 1991, "multirobot systems"). The parts keep
    their order, their parameters and their shapes to draw. `gravity` (3,), m/s^2, is the gravity vector in the common
    ground frame, in place of those of the parts; None, the default, takes that of the parts, which must then be the
    same vector in all, turned by no part's pose. Raises `InputError` for no parts, parts with loops of their own, a
    `gravity` that is not (3,), not finite or above 1e9 in size, and, where it is None, parts of different gravity and
    poses that turn it; `NotFoundError` for unknown names in `loops`.
    """
    if not parts:
        raise InputError(f"{name}: at least one part is needed")
    common = _gravity(name, parts) if gravity is None else frozen_array(gravity, (3,), f"{name}: gravity")
    links: list[Link] = []
    visuals: list[Visual] = []
    frames: list[NamedFrame] = []
    for label, (part, stand) in parts.items():
        if part.loops is not None:
            raise InputError(f"{name}: part {label!r} has loops of its own: join its tree and give all loops together")
        visuals += [_moved(visual, stand, len(links)) for visual in part.visuals]
        frames += [_renamed_frame(frame, label, stand, len(links)) for frame in part.frames]
        links += [_renamed(link, label, stand, len(links)) for link in part.links]
    source = f"joined from {', '.join(parts)}"
    return Description(name, tuple(links), common, source, loops, tuple(visuals), tuple(frames))


def _gravity(name: str, parts: Mapping[str, tuple[Description, Pose]]) -> Array:
    """The one vector that all parts have, turned by their poses or not. Raises `InputError` where there is none."""
    first, (leading, _) = next(iter(parts.items()))
    common, asked = leading.gravity, "give `gravity` in the common one, such as (0, 0, -9.81)"
    for label, (part, stand) in parts.items():
        own, turned = part.gravity, stand.rotation @ part.gravity
        said = f"{name}: part {label!r} has the gravity {own.tolist()} in its own ground frame"
        if not _alike(own, common):
            raise InputError(f"{said}, part {first!r} {common.tolist()}: {asked}")
        if not _alike(own, turned):
            raise InputError(f"{said}, {turned.tolist()} in the common one by its pose: {asked}")
    return common


def _alike(one: Array, other: Array) -> bool:
    return bool(np.abs(one - other).max() <= 1e-9 * np.abs(one).max())


def _renamed(link: Link, label: str, stand: Pose, above: int) -> Link:
    on_ground = link.parent == GROUND
    return replace(
        link,
        name=f"{label}.{link.name}",
        parent=GROUND if on_ground else link.parent + above,
        joint=_renamed_joint(link.joint, label),
        near=stand @ link.near if on_ground else link.near,
    )


def _renamed_joint(joint: Joint, label: str) -> Joint:
    others = tuple((f"{label}.{name}", ratio) for name, ratio in joint.drive.turns_with)
    return replace(joint, name=f"{label}.{joint.name}", drive=replace(joint.drive, turns_with=others))


def _renamed_frame(frame: NamedFrame, label: str, stand: Pose, above: int) -> NamedFrame:
    on_ground = frame.link == GROUND
    link, pose = (GROUND, stand @ frame.pose) if on_ground else (frame.link + above, frame.pose)
    return replace(frame, name=f"{label}.{frame.name}", link=link, pose=pose)


def _moved(visual: Visual, stand: Pose, above: int) -> Visual:
    on_ground = visual.link == GROUND
    return visual.on(GROUND, stand) if on_ground else replace(visual, link=visual.link + above)
