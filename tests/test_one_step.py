"""What a plant does in one control period, against equations solved by hand on joints of constant inertia."""

from __future__ import annotations

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.control import PDGravity, Sinusoids
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs import TrackingEnv
from adaptctl.simulation import LinearlyImplicitEuler, Plant, rollout, simulate
from adaptctl.simulation.effects import ElasticJoints, Encoder, Friction, TorqueLimit, TorqueRateLimit

INERTIA = np.array([0.5, 0.25])
"""kg m^2 and kg: a table turns about the vertical, a sledge slides in the horizontal, and neither feels the other"""
TWO = """
schema = "adaptctl/mechanism/1"
name = "table and sledge"

[[links]]
name = "table"
joint = "turn"
effort = 8
mass = 1
first_moment = [0, 0, 0]
inertia = { xx = 1, yy = 1, zz = 0.5 }

[[links]]
name = "sledge"
joint = "slide"
type = "prismatic"
axis = [1, 0, 0]
effort = 8
mass = 0.25
first_moment = [0, 0, 0]
inertia = { xx = 1, yy = 1, zz = 1 }
"""
DT = 0.01


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Mechanism:
    path = tmp_path_factory.mktemp("two") / "two.toml"
    path.write_text(TWO)
    return load(path)


def numbers(*values: float) -> Array:
    return np.array(values)


def test_the_springs_torque_is_that_of_the_steps_end(both: Mechanism) -> None:
    """What the links gain is f dt, what the motors gain (torque - f) dt, with the f of the positions and velocities at
    which the implicit step ends, wherever it began."""
    k, d, J = numbers(300.0, 90.0), numbers(0.4, 0.2), numbers(0.1, 0.05)
    plant = Plant(both, DT, integrator=LinearlyImplicitEuler(), effects=[ElasticJoints(k, d, J)])
    start = plant.init([0.1, -0.2], [0.3, 0.5])
    state, torque = start, numbers(1.5, -0.7)
    for _ in range(3):
        before, state = state, plant.step(state, torque)
        (theta, w), (theta1, w1) = (np.split(x.drives[-4:], 2) for x in (before, state))
        f = k * (theta1 - state.p) + d * (w1 - state.v)
        np.testing.assert_allclose(INERTIA * (state.v - before.v), DT * f, rtol=1e-11)
        np.testing.assert_allclose(J * (w1 - w), DT * (torque - f), rtol=1e-11)
        np.testing.assert_allclose(state.p - before.p, DT * (state.v + before.v) / 2, rtol=1e-9)
        np.testing.assert_allclose(theta1 - theta, DT * (w1 + w) / 2, rtol=1e-9)
    assert np.abs(state.v - start.v).max() > 0.02


def test_a_joint_that_begins_at_rest_is_braked_by_the_secant_of_its_friction(both: Mechanism) -> None:
    """(M + dt B) v_1 = dt torque, B by the curve at the speed that its slope at rest would lead to."""
    friction = Friction(viscous=[0.3, 0.1], coulomb=[1.0, 2.0], stribeck=0.5)
    plant = Plant(both, DT, integrator=LinearlyImplicitEuler(), effects=[friction])
    torque, slope = numbers(0.8, -1.1), numbers(0.3 + 150.0, 0.1 + 250.0)
    state = plant.step(plant.init([0.0, 0.0], [0.0, 0.0]), torque)
    first = DT * torque / (INERTIA + DT * slope)
    secant = numbers(0.3, 0.1) + (numbers(1.0, 2.0) + 0.5 / (1.0 + (first / 0.1) ** 2)) / np.hypot(first, 0.01)
    np.testing.assert_allclose(state.v, DT * torque / (INERTIA + DT * secant), rtol=1e-12)


@pytest.mark.parametrize("speed", [0.02, 0.1, 0.5])
def test_half_the_excess_of_static_friction_is_gone_at_its_speed_and_falls_by_the_square(
    both: Mechanism, speed: float
) -> None:
    """By torques that hold a steady speed: at twice it a fifth is left, at three times a tenth."""
    plant = Plant(both, 1e-7, effects=[Friction(coulomb=1.0, stribeck=[2.0, 4.0], stribeck_speed=speed)])
    for times, left in ((1.0, 1 / 2), (2.0, 1 / 5), (3.0, 1 / 10), (-2.0, 1 / 5)):
        v = times * speed
        smooth = v / np.hypot(v, 0.01)
        held = (1.0 + left * numbers(2.0, 4.0)) * smooth
        state = plant.step(plant.init([0.0, 0.0], [v, v]), held)
        np.testing.assert_allclose(state.v, v, atol=1e-13)


def test_each_measurement_has_noise_of_its_own(both: Mechanism) -> None:
    plant = Plant(both, DT, effects=[Encoder(noise=[0.01, 0.02], velocity_noise=[0.1, 0.3])])
    first, noise = plant.init([0.1, 0.2], [0.3, 0.4], noise=[1.0, -2.0, 3.0, 5.0]), numbers(-1.0, 0.5, 2.0, -4.0)
    np.testing.assert_allclose(first.measured_p, [0.1 + 0.01, 0.2 - 0.04], rtol=1e-14)
    np.testing.assert_allclose(first.measured_v, [0.3 + 0.3, 0.4 + 1.5], rtol=1e-14)
    state = plant.step(first, [0.0, 0.0], noise=noise)
    np.testing.assert_allclose(state.measured_p - state.p, [-0.01, 0.01], rtol=1e-12)
    np.testing.assert_allclose(state.measured_v - state.v, [0.2, -1.2], rtol=1e-12)


def test_clipped_is_a_torque_beyond_the_plants_limits_and_nothing_else(both: Mechanism) -> None:
    """Effects that make less of a torque have flags of their own."""
    plant = Plant(both, DT, effects=[TorqueRateLimit([100.0, 100.0]), TorqueLimit(6.0)])
    for torque, clipped, applied in (
        ([0.5, 0.5], False, [0.5, 0.5]),
        ([7.0, -8.0], False, [1.0, -1.0]),  # at most 1 N m per period
        ([0.9, 8.1], True, [0.9, 1.0]),
        ([np.nextafter(8.0, 9.0), 0.0], True, [1.0, 0.0]),
    ):
        state = plant.step(plant.init([0.0, 0.0], [0.0, 0.0]), torque)
        assert bool(state.clipped) is clipped
        np.testing.assert_allclose(state.applied_torque, applied, rtol=1e-13)
        limited = dict(zip(plant.flags, state.flags.tolist(), strict=True))
        assert limited["rate_limited"] == float(np.abs(torque).max() > 1.0)
    fast = Plant(both, DT, effects=[TorqueLimit(6.0)])
    state = fast.step(fast.init([0.0, 0.0], [0.0, 0.0]), [7.0, 0.0])
    assert not state.clipped
    np.testing.assert_array_equal(state.applied_torque, [6.0, 0.0])


def test_runs_count_what_was_clipped_and_not_what_drives_are_too_slow_for(both: Mechanism) -> None:
    law = PDGravity(both, [40.0, 40.0], [4.0, 4.0])
    still = Sinusoids([0.1, 0.1], [0.0, 0.0], [0.1, 0.1])
    env = TrackingEnv(both, still, control_period=DT, duration=0.5, effects=[TorqueRateLimit(30.0)])
    options = {"initial_error": [0.1, -0.1]}
    for drive in (simulate, rollout):
        run = drive(env, law, options=options)
        assert run.flags["rate_limited"].any()
        assert not run.clipped.any()


@pytest.mark.parametrize(("last", "kept"), [(0.29, 29), (0.07, 7), (0.004, 1), (0.026, 3), (0.5, 50), (9.0, 50)])
def test_the_last_seconds_are_as_many_samples_as_fit_them_best(both: Mechanism, last: float, kept: int) -> None:
    """0.29/0.01 is below 29 in floating point."""
    law = PDGravity(both, [4.0, 4.0], [1.0, 1.0])
    env = TrackingEnv(both, Sinusoids([0.0, 0.0], [0.1, 0.1], [1.0, 1.0]), control_period=DT, duration=0.5)
    for drive in (simulate, rollout):
        run = drive(env, law, seed=0, keep_last=last)
        np.testing.assert_allclose(run.time, DT * np.arange(50 - kept, 50), atol=1e-12)
