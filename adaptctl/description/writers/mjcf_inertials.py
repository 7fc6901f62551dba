"""Writer of MJCF with other inertials: everything else of the file stays as it is, byte for byte."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.inertia import from_tensor, inertia_tensor, is_physically_consistent, transformed
from adaptctl.description.readers.mjcf import MjcfBody, mjcf_bodies
from adaptctl.description.writers.edits import edited, end_of_tag
from adaptctl.errors import FileError, InputError
from adaptctl.files import read_bytes, write_bytes


def write_mjcf(
    path: str | Path, original: str | Path, before: Description, after: Description, root: str | None = None
) -> None:
    """Write to `path` a copy of the MJCF file `original` with the links' inertias of the description `after`; all else
    stays, byte for byte. `before` is the description read from `original` with the same `root`, the name of the
    mechanism's first body, None for the one root body that moves.

    A link's inertia is that of all bodies fixed to each other: the body at its joint gets the whole change, the others
    keep theirs. That body gets an <inertial> where it had geoms only; MuJoCo prefers it to them. Raises `FileError` for
    a file that cannot be read or written, where no rigid body has the inertia that a body would get, where that body
    stands in an included file, and where the compiler setting inertiafromgeom is true, so that inertials are ignored;
    `ValueError` for descriptions with different numbers of links.
    """
    data = read_bytes(original)
    try:
        bodies = mjcf_bodies(original, root)
        spans, changes = _spans(data), dict[int, Array]()
        for i, (old, new) in enumerate(zip(before.links, after.links, strict=True)):
            if not np.array_equal(old.inertia, new.inertia):
                place, ten = _changed(bodies, i, new.name, new.inertia - old.inertia)
                changes[place] = ten
    except InputError as error:
        raise FileError(f"{original}: {error}") from error
    write_bytes(path, edited(data, [_edit(spans[place], ten) for place, ten in changes.items()]))


def _changed(bodies: Mapping[int, MjcfBody], link: int, name: str, difference: Array) -> tuple[int, Array]:
    """The body of a link that takes a change of inertia (10,), by its place in the file, and its new ten."""
    body = bodies[link]
    ten = body.ten + transformed(difference, body.place.inverse)
    if not is_physically_consistent(ten):
        raise InputError(
            f"link {name!r}: no rigid body has its inertia, and MuJoCo reads no other: take the nearest that one has, "
            "adaptctl.identifiability.nearest_consistent"
        )
    if body.number is None:
        raise InputError(f"link {name!r}: its body stands in an included file: write that one")
    return body.number, ten


@dataclass
class _BodySpan:
    """Byte offsets in the file of a body's content and of its <inertial>."""

    start: int
    empty: bool
    inertial: tuple[int, int] | None = None


@dataclass
class _BodyFinder:
    """Parser target that finds the spans of a file's bodies, in its order."""

    data: bytes
    spans: list[_BodySpan] = field(default_factory=list)
    path: list[int | None] = field(default_factory=list)
    """Of each element that is open, the body's number; None where it is no body."""
    begun: int = 0

    def started(self, tag: str, at: int) -> None:
        if tag == "inertial" and self._body is not None:
            self.begun = at
        is_body = tag == "body"
        if is_body:
            start = end_of_tag(self.data, at)
            self.spans.append(_BodySpan(start, self.data[start - 2 : start] == b"/>"))
        self.path.append(len(self.spans) - 1 if is_body else None)

    def ended(self, tag: str, at: int) -> None:
        self.path.pop()
        if tag == "inertial" and self._body is not None:
            first = end_of_tag(self.data, self.begun)
            is_empty = self.data[first - 2 : first] == b"/>"
            self.spans[self._body].inertial = (self.begun, first if is_empty else end_of_tag(self.data, at))

    @property
    def _body(self) -> int | None:
        return self.path[-1] if self.path else None


def _spans(data: bytes) -> list[_BodySpan]:
    parser, finder = expat.ParserCreate(), _BodyFinder(data)
    parser.StartElementHandler = lambda tag, attributes: finder.started(tag, parser.CurrentByteIndex)
    parser.EndElementHandler = lambda tag: finder.ended(tag, parser.CurrentByteIndex)
    parser.Parse(data, True)
    return finder.spans


def _edit(span: _BodySpan, ten: Array) -> tuple[int, int, bytes]:
    """The replacement that gives a body its ten."""
    new = _inertial(ten)
    if span.inertial is not None:
        return (*span.inertial, new)
    return (span.start - 2, span.start, b">" + new + b"</body>") if span.empty else (span.start, span.start, new)


def _inertial(ten: Array) -> bytes:
    mass = float(ten[0])
    center = ten[1:4] / mass
    shift = mass * (np.dot(center, center) * np.eye(3) - np.outer(center, center))
    xx, xy, yy, xz, yz, zz = from_tensor(mass, ten[1:4], inertia_tensor(ten) - shift)[4:].tolist()
    place = " ".join(repr(x) for x in center.tolist())
    full = " ".join(repr(x) for x in (xx, yy, zz, xy, xz, yz))
    return f'<inertial pos="{place}" mass="{mass!r}" fullinertia="{full}"/>'.encode()
