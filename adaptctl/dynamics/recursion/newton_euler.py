"""Newton and Euler's equations of a tree's links: torques, their regressor, and the powers of its columns."""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.dynamics.recursion.motion import GROUND, LinkMotion, Twist, carried, moved, twists
from adaptctl.dynamics.recursion.segment import Placement
from adaptctl.dynamics.recursion.wrench import Wrench, power, wrench
from adaptctl.scalars import Column, Scalar, cross, dot


def joint_torques(places: Sequence[Placement], moving: Sequence[LinkMotion], parameters: Column) -> Column:
    """Torques (n,) that the joints must exert for their links to move so, N m: the backward recursion."""
    loads = [wrench(motion, parameters.of[10 * i : 10 * i + 10]) for i, motion in enumerate(moving)]
    torques: list[Scalar] = [0.0] * len(places)
    for i in reversed(range(len(places))):
        place = places[i]
        torques[i] = joint_power(place, loads[i])
        if place.segment.parent != GROUND:
            loads[place.segment.parent] += lifted(place, loads[i])
    return Column(torques)


def joint_power(place: Placement, load: Wrench) -> Scalar:
    """The joint torque that balances a link's wrench: its power at a unit joint rate."""
    z = place.segment.axis
    if not place.segment.turns:
        return dot(load.force, z)
    return dot(load.moment, z) + dot(load.force, cross(z, place.shift))


def lifted(place: Placement, load: Wrench) -> Wrench:
    """The wrench about the parent's origin, in the parent's frame."""
    force = place.up(load.force)
    moment = place.up(load.moment + cross(place.shift, load.force))
    return Wrench(force, moment + cross(place.segment.near, force))


def torque_regressor(places: Sequence[Placement], moving: Sequence[LinkMotion], columns: Sequence[int]) -> list[Column]:
    """The rows of the torque regressor Y, one a joint, with the asked columns only: Y D = M a_r + C(q, v) v_r + g."""
    kept = kept_by_link(columns, len(places))
    rows: list[dict[int, Scalar]] = [{} for _ in places]
    joints: list[dict[int, Twist]] = []
    for i, place in enumerate(places):
        joints.append(joint_twists(place, i, joints))
        for j, twist in joints[i].items():
            rows[j] |= {10 * i + k: y for k, y in zip(kept[i], power(moving[i], twist, kept[i]), strict=True)}
    return [Column(row.get(column, 0.0) for column in columns) for row in rows]


def joint_twists(place: Placement, i: int, done: Sequence[dict[int, Twist]]) -> dict[int, Twist]:
    """The twist of link i under a unit rate of each joint that moves it: its Jacobian, a column an entry."""
    parent = place.segment.parent
    above = done[parent] if parent != GROUND else {}
    return {j: carried(place, twist) for j, twist in above.items()} | {i: moved(place, 1.0)}


def kept_by_link(columns: Sequence[int], links: int) -> list[list[int]]:
    """For each link, the indices among its ten parameters of the asked columns."""
    kept: list[list[int]] = [[] for _ in range(links)]
    for column in columns:
        kept[column // 10].append(column % 10)
    return kept


def powers(places: Sequence[Placement], moving: Sequence[LinkMotion], s: Column, columns: Sequence[int]) -> Column:
    """The powers Y' s (c,) of each asked parameter's wrench under joint rates s, in O(N), without forming Y."""
    kept = kept_by_link(columns, len(places))
    sliding = zip(moving, twists(places, s), kept, strict=True)
    found = [dict(zip(keep, power(motion, twist, keep), strict=True)) for motion, twist, keep in sliding]
    return Column(found[column // 10][column % 10] for column in columns)
