"""Linear controllers of python-control on our plants and environments, against python-control itself."""

from __future__ import annotations

import control
import gymnasium
import numpy as np
import pytest

import adaptctl
from adaptctl.control import LinearController, PDGravity, ReferencePoint
from adaptctl.errors import InputError
from adaptctl.simulation.systems import mechanism_system, plant_system

PERIOD = 1e-3


@pytest.fixture(scope="module")
def arm() -> adaptctl.Mechanism:
    return adaptctl.load("two_link")


def lqr_gain(arm: adaptctl.Mechanism) -> np.ndarray:
    still = np.zeros(2)
    linear = mechanism_system(arm).linearize(np.zeros(4), arm.inverse_dynamics(still, still, still))
    sampled = control.c2d(linear, PERIOD)
    return control.dlqr(sampled, np.diag([1e4, 1e4, 10.0, 10.0]), 0.01 * np.eye(2))[0]


def test_lqr_with_feedforward_tracks_in_our_environment(arm: adaptctl.Mechanism) -> None:
    law = LinearController.state_feedback(lqr_gain(arm), feedforward=arm)
    env = gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", robot=arm, reference=3, duration=5.0, initial_error=0.05)
    run = adaptctl.simulate(env, law, seed=0)
    assert np.abs(run.error[-1]).max() < 1e-3 < 0.04 < np.abs(run.error[0]).max()


def test_state_feedback_is_a_spring_and_a_damper(arm: adaptctl.Mechanism) -> None:
    rng = np.random.default_rng(0)
    p, v, rp, rv, ra = rng.normal(size=(5, 2))
    law = LinearController.state_feedback([[7.0, 0.0, 2.0, 0.0], [0.0, 5.0, 0.0, 1.0]])
    torque, _ = law.step(law.init(p, v), p, v, ReferencePoint(rp, rv, ra))
    np.testing.assert_allclose(torque, -np.array([7.0, 5.0]) * (p - rp) - np.array([2.0, 1.0]) * (v - rv))


def test_a_system_is_the_controller_that_it_is_there(arm: adaptctl.Mechanism) -> None:
    pid = control.tf([30.0, -59.0, 29.1], [1.0, -1.2, 0.2], PERIOD)
    single = control.ss(pid)
    system = control.ss(control.append(single, 0.5 * single), inputs=["error[0]", "error[1]"], outputs=2)
    law = LinearController.from_system(system, PERIOD)
    errors = np.random.default_rng(1).normal(size=(50, 2))
    expected = control.forced_response(system, U=errors.T).outputs.T
    zero, found = np.zeros(2), []
    state = law.init(zero, zero)
    for error in errors:
        torque, state = law.step(state, zero, zero, ReferencePoint(error, zero, zero))
        found.append(torque)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("stated", [True, None, 2e-3])
def test_a_system_whose_period_is_not_stated_takes_the_controllers(stated: bool | float | None) -> None:
    system = control.ss([[0.5]], [[1.0]], [[3.0]], [[2.0]], stated, inputs=["p[0]"])
    law = LinearController.from_system(system, 2e-3)
    np.testing.assert_array_equal(law.D[:, 0], [2.0])


def test_closed_loops_are_the_same_there_and_here(arm: adaptctl.Mechanism) -> None:
    gain = np.array([[60.0, 0.0, 12.0, 0.0], [0.0, 40.0, 0.0, 6.0]])
    plant, law = adaptctl.Plant(arm, PERIOD), LinearController.state_feedback(gain)
    there = plant_system(plant)
    state, x, memory = plant.init([0.2, 0.1], [0.0, 0.0]), np.array([0.2, 0.1, 0.0, 0.0]), law.init([0, 0], [0, 0])
    still = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
    for k in range(200):
        torque, memory = law.step(memory, state.p, state.v, still)
        state = plant.step(state, torque)
        x = there.dynamics(k * PERIOD, x, -gain @ x)
    np.testing.assert_allclose([*state.p, *state.v], x, atol=1e-10)
    assert isinstance(PDGravity(arm, gain[0, 0], gain[0, 2]), PDGravity)


@pytest.mark.parametrize(
    ("system", "message"),
    [
        (control.ss(-1.0, 1.0, 1.0, 0.0, inputs=["error[0]"]), r"in continuous time: sample it, control\.c2d"),
        (control.ss(0.5, 1.0, 1.0, 0.0, 0.1, inputs=["error[0]"]), r"the system's period is 0\.1 s"),
        (control.ss(0.5, 1.0, 1.0, 0.0, PERIOD, inputs=["wind"]), "unknown input 'wind': expected p, v"),
        (control.ss(0.5, 1.0, 1.0, 0.0, PERIOD, inputs=["error[1]"]), r"unknown input 'error\[1\]'"),
        ("pid", "expected a linear system of python-control, got str"),
    ],
)
def test_systems_that_are_refused(system: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        LinearController.from_system(system, PERIOD)  # type: ignore[arg-type]


def test_gains_that_are_refused(arm: adaptctl.Mechanism) -> None:
    with pytest.raises(InputError, match=r"expected a gain \(r, 2 r\), got \(2, 3\)"):
        LinearController.state_feedback(np.zeros((2, 3)))
    with pytest.raises(InputError, match="feedforward: expected a tree of 1 joints"):
        LinearController.state_feedback(np.zeros((1, 2)), arm)
