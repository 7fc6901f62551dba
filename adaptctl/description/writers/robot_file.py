"""Writer of URDF and MJCF files with other inertias; all else stays, byte for byte."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import about_center, from_tensor, is_physically_consistent, transformed
from adaptctl.description.readers.mjcf import MjcfBody, mjcf_bodies
from adaptctl.description.readers.registry import read
from adaptctl.description.readers.urdf import link_inertia
from adaptctl.description.readers.xml_elements import parsed, xml_encoding, xml_text
from adaptctl.description.right_angles import ROUNDED_ANGLE, snapped
from adaptctl.errors import AdaptctlError, FileError, InputError
from adaptctl.files import read_bytes, write_bytes


def write_robot(path: str | Path, original: str | Path, after: Description, root: str | None = None) -> None:
    """Write a copy of a URDF or MJCF file with other inertias."""
    suffix = Path(original).suffix.lower()
    if suffix not in (".urdf", ".xml", ".mjcf"):
        raise InputError(f"{original}: expected a URDF or MJCF file, got {suffix!r}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # as when it was first read
        floating_base, before = _reading(original, root, after)
    if suffix == ".urdf":
        write_urdf(path, original, before, after)
    else:
        _write_mjcf(path, original, before, after, root, floating_base)


def _reading(original: str | Path, root: str | None, after: Description) -> tuple[bool, Description]:
    """Reading of a file that a description was made of: true if the base floats, and the description."""
    different = f"{original}: does not match {after.name}: its joints, frames or names differ"
    errors: list[AdaptctlError] = []
    for floating_base in (False, True):
        try:
            before = read(original, root=root, floating_base=floating_base)
        except InputError as error:
            errors.append(error)
            continue
        for one in (before, snapped(before, ROUNDED_ANGLE)):
            if one.geometry_sha256 == after.geometry_sha256:
                return floating_base, one
    raise FileError(different) if len(errors) < 2 else errors[0]


def write_urdf(path: str | Path, original: str | Path, before: Description, after: Description) -> None:
    """Write a copy of a URDF file with other inertias, and the friction of drives in <dynamics> where it differs."""
    data = read_bytes(original)
    text = xml_text(original, data)
    try:
        robot = parsed(text, "robot")
        elements = {element.attrib["name"]: element for element in robot.findall("link")}
        fixed = _still_below(robot, before.joint_names)
        changed: dict[str, Array | None] = {}
        links = zip(before.links, after.links, strict=True)
        for old, new in ((old, new) for old, new in links if not old.massless):
            others = old.inertia - link_inertia(elements[old.name])
            rest = new.inertia - others
            if np.any(others) and not is_physically_consistent(rest):
                rest = new.inertia
                changed |= dict.fromkeys(_all_below(fixed, old.name))
            if rest[0] == 0.0 and np.any(rest):
                raise InputError(f"link {old.name!r}: URDF does not support inertia without mass")
            changed[old.name] = rest
    except InputError as error:
        raise FileError(f"{original}: {error}") from error
    write_bytes(path, with_inertials(_with_frictions(data, before, after), changed))


def _with_frictions(data: bytes, before: Description, after: Description) -> bytes:
    """Copy of a URDF file's bytes with other viscous and Coulomb friction of joints."""
    joints = ((old.joint, new.joint) for old, new in zip(before.links, after.links, strict=True))
    terms = {new.name: _friction(new.drive) for old, new in joints if _friction(old.drive) != _friction(new.drive)}
    elements = {name: b'<dynamics damping="%r" friction="%r"/>' % pair for name, pair in terms.items()}
    return _with_elements(data, "joint", "dynamics", elements) if terms else data


def _friction(drive: Drive) -> tuple[float, float]:
    return float(drive.viscous or 0.0), float(drive.coulomb or 0.0)


def with_inertials(data: bytes, inertias: Mapping[str, Array | None]) -> bytes:
    """Copy of a URDF file's bytes with some <inertial> elements replaced."""
    elements = {name: b"" if ten is None else _urdf_inertial(ten) for name, ten in inertias.items()}
    return _with_elements(data, "link", "inertial", elements)


def with_comment(data: bytes, comment: str) -> bytes:
    """Copy of a URDF file's bytes with a comment at the start of <robot>."""
    (span,) = _Finder.spans_of(data, "robot", nested=True).values()
    text = b"\n  <!-- " + comment.replace("--", "- -").encode() + b" -->"
    return data if span.empty else _edited(data, [(span.start, span.start, text)])


def _with_elements(data: bytes, tag: str, inner: str, elements: Mapping[str, bytes]) -> bytes:
    """Copy of a file's bytes with other inner elements of those that have a tag and a name; an empty one is removed."""
    spans = _Finder.spans_of(data, tag, nested=False, inner=inner)
    edits = []
    for name, new in elements.items():
        span = spans[name]
        if span.inner is not None:
            edits.append((*span.inner, new))
        elif new and span.empty:
            edits.append((span.start - 2, span.start, b">\n    " + new + f"\n  </{tag}>".encode()))
        elif new:
            edits.append((span.start, span.start, b"\n    " + new))
    return _edited(data, edits)


def _still_below(robot: Element, moving: Collection[str]) -> dict[str, list[str]]:
    """Links that fixed and locked joints hold, by the links before them."""
    below: dict[str, list[str]] = {}
    for joint in robot.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if joint.get("name") not in moving and parent is not None and child is not None:
            below.setdefault(parent.attrib["link"], []).append(child.attrib["link"])
    return below


def _all_below(fixed: Mapping[str, list[str]], name: str) -> list[str]:
    return [other for child in fixed.get(name, []) for other in (child, *_all_below(fixed, child))]


def _write_mjcf(
    path: str | Path,
    original: str | Path,
    before: Description,
    after: Description,
    root: str | None,
    floating_base: bool,
) -> None:
    """Same for MJCF."""
    data = read_bytes(original)
    try:
        bodies, spans = mjcf_bodies(original, root, floating_base), _Finder.spans_of(data, "body", nested=True)
        edits = []
        for i, (old, new) in enumerate(zip(before.links, after.links, strict=True)):
            if not np.array_equal(old.inertia, new.inertia):
                number, ten = _changed(bodies[i], new.name, new.inertia - old.inertia)
                edits.append(_mjcf_edit(spans[number], _mjcf_inertial(ten)))
    except InputError as error:
        raise FileError(f"{original}: {error}") from error
    write_bytes(path, _edited(data, edits))


def _changed(body: MjcfBody, name: str, difference: Array) -> tuple[int, Array]:
    ten = body.ten + transformed(difference, body.place.inverse)
    if not is_physically_consistent(ten):
        raise InputError(
            f"link {name!r}: its inertia is not physically consistent, as MuJoCo requires; "
            "adaptctl.identifiability.nearest_consistent finds the closest consistent one"
        )
    if body.number is None:
        raise InputError(f"link {name!r}: its body is in an included file or a copy; edit that file instead")
    return body.number, ten


@dataclass
class _Span:
    """Byte offsets of an element's content, and of the inner element that is looked for."""

    start: int
    empty: bool
    inner: tuple[int, int] | None = None


@dataclass
class _Finder:
    """Parser target that finds the spans of a file's elements of one tag."""

    data: bytes
    tag: str
    nested: bool
    inner: str
    spans: dict[str | int, _Span] = field(default_factory=dict)
    path: list[_Span | None] = field(default_factory=list)
    """Of each element that is open, its span; None where it is none of them."""
    element_start: int = 0

    @classmethod
    def spans_of(cls, data: bytes, tag: str, nested: bool, inner: str = "inertial") -> dict[str | int, _Span]:
        parser, finder = expat.ParserCreate(xml_encoding(data) or "utf-8"), cls(data, tag, nested, inner)
        parser.StartElementHandler = lambda tag, attributes: finder.started(tag, attributes, parser.CurrentByteIndex)
        parser.EndElementHandler = lambda tag: finder.ended(tag, parser.CurrentByteIndex)
        parser.Parse(data, True)
        return finder.spans

    def started(self, tag: str, attributes: Mapping[str, str], at: int) -> None:
        self.element_start = at if tag == self.inner else self.element_start
        span = None
        if tag == self.tag and (self.nested or len(self.path) == 1):
            start = self._end_of_tag(at)
            span = _Span(start, self.data[start - 2 : start] == b"/>")
            self.spans[len(self.spans) if self.nested else attributes["name"]] = span
        self.path.append(span)

    def ended(self, tag: str, at: int) -> None:
        self.path.pop()
        if tag == self.inner and self.path and (span := self.path[-1]) is not None:
            first = self._end_of_tag(self.element_start)
            span.inner = (
                self.element_start,
                first if self.data[first - 2 : first] == b"/>" else self._end_of_tag(at),
            )

    def _end_of_tag(self, at: int) -> int:
        """Place behind the tag's ">", not one within quotes."""
        quote = 0
        for i in range(at, len(self.data)):
            byte = self.data[i]
            if quote:
                quote = 0 if byte == quote else quote
            elif byte in b"\"'":
                quote = byte
            elif byte == ord(">"):
                return i + 1
        return len(self.data)


def _edited(data: bytes, edits: Iterable[tuple[int, int, bytes]]) -> bytes:
    for start, end, new in sorted(edits, reverse=True):
        data = data[:start] + new + data[end:]
    return data


def _mjcf_edit(span: _Span, new: bytes) -> tuple[int, int, bytes]:
    if span.inner is not None:
        return (*span.inner, new)
    return (span.start - 2, span.start, b">" + new + b"</body>") if span.empty else (span.start, span.start, new)


def _about_center(ten: Array) -> tuple[str, str, list[str]]:
    """Mass, centre and inertia about it, as texts that are read back the same."""
    mass = float(ten[0])
    center = ten[1:4] / (mass or 1.0)
    six = from_tensor(mass, ten[1:4], about_center(ten))[4:].tolist()
    return repr(mass), " ".join(map(repr, center.tolist())), [repr(x) for x in six]


def _urdf_inertial(ten: Array) -> bytes:
    mass, place, (xx, xy, yy, xz, yz, zz) = _about_center(ten)
    return (
        f'<inertial>\n      <origin xyz="{place}" rpy="0 0 0"/>\n      <mass value="{mass}"/>\n'
        f'      <inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/>\n    </inertial>'
    ).encode()


def _mjcf_inertial(ten: Array) -> bytes:
    mass, place, (xx, xy, yy, xz, yz, zz) = _about_center(ten)
    return f'<inertial pos="{place}" mass="{mass}" fullinertia="{xx} {yy} {zz} {xy} {xz} {yz}"/>'.encode()
