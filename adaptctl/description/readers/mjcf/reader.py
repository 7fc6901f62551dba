"""Reader of MJCF, MuJoCo's format: its tree of bodies, their inertias, joints, and equalities that close loops.

Read here rather than by Pinocchio 4.1, whose reader leaves out in silence all root bodies but the first, <frame>
elements, gravity, and joint equalities, keeps inactive equalities, and misplaces those of bodies without joints.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import GROUND, STANDARD_GRAVITY, Description, Joint, Link
from adaptctl.description.inertia import transformed
from adaptctl.description.pose import Pose
from adaptctl.description.readers.mjcf.equality import Places, Site, Standing, equalities
from adaptctl.description.readers.mjcf.frames import placed
from adaptctl.description.readers.mjcf.includes import included
from adaptctl.description.readers.mjcf.inertia import body_inertia
from adaptctl.description.readers.mjcf.joint import (
    is_free,
    is_sprung,
    joint_of,
    motor_efforts,
    no_torques,
    offset_of,
    unfolded,
)
from adaptctl.description.readers.mjcf.settings import MAIN, Settings
from adaptctl.description.readers.robot_checks import (
    MOST_BODIES,
    MOST_GEOMS,
    MOST_LINKS,
    require_at_most,
    require_mass_of_inertia,
    unknown_body,
    warn_of_degrees,
    warn_of_weightless,
)
from adaptctl.description.readers.xml_elements import located, named, numbers, only, parsed, refuse
from adaptctl.errors import FileError, InputError, NotFoundError, SimplificationWarning
from adaptctl.files import read_text

_SECTIONS = (
    *("compiler", "option", "size", "visual", "statistic", "default", "asset", "worldbody", "contact", "equality"),
    *("tendon", "actuator", "sensor", "keyframe", "custom", "extension"),
)
_IN_BODIES = ("body", "frame", "joint", "freejoint", "inertial", "geom", "site", "camera", "light")
_BODY = ("name", "childclass", "pos", "quat", "axisangle", "xyaxes", "zaxis", "euler", "mocap", "gravcomp", "user")


def read_mjcf(path: str | Path, *, root: str | None = None) -> Description:
    """The description of the mechanism that moves in the MJCF file at `path`, with the loops that its equalities close.

    `root` names the body that the mechanism begins with, where the file is a scene: that body and all on it are read,
    and the rest of the scene is left out. It must not stand on a body that moves. None stands for the one root body
    that moves. What <include> names is read as part of the file.

    Link frames stand at the joints, turned as their bodies; a link is named after its body. A body with several joints
    becomes as many links, massless but the last. Bodies without joints become part of the one that they are fixed to.
    <connect>, <weld> and <joint> equalities become closures and couplings; the joints that actuators drive are then
    primary (independent), or, where nothing is driven and only joints are coupled, all that follow no other. Armature,
    damping and dry friction become the joint's drive; where they are zero they are not modelled. Effort limits are the
    actuators'. A free joint becomes three slides and three hinges, named after it or its body with `_x`, `_y`, `_z`,
    `_yaw`, `_pitch` and `_roll`, primary too.

    Raises `FileError` for a file that cannot be read, for a `root` that is unknown or stands on a body that moves and,
    naming the element, for wrong contents and for motion that is not read, such as ball joints and, without a `root`,
    more than one root body that moves. Warns (`SimplificationWarning`) of springs, tendons and gravity compensation,
    which are left out, of actuators that command no torque, of angles that look like degrees, and of links that move
    without mass and whose descendants have none.
    """
    try:
        scene = included(parsed(read_text(path), "mujoco"), path)
        return _Reader(scene, path, root).description()
    except FileError:
        raise
    except InputError as error:
        raise FileError(f"{path}: {error}") from error


@dataclass(frozen=True, eq=False)
class MjcfBody:
    """A body of an MJCF file with its own inertia. `number` is its zero-based index among the file's <body> elements,
    None where it stands in an included file; `ten` (10,) are its inertial parameters m, mc_x, mc_y, mc_z, I_xx, I_xy,
    I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2), about its frame's origin, without those of bodies fixed to it; and
    `place` is its frame's pose in the frame of the link that it is part of (m). Nothing is checked at construction."""

    number: int | None
    ten: Array
    place: Pose


@dataclass(frozen=True, eq=False)
class MjcfBodies:
    """The bodies of an MJCF file whose inertias a writer can change: `of_links` has, by the zero-based index of each
    link with mass, the body at its joint. `from_geoms` is True if the file's setting inertiafromgeom is true, by which
    inertias are computed from geoms and <inertial> elements are ignored. Nothing is checked at construction."""

    of_links: dict[int, MjcfBody]
    from_geoms: bool


def mjcf_bodies(path: str | Path, root: str | None = None) -> MjcfBodies:
    """The bodies of the MJCF file at `path` that sit at the joints of the links that `read_mjcf` makes of it, one for
    each link with mass, with their own inertias.

    `root` is the name of the mechanism's first body, None the one root body that moves. Raises `FileError` for a file
    that cannot be read, `NotFoundError` for an unknown root, and `InputError` for wrong contents and for what
    `read_mjcf` refuses: ball joints, mocap bodies, no joint, a `root` on a body that moves and, without a `root`,
    several root bodies that move. Simplifications are not warned of.
    """
    scene = parsed(read_text(path), "mujoco")
    numbers_of = {id(body): k for k, body in enumerate(scene.iter("body"))}
    reader = _Reader(included(scene, path), path, root)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SimplificationWarning)
        reader.description()
    found = {
        link: MjcfBody(numbers_of.get(id(element)), ten, place) for link, (element, ten, place) in reader.own.items()
    }
    return MjcfBodies(found, reader.settings.inertia_from_geoms == "true")


@dataclass
class _Unread:
    """A body yet to be read: its element, the link that carries it and its parent's place there and in the world."""

    element: Element
    carrier: int
    place: Pose
    home: Pose
    childclass: str


@dataclass
class _Reader:
    """Walks the bodies from the root outward, parents before children and branch by branch."""

    root: Element
    path: str | Path
    base: str | None = None
    """The body that the mechanism begins with; None where nothing else moves."""
    links: list[Link] = field(default_factory=list)
    sums: list[Array] = field(default_factory=list)
    bodies: list[Element] = field(default_factory=list)
    """Of each link, the body that it belongs to."""
    own: dict[int, tuple[Element, Array, Pose]] = field(default_factory=dict)
    """Of each link with mass, the body at its joint, its ten alone, and its frame in the link."""
    places: Places = field(default_factory=Places)
    sprung: list[str] = field(default_factory=list)
    lifted: list[str] = field(default_factory=list)
    floating: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        for tag, most in (("body", MOST_BODIES), ("geom", MOST_GEOMS)):
            require_at_most(sum(1 for _ in self.root.iter(tag)), most, f"<{tag}> elements")
        for section in self.root:
            if section.tag not in _SECTIONS:
                refuse(section, f"<{section.tag}> is not read; sections that are: {', '.join(_SECTIONS)}")
        self.settings = Settings.of(self.root)
        self.efforts = motor_efforts(self.root, self.settings)

    @property
    def servos(self) -> list[str]:
        """The actuators of the joints that make something else of their control than a torque."""
        return no_torques(self.root, self.settings, self.places.joints)

    def description(self) -> Description:
        """The whole mechanism."""
        moving: list[str] = []
        for element, pose, name in self._roots() if self.base is None else [self._chosen(self.base)]:
            before, root = len(self.links), len(self.places.bodies)
            pending = [_Unread(element, GROUND, pose, pose, name)]
            while pending:
                body = pending.pop()
                with located(body.element):
                    pending += self._read(body)[::-1]
            if len(self.links) > before:
                moving.append(list(self.places.bodies)[root])
        _require_one(moving)
        require_at_most(len(self.links), MOST_LINKS, "links that move")
        links = tuple(self._weighed())
        names = [link.name for link in links]
        driven = [*self.floating, *self.efforts] if self.efforts else []
        loops = equalities(self.root, self.settings, self.places, names, driven, part=self.base is not None)
        self._warn()
        warn_of_degrees(self.path, links, (), stacklevel=4)
        warn_of_weightless(self.path, links, loops, stacklevel=4)
        name = self.root.get("model") or Path(self.path).stem
        return Description(name, links, _gravity(self.root), f"MJCF file {Path(self.path).name}", loops)

    def _weighed(self) -> Iterator[Link]:
        """The links with all that they carry."""
        for body, link, ten in zip(self.bodies, self.links, self.sums, strict=True):
            with located(body):
                yield require_mass_of_inertia(replace(link, inertia=ten))

    def _roots(self) -> Iterator[tuple[Element, Pose, str]]:
        for world in self.root.findall("worldbody"):
            if world.find("inertial") is not None or world.find("joint") is not None:
                raise InputError("<worldbody>: the world has no joint and no inertia")
            self._note_sites(world, "world", MAIN)
            yield from ((x, pose, name) for x, pose, name in self._inside(world, MAIN) if x.tag == "body")

    def _chosen(self, base: str) -> tuple[Element, Pose, str]:
        """The body of that name, the frame that it stands in, its default class. Nothing that moves may carry it."""
        pending, known = [(*body, "") for body in self._roots()], list[str]()
        while pending:
            element, pose, childclass, moving = pending.pop()
            name = element.get("name", "")
            known.append(name)
            if name == base and moving:
                raise InputError(f"body {base!r} stands on {moving!r}, which moves: name that one, or a fixed one")
            if name == base:
                return element, pose, childclass
            childclass = element.get("childclass", childclass)
            place = pose @ placed(element, self.settings, f"body {name!r}")
            inside = list(self._inside(element, childclass))
            if any(x.tag in ("joint", "freejoint") for x, _, _ in inside):
                moving = name
            pending += [(x, place @ at, cls, moving) for x, at, cls in inside if x.tag == "body"]
        raise NotFoundError(unknown_body(base, known))

    def _inside(self, body: Element, childclass: str) -> Iterator[tuple[Element, Pose, str]]:
        """The elements of a body, also those within frames, each with the pose of its frame and its default class."""
        pending = [(child, Pose.identity(), childclass) for child in body][::-1]
        while pending:
            child, pose, name = pending.pop()
            if child.tag not in _IN_BODIES:
                raise InputError(f"{named(body)}: <{child.tag}> is not read; what is: {', '.join(_IN_BODIES)}")
            if child.tag != "frame":
                yield child, pose, name
                continue
            within = pose @ placed(child, self.settings, named(body))
            pending += [(inner, within, child.get("childclass", name)) for inner in child][::-1]

    def _read(self, body: _Unread) -> list[_Unread]:
        """A body's joints, inertia and sites; returns the bodies on it."""
        element, name = body.element, self._name(body.element)
        where = f"body {name!r}"
        childclass = element.get("childclass", body.childclass)
        own = placed(element, self.settings, where)
        carrier, place, home = body.carrier, body.place @ own, body.home @ own
        inside = list(self._inside(element, childclass))
        joints = [self._full(x, at, cls) for x, at, cls in inside if x.tag in ("joint", "freejoint")]
        if any(is_free(joint) for joint, _ in joints):
            joints = self._free(joints, body, name)
        for k, (joint, at) in enumerate(joints):
            carrier, place = self._add(joint, at, carrier, place, element, name, last=k == len(joints) - 1)
        if any(x.tag == "inertial" and at != Pose.identity() for x, at, _ in inside):
            raise InputError(f"{where}: <inertial> within a <frame> is not read: put it into the body")
        geoms = [self._full(x, at, cls) for x, at, cls in inside if x.tag == "geom"]
        if carrier != GROUND:
            ten = body_inertia(only(element, "inertial", where), geoms, self.settings, where)
            self.sums[carrier] = self.sums[carrier] + transformed(ten, place)
            if joints:
                self.own[carrier] = element, ten, place
        self.places.bodies[name] = Standing(carrier, place, home)
        self._note_sites(element, name, childclass)
        return [_Unread(x, carrier, place @ at, home @ at, cls) for x, at, cls in inside if x.tag == "body"]

    def _free(self, joints: Sequence[tuple[Element, Pose]], body: _Unread, name: str) -> list[tuple[Element, Pose]]:
        """The joints of a body that floats."""
        if len(joints) > 1 or body.carrier != GROUND:
            raise InputError(f"body {name!r}: a free joint stands alone, and nothing that moves carries its body")
        parts = unfolded(joints[0][0], name)
        self.floating += [part.attrib["name"] for part in parts]
        return [(part, Pose.identity()) for part in parts]

    def _add(
        self, joint: Element, at: Pose, carrier: int, place: Pose, element: Element, body: str, last: bool
    ) -> tuple[int, Pose]:
        """One more link; returns its index and the body's place on it."""
        name = joint.get("name") or (body if last else f"{body}_{len(self.links)}")
        moving = joint_of(joint, name, self.settings, self.efforts.get(name))
        moving = Joint(name, moving.kind, at.rotation @ moving.axis, moving.limits, moving.drive)
        anchor = np.array(numbers(joint, "pos", 3, f"joint {name!r}")) if "pos" in joint.attrib else np.zeros(3)
        to_joint = Pose(np.eye(3), at.rotation @ anchor + at.translation)
        offset, back = offset_of(joint, moving, self.settings)
        near, called = place @ to_joint @ back, body if last else f"{body}/{name}"
        self.links.append(Link(called, carrier, moving, near, Pose.identity(), massless=not last))
        self.sums.append(np.zeros(10))
        self.bodies.append(element)
        self.places.joints[name] = offset
        if is_sprung(joint, name):
            self.sprung.append(name)
        return len(self.links) - 1, to_joint.inverse

    def _full(self, element: Element, at: Pose, childclass: str) -> tuple[Element, Pose]:
        return self.settings.full(element, childclass), at

    def _name(self, element: Element) -> str:
        name = element.get("name") or f"body{len(self.places.bodies) + 1}"
        where = f"body {name!r}"
        if name in self.places.bodies or name == "world":
            raise InputError(f"two bodies are named {name!r}: names must be unique")
        for attribute in element.attrib:
            if attribute not in _BODY:
                raise InputError(f"{where}: unknown attribute {attribute!r}; expected one of {', '.join(_BODY)}")
        if element.get("mocap") == "true":
            raise InputError(f"{where}: a mocap body is moved by hand: leave it out")
        if element.get("gravcomp", "0") not in ("0", "0.0"):
            self.lifted.append(name)
        return name

    def _note_sites(self, element: Element, body: str, childclass: str) -> None:
        for site, at, cls in self._inside(element, childclass):
            if site.tag == "site" and site.get("name"):
                full = self.settings.full(site, cls)
                pose = at @ placed(full, self.settings, f"site {site.attrib['name']!r}")
                self.places.sites[site.attrib["name"]] = Site(body, pose)

    def _warn(self) -> None:
        tendons = [named(t) for section in self.root.findall("tendon") for t in section]
        for text, names in (
            ("springs of joints are left out", self.sprung),
            ("gravity compensation is left out", self.lifted),
            ("tendons are left out", tendons),
            ("actuators that are no torques, as the laws here command: a <motor> is", self.servos),
        ):
            if names:
                warnings.warn(f"{self.path}: {text}: {', '.join(names)}", SimplificationWarning, stacklevel=5)


def _require_one(moving: Sequence[str]) -> None:
    """One root body, and no more, has joints on it; Pinocchio and others would read the first alone."""
    if not moving:
        raise InputError("no joint moves: expected a hinge or a slide")
    if len(moving) > 1:
        raise InputError(
            f"more than one root body moves, {moving[0]!r} and {moving[1]!r}: each is a mechanism of its own; name "
            f"the one that is meant, root={moving[0]!r}, or keep them in files of their own, and join them if they "
            "hang together"
        )


def _gravity(root: Element) -> Array:
    gravity = np.array(STANDARD_GRAVITY)
    for option in root.findall("option"):
        if "gravity" in option.attrib:
            gravity = np.array(numbers(option, "gravity", 3, "<option>"))
        if any(flag.get("gravity") == "disable" for flag in option.findall("flag")):
            return np.zeros(3)
    return gravity
