"""Energies as linear functions of the inertial parameters, and equations of motion by momenta."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from adaptctl.dynamics.equations import Equations
from adaptctl.dynamics.recursion.motion import GROUND, Twist, twists
from adaptctl.dynamics.recursion.segment import Placement, Segment, placements
from adaptctl.errors import InputError
from adaptctl.scalars import ZERO, Column, Dual, Scalar, Vec, cross, dot


class Weight:
    """Gravity's acceleration and potential at one link."""

    __slots__ = ("gravity", "potential")

    def __init__(self, gravity: Vec, potential: Scalar) -> None:
        self.gravity, self.potential = gravity, potential


def weights(places: Sequence[Placement], gravity: Vec) -> list[Weight]:
    """Gravity's acceleration in the axes of each of n links, m/s^2, and the potential energy per mass at its origin,
    J/kg, 0 at the ground frame's origin, as one `Weight` for each link. `places` has the links' placements in their
    parents, parents before children; `gravity` (3,) is the acceleration in the ground frame, m/s^2. Nothing is
    checked."""
    out: list[Weight] = []
    for place in places:
        parent = place.segment.parent
        out.append(carried_weight(place, out[parent] if parent != GROUND else Weight(gravity, 0.0)))
    return out


def carried_weight(place: Placement, base: Weight) -> Weight:
    """Gravity's acceleration in one link's axes, m/s^2, and the potential energy per mass at its origin, J/kg, as a
    `Weight`, from those of its parent, `base`. `place` is the link's placement in its parent. Nothing is checked."""
    own = place.down(base.gravity)
    fall = dot(base.gravity, place.near) + dot(own, place.shift)
    return Weight(own, base.potential - fall)


def link_energy(twist: Twist, weight: Weight) -> Column:
    """Energy regressor (10,) of one link: kinetic plus potential energy, in J of its ten inertial parameters."""
    w, v = twist.w, twist.v
    moment = cross(v, w) - weight.gravity
    mass = 0.5 * dot(v, v) + weight.potential
    turning = (0.5 * w.x * w.x, w.x * w.y, 0.5 * w.y * w.y, w.x * w.z, w.y * w.z, 0.5 * w.z * w.z)
    return Column((mass, *moment, *turning))


def energy_regressor(links: Sequence[Segment], q: Column, v: Column, gravity: Vec) -> Column:
    """Energy regressor E (10 n,) of a tree of n links, J link's ten inertial parameters."""
    return placed_energy_regressor(placements(tuple(links), q), v, gravity)


def placed_energy_regressor(places: Sequence[Placement], v: Column, gravity: Vec) -> Column:
    """Energy regressor (10 n,) of a tree of n links, from the links' placements, J link's ten inertial parameters."""
    pairs = zip(twists(places, v), weights(places, gravity), strict=True)
    return Column(entry for twist, weight in pairs for entry in link_energy(twist, weight))


def potential_regressor(links: Sequence[Segment], q: Column, gravity: Vec) -> Column:
    """Potential part (10 n,) of the energy regressor of a tree of n links."""
    places = placements(tuple(links), q)
    still = Twist(ZERO, ZERO)
    return Column(entry for weight in weights(places, gravity) for entry in link_energy(still, weight))


class MomentumTerms(NamedTuple):
    """Regressors of the equations of motion in momenta, which need no accelerations."""

    momentum: list[Column]
    forces: list[Column]


def momentum_terms(equations: Equations, q: Column, v: Column, columns: Sequence[int]) -> MomentumTerms:
    """Regressors, as `MomentumTerms`, of the momenta M v of r primary (independent) joints and of all generalised
    forces but the torque that change these momenta. They have r rows (k,) each, N m s and N m (N s and N if prismatic)
    per unit of each of the k of the P inertial and friction parameters whose indices `columns` are, from 0 to P - 1.

    `equations` are the mechanism's, with mass matrix M and Christoffel (Coriolis) matrix C; `q` (n,) is a configuration
    of the spanning tree's n joints, rad (m), and `v` (r,) the velocities of the primary ones, rad/s (m/s). Of the
    forces C' v - g - friction, g being gravity's torque, C' v is M_dot v - C v, since the rate M_dot of M along v is C
    + C'; M_dot v comes from dual numbers along the motion. Raises `InputError` for equations whose linear constraints
    fix parameters at values other than zero, for which regressors have no columns, `IndexError` for an index of P or
    more, and `IndexError` or `ValueError` for vectors too short.
    """
    if equations.has_known_share:
        raise InputError("learning from filtered torques needs relations without known values other than zero")
    still = Column.zeros(equations.dof)
    moving = Column(map(Dual, q, equations.rates(q, v)))
    rows = equations.without_gravity().torque_regressor(moving, still, still, v, columns)
    momentum = [Column(_value(x) for x in row) for row in rows]
    change = [Column(_slope(x) for x in row) for row in rows]
    bias = equations.torque_regressor(q, v, v, still, columns)
    return MomentumTerms(momentum, [c - b for c, b in zip(change, bias, strict=True)])


def _value(x: Any) -> Any:
    return x.value if isinstance(x, Dual) else x


def _slope(x: Any) -> Any:
    return x.slope if isinstance(x, Dual) else 0.0
