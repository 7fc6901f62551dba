"""Forward dynamics by articulated bodies (Featherstone 1983; 2008, chapter 7)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from adaptctl.dynamics.recursion.frame_choice import held_parameters
from adaptctl.dynamics.recursion.mass_matrix import body
from adaptctl.dynamics.recursion.motion import GROUND, LinkMotion, Twist, carried, moved
from adaptctl.dynamics.recursion.newton_euler import Wrench, joint_power, lifted, wrench
from adaptctl.dynamics.recursion.segment import Placement, symmetric_up, tensor_up
from adaptctl.scalars import ZERO, Column, Mat, Scalar, Vec, dot, product


class ArticulatedBody(NamedTuple):
    """Articulated-body inertia (6, 6), in blocks (3, 3)."""

    inertia: Mat
    coupling: Mat
    mass: Mat

    def __add__(self, other: Any) -> ArticulatedBody:
        return ArticulatedBody(*(a + b for a, b in zip(self, other, strict=True)))

    def load(self, acceleration: Twist) -> Wrench:
        """Wrench about the body's reference point that gives the body an acceleration."""
        alpha, acc = acceleration.w, acceleration.v
        return Wrench(self.coupling.T @ alpha + self.mass @ acc, self.inertia @ alpha + self.coupling @ acc)

    def without(self, load: Wrench, inverse: Scalar) -> ArticulatedBody:
        """Articulated-body inertia with the link's joint free."""
        moment, force = inverse * load.moment, inverse * load.force
        return ArticulatedBody(
            _symmetric(self.inertia - _outer(moment, load.moment)),
            self.coupling - _outer(moment, load.force),
            _symmetric(self.mass - _outer(force, load.force)),
        )

    def moved_origin(self, offset: Vec) -> ArticulatedBody:
        """This inertia about another point."""
        arm = _crossing(offset)
        coupling = self.coupling + product(arm, self.mass)
        spread = product(arm, self.coupling.T) + product(coupling, arm.T)
        return ArticulatedBody(_symmetric(self.inertia + spread), coupling, self.mass)

    def raised(self, place: Placement, rotor: Scalar) -> ArticulatedBody:
        """Inertia at the parent link's origin, in its axes."""
        if place.segment.whole is not None and any(place.segment.joint_to_link):  # then one way costs less than two
            return self.turned_up(place).moved_origin(place.near + place.up(place.shift))
        at_joint = self.moved_origin(place.shift)
        if isinstance(rotor, float) and rotor == 0.0:
            at_joint = at_joint.free_along(place)
        return at_joint.turned_up(place).moved_origin(place.near)

    def free_along(self, place: Placement) -> ArticulatedBody:
        """Inertia of a link with a free joint, with exact zeros along its axis."""
        still = [abs(x) != 1.0 for x in place.segment.axis]
        if all(still):
            return self
        if place.segment.turns:
            return ArticulatedBody(_kept(self.inertia, still, still), _kept(self.coupling, still, _ALL), self.mass)
        return ArticulatedBody(self.inertia, _kept(self.coupling, _ALL, still), _kept(self.mass, still, still))

    def turned_up(self, place: Placement) -> ArticulatedBody:
        """Inertia in the parent link's axes, about the same point."""
        inertia, mass = symmetric_up(place, self.inertia), symmetric_up(place, self.mass)
        return ArticulatedBody(inertia, tensor_up(place, self.coupling), mass)


class _Joint(NamedTuple):
    load: Wrench
    inverse: Scalar
    torque: Scalar


def accelerations(
    places: Sequence[Placement],
    unaccelerated: Sequence[LinkMotion],
    parameters: Column,
    rotors: Sequence[Scalar],
    torque: Column,
) -> Column:
    """Joint accelerations (n,) by articulated bodies, in linear time."""
    joints = _freed(places, unaccelerated, parameters, rotors, torque)
    found: list[Scalar] = []
    links: list[Twist] = []
    for place, joint in zip(places, joints, strict=True):
        parent = place.segment.parent
        base = carried(place, links[parent]) if parent != GROUND else Twist(ZERO, ZERO)
        held = dot(joint.load.moment, base.w) + dot(joint.load.force, base.v)
        found.append(joint.inverse * (joint.torque - held))
        own = moved(place, found[-1])
        links.append(Twist(base.w + own.w, base.v + own.v))
    return Column(found)


def _freed(
    places: Sequence[Placement],
    unaccelerated: Sequence[LinkMotion],
    parameters: Column,
    rotors: Sequence[Scalar],
    torque: Column,
) -> list[_Joint]:
    tens = [held_parameters(place, parameters.of[10 * i : 10 * i + 10]) for i, place in enumerate(places)]
    bodies = [_articulated(ten) for ten in tens]
    loads = [wrench(motion, ten) for motion, ten in zip(unaccelerated, tens, strict=True)]
    joints: list[_Joint] = []
    for i in reversed(range(len(places))):
        place = places[i]
        load, left = bodies[i].load(moved(place, 1.0)), torque[i] - joint_power(place, loads[i])
        joint = _Joint(load, 1.0 / (joint_power(place, load) + rotors[i]), left)
        joints.append(joint)
        parent, pull = place.segment.parent, joint.inverse * left
        if parent != GROUND:
            bodies[parent] += bodies[i].without(load, joint.inverse).raised(place, rotors[i])
            loads[parent] += lifted(place, loads[i] + Wrench(pull * load.force, pull * load.moment))
    return joints[::-1]


def _articulated(ten: Sequence[Scalar]) -> ArticulatedBody:
    link = body(ten)
    m = link.mass
    return ArticulatedBody(
        link.inertia, _crossing(link.moment), Mat(Vec(m, 0.0, 0.0), Vec(0.0, m, 0.0), Vec(0.0, 0.0, m))
    )


def _crossing(r: Vec) -> Mat:
    """Matrix of r x."""
    return Mat(Vec(0.0, -r.z, r.y), Vec(r.z, 0.0, -r.x), Vec(-r.y, r.x, 0.0))


def _symmetric(a: Mat) -> Mat:
    return Mat(a.x, Vec(a.x.y, a.y.y, a.y.z), Vec(a.x.z, a.y.z, a.z.z))


_ALL = (True, True, True)


def _kept(a: Mat, rows: Sequence[bool], columns: Sequence[bool]) -> Mat:
    pairs = zip(a, rows, strict=True)
    return Mat(*(Vec(*(x if i and j else 0.0 for x, j in zip(row, columns, strict=True))) for row, i in pairs))


def _outer(a: Vec, b: Vec) -> Mat:
    return Mat(a.x * b, a.y * b, a.z * b)
