"""Several mechanisms as one: arms that hold an object, cells with more than one robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from adaptctl.description.description import GROUND, Description, Joint, Link
from adaptctl.description.loops import Loops
from adaptctl.description.named_frame import NamedFrame
from adaptctl.description.pose import Pose
from adaptctl.description.visual import Visual
from adaptctl.errors import InputError


def joined(name: str, parts: Mapping[str, tuple[Description, Pose]], loops: Loops | None = None) -> Description:
    """The description, called `name`, of one mechanism that consists of several trees: `parts` has, by label, each
    part's description and the pose of its ground frame in the common ground frame.

    Links, joints and named frames get their part's label in front, as in ``left.link3``, and `loops`, by default none,
    uses these names: so two hands are welded to one object (Sheu and Walker 1991, "multirobot systems"). The parts keep
    their order, their parameters and their shapes to draw. All parts must have the same gravity vector, which becomes
    that of the common ground frame: the poses do not turn it. Raises `InputError` for no parts, parts of different
    gravity, and parts with loops of their own, `NotFoundError` for unknown names in `loops`.
    """
    if not parts:
        raise InputError(f"{name}: at least one part is needed")
    gravities = {tuple(part.gravity.tolist()) for part, _ in parts.values()}
    if len(gravities) > 1:
        raise InputError(f"{name}: the parts must agree on gravity, got {sorted(gravities)}")
    links: list[Link] = []
    visuals: list[Visual] = []
    frames: list[NamedFrame] = []
    for label, (part, stand) in parts.items():
        if part.loops is not None:
            raise InputError(f"{name}: part {label!r} has loops of its own: join its tree and give all loops together")
        visuals += [_moved(visual, stand, len(links)) for visual in part.visuals]
        frames += [_renamed_frame(frame, label, stand, len(links)) for frame in part.frames]
        links += [_renamed(link, label, stand, len(links)) for link in part.links]
    gravity, source = next(iter(parts.values()))[0].gravity, f"joined from {', '.join(parts)}"
    return Description(name, tuple(links), gravity, source, loops, tuple(visuals), tuple(frames))


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
