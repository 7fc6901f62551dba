"""Reader of untrusted XML: no document types, bounded, errors with element and line."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from adaptctl.errors import InputError, printable

MAX_ELEMENTS, MAX_DEPTH = 50_000, 600
"""Elements in one file, and their nesting depth."""
MAX_NAME_CHARACTERS, MAX_NUMBERS_CHARACTERS = 256, 4096
"""Characters of a name, and of the text of an attribute that holds numbers."""
MAX_MAGNITUDE = 1e30
"""Magnitude of the numbers that are read, limits apart: products of five of them are doubles still."""

_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")


class ElementError(InputError):
    """Error of a wrong element of an XML file."""


class LineElement(Element):
    """XML element with its line."""

    line = 0


class _Parser:
    """Parser that refuses document types before any entity can expand."""

    def __init__(self) -> None:
        self._expat = expat.ParserCreate(namespace_separator="}")
        self._expat.namespace_prefixes = True
        self._expat.StartNamespaceDeclHandler = self._declared
        self._expat.StartElementHandler = self._start
        self._expat.EndElementHandler = self._end
        self._expat.StartDoctypeDeclHandler = self._doctype
        self._builder = TreeBuilder(element_factory=LineElement)
        self._depth = self._count = 0
        self._default = ""

    def parse(self, text: str) -> Element:
        self._expat.Parse(text, True)
        return self._builder.close()

    def _declared(self, prefix: str | None, uri: str) -> None:
        if prefix is None and self._depth == 0 and "xacro" not in uri:
            self._default = uri

    def _qualified(self, name: str) -> str:
        """Name as `ElementTree` has it, without the root's default namespace."""
        uri, _, local = name.partition("}")
        if not local:
            return name
        local, _, prefix = local.partition("}")
        return local if uri == self._default and not prefix else f"{{{uri}}}{local}"

    def _start(self, tag: str, attributes: Mapping[str, str]) -> None:
        line = self._expat.CurrentLineNumber
        self._depth, self._count = self._depth + 1, self._count + 1
        if self._depth > MAX_DEPTH or self._count > MAX_ELEMENTS:
            what = f"{MAX_ELEMENTS} elements" if self._depth <= MAX_DEPTH else f"{MAX_DEPTH} nested elements"
            raise ElementError(f"<{tag}>: more than {what}, the limit (line {line})")
        element = self._builder.start(self._qualified(tag), {self._qualified(k): v for k, v in attributes.items()})
        element.line = line  # type: ignore[attr-defined]  # Python's own element takes further attributes
        for key in ("name", "model"):
            name = attributes.get(key, "")
            if _CONTROL.search(name) or len(name) > MAX_NAME_CHARACTERS:
                what = f"at most {MAX_NAME_CHARACTERS} printable characters"
                refuse(element, f"<{tag}>: {key}: expected {what}, got {printable(name)!r}")

    def _end(self, tag: str) -> None:
        self._depth -= 1
        self._builder.end(self._qualified(tag))

    def _doctype(self, *given: object) -> NoReturn:
        raise InputError("<!DOCTYPE ...> and entities are not supported; remove them")


def parsed(text: str, tag: str, *others: str) -> Element:
    """Root element of an XML document, which must have an expected tag."""
    if "\0" in text:
        raise InputError("contains NUL characters, as UTF-16 text does; save the file as UTF-8 text")
    try:
        root = _Parser().parse(text)
    except (expat.ExpatError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"not well-formed XML ({error})") from error
    if root.tag not in (tag, *others):
        refuse(root, f"the root element must be <{tag}>, got <{root.tag}>")
    return root


def line_of(element: Element) -> int:
    """Line at which an element begins; 0 where unknown."""
    return getattr(element, "line", 0)


def like(element: Element, attributes: Mapping[str, str], tag: str = "") -> Element:
    """New XML element with the line of another and by default its tag."""
    copy = LineElement(tag or element.tag, dict(attributes))
    copy.line = line_of(element)
    return copy


def refuse(element: Element, message: str) -> NoReturn:
    """Raise an `ElementError` that names the line of an element, where known."""
    raise ElementError(f"{message} (line {line})" if (line := line_of(element)) else message)


@contextmanager
def located(element: Element) -> Iterator[None]:
    """Context in which an `InputError` becomes an `ElementError` with the line of an element."""
    try:
        yield
    except ElementError:
        raise
    except InputError as error:
        refuse(element, str(error))


def named(element: Element) -> str:
    """Name of an `element` for messages."""
    return f"{element.tag} {element.attrib['name']!r}" if "name" in element.attrib else f"<{element.tag}>"


def attribute(element: Element, name: str, where: str) -> str:
    """Text of the attribute `name` of an `element`."""
    value = element.get(name)
    if not value:
        refuse(element, f"{where}: <{element.tag}> needs the attribute {name}")
    return value


def number(element: Element, name: str, where: str, largest: float = MAX_MAGNITUDE) -> float:
    """Finite number in an attribute of an element."""
    return numbers(element, name, 1, where, largest)[0]


def numbers(element: Element, name: str, count: int | range, where: str, largest: float = MAX_MAGNITUDE) -> list[float]:
    """Finite numbers in an attribute of an element, separated by spaces."""
    text = attribute(element, name, where)
    counts = range(count, count + 1) if isinstance(count, int) else count
    readable = len(text) <= MAX_NUMBERS_CHARACTERS and text.isascii() and "_" not in text
    try:
        values = [float(word) for word in text.split()] if readable else []
    except ValueError:
        values = []
    if len(values) not in counts or not all(map(math.isfinite, values)):
        refuse(element, f"{where}: {name} of <{element.tag}>: expected {_wanted(counts)}, got {text!r}")
    if max(map(abs, values)) > largest:
        refuse(element, f"{where}: {name} of <{element.tag}>: expected at most {largest:g}, got {text!r}")
    return values


def required(element: Element, tag: str, where: str) -> Element:
    """One child of an `element` that has the given `tag`."""
    found = only(element, tag, where)
    if found is None:
        refuse(element, f"{where}: <{element.tag}> needs an element <{tag}>")
    return found


def only(element: Element, tag: str, where: str) -> Element | None:
    """Child with the given tag, None where there is none."""
    found = element.findall(tag)
    if len(found) > 1:
        refuse(found[1], f"{where}: <{element.tag}> has {len(found)} elements <{tag}>, expected one")
    return found[0] if found else None


def _wanted(counts: range) -> str:
    if counts == range(1, 2):
        return "a finite number"
    least, most = counts[0], counts[-1]
    return f"{least} finite numbers" if least == most else f"{least} to {most} finite numbers"
