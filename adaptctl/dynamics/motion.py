"""Forward recursions: how every link moves, in its own frame."""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.dynamics.segment import Placement
from adaptctl.scalars import ZERO, Column, Mat, Scalar, Vec, cross

GROUND = -1


class Twist:
    """A link's angular velocity `w` and the velocity `v` of its origin, in its own frame."""

    __slots__ = ("v", "w")

    def __init__(self, w: Vec, v: Vec) -> None:
        self.w, self.v = w, v


AT_REST = Twist(ZERO, ZERO)


def carried(place: Placement, parent: Twist) -> Twist:
    """The parent's twist at the link's origin, as if the joint were locked."""
    w = place.down(parent.w)
    v = place.down(parent.v + cross(parent.w, place.segment.near))
    return Twist(w, v + cross(w, place.shift))


def moved(place: Placement, rate: Scalar) -> Twist:
    """The twist of a link whose joint alone moves, at the given rate."""
    axis = place.segment.axis
    if place.segment.turns:
        w = rate * axis
        return Twist(w, cross(w, place.shift))
    return Twist(ZERO, rate * axis)


def twists(places: Sequence[Placement], rate: Column) -> list[Twist]:
    """Every link's twist under joint velocities."""
    out: list[Twist] = []
    for i, place in enumerate(places):
        parent = place.segment.parent
        own = moved(place, rate[i])
        if parent != GROUND:
            base = carried(place, out[parent])
            own = Twist(base.w + own.w, base.v + own.v)
        out.append(own)
    return out


class Products:
    """The symmetric products (w_i r_j + w_j r_i) / 2 of two angular velocities."""

    __slots__ = ("xx", "xy", "xz", "yy", "yz", "zz")

    def __init__(self, w: Vec, r: Vec) -> None:
        self.xx, self.yy, self.zz = w.x * r.x, w.y * r.y, w.z * r.z
        if w is r:
            self.xy, self.xz, self.yz = w.x * w.y, w.x * w.z, w.y * w.z
        else:
            h = 0.5 * w
            self.xy = h.x * r.y + h.y * r.x
            self.xz = h.x * r.z + h.z * r.x
            self.yz = h.y * r.z + h.z * r.y


class Motion:
    """A link under two velocities: `w` and `r` turn it, `alpha` and `acc` (less gravity) accelerate it."""

    __slots__ = ("acc", "alpha", "lever", "products", "r", "w")

    def __init__(self, w: Vec, r: Vec, alpha: Vec, acc: Vec) -> None:
        self.w, self.r, self.alpha, self.acc = w, r, alpha, acc
        self.products = Products(w, r)
        self.lever = lever(self.products, alpha)


def lever(p: Products, a: Vec) -> Mat:
    """The matrix that gives a point u its acceleration from turning: a x u + (w x (r x u) + r x (w x u)) / 2."""
    return Mat(
        Vec(-(p.yy + p.zz), p.xy - a.z, p.xz + a.y),
        Vec(p.xy + a.z, -(p.xx + p.zz), p.yz - a.x),
        Vec(p.xz - a.y, p.yz + a.x, -(p.xx + p.yy)),
    )


def motions(places: Sequence[Placement], v: Column, v_r: Column, a_r: Column, gravity: Vec) -> list[Motion]:
    """Newton-Euler's forward recursion, polarised in its two velocities.

    With v_r = v it is the ordinary recursion; otherwise it leads to C(p, v) v_r with the Christoffel C that
    Slotine and Li (1987) need, because the velocity terms are a symmetric bilinear form.
    """
    out: list[Motion] = []
    same = v is v_r
    for i, place in enumerate(places):
        parent = place.segment.parent
        base = out[parent] if parent != GROUND else Motion(ZERO, ZERO, ZERO, -gravity)
        out.append(_next(place, base, v[i], v_r[i], a_r[i], same))
    return out


def _next(place: Placement, base: Motion, v: Scalar, v_r: Scalar, a_r: Scalar, same: bool) -> Motion:
    segment, z = place.segment, place.segment.axis
    w = place.down(base.w)
    r = w if same else place.down(base.r)
    alpha, acc = place.down(base.alpha), place.down(base.acc + base.lever @ segment.near)
    spin = cross(v * w, z) if same else cross((0.5 * v_r) * w + (0.5 * v) * r, z)
    if segment.turns:
        w_own = w + v * z
        link = Motion(w_own, w_own if same else r + v_r * z, alpha + a_r * z + spin, acc)
    else:
        link = Motion(w, r, alpha, acc + a_r * z + 2.0 * spin)
    link.acc = link.acc + link.lever @ place.shift
    return link
