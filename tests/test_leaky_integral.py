"""A leaky integral of the sliding variable: its theorem, its bounds, and friction that is in no model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled_loops import Loop, arm, distance, gains, kinetic, loop, own_gain, reduced, swinging

from adaptctl.arrays import Array
from adaptctl.contest.entries import ContestEntry
from adaptctl.control import LeakyIntegral, SlotineLi
from adaptctl.errors import InputError

NAME, SMALL = "puma560_geared", "puma560_arm3"


def fast(run: Loop) -> Array:
    """Torques (T, r) of the integral."""
    return np.array([state.controller_state.torque for state in run.states])


def agreed(run: Loop) -> Array:
    """Shares (T, r) of the time in which speeds agreed with positions."""
    return np.array([state.controller_state.agreed for state in run.states])


@settings(max_examples=5, deadline=None)
@given(rate=st.floats(5.0, 100.0), added=st.floats(0.0, 100.0), leak=st.floats(0.1, 10.0), seed=st.integers(0, 100))
def test_v_with_the_energy_of_the_integral_never_rises(rate: float, added: float, leak: float, seed: int) -> None:
    mechanism, damping, own = arm(NAME), gains(NAME).damping, 0.1 * own_gain(NAME)
    settings = {"torque_limits": np.inf, "integral_rate": rate, "added_rate": added, "leak": leak}
    law = LeakyIntegral(reduced(NAME), 5.0, damping, own, **settings)
    run = loop(law, mechanism, swinging(mechanism, seed), 0.5)
    rates = rate + added * agreed(run)
    V = (
        kinetic(mechanism, run)
        + distance(law, run, mechanism.inertial_parameters)
        + 0.5 * (fast(run) ** 2 / (rates * damping)).sum(1)
    )
    assert np.diff(V).max() < 1e-5 * V[0]
    assert V[0] - V[-1] > 0.9 * kinetic(mechanism, run)[0]


@pytest.mark.parametrize("leak", [1.0, 4.0])
def test_the_leak_leaves_of_a_constant_load_what_the_rates_say(leak: float) -> None:
    mechanism, K, model = arm(SMALL), gains(SMALL).damping, reduced(SMALL)
    reference, load, rate = swinging(mechanism, amplitude=0.0), 0.2 * gains(SMALL).damping, 20.0
    law = LeakyIntegral(
        model, 5.0, K, initial=model.fundamental_parameters, torque_limits=np.inf, integral_rate=rate, leak=leak
    )
    run = loop(law, mechanism, reference, 10.0, disturbance=lambda t: load)
    assert np.abs(run.p[-1] - reference.center) == pytest.approx(0.2 / (5.0 * (1.0 + rate / leak)), rel=1e-2)


def test_it_is_within_its_share_of_the_limits_and_rests_while_a_torque_is_at_its_own() -> None:
    mechanism, K, model = arm(SMALL), gains(SMALL).damping, reduced(SMALL)
    limits = np.array([80.0, 90.0, 40.0])
    law = LeakyIntegral(model, 5.0, K, torque_limits=limits, integral_share=0.02)
    run = loop(law, mechanism, swinging(mechanism), 1.0)
    assert (np.abs(fast(run)).max(axis=0) / limits).max() == pytest.approx(0.02)
    low = LeakyIntegral(model, 5.0, K, torque_limits=1e-3)
    state = low.init(np.full(3, 0.5), np.zeros(3))
    aim = swinging(mechanism, amplitude=0.0)(0.0)
    for _ in range(3):
        _, state = low.step(state, aim.p + 0.5, np.zeros(3), aim)
    assert state.dt == 0.0
    np.testing.assert_array_equal(state.controller_state.torque, 0.0)


def test_without_time_to_act_it_is_slotine_and_lis_law() -> None:
    mechanism, K, model = arm(SMALL), gains(SMALL).damping, reduced(SMALL)
    runs = [
        loop(law, mechanism, swinging(mechanism), 0.3)
        for law in (
            SlotineLi(model, 5.0, K, own_gain(SMALL)),
            LeakyIntegral(model, 5.0, K, own_gain(SMALL), integral_rate=1e-9),
        )
    ]
    np.testing.assert_allclose(runs[0].p, runs[1].p, atol=1e-9)


def test_noise_of_speeds_does_not_add_up() -> None:
    """At rest half the difference of two speeds is left of the noise."""
    K, aim = gains(SMALL).damping, swinging(arm(SMALL), amplitude=0.0)(0.0)
    law = LeakyIntegral(reduced(SMALL), 5.0, K, initial=reduced(SMALL).fundamental_parameters, torque_limits=np.inf)
    state, noise = law.init(aim.p, 0.0 * aim.p), np.random.default_rng(0).uniform(-0.03, 0.03, (2000, 3))
    for v in noise:
        _, state = law.step(state, aim.p, v, aim)
        assert np.all(np.abs(state.controller_state.torque) <= 0.03 * 40.0 * 1e-3 * K)


def test_the_default_law_follows_friction_that_is_in_no_model_as_the_gradient_does() -> None:
    def errors(law: str) -> list[float]:
        entry = ContestEntry(law, "puma560_arm3", "", ("stribeck",), (1,), 8.0, (), "adaptctl")
        return [row["error"] for row in entry.rows()]

    learned, true = errors("learning"), errors("true")
    assert learned[0] < 0.025 * true[0]


def test_the_rate_rises_with_exact_speeds_and_falls_with_late_ones_no_faster_than_the_leak_pays() -> None:
    mechanism, model = arm(SMALL), reduced(SMALL)
    law = LeakyIntegral(model, 5.0, gains(SMALL).damping, torque_limits=np.inf, leak=10.0, added_rate=100.0)
    reference, share = swinging(mechanism), []
    state = law.init(reference(0.0).p, reference(0.0).v)
    for k in range(1, 400):
        late = 3e-3 if k > 200 else 0.0
        t = 1e-3 * k
        _, state = law.step(state, reference(t).p, reference(t - late).v, reference(t))
        share.append(state.controller_state.agreed)
    assert np.min(share[199]) > 0.95
    assert np.max(share[-1]) < 0.1
    assert np.min(np.array(share[200:]) / share[199:-1]) == pytest.approx(1.0 / 1.02, rel=1e-12)


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (
            lambda: {"integral_rate": 201.0},
            "integral_rate: 201 1/s, with what is added, is too fast for a control period of 0.001 s; use at most 200",
        ),
        (lambda: {"added_rate": 161.0}, "integral_rate: 201 1/s, with what is added, is too fast"),
        (lambda: {"added_rate": -1.0}, "added_rate: expected at least 0 1/s, got -1"),
        (lambda: {"integral_rate": 0.0}, "integral_rate: expected a positive number in 1/s"),
        (lambda: {"leak": -1.0}, "leak: expected a positive number in 1/s"),
        (lambda: {"integral_share": np.nan}, "integral_share: expected a positive number"),
    ],
)
def test_numbers_out_of_range_are_refused(made: Callable[[], dict[str, float]], says: str) -> None:
    with pytest.raises(InputError, match=says):
        LeakyIntegral(reduced(SMALL), 5.0, gains(SMALL).damping, **made())  # type: ignore[arg-type]
