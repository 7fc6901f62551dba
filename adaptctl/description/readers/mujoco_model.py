"""A mechanism from a compiled MuJoCo model, which may hold a whole scene: a body and all that hangs on it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import GROUND, Description, Joint, Link
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import from_center_of_mass, transformed
from adaptctl.description.limits import Limits
from adaptctl.description.pose import Pose, rotation_about
from adaptctl.description.readers.mjcf.frames import from_quaternion
from adaptctl.description.readers.mjcf.joint import kind_within, position_limits
from adaptctl.description.readers.robot_checks import MOST_LINKS, require_at_most, unknown_body
from adaptctl.errors import InputError, NotFoundError, SimplificationWarning

if TYPE_CHECKING:
    import mujoco

FREE, BALL, SLIDE, HINGE = range(4)
"""MuJoCo's numbers of kinds of joints (mjtJoint)."""
CONNECT, WELD, OF_JOINTS = range(3)
"""MuJoCo's numbers of kinds of equalities (mjtEq)."""
NO_GRAVITY, NO_EQUALITY = "mjDSBL_GRAVITY", "mjDSBL_EQUALITY"
WORLD = 0


def from_mujoco(model: mujoco.MjModel, body: str | None = None) -> Description:
    """The description of the mechanism that is a `body` of a MuJoCo `model`, by name, with all bodies on it. What it
    stands on must not move. None stands for the one root body on which joints turn or slide; bodies that only float are
    objects of the scene.

    Link frames stand at the joints, turned as their bodies; a link is named after its body, and a body with several
    joints becomes as many links, massless but the last. Armature, damping and frictionloss become the joint's drive,
    where they are not zero; effort limits are those of the actuators, and position limits of at least 1e9 rad (m if
    prismatic) in size count as none. Raises `InputError` for ball and free joints, no joint, a body that stands on one
    that moves, several root bodies that move (for None), nonlinear damping, more than 256 links, and active equalities
    of these bodies, `NotFoundError` for an unknown body. Warns (`SimplificationWarning`) of actuators that command no
    torque, and of springs and gravity compensation, which are left out.
    """
    arm = MujocoArm.of(model, body)
    links = tuple(arm.links())
    require_at_most(len(links), MOST_LINKS, "links that move")
    _require_no_equality(arm)
    _warn(arm)
    name = arm.body_name(arm.root) if body is not None or not _name(model) else _name(model)
    return Description(name, links, _gravity(model), "MuJoCo model")


@dataclass(frozen=True, eq=False)
class MujocoArm:
    """The part of a MuJoCo model that is one mechanism: its bodies and joints as zero-based indices in `model`. `root`
    is its first body, `bodies` all of its bodies, parents first, `joints` its joints, one for each link.

    `carriers` has, by body, the index of the link that it is part of, -1 for the ground, and `places` its frame's pose
    (m) in that link, or in the world; both are empty until the method `links` fills them. `MujocoArm.of` finds an arm;
    nothing is checked at construction.
    """

    model: mujoco.MjModel
    root: int
    bodies: tuple[int, ...]
    joints: tuple[int, ...]
    carriers: dict[int, int] = field(default_factory=dict)
    """Of each body that moves, the link that it is part of."""
    places: dict[int, Pose] = field(default_factory=dict)
    """Of each body, its frame's pose in the link that it is part of, or in the world."""

    @classmethod
    def of(cls, model: mujoco.MjModel, body: str | None = None) -> MujocoArm:
        """The arm that consists of a `body` of a MuJoCo model, by name, and of all bodies on it; None stands for the
        one root body on which joints turn or slide. Raises `NotFoundError` for an unknown body, `InputError` for one
        that stands on a body that moves, for ball and free joints, for no joint, and, without a name, for several root
        bodies that move."""
        root = _moving_root(model) if body is None else _root(model, body)
        below = {root}
        for i in range(root + 1, model.nbody):
            if model.body_parentid[i] in below:
                below.add(i)
        bodies = tuple(sorted(below))
        joints = tuple(j for i in bodies for j in _joints(model, i))
        for j in joints:
            if model.jnt_type[j] in (FREE, BALL):
                kind = "a free joint" if model.jnt_type[j] == FREE else "a ball joint"
                where = model.body(model.jnt_bodyid[j]).name
                raise InputError(f"body {where!r} has {kind}: only hinges and slides are understood; name a body on it")
        if not joints:
            raise InputError(f"body {model.body(root).name!r}: no joint on it moves: expected a hinge or a slide")
        return cls(model, root, bodies, joints)

    def links(self) -> Iterator[Link]:
        """The links of the arm in depth-first order, one for each joint, with the summed inertia of all bodies fixed to
        them. The call also fills this object's `carriers` and `places`, the links that bodies are part of and the
        bodies' poses there. Raises `InputError` for a range that does not rise, lengths above 1e9 m, inertias above
        1e20, values that are not finite, drive terms below 0, and nonlinear damping."""
        links: list[Link] = []
        tens: list[Array] = []
        for i in self.bodies:
            carrier, place = self._stand(i)
            joints = _joints(self.model, i)
            for j in joints:
                carrier, place = self._add(links, j, carrier, place, last=j == joints[-1])
                tens.append(np.zeros(10))
            self.carriers[i], self.places[i] = carrier, place
            if carrier != GROUND:
                tens[carrier] = tens[carrier] + transformed(body_ten(self.model, i), place)
        return (replace(link, inertia=ten) for link, ten in zip(links, tens, strict=True))

    def _stand(self, i: int) -> tuple[int, Pose]:
        """The link that carries a body, and the body's frame there before its own joints move."""
        own = pose(self.model.body_pos[i], self.model.body_quat[i])
        parent = int(self.model.body_parentid[i])
        if i != self.root:
            return self.carriers[parent], self.places[parent] @ own
        while parent != WORLD:
            own = pose(self.model.body_pos[parent], self.model.body_quat[parent]) @ own
            parent = int(self.model.body_parentid[parent])
        return GROUND, own

    def _add(self, links: list[Link], j: int, carrier: int, place: Pose, last: bool) -> tuple[int, Pose]:
        """One more link; returns its index and the body's place on it."""
        model, body = self.model, self.body_name(int(self.model.jnt_bodyid[j]))
        name = model.joint(j).name or (body if last else f"{body}_{len(links)}")
        joint = _joint(model, j, name)
        to_joint = Pose(np.eye(3), np.array(model.jnt_pos[j]))
        ref = float(model.qpos0[model.jnt_qposadr[j]])
        turned = (rotation_about(joint.axis, -ref), np.zeros(3)) if joint.kind.turns else (np.eye(3), -ref * joint.axis)
        near, called = place @ to_joint @ Pose(*turned), body if last else f"{body}/{name}"
        links.append(Link(called, carrier, joint, near, Pose.identity(), massless=not last))
        return len(links) - 1, to_joint.inverse

    def body_name(self, i: int) -> str:
        """The name of the model's body of zero-based index `i`, such as "body3" where it has none. Nothing is
        checked."""
        return self.model.body(i).name or f"body{i}"

    @property
    def actuators(self) -> list[int]:
        """Zero-based indices in the model of the actuators that act on the arm's joints directly, not by tendons or
        sites."""
        joints = set(self.joints)
        return [i for i in range(self.model.nu) if self.model.actuator_trntype[i] in (0, 1)
                and int(self.model.actuator_trnid[i, 0]) in joints]  # fmt: skip

    @property
    def servos(self) -> list[str]:
        """Names of the arm's actuators whose force is not a multiple of their control, each with its kind, as in
        "'elbow' (a position servo)"; empty where all actuators are torque motors."""
        return [
            f"{_name_of_actuator(self.model, i)} ({kind})" for i in self.actuators if (kind := servo(self.model, i))
        ]


def body_ten(model: mujoco.MjModel, i: int) -> Array:
    """The ten inertial parameters (10,) of the body of zero-based index `i` in a MuJoCo model, about its frame's
    origin, without the bodies on it: m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (mass in kg, first moment
    in kg m, inertia tensor in kg m^2). Raises `InputError` for a centre of mass above 1e9 m or not finite; nothing else
    is checked."""
    at = pose(model.body_ipos[i], model.body_iquat[i])
    return transformed(from_center_of_mass(float(model.body_mass[i]), np.zeros(3), np.diag(model.body_inertia[i])), at)


def pose(position: Array, quaternion: Array) -> Pose:
    """The pose of a frame at `position` (3,), m, with the attitude of a `quaternion` (4,), w, x, y, z, of any length
    from 1e-12. Raises `InputError` for a shorter quaternion, and for positions above 1e9 m or not finite."""
    return Pose(from_quaternion(np.array(quaternion), "MuJoCo model"), np.array(position))


def servo(model: mujoco.MjModel, i: int) -> str:
    """The kind, in words such as "a position servo", of the actuator of zero-based index `i` in a MuJoCo model whose
    force is not a multiple of its control; the empty text for one whose force is, a torque motor. Nothing is
    checked."""
    gain, bias = model.actuator_gainprm[i], model.actuator_biasprm[i]
    if model.actuator_dyntype[i]:
        return "it has dynamics of its own"
    if not model.actuator_gaintype[i] and not model.actuator_biastype[i]:
        return ""
    if not model.actuator_gaintype[i] and gain[0] and bias[1] == -gain[0]:
        return "a position servo"
    if not model.actuator_gaintype[i] and gain[0] and not bias[1] and bias[2] == -gain[0]:
        return "a velocity servo"
    return "its force depends on the state"


def _name_of_actuator(model: mujoco.MjModel, i: int) -> str:
    return repr(model.actuator(i).name or f"actuator {i}")


def _joints(model: mujoco.MjModel, i: int) -> range:
    first = int(model.body_jntadr[i])
    return range(first, first + int(model.body_jntnum[i])) if first >= 0 else range(0)


def _root(model: mujoco.MjModel, body: str) -> int:
    names = [model.body(i).name for i in range(1, model.nbody)]
    if body not in names:
        raise NotFoundError(unknown_body(body, names))
    root = names.index(body) + 1
    above = int(model.body_parentid[root])
    while above != WORLD:
        if model.body_jntnum[above]:
            raise InputError(
                f"body {body!r} stands on {model.body(above).name!r}, which moves: name that one, or a fixed one"
            )
        above = int(model.body_parentid[above])
    return root


def _moving_root(model: mujoco.MjModel) -> int:
    """The one root body on which joints turn or slide."""
    moved = {int(model.body_rootid[model.jnt_bodyid[j]]) for j in range(model.njnt) if model.jnt_type[j] != FREE}
    names = [model.body(i).name for i in sorted(moved)]
    if not moved:
        raise InputError("no joint turns or slides: expected a hinge or a slide")
    if len(moved) > 1:
        known = ", ".join(map(repr, names))
        raise InputError(f"{len(moved)} root bodies move, {known}: name one, body={names[0]!r}, or --root {names[0]}")
    return moved.pop()


def _joint(model: mujoco.MjModel, j: int, name: str) -> Joint:
    ends = model.jnt_range[j].tolist() if model.jnt_limited[j] else (-math.inf, math.inf)
    dof = int(model.jnt_dofadr[j])
    polynomials = [getattr(model, name) for name in ("dof_dampingpoly",) if hasattr(model, name)]
    if any(np.any(values[dof]) for values in polynomials):
        raise InputError(f"joint {name!r}: damping: only the first coefficient is understood")
    numbers = (model.dof_armature[dof], model.dof_damping[dof], model.dof_frictionloss[dof])
    armature, damping, friction = (float(value) or None for value in numbers)
    limits = Limits(*position_limits(*ends), effort=_effort(model, j) or math.inf)
    return Joint(
        name,
        kind_within(limits, model.jnt_type[j] == HINGE),
        np.array(model.jnt_axis[j]),
        limits,
        Drive(armature, damping, friction),
    )


def _effort(model: mujoco.MjModel, j: int) -> float:
    """The greatest effort of all actuators of a joint (N m or N); infinite without actuators."""
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


def _gravity(model: mujoco.MjModel) -> Array:
    return np.zeros(3) if _disabled(model, NO_GRAVITY) else np.array(model.opt.gravity)


def _disabled(model: mujoco.MjModel, flag: str) -> bool:
    import mujoco

    return bool(model.opt.disableflags & int(getattr(mujoco.mjtDisableBit, flag)))


def _name(model: mujoco.MjModel) -> str:
    """The model's own name."""
    return bytes(model.names).split(b"\0", 1)[0].decode()


def _require_no_equality(arm: MujocoArm) -> None:
    """Refuse equalities that hold on to the arm: they close loops, which are read from files alone."""
    model = arm.model
    for e in range(0 if _disabled(model, NO_EQUALITY) else model.neq):
        kind, ends = int(model.eq_type[e]), {int(model.eq_obj1id[e]), int(model.eq_obj2id[e])}
        sites = kind in (CONNECT, WELD) and int(model.eq_objtype[e]) == 6  # mjOBJ_SITE
        bodies = {int(model.site_bodyid[s]) for s in ends} if sites else ends
        own = set(arm.joints) if kind == OF_JOINTS else set(arm.bodies)
        if model.eq_active0[e] and kind <= OF_JOINTS and bodies & own:
            name = model.equality(e).name or f"equality {e}"
            raise InputError(f"{name!r} ties the arm: read it with adaptctl.load(path), which closes loops")


def _warn(arm: MujocoArm) -> None:
    model = arm.model
    sprung = [model.joint(j).name for j in arm.joints if np.any(model.jnt_stiffness[j])]
    lifted = [model.body(i).name for i in arm.bodies if model.body_gravcomp[i]]
    for text, names in (
        ("actuators that are no torques, as the laws here command", arm.servos),
        ("springs of joints are left out", sprung),
        ("gravity compensation is left out", lifted),
    ):
        if names:
            text = f"MuJoCo model, body {arm.body_name(arm.root)!r}: {text}: {', '.join(names)}"
            warnings.warn(text, SimplificationWarning, stacklevel=4)
