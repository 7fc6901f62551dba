"""Loops as Pinocchio's constraint models, to go with `to_pinocchio`'s model of the tree."""

from __future__ import annotations

import numpy as np
import pinocchio

from adaptctl.description.description import Description
from adaptctl.description.loops import Closure, ClosureKind
from adaptctl.description.pose import Pose
from adaptctl.errors import InputError


def to_pinocchio_constraints(description: Description, model: pinocchio.Model) -> list[pinocchio.RigidConstraintModel]:
    """Pinocchio's constraint models of all loop closures of a `description`, on the `model` that `to_pinocchio` made of
    it; an empty list without loops.

    A common point is a contact of three rows (scalar constraints) and a weld one of six. Pinocchio knows no common
    axis: that becomes two models, common points 1 m apart on it, one of whose six rows is dependent. Rows are in the
    frame of the first link's joint. Where a loop is planar some rows depend on others, as in the mechanism itself:
    solve with a proximal method. Raises `InputError` for couplings (joints that follow others), which have no such
    model. The `model` is not checked.
    """
    if description.loops is None:
        return []
    if description.loops.couplings:
        names = ", ".join(coupling.name for coupling in description.loops.couplings)
        raise InputError(f"{description.name}: Pinocchio's constraint models hold no couplings of joints: {names}")
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
    """A frame's joint in the model, 0 for the ground, and its place there."""
    index = next((i for i, known in enumerate(description.links) if known.name == link), -1)
    pose = frame if link is None else description.links[index].far @ frame
    return index + 1, pinocchio.SE3(np.array(pose.rotation), np.array(pose.translation))
