"""Reader of untrusted XML: no document types, bounded, errors with element and line."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from adaptctl.errors import InputError, printable, shown
from adaptctl.files import decoded, read_bytes

MAX_ELEMENTS, MAX_DEPTH = 50_000, 600
"""Elements in one file, and their nesting depth."""
MAX_NAME_CHARACTERS, MAX_NUMBERS_CHARACTERS = 256, 4096
"""Characters of a name, and of the text of an attribute that holds numbers."""
MAX_MAGNITUDE = 1e30
"""Magnitude of the numbers that are read, limits apart: products of five of them are doubles still."""

ENCODINGS = ("iso-8859-1", "latin-1", "latin1", "iso-8859-15", "windows-1252", "cp1252")
"""encodings that are read where a file declares them and is not UTF-8"""
_DECLARED = re.compile(rb"\s*<\?xml[^>]{0,200}?\sencoding\s*=\s*[\"']([A-Za-z0-9._-]{1,40})[\"']")
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")


class ElementError(InputError):
    """Error of a wrong element of an XML file."""


class LineElement(Element):
    """XML element with its line."""

    line = 0


class _Parser:
    """Parser that refuses document types before any entity can expand; elements of undeclared prefixes keep them."""

    def __init__(self) -> None:
        self._expat = expat.ParserCreate()
        self._expat.StartElementHandler = self._start
        self._expat.EndElementHandler = self._end
        self._expat.StartDoctypeDeclHandler = self._doctype
        self._builder = TreeBuilder(element_factory=LineElement)
        self._count = 0
        self._scopes: list[Mapping[str, str]] = [{"xml": "http://www.w3.org/XML/1998/namespace"}]
        self._default = ""

    def parse(self, text: str) -> Element:
        self._expat.Parse(text, True)
        return self._builder.close()

    def _enter(self, attributes: Mapping[str, str]) -> None:
        """Add a scope of the namespaces that an element declares."""
        spaces = {k.partition(":")[2]: uri for k, uri in attributes.items() if k == "xmlns" or k.startswith("xmlns:")}
        if len(self._scopes) == 1 and "xacro" not in spaces.get("", ""):
            self._default = spaces.get("", "")
        self._scopes.append({**self._scopes[-1], **spaces} if spaces else self._scopes[-1])

    def _qualified(self, name: str, default: str = "") -> str:
        """Name as `ElementTree` has it, without the root's default namespace."""
        prefix, _, local = name.rpartition(":")
        uri = self._scopes[-1].get(prefix, "") if prefix else default
        return f"{{{uri}}}{local}" if uri and (prefix or uri != self._default) else name

    def _start(self, tag: str, attributes: Mapping[str, str]) -> None:
        line = self._expat.CurrentLineNumber
        depth, self._count = len(self._scopes), self._count + 1
        if depth > MAX_DEPTH or self._count > MAX_ELEMENTS:
            what = f"{MAX_ELEMENTS} elements" if depth <= MAX_DEPTH else f"{MAX_DEPTH} nested elements"
            raise ElementError(f"<{tag}>: more than {what}, the limit (line {line})")
        self._enter(attributes)
        plain = {self._qualified(k): v for k, v in attributes.items() if k != "xmlns" and not k.startswith("xmlns:")}
        element = self._builder.start(self._qualified(tag, self._scopes[-1].get("", "")), plain)
        element.line = line  # type: ignore[attr-defined]  # Python's own element takes further attributes
        for key in ("name", "model"):
            name = attributes.get(key, "")
            if _CONTROL.search(name) or len(name) > MAX_NAME_CHARACTERS:
                what = f"at most {MAX_NAME_CHARACTERS} printable characters"
                refuse(element, f"<{tag}>: {key}: expected {what}, got {printable(name)!r}")

    def _end(self, tag: str) -> None:
        self._builder.end(self._qualified(tag, self._scopes.pop().get("", "")))

    def _doctype(self, *given: object) -> NoReturn:
        raise InputError("<!DOCTYPE ...> and entities are not supported; remove them")


def read_xml(path: str | Path) -> str:
    """Text of an XML file in UTF-8 or the encoding of one byte a character that it declares."""
    return xml_text(path, read_bytes(path))


def xml_text(path: str | Path, data: bytes) -> str:
    """Text of an XML file's bytes."""
    encoding = xml_encoding(data)
    return data.decode(encoding, errors="replace") if encoding else decoded(path, data)


def xml_encoding(data: bytes) -> str | None:
    """Declared encoding, one of `ENCODINGS`, of XML that is not UTF-8; else None."""
    declared = _DECLARED.match(data)
    name = declared[1].decode().lower() if declared is not None else ""
    if name not in ENCODINGS:
        return None
    try:
        data.decode()
    except UnicodeDecodeError:
        return name
    return None


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
        refuse(element, f"{where}: {name} of <{element.tag}>: expected {_wanted(counts)}, got {shown(text)}")
    if max(map(abs, values)) > largest:
        refuse(element, f"{where}: {name} of <{element.tag}>: expected at most {largest:g}, got {shown(text)}")
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


def element_of(place: str, elements: Sequence[Element]) -> Element:
    """Element on the line that MuJoCo names, one of those that it was shown a line each."""
    found = re.findall(r"line (\d+)", place)
    k = int(found[-1]) if found else 0
    return elements[k - 1] if 0 < k <= len(elements) else LineElement("")
