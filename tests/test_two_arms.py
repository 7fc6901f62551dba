"""Two arms that hold one rod, as an experiment."""

from __future__ import annotations

import numpy as np
import pytest
from nightly import nightly

from adaptctl.control import Gradient, SlotineLi, lyapunov
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.experiments.two_arms import LEFT, RIGHT, TwoArms, _slopes
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import simulate

EXPERIMENT = TwoArms(duration=4.0)


@pytest.fixture(scope="module")
def mechanism() -> Mechanism:
    return EXPERIMENT.mechanism()


def test_both_arms_hold_the_rod_where_they_are_said_to(mechanism: Mechanism) -> None:
    """The right arm as told to 0.01 rad, and neither near a singularity: all joints move as fast as those of the left
    within a factor of ten."""
    np.testing.assert_allclose(mechanism.configuration(np.array(LEFT)), [*LEFT, *RIGHT], atol=0.01)
    assert np.linalg.cond(_slopes(mechanism)) < 10.0


def test_both_arms_motors_share_the_load(mechanism: Mechanism) -> None:
    """The left arm alone could not hold the right one: its fifth joint would be overloaded."""
    limits = EXPERIMENT.torque_limits(mechanism)
    assert mechanism.dof == 6
    assert np.all(limits > mechanism.effort_limits)
    held = np.abs(mechanism.inverse_dynamics(LEFT, np.zeros(6), np.zeros(6)))
    assert held[4] > mechanism.effort_limits[4]
    assert np.all(held < 0.5 * limits)


def test_virtual_power_of_both_arms_is_that_of_the_left_joints(mechanism: Mechanism) -> None:
    """The limits' oracle: with all twelve motors at their limits, no joint's share is beyond them."""
    step = 1e-6
    limits = np.array([link.joint.limits.effort for link in mechanism.links])
    q = mechanism.configuration(np.array(LEFT) + step * np.eye(6))
    slopes = (q - mechanism.configuration(LEFT)) / step
    np.testing.assert_allclose(EXPERIMENT.torque_limits(mechanism), np.abs(slopes) @ limits, rtol=1e-4)


@nightly
def test_the_pair_learns_and_the_lyapunov_function_never_rises(mechanism: Mechanism) -> None:
    model, gains = ReducedModel.full(mechanism), EXPERIMENT.gains(mechanism)
    env = EXPERIMENT.environment(mechanism)
    limits = EXPERIMENT.torque_limits(mechanism)  # those of both arms
    law = Gradient(EXPERIMENT.adaptation(model))
    controller = SlotineLi(model, gains.bandwidth, gains.damping, law, torque_limits=limits)
    run = simulate(env, controller, seed=0)
    error = np.sqrt(np.mean(run.error**2, axis=1))
    assert not run.terminated
    assert run.clipped.sum() == 0
    assert error[-500:].max() < 0.15 * error[0]
    assert np.diff(lyapunov(controller, run, mechanism)).max() <= 0.0


@nightly
def test_every_law_of_the_experiment_has_both_arms_motors(mechanism: Mechanism) -> None:
    basis, limits = ReducedModel(mechanism).basis, EXPERIMENT.torque_limits(mechanism)
    assert basis is not None
    laws = [law for one in EXPERIMENT.contenders(mechanism, basis) if isinstance(law := one.make(), SlotineLi)]
    assert len(laws) > 3
    for law in laws:
        np.testing.assert_array_equal(np.asarray(law.torque_limits), limits)


def test_an_arm_that_cannot_hold_the_rod_is_refused() -> None:
    with pytest.raises(InputError, match="semi_direct_drive has 5 links, but two arms need"):
        TwoArms(robot="semi_direct_drive").mechanism()
