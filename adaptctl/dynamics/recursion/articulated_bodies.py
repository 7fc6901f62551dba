"""Forward dynamics by articulated bodies (Featherstone 1983; 2008, chapter 7): in time linear in the number of links.

A link's articulated inertia is its inertia as its parent has to move it, the joints beyond free: symmetric, 6 by 6,
about
the link's origin, in blocks. Loads and accelerations are differences from the motion with all joints unaccelerated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from adaptctl.dynamics.recursion.mass_matrix import body, turned_up
from adaptctl.dynamics.recursion.motion import GROUND, LinkMotion, Twist, carried, moved
from adaptctl.dynamics.recursion.newton_euler import joint_power, lifted
from adaptctl.dynamics.recursion.segment import Placement
from adaptctl.dynamics.recursion.wrench import Wrench, wrench
from adaptctl.scalars import ZERO, Column, Mat, Scalar, Vec, dot, product


class ArticulatedBody(NamedTuple):
    """An articulated body's inertia, the wrench that accelerates a link with what hangs on it: moment = inertia alpha +
    coupling acc, force = coupling' alpha + mass acc."""

    inertia: Mat
    coupling: Mat
    mass: Mat

    def __add__(self, other: Any) -> ArticulatedBody:
        return ArticulatedBody(*(a + b for a, b in zip(self, other, strict=True)))

    def load(self, acceleration: Twist) -> Wrench:
        """The wrench of an acceleration, its angular part `w` and its linear part `v`."""
        alpha, acc = acceleration.w, acceleration.v
        return Wrench(self.coupling.T @ alpha + self.mass @ acc, self.inertia @ alpha + self.coupling @ acc)

    def without(self, load: Wrench, inverse: Scalar) -> ArticulatedBody:
        """Articulated inertia seen through a free joint, whose unit acceleration takes this load and has this inverse
        inertia."""
        moment, force = inverse * load.moment, inverse * load.force
        return ArticulatedBody(
            _symmetric(self.inertia - _outer(moment, load.moment)),
            self.coupling - _outer(moment, load.force),
            _symmetric(self.mass - _outer(force, load.force)),
        )

    def moved_origin(self, offset: Vec) -> ArticulatedBody:
        """The articulated body about an origin `offset` (m) behind its own."""
        arm = _crossing(offset)
        coupling = self.coupling + product(arm, self.mass)
        spread = product(arm, self.coupling.T) + product(coupling, arm.T)
        return ArticulatedBody(_symmetric(self.inertia + spread), coupling, self.mass)

    def raised(self, place: Placement) -> ArticulatedBody:
        """The articulated body about the parent's origin, in the parent's frame."""
        near = place.segment.near
        if place.segment.whole is not None:  # far from right angles one way costs less than two
            return self.turned_up(place).moved_origin(near + place.up(place.shift))
        return self.moved_origin(place.shift).turned_up(place).moved_origin(near)

    def turned_up(self, place: Placement) -> ArticulatedBody:
        """This articulated body in coordinates of the parent's frame, about the same point."""
        inertia, mass = turned_up(place, self.inertia), turned_up(place, self.mass)
        return ArticulatedBody(inertia, _turned_up(place, self.coupling), mass)


class _Joint(NamedTuple):
    """A free joint: the load of its unit acceleration, its inverse inertia, and the torque left to accelerate it."""

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
    """Joint accelerations (n,) under joint torques, of links with ten parameters each (10N,), whose motion with all
    joints unaccelerated is given; `rotors` (n,) are inertias of the joints themselves."""
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
    """Free joints with the articulated bodies behind them, from the tips inward."""
    tens = [parameters.of[10 * i : 10 * i + 10] for i in range(len(places))]
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
            bodies[parent] += bodies[i].without(load, joint.inverse).raised(place)
            loads[parent] += lifted(place, loads[i] + Wrench(pull * load.force, pull * load.moment))
    return joints[::-1]


def _articulated(ten: Sequence[Scalar]) -> ArticulatedBody:
    """A link on which nothing hangs."""
    link = body(ten)
    m = link.mass
    return ArticulatedBody(
        link.inertia, _crossing(link.moment), Mat(Vec(m, 0.0, 0.0), Vec(0.0, m, 0.0), Vec(0.0, 0.0, m))
    )


def _turned_up(place: Placement, tensor: Mat) -> Mat:
    """A tensor of the link's frame, in the parent's."""
    half = Mat(*map(place.up, tensor.T)).T
    return Mat(*map(place.up, half))


def _crossing(r: Vec) -> Mat:
    """The matrix of r x."""
    return Mat(Vec(0.0, -r.z, r.y), Vec(r.z, 0.0, -r.x), Vec(-r.y, r.x, 0.0))


def _symmetric(a: Mat) -> Mat:
    """A symmetric matrix, each entry below the diagonal that above: it is computed once."""
    return Mat(a.x, Vec(a.x.y, a.y.y, a.y.z), Vec(a.x.z, a.y.z, a.z.z))


def _outer(a: Vec, b: Vec) -> Mat:
    return Mat(a.x * b, a.y * b, a.z * b)
