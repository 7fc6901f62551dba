"""Other drives of a mechanism under constraints on its parameters, which stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_tree
from test_constraints import case

from adaptctl.description import Pose
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import Constraints, Relation, constrained


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 5), st.booleans())
def test_constraints_stay_with_other_drives(seed: int, links: int, driven: bool) -> None:
    """With other drives after the constraints or before them, it is the same mechanism."""
    mechanism, given_constraints = case(seed, links)
    if driven:
        mechanism = mechanism.with_drives(Drive(0.2, 0.3, 0.1))
    drives = [Drive(0.1 * (i + 1), viscous=0.5) if i % 2 else Drive(coulomb=0.7, offset=-0.2) for i in range(links)]
    found = constrained(mechanism, given_constraints).with_drives(drives)
    expected = constrained(mechanism.with_drives(drives), given_constraints)
    assert found.parameter_names == expected.parameter_names
    assert found.geometry_sha256 == expected.geometry_sha256
    np.testing.assert_allclose(found.inertial_parameters, expected.inertial_parameters)
    p, v, a = np.random.default_rng(seed).normal(size=(3, links))
    torque = found.torque_regressor(p, v, a) @ found.inertial_parameters + found.constraint_bias_torque(p, v, a)
    np.testing.assert_allclose(found.inverse_dynamics(p, v, a), torque, atol=1e-9)
    assert type(found.with_drives(Drive()).unconstrained) is Mechanism


def test_drives_have_the_rotors_that_constraints_bind() -> None:
    tree = random_tree(3, 3).with_drives(Drive(0.4, viscous=1.0))
    first, second, third = (f"{joint.name}.rotor_inertia" for joint in tree.primary_joints)
    one = constrained(tree, Constraints({first: 0.5}, (Relation({second: 1.0, third: -2.0}),)))
    other = one.with_drives([Drive(9.0), Drive(9.0, coulomb=1.0), Drive(0.3)])
    values = dict(zip(other.description.parameter_names, other.description.inertial_parameters.tolist(), strict=True))
    assert values[first] == 0.5
    assert values[second] == pytest.approx(2.0 * values[third])
    for missing, drives in (
        (f"{first}, {second}, {third}", Drive(viscous=1.0)),
        (first, [Drive(), Drive(1.0), Drive(1.0)]),
        (third, [Drive(1.0), Drive(1.0), Drive()]),
    ):
        with pytest.raises(InputError, match=f"drives: the constraints bind {missing}; give the drives these terms"):
            one.with_drives(drives)


def test_relations_of_a_small_arm_are_compared_in_its_own_units() -> None:
    """Of one of half a millimetre, in which an inertia of 1 kg m^2 is that of tons."""
    arm = random_tree(0, 2).description
    small = [replace(one, parent_to_joint=_shrunk(one.parent_to_joint), joint_to_link=_shrunk(one.joint_to_link))
             for one in arm.links]  # fmt: skip
    mechanism, (name, *_) = Mechanism(replace(arm, links=tuple(small))), [link.name for link in small]
    unit = mechanism.description.longest_offset**-2
    relations = tuple(Relation({f"{name}.m": 1.0, f"{name}.I_zz": factor * unit}) for factor in (1.0, 2.0))
    left = constrained(mechanism, Constraints(relations=relations)).num_energy_parameters
    assert left == mechanism.num_energy_parameters - 2


def _shrunk(pose: Pose) -> Pose:
    return Pose(pose.rotation, 1e-3 * pose.translation)
