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
    """The place of a body of an MJCF file: `carrier`, the index of the link that carries it, from 0, -1 for the ground,
    and its frame's poses, `place` in that link's frame, for the ground in the world, and `home` in the world, as the
    file draws it (m)."""

    carrier: int
    place: Pose
    home: Pose


@dataclass(frozen=True)
class Site:
    """A site of an MJCF file: a frame on the body named `body`, at `pose` (m) in that body's frame."""

    body: str
    pose: Pose


@dataclass
class Places:
    """The elements that equalities of an MJCF file name: `bodies` with their places (the link that carries each, and
    its poses, m), always with "world", `sites`, and `joints` with the coordinates (rad or m) at which the file draws
    them; all by name, and empty by default."""

    bodies: dict[str, Standing] = field(default_factory=dict)
    sites: dict[str, Site] = field(default_factory=dict)
    joints: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        still = Pose.identity()
        self.bodies.setdefault("world", Standing(GROUND, still, still))

    def touched(self, element: Element) -> bool:
        """True if the <equality> child `element` names a body, site or joint in these `Places`; the world does not
        count."""
        known = {"body": self.bodies.keys() - {"world"}, "site": self.sites.keys(), "joint": self.joints.keys()}
        return any(element.get(f"{kind}{k}") in names for kind, names in known.items() for k in (1, 2))

    def body(self, name: str, where: str) -> Standing:
        """The place of the body called `name`: the link that carries it, and its frame's poses in that link and in the
        world (m). Raises `NotFoundError` where there is none; `where` begins the message."""
        return _known(self.bodies, name, "body", where)

    def site(self, name: str, where: str) -> tuple[Standing, Pose]:
        """The place of the body that has the site called `name` (the link that carries the body, and its poses, m), and
        the site's pose in that body's frame (m). Raises `NotFoundError` where there is no such site; `where` begins the
        message."""
        found = _known(self.sites, name, "site", where)
        return self.bodies[found.body], found.pose

    def joint(self, name: str, where: str) -> float:
        """The coordinate (rad or m) at which the file draws the joint called `name`. Raises `NotFoundError` where there
        is none; `where` begins the message."""
        return _known(self.joints, name, "joint", where)


def equalities(
    root: Element, settings: Settings, places: Places, links: Sequence[str], driven: Sequence[str], part: bool = False
) -> Loops | None:
    """The loops that the active equalities of an MJCF file close, None where there are none: <connect> and <weld> as
    closures, <joint> as couplings.

    `root` is the file's root element, `settings` its compiler settings and defaults, `places` has the bodies, sites and
    joints by name, `links` the links' names by index. `driven` has the names of joints that actuators drive, which
    become the primary (independent) ones; without any, those that follow no other do. The loops' reference, from which
    motion is followed, is the configuration that the file draws. Where the mechanism is a `part` of a scene, by default
    not, equalities of the rest are left out. Raises `InputError` for an equality of another kind or with wrong
    contents, and for closures where no joint is driven, `NotFoundError` for an unknown body, site or joint.
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
