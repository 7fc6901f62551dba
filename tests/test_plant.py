"""The plant: its native code against the equations, its limits, its parameters, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adaptctl.arrays import Array
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.description import GROUND, Description, Joint, Link, Pose
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column, column
from adaptctl.simulation import Integrator, Plant, PlantState, RungeKutta4, SemiImplicitEuler


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


@pytest.fixture(scope="module")
def plant(puma: Mechanism) -> Plant:
    return Plant(puma, 1e-3)


def in_python(plant: Plant, state: PlantState, torque: Array, parameters: Array) -> Array:
    """The same control period by the equations on floats."""
    p, v, dt = column(state.p), column(state.v), plant.control_period / plant.substeps
    held, true = column(plant.clip_torque(torque)), column(parameters)

    def acceleration(p: Column, v: Column) -> Column:
        return plant.mechanism.equations.forward_dynamics(p, v, held, true)

    for _ in range(plant.substeps):
        p, v = plant.integrator.step(acceleration, p, v, dt)
    return np.array([*p, *v])


def pendulums(links: int) -> Mechanism:
    """A chain of rods that hang below each other."""
    ten = [0.1, 0.0, 0.0, -0.005, 0.001, 0.0, 0.001, 0.0, 0.0, 0.0001]
    chain = [
        Link(
            f"link{i}",
            i - 1 if i else GROUND,
            Joint(f"joint{i}", axis=np.array([0.0, 1.0, 0.0])),
            Pose(np.eye(3), np.array([0.0, 0.0, -0.1 if i else 0.0])),
            Pose.identity(),
            np.array(ten),
        )
        for i in range(links)
    ]
    return Mechanism(Description("pendulums", tuple(chain)))


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("integrator", [RungeKutta4(), SemiImplicitEuler()])
def test_native_code_is_the_equations(puma: Mechanism, integrator: Integrator, substeps: int) -> None:
    rng = np.random.default_rng(1)
    plant = Plant(puma, 2e-3, substeps, integrator)
    for _ in range(5):
        state = plant.init(rng.uniform(-2, 2, 6), rng.uniform(-2, 2, 6))
        torque, parameters = rng.uniform(-300, 300, 6), puma.inertial_parameters * rng.uniform(0.9, 1.1, 60)
        after = plant.step(state, torque, parameters)
        expected = in_python(plant, state, torque, parameters)
        np.testing.assert_allclose(np.concatenate((after.p, after.v)), expected, rtol=1e-10, atol=1e-12)
        assert after.time == pytest.approx(2e-3)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_equal_steps_give_equal_bits_and_leave_their_arguments_alone(plant: Plant, seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, v, torque = rng.uniform(-3, 3, (3, 6))
    state = plant.init(p, v)
    first, second = plant.step(state, torque), plant.step(state, torque)
    assert first.p.tobytes() == second.p.tobytes()
    assert first.v.tobytes() == second.v.tobytes()
    assert np.array_equal(state.p, p)
    assert np.array_equal(state.v, v)


def test_a_state_is_its_own(plant: Plant) -> None:
    """What it was made from may be used for something else."""
    p, v = np.zeros((2, 6))
    state = plant.init(p, v)
    p[:], v[:] = 1.0, 1.0
    for values in (state.p, state.v, state.q):
        np.testing.assert_array_equal(values, 0.0)


def test_energy_is_the_mechanisms(plant: Plant, puma: Mechanism) -> None:
    state = plant.init([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    assert plant.energy(state) == pytest.approx(float(puma.energy(state.p, state.v)), rel=1e-13)
    doubled = plant.energy(state, 2.0 * puma.inertial_parameters)
    assert doubled == pytest.approx(2.0 * plant.energy(state), rel=1e-13)


def test_power_is_the_rate_of_energy(plant: Plant) -> None:
    """A constant torque does the work torque . (p_after - p_before), whatever the path."""
    state = plant.init([0.0, -0.6, 0.8, 0.0, 0.5, 0.0], np.zeros(6))
    torque = np.array([10.0, -30.0, 8.0, 0.05, -0.05, 0.02])
    start, before = state, plant.energy(state)
    for _ in range(200):
        state = plant.step(state, torque)
    work = float(torque @ (state.p - start.p))
    assert plant.energy(state) - before == pytest.approx(work, rel=1e-9)


def test_torque_is_held_within_the_limits(plant: Plant, puma: Mechanism) -> None:
    state = plant.init(np.zeros(6), np.zeros(6))
    far, limits = np.array([1e6, -1e6, 1e6, 1.0, 0.0, -1e6]), puma.effort_limits
    limited = plant.clip_torque(far)
    np.testing.assert_array_equal(limited, np.clip(far, -limits, limits))
    np.testing.assert_array_equal(plant.step(state, far).v, plant.step(state, limited).v)
    free = replace(plant, torque_limits=np.full(6, np.inf))
    assert np.abs(free.step(state, far).v).max() > 10.0 * np.abs(plant.step(state, far).v).max()


def test_a_payload_needs_no_new_plant(plant: Plant, puma: Mechanism) -> None:
    heavier = np.array(puma.inertial_parameters)
    heavier[50] += 2.0
    other = Plant(puma.with_parameters(heavier), 1e-3)
    state = plant.init([0.0, -0.6, 0.8, 0.0, 0.5, 0.0], np.zeros(6))
    with_payload = plant.step(state, np.zeros(6), heavier)
    np.testing.assert_array_equal(with_payload.v, other.step(state, np.zeros(6)).v)
    assert not np.array_equal(with_payload.v, plant.step(state, np.zeros(6)).v)


def test_long_mechanisms_run_in_python() -> None:
    links = MAX_COMPILED_LINKS + 1
    plant = Plant(pendulums(links), 1e-3, integrator=SemiImplicitEuler())
    state = plant.init(np.full(links, 0.1), np.zeros(links))
    after = plant.step(state, np.zeros(links))
    expected = in_python(plant, state, np.zeros(links), plant.mechanism.inertial_parameters)
    np.testing.assert_array_equal(np.concatenate((after.p, after.v)), expected)
    assert plant.energy(after) == pytest.approx(plant.energy(state), rel=1e-4)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"control_period": 0.0}, "control_period: expected a positive time"),
        ({"control_period": float("nan")}, "control_period"),
        ({"substeps": 0}, "substeps: expected a whole number from 1 to 1000000, got 0"),
        ({"torque_limits": np.ones(5)}, "torque_limits: expected a number or 6 of them"),
        ({"torque_limits": -1.0}, "torque_limits"),
    ],
)
def test_bad_settings_are_refused(puma: Mechanism, settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Plant(puma, **({"control_period": 1e-3} | settings))


def test_bad_arguments_are_refused(plant: Plant) -> None:
    state = plant.init(np.zeros(6), np.zeros(6))
    nan, torque = np.array([0.0, 0.0, np.nan, 0.0, 0.0, 0.0]), np.zeros(6)
    with pytest.raises(NonFiniteError, match=r"torque: expected finite numbers, got nan at index \(2,\)"):
        plant.step(state, nan)
    with pytest.raises(NonFiniteError, match="torque"):
        plant.clip_torque(np.full(6, np.inf))
    with pytest.raises(InputError, match=r"torque: expected shape .*got \(5,\)"):
        plant.step(state, np.zeros(5))
    with pytest.raises(InputError, match="torque: expected shape"):
        plant.clip_torque(np.zeros((2, 6)))
    with pytest.raises(NonFiniteError, match="p: expected finite"):
        plant.init(nan, torque)
    with pytest.raises(NonFiniteError, match="v: expected finite"):
        plant.step(state._replace(v=nan), torque)
    with pytest.raises(NonFiniteError, match="parameters: expected finite"):
        plant.step(state, torque, np.full(60, np.nan))
    with pytest.raises(InputError, match="parameters"):
        plant.step(state, torque, np.zeros(61))


def test_a_motion_that_runs_away_is_refused(plant: Plant) -> None:
    with pytest.raises(NonFiniteError, match="the motion diverged after 0 s: use a shorter control period"):
        plant.step(plant.init(np.zeros(6), np.full(6, 1e150)), np.zeros(6))


def test_a_loop_that_closes_the_other_way_is_where_the_arm_cannot_be() -> None:
    """At the same primary joints, which are within all conditions."""
    arm = load("semi_direct_drive")
    p, plant = arm.neutral_configuration, Plant(arm, 1e-3)
    own, other = arm.configuration(p), column([*p.tolist(), 3.0182, 4.6712])
    for _ in range(5):
        other = arm.equations.closed(column(p), other)
    q = np.array(other.of, dtype=np.float64)
    np.testing.assert_allclose(np.array(arm.equations.closed(column(p), other).of, dtype=np.float64), q, atol=1e-12)
    assert plant.is_valid_configuration(np.array([own, q])).tolist() == [True, False]
