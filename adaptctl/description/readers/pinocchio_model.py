"""Conversion to and from Pinocchio's models."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np
import pinocchio

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.drive import MAY_BE_NEGATIVE, Drive, Limits
from adaptctl.description.inertia import inertia_tensor, transformed
from adaptctl.description.joint import Joint, JointKind
from adaptctl.description.link import GROUND, Link, depth_first
from adaptctl.description.loops import Closure, ClosureKind
from adaptctl.description.pose import FrameKind, NamedFrame, Pose
from adaptctl.description.readers.entries import zero_limits
from adaptctl.errors import InputError, NotFoundError, SimplificationWarning, warn

_ONE_COORDINATE = re.compile(r"JointModel(R[XYZ]|RUB[XYZ]|P[XYZ]|(Revolute|RevoluteUnbounded|Prismatic)Unaligned)")
_UNLIMITED = 1e300
"""Pinocchio writes the largest double for a limit that is not there."""
_LEFT_OUT = "springs and friction other than viscous and Coulomb are ignored"


def to_pinocchio(description: Description) -> pinocchio.Model:
    """
    Return a Pinocchio model of a mechanism's spanning tree.

    Parameters
    ----------
    description : Description
        Mechanism; closures and couplings of its loops are left out.

    Returns
    -------
    pinocchio.Model
        Model with the same joints in the same order, link frames as body frames, and rotors as armature. Continuous
        joints become revolute ones without limits.

    Raises
    ------
    InputError
        If a link has a first moment without mass or a drive turns with several joints.

    Warns
    -----
    SimplificationWarning
        If springs, or friction other than viscous and Coulomb's, are left out.

    Examples
    --------
    >>> from adaptctl.description import to_pinocchio
    >>> to_pinocchio(arm.description).nq
    2
    """
    _validate_own_shafts(description)
    model = pinocchio.Model()
    model.name = description.name
    model.gravity.linear = np.array(description.gravity)
    for link in description.links:
        _append(model, link, description.links)
    types = {kind: found for found, kind in _KINDS.items()}
    for frame in description.frames:
        at = frame.pose if frame.link == GROUND else description.links[frame.link].joint_to_link @ frame.pose
        parent = 0
        if frame.link != GROUND:
            parent = model.getFrameId(description.links[frame.link].joint.name, pinocchio.FrameType.JOINT)
        model.addFrame(pinocchio.Frame(frame.name, frame.link + 1, parent, _placement(at), types[frame.kind]))
    drives = [link.joint.drive for link in description.links]
    model.armature = np.array([drive.rotor_inertia or 0.0 for drive in drives])
    model.damping = np.array([drive.viscous or 0.0 for drive in drives])
    model.friction = np.array([drive.coulomb or 0.0 for drive in drives])
    _warn(model, _LEFT_OUT, _bent(description))
    return model


def _validate_own_shafts(description: Description) -> None:
    if description.drive_couplings:
        raise InputError(f"{description.name}: Pinocchio does not support drives coupled to several joints")


def _bent(description: Description) -> list[str]:
    drives = {link.joint.name: link.joint.drive for link in description.links}
    return [name for name, drive in drives.items() if any(drive.value(kind) for kind in MAY_BE_NEGATIVE)]


def from_pinocchio(model: pinocchio.Model, name: str | None = None) -> Description:
    """
    Return the description of the mechanism in a Pinocchio model.

    Parameters
    ----------
    model : pinocchio.Model
        Model of revolute and prismatic joints.
    name : str, optional
        Name of the mechanism; by default the model's own, or "mechanism" where that is empty.

    Returns
    -------
    Description
        Joints in depth-first order: look up their index in the model by name. Link frames are joint frames; a link has
        the name of the first body frame on its joint. Bodies fixed to the universe are left out.

    Raises
    ------
    InputError
        If a joint has several coordinates or is helical or mimic, there is no joint, a range is empty, friction is
        negative, or gravity has an angular part.

    Warns
    -----
    SimplificationWarning
        If limits are zero or negative, which are taken as no limits.

    Examples
    --------
    >>> from adaptctl.description import from_pinocchio, to_pinocchio
    >>> from_pinocchio(to_pinocchio(arm.description)).joint_names
    ('shoulder', 'elbow')
    """
    if np.any(model.gravity.angular):
        raise InputError(f"{model.name}: gravity: expected no angular part, got {model.gravity}")
    links = [_link(model, i) for i in range(1, model.njoints)]
    _warn(model, "limits of zero are read as no limits", _zero_limited(model))
    _warn(model, "negative limits of effort or velocity are read as none", _negative_limited(model))
    ordered = depth_first(links)
    gravity, frames = np.array(model.gravity.linear), tuple(_frames(model, [link.joint.name for link in ordered]))
    return Description(name or model.name or "mechanism", ordered, gravity, frames=frames)


def _frames(model: pinocchio.Model, joints: list[str]) -> Iterator[NamedFrame]:
    own = {(int(frame.parentJoint), str(frame.name)) for frame in model.frames}
    own = {(i, name) for i, name in own if i and name == _body_name(model, i)}
    for frame in list(model.frames)[1:]:
        index, name, at = int(frame.parentJoint), str(frame.name), frame.placement
        is_own = frame.type == pinocchio.FrameType.BODY and (index, name) in own and at.isIdentity(0.0)
        if frame.type == pinocchio.FrameType.JOINT or is_own:
            continue
        link = joints.index(str(model.names[index])) if index else GROUND
        yield NamedFrame(name, link, Pose(np.array(at.rotation), np.array(at.translation)), _KINDS[frame.type])


_KINDS = {
    pinocchio.FrameType.OP_FRAME: FrameKind.OPERATIONAL,
    pinocchio.FrameType.FIXED_JOINT: FrameKind.FIXED_JOINT,
    pinocchio.FrameType.BODY: FrameKind.BODY,
    pinocchio.FrameType.SENSOR: FrameKind.SENSOR,
}


def with_inertias(model: pinocchio.Model, description: Description) -> pinocchio.Model:
    """Copy of a Pinocchio model with other inertias and drives, matched by joint name."""
    _validate_own_shafts(description)
    names = {str(name): i for i, name in enumerate(model.names)}
    changed = model.copy()
    for link in description.links:
        if link.joint.name not in names:
            raise NotFoundError(f"{model.name}: unknown joint {link.joint.name!r}; joints: {', '.join(names)}")
        index, drive = names[link.joint.name], link.joint.drive
        v = model.joints[index].idx_v
        changed.inertias[index] = _inertia(link)
        own = (drive.rotor_inertia, drive.viscous, drive.coulomb)
        for numbers, value in zip((changed.armature, changed.damping, changed.friction), own, strict=True):
            numbers[v] = value or 0.0
    if len(names) - 1 != len(description.links):
        raise InputError(
            f"{model.name}: expected {len(description.links)} joints, as in {description.name}, got {len(names) - 1}"
        )
    _warn(model, _LEFT_OUT, _bent(description))
    return changed


def _append(model: pinocchio.Model, link: Link, links: tuple[Link, ...]) -> None:
    at = Pose.identity() if link.parent == GROUND else links[link.parent].joint_to_link
    joint, limits = link.joint, link.joint.limits
    bounds = [np.array([b]) for b in (limits.effort, limits.velocity, limits.lower, limits.upper)]
    index = model.addJoint(
        link.parent + 1, _joint_model(joint), _placement(at @ link.parent_to_joint), joint.name, *bounds
    )
    model.appendBodyToJoint(index, _inertia(link), pinocchio.SE3.Identity())
    frame = model.addJointFrame(index)
    model.addBodyFrame(link.name, index, _placement(link.joint_to_link), frame)


def _joint_model(joint: Joint) -> pinocchio.JointModel:
    letter = "R" if joint.kind.is_revolute else "P"
    for axis, unit in zip("XYZ", np.eye(3), strict=True):
        if np.array_equal(joint.axis, unit):
            return getattr(pinocchio, f"JointModel{letter}{axis}")()
    unaligned = (
        pinocchio.JointModelRevoluteUnaligned if joint.kind.is_revolute else pinocchio.JointModelPrismaticUnaligned
    )
    return unaligned(np.array(joint.axis))


def _placement(pose: Pose) -> pinocchio.SE3:
    return pinocchio.SE3(np.array(pose.rotation), np.array(pose.translation))


def _inertia(link: Link) -> pinocchio.Inertia:
    """Inertia in the joint's frame; Pinocchio divides by the mass to store the centre."""
    ten = transformed(link.inertia, link.joint_to_link)
    if ten[0] != 0.0:
        return pinocchio.Inertia.FromDynamicParameters(ten)
    if np.any(ten[1:4]):
        raise InputError(
            f"link {link.name!r}: first moment without mass is not supported by Pinocchio, got {ten[1:4].tolist()}"
        )
    inertia = pinocchio.Inertia.Zero()
    inertia.inertia = inertia_tensor(ten)
    return inertia


def _link(model: pinocchio.Model, index: int) -> Link:
    placement = model.jointPlacements[index]
    near = Pose(np.array(placement.rotation), np.array(placement.translation))
    inertia = model.inertias[index]
    ten = inertia.toDynamicParameters() if inertia.mass != 0.0 else _massless(inertia)
    parent = int(model.parents[index]) - 1
    return Link(_body_name(model, index), parent, _joint(model, index), near, Pose.identity(), ten)


def _massless(inertia: pinocchio.Inertia) -> Array:
    tensor = inertia.inertia
    return np.array([0.0] * 4 + [tensor[k] for k in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))])


def _body_name(model: pinocchio.Model, index: int) -> str:
    for frame in model.frames:
        if frame.type == pinocchio.FrameType.BODY and frame.parentJoint == index:
            return str(frame.name)
    return str(model.names[index])


def _joint(model: pinocchio.Model, index: int) -> Joint:
    joint, name = model.joints[index], str(model.names[index])
    shortname = joint.shortname()
    if not _ONE_COORDINATE.fullmatch(shortname):
        raise InputError(
            f"{model.name}: joint {name!r} is a {shortname}; only revolute and prismatic joints are supported "
            "(for a floating base, use three prismatic and three revolute joints)"
        )
    axis, turns = _axis(model, index)
    limits = _limits(model, index)
    unbounded = joint.nq == 2 or (limits.lower == -math.inf and limits.upper == math.inf)
    kind = JointKind.PRISMATIC if not turns else JointKind.CONTINUOUS if unbounded else JointKind.REVOLUTE
    return Joint(name, kind, axis, limits, _drive(model, index))


def _axis(model: pinocchio.Model, index: int) -> tuple[Array, bool]:
    joint = model.joints[index]
    data = joint.createData()
    joint.calc(data, pinocchio.neutral(model))
    subspace = np.ravel(data.S)
    turns = bool(np.any(subspace[3:]))
    return subspace[3:] if turns else subspace[:3], turns


def _limits(model: pinocchio.Model, index: int) -> Limits:
    lower, upper, velocity, effort = _bounds(model, index)
    if lower == upper == 0.0:
        lower, upper = -math.inf, math.inf
    try:
        return Limits(lower, upper, *(most if most > 0.0 else math.inf for most in (velocity, effort)))
    except InputError as error:
        raise InputError(f"{model.name}: joint {model.names[index]!r}: {error}") from error


def _drive(model: pinocchio.Model, index: int) -> Drive:
    """Joint's drive; Pinocchio has zeros where nothing is modelled."""
    v = model.joints[index].idx_v
    own = (float(numbers[v]) or None for numbers in (model.armature, model.damping, model.friction))
    armature, damping, friction = own
    try:
        return Drive(armature, damping, friction)
    except InputError as error:
        raise InputError(f"{model.name}: joint {model.names[index]!r}: {error}") from error


def _bounds(model: pinocchio.Model, index: int) -> list[float]:
    v, q = model.joints[index].idx_v, model.joints[index].idx_q
    lower, upper = -math.inf, math.inf
    if model.joints[index].nq == 1:
        lower, upper = model.lowerPositionLimit[q], model.upperPositionLimit[q]
    values = (lower, upper, model.velocityLimit[v], model.effortLimit[v])
    return [math.copysign(math.inf, x) if abs(x) > _UNLIMITED else float(x) for x in values]


def _zero_limited(model: pinocchio.Model) -> list[str]:
    bounds = {model.names[i]: _bounds(model, i) for i in range(1, model.njoints)}
    return [f"{name} ({zeros})" for name, own in bounds.items() if (zeros := zero_limits(*own))]


def _negative_limited(model: pinocchio.Model) -> list[str]:
    return [model.names[i] for i in range(1, model.njoints) if min(_bounds(model, i)[2:]) < 0.0]


def _warn(model: pinocchio.Model, text: str, names: list[str]) -> None:
    if names:
        warn(f"{model.name}: {text}: {', '.join(names)}", SimplificationWarning)


def to_pinocchio_constraints(description: Description, model: pinocchio.Model) -> list[pinocchio.RigidConstraintModel]:
    """
    Return Pinocchio's constraint models of the loop closures.

    Parameters
    ----------
    description : Description
        Mechanism with or without loops.
    model : pinocchio.Model
        Model that `to_pinocchio` returned for it.

    Returns
    -------
    list of pinocchio.RigidConstraintModel
        Three rows for a common point, six for a weld, and two points 1 m apart for a common axis; empty without loops.

    Raises
    ------
    InputError
        If joints follow others (couplings), for which Pinocchio has no model.

    Notes
    -----
    Some rows depend on others, as in planar loops: solve with a proximal method.

    Examples
    --------
    >>> from adaptctl.description import to_pinocchio, to_pinocchio_constraints
    >>> to_pinocchio_constraints(arm.description, to_pinocchio(arm.description))
    []
    """
    if description.loops is None:
        return []
    if description.loops.couplings:
        names = ", ".join(coupling.name for coupling in description.loops.couplings)
        raise InputError(
            f"{description.name}: joint couplings are not supported by Pinocchio's constraint models: {names}"
        )
    return [m for closure in description.loops.closures for m in _models(description, closure, model)]


def _models(description: Description, closure: Closure, model: pinocchio.Model) -> list[pinocchio.RigidConstraintModel]:
    first, second = (
        _at_joint(description, link, frame)
        for link, frame in ((closure.first, closure.first_frame), (closure.second, closure.second_frame))
    )
    weld = closure.kind is ClosureKind.WELD
    heights = (0.0, 1.0) if closure.kind is ClosureKind.AXIS else (0.0,)
    kind = pinocchio.ContactType.CONTACT_6D if weld else pinocchio.ContactType.CONTACT_3D
    models = []
    for height in heights:
        up = pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, height]))
        frames = (first[0], first[1] * up, second[0], second[1] * up)
        constraint = pinocchio.RigidConstraintModel(kind, model, *frames, pinocchio.ReferenceFrame.LOCAL)
        constraint.name = closure.name
        models.append(constraint)
    return models


def _at_joint(description: Description, link: str | None, frame: Pose) -> tuple[int, pinocchio.SE3]:
    index = next((i for i, known in enumerate(description.links) if known.name == link), -1)
    pose = frame if link is None else description.links[index].joint_to_link @ frame
    return index + 1, pinocchio.SE3(np.array(pose.rotation), np.array(pose.translation))
