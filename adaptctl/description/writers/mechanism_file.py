"""Writer of mechanisms as TOML, read back to the same numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.drive import DriveParameter, Limits
from adaptctl.description.inertia import inertia_tensor
from adaptctl.description.joint import JointKind
from adaptctl.description.link import GROUND, Link
from adaptctl.description.loops import Closure, Loops
from adaptctl.description.pose import FrameKind, Pose
from adaptctl.errors import InputError
from adaptctl.files import toml_string, write_text


def write_mechanism(path: str | Path, description: Description) -> None:
    """Write a description as a TOML file that `load` reads."""
    write_text(path, mechanism_toml(description))


def mechanism_toml(description: Description) -> str:
    """Text of a description's TOML file, schema ``adaptctl/mechanism/1``, numbers with all digits."""
    _validate_sayable(description)
    parts = [
        'schema = "adaptctl/mechanism/1"',
        f"name = {toml_string(description.name)}",
        f"source = {toml_string(description.source)}",
        f"gravity = {_numbers(description.gravity)}",
        *_of_loops(description.loops),
        *(line for link in description.links for line in _link(link, description.links)),
        *_tables(description.loops),
        *_named_frames(description),
    ]
    return "\n".join(parts) + "\n"


def _validate_sayable(description: Description) -> None:
    for joint in (link.joint for link in description.links):
        bounds = (joint.limits.lower, joint.limits.upper)
        if joint.kind is JointKind.CONTINUOUS and bounds != (-math.inf, math.inf):
            raise InputError(
                f"{description.name}: joint {joint.name!r} is continuous, but has position limits from "
                f"{bounds[0]} to {bounds[1]}; remove them, or make the joint revolute"
            )


def _link(link: Link, links: Sequence[Link]) -> Iterator[str]:
    joint = link.joint
    yield "\n[[links]]"
    yield f"name = {toml_string(link.name)}"
    yield f"joint = {toml_string(joint.name)}"
    yield f"type = {toml_string(joint.kind.value)}"
    if link.parent != GROUND:
        yield f"parent = {toml_string(links[link.parent].name)}"
    yield f"axis = {_numbers(joint.axis)}"
    yield from _frame(link.parent_to_joint)
    if link.joint_to_link != Pose.identity():
        yield f"far = {{ {', '.join(_frame(link.joint_to_link))} }}"
    yield from _limits(joint.limits)
    yield from _inertia(link)
    yield from _drive(link)


def _limits(limits: Limits) -> Iterator[str]:
    names = ["lower", "upper", "velocity", "effort"]
    if math.isfinite(limits.lower) and math.isfinite(limits.upper):
        yield f"range = {_numbers(np.array([limits.lower, limits.upper]))}"
        del names[:2]
    finite = (name for name in names if math.isfinite(getattr(limits, name)))
    yield from (f"{name} = {_number(getattr(limits, name))}" for name in finite)


def _frame(pose: Pose) -> Iterator[str]:
    if np.any(pose.translation):
        yield f"position = {_numbers(pose.translation)}"
    if not np.array_equal(pose.rotation, np.eye(3)):
        yield f"rpy = {_numbers(_rpy(pose.rotation))}"


def _rpy(rotation: Array) -> Array:
    """Fixed-axis roll, pitch and yaw; at a pitch of a right angle, yaw is zero."""
    R = rotation
    across = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], across)
    if across < 1e-12:
        return np.array([math.copysign(1.0, -R[2, 0]) * math.atan2(R[0, 1], R[1, 1]), pitch, 0.0])
    return np.array([math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])])


def _inertia(link: Link) -> Iterator[str]:
    if link.massless:
        yield "massless = true"
        return
    if np.any(link.inertia):
        tensor = inertia_tensor(link.inertia)
        places = (("xx", 0, 0), ("xy", 0, 1), ("yy", 1, 1), ("xz", 0, 2), ("yz", 1, 2), ("zz", 2, 2))
        yield f"mass = {_number(link.inertia[0])}"
        yield f"first_moment = {_numbers(link.inertia[1:4])}"
        yield f"inertia = {{ {', '.join(f'{name} = {_number(tensor[i, j])}' for name, i, j in places)} }}"


def _drive(link: Link) -> Iterator[str]:
    drive = link.joint.drive
    terms = [f"{k.value} = {_number(x)}" for k in DriveParameter if (x := drive.value(k)) is not None]
    if drive.turns_with:
        others = ", ".join(f"{toml_string(name)} = {_number(ratio)}" for name, ratio in drive.turns_with)
        terms.append(f"turns_with = {{ {others} }}")
    if terms:
        yield f"drive = {{ {', '.join(terms)} }}"


def _of_loops(loops: Loops | None) -> Iterator[str]:
    if loops is not None:
        yield f"primary = [{', '.join(map(toml_string, loops.primary))}]"
        if loops.reference:
            yield f"reference = {_table(loops.reference)}"


def _tables(loops: Loops | None) -> Iterator[str]:
    if loops is None:
        return
    for closure in loops.closures:
        yield from _closure(closure)
    for coupling in loops.couplings:
        yield "\n[[couplings]]"
        yield f"name = {toml_string(coupling.name)}"
        yield f"follower = {toml_string(coupling.follower)}\nleader = {toml_string(coupling.leader)}"
        yield f"ratio = {_number(coupling.ratio)}\noffset = {_number(coupling.offset)}"
    for condition in loops.conditions:
        yield f"\n[[conditions]]\nname = {toml_string(condition.name)}\nweights = {_table(condition.weights)}"
        bounds = (("lower", condition.lower), ("upper", condition.upper))
        yield from (f"{name} = {_number(bound)}" for name, bound in bounds if math.isfinite(bound))


def _closure(closure: Closure) -> Iterator[str]:
    yield f"\n[[closures]]\nname = {toml_string(closure.name)}\nkind = {toml_string(closure.kind.value)}"
    ends = (("first", closure.first, closure.first_frame), ("second", closure.second, closure.second_frame))
    for end, link, frame in ends:
        named = [] if link is None else [f"link = {toml_string(link)}"]
        yield f"{end} = {{ {', '.join([*named, *_frame(frame)])} }}"


def _named_frames(description: Description) -> Iterator[str]:
    for frame in description.frames:
        yield f"\n[[frames]]\nname = {toml_string(frame.name)}"
        if frame.link != GROUND:
            yield f"link = {toml_string(description.links[frame.link].name)}"
        yield from _frame(frame.pose)
        if frame.kind is not FrameKind.OPERATIONAL:
            yield f"kind = {toml_string(frame.kind.value)}"


def _table(values: object) -> str:
    items = dict(values).items()  # type: ignore[call-overload]  # a mapping by its place in the file
    return f"{{ {', '.join(f'{toml_string(name)} = {_number(x)}' for name, x in items)} }}"


def _number(x: float) -> str:
    return repr(float(x) + 0.0)


def _numbers(values: Array) -> str:
    return f"[{', '.join(_number(x) for x in np.ravel(values).tolist())}]"
