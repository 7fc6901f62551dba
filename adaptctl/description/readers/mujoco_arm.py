"""Part of a MuJoCo model that is one mechanism, as links."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.drive import Drive, DriveParameter, Limits
from adaptctl.description.inertia import from_center_of_mass, transformed
from adaptctl.description.joint import Joint, JointKind
from adaptctl.description.link import GROUND, Link
from adaptctl.description.loops import Loops
from adaptctl.description.pose import Pose, quaternion_rotation, rotation_about
from adaptctl.description.readers.entries import (
    FLOATING_FLAG,
    unknown_body,
    validate_mass_of_inertia,
)
from adaptctl.description.readers.xml_elements import LineElement, located
from adaptctl.errors import InputError, NotFoundError, SimplificationWarning, warn
from adaptctl.optional_packages import needed

if TYPE_CHECKING:
    import mujoco

FREE, BALL, SLIDE, HINGE = range(4)
"""MuJoCo's numbers of kinds of joints (mjtJoint)."""
CONNECT, WELD, OF_JOINTS = range(3)
"""MuJoCo's numbers of kinds of equalities (mjtEq)."""
SITE = 6
"""MuJoCo's number of sites among objects (mjtObj)."""
NO_GRAVITY, NO_EQUALITY, NO_SPRING = "mjDSBL_GRAVITY", "mjDSBL_EQUALITY", "mjDSBL_SPRING"
WORLD = 0
NO_LIMIT = 1e9
"""rad or m, of a side of a range that limits nothing"""


def mujoco_package(what: str = "a MuJoCo model") -> Any:
    """Package mujoco."""
    with needed(what):
        import mujoco
    return mujoco


@dataclass(frozen=True, eq=False)
class MujocoArm:
    """Part of a MuJoCo model that is one mechanism."""

    model: mujoco.MjModel
    root: int
    bodies: tuple[int, ...]
    joints: tuple[int, ...]
    elements: Mapping[object, Element] = field(default_factory=dict)
    held: tuple[str, ...] = ()
    """bodies whose free joints are not there, so that they stand still"""
    beside: tuple[str, ...] = ()
    """other root bodies that move, which no actuator drives"""
    carriers: dict[int, int] = field(default_factory=dict)
    places: dict[int, Pose] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        model: mujoco.MjModel,
        body: str | None = None,
        elements: Mapping[object, Element] | None = None,
        held: Sequence[str] = (),
    ) -> MujocoArm:
        """Arm of a body of a MuJoCo model and all bodies on it."""
        held = (*held, *(model.body(i).name for i in range(model.nbody) if _floats(model, i)))
        roots = _moving_roots(model, held) if body is None else [_root(model, body)]
        root, below = min(roots), set(roots)
        for i in range(root + 1, model.nbody):
            if model.body_parentid[i] in below:
                below.add(i)
        bodies = tuple(sorted(below))
        joints = tuple(j for i in bodies for j in _joints(model, i))
        moving = {int(model.body_rootid[model.jnt_bodyid[j]]) for j in range(model.njnt) if model.jnt_type[j] != FREE}
        beside = tuple(model.body(i).name for i in sorted(moving - set(roots)) if body is None)
        below_world = [model.body(i).name for top in roots for i in (top, *_above(model, top))]
        found = cls(
            model, root, bodies, joints, elements or {}, tuple(name for name in held if name in below_world), beside
        )
        for i in bodies:
            with found.at_line(found.body_name(i)):
                found._validate_plain(i)
        if not joints:
            raise InputError(f"body {model.body(root).name!r}: {_nothing_moves(found.held)}")
        return found

    def at_line(self, key: object) -> AbstractContextManager[None]:
        """Context in which an `InputError` names the line of an element."""
        return located(self.elements.get(key, LineElement("")))

    def _validate_plain(self, i: int) -> None:
        where = f"body {self.body_name(i)!r}"
        for j in _joints(self.model, i):
            if self.model.jnt_type[j] == BALL:
                raise InputError(
                    f"{where} has a ball joint, {self.model.joint(j).name!r}, but a compiled model may have only "
                    "hinges and slides; load its file, where it becomes three hinges"
                )
        if self.model.body_mocapid[i] >= 0:
            raise InputError(f"{where}: mocap bodies are not supported; remove it")

    def links(self) -> list[Link]:
        """Links in depth-first order, with the inertia of all bodies fixed to them."""
        links: list[Link] = []
        tens: list[Array] = []
        for i in self.bodies:
            with self.at_line(self.body_name(i)):
                carrier, place = self._stand(i)
                joints = _joints(self.model, i)
                for j in joints:
                    carrier, place = self._add(links, j, carrier, place, last=j == joints[-1])
                    tens.append(np.zeros(10))
                self.carriers[i], self.places[i] = carrier, place
                if carrier != GROUND:
                    tens[carrier] = tens[carrier] + transformed(body_ten(self.model, i), place)
        for k, ten in enumerate(tens):
            with self.at_line(self.body_name(int(self.model.jnt_bodyid[self.joints[k]]))):
                links[k] = validate_mass_of_inertia(replace(links[k], inertia=ten))
        return links

    def _stand(self, i: int) -> tuple[int, Pose]:
        own = pose(self.model.body_pos[i], self.model.body_quat[i])
        parent = int(self.model.body_parentid[i])
        if parent not in self.carriers:
            return GROUND, self.still(parent) @ own
        return self.carriers[parent], self.places[parent] @ own

    def still(self, i: int) -> Pose:
        """Place in the world of a body that does not move."""
        place = Pose.identity()
        while i != WORLD:
            place = pose(self.model.body_pos[i], self.model.body_quat[i]) @ place
            i = int(self.model.body_parentid[i])
        return place

    def _add(self, links: list[Link], j: int, carrier: int, place: Pose, last: bool) -> tuple[int, Pose]:
        model, body = self.model, self.body_name(int(self.model.jnt_bodyid[j]))
        name = model.joint(j).name or (body if last else f"{body}_{len(links)}")
        joint = _joint(model, j, name)
        to_joint = Pose(np.eye(3), np.array(model.jnt_pos[j]))
        ref = float(model.qpos0[model.jnt_qposadr[j]])
        turned = (
            (rotation_about(joint.axis, -ref), np.zeros(3))
            if joint.kind.is_revolute
            else (np.eye(3), -ref * joint.axis)
        )
        near, called = place @ to_joint @ Pose(*turned), body if last else f"{body}/{name}"
        links.append(Link(called, carrier, joint, near, Pose.identity(), massless=not last))
        return len(links) - 1, to_joint.inverse

    @property
    def gravity(self) -> Array:
        """Acceleration of gravity (3,) in m/s^2; zero where the model disables it."""
        return np.zeros(3) if is_disabled(self.model, NO_GRAVITY) else np.array(self.model.opt.gravity)

    def warn(
        self,
        where: str,
        links: Sequence[Link],
        *more: tuple[str, Sequence[str]],
    ) -> None:
        """Warn (`SimplificationWarning`) of what the arm has and its description has not, and of `more`."""
        sprung = [link.joint.name for j, link in zip(self.joints, links, strict=True) if _is_bent(self.model, j)]
        lifted = [self.body_name(i) for i in self.bodies if self.model.body_gravcomp[i]]
        for text, names in (
            ("actuators without torque input (expected <motor>)", self.servos),
            ("joint springs that are not linear are ignored", sprung),
            ("gravity compensation is ignored", lifted),
            (f"the base is held still, and floats with {FLOATING_FLAG}", self.held),
            ("other bodies that move, but have no actuator, are left out", self.beside),
            *more,
        ):
            if names:
                warn(f"{where}: {text}: {', '.join(names)}", SimplificationWarning)

    def undriven(
        self, links: Sequence[Link], loops: Loops | None, floating: Sequence[str] = ()
    ) -> tuple[str, list[str]]:
        """Note on primary joints without an actuator, where others have one."""
        on = {int(self.model.actuator_trnid[i, 0]) for i in self.actuators}
        names = [link.joint.name for j, link in zip(self.joints, links, strict=True) if j not in on]
        primary = names if loops is None else loops.primary
        text = "no actuator drives these joints, which are taken as driven"
        asked = bool(on) or (loops is not None and bool(loops.closures))
        return text, [name for name in names if asked and name in primary and name not in floating]

    def body_name(self, i: int) -> str:
        """Name of body `i`, such as "body3" where it has none."""
        return self.model.body(i).name or f"body{i}"

    @property
    def actuators(self) -> list[int]:
        """Indices of the actuators that act on joints directly."""
        joints = set(self.joints)
        return [i for i in range(self.model.nu) if self.model.actuator_trntype[i] in (0, 1)
                and int(self.model.actuator_trnid[i, 0]) in joints]  # fmt: skip

    @property
    def servos(self) -> list[str]:
        """Names and kinds of actuators that are not torque motors."""
        return [
            f"{_name_of_actuator(self.model, i)} ({kind})" for i in self.actuators if (kind := servo(self.model, i))
        ]


def body_ten(model: mujoco.MjModel, i: int) -> Array:
    """Ten inertial parameters of body `i`, without the bodies on it."""
    at = pose(model.body_ipos[i], model.body_iquat[i])
    if model.body_mass[i] < 0.0 or np.any(model.body_inertia[i] < 0.0):
        raise InputError(f"body {model.body(i).name!r}: mass and inertia must not be negative")
    return transformed(from_center_of_mass(float(model.body_mass[i]), np.zeros(3), np.diag(model.body_inertia[i])), at)


def pose(position: Array, quaternion: Array) -> Pose:
    """Pose of a position (3,) in m and a quaternion w, x, y, z."""
    return Pose(quaternion_rotation(quaternion), np.array(position))


def servo(model: mujoco.MjModel, i: int) -> str:
    """Kind of an actuator, such as "a position servo"; empty for a torque motor."""
    gain, bias = model.actuator_gainprm[i], model.actuator_biasprm[i]
    if model.actuator_dyntype[i]:
        return "actuator dynamics"
    if not model.actuator_gaintype[i] and not model.actuator_biastype[i]:
        return ""
    if not model.actuator_gaintype[i] and gain[0] and bias[1] == -gain[0]:
        return "a position servo"
    if not model.actuator_gaintype[i] and gain[0] and not bias[1] and bias[2] == -gain[0]:
        return "a velocity servo"
    return "state-dependent force"


def _name_of_actuator(model: mujoco.MjModel, i: int) -> str:
    return repr(model.actuator(i).name or f"actuator {i}")


def _joints(model: mujoco.MjModel, i: int) -> list[int]:
    """Joints of body `i` but a free one, which is held."""
    first = int(model.body_jntadr[i])
    own = range(first, first + int(model.body_jntnum[i])) if first >= 0 else range(0)
    return [j for j in own if model.jnt_type[j] != FREE]


def _floats(model: mujoco.MjModel, i: int) -> bool:
    first = int(model.body_jntadr[i])
    return first >= 0 and bool(model.jnt_type[first] == FREE)


def _above(model: mujoco.MjModel, i: int) -> Iterator[int]:
    while (i := int(model.body_parentid[i])) != WORLD:
        yield i


def _nothing_moves(held: Sequence[str]) -> str:
    more = f"; the base {held[0]!r} is held still, floats with {FLOATING_FLAG}" if held else ""
    return f"no moving joint: expected a hinge or a slide{more}"


def _root(model: mujoco.MjModel, body: str) -> int:
    names = [model.body(i).name for i in range(1, model.nbody)]
    if body not in names:
        raise NotFoundError(unknown_body(body, names))
    root = names.index(body) + 1
    for above in _above(model, root):
        if _joints(model, above):
            raise InputError(
                f"root: body {body!r} is attached to {model.body(above).name!r}, which moves; give that body or a "
                "fixed one"
            )
    return root


def _moving_roots(model: mujoco.MjModel, held: Sequence[str]) -> list[int]:
    """Bodies at which the mechanism begins: one, the only one with actuators, or several that loops join."""
    moved = {int(model.body_rootid[model.jnt_bodyid[j]]) for j in range(model.njnt) if model.jnt_type[j] != FREE}
    names = [model.body(i).name for i in sorted(moved)]
    if not moved:
        raise InputError(_nothing_moves(held))
    driven = {int(model.body_rootid[model.jnt_bodyid[j]]) for j in _driven(model)} & moved
    joined = _joined(model, min(driven or moved))
    if not (driven or moved) <= joined:
        known = ", ".join(map(repr, names))
        raise InputError(
            f"{len(moved)} root bodies move, {known}, each a separate mechanism; select one, such as "
            f"root={names[0]!r} (--root {names[0]})"
        )
    return sorted(moved & joined)


def _driven(model: mujoco.MjModel) -> list[int]:
    """Joints that actuators act on directly."""
    return [int(model.actuator_trnid[i, 0]) for i in range(model.nu) if model.actuator_trntype[i] in (0, 1)]


def _joined(model: mujoco.MjModel, root: int) -> set[int]:
    """Root bodies that active equalities join to one, itself counted."""
    active = (
        ()
        if is_disabled(model, NO_EQUALITY)
        else np.flatnonzero(model.eq_active0 & (model.eq_type <= OF_JOINTS)).tolist()
    )
    pairs = [set(model.body_rootid[ends].tolist()) - {WORLD} for e in active if (ends := equality_bodies(model, e))]
    joined = {root}
    while more := {other for pair in pairs if pair & joined for other in pair} - joined:
        joined |= more
    return joined


def equality_bodies(model: mujoco.MjModel, e: int) -> list[int]:
    """Bodies that an equality acts on."""
    ends = [int(end) for end in (model.eq_obj1id[e], model.eq_obj2id[e]) if end >= 0]
    if model.eq_type[e] == OF_JOINTS:
        return [int(model.jnt_bodyid[j]) for j in ends]
    return [int(model.site_bodyid[s]) for s in ends] if model.eq_objtype[e] == SITE else ends


def _joint(model: mujoco.MjModel, j: int, name: str) -> Joint:
    ends = model.jnt_range[j].tolist() if model.jnt_limited[j] else (-math.inf, math.inf)
    dof = int(model.jnt_dofadr[j])
    polynomials = [getattr(model, name) for name in ("dof_dampingpoly",) if hasattr(model, name)]
    if any(np.any(values[dof]) for values in polynomials):
        raise InputError(f"joint {name!r}: damping: only the first coefficient is supported")
    numbers = (model.dof_armature[dof], model.dof_damping[dof], model.dof_frictionloss[dof])
    armature, damping, friction = (float(value) or None for value in numbers)
    try:
        limits = Limits(*position_limits(*ends), effort=_effort(model, j) or math.inf)
        kind = kind_within(limits, model.jnt_type[j] == HINGE)
        drive = Drive(armature, damping, friction).with_terms(_spring(model, j))
        return Joint(name, kind, np.array(model.jnt_axis[j]), limits, drive)
    except InputError as error:
        where = f"joint {name!r}"
        raise InputError(str(error) if str(error).startswith(where) else f"{where}: {error}") from error


def _effort(model: mujoco.MjModel, j: int) -> float:
    on = [i for i in range(model.nu) if model.actuator_trntype[i] in (0, 1) and model.actuator_trnid[i, 0] == j]
    bound = sum(_actuator_effort(model, i) for i in on) if on else math.inf
    own = float(np.abs(model.jnt_actfrcrange[j]).max()) if model.jnt_actfrclimited[j] else math.inf
    return min(bound, own)


def _actuator_effort(model: mujoco.MjModel, i: int) -> float:
    gear, bounds = abs(float(model.actuator_gear[i, 0])), [math.inf]
    if model.actuator_forcelimited[i]:
        bounds.append(float(np.abs(model.actuator_forcerange[i]).max()))
    if model.actuator_ctrllimited[i] and not servo(model, i):
        bounds.append(abs(float(model.actuator_gainprm[i, 0])) * float(np.abs(model.actuator_ctrlrange[i]).max()))
    return gear * min(bounds) if gear else 0.0


def is_disabled(model: mujoco.MjModel, flag: str) -> bool:
    """True where a MuJoCo `model` disables what the `flag` is named after, as "mjDSBL_GRAVITY"."""
    import mujoco

    return bool(model.opt.disableflags & int(getattr(mujoco.mjtDisableBit, flag)))


def model_name(model: mujoco.MjModel) -> str:
    """Name of a MuJoCo `model` itself, empty where it has none."""
    return bytes(model.names).split(b"\0", 1)[0].decode()


def _is_bent(model: mujoco.MjModel, j: int) -> bool:
    polynomial = getattr(model, "jnt_stiffnesspoly", None)
    return polynomial is not None and bool(np.any(polynomial[j]))


def _spring(model: mujoco.MjModel, j: int) -> dict[DriveParameter, float | None]:
    """Terms of a drive for the spring of a joint, none without one."""
    stiffness = float(model.jnt_stiffness[j])
    if stiffness == 0.0 or _is_bent(model, j) or is_disabled(model, NO_SPRING):
        return {}
    rest = float(model.qpos_spring[model.jnt_qposadr[j]])
    return {DriveParameter.STIFFNESS: stiffness, DriveParameter.OFFSET: -stiffness * rest or None}


def position_limits(lower: float, upper: float) -> tuple[float, float]:
    """Position limits for a range of MuJoCo's, infinite from 1e9 on."""
    return (-math.inf if lower <= -NO_LIMIT else lower, math.inf if upper >= NO_LIMIT else upper)


def kind_within(limits: Limits, turns: bool) -> JointKind:
    """Kind of a joint by its limits and whether it turns."""
    if not turns:
        return JointKind.PRISMATIC
    free = (limits.lower, limits.upper) == (-math.inf, math.inf)
    return JointKind.CONTINUOUS if free else JointKind.REVOLUTE
