"""Reading XML that strangers wrote: no document types, finite numbers, and errors that name the element."""

from __future__ import annotations

import math
from typing import NoReturn
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from adaptctl.errors import InputError


class _NoDoctype(ElementTree.TreeBuilder):
    """Refuses document types before any entity in them can expand or reach for another file."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> NoReturn:
        raise InputError("a <!DOCTYPE ...> has no place here, and entities are refused: remove it")


def parsed(text: str, tag: str) -> Element:
    """The root element, which must be <tag>."""
    try:
        root = ElementTree.fromstring(text, ElementTree.XMLParser(target=_NoDoctype()))
    except (ElementTree.ParseError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"not well-formed XML ({error})") from error
    if root.tag != tag:
        raise InputError(f"the root element must be <{tag}>, got <{root.tag}>")
    return root


def named(element: Element) -> str:
    """The element as messages call it: ``joint 'hinge'``."""
    return f"{element.tag} {element.attrib['name']!r}" if "name" in element.attrib else f"<{element.tag}>"


def attribute(element: Element, name: str, where: str) -> str:
    """A text that must be there."""
    value = element.get(name)
    if not value:
        raise InputError(f"{where}: <{element.tag}> needs the attribute {name}")
    return value


def number(element: Element, name: str, where: str) -> float:
    """A finite number that must be there."""
    return numbers(element, name, 1, where)[0]


def numbers(element: Element, name: str, count: int | range, where: str) -> list[float]:
    """Finite numbers that must be there, `count` of them or as many as a range allows."""
    text = attribute(element, name, where)
    counts = range(count, count + 1) if isinstance(count, int) else count
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) not in counts or not all(map(math.isfinite, values)) or "_" in text:
        raise InputError(f"{where}: {name} of <{element.tag}>: expected {_wanted(counts)}, got {text!r}")
    return values


def required(element: Element, tag: str, where: str) -> Element:
    """The one child that must be there."""
    found = only(element, tag, where)
    if found is None:
        raise InputError(f"{where}: <{element.tag}> needs an element <{tag}>")
    return found


def only(element: Element, tag: str, where: str) -> Element | None:
    """The one child of this tag, if there is any."""
    found = element.findall(tag)
    if len(found) > 1:
        raise InputError(f"{where}: <{element.tag}> has {len(found)} elements <{tag}>, expected one")
    return found[0] if found else None


def _wanted(counts: range) -> str:
    if counts == range(1, 2):
        return "a finite number"
    least, most = counts[0], counts[-1]
    return f"{least} finite numbers" if least == most else f"{least} to {most} finite numbers"
