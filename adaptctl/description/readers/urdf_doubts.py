"""Doubts about a URDF file that can be read, but hardly means what it says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.description.link import Link, weightless_ends
from adaptctl.description.readers.entries import is_more_than_a_turn
from adaptctl.description.readers.xml_elements import named, numbers
from adaptctl.errors import InputError

MAX_LENGTH = 20.0
"""Distance (m) from a link to its next joint or centre of mass that no robot has."""
LIMITED = ("revolute", "prismatic")
"""Types of joints that URDF requires to have limits."""
GIVE_INERTIAL = "moving links without <inertial> are taken as massless; give mass, centre and inertia in <inertial>"
GIVE_LIMIT = "joints without <limit>, which URDF requires, are read without limits; give lower, upper, velocity, effort"
IN_METRES = "lengths are read in metres, but look like millimetres"


def massless(links: Sequence[Link], bodies: Mapping[str, Element]) -> list[str]:
    """Links without <inertial> that hold others at a distance, unlike the bodies within a joint of several axes."""
    if not any(np.any(link.inertia) for link in links):
        return []
    long = {link.parent for link in links if np.any(link.parent_to_joint.translation)}
    ends = weightless_ends(links)
    return [
        link.name
        for i, link in enumerate(links)
        if i in long and link.name not in ends and not np.any(link.inertia) and _is_bare(bodies[link.name])
    ]


def unlimited(joints: Iterable[Element]) -> list[str]:
    """Joints without <limit> in a file that gives limits of others; those that mimic have their leaders'."""
    needing = [joint for joint in joints if joint.get("type") in LIMITED and joint.find("mimic") is None]
    bare = [joint.attrib["name"] for joint in needing if joint.find("limit") is None]
    return bare if len(bare) < len(needing) else []


def lengthy(parts: Iterable[Element]) -> list[str]:
    """Origins of joints and inertias so far away that their lengths may be millimetres."""
    return [text for part in parts for text in _far(part)]


def turned(robot: Element) -> list[str]:
    """Angles of origins that may be degrees."""
    placed = ((part, origin) for part in robot.iter() for origin in part.findall("origin") if "rpy" in origin.attrib)
    return [f"rpy of {named(part)}" for part, origin in placed if is_more_than_a_turn(_triple(origin, "rpy"))]


def _is_bare(body: Element) -> bool:
    return body.find("inertial") is None


def _far(part: Element) -> Iterator[str]:
    for owner in (part, *part.findall("inertial")):
        for origin in owner.findall("origin"):
            if (most := max(map(abs, _triple(origin, "xyz")))) > MAX_LENGTH:
                yield f"origin of {named(part)} at {most:g} m"


def _triple(origin: Element, key: str) -> Sequence[float]:
    try:
        return numbers(origin, key, 3, "<origin>")
    except InputError:  # of what is not read
        return [0.0]
