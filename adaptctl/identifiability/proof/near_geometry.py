"""Geometry that nearly, but not exactly, stands at right angles, meets, or is equal: where it matters, ranks differ."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from adaptctl.description import GROUND, Description
from adaptctl.identifiability.proof.joint_frames import CanonicalFrames
from adaptctl.identifiability.proof.simplest import AS_GIVEN, AS_MEANT
from adaptctl.identifiability.right_angles import near_right_angles


def near_coincidences(description: Description, frames: CanonicalFrames) -> tuple[str, ...]:
    """What nearly coincides, in words: angles within 1e-3 rad of right ones, offsets within 1e-4 of the mechanism's
    length of zero, and in closed loops also lengths that are so nearly equal."""
    angles = [str(angle) for angle in near_right_angles(description, AS_GIVEN.angle)]
    return (*angles, *_near_offsets(description, frames), *_near_equals(description, frames))


def _near_offsets(description: Description, frames: CanonicalFrames) -> Iterator[str]:
    for link, joint in zip(description.links, frames.joints, strict=True):
        before = "the world" if link.parent == GROUND else description.links[link.parent].joint.name
        for what, offset in (("from", joint.joint.radius), ("along", joint.joint.height)):
            if link.parent != GROUND and _nearly(offset, frames.length):
                yield f"{link.joint.name} stands {abs(offset):.1e} m {what} the axis of {before}, which is nearly nothing"


def _near_equals(description: Description, frames: CanonicalFrames) -> Iterator[str]:
    loops = description.loops
    if loops is None or not loops.closures:
        return
    index = {link.name: i for i, link in enumerate(description.links)} | {None: GROUND}
    lengths = [(link.joint.name, joint.joint) for link, joint in zip(description.links, frames.joints, strict=True)]
    for closure in loops.closures:
        for link, pose in ((closure.first, closure.first_frame), (closure.second, closure.second_frame)):
            lengths.append((closure.name, frames.placement(index[link], pose)))
    ordered = sorted((abs(x), name) for name, placement in lengths for x in (placement.radius, placement.height))
    for (one, name), (other, another) in pairwise(ordered):
        if one > AS_MEANT.length * frames.length and _nearly(other - one, frames.length):
            yield f"the lengths {one:.10g} m at {name} and {other:.10g} m at {another} are nearly equal"


def _nearly(x: float, length: float) -> bool:
    return AS_GIVEN.length * length < abs(x) <= AS_MEANT.length * length
