"""Newton and Euler's equations of a tree: torques, their regressor, and the adaptive tick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from adaptctl.dynamics.motion import GROUND, Motion, Twist, carried, motions, moved, twists
from adaptctl.dynamics.segment import Placement, Segment, placements
from adaptctl.dynamics.wrench import Wrench, power, wrench
from adaptctl.scalars import Column, Scalar, Vec, cross, dot


def inverse_dynamics(
    links: Sequence[Segment], q: Column, v: Column, v_r: Column, a_r: Column, gravity: Vec, parameters: Column
) -> Column:
    """Joint torques M(q) a_r + C(q, v) v_r + g(q) for parameters (10N,); v_r = v gives the ordinary ones."""
    places = placements(tuple(links), q)
    return joint_torques(places, motions(places, v, v_r, a_r, gravity), parameters)


def joint_torques(places: Sequence[Placement], moving: Sequence[Motion], parameters: Column) -> Column:
    """The backward recursion: what every joint must exert for its links to move so."""
    loads = [wrench(motion, parameters.of[10 * i : 10 * i + 10]) for i, motion in enumerate(moving)]
    torques: list[Scalar] = [0.0] * len(places)
    for i in reversed(range(len(places))):
        place = places[i]
        torques[i] = joint_power(place, loads[i])
        if place.segment.parent != GROUND:
            loads[place.segment.parent] += lifted(place, loads[i])
    return Column(torques)


def joint_power(place: Placement, load: Wrench) -> Scalar:
    """What a link's wrench asks of its joint: the power of a unit joint rate."""
    z = place.segment.axis
    if not place.segment.turns:
        return dot(load.force, z)
    return dot(load.moment, z) + dot(load.force, cross(z, place.shift))


def lifted(place: Placement, load: Wrench) -> Wrench:
    """The same wrench about the parent's origin, in the parent's frame."""
    force = place.up(load.force)
    moment = place.up(load.moment + cross(place.shift, load.force))
    return Wrench(force, moment + cross(place.segment.near, force))


def torque_regressor(
    links: Sequence[Segment],
    q: Column,
    v: Column,
    v_r: Column,
    a_r: Column,
    gravity: Vec,
    columns: Sequence[int],
) -> list[Column]:
    """Rows of Y, one a joint, with the asked columns only: Y D = M a_r + C(q, v) v_r + g."""
    places = placements(tuple(links), q)
    moving = motions(places, v, v_r, a_r, gravity)
    kept = kept_by_link(columns, len(links))
    rows: list[dict[int, Scalar]] = [{} for _ in links]
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
    """For each link, which of its ten are among the asked columns."""
    kept: list[list[int]] = [[] for _ in range(links)]
    for column in columns:
        kept[column // 10].append(column % 10)
    return kept


class AdaptiveTick(NamedTuple):
    """`torque` = Y_r D and `gradient` = Y_r' s on the kept columns, without ever forming Y_r."""

    torque: Column
    gradient: Column


def adaptive_tick(
    links: Sequence[Segment],
    q: Column,
    v: Column,
    v_r: Column,
    a_r: Column,
    s: Column,
    gravity: Vec,
    parameters: Column,
    columns: Sequence[int],
) -> AdaptiveTick:
    """One controller tick in O(N): the feed-forward torque and the gradient of the adaptation, one motion."""
    places = placements(tuple(links), q)
    moving = motions(places, v, v_r, a_r, gravity)
    return AdaptiveTick(joint_torques(places, moving, parameters), powers(places, moving, s, columns))


def adaptation_gradient(
    links: Sequence[Segment],
    q: Column,
    v: Column,
    v_r: Column,
    a_r: Column,
    s: Column,
    gravity: Vec,
    columns: Sequence[int],
) -> Column:
    """Y_r' s on the asked columns, which must be sorted."""
    places = placements(tuple(links), q)
    return powers(places, motions(places, v, v_r, a_r, gravity), s, columns)


def powers(places: Sequence[Placement], moving: Sequence[Motion], s: Column, columns: Sequence[int]) -> Column:
    """Y_r' s: the power of each parameter's wrench under joint rates s, so one forward recursion gives all."""
    kept = kept_by_link(columns, len(places))
    sliding = zip(moving, twists(places, s), kept, strict=True)
    return Column(y for motion, twist, keep in sliding for y in power(motion, twist, keep))
