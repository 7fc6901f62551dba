"""Newton and Euler's equations of a tree's links: wrenches, torques, their regressor, and the powers of its columns."""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.dynamics.recursion.frame_choice import held_parameters, per_own_parameter
from adaptctl.dynamics.recursion.motion import GROUND, LinkMotion, Twist, carried, moved, twists
from adaptctl.dynamics.recursion.segment import Placement
from adaptctl.scalars import Column, Scalar, Vec, cross, dot


class Wrench:
    """A wrench on a link: `force` (3,), N, and `moment` (3,) about the link's origin, N m, both in the link's axes."""

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
    """Powers, W per unit of an inertial parameter, of wrenches on a link that moves with a `twist`."""
    moments = inertia_moments(motion) if any(k >= 4 for k in keep) else ()
    levered = motion.lever.T @ twist.v + cross(motion.acc, twist.w) if any(1 <= k <= 3 for k in keep) else None
    first = tuple(levered) if levered is not None else ()
    return [
        dot(motion.acc, twist.v) if k == 0 else first[k - 1] if k <= 3 else dot(moments[k - 4], twist.w) for k in keep
    ]


def joint_torques(places: Sequence[Placement], moving: Sequence[LinkMotion], parameters: Column) -> Column:
    """Joint torques (n,), that give the n links of a tree, their motion against inertia and gravity."""
    tens = (parameters.of[10 * i : 10 * i + 10] for i in range(len(places)))
    held = map(held_parameters, places, tens)
    loads = [wrench(motion, ten) for motion, ten in zip(moving, held, strict=True)]
    torques: list[Scalar] = [0.0] * len(places)
    for i in reversed(range(len(places))):
        place = places[i]
        torques[i] = joint_power(place, loads[i])
        if place.segment.parent != GROUND:
            loads[place.segment.parent] += lifted(place, loads[i])
    return Column(torques)


def joint_power(place: Placement, load: Wrench) -> Scalar:
    """The joint torque, that corresponds to a wrench on the joint's link."""
    z = place.segment.axis
    if not place.segment.turns:
        return dot(load.force, z)
    return dot(load.moment, z) + dot(load.force, cross(z, place.shift))


def lifted(place: Placement, load: Wrench) -> Wrench:
    """A wrench about the parent link's origin and in the parent's axes, from the same wrench about the link's origin in
    its axes, `load`: a `Wrench` of force, N, and moment, N m. `place` is the link's placement in its parent. Nothing is
    checked."""
    force = place.up(load.force)
    moment = place.up(load.moment + cross(place.shift, load.force))
    return Wrench(force, moment + cross(place.near, force))


def torque_regressor(places: Sequence[Placement], moving: Sequence[LinkMotion], columns: Sequence[int]) -> list[Column]:
    """Torque regressor Y (n, k) of a tree of n links, as n rows, one `Column` (k,) a joint of k inertial parameters."""
    kept = kept_by_link(columns, len(places))
    rows: list[dict[int, Scalar]] = [{} for _ in places]
    joints: list[dict[int, Twist]] = []
    for i, place in enumerate(places):
        joints.append(joint_twists(place, i, joints))
        for j, twist in joints[i].items():
            found = _kept_powers(place, moving[i], twist, kept[i])
            rows[j] |= {10 * i + k: y for k, y in zip(kept[i], found, strict=True)}
    return [Column(row.get(column, 0.0) for column in columns) for row in rows]


def joint_twists(place: Placement, i: int, done: Sequence[dict[int, Twist]]) -> dict[int, Twist]:
    """Twists of the link of zero-based index `i` under unit velocity of each joint that moves it, a `Twist` by joint
    index: the columns of the link's Jacobian in its axes, rad/rad and m/rad (m/m for a prismatic joint's velocity).
    `place` is the link's placement in its parent. `done` has what this function returned for the links of lower index,
    in order, the parent among them; for a link on the ground it may be empty. Nothing is checked."""
    parent = place.segment.parent
    above = done[parent] if parent != GROUND else {}
    return {j: carried(place, twist) for j, twist in above.items()} | {i: moved(place, 1.0)}


def kept_by_link(columns: Sequence[int], links: int) -> list[list[int]]:
    """Parameter indices sorted by link."""
    kept: list[list[int]] = [[] for _ in range(links)]
    for column in columns:
        kept[column // 10].append(column % 10)
    return kept


def powers(places: Sequence[Placement], moving: Sequence[LinkMotion], s: Column, columns: Sequence[int]) -> Column:
    """The powers Y' s (k,), W per unit of each of k inertial parameters, with the transpose Y' of the torque regressor
    Y (n, k) of a tree of n links, one joint each. Y is not formed, and the time is linear in n.

    `places` has the links' placements in their parents, parents before children; `moving` the motion of each for which
    Y is the regressor, a `LinkMotion`; `s` (n,) are joint velocities, rad/s (m/s if prismatic); `columns` the k indices
    among the ten parameters of all links (10 n,), m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg
    m^2, about the link frame's origin) of each. An index of 10 n or more, or too short an s, raises `IndexError`;
    negative indices are not refused.
    """
    kept = kept_by_link(columns, len(places))
    of_links = map(_kept_powers, places, moving, twists(places, s), kept)
    found = [dict(zip(keep, powers, strict=True)) for keep, powers in zip(kept, of_links, strict=True)]
    return Column(found[column // 10][column % 10] for column in columns)


def _kept_powers(place: Placement, motion: LinkMotion, twist: Twist, keep: Sequence[int]) -> Sequence[Scalar]:
    """The powers per unit of the kept parameters of a link in its own axes."""
    if place.turn is None or not keep:
        return power(motion, twist, keep)
    own = per_own_parameter(place.turn, power(motion, twist, range(10)))
    return [own[k] for k in keep]
