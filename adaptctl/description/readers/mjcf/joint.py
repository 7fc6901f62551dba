"""An MJCF joint: a hinge or a slide, its limits, its drive, and what its actuators can exert."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.description.description import Joint, JointKind
from adaptctl.description.drive import Drive
from adaptctl.description.limits import Limits
from adaptctl.description.pose import Pose, rotation_about
from adaptctl.description.readers.mjcf.settings import MAIN, Settings
from adaptctl.description.readers.xml_elements import named, number, numbers, refuse
from adaptctl.description.transforms.floating_base import JOINTS
from adaptctl.errors import InputError

_ATTRIBUTES = (
    *("name", "class", "type", "group", "pos", "axis", "springdamper", "solreflimit", "solimplimit", "solreffriction"),
    *("solimpfriction", "stiffness", "range", "limited", "actuatorfrcrange", "actuatorfrclimited", "actuatorgravcomp"),
    *("margin", "ref", "springref", "armature", "damping", "frictionloss", "user"),
)
_FREE_ATTRIBUTES = ("name", "group", "align")
_KINDS = ("hinge", "slide")
NO_LIMIT = 1e9
"""rad or m, of a side of a range that limits nothing"""


def joint_of(joint: Element, name: str, settings: Settings, effort: float | None) -> Joint:
    """The joint, called `name`, that an MJCF <joint> element gives, a hinge or a slide; a hinge without limits is a
    continuous joint. Its axis is in the frame of the body or <frame> that contains the element.

    `settings` say how angles are written; `effort` is the bound of the joint's actuators (N m, N for a slide), None
    without actuators. Limits of at least 1e9 rad (m for a slide) in size count as none. Raises `InputError` for a ball
    joint, an unknown type or attribute, attributes that are not finite numbers, a zero axis, a range that is missing
    though limited or not rising, armature, damping or friction below 0, and nonlinear damping.
    """
    where = f"joint {name!r}"
    _require_known(joint, _ATTRIBUTES, where)
    kind = joint.get("type", "hinge")
    if kind == "ball":
        raise InputError(f"{where}: type 'ball' is not read: build it of hinges")
    if kind not in _KINDS:
        raise InputError(f"{where}: unknown type {kind!r}; expected one of {', '.join(_KINDS)}")
    axis = numbers(joint, "axis", 3, where) if "axis" in joint.attrib else [0.0, 0.0, 1.0]
    limits = _limits(joint, kind == "hinge", settings, effort, where)
    try:
        return Joint(name, kind_within(limits, kind == "hinge"), np.array(axis), limits, _drive(joint, where))
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(where) else f"{where}: {error}") from error


def is_free(joint: Element) -> bool:
    """True where an MJCF joint element, `joint`, is a free joint (freejoint, or of type free), which lets its body move
    in all six directions. Nothing is raised."""
    return joint.tag == "freejoint" or joint.get("type") == "free"


def unfolded(joint: Element, body: str) -> list[Element]:
    """The six <joint> elements that stand for the free joint of an MJCF file: slides along x, y and z, then hinges yaw,
    pitch and roll, named after the joint, or after its `body` where it has no name, as in ``name_x``.

    The joint's position, axis and range are ignored, as MuJoCo ignores them. Armature, damping, frictionloss and
    stiffness of a free joint act on the angular velocity, not on the hinges' rates, and are not read. Raises
    `InputError` where one of these is not 0, and for unknown attributes.
    """
    name = joint.get("name") or body
    where = f"joint {name!r}"
    _require_known(joint, _ATTRIBUTES if joint.tag == "joint" else _FREE_ATTRIBUTES, where)
    for kind in ("armature", "damping", "frictionloss", "stiffness"):
        if kind in joint.attrib and any(numbers(joint, kind, range(1, 4), where)):
            raise InputError(f"{where}: {kind} of a free joint is not read: expected 0, got {joint.attrib[kind]!r}")
    kinds = {True: "hinge", False: "slide"}
    return [
        Element("joint", name=f"{name}_{suffix}", type=kinds[kind.turns], axis=" ".join(map(str, axis)))
        for suffix, kind, axis in JOINTS
    ]


def offset_of(joint: Element, moving: Joint, settings: Settings) -> tuple[float, Pose]:
    """The pair (coordinate, pose) of a joint as an MJCF file draws it. The coordinate (rad, m for a slide) is the
    joint's attribute ref, 0 without one; the pose (m) is that of the joint's frame at coordinate zero, in the joint's
    frame as drawn. `moving` is the joint read from the element `joint`; `settings` say how angles are written. Raises
    `ElementError` for a ref that is not a finite number."""
    where = f"joint {moving.name!r}"
    ref = number(joint, "ref", where) if "ref" in joint.attrib else 0.0
    if moving.kind.turns:
        ref = settings.angle(ref)
        return ref, Pose(rotation_about(moving.axis, -ref), np.zeros(3))
    return ref, Pose(np.eye(3), -ref * moving.axis)


def is_sprung(joint: Element, name: str) -> bool:
    """True where the MJCF joint element `joint`, called `name` in messages, has a spring: a stiffness other than zero.
    Raises `ElementError` where the stiffness is not 1 to 3 finite numbers."""
    return "stiffness" in joint.attrib and any(numbers(joint, "stiffness", range(1, 4), f"joint {name!r}"))


def motor_efforts(root: Element, settings: Settings) -> dict[str, float]:
    """The greatest efforts (N m, N for a slide) of the joints of an MJCF file that actuators drive, by joint name: the
    sum over a joint's actuators, infinite where one has no bound. `root` is the file's root element, `settings` has its
    defaults. Raises `ElementError` for an actuator of an unknown joint or default class, and for gears and bounds that
    are not numbers."""
    efforts: dict[str, float] = {}
    known = {name for joint in root.iter() if joint.tag in ("joint", "freejoint") and (name := joint.get("name"))}
    for section in root.findall("actuator"):
        for actuator in section:
            full = settings.full(actuator, MAIN)
            joint = full.get("joint") or full.get("jointinparent")
            if joint is not None and joint not in known:
                refuse(
                    actuator, f"{named(actuator)}: there is no joint {joint!r}; there are {', '.join(sorted(known))}"
                )
            if joint is not None:
                efforts[joint] = efforts.get(joint, 0.0) + _effort(full)
    return efforts


def no_torques(root: Element, settings: Settings, joints: Container[str]) -> list[str]:
    """Names of the actuators of the given `joints` of an MJCF file whose force is not a multiple of their control, such
    as servos and muscles; each has its tag before it, as in "position 'elbow'". `root` is the file's root element,
    `settings` has its defaults. Raises `ElementError` for an unknown default class."""
    found = []
    for actuator in (actuator for section in root.findall("actuator") for actuator in section):
        full = settings.full(actuator, MAIN)
        plain = ("none", "fixed", "none")
        law = tuple(full.get(key, like) for key, like in zip(("dyntype", "gaintype", "biastype"), plain, strict=True))
        is_torque = actuator.tag == "motor" or (actuator.tag == "general" and law == plain)
        joint = full.get("joint") or full.get("jointinparent")
        if joint in joints and not is_torque:
            own = repr(actuator.get("name")) if actuator.get("name") else f"of joint {joint!r}"
            found.append(f"{actuator.tag} {own}")
    return found


def _require_known(joint: Element, known: Sequence[str], where: str) -> None:
    for attribute in joint.attrib:
        if attribute not in known:
            raise InputError(f"{where}: unknown attribute {attribute!r}; expected one of {', '.join(known)}")


def _effort(actuator: Element) -> float:
    """The bound of one actuator on its joint: of its force, or, for a motor, of its control."""
    where = named(actuator)
    gear = abs(numbers(actuator, "gear", range(1, 7), where)[0]) if "gear" in actuator.attrib else 1.0
    bounds = [_largest(actuator, "forcerange", where)]
    if actuator.tag == "motor":
        bounds.append(_largest(actuator, "ctrlrange", where))
    return gear * min(bounds) if gear else 0.0


def _largest(element: Element, name: str, where: str) -> float:
    limited = element.get(name.replace("range", "limited"), "auto")
    if name not in element.attrib or limited == "false":
        return math.inf
    return max(map(abs, numbers(element, name, 2, where, math.inf)))


def position_limits(lower: float, upper: float) -> tuple[float, float]:
    """The pair of a joint's lower and upper position limit (rad, m if prismatic) for a range `lower` to `upper` of
    MuJoCo's: a `lower` of -1e9 or less becomes minus infinity, an `upper` of 1e9 or more infinity, no limit. Nothing is
    checked."""
    return (-math.inf if lower <= -NO_LIMIT else lower, math.inf if upper >= NO_LIMIT else upper)


def kind_within(limits: Limits, turns: bool) -> JointKind:
    """The kind of a joint with the given `limits`: prismatic unless it `turns`, as a hinge does; else continuous where
    both position limits are infinite, revolute where not. Nothing is raised."""
    if not turns:
        return JointKind.PRISMATIC
    free = (limits.lower, limits.upper) == (-math.inf, math.inf)
    return JointKind.CONTINUOUS if free else JointKind.REVOLUTE


def _limits(joint: Element, turns: bool, settings: Settings, effort: float | None, where: str) -> Limits:
    lower, upper = -math.inf, math.inf
    limited = joint.get("limited", "auto" if settings.autolimits else "false")
    if limited == "true" and "range" not in joint.attrib:
        raise InputError(f"{where}: limited, but no range is given")
    if limited != "false" and "range" in joint.attrib:
        ends = (settings.angle(x) if turns else x for x in numbers(joint, "range", 2, where, math.inf))
        lower, upper = position_limits(*ends)
    bound = min(_largest(joint, "actuatorfrcrange", where), math.inf if effort is None else effort)
    try:
        return Limits(lower, upper, effort=bound or math.inf)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _drive(joint: Element, where: str) -> Drive:
    """Armature, damping and dry friction; zero is not modelled. Damping may be a polynomial's coefficients."""
    values = {
        name: numbers(joint, name, range(1, 4), where) if name in joint.attrib else [0.0]
        for name in ("armature", "damping", "frictionloss")
    }
    for name, numbers_given in values.items():
        if any(numbers_given[1:]):
            raise InputError(f"{where}: {name}: only the first coefficient is understood, got {joint.attrib[name]!r}")
    armature, damping, friction = (given[0] or None for given in values.values())
    return Drive(armature, damping, friction)
