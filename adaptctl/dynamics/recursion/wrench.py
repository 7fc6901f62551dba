"""The wrench that moves one link, as a linear function of its ten parameters."""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.dynamics.recursion.motion import LinkMotion, Twist
from adaptctl.scalars import Scalar, Vec, cross, dot


class Wrench:
    """A force and its moment about the link's origin, in the link's frame (N, N m)."""

    __slots__ = ("force", "moment")

    def __init__(self, force: Vec, moment: Vec) -> None:
        self.force, self.moment = force, moment

    def __add__(self, other: Wrench) -> Wrench:
        return Wrench(self.force + other.force, self.moment + other.moment)


def wrench(motion: LinkMotion, ten: Sequence[Scalar]) -> Wrench:
    """The wrench that moves the link: f = m acc + lever mc, n = mc x acc + the moment of its inertia."""
    m, mc = ten[0], Vec(ten[1], ten[2], ten[3])
    force = m * motion.acc + motion.lever @ mc
    moment = cross(mc, motion.acc)
    for weight, column in zip(ten[4:], inertia_moments(motion), strict=True):
        moment = moment + weight * column
    return Wrench(force, moment)


def inertia_moments(motion: LinkMotion) -> tuple[Vec, ...]:
    """The moments of unit I_xx, I_xy, I_yy, I_xz, I_yz, I_zz: I alpha + (w x I r + r x I w) / 2."""
    a, b, p = motion.alpha, motion.lever, motion.products
    return (
        Vec(a.x, p.xz, -p.xy),
        Vec(-b.z.x, b.z.y, p.xx - p.yy),
        Vec(-p.yz, a.y, p.xy),
        Vec(b.y.x, p.zz - p.xx, -b.y.z),
        Vec(p.yy - p.zz, -b.x.y, b.x.z),
        Vec(p.yz, -p.xz, a.z),
    )


def power(motion: LinkMotion, twist: Twist, keep: Sequence[int]) -> list[Scalar]:
    """The power of a twist against the wrench of each kept unit parameter: one entry of a regressor each."""
    moments = inertia_moments(motion) if any(k >= 4 for k in keep) else ()
    levered = motion.lever.T @ twist.v + cross(motion.acc, twist.w) if any(1 <= k <= 3 for k in keep) else None
    first = tuple(levered) if levered is not None else ()
    return [
        dot(motion.acc, twist.v) if k == 0 else first[k - 1] if k <= 3 else dot(moments[k - 4], twist.w) for k in keep
    ]
