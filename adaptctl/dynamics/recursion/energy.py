"""Energy regressors, and equations of motion by momenta."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from adaptctl.dynamics.equations import Equations
from adaptctl.dynamics.recursion.motion import GROUND, Twist, twists
from adaptctl.dynamics.recursion.segment import Placement, Segment, placements
from adaptctl.errors import InputError
from adaptctl.scalars import ZERO, Column, Scalar, Vec, cross, dot


class Weight:
    """Gravity's acceleration and potential at one link."""

    __slots__ = ("gravity", "potential")

    def __init__(self, gravity: Vec, potential: Scalar) -> None:
        self.gravity, self.potential = gravity, potential


def weights(places: Sequence[Placement], gravity: Vec) -> list[Weight]:
    """Gravity in each link's axes, and its potential."""
    out: list[Weight] = []
    for place in places:
        parent = place.segment.parent
        out.append(carried_weight(place, out[parent] if parent != GROUND else Weight(gravity, 0.0)))
    return out


def carried_weight(place: Placement, base: Weight) -> Weight:
    """Gravity and potential at a link, from its parent's."""
    if base.gravity is ZERO:
        return base
    own = place.down(base.gravity)
    fall = dot(base.gravity, place.near) + dot(own, place.shift)
    return Weight(own, base.potential - fall)


def link_energy(twist: Twist, weight: Weight) -> Column:
    """Energy regressor (10,) of one link."""
    w, v = twist.w, twist.v
    moment = cross(v, w) - weight.gravity
    mass = 0.5 * dot(v, v) + weight.potential
    turning = (0.5 * w.x * w.x, w.x * w.y, 0.5 * w.y * w.y, w.x * w.z, w.y * w.z, 0.5 * w.z * w.z)
    return Column((mass, *moment, *turning))


def energy_regressor(links: Sequence[Segment], q: Column, v: Column, gravity: Vec) -> Column:
    """Energy regressor (10 n,) of a tree."""
    return placed_energy_regressor(placements(tuple(links), q), v, gravity)


def placed_energy_regressor(places: Sequence[Placement], v: Column, gravity: Vec) -> Column:
    """Energy regressor (10 n,) from the links' placements."""
    pairs = zip(twists(places, v), weights(places, gravity), strict=True)
    return Column(entry for twist, weight in pairs for entry in link_energy(twist, weight))


def potential_regressor(links: Sequence[Segment], q: Column, gravity: Vec) -> Column:
    """Potential energy regressor (10 n,) of a tree."""
    places = placements(tuple(links), q)
    still = Twist(ZERO, ZERO)
    return Column(entry for weight in weights(places, gravity) for entry in link_energy(still, weight))


class MomentumTerms(NamedTuple):
    """Regressors of the equations of motion by momenta."""

    momentum: list[Column]
    forces: list[Column]


def momentum_terms(
    equations: Equations, q: Column, v: Column, columns: Sequence[int], v_f: Column | None = None
) -> MomentumTerms:
    """Regressors of the momenta M v and their forces, friction at v_f among them, or at v."""
    _validate_linear(equations)
    return MomentumTerms(*(part.regressor(columns) for part in equations.momenta(q, v, v_f)))


def known_momentum_terms(equations: Equations, q: Column, v: Column, parameters: Column) -> MomentumTerms:
    """Momenta and forces of known parameters, in place of their regressors: a column of one entry a joint."""
    _validate_linear(equations)
    return MomentumTerms(*([Column((x,)) for x in part.torque(parameters)] for part in equations.momenta(q, v)))


def _validate_linear(equations: Equations) -> None:
    if equations.has_constraint_bias:
        raise InputError("prediction of filtered torques needs constraints that set parameters to zero")
