"""Energies of a mechanism's links over the prime field, by the same recursion as in floats."""

from __future__ import annotations

import numpy as np

from adaptctl.description import GROUND, Description
from adaptctl.dynamics.recursion.energy import Weight, carried_weight, link_energy, placed_energy_regressor, weights
from adaptctl.dynamics.recursion.motion import Twist, carried, twists
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.identifiability.proof.exact_geometry import ExactGeometry
from adaptctl.identifiability.proof.joint_states import random_places, random_rates
from adaptctl.identifiability.proof.prime_field import PRIME, Residues, stacked_residues
from adaptctl.scalars import ZERO


def energy_differences(description: Description, geometry: ExactGeometry, samples: int, seed: int) -> Residues:
    """The matrix H (`samples`, P) of energy differences per unit of each of a mechanism's P inertial parameters (all
    but friction), as residues modulo the prime 2^31 - 1: kinetic plus potential energies at `samples` random states,
    less those at one more state, the same for all rows.

    `description` is the mechanism's, `geometry` its geometry, exact and in residues; energies are with that gravity,
    which is a unit vector where the geometry was made by axes, and that unit of length. `seed` draws the states, joint
    coordinates and rates uniform among the nonzero residues (half tangents for angles), the same for the same seed. It
    is for trees, also with joints that follow others; closed loops are not looked at. Nothing is checked.
    """
    rng = np.random.default_rng(seed)
    places = random_places(description, geometry, samples + 1, rng)
    rates = random_rates(description, samples + 1, rng)
    links = placed_energy_regressor(places, rates, geometry.gravity)
    row = TreeEquations.of(description).energies(links, rates)
    E = stacked_residues([*row][: description.energetic], samples + 1)
    return (E[1:] - E[:1]) % PRIME


def energy_changes(description: Description, geometry: ExactGeometry, samples: int, seed: int) -> Residues:
    """Energy changes (N, `samples`, 11) as a body is moved from the link of a joint to the parent link (or the ground),
    at random states of a tree of N links, as residues modulo the prime 2^31 - 1. They are the kinetic plus potential
    energy of the body on the joint's link less that of the same body fixed to the parent link, in the pose that it has
    there at joint position zero.

    The first ten are per unit of the body's inertial parameters (m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz,
    I_zz) in the link's frame; the eleventh is the square of the joint's rate, for a rotor's inertia, and 0 where there
    is no rotor. A combination of the eleven is unobservable at a joint (the torques do not show it) exactly when the
    energy changes in no state. `description` is the tree's, `geometry` its geometry, exact and in residues; joint
    position zero is that of its joint coordinates, which may be shifted from the file's, and energies are with its
    gravity and its unit of length. `seed` draws the states, joint coordinates and rates uniform among the nonzero
    residues (half tangents for angles), the same for the same seed. Nothing is checked.
    """
    rng = np.random.default_rng(seed)
    places = random_places(description, geometry, samples, rng)
    rates = random_rates(description, samples, rng)
    moving, heavy = twists(places, rates), weights(places, geometry.gravity)
    out = np.zeros((len(places), samples, 11), dtype=np.int64)
    for i, link in enumerate(geometry.links):
        before, base = Twist(ZERO, ZERO), Weight(geometry.gravity, 0.0)
        if link.parent != GROUND:
            before, base = moving[link.parent], heavy[link.parent]
        still = link.placed((1.0, 0.0) if link.turns else (0.0,))
        free = link_energy(moving[i], heavy[i])
        held = link_energy(carried(still, before), carried_weight(still, base))
        out[i, :, :10] = stacked_residues([*(free - held)], samples)
        if description.links[i].joint.drive.rotor_inertia is not None:
            out[i, :, 10] = rates[i].residues * rates[i].residues % PRIME
    return out
