"""The wrench that moves one link, as a linear function of its ten parameters."""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.dynamics.recursion.motion import LinkMotion, Twist
from adaptctl.scalars import Scalar, Vec, cross, dot


class Wrench:
    """A wrench on a link: `force` (3,), N, and `moment` (3,) about the link's origin, N m, both in the link's axes. `+`
    adds two wrenches on the same link. Nothing is checked."""

    __slots__ = ("force", "moment")

    def __init__(self, force: Vec, moment: Vec) -> None:
        self.force, self.moment = force, moment

    def __add__(self, other: Wrench) -> Wrench:
        return Wrench(self.force + other.force, self.moment + other.moment)


def wrench(motion: LinkMotion, ten: Sequence[Scalar]) -> Wrench:
    """The force, N, and moment about the link's origin, N m, in the link's axes, as a `Wrench`, that give a link its
    `motion` against inertia and gravity.

    The force is m acc + lever mc, the moment mc x acc plus that of the inertia (`inertia_moments`), acc and lever being
    those of `motion`. `ten` (10,) are the link's inertial parameters m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz,
    I_zz (kg, kg m, kg m^2, about the link frame's origin); another number of them raises `ValueError` or `IndexError`.
    """
    m, mc = ten[0], Vec(ten[1], ten[2], ten[3])
    force = m * motion.acc + motion.lever @ mc
    moment = cross(mc, motion.acc)
    for weight, column in zip(ten[4:], inertia_moments(motion), strict=True):
        moment = moment + weight * column
    return Wrench(force, moment)


def inertia_moments(motion: LinkMotion) -> tuple[Vec, ...]:
    """Moments (3,) about a link's origin, in its axes, that give the link its `motion`, for each of its inertias I_xx,
    I_xy, I_yy, I_xz, I_yz, I_zz: six vectors, N m per kg m^2. The sum of each times its inertia is I alpha + (w x I r +
    r x I w)/2 for the inertia tensor I, the angular acceleration alpha, and the actual and the reference angular
    velocities w and r of the motion. Nothing is checked."""
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
    """Powers, W per unit of an inertial parameter, of wrenches on a link that moves with a `twist`: a list of one
    scalar for each index in `keep`, from 0 to 9. The wrench of an index is the one that gives the link its `motion`
    where that parameter is 1 and the nine others are 0.

    The parameters are m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2, about the link frame's
    origin). `motion` is a `LinkMotion`; `twist` has the link's angular velocity, rad/s, and its origin's velocity, m/s,
    in the link's axes. For the twist under unit velocity of a joint, powers are entries of the torque regressor, N m (N
    if prismatic) per unit of each parameter. Indices are not checked.
    """
    moments = inertia_moments(motion) if any(k >= 4 for k in keep) else ()
    levered = motion.lever.T @ twist.v + cross(motion.acc, twist.w) if any(1 <= k <= 3 for k in keep) else None
    first = tuple(levered) if levered is not None else ()
    return [
        dot(motion.acc, twist.v) if k == 0 else first[k - 1] if k <= 3 else dot(moments[k - 4], twist.w) for k in keep
    ]
