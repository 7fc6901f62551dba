"""Reader of MJCF by MuJoCo's own parser."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn
from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.pose import Pose
from adaptctl.description.readers.entries import MAX_LINKS, validate_at_most, warn_of_degrees
from adaptctl.description.readers.mjcf_joints import Rewriting
from adaptctl.description.readers.mjcf_scan import ScannedFile, validate_within
from adaptctl.description.readers.mujoco_arm import MujocoArm, body_ten, mujoco_package
from adaptctl.description.readers.mujoco_model import loops_of
from adaptctl.description.readers.xml_elements import element_of, named, refuse
from adaptctl.errors import FileError, InputError, printable

if TYPE_CHECKING:
    import mujoco

MAX_MESH_SECONDS, MAX_MESH_MEMORY = 20, 4 * 2**30
"""s and bytes that reading meshes may take"""
_BODIES = ("body_mass", "body_ipos", "body_iquat", "body_inertia")
"""What a model says of bodies' inertias."""


def read_mjcf(path: str | Path, *, root: str | None = None, floating_base: bool = False) -> Description:
    """
    Read a mechanism from an MJCF file, with the loops that its equalities close.

    Parameters
    ----------
    path : str or Path
        MJCF file. Files that it includes, and meshes of inertias, are read from its folder or below.
    root : str, optional
        Name of the body at which the mechanism begins; its descendants are included. Default: the only root body that
        moves.
    floating_base : bool, default False
        If true, that body floats on three slides and three hinges, with endings `_x` to `_roll`, named after its free
        joint or itself. By default it is held still.

    Returns
    -------
    Description
        Links are named after bodies, with frames at the joints. A ball joint becomes three hinges, `_yaw`, `_pitch` and
        `_roll`. In loops, driven joints are primary, and others that these do not determine.

    Raises
    ------
    FileError
        If the file cannot be read, MuJoCo refuses it, `root` is unknown or on a moving body, or a joint is not
        supported (several moving roots); the message names the element.
    MissingExtraError
        If MuJoCo is not installed.

    Warns
    -----
    SimplificationWarning
        If a base is held, no actuator drives a joint, bent springs, tendons or gravity compensation are left out,
        actuators command no torque, or angles look like degrees.

    Notes
    -----
    Fixed bodies are merged into their parents; a body with several joints becomes as many links, of which only the last
    has mass. Armature, damping, dry friction and a joint's spring become terms of its drive, where not zero. See
    :doc:`/robots`.

    Examples
    --------
    >>> from adaptctl.description import read_mjcf
    >>> file = tmp / "pendulum.xml"
    >>> _ = file.write_text('''<mujoco><worldbody><body name="rod"><joint name="hinge" axis="0 1 0"/>
    ... <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -1"/></body></worldbody></mujoco>''')
    >>> read_mjcf(file).joint_names
    ('hinge',)
    """
    try:
        scanned = ScannedFile.of(path, whole=root is None)
        arm, changed = _arm(scanned, root, floating_base)
        links = tuple(arm.links())
        validate_at_most(len(links), MAX_LINKS, "moving links")
        loops = loops_of(arm, links, str(path), changed.floating)
        name = scanned.root.get("model") or Path(path).stem
        made = Description(name, links, arm.gravity, f"MJCF file {Path(path).name}", loops)
    except FileError:
        raise
    except InputError as error:
        raise FileError(f"{path}: {error}") from error
    arm.warn(
        str(path),
        links,
        ("tendons are ignored", scanned.tendons),
        ("friction, armature, limits and actuators of ball and free joints are ignored", changed.ignored),
        arm.undriven(links, loops, changed.floating),
    )
    warn_of_degrees(path, links, ())
    return made


@dataclass(frozen=True, eq=False)
class MjcfBody:
    """Body of an MJCF file with its own inertia."""

    number: int | None
    ten: Array
    place: Pose


def mjcf_bodies(path: str | Path, root: str | None = None, floating_base: bool = False) -> dict[int, MjcfBody]:
    """Bodies of an MJCF file with their own inertias, by link index."""
    scanned = ScannedFile.of(path, whole=root is None)
    if any(compiler.get("inertiafromgeom") == "true" for compiler in scanned.root.findall("compiler")):
        raise InputError(
            "<compiler>: inertiafromgeom: expected 'auto', got 'true', which ignores the <inertial> elements"
        )
    arm, _ = _arm(scanned, root, floating_base)
    arm.links()
    return {
        arm.carriers[i]: MjcfBody(scanned.numbers.get(arm.body_name(i)), body_ten(arm.model, i), arm.places[i])
        for i in arm.bodies
        if arm.model.body_jntnum[i]
    }


def _arm(scanned: ScannedFile, root: str | None, floating_base: bool) -> tuple[MujocoArm, Rewriting]:
    mj = mujoco_package("MJCF")
    text, elements = scanned.text()
    with _mujocos_errors(elements):
        spec = mj.MjSpec.from_string(text)
        changed = Rewriting.of(spec, elements, root, floating_base)
        meshes = _need_meshes(spec, kept=False)
        model = spec.compile()
    if meshes:
        _add_mesh_inertias(model, scanned, meshes)
    known: dict[object, Element] = {body.attrib["name"]: body for body in scanned.root.iter("body")}
    equalities = [element for section in scanned.root.findall("equality") for element in section]
    return MujocoArm.of(model, root, known | dict(enumerate(equalities)), changed.held), changed


@contextmanager
def _mujocos_errors(elements: Sequence[Element]) -> Iterator[None]:
    """Context in which MuJoCo's errors name the element and its line in the file."""
    fatal = mujoco_package().FatalError
    try:
        yield
    except InputError:
        raise
    except (ValueError, fatal) as error:
        _refuse(str(error), elements)


def _refuse(error: str, elements: Sequence[Element]) -> NoReturn:
    lines = error.splitlines() or ["no reason given"]
    text = f"MuJoCo: {printable(re.sub(r'^(XML Error: |Error: |Schema violation: )+', '', lines[0]), 200)}"
    element = element_of(lines[-1], elements)
    refuse(element, f"{named(element)}: {text}" if element.tag else text)


def _need_meshes(spec: mujoco.MjSpec, kept: bool) -> dict[str, str]:
    """Meshes on which inertias depend."""
    mj, needed = mujoco_package(), dict[str, str]()
    ways, (first, last) = mj.mjtInertiaFromGeom, spec.compiler.inertiagrouprange
    way = spec.compiler.inertiafromgeom
    for geom in spec.geoms:
        written = geom.parent.explicitinertial if way == ways.mjINERTIAFROMGEOM_AUTO else False
        ignored = written or way == ways.mjINERTIAFROMGEOM_FALSE or _stands(geom.parent)
        weighs = (geom.mass if math.isfinite(geom.mass) else geom.density) != 0.0
        shape = geom.type not in (mj.mjtGeom.mjGEOM_PLANE, mj.mjtGeom.mjGEOM_HFIELD)
        counts = not ignored and weighs and shape and first <= geom.group <= last
        if counts and geom.meshname:
            needed[geom.meshname] = geom.info
        if not counts or (geom.meshname and not kept):
            geom.type, geom.size, geom.fromto = mj.mjtGeom.mjGEOM_SPHERE, np.ones(3), np.full(6, np.nan)
            geom.meshname, geom.mass = "", float(counts)
    return needed


def _stands(body: Any) -> bool:
    """True for a body that no joint moves, whose inertia plays no part."""
    while body is not None:
        if body.joints:
            return False
        body = body.parent
    return True


def _add_mesh_inertias(model: mujoco.MjModel, scanned: ScannedFile, needed: Mapping[str, str]) -> None:
    """Give bodies the inertias of their meshes, from a process that reads these."""
    _, elements = scanned.text()
    for name, place in needed.items():
        geom = element_of(place, elements)
        if name not in scanned.meshes:
            refuse(geom, f"{named(geom)}: unknown mesh {printable(name)!r}, which its inertia depends on")
        mesh = scanned.meshes[name]
        if "file" in mesh.attrib and not validate_within(scanned.folder, mesh).is_file():
            refuse(mesh, f"{named(mesh)}: no such file: {printable(mesh.attrib['file'])!r}")
    text, elements = scanned.text(needed)
    code = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import _serve; _serve()"
    with tempfile.TemporaryDirectory() as folder:
        try:
            said = subprocess.run(
                [sys.executable, "-c", code],
                input=text.encode(),
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                cwd=folder,
                timeout=MAX_MESH_SECONDS,
                check=True,
            ).stdout
        except (subprocess.SubprocessError, OSError) as error:
            meshes = ", ".join(map(printable, needed))
            raise InputError(f"MuJoCo cannot compute the inertia of meshes {meshes}; give an <inertial>") from error
    found = json.loads(said)
    if isinstance(found, str):
        _refuse(found, elements)
    for name in _BODIES:
        array = getattr(model, name)
        array[:] = np.reshape(found[name], array.shape)


def _serve() -> None:
    """Answer an MJCF text on standard input with its bodies' inertias."""
    import resource

    resource.setrlimit(resource.RLIMIT_CPU, (MAX_MESH_SECONDS, MAX_MESH_SECONDS))
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MESH_MEMORY, MAX_MESH_MEMORY))
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, 2**20))
    mj = mujoco_package()
    try:
        spec = mj.MjSpec.from_string(sys.stdin.read())
        Rewriting.of(spec)
        _need_meshes(spec, kept=True)
        model = spec.compile()
        found: object = {name: getattr(model, name).ravel().tolist() for name in _BODIES}
    except (ValueError, mj.FatalError) as error:
        found = str(error)
    json.dump(found, sys.stdout)
