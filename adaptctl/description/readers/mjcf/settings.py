"""Settings of a whole MJCF file: compiler settings, and defaults by class."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from adaptctl.description.readers.xml_elements import like, named, numbers, refuse
from adaptctl.errors import InputError

MAIN = "main"
"""The class of elements that name none and stand in no body with a childclass."""

ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")

_SIMPLIFIED = {
    "settotalmass": "masses are not scaled: scale them in the file",
    "boundmass": "masses are not bounded: write them as they are meant",
    "boundinertia": "inertias are not bounded: write them as they are meant",
}


@dataclass(frozen=True)
class Settings:
    """Compiler settings and default classes of an MJCF file, from its <compiler> and <default> sections, by default
    MuJoCo's own.

    `degrees` is True for angles in degrees, False for rad; `eulerseq` has the three axes of Euler angles, x, y or z for
    axes that turn with the frame, X, Y or Z for fixed ones; `autolimits` is True where a range alone limits a joint,
    without the attribute ``limited``. `inertia_from_geoms` says which bodies' inertias come from geoms: "true" all that
    have geoms, "false" none, "auto" those without an <inertial>; `inertia_groups` are the first and the last group of
    geoms that count for them. `classes` has the attributes that elements inherit, by the name of the default class and
    the elements' tag, with those that the class inherits itself. Nothing is checked at construction.
    """

    degrees: bool = True
    eulerseq: str = "xyz"
    autolimits: bool = True
    inertia_from_geoms: str = "auto"
    inertia_groups: tuple[float, float] = (0.0, 5.0)
    classes: Mapping[str, Mapping[str, Mapping[str, str]]] = field(default_factory=dict)

    @classmethod
    def of(cls, root: Element) -> Settings:
        """The compiler settings and defaults of an MJCF file, from its `root` element. Raises `InputError` for unknown
        values, for a default class without a name, and for compiler settings that are not read: settotalmass,
        boundmass, boundinertia, balanceinertia and global coordinates."""
        compiler: dict[str, str] = {}
        for element in root.findall("compiler"):
            compiler |= element.attrib
        _require_read(compiler)
        merged = Element("compiler", compiler)
        groups = (
            numbers(merged, "inertiagrouprange", 2, "<compiler>") if "inertiagrouprange" in compiler else [0.0, 5.0]
        )
        return cls(
            degrees=_choice(compiler, "angle", ("degree", "radian")) == "degree",
            eulerseq=_eulerseq(compiler.get("eulerseq", "xyz")),
            autolimits=_choice(compiler, "autolimits", ("true", "false")) == "true",
            inertia_from_geoms=_choice(compiler, "inertiafromgeom", ("auto", "true", "false")),
            inertia_groups=(groups[0], groups[1]),
            classes=_classes(root),
        )

    def angle(self, value: float) -> float:
        """The angle in rad of an angle `value` as an MJCF file writes it: in degrees where this object's `degrees` is
        True, else in rad. Nothing is raised."""
        return math.radians(value) if self.degrees else value

    def full(self, element: Element, childclass: str) -> Element:
        """A copy of the MJCF `element` without its children, with its own attributes and, for those it lacks, those of
        its default class. That is the class it names or else `childclass`, the class that its body gives its children.
        Raises `ElementError` for an unknown class."""
        name = element.get("class", childclass)
        if name not in self.classes:
            known = ", ".join(self.classes)
            refuse(element, f"{named(element)}: there is no default class {name!r}; there are {known}")
        defaults = dict(self.classes[name].get(element.tag, {}))
        if any(key in element.attrib for key in ORIENTATIONS):
            defaults = {key: value for key, value in defaults.items() if key not in ORIENTATIONS}
        full = defaults | element.attrib
        if element.tag == "geom" and "size" in element.attrib and "size" in defaults:
            own, inherited = element.attrib["size"].split(), defaults["size"].split()
            full["size"] = " ".join([*own, *inherited[len(own) :]])  # A shorter size keeps the default's rest.
        return like(element, full)


def _require_read(compiler: Mapping[str, str]) -> None:
    for name, remark in _SIMPLIFIED.items():
        if name in compiler and numbers(Element("compiler", dict(compiler)), name, 1, "<compiler>")[0] > 0.0:
            raise InputError(f"<compiler>: {name}: {remark}")
    if compiler.get("balanceinertia") == "true":
        raise InputError("<compiler>: balanceinertia: inertias are not balanced: write them as they are meant")
    if compiler.get("coordinate", "local") != "local":
        raise InputError("<compiler>: coordinate: only local coordinates are read, as by MuJoCo since 2.3.4")


def _choice(attributes: Mapping[str, str], name: str, choices: tuple[str, ...]) -> str:
    value = attributes.get(name, choices[0])
    if value not in choices:
        raise InputError(f"<compiler>: {name}: expected one of {', '.join(choices)}, got {value!r}")
    return value


def _eulerseq(text: str) -> str:
    if len(text) != 3 or set(text.lower()) - set("xyz"):
        raise InputError(f"<compiler>: eulerseq: expected three of x, y, z, X, Y, Z, got {text!r}")
    return text


def _classes(root: Element) -> dict[str, dict[str, dict[str, str]]]:
    """Attributes by class and tag. Classes stand within one another and inherit."""
    classes: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}
    pending = [(element, element.get("class", MAIN), MAIN) for element in root.findall("default")][::-1]
    while pending:
        element, name, above = pending.pop()
        inherited = {tag: dict(attributes) for tag, attributes in classes[above].items()}
        own = classes.setdefault(name, inherited)
        for child in element:
            if child.tag != "default":
                own[child.tag] = own.get(child.tag, {}) | child.attrib
        nested = [child for child in element if child.tag == "default"]
        for child in nested:
            if not child.get("class"):
                raise InputError(f"<default> within class {name!r} needs the attribute class")
        pending += [(child, child.attrib["class"], name) for child in nested[::-1]]
    return classes
