"""Newton-Euler equations of a tree."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from operator import add

from adaptctl.dynamics.recursion.frame_choice import held_parameters, per_own_parameter
from adaptctl.dynamics.recursion.motion import GROUND, LinkMotion, Twist, carried, moved, twists
from adaptctl.dynamics.recursion.segment import Placement
from adaptctl.scalars import Column, Scalar, Vec, cross, dot


class Wrench:
    """Force in N and moment in N m about a link's origin."""

    __slots__ = ("force", "moment")

    def __init__(self, force: Vec, moment: Vec) -> None:
        self.force, self.moment = force, moment

    def __add__(self, other: Wrench) -> Wrench:
        return Wrench(self.force + other.force, self.moment + other.moment)


def wrench(motion: LinkMotion, ten: Sequence[Scalar]) -> Wrench:
    """Wrench of a link's motion against inertia and gravity."""
    m, mc = ten[0], Vec(ten[1], ten[2], ten[3])
    force = m * motion.acc + motion.lever @ mc
    moment = cross(mc, motion.acc)
    for weight, column in zip(ten[4:], inertia_moments(motion), strict=True):
        moment = moment + weight * column
    return Wrench(force, moment)


def inertia_moments(motion: LinkMotion) -> tuple[Vec, ...]:
    """Moments (3,) of a link's motion per unit of each of its six inertia tensor entries."""
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
    """Powers of wrenches on a moving link."""
    moments = inertia_moments(motion) if any(k >= 4 for k in keep) else ()
    levered = motion.lever.T @ twist.v + cross(motion.acc, twist.w) if any(1 <= k <= 3 for k in keep) else None
    first = tuple(levered) if levered is not None else ()
    return [
        dot(motion.acc, twist.v) if k == 0 else first[k - 1] if k <= 3 else dot(moments[k - 4], twist.w) for k in keep
    ]


def joint_torques(places: Sequence[Placement], moving: Sequence[LinkMotion], parameters: Column) -> Column:
    """Joint torques (n,) by the backward recursion."""
    torques: list[Scalar] = [0.0] * len(places)
    for i, load in subtree_loads(places, moving, parameters):
        torques[i] = joint_power(places[i], load)
    return Column(torques)


def subtree_loads(
    places: Sequence[Placement], moving: Sequence[LinkMotion], parameters: Column
) -> Iterator[tuple[int, Wrench]]:
    """Each link, from the last one, and the wrench on it with all that it carries."""
    tens = (parameters.of[10 * i : 10 * i + 10] for i in range(len(places)))
    held = map(held_parameters, places, tens)
    loads = [wrench(motion, ten) for motion, ten in zip(moving, held, strict=True)]
    for i in reversed(range(len(places))):
        yield i, loads[i]
        if places[i].segment.parent != GROUND:
            loads[places[i].segment.parent] += lifted(places[i], loads[i])


def joint_power(place: Placement, load: Wrench) -> Scalar:
    """Torque in N m (N if prismatic) at the joint that a wrench on its link makes."""
    z = place.segment.axis
    if not place.segment.turns:
        return dot(load.force, z)
    return dot(load.moment, z) + dot(load.force, cross(z, place.shift))


def lifted(place: Placement, load: Wrench) -> Wrench:
    """Wrench about the parent link's origin."""
    force = place.up(load.force)
    moment = place.up(load.moment + cross(place.shift, load.force))
    return Wrench(force, moment + cross(place.near, force))


def torque_regressor(places: Sequence[Placement], moving: Sequence[LinkMotion], columns: Sequence[int]) -> list[Column]:
    """Torque regressor (n, k) of a tree, by rows."""
    return powers_by_joint(places, [(moving, lambda i: moved(places[i], 1.0))], columns)


def powers_by_joint(
    places: Sequence[Placement],
    pairs: Sequence[tuple[Sequence[LinkMotion], Callable[[int], Twist]]],
    columns: Sequence[int],
) -> list[Column]:
    """Powers (n, k) of links' motions on twists that each joint gives its link, the sum of all pairs, by rows."""
    kept = kept_by_link(columns, len(places))
    rows: list[dict[int, Scalar]] = [{} for _ in places]
    done: list[list[dict[int, Twist]]] = [[] for _ in pairs]
    for i, place in enumerate(places):
        for (_, first), twists_of in zip(pairs, done, strict=True):
            twists_of.append(joint_twists(place, i, twists_of) | {i: first(i)})
        for j in done[0][i]:
            given = [(moving[i], twists_of[i][j]) for (moving, _), twists_of in zip(pairs, done, strict=True)]
            rows[j] |= {10 * i + k: y for k, y in zip(kept[i], _kept_powers(place, given, kept[i]), strict=True)}
    return [Column(row.get(column, 0.0) for column in columns) for row in rows]


def joint_twists(place: Placement, i: int, done: Sequence[dict[int, Twist]]) -> dict[int, Twist]:
    """Twists of link `i` that those of the joints before it carry along."""
    parent = place.segment.parent
    return {j: carried(place, twist) for j, twist in done[parent].items()} if parent != GROUND else {}


def kept_by_link(columns: Sequence[int], links: int) -> list[list[int]]:
    """Parameter indices sorted by link."""
    kept: list[list[int]] = [[] for _ in range(links)]
    for column in columns:
        kept[column // 10].append(column % 10)
    return kept


def powers(places: Sequence[Placement], moving: Sequence[LinkMotion], s: Column, columns: Sequence[int]) -> Column:
    """Regressor's transpose times joint rates, Y' s (k,) in W per unit of k inertial parameters."""
    kept = kept_by_link(columns, len(places))
    moved_by = zip(moving, twists(places, s), strict=True)
    of_links = (_kept_powers(place, [pair], keep) for place, pair, keep in zip(places, moved_by, kept, strict=True))
    found = [dict(zip(keep, powers, strict=True)) for keep, powers in zip(kept, of_links, strict=True)]
    return Column(found[column // 10][column % 10] for column in columns)


def _kept_powers(place: Placement, pairs: Sequence[tuple[LinkMotion, Twist]], keep: Sequence[int]) -> Sequence[Scalar]:
    needed = keep if place.turn is None or not keep else range(10)
    total = [reduce(add, x) for x in zip(*(power(*pair, needed) for pair in pairs), strict=True)]
    if place.turn is None or not keep:
        return total
    own = per_own_parameter(place.turn, total)
    return [own[k] for k in keep]
