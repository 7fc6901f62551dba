"""Energy changes as bodies are passed to the parent link, against the energies of whole mechanisms."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_tree

from adaptctl.description import GROUND
from adaptctl.description.drive import Drive
from adaptctl.identifiability.energy_matrix import parameter_units
from adaptctl.identifiability.inertial_transfers import inertial_transfers
from adaptctl.identifiability.sampling import random_states
from adaptctl.identifiability.tree_null_space import energy_changes


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_a_body_passed_to_the_parent_changes_energies_by_what_it_has_on_either_link(seed: int, links: int) -> None:
    drives = [Drive(rotor_inertia=0.1) if (seed >> i) % 2 else Drive() for i in range(links)]
    mechanism = random_tree(seed, links).with_drives(drives)
    states = random_states(mechanism, 7, np.random.default_rng(seed))
    found = inertial_transfers(mechanism)
    changes = energy_changes(mechanism, found, states)
    units = parameter_units(mechanism, found.frames.length)
    H = mechanism.energy_regressor(states.p, states.v) * units
    for i, (link, drive) in enumerate(zip(mechanism.links, drives, strict=True)):
        own = found.own[i]
        given_up = H[:, own.indices] - changes[i] @ own.bodies  # what the parent link then has
        if link.parent == GROUND:
            parents = given_up[:1] + 0.0 * given_up  # where nothing moves, a constant
        else:
            passed = found.passed_to_parent(i, own.bodies)
            parent = found.own[link.parent]
            parents = H[:, parent.indices[:10]] @ np.linalg.solve(parent.bodies[:10, :10], passed[:10])
        np.testing.assert_allclose(given_up, parents, atol=1e-9 * max(np.abs(H).max(), 1.0))
        np.testing.assert_allclose(
            changes[i, :, 10] / found.frames.rotor_scales[i],
            0.5 * states.v[:, i] ** 2 * (drive.rotor_inertia is not None),
            rtol=1e-12,
        )
