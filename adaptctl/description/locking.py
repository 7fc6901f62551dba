"""Joints held at fixed positions: their links become part of the links before them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from adaptctl.description.description import Description
from adaptctl.description.inertia import transformed
from adaptctl.description.joint import JointKind
from adaptctl.description.link import GROUND, Link
from adaptctl.description.loops import Closure, Loops
from adaptctl.description.pose import NamedFrame, Pose, rotation_about
from adaptctl.errors import InputError, NotFoundError, suggested_name

MAX_OUTSIDE = 1e-6
"""rad or m by which a joint may be held beyond its limits"""


def locked_words(words: Iterable[str]) -> dict[str, float | None]:
    """Positions by names of joints, None where none is given, from words such as `elbow=0.5`."""
    found: dict[str, float | None] = {}
    for word in (part for given in words for part in re.split(r",(?=[^\W\d])", given)):
        name, mark, text = word.partition("=")
        if found and re.fullmatch(r"[-+]?\d*\.?\d+", word):
            raise InputError(f"lock: expected JOINT=VALUE, got {word!r}; write {list(found)[-1]}={word}")
        try:
            value = float(text) if mark else None
        except ValueError:
            point = f"; write {name}={text.replace(',', '.')}, with a point" if text.count(",") == 1 else ""
            raise InputError(f"lock: joint {name!r}: expected a position in rad or m, got {text!r}{point}") from None
        if name in found:
            raise InputError(f"lock: joint {name!r} is given twice")
        found[name] = value
    return found


def held_positions(description: Description, given: Mapping[str, float | None] | Iterable[str]) -> dict[str, float]:
    """Checked positions of primary joints to hold, in rad (m); followers hold their leaders, None is zero."""
    if isinstance(given, str):
        raise InputError(f"lock: expected joints with their positions, or a list of names, got the text {given!r}")
    given = given if isinstance(given, Mapping) else locked_words(given)
    couplings = {} if description.loops is None else {c.follower: c for c in description.loops.couplings}
    primary = [description.joint_names[i] for i in description.primary]
    found: dict[str, float] = {}
    for name, value in given.items():
        if name not in description.joint_names:
            known = ", ".join(description.joint_names)
            first, *rest = re.split(r"[\s:]+", name.strip(), maxsplit=1)
            own = first in description.joint_names and rest
            hint = f"; write {first}={rest[0]}" if own else suggested_name(name, description.joint_names)
            raise NotFoundError(f"lock: {description.name} has no joint {name!r}{hint}; joints: {known}")
        position, lead = _checked(description, name, value), name
        if name in couplings and name not in primary:
            lead, position = couplings[name].leader, (position - couplings[name].offset) / couplings[name].ratio
        if lead not in primary:
            raise InputError(f"lock: joint {name!r} depends on others by a loop; lock those: {', '.join(primary)}")
        if not math.isclose(found.setdefault(lead, position), position, rel_tol=1e-9, abs_tol=1e-9):
            raise InputError(f"lock: joint {name!r}: {lead!r}, which leads it, is locked elsewhere")
    if found.keys() >= set(primary):
        raise InputError(f"lock: all joints of {description.name} are locked; at least one must move")
    return found


def _checked(description: Description, name: str, value: float | None) -> float:
    joint = description.links[description.joint_names.index(name)].joint
    position, limits = 0.0 if value is None else float(value), joint.limits
    if not math.isfinite(position):
        raise InputError(f"lock: joint {name!r}: expected a finite position in {joint.kind.position_unit}, got {value}")
    if not limits.lower - MAX_OUTSIDE <= position <= limits.upper + MAX_OUTSIDE:
        raise InputError(
            f"lock: joint {name!r}: {position:g} {joint.kind.position_unit} is outside its limits, {limits.lower:g} to "
            f"{limits.upper:g}; give the position at which it was held, such as "
            f"{name}={_inside(limits.lower, limits.upper):g}"
        )
    return position


def _inside(lower: float, upper: float) -> float:
    ends = [end for end in (lower, upper) if math.isfinite(end)]
    return float(np.mean(ends)) if ends else 0.0


def with_locked(description: Description, locked: Mapping[str, float], configuration: Sequence[float]) -> Description:
    """Description without the locked primary joints, and those that follow them, at a configuration of all joints."""
    still = _still(description, locked)
    for link in description.links:
        drive, name = link.joint.drive, link.joint.name
        if name in still and any(other not in still for other, _ in drive.turns_with):
            raise InputError(f"lock: the motor of joint {name!r} turns with other joints too, so that it is not held")
    places: list[tuple[int, Pose]] = []
    kept: list[Link] = []
    for link, q in zip(description.links, configuration, strict=True):
        carrier, pose = (GROUND, Pose.identity()) if link.parent == GROUND else places[link.parent]
        if link.joint.name not in still:
            places.append((len(kept), Pose.identity()))
            kept.append(_moving(link, carrier, pose, still))
            continue
        pose = pose @ link.parent_to_joint @ _moved(link, q) @ link.joint_to_link
        places.append((carrier, pose))
        if carrier != GROUND and np.any(link.inertia):
            whole = kept[carrier].inertia + transformed(link.inertia, pose)
            kept[carrier] = replace(kept[carrier], inertia=whole, massless=False)
    return _reduced(description, locked, still, tuple(kept), places)


def _moving(link: Link, carrier: int, pose: Pose, still: Iterable[str]) -> Link:
    drive = link.joint.drive
    others = tuple((name, ratio) for name, ratio in drive.turns_with if name not in still)
    joint = replace(link.joint, drive=replace(drive, turns_with=others)) if others != drive.turns_with else link.joint
    return replace(link, parent=carrier, joint=joint, parent_to_joint=pose @ link.parent_to_joint)


def _moved(link: Link, q: float) -> Pose:
    axis = link.joint.axis
    if link.joint.kind is JointKind.PRISMATIC:
        return Pose(np.eye(3), q * axis)
    return Pose(rotation_about(axis, q), np.zeros(3))


def _reduced(
    description: Description,
    locked: Mapping[str, float],
    still: set[str],
    links: tuple[Link, ...],
    places: Sequence[tuple[int, Pose]],
) -> Description:
    """Description of the links that still move, with shapes and frames where they now are."""

    def place(link: int) -> tuple[int, Pose]:
        return (GROUND, Pose.identity()) if link == GROUND else places[link]

    shown = tuple(visual.on(*place(visual.link)) for visual in description.visuals)
    frames = [
        replace(frame, link=place(frame.link)[0], pose=place(frame.link)[1] @ frame.pose)
        for frame in description.frames
    ]
    taken = {frame.name for frame in frames}
    for link, (carrier, pose) in zip(description.links, places, strict=True):
        if link.joint.name in still and link.name not in taken:
            frames.append(NamedFrame(link.name, carrier, pose))
    return replace(
        description,
        links=links,
        loops=_loops(description, still, places, links),
        visuals=shown,
        frames=tuple(frames),
        locked={**description.locked, **locked},
    )


def _still(description: Description, locked: Mapping[str, float]) -> set[str]:
    """Names of all joints that are held where the locked primary joints are."""
    still, loops = set(locked), description.loops
    if loops is None:
        return still
    still |= {c.follower for c in loops.couplings if c.leader in locked}
    leaders = {c.follower: c.leader for c in loops.couplings}
    for group in _groups([_cycle(description, c) for c in loops.closures], leaders):
        free = [name for name in loops.primary if name in group and name not in locked]
        if not free and group & still:
            still |= group
        elif group & still:
            raise InputError(
                f"lock: joints {', '.join(sorted(group & still))} are in a loop with {', '.join(free)}; lock these too"
            )
    return still


def _groups(cycles: Sequence[set[str]], leaders: Mapping[str, str]) -> list[set[str]]:
    """Joints that closures tie together, with the leaders of followers among them."""
    groups: list[set[str]] = []
    for cycle in cycles:
        whole = cycle | {leaders[name] for name in cycle if name in leaders}
        whole |= {follower for follower, leader in leaders.items() if leader in whole}
        apart = [group for group in groups if not group & whole]
        groups = [*apart, whole.union(*(group for group in groups if group & whole))]
    return groups


def _cycle(description: Description, closure: Closure) -> set[str]:
    """Joints between the two links of a closure."""
    ends = [_ancestors(description, name) for name in (closure.first, closure.second)]
    return {description.joint_names[i] for i in ends[0] ^ ends[1]}


def _ancestors(description: Description, name: str | None) -> set[int]:
    found: set[int] = set()
    i = GROUND if name is None else [link.name for link in description.links].index(name)
    while i != GROUND:
        found.add(i)
        i = description.links[i].parent
    return found


def _loops(
    description: Description, still: set[str], places: Sequence[tuple[int, Pose]], links: Sequence[Link]
) -> Loops | None:
    loops = description.loops
    if loops is None:
        return None
    closures = tuple(
        _carried(c, description, places, links) for c in loops.closures if not _cycle(description, c) <= still
    )
    couplings = tuple(c for c in loops.couplings if c.follower not in still)
    if not closures and not couplings:
        return None
    conditions = [c for c in loops.conditions if not still & c.weights.keys()]
    if len(conditions) < len(loops.conditions) and any(c.weights.keys() - still for c in loops.conditions):
        raise InputError("lock: a condition of the loops is on locked and on other joints; lock all of them or none")
    primary = tuple(name for name in loops.primary if name not in still)
    reference = {name: value for name, value in loops.reference.items() if name not in still}
    return Loops(primary, closures, couplings, reference, tuple(conditions))


def _carried(
    closure: Closure, description: Description, places: Sequence[tuple[int, Pose]], links: Sequence[Link]
) -> Closure:
    names = [link.name for link in description.links]

    def end(name: str | None, frame: Pose) -> tuple[str | None, Pose]:
        if name is None:
            return None, frame
        carrier, pose = places[names.index(name)]
        return (None if carrier == GROUND else links[carrier].name), pose @ frame

    (first, first_frame), (second, second_frame) = (
        end(closure.first, closure.first_frame),
        end(closure.second, closure.second_frame),
    )
    return replace(closure, first=first, second=second, first_frame=first_frame, second_frame=second_frame)
