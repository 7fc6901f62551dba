"""Free and ball joints of MuJoCo's specifications: held, or made of slides and hinges."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.description.readers.entries import FLOATING_FLAG
from adaptctl.description.readers.mujoco_arm import BALL, FREE, HINGE, SLIDE, mujoco_package
from adaptctl.description.readers.xml_elements import element_of, refuse
from adaptctl.description.transforms import FLOATING_JOINTS
from adaptctl.errors import InputError

if TYPE_CHECKING:
    import mujoco

BALL_JOINTS = FLOATING_JOINTS[3:]
MAX_PITCH = math.radians(80.0)
"""rad, of a ball joint's second hinge, at whose right angle the other two turn about one axis"""
_ACTING = ("armature", "damping", "frictionloss", "stiffness")


@dataclass(frozen=True)
class Rewriting:
    """Hinges and slides for all joints of a specification, with names of what was changed."""

    spec: mujoco.MjSpec
    elements: Sequence[Element] = ()
    held: list[str] = field(default_factory=list)
    """bodies whose free joints are gone"""
    floating: list[str] = field(default_factory=list)
    """joints of the floating base"""
    ignored: list[str] = field(default_factory=list)
    """ball joints that had friction, armature, a spring or a limit, and actuators on free and ball joints"""

    @classmethod
    def of(
        cls, spec: mujoco.MjSpec, elements: Sequence[Element] = (), root: str | None = None, floating_base: bool = False
    ) -> Rewriting:
        """Bases held, or the base at the root floating; ball joints as hinges."""
        made = cls(spec, elements)
        base = made._base(root) if floating_base else None
        for body, joint in made._joints(FREE):
            made._validate_free(body, joint, floats=base is not None and body.name == base.name)
        for body, joint in made._joints(FREE):
            if base is None or body.name != base.name:
                made._ignore_actuators(joint.name)
                made.held.append(body.name)
                _delete(spec, joint)
        if base is not None:
            made._float(base)
        for body, joint in made._joints(BALL):
            made._hinge(body, joint)
        return made

    def _joints(self, kind: int) -> list[tuple[Any, Any]]:
        return [(body, joint) for body in self.spec.bodies for joint in body.joints if joint.type == kind]

    def _base(self, root: str | None) -> Any:
        """Body that may float; None where nothing moves or the root is unknown, which is refused later."""
        bodies = list(self.spec.bodies)[1:]
        if root is not None:
            return next((body for body in bodies if body.name == root), None)
        tops = [body for body in bodies if body.parent.name == self.spec.worldbody.name]
        carrying = [top for top in tops if any(joint.type != FREE for joint in _joints_below(top))]
        moved = carrying or [top for top in tops if any(joint.type == FREE for joint in top.joints)]
        if len(moved) > 1:
            names, first = ", ".join(repr(top.name) for top in moved), moved[0].name
            raise InputError(
                f"{len(moved)} root bodies move, {names}; select the one that floats, such as root={first!r} "
                f"(--root {first})"
            )
        return moved[0] if moved else None

    def _validate_free(self, body: Any, joint: Any, floats: bool) -> None:
        element, above = element_of(joint.info, self.elements), body.parent
        while above is not None and not above.joints:
            above = above.parent
        if len(body.joints) > 1 or above is not None:
            text = "a free joint must be the only joint of its body, and the bodies above must be fixed"
            refuse(element, f"body {body.name!r}: {text}")
        for what in _ACTING if floats else ():
            if np.any(getattr(joint, what)):
                given = np.ravel(getattr(joint, what)).tolist()
                name = joint.name or body.name
                refuse(element, f"joint {name!r}: {what}: expected 0 for a free joint, got {given[0]:g}")

    def _float(self, base: Any) -> None:
        free = [joint for joint in base.joints if joint.type == FREE]
        if base.joints and not free:
            own = base.joints[0].name
            refuse(
                element_of(base.info, self.elements),
                f"body {base.name!r} moves on a joint of its own, {own!r}: there is no base to float; leave out "
                f"{FLOATING_FLAG}",
            )
        joint = free[0] if free else base.add_joint()
        name, place = joint.name or base.name, joint.info if free else base.info
        self._ignore_actuators(joint.name)
        parts = self._unfolded(base, joint, name, FLOATING_JOINTS)
        for part in parts:
            part.pos, part.info = np.zeros(3), place
        self.floating.extend(part.name for part in parts)

    def _hinge(self, body: Any, joint: Any) -> None:
        """Replace a ball joint by three hinges about its place."""
        element, name = element_of(joint.info, self.elements), joint.name or body.name
        kinds = [one.type for one in body.joints]
        if kinds[-1] != BALL or kinds.count(kinds[-1]) > 1:
            refuse(element, f"body {body.name!r}: a ball joint must be the last joint of its body, and the only one")
        if np.any(joint.range) or any(np.any(getattr(joint, what)) for what in _ACTING):
            self.ignored.append(name)
        self._ignore_actuators(joint.name)
        place, info = np.array(joint.pos), joint.info
        parts = self._unfolded(body, joint, name, BALL_JOINTS)
        for part in parts:
            part.pos, part.info = place, info
        most = math.degrees(MAX_PITCH) if self.spec.compiler.degree else MAX_PITCH
        parts[1].limited, parts[1].range = 1, [-most, most]

    def _unfolded(self, body: Any, joint: Any, name: str, kinds: Sequence[Any]) -> list[Any]:
        mjtJoint, parts = mujoco_package().mjtJoint, [joint, *(body.add_joint() for _ in kinds[1:])]
        for part, (suffix, kind, axis) in zip(parts, kinds, strict=True):
            part.name, part.type, part.axis = f"{name}_{suffix}", mjtJoint(HINGE if kind.is_revolute else SLIDE), axis
            part.ref, part.limited, part.actfrclimited = 0.0, 0, 0
            for what in _ACTING:
                setattr(part, what, 0.0 * np.asarray(getattr(part, what)))
        return parts

    def _ignore_actuators(self, joint: str) -> None:
        for actuator in [one for one in self.spec.actuators if joint and one.target == joint]:
            self.ignored.append(actuator.name or f"actuator on {joint}")
            _delete(self.spec, actuator)


def held_scene(spec: mujoco.MjSpec) -> list[str]:
    """Names of the bases of a scene's mechanisms, whose free joints are taken out; what floats alone still does."""
    held = []
    for body in spec.bodies:
        for joint in [joint for joint in body.joints if joint.type == FREE]:
            if any(other.type != FREE for other in _joints_below(body)):
                held.append(body.name)
                _delete(spec, joint)
    for key in list(spec.keys) if held else ():
        _delete(spec, key)  # whose coordinates are those of other joints
    return held


def _delete(spec: Any, element: Any) -> None:
    if hasattr(spec, "delete"):
        spec.delete(element)
    else:
        element.delete()  # before MuJoCo 3.3.1


def _joints_below(body: Any) -> Iterator[Any]:
    pending = [body]
    while pending:
        one = pending.pop()
        yield from one.joints
        pending += list(one.bodies)
