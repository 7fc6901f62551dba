"""Reader of URDF: links, joints, inertias and limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.drive import Drive, Limits
from adaptctl.description.inertia import from_center_of_mass, transformed
from adaptctl.description.joint import Joint, JointKind
from adaptctl.description.link import GROUND, Link
from adaptctl.description.loops import Coupling, Loops
from adaptctl.description.pose import NamedFrame, Pose
from adaptctl.description.readers.entries import (
    FLOATING_FLAG,
    MAX_BODIES,
    MAX_LINKS,
    validate_at_most,
    validate_mass_of_inertia,
    warn_of_degrees,
    warn_of_weightless,
    zero_limits,
)
from adaptctl.description.readers.urdf_doubts import (
    GIVE_INERTIAL,
    GIVE_LIMIT,
    IN_METRES,
    lengthy,
    massless,
    turned,
    unlimited,
)
from adaptctl.description.readers.urdf_visuals import Meshes, materials, origin_pose, visuals
from adaptctl.description.readers.xml_elements import (
    attribute,
    located,
    named,
    number,
    numbers,
    only,
    parsed,
    read_xml,
    refuse,
    required,
)
from adaptctl.description.transforms import above_base, floating, frames_above_base
from adaptctl.description.visual import Visual
from adaptctl.errors import FileError, InputError, SimplificationWarning, suggested_name, warn

KINDS = {kind.value: kind for kind in JointKind}
UNREAD_MACROS = ("property", "arg", "macro")
BASE_KINDS = ("floating", "planar")
"""Kinds of joints that only a base is on."""


def read_urdf(path: str | Path, *, floating_base: bool = False, mesh_folders: Sequence[str | Path] = ()) -> Description:
    """
    Read a mechanism from a URDF file.

    Parameters
    ----------
    path : str or Path
        URDF file.
    floating_base : bool, default False
        If true, the root link floats on three slides and the hinges yaw, pitch and roll, named after it. By default it
        is fixed to the ground, as an arm is.
    mesh_folders : sequence of str or Path, optional
        Folders with meshes to show. Default: none besides the file's own package.

    Returns
    -------
    Description
        Links are named after the joints' children, with frames at the joints. All joints that follow no other are
        primary.

    Raises
    ------
    FileError
        If the file cannot be read or its contents are wrong; the message names the element and its line.

    Warns
    -----
    SimplificationWarning
        If a base is held that may be meant to float, a mimic joint has no moving leader, limits are missing, zero or
        negative (taken as none), angles look like degrees or lengths like millimetres, links have no mass, or a mesh is
        outside the folders.

    Notes
    -----
    Links behind fixed joints are merged into their parents, and are named frames there; collision geometry and
    transmissions are not read. Damping and friction become viscous and Coulomb friction, where not zero. See
    :doc:`/robots`.

    Examples
    --------
    >>> from adaptctl.description import read_urdf
    >>> file = tmp / "rod.urdf"
    >>> _ = file.write_text('''<robot name="arm"><link name="base"/><link name="rod"><inertial><mass value="1"/>
    ... <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    ... <joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/></joint></robot>''')
    >>> read_urdf(file)
    <Description 'arm': 1 links>
    """
    try:
        robot = _robot(read_xml(path))
        bodies = _by_name(robot, "link")
        edges = [_Edge.of(element) for element in _by_name(robot, "joint").values()]
        root = _root(bodies, edges)
        unread = (
            set() if floating_base else _partial(_reached([root], [edge for edge in edges if not edge.joint]), bodies)
        )
        inertias = {name: np.zeros(10) if name in unread else link_inertia(body) for name, body in bodies.items()}
        name, source = robot.get("name") or Path(path).stem, f"URDF file {Path(path).name}"
        links, still, places = _movable(root, inertias, edges)
        meshes = Meshes(Path(path), mesh_folders)
        shown, frames = _shown(robot, bodies, places, meshes), _frames(links, places)
        held = _held(root, still, links, edges)
        if floating_base:
            frames = frames_above_base(frames)
            links, shown = floating(links, root, still), above_base(shown)
        elif not links:
            more = f"; the base {root!r} is held still, and floats with {FLOATING_FLAG}" if np.any(still) else ""
            raise InputError(f"no moving joint: expected a revolute, continuous or prismatic joint{more}")
        loops = _loops(edges, links)
        for link in links:
            with located(bodies.get(link.name, robot)):
                validate_mass_of_inertia(link)
        description = Description(name, links, source=source, loops=loops, visuals=shown, frames=frames)
    except FileError:
        raise
    except InputError as error:
        raise FileError(f"{path}: {error}") from error
    _warn(path, "mimic joints whose leader does not move are read as independent", _leaderless(edges))
    repeated = [edge.name for edge in edges if _is_repeated(edge.element.findall("mimic"))]
    _warn(path, "constraints given twice are taken once", repeated)
    _warn(path, f"the base is held still, and floats with {FLOATING_FLAG}", [] if floating_base else held)
    _warn(path, "negative limits of effort or velocity are read as none", [e.name for e in edges if e.negative_limits])
    zeros = [f"{edge.name} ({edge.zero_limits})" for edge in edges if edge.zero_limits]
    _warn(path, "limits of zero are read as no limits", zeros)
    _warn(path, GIVE_LIMIT, unlimited(edge.element for edge in edges))
    _warn(path, GIVE_INERTIAL, massless(links, bodies))
    movers = [edge.element for edge in edges if edge.parent != root or edge.joint is not None]
    _warn(path, IN_METRES, lengthy([*movers, *(bodies[link.name] for link in links if link.name in bodies)]))
    _warn(
        path,
        "meshes outside the robot's package are ignored; give their folder in mesh_folders",
        meshes.outside,
    )
    warn_of_degrees(path, links, turned(robot))
    warn_of_weightless(path, links, loops)
    return description


@dataclass(frozen=True)
class _Edge:
    """Joint of the file; a fixed one has no `joint`."""

    element: Element
    name: str
    parent: str
    child: str
    origin: Pose
    joint: Joint | None = None
    mimic: Coupling | None = None
    zero_limits: str = ""
    negative_limits: bool = False

    @property
    def kind(self) -> str:
        """Type in the file."""
        return self.element.get("type", "")

    @classmethod
    def of(cls, element: Element) -> _Edge:
        """Joint of an element."""
        with located(element):
            return cls._of(element)

    @classmethod
    def _of(cls, element: Element) -> _Edge:
        where = named(element)
        kind = attribute(element, "type", where)
        if kind not in ("fixed", *KINDS, *BASE_KINDS):
            refuse(element, f"{where}: unknown type {kind!r}; expected one of {', '.join([*KINDS, 'fixed'])}")
        parent, child = (attribute(required(element, tag, where), "link", where) for tag in ("parent", "child"))
        name, origin = element.attrib["name"], origin_pose(element, where)
        if kind not in KINDS:
            return cls(element, name, parent, child, origin)
        limits, zero, negative = _limits(only(element, "limit", where), KINDS[kind], where)
        joint = Joint(name, KINDS[kind], _axis(element, where), limits, _drive(element, where))
        return cls(element, name, parent, child, origin, joint, _mimic(element, where), zero, negative)


def _robot(text: str) -> Element:
    robot = parsed(text, "robot")
    for element in _read_parts(robot):
        texts = (element.tag, *element.attrib.values())
        if "xacro" in element.tag or any("${" in value or "$(" in value for value in texts):
            refuse(element, "contains xacro macros; expand them first (xacro file.urdf.xacro > file.urdf)")
    return robot


def _read_parts(robot: Element) -> Iterator[Element]:
    """Elements that are read: not simulators', nor those that define a macro or its values."""
    yield robot
    for child in robot:
        if child.tag in ("link", "joint", "material"):
            yield from child.iter()
        elif "xacro" in child.tag and not child.tag.endswith(UNREAD_MACROS):
            yield child


def _by_name(robot: Element, tag: str) -> dict[str, Element]:
    found: dict[str, Element] = {}
    elements = robot.findall(tag)
    validate_at_most(len(elements), MAX_BODIES, f"<{tag}> elements")
    for index, element in enumerate(elements):
        name = element.get("name")
        if not name:
            refuse(element, f"<{tag}> number {index + 1} has no name; add name=...")
        if name in found:
            refuse(element, f"two <{tag}> elements are named {name!r}: names must be unique")
        found[name] = element
    return found


def _root(bodies: dict[str, Element], edges: Sequence[_Edge]) -> str:
    carried: dict[str, str] = {}
    for edge in edges:
        for role, link in (("parent", edge.parent), ("child", edge.child)):
            if link not in bodies:
                refuse(edge.element, f"joint {edge.name!r}: its {role} link {link!r} does not exist")
        if edge.child in carried:
            both = f"{carried[edge.child]!r} and {edge.name!r}"
            refuse(edge.element, f"link {edge.child!r} is the child of two joints, {both}: URDF does not allow loops")
        carried[edge.child] = edge.name
    roots = [name for name in bodies if name not in carried]
    if len(roots) > 1:
        raise InputError(f"more than one root link, {_listed(roots)}; connect all but one by joints")
    loose = set(bodies) - _reached(roots, edges)
    if loose or not roots:
        raise InputError(f"links in a cycle: {_listed(sorted(loose))}" if bodies else "no <link> elements")
    return roots[0]


def _reached(roots: Sequence[str], edges: Sequence[_Edge]) -> set[str]:
    below: dict[str, list[str]] = {}
    for edge in edges:
        below.setdefault(edge.parent, []).append(edge.child)
    reached, pending = set(roots), list(roots)
    while pending:
        children = below.get(pending.pop(), [])
        reached.update(children)
        pending += children
    return reached


def _partial(fixed: set[str], bodies: dict[str, Element]) -> set[str]:
    """Links among those fixed to the ground whose <inertial> lacks a part, which no equation needs."""
    parts = {name: bodies[name].find("inertial") for name in fixed}
    return {
        name
        for name, part in parts.items()
        if part is not None and (len(part.findall("mass")), len(part.findall("inertia"))) != (1, 1)
    }


def _movable(
    root: str, inertias: dict[str, Array], edges: Sequence[_Edge]
) -> tuple[tuple[Link, ...], Array, dict[str, tuple[int, Pose]]]:
    below: dict[str, list[_Edge]] = {}
    for edge in edges:
        below.setdefault(edge.parent, []).append(edge)
    links: list[tuple[_Edge, Joint, int, Pose]] = []
    sums: list[Array] = []
    still, places = inertias[root], {root: (GROUND, Pose.identity())}
    pending = [(edge, GROUND, Pose.identity()) for edge in below.get(root, [])[::-1]]
    while pending:
        edge, carrier, place = pending.pop()
        place = place @ edge.origin
        if edge.joint is not None:
            links.append((edge, edge.joint, carrier, place))
            sums.append(inertias[edge.child])
            carrier, place = len(links) - 1, Pose.identity()
        elif carrier == GROUND:
            still = still + transformed(inertias[edge.child], place)
        else:
            sums[carrier] = sums[carrier] + transformed(inertias[edge.child], place)
        places[edge.child] = carrier, place
        pending += [(next_edge, carrier, place) for next_edge in below.get(edge.child, [])[::-1]]
    validate_at_most(len(links), MAX_LINKS, "moving links")
    pairs = zip(links, sums, strict=True)
    return tuple(_link(*found, ten) for found, ten in pairs), still, places


def _link(edge: _Edge, joint: Joint, parent: int, near: Pose, ten: Array) -> Link:
    with located(edge.element):
        return Link(edge.child, parent, joint, near, Pose.identity(), ten)


def _frames(links: Sequence[Link], places: dict[str, tuple[int, Pose]]) -> tuple[NamedFrame, ...]:
    """Links that fixed joints hold, such as `tool0`, as frames on the links that move."""
    moving = {link.name for link in links}
    return tuple(NamedFrame(name, *place) for name, place in places.items() if name not in moving)


def _shown(
    robot: Element, bodies: dict[str, Element], places: dict[str, tuple[int, Pose]], meshes: Meshes
) -> tuple[Visual, ...]:
    colors = materials(robot)
    return tuple(v.on(*places[name]) for name, body in bodies.items() for v in visuals(body, meshes, colors))


def link_inertia(link: Element) -> Array:
    """Ten inertial parameters of a URDF <link> element."""
    with located(link):
        return _inertia_of(link, named(link))


def _inertia_of(link: Element, where: str) -> Array:
    inertial = only(link, "inertial", where)
    if inertial is None:
        return np.zeros(10)
    mass = number(required(inertial, "mass", where), "value", where)
    element = required(inertial, "inertia", where)
    xx, xy, xz, yy, yz, zz = (number(element, f"i{name}", where) for name in ("xx", "xy", "xz", "yy", "yz", "zz"))
    if mass < 0.0:
        refuse(inertial, f"{where}: mass must not be negative, got {mass}")
    center = origin_pose(inertial, where)
    tensor = center.rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ center.rotation.T
    return from_center_of_mass(mass, center.translation, tensor)


def _axis(joint: Element, where: str) -> Array:
    axis = only(joint, "axis", where)
    return np.array(numbers(axis, "xyz", 3, where) if axis is not None else [1.0, 0.0, 0.0])


def _mimic(joint: Element, where: str) -> Coupling | None:
    given = joint.findall("mimic")
    mimic = given[0] if given and _is_repeated(given) else only(joint, "mimic", where)
    if mimic is None:
        return None
    leader, name = attribute(mimic, "joint", where), joint.attrib["name"]
    ratio, offset = (
        number(mimic, key, where) if key in mimic.attrib else default
        for key, default in (("multiplier", 1.0), ("offset", 0.0))
    )
    try:
        return Coupling(f"{name} mimics {leader}", name, leader, ratio, offset)
    except InputError as error:
        raise InputError(f"{where}: <mimic>: {error}") from error


def _is_repeated(elements: Sequence[Element]) -> bool:
    """True where more than one element says the same."""
    return len(elements) > 1 and all(element.attrib == elements[0].attrib for element in elements)


def _loops(edges: Sequence[_Edge], links: Sequence[Link]) -> Loops | None:
    moving = {edge.name for edge in edges if edge.joint is not None}
    couplings = [edge.mimic for edge in edges if edge.mimic is not None and edge.mimic.leader in moving]
    if not couplings:
        return None
    followers = {coupling.follower for coupling in couplings}
    primary = [link.joint.name for link in links if link.joint.name not in followers]
    return Loops(tuple(primary), couplings=tuple(couplings))


def _leaderless(edges: Sequence[_Edge]) -> list[str]:
    moving = {edge.name for edge in edges if edge.joint is not None}
    pairs = [(edge.name, edge.mimic.leader) for edge in edges if edge.mimic and edge.mimic.leader not in moving]
    known = [edge.name for edge in edges]
    return [name if own in known else f"{name}, of unknown leader {own!r}{_close(own, moving)}" for name, own in pairs]


def _close(name: str, moving: set[str]) -> str:
    return suggested_name(name, sorted(moving)) or "; name a joint in <mimic>"


def _drive(joint: Element, where: str) -> Drive:
    """Joint's friction."""
    dynamics = only(joint, "dynamics", where)
    if dynamics is None:
        return Drive()
    viscous, coulomb = (
        number(dynamics, name, where) if name in dynamics.attrib else 0.0 for name in ("damping", "friction")
    )
    try:
        return Drive(viscous=viscous or None, coulomb=coulomb or None)
    except InputError as error:
        raise InputError(f"{where}: <dynamics>: {error}") from error


def _limits(limit: Element | None, kind: JointKind, where: str) -> tuple[Limits, str, bool]:
    """Limits, those that are zero in words, and whether one is negative; neither limits."""
    if limit is None:
        return Limits(), "", False
    lower, upper, velocity, effort = (
        number(limit, name, where, math.inf) if name in limit.attrib else None
        for name in ("lower", "upper", "velocity", "effort")
    )
    bounds = (-math.inf, math.inf)
    if kind is JointKind.CONTINUOUS:
        lower = upper = None
    if lower or upper:
        bounds = (lower or 0.0, upper or 0.0)
    zero = zero_limits(lower, upper, velocity, effort)
    most = [value if value is not None and value > 0.0 else math.inf for value in (velocity, effort)]
    negative = any(value is not None and value < 0.0 for value in (velocity, effort))
    try:
        return Limits(*bounds, *most), zero, negative
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _held(root: str, still: Array, links: Sequence[Link], edges: Sequence[_Edge]) -> list[str]:
    """Base that may be meant to float: on a floating joint, or heavy with several branches."""
    loose = [edge for edge in edges if edge.kind in BASE_KINDS]
    carried = _reached([link.name for link in links], edges) if loose else set()
    for edge in (edge for edge in loose if edge.parent in carried):
        known = ", ".join([*KINDS, "fixed"])
        refuse(
            edge.element, f"joint {edge.name!r}: type {edge.kind!r} is only for a base; build it from {known} joints"
        )
    on_base = {i for i, link in enumerate(links) if link.parent == GROUND}
    limbs = {link.parent for link in links} & on_base
    return [edge.child for edge in loose] or ([root] if len(limbs) > 1 and np.any(still) else [])


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(repr, names[:5])) + (", ..." if len(names) > 5 else "")


def _warn(path: str | Path, text: str, names: Sequence[str]) -> None:
    if names:
        warn(f"{path}: {text}: {', '.join(names)}", SimplificationWarning)
