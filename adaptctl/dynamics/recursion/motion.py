"""Forward recursion of the links' motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from adaptctl.dynamics.recursion.segment import Placement
from adaptctl.scalars import ZERO, Column, Mat, Scalar, Vec, cross

GROUND = -1
AXES = Mat.of(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))


class Twist:
    """Angular velocity, and velocity of the link's origin."""

    __slots__ = ("v", "w")

    def __init__(self, w: Vec, v: Vec) -> None:
        self.w, self.v = w, v


def carried(place: Placement, parent: Twist) -> Twist:
    """Twist of a link from its parent's."""
    w = place.down(parent.w)
    v = place.down(parent.v + cross(parent.w, place.near))
    return Twist(w, v + cross(w, place.shift))


def moved(place: Placement, rate: Scalar) -> Twist:
    """Twist of a link by its own joint alone."""
    axis = place.segment.axis
    if place.segment.turns:
        w = rate * axis
        return Twist(w, cross(w, place.shift))
    return Twist(ZERO, rate * axis)


def twists(places: Sequence[Placement], rate: Column) -> list[Twist]:
    """Twists of all n links."""
    out: list[Twist] = []
    for i, place in enumerate(places):
        parent = place.segment.parent
        own = moved(place, rate[i])
        if parent != GROUND:
            base = carried(place, out[parent])
            own = Twist(base.w + own.w, base.v + own.v)
        out.append(own)
    return out


def bracket(one: Twist, other: Twist) -> Twist:
    """Lie bracket of two twists of a link."""
    return Twist(cross(one.w, other.w), cross(one.w, other.v) + cross(one.v, other.w))


class Products(NamedTuple):
    """Symmetric products (w_i r_j + w_j r_i)/2 of angular velocities."""

    xx: Scalar
    xy: Scalar
    yy: Scalar
    xz: Scalar
    yz: Scalar
    zz: Scalar


ZERO_PRODUCTS = Products(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def products(w: Vec, r: Vec) -> Products:
    """Symmetric products of two angular velocities (3,)."""
    if w is r:
        return Products(w.x * w.x, w.x * w.y, w.y * w.y, w.x * w.z, w.y * w.z, w.z * w.z)
    h = 0.5 * w
    mixed = h.x * r.y + h.y * r.x, h.x * r.z + h.z * r.x, h.y * r.z + h.z * r.y
    return Products(w.x * r.x, mixed[0], w.y * r.y, mixed[1], mixed[2], w.z * r.z)


class LinkMotion:
    """Motion of a link, accelerations less gravity's."""

    __slots__ = ("acc", "alpha", "lever", "products")

    def __init__(self, products: Products, alpha: Vec, acc: Vec) -> None:
        self.products, self.alpha, self.acc = products, alpha, acc
        self.lever = lever(products, alpha)

    @property
    def numbers(self) -> tuple[Scalar, ...]:
        """Twelve scalars from which the motion is rebuilt."""
        return (*self.products, *self.alpha, *self.acc)

    @classmethod
    def of(cls, numbers: Sequence[Scalar]) -> LinkMotion:
        """Motion rebuilt from its twelve `numbers`."""
        return cls(Products(*numbers[:6]), Vec(*numbers[6:9]), Vec(*numbers[9:]))


def lever(p: Products, a: Vec) -> Mat:
    """Matrix L (3, 3) of points' accelerations by rotation."""
    return Mat(
        Vec(-(p.yy + p.zz), p.xy - a.z, p.xz + a.y),
        Vec(p.xy + a.z, -(p.xx + p.zz), p.yz - a.x),
        Vec(p.xz - a.y, p.yz + a.x, -(p.xx + p.yy)),
    )


def motions(places: Sequence[Placement], v: Column, v_r: Column, a_r: Column, gravity: Vec) -> list[LinkMotion]:
    """Motions of all links under v, v_r and a_r (n,)."""
    w = angular_velocities(places, v)
    r = w if v is v_r else angular_velocities(places, v_r)
    ground, out = LinkMotion(ZERO_PRODUCTS, ZERO, -gravity), list[LinkMotion]()
    for i, place in enumerate(places):
        segment, z = place.segment, place.segment.axis
        base = out[segment.parent] if segment.parent != GROUND else ground
        alpha, acc = place.down(base.alpha), place.down(base.acc + base.lever @ place.near)
        spin = cross(v[i] * w[i], z) if w is r else cross((0.5 * v_r[i]) * w[i] + (0.5 * v[i]) * r[i], z)
        if segment.turns:
            alpha = alpha + a_r[i] * z + spin
        else:
            acc = acc + a_r[i] * z + 2.0 * spin
        link = LinkMotion(products(w[i], r[i]), alpha, acc)
        link.acc = link.acc + link.lever @ place.shift
        out.append(link)
    return out


def momenta(moving: Sequence[Twist]) -> list[LinkMotion]:
    """Motions whose wrenches are the links' momenta."""
    return [LinkMotion(ZERO_PRODUCTS, twist.w, twist.v) for twist in moving]


def angular_velocities(places: Sequence[Placement], rate: Column) -> list[Vec]:
    """Angular velocities (3,) of the links."""
    out: list[Vec] = []
    for i, place in enumerate(places):
        segment = place.segment
        w = place.down(out[segment.parent]) if segment.parent != GROUND else ZERO
        out.append(w + rate[i] * segment.axis if segment.turns else w)
    return out
