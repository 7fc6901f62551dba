"""Writer of URDF with other inertials: everything else of the file stays as it is, byte for byte."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.inertia import from_tensor, inertia_tensor, is_physically_consistent
from adaptctl.description.readers.urdf import link_inertia
from adaptctl.description.readers.xml_elements import parsed
from adaptctl.description.writers.edits import edited, end_of_tag
from adaptctl.errors import FileError, InputError
from adaptctl.files import decoded, read_bytes, write_bytes


def write_urdf(path: str | Path, original: str | Path, before: Description, after: Description) -> None:
    """Write to `path` a copy of the URDF file `original` with the links' inertias of the description `after`; all else
    stays, byte for byte. `before` is the description read from `original`.

    A moving link's inertia includes that of all links fixed to it. These keep theirs, and it gets the rest, as long as
    a rigid body can have the rest; where none can, it gets all, and they lose theirs. Raises `FileError` for a file
    that cannot be read or written or is not UTF-8, and for a first moment or an inertia without mass, which URDF cannot
    hold; `KeyError` for a link that the file does not have, `ValueError` for descriptions with different numbers of
    links.
    """
    data = read_bytes(original)
    text = decoded(original, data)
    try:
        robot = parsed(text, "robot")
        elements = {element.attrib["name"]: element for element in robot.findall("link")}
        fixed = _fixed_below(robot)
        changed: dict[str, Array | None] = {}
        for old, new in zip(before.links, after.links, strict=True):
            others = old.inertia - link_inertia(elements[old.name])
            rest = new.inertia - others
            if np.any(others) and not is_physically_consistent(rest):
                rest = new.inertia
                changed |= dict.fromkeys(_all_below(fixed, old.name))
            if rest[0] == 0.0 and np.any(rest):
                raise InputError(f"link {old.name!r}: URDF's inertias are about a centre of mass: without mass none is")
            changed[old.name] = rest
    except InputError as error:
        raise FileError(f"{original}: {error}") from error
    write_bytes(path, with_inertials(data, changed))


def with_inertials(data: bytes, inertias: Mapping[str, Array | None]) -> bytes:
    """A copy of the bytes `data` of a URDF file with the <inertial> elements of some links replaced; all else stays,
    byte for byte. `inertias` has, by link name, the ten inertial parameters (10,) m, mc_x, mc_y, mc_z, I_xx, I_xy,
    I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2, about the link frame's origin), or None to take the element out. Raises
    `KeyError` for a link that the file does not have."""
    spans = _spans(data)
    edits = []
    for name, ten in inertias.items():
        span = spans[name]
        new = b"" if ten is None else _element(ten)
        if span.inertial is not None:
            edits.append((*span.inertial, new))
        elif ten is not None and data[span.start - 2 : span.start] == b"/>":
            edits.append((span.start - 2, span.start, b">\n    " + new + b"\n  </link>"))
        elif ten is not None:
            edits.append((span.start, span.start, b"\n    " + new))
    return edited(data, edits)


@dataclass
class _Span:
    """Byte offsets in the file of a link's content and of its <inertial>."""

    start: int
    inertial: tuple[int, int] | None = None


@dataclass
class _Finder:
    """Parser target that finds the spans of a file's links by name."""

    data: bytes
    spans: dict[str, _Span] = field(default_factory=dict)
    path: list[str] = field(default_factory=list)
    link: str = ""
    begun: int = 0

    def started(self, tag: str, attributes: dict[str, str], at: int) -> None:
        self.path.append(tag)
        if self.path == ["robot", "link"]:
            self.link = attributes["name"]
            self.spans[self.link] = _Span(end_of_tag(self.data, at))
        elif self.path == ["robot", "link", "inertial"]:
            self.begun = at

    def ended(self, at: int) -> None:
        if self.path == ["robot", "link", "inertial"]:
            self.spans[self.link].inertial = (
                self.begun,
                max(end_of_tag(self.data, at), end_of_tag(self.data, self.begun)),
            )
        self.path.pop()


def _spans(data: bytes) -> dict[str, _Span]:
    parser, finder = expat.ParserCreate(), _Finder(data)
    parser.StartElementHandler = lambda tag, attributes: finder.started(tag, attributes, parser.CurrentByteIndex)
    parser.EndElementHandler = lambda tag: finder.ended(parser.CurrentByteIndex)
    parser.Parse(data, True)
    return finder.spans


def _element(ten: Array) -> bytes:
    mass = float(ten[0])
    center = ten[1:4] / (mass or 1.0)
    shift = mass * (np.dot(center, center) * np.eye(3) - np.outer(center, center))
    at_center = from_tensor(mass, ten[1:4], inertia_tensor(ten) - shift)
    xx, xy, yy, xz, yz, zz = (repr(float(x)) for x in at_center[4:])
    place = " ".join(repr(float(x)) for x in center)
    return (
        f'<inertial>\n      <origin xyz="{place}" rpy="0 0 0"/>\n      <mass value="{mass!r}"/>\n'
        f'      <inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/>\n    </inertial>'
    ).encode()


def _fixed_below(robot: Element) -> dict[str, list[str]]:
    below: dict[str, list[str]] = {}
    for joint in robot.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if joint.get("type") == "fixed" and parent is not None and child is not None:
            below.setdefault(parent.attrib["link"], []).append(child.attrib["link"])
    return below


def _all_below(fixed: Mapping[str, list[str]], name: str) -> list[str]:
    return [other for child in fixed.get(name, []) for other in (child, *_all_below(fixed, child))]
