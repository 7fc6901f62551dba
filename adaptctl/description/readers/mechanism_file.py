"""Reader of mechanisms from TOML files of links and closures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import msgspec
import numpy as np

from adaptctl.description.description import STANDARD_GRAVITY, Description
from adaptctl.description.link import GROUND, Link, depth_first
from adaptctl.description.loops import Closure, ClosureKind, Condition, Coupling, Loops, given_once
from adaptctl.description.pose import FrameKind, NamedFrame
from adaptctl.description.readers.entries import (
    MAX_ENTRIES,
    FrameEntry,
    LinkEntry,
    Name,
    Triple,
    is_more_than_a_turn,
    warn_of_degrees,
    warn_of_repeated,
    warn_of_weightless,
)
from adaptctl.errors import FileError, InputError, NotFoundError
from adaptctl.files import read_text, read_toml, with_line

Entry = TypeVar("Entry")
Part = TypeVar("Part")


class TreeLink(LinkEntry, kw_only=True):
    """Link of a tree with the joint before it, in TOML."""

    parent: Name | None = None
    axis: Triple = (0.0, 0.0, 1.0)
    position: Triple = (0.0, 0.0, 0.0)
    rpy: Triple | None = None
    rpy_deg: Triple | None = None
    far: FrameEntry = msgspec.field(default_factory=FrameEntry)
    massless: bool = False


class LinkFrame(FrameEntry, kw_only=True):
    """Frame on a link in a mechanism file in TOML; without a link, on the ground."""

    link: Name | None = None


class NamedFrameEntry(LinkFrame, kw_only=True):
    """Named frame in a mechanism file in TOML."""

    name: Name
    kind: Literal["operational", "fixed joint", "body", "sensor"] = "operational"


class ClosureEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Loop closure between two frames in a mechanism file in TOML."""

    name: Name
    first: LinkFrame
    second: LinkFrame
    kind: Literal["point", "axis", "weld"] = "point"


class CouplingEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Coupling of two joints in TOML: follower = ratio * leader + offset."""

    follower: Name
    leader: Name
    ratio: float = 1.0
    offset: float = 0.0
    name: Name | None = None


class ConditionEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Linear bound on primary positions in a mechanism file in TOML."""

    name: Name
    weights: dict[Name, float]
    lower: float | None = None
    upper: float | None = None


class MechanismFile(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Contents of a mechanism file in TOML, as `read_mechanism_file` reads them."""

    schema: Literal["adaptctl/mechanism/1"]
    links: Annotated[list[TreeLink], msgspec.Meta(min_length=1, max_length=MAX_ENTRIES)]
    name: Name | None = None
    source: str = ""
    gravity: Triple = STANDARD_GRAVITY
    closures: Annotated[list[ClosureEntry], msgspec.Meta(max_length=MAX_ENTRIES)] = []
    couplings: Annotated[list[CouplingEntry], msgspec.Meta(max_length=MAX_ENTRIES)] = []
    primary: Annotated[list[Name], msgspec.Meta(max_length=MAX_ENTRIES)] | None = None
    reference: dict[Name, float] = {}
    conditions: Annotated[list[ConditionEntry], msgspec.Meta(max_length=MAX_ENTRIES)] = []
    frames: list[NamedFrameEntry] = []


def read_mechanism_file(path: str | Path) -> Description:
    """
    Read a mechanism from a TOML file of links, closures and couplings.

    Parameters
    ----------
    path : str or Path
        File with ``schema = "adaptctl/mechanism/1"``; the mechanism is named after it unless it gives a name.

    Returns
    -------
    Description
        The mechanism. Where the file has neither closures nor a list `primary`, all joints but followers of couplings
        are primary (independent).

    Raises
    ------
    FileError
        If the file cannot be read or its contents are wrong; the message names the element. Loops that do not close are
        found when a mechanism is made.

    Warns
    -----
    SimplificationWarning
        If angles look like degrees, or a link at the end of a chain has no mass.

    Notes
    -----
    Tables are ``[[links]]``, ``[[closures]]``, ``[[couplings]]``, ``[[conditions]]`` and ``[[frames]]``, units m and
    rad. See :doc:`/robots`.

    Examples
    --------
    >>> from adaptctl.description import read_mechanism_file
    >>> file = tmp / "slider.toml"
    >>> _ = file.write_text('''schema = "adaptctl/mechanism/1"
    ... [[links]]
    ... name = "cart"
    ... type = "prismatic"
    ... mass = 2.0
    ... first_moment = [0.0, 0.0, 0.0]
    ... inertia = { xx = 0.1, yy = 0.1, zz = 0.1 }
    ... ''')
    >>> read_mechanism_file(file)
    <Description 'slider': 1 links>
    """
    content = read_toml(path, MechanismFile)
    try:
        links = _links(content.links)
        name, gravity = content.name or Path(path).stem, np.array(content.gravity)
        loops, repeated = _loops(content, links)
        frames = _frames(content.frames, [link.name for link in links])
        description = Description(name, links, gravity, content.source.strip(), loops, frames=frames)
    except InputError as error:
        raise FileError(with_line(f"{path}: {error}", read_text(path))) from error
    turned = [any(map(is_more_than_a_turn, (entry.rpy, entry.far.rpy))) for entry in content.links]
    warn_of_degrees(path, links, [f"rpy of $.links[{i}]" for i in np.flatnonzero(turned)])
    warn_of_weightless(path, links, loops)
    warn_of_repeated(path, repeated)
    return description


def _links(entries: Sequence[TreeLink]) -> tuple[Link, ...]:
    names = [entry.name or f"link{i + 1}" for i, entry in enumerate(entries)]
    _validate_parents(entries, names)

    def link(entry: TreeLink, place: int) -> Link:
        joint = entry.moving(entry.joint or f"joint{place + 1}", entry.axis)
        near = FrameEntry(position=entry.position, rpy=entry.rpy, rpy_deg=entry.rpy_deg).pose()
        parent = GROUND if entry.parent is None else names.index(entry.parent)
        return Link(names[place], parent, joint, near, entry.far.pose(), entry.ten(), entry.massless)

    return depth_first(_built("links", entries, link))


def _validate_parents(entries: Sequence[TreeLink], names: Sequence[str]) -> None:
    for i, entry in enumerate(entries):
        if names.count(names[i]) > 1:
            raise InputError(f"$.links[{i}]: the name {names[i]!r} is given more than once")
        if entry.parent is not None and entry.parent not in names:
            known = ", ".join(names)
            raise NotFoundError(
                f"$.links[{i}] ({names[i]}): parent: unknown link {entry.parent!r}; links: {known}; a link "
                "without the key parent is attached to the ground"
            )


def _frames(entries: Sequence[NamedFrameEntry], links: Sequence[str]) -> tuple[NamedFrame, ...]:
    def frame(entry: NamedFrameEntry, place: int) -> NamedFrame:
        if entry.link is not None and entry.link not in links:
            raise NotFoundError(f"unknown link {entry.link!r}; links: {', '.join(links)}")
        link = GROUND if entry.link is None else links.index(entry.link)
        return NamedFrame(entry.name, link, entry.pose(), FrameKind(entry.kind))

    return _built("frames", entries, frame)


def _loops(content: MechanismFile, links: Sequence[Link]) -> tuple[Loops | None, tuple[str, ...]]:
    """Loops, and the names of constraints that were given twice."""
    closures, again = given_once(_built("closures", content.closures, _closure))
    couplings, more = given_once(_built("couplings", content.couplings, _coupling))
    if not closures and not couplings:
        _validate_nothing_of_loops(content)
        return None, ()
    conditions = _built("conditions", content.conditions, _condition)
    loops = Loops(_primary(content, couplings, links), closures, couplings, content.reference, conditions)
    return loops, (*again, *more)


def _validate_nothing_of_loops(content: MechanismFile) -> None:
    for name in ("primary", "reference", "conditions"):
        if getattr(content, name):
            raise InputError(f"$.{name}: used only with closures or couplings; remove it, or add one")


def _primary(content: MechanismFile, couplings: Sequence[Coupling], links: Sequence[Link]) -> tuple[str, ...]:
    joints = [link.joint.name for link in links]
    if content.primary is not None:
        return tuple(content.primary)
    if content.closures:
        raise InputError(f"$.primary is missing; name the driven joints among {', '.join(joints)}")
    followers = {coupling.follower for coupling in couplings}
    return tuple(name for name in joints if name not in followers)


def _closure(entry: ClosureEntry, place: int) -> Closure:
    first, second = _in_context("first", entry.first.pose), _in_context("second", entry.second.pose)
    return Closure(entry.name, entry.first.link, entry.second.link, first, second, ClosureKind(entry.kind))


def _coupling(entry: CouplingEntry, place: int) -> Coupling:
    name = entry.name or f"{entry.follower} follows {entry.leader}"
    return Coupling(name, entry.follower, entry.leader, entry.ratio, entry.offset)


def _condition(entry: ConditionEntry, place: int) -> Condition:
    lower = -math.inf if entry.lower is None else entry.lower
    return Condition(entry.name, entry.weights, lower, math.inf if entry.upper is None else entry.upper)


def _built(what: str, entries: Sequence[Entry], build: Callable[[Entry, int], Part]) -> tuple[Part, ...]:
    def one(entry: Entry, place: int) -> Part:
        return _in_context(f"$.{what}[{place}]", lambda: build(entry, place))

    return tuple(one(entry, place) for place, entry in enumerate(entries))


def _in_context(where: str, make: Callable[[], Part]) -> Part:
    try:
        return make()
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
