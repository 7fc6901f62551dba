"""Exact energy changes of bodies moved to a joint's parent: as many as in floats, and as energies depend on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_trees import random_chain, random_tree

from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.inertial_transfers import inertial_transfers
from adaptctl.identifiability.proof import arithmetic
from adaptctl.identifiability.proof.arithmetic import PRIME, random_residues
from adaptctl.identifiability.proof.exact_energies import ExactEnergies
from adaptctl.identifiability.proof.exact_geometry import ExactFrame
from adaptctl.identifiability.proof.exact_transfers import energy_changes


@pytest.mark.parametrize("seed", range(4))
def test_as_much_changes_at_a_joint_exactly_as_in_floats(seed: int) -> None:
    """Rotors alone add a column, the squares of their speeds."""
    drives = [Drive(rotor_inertia=0.1), Drive(), Drive(rotor_inertia=0.2)]
    mechanism, samples = random_chain(seed, 3).with_drives(drives), 16
    exact = ExactEnergies(mechanism)
    joints = [ExactFrame.of(joint.joint, exact.reading) for joint in exact.frames.joints]
    changes, rng = energy_changes(mechanism.description, joints, samples, seed=5), np.random.default_rng(5)
    *_, rates = (random_residues((3, samples), rng).residues for _ in range(3))
    assert changes.shape == (3, samples, 11)
    for i, drive in enumerate(drives):
        expected = 0 * rates[i] if drive.rotor_inertia is None else rates[i] * rates[i] % PRIME
        np.testing.assert_array_equal(changes[i, :, 10], expected)
    seen = inertial_transfers(mechanism).observable
    assert arithmetic.ranks(changes) == tuple(map(len, seen))


@pytest.mark.parametrize("strength", [9.81, 0.0])
@pytest.mark.parametrize("seed", range(3))
def test_joints_feel_together_what_energies_depend_on(seed: int, strength: float) -> None:
    """The rank by joints, whose links are matrices there, and that of the recursion's energies."""
    arm = random_tree(seed, 4).with_drives([Drive(rotor_inertia=0.1), *[Drive()] * 3])
    down = strength * arm.description.gravity / np.linalg.norm(arm.description.gravity)
    exact = ExactEnergies(Mechanism(replace(arm.description, gravity=down)))
    assert exact.rank == arithmetic.rank(exact._differences)
