"""Plants and controllers in python-control: the same numbers as ours, and linearised as theory has it."""

from __future__ import annotations

from typing import Any

import control
import numpy as np
import pytest
from random_trees import random_chain

from adaptctl.control import ComputedTorque, Controller, SafetyFilter, SlotineLi, adaptation_gain, typical_inertia
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import LinearlyImplicitEuler, Plant, rollout
from adaptctl.simulation.effects import ControlDelay, Friction, LuGre
from adaptctl.simulation.systems import (
    closed_loop_system,
    controller_start,
    controller_system,
    mechanism_system,
    plant_system,
)

PERIOD = 1e-3
POSE = np.array([0.0, -0.6, 0.8, 0.0, 0.5, 0.0])


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_geared")


def laws(puma: Mechanism) -> list[Controller]:
    model = ReducedModel.full(puma)
    return [ComputedTorque(puma, 8.0), SlotineLi(model, 8.0, 10.0, adaptation_gain(model), control_period=PERIOD)]


@pytest.mark.parametrize("which", [0, 1])
def test_the_joined_loop_is_the_rollout(puma: Mechanism, which: int) -> None:
    law = laws(puma)[which]
    run = rollout(TrackingEnv(puma, 1, duration=0.1, initial_error=0.05), law, seed=0)
    loop = closed_loop_system(Plant(puma, PERIOD), law)
    reference = np.concatenate((run.reference_p, run.reference_v, run.reference_a), axis=1).T
    start = np.concatenate((run.p[0], run.v[0], controller_start(law, run.p[0], run.v[0])))
    response = control.input_output_response(loop, PERIOD * np.arange(100), reference, start)
    np.testing.assert_allclose(response.outputs[:6].T, run.p, atol=1e-12)
    np.testing.assert_allclose(response.outputs[6:].T, run.v, atol=1e-11)


def test_a_pendulum_linearises_to_its_frequency_and_its_damping() -> None:
    """s^2 + (b/I) s + g'/I about hanging, and its sampling by exp(sT)."""
    arm = random_chain(3, 1).with_drives(Drive(rotor_inertia=0.2, viscous=0.3))
    slope = (arm.inverse_dynamics([1e-6], [0.0], [0.0]) - arm.inverse_dynamics([-1e-6], [0.0], [0.0]))[0] / 2e-6
    torque, inertia = arm.inverse_dynamics([0.0], [0.0], [0.0]), typical_inertia(arm)[0]
    expected = np.roots([1.0, 0.3 / inertia, slope / inertia])
    linear = control.linearize(mechanism_system(arm), [0.0, 0.0], torque)
    np.testing.assert_allclose(np.sort_complex(linear.poles()), np.sort_complex(expected), rtol=1e-4)
    sampled = control.linearize(plant_system(Plant(arm, 0.01, 4)), [0.0, 0.0], torque)
    assert sampled.dt == 0.01
    np.testing.assert_allclose(
        np.sort_complex(sampled.poles()), np.sort_complex(np.exp(0.01 * expected)), rtol=1e-6, atol=1e-6
    )


def test_computed_torque_puts_its_poles(puma: Mechanism) -> None:
    """With true parameters: six pairs at 8/s, each sampled under a hold; the law's own memory decays at once."""
    law, plant = ComputedTorque(puma, 8.0), Plant(puma, PERIOD)
    start = np.concatenate((POSE, np.zeros(6), controller_start(law, POSE, np.zeros(6))))
    loop = control.linearize(closed_loop_system(plant, law), start, np.concatenate((POSE, np.zeros(12))))
    poles = loop.poles()
    assert np.count_nonzero(np.abs(poles) < 1e-6) == 6
    k, c = 64.0 * PERIOD**2, 16.0 * PERIOD
    held = np.roots([1.0, 0.5 * k + c - 2.0, 1.0 + 0.5 * k - c])
    pairs = poles[np.abs(poles) > 1e-6]
    assert np.sum(pairs).real == pytest.approx(6.0 * np.sum(held).real, rel=1e-6)
    assert np.prod(pairs).real == pytest.approx(np.prod(held).real ** 6, rel=1e-5)  # gravity moves within a hold


def test_loops_are_systems_too() -> None:
    arm = load("semi_direct_drive")
    p, v, torque = arm.neutral_configuration, np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, -1.0])
    state = np.concatenate((p, v))
    rates = mechanism_system(arm).dynamics(0.0, state, torque)
    np.testing.assert_allclose(rates, np.concatenate((v, arm.forward_dynamics(p, v, torque))), rtol=1e-12)
    plant = Plant(arm, PERIOD)
    after = plant.step(plant.init(p, v), torque)
    np.testing.assert_allclose(
        plant_system(plant).dynamics(0.0, state, torque), np.concatenate((after.p, after.v)), rtol=1e-12
    )


def test_a_controller_keeps_its_estimate_in_its_state(puma: Mechanism) -> None:
    law = laws(puma)[1]
    system = controller_system(law, PERIOD)
    assert (system.ninputs, system.noutputs, system.dt) == (30, 6, PERIOD)
    x = controller_start(law, POSE, np.zeros(6))
    u = np.concatenate((POSE + 0.1, np.ones(6), POSE, np.zeros(12)))
    after = system.dynamics(0.0, system.dynamics(0.0, x, u), u)
    np.testing.assert_array_equal(x[:66], 0.0)
    assert np.abs(after[:66]).max() > 0.0


def test_a_loop_of_two_arms_is_refused(puma: Mechanism) -> None:
    other = random_chain(0, 2)
    with pytest.raises(InputError, match="the plant has 2 joints, but the controller has 6"):
        closed_loop_system(Plant(other, PERIOD), ComputedTorque(puma, 8.0))


@pytest.mark.parametrize("period", [0, 0.0, -1e-3, np.nan, np.inf, None, "1e-3"])
@pytest.mark.parametrize("which", [0, 1])
def test_a_period_is_a_positive_time(puma: Mechanism, which: int, period: Any) -> None:
    with pytest.raises(InputError, match="period: expected a positive time in s"):
        controller_system(laws(puma)[which], period)


def test_a_law_ticks_at_its_own_period(puma: Mechanism) -> None:
    """What it learns in a tick goes with the period; a law without learning has none."""
    without, law = laws(puma)
    for refused in (
        law,
        SafetyFilter(law),
        SafetyFilter(without, rate_limits=1e4, stop_damping=10.0, control_period=PERIOD),
    ):
        for other in (5e-3, 5e-4):
            with pytest.raises(InputError, match=rf"period: \w+ has the period 0\.001 s, got {other:g} s"):
                closed_loop_system(Plant(puma, other), refused)
        assert closed_loop_system(Plant(puma, PERIOD), refused).dt == PERIOD
    assert closed_loop_system(Plant(puma, 5e-3), without).dt == 5e-3


@pytest.mark.parametrize("which", [0, 1])
def test_the_first_state_is_that_of_one_arm(puma: Mechanism, which: int) -> None:
    law, many = laws(puma)[which], np.zeros((5, 6))
    for p, v, name in ((many, many, "p"), (POSE, many, "v"), (many[0, :3], POSE, "p"), (0.0, POSE, "p")):
        with pytest.raises(InputError, match=rf"{name}: expected shape \(6,\), for one arm, got \("):
            controller_start(law, p, v)  # type: ignore[arg-type]
    with pytest.raises(NonFiniteError):
        controller_start(law, np.full(6, np.nan), POSE)


def test_a_plant_that_remembers_is_refused(puma: Mechanism) -> None:
    """Its state would be more than p and v; friction in the joints is not."""
    for plant in (
        Plant(puma, PERIOD, effects=[ControlDelay(1)]),
        Plant(puma, PERIOD, 4, LinearlyImplicitEuler(), effects=[LuGre(1.0, 1e4)]),
    ):
        with pytest.raises(InputError, match="expected a plant with joint effects without a state only"):
            plant_system(plant)
    assert plant_system(Plant(puma, PERIOD, effects=[Friction(viscous=1.0)])).nstates == 12
