"""Energies of a mechanism with closed loops in sixty digits, by the same equations as in floats."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

from adaptctl.arrays import Array
from adaptctl.description import GROUND, Description
from adaptctl.description.loops import Closure
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.loop_equations import LoopEquations
from adaptctl.dynamics.loops.constraint import ClosureSide, Follower, Loop
from adaptctl.errors import InputError
from adaptctl.identifiability.proof.arithmetic import digits, samples_of, stacked_digits
from adaptctl.identifiability.proof.exact_geometry import ExactGeometry
from adaptctl.scalars import Column


def exact_loops(mechanism: Mechanism, geometry: ExactGeometry) -> LoopEquations:
    """The equations of motion of a mechanism with closed loops on its exact `geometry`, as `LoopEquations`, whose joint
    coordinates are the file's plus the geometry's `shifts` (rad). Raises `InputError` for a tree, `LoopError` where
    loops cannot be closed."""
    description = mechanism.description
    if mechanism.continuation is None or description.loops is None:
        raise InputError(f"{mechanism.name}: there are no loops to close")
    equations = mechanism.continuation.equations
    tree = replace(equations.tree, segments=geometry.links, gravity=geometry.gravity)
    pairs = zip(equations.closing.loops, description.loops.closures, strict=True)
    closed = tuple(_exact_loop(loop, closure, description, geometry) for loop, closure in pairs)
    followers = tuple(_exact_follower(follower, geometry) for follower in equations.closing.followers)
    return LoopEquations(tree, replace(equations.closing, loops=closed, followers=followers))


def loop_energies(equations: LoopEquations, geometry: ExactGeometry, q: Array, v: Array) -> Any:
    """The energy regressor (samples, P) of a mechanism with closed loops at `samples` states, to 60 decimal digits:
    kinetic plus potential energies per unit of each of P inertial and friction parameters (0 for friction). Entries are
    Python ints (dtype object), the energies times 2^200. They are with the gravity of the exact `geometry`, a unit
    vector where the geometry was made from joint axes alone, and in its unit of length.

    `equations` are the equations of motion on that geometry, which `exact_loops` returns; `q` (samples, n) are
    configurations of the spanning tree's n joints, rad (m for a prismatic joint), in the file's coordinates, that close
    the loops up to round-off, and are closed to 60 digits here; `v` (samples, r) are the velocities of the r primary
    (independent) joints, rad/s (the geometry's unit per s for a prismatic joint). Raises `ArithmeticError` where
    Newton's steps on that geometry meet a singular matrix, as at a singularity of the loops.
    """
    joints = zip(q.T, geometry.shifts, geometry.links, strict=True)
    guess = Column(_coordinate(x, shift, link.turns, geometry.reading.unit) for x, shift, link in joints)
    closed = equations.closed(Column(guess[i] for i in equations.closing.primary), guess)
    row = equations.energy_regressor(closed, Column(samples_of(x) for x in v.T))
    return stacked_digits([*row], len(q))


def _coordinate(q: Array, shift: float, turns: bool, unit: Fraction) -> Any:
    return samples_of(q) + shift if turns else samples_of(q) * digits(1 / unit)


def _exact_loop(loop: Loop, closure: Closure, description: Description, geometry: ExactGeometry) -> Loop:
    names = {link.name: i for i, link in enumerate(description.links)}
    first = geometry.fixed(GROUND if closure.first is None else names[closure.first], closure.first_frame)
    second = geometry.fixed(GROUND if closure.second is None else names[closure.second], closure.second_frame)
    return Loop(
        ClosureSide(loop.first.links, first.rotation, first.origin),
        ClosureSide(loop.second.links, second.rotation, second.origin),
        loop.kind,
    )


def _exact_follower(follower: Follower, geometry: ExactGeometry) -> Follower:
    """The follower with its offset among shifted joints, and lengths in the geometry's unit."""
    shifts, links = geometry.shifts, geometry.links
    over = {False: float(1 / geometry.reading.unit), True: 1.0}
    own, other = over[links[follower.follower].turns], over[links[follower.leader].turns]
    shift = shifts[follower.follower] - follower.ratio * shifts[follower.leader]
    return replace(follower, ratio=follower.ratio * own / other, offset=follower.offset * own + shift)
