"""Geometry that nearly, but not exactly, stands at right angles, meets, or is equal: where it matters, ranks differ."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise

from adaptctl.description import GROUND, Description
from adaptctl.identifiability.proof.joint_frames import CanonicalFrames
from adaptctl.identifiability.proof.simplest import AS_GIVEN, AS_MEANT
from adaptctl.identifiability.right_angles import near_right_angles


def near_coincidences(description: Description, frames: CanonicalFrames) -> tuple[str, ...]:
    """Near coincidences of a mechanism's geometry, a text for each; if they are meant to be exact, the rank may be
    another. Empty where there are none.

    They are angles between successive joint axes within 1e-3 rad of a multiple of 90 degrees, offsets between these
    axes below 1e-4 of the characteristic length, and, with closed loops, lengths that differ by less than that; those
    within 1e-11 (rad, or of that length) count as exact and are none. `description` is the mechanism's, `frames` the
    joints' poses from axis to axis. Nothing is checked.
    """
    angles = [str(angle) for angle in near_right_angles(description, AS_GIVEN.angle)]
    return (*angles, *_near_offsets(description, frames), *_near_equals(description, frames))


def _near_offsets(description: Description, frames: CanonicalFrames) -> Iterator[str]:
    for link, joint in zip(description.links, frames.joints, strict=True):
        before = "the world" if link.parent == GROUND else description.links[link.parent].joint.name
        for what, offset in (("from", joint.joint.radius), ("along", joint.joint.height)):
            if link.parent != GROUND and _nearly(offset, frames.length):
                yield f"{link.joint.name} stands {abs(offset):.1e} m {what} the axis of {before}, nearly nothing"


def _near_equals(description: Description, frames: CanonicalFrames) -> Iterator[str]:
    for (one, name), (other, another) in pairwise(loop_lengths(description, frames)):
        if one > AS_MEANT.length * frames.length and _nearly(other - one, frames.length):
            yield f"the lengths {one:.10g} m at {name} and {other:.10g} m at {another} are nearly equal"


def loop_lengths(description: Description, frames: CanonicalFrames) -> list[tuple[float, str]]:
    """Lengths that may have to equal one another in closed loops, as pairs (length in m, name of the joint or loop
    closure that it belongs to), in ascending order of length.

    They are the distances from the z axis (radius) and along it (height), in size, of each joint's frame in that of the
    joint before, as `frames` have them, and of each closure's two frames in those of their links' joints. Empty for a
    `description` without loop closures. Nothing is checked.
    """
    loops = description.loops
    if loops is None or not loops.closures:
        return []
    placed = [(link.joint.name, joint.joint) for link, joint in zip(description.links, frames.joints, strict=True)]
    index: dict[str | None, int] = {None: GROUND} | {link.name: i for i, link in enumerate(description.links)}
    for closure in loops.closures:
        placed.append((closure.name, frames.placement(index[closure.first], closure.first_frame)))
        placed.append((closure.name, frames.placement(index[closure.second], closure.second_frame)))
    return sorted((abs(x), name) for name, placement in placed for x in (placement.radius, placement.height))


def as_equal(lengths: Iterable[float], least: float) -> tuple[float, ...]:
    """The lengths (m), in ascending order, that represent groups of nearly equal ones among `lengths` (m), which must
    rise: the first of each group, which the others exceed by at most `least` (m). Nothing is checked."""
    firsts: list[float] = []
    for length in lengths:
        if not firsts or length - firsts[-1] > least:
            firsts.append(length)
    return tuple(firsts)


def _nearly(x: float, length: float) -> bool:
    return AS_GIVEN.length * length < abs(x) <= AS_MEANT.length * length
