"""MJCF's equality constraints: frames that coincide, and joints that follow others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar
from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.description.description import GROUND
from adaptctl.description.loops import Closure, ClosureKind, Coupling, Loops
from adaptctl.description.pose import Pose
from adaptctl.description.readers.mjcf.frames import from_quaternion
from adaptctl.description.readers.mjcf.settings import MAIN, Settings
from adaptctl.description.readers.xml_elements import attribute, like, located, numbers
from adaptctl.errors import InputError, NotFoundError

Known = TypeVar("Known")

_UNREAD = ("tendon", "flex", "flexvert", "flexstrain", "distance")


@dataclass(frozen=True)
class Standing:
    """The attachment of a body of an MJCF file to a link. `carrier` is the zero-based index of the link that the body
    is part of, -1 for the ground; `place` the pose (m) of the body's frame in that link's frame, for the ground in the
    world; `home` its pose in the world as the file draws it. Nothing is checked at construction."""

    carrier: int
    place: Pose
    home: Pose


@dataclass(frozen=True)
class Site:
    """A site of an MJCF file: a frame on the body named `body`, at `pose` (m) in that body's frame. Nothing is checked
    at construction."""

    body: str
    pose: Pose


@dataclass
class Places:
    """The elements that equality constraints of an MJCF file can name, by name, empty by default.

    `bodies` has the link that each body is part of and the body's poses (m), always with "world"; `sites` the frames on
    bodies; `joints` the coordinates (rad, m for a slide) at which the file draws the joints. Nothing is checked at
    construction.
    """

    bodies: dict[str, Standing] = field(default_factory=dict)
    sites: dict[str, Site] = field(default_factory=dict)
    joints: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        still = Pose.identity()
        self.bodies.setdefault("world", Standing(GROUND, still, still))

    def touched(self, element: Element) -> bool:
        """True if the child `element` of an MJCF file's <equality> names a body, site or joint that is among those
        collected here; the world does not count. Nothing is raised."""
        known = {"body": self.bodies.keys() - {"world"}, "site": self.sites.keys(), "joint": self.joints.keys()}
        return any(element.get(f"{kind}{k}") in names for kind, names in known.items() for k in (1, 2))

    def body(self, name: str, where: str) -> Standing:
        """The attachment of the body called `name` in an MJCF file: the link that it is part of, and its frame's poses
        in that link and in the world (m). Raises `NotFoundError` where there is no such body; `where` begins the
        message."""
        return _known(self.bodies, name, "body", where)

    def site(self, name: str, where: str) -> tuple[Standing, Pose]:
        """The pair of the attachment of the body that has the site called `name` in an MJCF file (the link that it is
        part of, and its poses, m), and the site's pose in that body's frame (m). Raises `NotFoundError` where there is
        no such site; `where` begins the message."""
        found = _known(self.sites, name, "site", where)
        return self.bodies[found.body], found.pose

    def joint(self, name: str, where: str) -> float:
        """The coordinate (rad, m for a slide) at which an MJCF file draws the joint called `name`. Raises
        `NotFoundError` where there is no such joint; `where` begins the message."""
        return _known(self.joints, name, "joint", where)


def equalities(
    root: Element, settings: Settings, places: Places, links: Sequence[str], driven: Sequence[str], part: bool = False
) -> Loops | None:
    """The loop constraints, a `Loops`, that the active equalities of an MJCF file make: <connect> and <weld> become
    closures, <joint> couplings; None where there are none.

    `root` is the file's root element, `settings` its compiler settings and defaults, `places` has the bodies, sites and
    joints by name, `links` the links' names by index. `driven` has the names of joints that actuators drive, which
    become the primary (independent) ones; without any, those that follow no other do. MuJoCo's initial configuration
    qpos0, which the file's body poses and the joints' `ref` give, becomes the reference configuration, from which
    motion is followed. Where the mechanism is a `part` of a scene, by default not, equalities that name none of its
    bodies, sites and joints are left out. Raises `InputError` for an equality of another kind or with wrong contents,
    and for closures where no joint is driven, `NotFoundError` for an unknown body, site or joint.
    """
    closures: list[Closure] = []
    couplings: list[Coupling] = []
    for number, element in enumerate(_active(root, settings)):
        name = element.get("name") or f"{element.tag}{number + 1}"
        where = f"equality {name!r}"
        if part and not places.touched(element):
            continue
        with located(element):
            if element.tag == "joint":
                couplings.append(_coupling(element, name, places, driven, where))
            elif element.tag in ("connect", "weld"):
                closures.append(_closure(element, name, places, links, where))
            else:
                known = "connect, weld, joint"
                said = "is not read" if element.tag in _UNREAD else "is unknown"
                raise InputError(f"{where}: <{element.tag}> {said}; equalities that are read: {known}")
    if not closures and not couplings:
        return None
    primary = _primary(places, closures, couplings, driven)
    reference = {name: value for name, value in places.joints.items() if value != 0.0}
    return Loops(primary, tuple(closures), tuple(couplings), reference)


def _active(root: Element, settings: Settings) -> list[Element]:
    """The active equalities with their defaults, which MJCF keeps under the tag equality."""
    flags = [flag for option in root.findall("option") for flag in option.findall("flag")]
    if any(flag.get("equality") == "disable" for flag in flags):
        return []
    found = []
    for element in (child for section in root.findall("equality") for child in section):
        own = {key: value for key, value in element.attrib.items() if key == "class"}
        defaults = settings.full(like(element, own, "equality"), MAIN)
        full = like(element, {**defaults.attrib, **element.attrib})
        if full.get("active", "true") == "true":
            found.append(full)
    return found


def _primary(
    places: Places, closures: Sequence[Closure], couplings: Sequence[Coupling], driven: Sequence[str]
) -> tuple[str, ...]:
    followers = {coupling.follower for coupling in couplings}
    moving = [name for name in places.joints if name in driven]
    if moving:
        return tuple(moving)
    if closures:
        raise InputError(
            f"loops need primary joints, and no actuator drives a joint: add <actuator><motor joint=.../></actuator> "
            f"for those that are driven, among {', '.join(places.joints)}"
        )
    return tuple(name for name in places.joints if name not in followers)


def _closure(element: Element, name: str, places: Places, links: Sequence[str], where: str) -> Closure:
    weld = element.tag == "weld"
    kind = ClosureKind.WELD if weld else ClosureKind.POINT
    if "site1" in element.attrib:
        first, second = (places.site(attribute(element, key, where), where) for key in ("site1", "site2"))
    else:
        first, second = _weld(element, places, where) if weld else _connect(element, places, where)

    def end(standing: Standing, frame: Pose) -> tuple[str | None, Pose]:
        return None if standing.carrier == GROUND else links[standing.carrier], standing.place @ frame

    (one, one_frame), (other, other_frame) = end(*first), end(*second)
    if one == other:
        raise InputError(f"{where}: both ends are on one rigid body, {one or 'the world'}: remove it")
    return Closure(name, one, other, one_frame, other_frame, kind)


End = tuple[Standing, Pose]


def _connect(element: Element, places: Places, where: str) -> tuple[End, End]:
    """A point given on the first body; on the second it is where that point is as the file draws it."""
    first, second = _bodies(element, places, where)
    anchor = Pose(np.eye(3), np.array(numbers(element, "anchor", 3, where)))
    met = second.home.inverse @ first.home @ anchor
    return (first, anchor), (second, Pose(np.eye(3), met.translation))


def _weld(element: Element, places: Places, where: str) -> tuple[End, End]:
    """The anchor, given on the second body, is at relpose in the first, or, when its quaternion is zero, where the
    file draws it."""
    first, second = _bodies(element, places, where)
    anchor = numbers(element, "anchor", 3, where) if "anchor" in element.attrib else [0.0] * 3
    shift = Pose(np.eye(3), np.array(anchor))
    met = first.home.inverse @ second.home @ shift
    if "relpose" in element.attrib:
        values = numbers(element, "relpose", 7, where)
        if any(values[3:]):
            met = Pose(from_quaternion(np.array(values[3:]), where), np.array(values[:3]))
    return (first, met), (second, shift)


def _bodies(element: Element, places: Places, where: str) -> tuple[Standing, Standing]:
    first = places.body(attribute(element, "body1", where), where)
    return first, places.body(element.get("body2", "world"), where)


def _coupling(element: Element, name: str, places: Places, driven: Sequence[str], where: str) -> Coupling:
    """q1 - ref1 = c0 + c1 (q2 - ref2): the first joint follows, unless it alone is driven."""
    follower = attribute(element, "joint1", where)
    if "joint2" not in element.attrib:
        raise InputError(f"{where}: holds joint {follower!r} still: leave the joint out, or name joint2")
    leader = attribute(element, "joint2", where)
    first, second = places.joint(follower, where), places.joint(leader, where)
    given = numbers(element, "polycoef", range(1, 6), where) if "polycoef" in element.attrib else [0.0, 1.0]
    c0, c1, *higher = [*given, *[0.0, 1.0][len(given) :]]
    if any(higher) or c1 == 0.0:
        raise InputError(f"{where}: polycoef: only a linear relation is understood, c0 c1 0 0 0, got {given}")
    offset = first + c0 - c1 * second
    try:
        if follower in driven and leader not in driven:
            return Coupling(name, leader, follower, 1.0 / c1, -offset / c1)
        return Coupling(name, follower, leader, c1, offset)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _known(known: Mapping[str, Known], name: str, what: str, where: str) -> Known:
    if name not in known:
        raise NotFoundError(f"{where}: there is no {what} {name!r}; there are {', '.join(known)}")
    return known[name]
