"""Axes in which the recursions hold a link's vectors: the link's own, or those that it has at its joint's zero angle.

A vector may be held in any axes, also in such as do not turn with its link. Where every joint on a link is parallel to
the link's own (or none is on it), the axes of zero angle cost less: motions and wrenches pass this joint without being
turned, the next joint turns them by the sum of both angles, and only the link's own parameters are turned.
"""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.dynamics.recursion.motion import GROUND
from adaptctl.dynamics.recursion.segment import Placement, Segment, axis_rotation
from adaptctl.dynamics.recursion.tensors import turned_back
from adaptctl.scalars import Column, Mat, Scalar, Vec, cos, sin


def continued(links: Sequence[Segment]) -> list[float]:
    """Senses in which a tree's n links turn on about their parents' joints: n numbers, 1.0 where a link's joint is
    parallel to its parent's joint, -1.0 where it is antiparallel, else 0.0. `links` has the links' geometry, parents
    before children. Joints that are parallel but for round-off do not count. Nothing is checked."""
    return [_sense(link, links[link.parent]) if link.parent != GROUND else 0.0 for link in links]


def _sense(link: Segment, parent: Segment) -> float:
    if not (link.turns and parent.turns):
        return 0.0
    axis = link.joint_axis if link.inward is None else link.inward.T @ link.joint_axis
    return next((sign for sign in (1.0, -1.0) if tuple(sign * axis) == tuple(parent.axis)), 0.0)


def held_still(links: Sequence[Segment]) -> list[bool]:
    """Links of a tree of n whose vectors cost least in the axes that they have at zero angle of their joints: n truth
    values. True are those whose joint turns about a coordinate axis of the link while all joints on it, if there are
    any, are parallel to it. `links` has the links' geometry, parents before children. Nothing is checked."""
    still = [link.turns and axis_rotation(link.axis, 1.0, 0.0) is not None for link in links]
    for link, sense in zip(links, continued(links), strict=True):
        if link.parent != GROUND and not sense:
            still[link.parent] = False
    return still


def angles(links: Sequence[Segment], q: Column) -> list[tuple[Scalar, ...]]:
    """The coordinates of a tree's n links at a configuration `q` (n,) of its joints, rad (m if prismatic), of which
    `held_placements` makes their placements: cosine and sine of the angle by which each is turned from the axes in
    which its parent's vectors are held, or its joint's displacement, m. That angle is its joint's own or, where its
    parent's vectors are held in axes of zero angle, a sum of several. `links` has the links' geometry, parents before
    children. Too short a q raises `IndexError`."""
    still, found = held_still(links), list[tuple[Scalar, ...]]()
    for i, (link, sense) in enumerate(zip(links, continued(links), strict=True)):
        if not link.turns:
            found.append((q[i],))
            continue
        c, s = cos(q[i]), sin(q[i])
        if link.parent != GROUND and still[link.parent]:
            cosine, sine = found[link.parent][0], sense * found[link.parent][1]
            c, s = c * cosine - s * sine, s * cosine + c * sine
        found.append((c, s))
    return found


def held_placements(links: Sequence[Segment], coordinates: Sequence[Sequence[Scalar]]) -> list[Placement]:
    """Poses of a tree's n links in their parents, a `Placement` each, in the axes in which their vectors are held.
    `links` has the links' geometry, parents before children, `coordinates` the n links' coordinates, as `angles` gives
    them. Nothing is checked."""
    found: list[Placement] = []
    for link, own, still in zip(links, coordinates, held_still(links), strict=True):
        before = found[link.parent].turn if link.parent != GROUND else None
        near = link.near if before is None else before.T @ link.near
        place = link.placed((1.0, 0.0) if still else own)
        turn = axis_rotation(link.axis, *own) if still else None
        shift = place.shift if turn is None else turn.T @ place.shift
        found.append(Placement(link._replace(near=near), own, place.turns, shift, turn))
    return found


def held_parameters(place: Placement, ten: Sequence[Scalar]) -> Sequence[Scalar]:
    """The ten inertial parameters of a link in the axes in which its vectors are held, from those in its own, `ten`
    (10,): m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2, about the link frame's origin).
    `place` is the link's placement. Nothing is checked."""
    if place.turn is None:
        return ten
    m, x, y, z, xx, xy, yy, xz, yz, zz = ten
    a = turned_back(place.turn, Mat(Vec(xx, xy, xz), Vec(xy, yy, yz), Vec(xz, yz, zz)))
    return m, *(place.turn.T @ Vec(x, y, z)), a.x.x, a.x.y, a.y.y, a.x.z, a.y.z, a.z.z


def per_parameter(place: Placement, held: Sequence[Scalar]) -> Sequence[Scalar]:
    """Coefficients (10,) of a link's ten inertial parameters in its own axes, from those of its ten parameters in the
    axes in which its vectors are held, `held` (10,): such as powers or torques per unit of each, in the order of
    `held_parameters`. `place` is the link's placement. Nothing is checked."""
    if place.turn is None:
        return held
    m, x, y, z, xx, xy, yy, xz, yz, zz = held
    # Any tensor will do whose opposite entries add up to the coefficients of products of inertia.
    a = turned_back(place.turn.T, Mat(Vec(xx, xy, xz), Vec(0.0, yy, yz), Vec(0.0, 0.0, zz)))
    products = a.x.y + a.y.x, a.y.y, a.x.z + a.z.x, a.y.z + a.z.y
    return m, *(place.turn @ Vec(x, y, z)), a.x.x, *products, a.z.z
