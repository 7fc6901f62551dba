"""A mechanism as a MuJoCo model, and other inertial parameters for one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.drive import MAY_BE_NEGATIVE, Drive, DriveParameter
from adaptctl.description.inertia import inertia_tensor, transformed
from adaptctl.description.link import GROUND, Link
from adaptctl.description.pose import Pose, rotation_quaternions
from adaptctl.description.readers.mujoco_arm import MujocoArm, body_ten
from adaptctl.errors import InputError

if TYPE_CHECKING:
    import mujoco

MUJOCO_TIME_STEP = 1e-3
"""s, of MuJoCo's integration"""
MUJOCO_MAX_VALUE = 1e10
"""rad or m, MuJoCo's largest number of a motion (mjMAXVAL): a limit that is never reached"""


MOMENT_DIGITS = 1e-5


def to_mujoco(description: Description) -> mujoco.MjModel:
    """The MuJoCo model of the mechanism of a `description`, which has no loops."""
    return _compiled(description)[1]


def mjcf_text(description: Description) -> str:
    """Text of a description as MJCF, with rotors as armature, and viscous and Coulomb friction."""
    spec, _ = _compiled(description)
    for body in spec.bodies:
        body.inertia = _triangular(np.array(body.inertia))
    spec.compile()
    return str(spec.to_xml())


def _triangular(moments: Array) -> Array:
    """Principal moments of which the largest is below the sum of the others by more than texts of six digits round."""
    least, middle, largest = np.argsort(moments)
    missing = max(0.0, (1.0 + MOMENT_DIGITS) * moments[largest] - moments[least] - moments[middle])
    out = moments.copy()
    out[[least, middle]] += 0.5 * missing
    return out


def _compiled(description: Description) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    import mujoco

    _validate_plain_joints(description)
    if description.inconsistent_links:
        names = ", ".join(description.inconsistent_links)
        raise InputError(f"{description.name}: inertia of {names} is not physically consistent, as MuJoCo requires")
    spec = mujoco.MjSpec()
    spec.modelname, spec.option.gravity = description.name, description.gravity
    spec.option.timestep, spec.compiler.degree = MUJOCO_TIME_STEP, False
    bodies: list[mujoco.MjsBody] = []
    for link in description.links:
        above = spec.worldbody if link.parent == GROUND else bodies[link.parent]
        bodies.append(_body(above, link, description))
        _motor(spec, link)
    try:
        return spec, spec.compile()
    except ValueError as error:
        raise InputError(f"{description.name}: MuJoCo: {str(error).splitlines()[0]}") from error


def _validate_plain_joints(description: Description) -> None:
    if description.loops is not None or description.drive_couplings:
        raise InputError(
            f"{description.name}: MuJoCo models of loops and coupled drives are not supported; the built-in plant "
            "simulates them"
        )
    for link in description.links:
        drive = link.joint.drive
        sprung = {DriveParameter.STIFFNESS, DriveParameter.OFFSET} if (drive.stiffness or 0.0) > 0.0 else set()
        if any(drive.value(kind) for kind in MAY_BE_NEGATIVE - sprung):
            raise InputError(
                f"{description.name}: joint {link.joint.name!r}: MuJoCo supports only viscous and Coulomb friction, "
                "and linear springs"
            )


def _body(above: mujoco.MjsBody, link: Link, description: Description) -> mujoco.MjsBody:
    import mujoco

    at = (
        link.parent_to_joint
        if link.parent == GROUND
        else description.links[link.parent].joint_to_link @ link.parent_to_joint
    )
    body = above.add_body(name=link.name, pos=at.translation, quat=rotation_quaternions(at.rotation))
    mass, center, turn, principal = principal_axes(transformed(link.inertia, link.joint_to_link), link.name)
    body.mass, body.ipos, body.iquat, body.inertia = mass, center, turn, principal
    body.explicitinertial = True
    joint, drive = link.joint, link.joint.drive
    kind = mujoco.mjtJoint.mjJNT_HINGE if joint.kind.is_revolute else mujoco.mjtJoint.mjJNT_SLIDE
    made = body.add_joint(name=joint.name, type=kind, axis=joint.axis)
    made.armature, made.frictionloss = drive.rotor_inertia or 0.0, drive.coulomb or 0.0
    made.damping = np.array([drive.viscous or 0.0, *np.zeros(np.size(made.damping) - 1)])
    made.stiffness = np.array([drive.stiffness or 0.0, *np.zeros(np.size(made.stiffness) - 1)])
    made.springref = _rest(drive)
    bounds = (joint.limits.lower, joint.limits.upper)
    if bounds != (-math.inf, math.inf):
        made.range, made.limited = np.clip(bounds, -MUJOCO_MAX_VALUE, MUJOCO_MAX_VALUE), 1
    return body


def _rest(drive: Drive) -> float:
    return -(drive.offset or 0.0) / drive.stiffness if drive.stiffness else 0.0


def _motor(spec: mujoco.MjSpec, link: Link) -> None:
    import mujoco

    effort, joint = link.joint.limits.effort, link.joint.name
    motor = spec.add_actuator(name=f"{joint} motor", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    if math.isfinite(effort):
        motor.ctrlrange, motor.ctrllimited = (-effort, effort), 1


def set_parameters(arm: MujocoArm, before: Description, after: Description) -> None:
    """Change a MuJoCo model in place to the inertias and friction of a description."""
    import mujoco

    _validate_plain_joints(after)
    if not arm.carriers:
        arm.links()
    links = list(zip(arm.joints, before.links, after.links, strict=True))
    bodies = {
        int(arm.model.jnt_bodyid[j]): _body_of(arm, i, new)
        for i, (j, old, new) in enumerate(links)
        if not np.array_equal(old.inertia, new.inertia)
    }
    model = arm.model
    for j, _, new in links:
        dof, drive = int(model.jnt_dofadr[j]), new.joint.drive
        model.dof_armature[dof] = drive.rotor_inertia or 0.0
        model.dof_damping[dof], model.dof_frictionloss[dof] = drive.viscous or 0.0, drive.coulomb or 0.0
        model.jnt_stiffness[j], model.qpos_spring[model.jnt_qposadr[j]] = drive.stiffness or 0.0, _rest(drive)
    for k, axes in bodies.items():
        model.body_mass[k], model.body_ipos[k], model.body_iquat[k], model.body_inertia[k] = axes
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _body_of(arm: MujocoArm, i: int, link: Link) -> tuple[float, Array, Array, Array]:
    """Inertia of the body at a link's joint: that of the link without the bodies that are fixed to it."""
    model, body = arm.model, int(arm.model.jnt_bodyid[arm.joints[i]])
    fixed = [b for b, carrier in arm.carriers.items() if carrier == i and b != body]
    rest = transformed(link.inertia, link.joint_to_link) - sum(
        (transformed(body_ten(model, b), arm.places[b]) for b in fixed), np.zeros(10)
    )
    return principal_axes(transformed(rest, arm.places[body].inverse), link.name)


def principal_axes(ten: Array, name: str) -> tuple[float, Array, Array, Array]:
    """Mass, centre of mass, principal axes and moments of a rigid body."""
    mass = float(ten[0])
    if mass <= 0.0 and np.any(ten):
        raise InputError(f"link {name!r}: mass: expected a positive number for MuJoCo, got {mass:g}")
    center = ten[1:4] / (mass or 1.0)
    at_center = transformed(ten, Pose(np.eye(3), -center))
    moments, axes = np.linalg.eigh(inertia_tensor(at_center))
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return mass, center, rotation_quaternions(axes), np.maximum(moments, 0.0)
