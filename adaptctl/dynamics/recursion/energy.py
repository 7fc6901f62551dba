"""Energies as linear functions of the inertial parameters."""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.dynamics.recursion.motion import GROUND, Twist, twists
from adaptctl.dynamics.recursion.segment import Placement, Segment, placements
from adaptctl.scalars import ZERO, Column, Scalar, Vec, cross, dot


class Weight:
    """Gravity in a link's frame, and the height potential -g.x of its origin (per kg)."""

    __slots__ = ("gravity", "potential")

    def __init__(self, gravity: Vec, potential: Scalar) -> None:
        self.gravity, self.potential = gravity, potential


def weights(places: Sequence[Placement], gravity: Vec) -> list[Weight]:
    """The gravity in every link's frame, and the heights of their origins."""
    out: list[Weight] = []
    for place in places:
        parent = place.segment.parent
        out.append(carried_weight(place, out[parent] if parent != GROUND else Weight(gravity, 0.0)))
    return out


def carried_weight(place: Placement, base: Weight) -> Weight:
    """The gravity in a link's frame and the height of its origin, from its parent's."""
    own = place.down(base.gravity)
    fall = dot(base.gravity, place.segment.near) + dot(own, place.shift)
    return Weight(own, base.potential - fall)


def link_energy(twist: Twist, weight: Weight) -> Column:
    """Total energy of one link per unit of each of its ten (Sheu and Walker 1991, section 2.2):
    [v.v/2 - g.x, v x w - R'g, w_x^2/2, w_x w_y, w_y^2/2, w_x w_z, w_y w_z, w_z^2/2]."""
    w, v = twist.w, twist.v
    moment = cross(v, w) - weight.gravity
    mass = 0.5 * dot(v, v) + weight.potential
    turning = (0.5 * w.x * w.x, w.x * w.y, 0.5 * w.y * w.y, w.x * w.z, w.y * w.z, 0.5 * w.z * w.z)
    return Column((mass, *moment, *turning))


def energy_regressor(links: Sequence[Segment], q: Column, v: Column, gravity: Vec) -> Column:
    """The row E (10N,) of T = E' D: kinetic plus potential energy of the tree, in J."""
    return placed_energy_regressor(placements(tuple(links), q), v, gravity)


def placed_energy_regressor(places: Sequence[Placement], v: Column, gravity: Vec) -> Column:
    """Energy regressor (P,) of links that are placed already."""
    pairs = zip(twists(places, v), weights(places, gravity), strict=True)
    return Column(entry for twist, weight in pairs for entry in link_energy(twist, weight))


def potential_regressor(links: Sequence[Segment], q: Column, gravity: Vec) -> Column:
    """Regressor (P,) of the potential energy alone."""
    places = placements(tuple(links), q)
    still = Twist(ZERO, ZERO)
    return Column(entry for weight in weights(places, gravity) for entry in link_energy(still, weight))
