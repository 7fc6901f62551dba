"""Part of an MJCF file that MuJoCo is shown, with checked numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from adaptctl.description.readers.entries import MAX_BODIES, MAX_GEOMS, MAX_LINKS
from adaptctl.description.readers.xml_elements import (
    MAX_ELEMENTS,
    MAX_MAGNITUDE,
    attribute,
    like,
    named,
    number,
    numbers,
    parsed,
    read_xml,
    refuse,
)
from adaptctl.errors import InputError, printable

MAX_FILES = 100
"""files that one scene may consist of"""

_ACTUATORS = ("motor", "general", "position", "velocity", "intvelocity", "damper")
_IN_FRAMES = ("body", "frame", "replicate", "joint", "freejoint", "geom", "site")
_SHOWN: Mapping[str, tuple[str, ...]] = {
    "mujoco": ("compiler", "option", "default", "asset", "worldbody", "equality", "actuator"),
    "option": ("flag",),
    "default": ("default", "joint", "geom", "site", "equality", "mesh", *_ACTUATORS),
    "asset": ("mesh",),
    "worldbody": _IN_FRAMES,
    "body": (*_IN_FRAMES, "inertial"),
    "frame": _IN_FRAMES,
    "replicate": _IN_FRAMES,
    "equality": ("connect", "weld", "joint"),
    "actuator": _ACTUATORS,
}
"""Elements within others that MuJoCo is shown."""
_LEFT_OUT: Mapping[str, tuple[str, ...]] = {
    "mujoco": (
        *("size", "visual", "statistic", "contact", "deformable", "tendon", "sensor", "keyframe", "custom"),
        "extension",
    ),
    **dict.fromkeys(("worldbody", "body", "frame", "replicate"), ("camera", "light")),
    "equality": (),
}
"""Elements that it need not see. Others are refused within these, and left out within all others."""
_WRITTEN_OUT = dict.fromkeys(("attach", "composite"), "mujoco.mj_saveLastXML writes the scene without it")
_UNREAD_EQUALITIES = ("tendon", "flex", "flexvert", "flexstrain", "distance")
_PLACE = ("pos", "quat", "axisangle", "xyaxes", "zaxis", "euler")
_OF_ACTUATORS = (
    *("name", "class", "joint", "jointinparent", "gear", "ctrlrange", "ctrllimited", "forcerange", "forcelimited"),
    *("dyntype", "gaintype", "biastype", "gainprm", "biasprm", "kp", "kv"),
)
_ATTRIBUTES: Mapping[str, tuple[str, ...]] = {
    "mujoco": ("model",),
    "option": ("gravity",),
    "flag": ("gravity", "equality"),
    "geom": ("name", "class", "type", "size", "fromto", "mass", "density", "shellinertia", "group", "mesh", *_PLACE),
    "site": ("name", "class", "type", "size", "fromto", *_PLACE),
    "mesh": ("name", "class", "file", "content_type", "scale", "refpos", "refquat", "inertia", "vertex", "face"),
    **dict.fromkeys(_ACTUATORS, _OF_ACTUATORS),
}
"""The attributes that it is shown of these elements; of others all but those that follow."""
_UNSEEN = (
    *("user", "discardvisual", "fusestatic", "usethread", "meshdir", "assetdir", "texturedir", "strippath"),
    *("alignfree", "saveinertial", "settotalmass", "boundmass", "boundinertia", "balanceinertia", "coordinate"),
)
_TEXTS = frozenset(
    (
        *("name", "class", "childclass", "model", "file", "content_type", "mesh", "joint", "jointinparent", "joint1"),
        *("joint2", "body1", "body2", "site1", "site2", "type", "limited", "ctrllimited", "forcelimited", "equality"),
        *("actuatorfrclimited", "actuatorgravcomp", "dyntype", "gaintype", "biastype", "active", "mocap", "sleep"),
        *("simple", "fuse", "align", "sep", "angle", "eulerseq", "autolimits", "inertiafromgeom", "shellinertia"),
        *("conflict", "fitaabb", "passthrough", "savecanonical", "savecompiled", "inertia"),
    )
)
"""Attributes that are no numbers."""
_COUNTS = {
    **dict.fromkeys(("mass", "ref", "armature", "frictionloss", "density", "gravcomp", "count"), 1),
    **dict.fromkeys(("range", "ctrlrange", "forcerange", "actuatorfrcrange", "inertiagrouprange"), 2),
    **dict.fromkeys(("pos", "zaxis", "euler", "axis", "anchor", "diaginertia"), 3),
    **dict.fromkeys(("quat", "axisangle"), 4),
    **dict.fromkeys(("xyaxes", "fullinertia", "fromto"), 6),
    "relpose": 7,
}
"""How many numbers attributes have, where this is always the same."""
_BOUNDS = ("range", "ctrlrange", "forcerange", "actuatorfrcrange")
_LIKE_A_NUMBER = re.compile(r"[-+.]*(\d|nan|inf)", re.IGNORECASE)
_SIMPLIFIED = {
    "settotalmass": "not supported: scale the masses in the file",
    "boundmass": "not supported; write the final masses in the file",
    "boundinertia": "not supported; write the final inertias in the file",
}


@dataclass(eq=False)
class ScannedFile:
    """An MJCF file of which only what motion depends on is left."""

    root: Element
    folder: Path
    meshes: dict[str, Element] = field(default_factory=dict)
    numbers: dict[str, int] = field(default_factory=dict)
    tendons: tuple[str, ...] = ()

    @classmethod
    def of(cls, path: str | Path, whole: bool = True) -> ScannedFile:
        """The MJCF file at `path`, parsed, with what it includes."""
        root = parsed(read_xml(path), "mujoco")
        own = {id(body): k for k, body in enumerate(root.iter("body"))}
        _include(root, path)
        _validate_read(root)
        tendons = tuple(named(tendon) for section in root.findall("tendon") for tendon in section)
        meshes = _meshes(root, Path(path).parent)
        _validate_equalities(root, whole)
        pending = [root]
        while pending:
            _leave_out(element := pending.pop())
            _check_numbers(element)
            pending += element
        _validate_few(root)
        _name_bodies(root)
        numbers_of = {body.attrib["name"]: own[id(body)] for body in root.iter("body") if id(body) in own}
        return cls(root, Path(path).parent, meshes, numbers_of, tendons)

    def text(self, meshes: Collection[str] = ()) -> tuple[str, list[Element]]:
        """Text of the file for MuJoCo, and its elements, one on each line."""
        assets = Element("asset")
        assets.extend(self.meshes[name] for name in meshes)
        root = like(self.root, self.root.attrib)
        root.extend([*self.root, assets])
        elements = list(root.iter())
        for element in elements:
            element.text = "\n"
        return ElementTree.tostring(root, encoding="unicode"), elements


def _include(root: Element, path: str | Path) -> None:
    folder, seen = Path(path).parent, {Path(path).resolve()}
    pending = [root]
    while pending:
        element = pending.pop()
        for child in [child for child in element if child.tag == "include"]:
            if len(seen) >= MAX_FILES:
                refuse(child, f"<include>: more than {MAX_FILES} files, the limit")
            place = list(element).index(child)
            element[place : place + 1] = _content(child, folder, seen)
            pending.append(element)
        pending += [child for child in element if len(child)]
    if sum(1 for _ in root.iter()) > MAX_ELEMENTS:
        raise InputError(f"more than {MAX_ELEMENTS} elements, included files counted: above the limit")


def _content(element: Element, folder: Path, seen: set[Path]) -> list[Element]:
    name = attribute(element, "file", "<include>")
    file = validate_within(folder, element)
    if file in seen:
        refuse(element, f"<include>: {printable(name)!r} is included twice; remove one")
    seen.add(file)
    try:
        return list(parsed(read_xml(file), "mujocoinclude", "mujoco"))
    except InputError as error:
        text = str(error).removeprefix(f"{file}: ")
        raise InputError(f"<include> of {printable(name)!r}: {text}") from error


def validate_within(folder: Path, element: Element) -> Path:
    """Path of a file that an element names, in or below the folder."""
    name = element.get("file", "")
    try:
        file = (folder / name).resolve()
    except (OSError, ValueError, RuntimeError):
        file = Path()
    if not file.is_relative_to(folder.resolve()):
        refuse(element, f"{named(element)}: {printable(name)!r} is outside the file's folder; move it there")
    return file


def _validate_read(root: Element) -> None:
    compiler: dict[str, str] = {}
    for element in root.findall("compiler"):
        compiler |= element.attrib
    merged = like(root, compiler, "compiler")
    for name, remark in _SIMPLIFIED.items():
        if name in compiler and number(merged, name, "<compiler>") > 0.0:
            raise InputError(f"<compiler>: {name}: {remark}")
    if compiler.get("balanceinertia") == "true":
        raise InputError("<compiler>: balanceinertia: not supported; write the final inertias in the file")
    if not re.fullmatch("[xyzXYZ]{3}", compiler.get("eulerseq", "xyz")):
        raise InputError(f"<compiler>: eulerseq: expected three of x, y, z, X, Y, Z, got {compiler['eulerseq']!r}")
    if compiler.get("coordinate", "local") != "local":
        raise InputError("<compiler>: coordinate: expected 'local', as in MuJoCo since 2.3.4")


def _meshes(root: Element, folder: Path) -> dict[str, Element]:
    settings: dict[str, str] = {}
    for compiler in root.findall("compiler"):
        settings |= compiler.attrib
    place = settings.get("meshdir", settings.get("assetdir", ""))
    found = {}
    for mesh in (mesh for section in root.findall("asset") for mesh in section.findall("mesh")):
        _leave_out(mesh)
        _check_numbers(mesh)
        if file := mesh.get("file", ""):
            mesh.set("name", mesh.get("name") or Path(file).stem)
            mesh.set("file", str(folder.resolve() / place / (Path(file).name if _strips(settings) else file)))
        found[mesh.get("name", "")] = mesh
    for section in root.findall("asset"):
        root.remove(section)
    return found


def _strips(settings: Mapping[str, str]) -> bool:
    return settings.get("strippath") == "true"


def _validate_equalities(root: Element, whole: bool) -> None:
    """Take out equalities that do not act or are of the rest of a scene."""
    off = any(flag.get("equality") == "disable" for flag in root.iter("flag"))
    for section in root.findall("equality"):
        for k, element in enumerate(list(section)):
            if element.tag in _SHOWN["equality"]:
                continue
            if element.tag not in _UNREAD_EQUALITIES or (whole and not off and element.get("active") != "false"):
                said = "is not supported" if element.tag in _UNREAD_EQUALITIES else "is unknown"
                where = f"equality {element.get('name') or f'{element.tag}{k + 1}'!r}"
                known = ", ".join(_SHOWN["equality"])
                refuse(element, f"{where}: <{element.tag}> {said}; supported: {known}")
            section.remove(element)


def _leave_out(element: Element) -> None:
    """Take out what MuJoCo is not shown."""
    shown, left_out = _SHOWN.get(element.tag, ()), _LEFT_OUT.get(element.tag)
    for child in [child for child in element if child.tag not in shown]:
        if left_out is not None and child.tag not in left_out and not _is_foreign(child.tag):
            where = "" if element.tag == "mujoco" else f"{named(element)}: "
            way = f"; {_WRITTEN_OUT[child.tag]}" if child.tag in _WRITTEN_OUT else ""
            refuse(child, f"{where}<{child.tag}> is not supported; supported: {', '.join((*shown, *left_out))}{way}")
        if element.tag == "actuator":
            child.tag = "general"
            child.attrib["biastype"] = "affine"
        else:
            element.remove(child)
    if element.tag == "actuator":
        element[:] = [child for child in element if child.get("joint") or child.get("jointinparent")]
    kept = _ATTRIBUTES.get(element.tag)
    for name in list(element.attrib):
        if name in _UNSEEN or _is_foreign(name) or (kept is not None and name not in kept):
            del element.attrib[name]


def _is_foreign(name: str) -> bool:
    """True for a name with a prefix, which no MJCF has."""
    return (":" in name or name.startswith("{")) and "xacro" not in name


def _check_numbers(element: Element) -> None:
    """Check that numbers have a robot's size, masses are not negative and ranges rise."""
    for name, text in element.attrib.items():
        if name in _TEXTS or (element.tag == "flag" and name == "gravity"):
            continue
        if name not in _COUNTS and text.strip() and not any(map(_LIKE_A_NUMBER.match, text.split())):
            continue  # MuJoCo says what is wrong with it
        largest = math.inf if name in _BOUNDS else MAX_MAGNITUDE
        values = numbers(element, name, _COUNTS.get(name, range(1, 4097)), named(element), largest)
        if name in ("mass", "density") and values[0] < 0.0:
            refuse(element, f"{named(element)}: {name} must not be negative, got {values[0]}")
        if name in _BOUNDS and element.get(_limited(name)) != "false":
            least, most = values
            if least > most or (name == "range" and least == most):
                refuse(element, f"{named(element)}: {name}: expected lower < upper, got {least:g} and {most:g}")


def _limited(name: str) -> str:
    return name.replace("range", "limited")


def _validate_few(root: Element) -> None:
    """Bound what MuJoCo's time and memory grow with."""
    most = {"body": MAX_BODIES, "joint": MAX_BODIES, "freejoint": MAX_BODIES, "geom": MAX_GEOMS, "site": MAX_GEOMS}
    counts = dict.fromkeys(most, 0)
    pending = [(world, 1, 0) for world in root.findall("worldbody")]
    while pending:
        element, copies, above = pending.pop()
        if element.tag == "replicate":
            copies *= math.ceil(max(1.0, number(element, "count", named(element))))
        if element.tag in counts:
            counts[element.tag] += copies
            if counts[element.tag] > most[element.tag]:
                refuse(element, f"more than {most[element.tag]} <{element.tag}> elements, the limit")
        if element.tag == "body":
            above += sum(6 if x.tag == "freejoint" else 1 for x in _inside(element) if x.tag.endswith("joint"))
        if above > MAX_LINKS:
            refuse(element, f"{named(element)}: {above} moving links, above the limit of {MAX_LINKS}")
        pending += [(child, copies, above) for child in element]


def _inside(body: Element) -> Iterator[Element]:
    pending = list(body)
    while pending:
        element = pending.pop()
        yield element
        if element.tag in ("frame", "replicate"):
            pending += list(element)


def _name_bodies(root: Element) -> None:
    names = {body.get("name") for body in root.iter("body")}
    for k, body in enumerate(root.iter("body")):
        if not body.get("name"):
            name = f"body{k + 2}"
            while name in names:
                name += "_"
            body.set("name", name)
