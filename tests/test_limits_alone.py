"""Gains from torque limits and kinematics alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from two_links import ARM, changed

import adaptctl
from adaptctl.description import Limits
from adaptctl.description.drive import Drive
from adaptctl.errors import InputError
from adaptctl.simulation import Plant, simulate_many
from adaptctl.simulation.integrator import integration
from adaptctl.tuning import limits_alone, tune, with_friction
from adaptctl.tuning.verification import base_model


def test_nothing_of_the_file_but_kinematics_and_limits_is_left() -> None:
    heavy = ARM.with_parameters(7.0 * ARM.inertial_parameters).with_drives(
        [Drive(viscous=3.0), Drive(rotor_inertia=9.0)]
    )
    one, other = limits_alone(with_friction(heavy), [600.0, 500.0]), limits_alone(with_friction(ARM), [600.0, 500.0])
    assert one.parameter_names == other.parameter_names
    np.testing.assert_array_equal(one.inertial_parameters, other.inertial_parameters)
    np.testing.assert_allclose(one.mass_matrix(np.array([0.3, 0.4])), np.diag([0.1, 0.05]), atol=1e-4)
    assert one.description.inconsistent_links == ()


def test_limits_and_accelerations_are_needed() -> None:
    with pytest.raises(InputError, match="elbow"):
        limits_alone(changed(lambda joint: replace(joint, limits=Limits()), 1))
    with pytest.raises(InputError, match="acceleration"):
        limits_alone(ARM, 0.0)


@pytest.mark.nightly
def test_an_arm_learns_with_gains_from_its_limits_alone() -> None:
    geared = with_friction(adaptctl.load("puma560_geared"))
    tuning = tune(limits_alone(geared))
    law = tuning.controller(base_model(tuning.mechanism))
    plant = Plant(geared, 1e-3, *integration(geared, (), 1e-3), torque_limits=tuning.torque_limits)
    start = tuning.reference(0.0).p + tuning.initial_error
    run = simulate_many(plant, law, tuning.reference, p=start[None], duration=20.0, record_every=50)
    assert 1e3 * np.sqrt(np.mean(run.error[-40:] ** 2)) < 0.02
