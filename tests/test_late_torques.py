"""Guarded learning of torques that arrive some control periods late."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain
from sampled_loops import arm, gains, own_gain, reduced, swinging

from adaptctl import Plant, Sinusoids, SlotineLi, adaptive_controller, simulate_many
from adaptctl.control import AdaptiveComputedTorque, Gradient, GuardedLearning, Projection
from adaptctl.control.adaptation import late_torques
from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.description import Description
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.hardware import ready_controller
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column
from adaptctl.simulation.effects import ControlDelay

ARM = "puma560_arm3"
TRUE = reduced(ARM).fundamental_parameters


def period_of(torque: Column) -> Period:
    nothing: Any = None
    return Period(nothing, torque, torque, torque, torque, torque, 1e-3, 1e-3, torque)


@given(delay=st.integers(0, 64), r=st.integers(1, 7), arms=st.integers(1, 3), seed=st.integers(0, 99))
@settings(max_examples=10, deadline=None)
def test_a_torque_arrives_that_was_sent_so_many_periods_ago(delay: int, r: int, arms: int, seed: int) -> None:
    sent = np.random.default_rng(seed).normal(size=(70, r, arms))
    state = late_torques.start(delay, r)
    if delay:
        state = late_torques.SentTorques(Column(np.zeros(arms) for _ in range(delay * r)))
    found = []
    for torque in sent:
        period, state = late_torques.arrived(period_of(Column(torque)), state)
        found.append(np.array(period.torque.of))
    np.testing.assert_array_equal(found, np.concatenate((np.zeros((delay, r, arms)), sent))[:70])


def torque_error(delay: int, told: int) -> float:
    """Error of predicted torques 1 s after the true parameters, on an arm whose torques are late, relative."""
    law = GuardedLearning(own_gain(ARM), 1.0 / (3.3e-3 * gains(ARM).damping) ** 2, delay=told)
    controller = SlotineLi(reduced(ARM), 8.0, gains(ARM).damping, law, TRUE, torque_limits=np.inf)
    reference = swinging(arm(ARM), amplitude=0.4)
    plant = Plant(arm(ARM), 1e-3, torque_limits=np.full(3, np.inf), effects=[ControlDelay(delay)])
    moving = plant.init(reference(np.zeros(1)).p[0], np.zeros(3))
    state = controller.init(moving.p, moving.v)
    for k in range(1000):
        torque, state = controller.step(state, moving.p, moving.v, reference(1e-3 * k))
        moving = plant.step(moving, torque)
    points = reference(np.linspace(0.0, 1.0, 100))
    Y = reduced(ARM).torque_regressor(points.p, points.v, points.a)
    return float(np.linalg.norm(Y @ (state.estimate - TRUE)) / np.linalg.norm(Y @ TRUE))


def test_a_delay_that_is_told_does_not_move_true_parameters() -> None:
    assert torque_error(2, 2) < 0.2 * torque_error(2, 0)


def test_without_a_delay_nothing_is_kept() -> None:
    law = SlotineLi(reduced(ARM), 8.0, gains(ARM).damping, GuardedLearning(own_gain(ARM)))
    assert law.init(np.zeros(3), np.zeros(3)).law_state.sent == NoMemory()
    assert late_torques.arrived(period := period_of(column(np.ones(2))), NoMemory()) == (period, NoMemory())


def test_the_delay_of_a_robot_is_told_to_its_law() -> None:
    mechanism = arm("two_link")
    for controller in (
        adaptive_controller(mechanism, control_period=4e-3, delay=3),
        ready_controller(mechanism, 4e-3, swinging(mechanism), delay=3),
    ):
        law: Any = controller.adaptation_law
        assert (law.delay, controller.init(np.zeros(2), np.zeros(2)).law_state.sent.torques.shape) == (3, (6,))


def ringing(delay: int, told: int) -> Any:
    """Half a second without gravity; the estimated inertia feeds back a tenth more than late torques allow."""
    description = Description("joint", random_chain(3, 1).links, gravity=np.zeros(3))
    model = ReducedModel(Mechanism(description))
    inertia = model.mechanism.mass_matrix(np.zeros(1))[0, 0]
    limit = 2.0 * np.sin(np.pi / (4 * delay + 2))
    first = model.fundamental_parameters * (1.1 * limit - 0.1) / 8e-3
    law = Gradient(0.6 * first**2, delay=told)
    controller = SlotineLi(model, 8.0, 0.1e3 * inertia, law, first, torque_limits=np.inf)
    still = Sinusoids(np.zeros(1), np.zeros(1), np.ones(1))
    plant = Plant(model.mechanism, 1e-3, torque_limits=[np.inf], effects=[ControlDelay(delay)])
    return simulate_many(plant, controller, still, duration=0.5, p=[[0.0]], v=[[0.01]]), np.abs(first)


@pytest.mark.parametrize("delay", [1, 2, 3])
def test_a_ring_lowers_the_inertia_that_causes_it_where_the_delay_is_told(delay: int) -> None:
    """The velocity that late torques feed back has the sign of the present one in a ring, so an estimate would rise."""
    run, first = ringing(delay, 0)
    assert not run.finite or np.abs(run.estimate[-1]).max() > first.max()
    run, first = ringing(delay, delay)
    assert run.finite
    assert np.all(np.abs(run.estimate[-1]) < 0.99 * first)
    assert np.abs(run.v[-50:]).max() < 5e-3


def test_laws_around_a_late_gradient_are_as_late_and_others_have_no_delay() -> None:
    late = Gradient(own_gain(ARM), delay=2)
    bounds = np.full(len(TRUE), np.inf)
    assert Projection(late, -bounds, bounds).regressor_delay == 2
    assert GuardedLearning(own_gain(ARM), delay=2).regressor_delay == 0
    with pytest.raises(InputError, match="has no delay: use SlotineLi"):
        AdaptiveComputedTorque(reduced(ARM), 8.0, adaptation=late, initial=TRUE)


@pytest.mark.parametrize("delay", [-1, 65, 1.0, True])
def test_delays_that_are_none_are_refused(delay: Any) -> None:
    with pytest.raises(InputError, match="delay"):
        GuardedLearning(own_gain(ARM), delay=delay)
    with pytest.raises(InputError, match="delay"):
        Gradient(own_gain(ARM), delay=delay)
    with pytest.raises(InputError, match="delay"):
        adaptive_controller(arm("two_link"), control_period=4e-3, delay=delay)
