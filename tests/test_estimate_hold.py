"""What an estimate adds to the sampling ratio: its bound is above every estimate on the way, and "
"gains are held by it."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain

from adaptctl import Plant, Sinusoids
from adaptctl.arrays import Array
from adaptctl.control import (
    Gains,
    Gradient,
    SlotineLi,
    Workspace,
    adaptation_gain,
    estimate_sampling_ratio,
    mapped_gain,
    sampling_ratio,
)
from adaptctl.control.adaptation.prior_ranges import PriorRanges, parameter_sampling_ratios
from adaptctl.control.gains.adaptation_ratio import stable_adaptation_below
from adaptctl.control.gains.workspace import everywhere
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import GainError, InputError, StabilityWarning, TuningWarning
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import simulate_many
from adaptctl.simulation.effects import ControlDelay

ARM = random_chain(3, 3)
MODEL = ReducedModel(ARM)
K, PERIOD, BANDWIDTH = len(MODEL.columns), 1e-3, np.array([6.0, 5.0, 7.0])


def hold_of_an_error(model: ReducedModel, error: Array, p: Array) -> Array:
    """T |lambda|_max(M^-1 (M^ - M) Lambda) at p (S, r), M^ - M of the error, written with mass matrices alone."""
    arm = model.mechanism
    nothing = arm.with_parameters(np.zeros(len(arm.parameter_names)))
    shift = nothing.with_parameters(model.embed(error)).mass_matrix(p)
    added = np.linalg.solve(arm.mass_matrix(p), shift * BANDWIDTH)
    return PERIOD * np.asarray(np.abs(np.linalg.eigvals(added)).max(axis=-1))


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_no_parameter_causes_more_than_its_number() -> None:
    numbers, p = parameter_sampling_ratios(MODEL, BANDWIDTH, PERIOD), everywhere(ARM).samples
    met = np.array([hold_of_an_error(MODEL, unit, p).max() for unit in np.eye(K)])
    assert np.all(met <= numbers * (1.0 + 1e-9))
    assert np.all(numbers <= np.sqrt(3.0) * np.sqrt(7.0 / 5.0) * met + 1e-12)  # a Frobenius norm, and sides that differ


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), whole=st.booleans(), kinetic=st.sampled_from([0.0, 3.0]))
def test_no_estimate_within_v_adds_more_than_its_bound(seed: int, whole: bool, kinetic: float) -> None:
    """Of all errors with error' Gamma^-1 error/2 <= V_0: a random one on the ellipsoid, and the worst for the bound."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(K, K))
    full = A @ A.T + 0.1 * np.eye(K) if whole else np.diag(rng.uniform(0.1, 5.0, K))
    prior = rng.uniform(0.1, 2.0, K)
    bound = estimate_sampling_ratio(MODEL, full if whole else np.diag(full), prior, BANDWIDTH, PERIOD, kinetic=kinetic)
    start = prior * rng.choice([-1.0, 1.0], K)
    level = 2.0 * kinetic + float(start @ np.linalg.solve(full, start))
    u = parameter_sampling_ratios(MODEL, BANDWIDTH, PERIOD)
    for direction in (rng.normal(size=K), full @ u, full @ (u * rng.choice([-1.0, 1.0], K))):
        error = direction * np.sqrt(level / float(direction @ np.linalg.solve(full, direction)))
        assert hold_of_an_error(MODEL, error, everywhere(ARM).samples[:40]).max() <= bound * (1.0 + 1e-9)


def test_an_estimate_is_taken_to_begin_at_rest_unless_a_kinetic_energy_is_given() -> None:
    given = MODEL, np.ones(K), np.full(K, 0.5), BANDWIDTH, PERIOD
    assert (
        estimate_sampling_ratio(*given)
        == estimate_sampling_ratio(*given, kinetic=0.0)
        < estimate_sampling_ratio(*given, kinetic=1.0)
    )


def wrist() -> tuple[ReducedModel, Gains]:
    """A PUMA, whose last link is light."""
    arm = load("puma560_measured")
    model = ReducedModel(arm)
    shape = np.median(np.diagonal(everywhere(arm).mass_matrices, axis1=1, axis2=2), axis=0)
    return model, Gains(np.full(6, 8.0), shape / sampling_ratio(arm, shape, PERIOD).value)


def test_ranges_are_held_where_a_light_wrist_would_ring() -> None:
    """Each to a fifth of what the gains leave of the sampling ratio."""
    model, gains = wrist()
    free, held = adaptation_gain(model), adaptation_gain(model, gains=gains, control_period=PERIOD)
    h = sampling_ratio(model.mechanism, gains.damping, PERIOD, gains.bandwidth).value
    u = parameter_sampling_ratios(model, gains.bandwidth, PERIOD)
    range_of = PriorRanges().for_parameters(model.names)
    np.testing.assert_allclose(held, 0.6 * np.minimum(range_of, 0.2 * (2.0 - h) / np.maximum(u, 1e-300)) ** 2)
    assert np.all(held <= free)
    lightest = model.names.index("link6.I_zz")
    assert held[lightest] < 1e-3 * free[lightest]
    still = [j for j, name in enumerate(model.names) if u[j] < 1e-6 * u[lightest]]
    np.testing.assert_array_equal(held[still], free[still])


def test_ranges_are_held_less_where_less_is_asked_for() -> None:
    """A slower bandwidth and a smaller workspace leave more; a rate is a factor on all."""
    model, gains = wrist()
    at: Any = {"gain_scale": 0.06, "control_period": PERIOD}
    held = adaptation_gain(model, gains=gains, **at)
    slower = adaptation_gain(model, gains=Gains(0.5 * gains.bandwidth, gains.damping), **at)
    along = Workspace.along(model.mechanism, np.array([[0.0, -0.6, 0.8, 0.0, 1.2, 0.0]]), margin=0.05)
    near = adaptation_gain(model, gains=gains, workspace=along, **at)
    assert np.all(slower >= held * (1.0 - 1e-12))
    assert slower.sum() > held.sum()
    assert near[model.names.index("link6.I_zz")] > held[model.names.index("link6.I_zz")]
    doubled = adaptation_gain(model, gain_scale=0.12, gains=gains, control_period=PERIOD)
    np.testing.assert_allclose(doubled, 2.0 * held)


@pytest.mark.parametrize("delay", [1, 2, 3])
def test_ranges_are_held_to_what_a_delay_leaves(delay: int) -> None:
    """The limit of a late torque is far below 2, and so is an estimate's share of it."""
    model, gains = wrist()
    limit = 2.0 * np.sin(np.pi / (4 * delay + 2))  # 1, 0.618, 0.445
    slow = Gains(gains.bandwidth, 0.3 * gains.damping)
    held = adaptation_gain(model, gains=slow, control_period=PERIOD, delay=delay)
    h = sampling_ratio(model.mechanism, slow.damping, PERIOD, slow.bandwidth).value
    u = parameter_sampling_ratios(model, slow.bandwidth, PERIOD)
    lightest = model.names.index("link6.I_zz")
    assert held[lightest] == pytest.approx(0.6 * (0.2 * (limit - h) / u[lightest]) ** 2)


@given(delay=st.integers(1, 5), held=st.floats(0.02, 0.95))
def test_late_torques_are_stable_up_to_an_adaptation_ratio_and_not_beyond(delay: int, held: float) -> None:
    """One joint, whose sliding variable and torque error are advanced tick by tick."""
    h = held * 2.0 * np.sin(np.pi / (4 * delay + 2))
    limit = stable_adaptation_below(h, delay)

    def largest_pole(a: float) -> float:
        loop = np.eye(delay + 2, k=-1)  # s now, torques on the way, and the torque error
        loop[0], loop[1], loop[-1] = np.eye(delay + 2)[0], 0.0, 0.0
        loop[0, delay] += 1.0
        loop[1, 0], loop[1, -1] = -h, 1.0
        loop[-1] = np.eye(delay + 2)[-1] - a * h * loop[0]
        return float(np.abs(np.linalg.eigvals(loop)).max())

    assert largest_pole(0.98 * limit) < 1.0 < largest_pole(1.02 * limit)


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_a_gain_is_lowered_to_half_of_what_is_stable_at_rest(delay: int) -> None:
    model, gains = wrist()
    slow = Gains(gains.bandwidth, 0.3 * gains.damping)
    at: Any = {"gains": slow, "control_period": PERIOD}
    with pytest.warns(TuningWarning, match=f"with a delay of {delay} allow" if delay else "these gains allow") as told:
        high, higher = (adaptation_gain(model, gain_scale=scale, delay=delay, **at) for scale in (60, 600))
    np.testing.assert_allclose(high, higher)
    share = float(str(told[0].message).split("lowered to ")[1].split(" ")[0])
    low = adaptation_gain(model, gain_scale=6e-4, delay=delay, **at)
    np.testing.assert_allclose(high, share * 1e5 * low, rtol=0.05)
    p = everywhere(model.mechanism).samples
    Y = model.torque_regressor(p, 0.0 * p, 0.0 * p)
    largest = PERIOD * max(np.linalg.eigvals(y * high @ y.T / slow.damping[:, None]).real.max() for y in Y)
    h = sampling_ratio(model.mechanism, slow.damping, PERIOD, slow.bandwidth).value
    assert largest == pytest.approx(0.5 * (stable_adaptation_below(h, delay) if delay else 2.0 - h))


def test_gains_that_a_fall_under_gravity_precedes_are_refused_with_a_delay() -> None:
    """Which an estimate of zero does not hold at an error of 1 rad; half of the arm's needs half of it."""
    model, gains = wrist()
    arm = model.mechanism
    gravity = np.abs([arm.inverse_dynamics(p, 0.0 * p, 0.0 * p) for p in everywhere(arm).samples]).max(axis=0)
    errors = gravity / (0.3 * gains.damping * gains.bandwidth)
    farthest = arm.primary_joints[int(errors.argmax())].name

    def given(share: float) -> dict[str, Any]:
        held = Gains(share * errors.max() * gains.bandwidth, 0.3 * gains.damping)
        return {"gains": held, "control_period": PERIOD, "gain_scale": 1e-9}

    adaptation_gain(model, **given(0.45))
    expected = adaptation_gain(model, delay=1, **given(1.01))
    half = 0.5 * model.fundamental_parameters
    with pytest.raises(
        GainError, match=f"gravity at {farthest} only after an error of 2.2 rad.* with a delay of 1 .*: begin"
    ):
        adaptation_gain(model, delay=1, **given(0.45))
    with pytest.raises(GainError, match=r"error of 1\.1 rad.* initial=model\.fundamental_parameters"):
        adaptation_gain(model, delay=1, initial=half, **given(0.45))
    np.testing.assert_array_less(0.0, adaptation_gain(model, delay=1, initial=half, **given(0.55)))
    described = model.fundamental_parameters
    np.testing.assert_allclose(adaptation_gain(model, delay=1, initial=described, **given(1.01)), expected)
    np.testing.assert_array_less(0.0, adaptation_gain(model, delay=1, initial=described, **given(0.31)))
    with pytest.raises(GainError, match=r"with 30% of it unknown.* error of 1\.1 rad.*: take more damping"):
        adaptation_gain(model, delay=1, initial=described, **given(0.27))
    with pytest.raises(InputError, match="adaptation gain: initial"):
        adaptation_gain(model, delay=1, initial=half[1:], **given(1.01))


def test_gains_that_learn_gravity_before_the_arm_falls_far_are_accepted() -> None:
    """A pendulum that its gains alone hold at 3 rad, from an estimate of zero and beside it."""
    arm = random_chain(3, 1)
    model, still = ReducedModel(arm), Sinusoids(np.zeros(1), np.zeros(1), np.ones(1))
    p = everywhere(arm).samples
    weight = np.abs(arm.inverse_dynamics(p, 0.0 * p, 0.0 * p)).max()
    gains = Gains(np.array([4.0]), np.array([weight / 12.0]))

    def fall(gain: Array) -> float:
        law = SlotineLi(model, gains.bandwidth, gains.damping, Gradient(gain, delay=1), torque_limits=np.inf)
        plant = Plant(arm, PERIOD, torque_limits=[np.inf], effects=[ControlDelay(1)])
        held = [replace(still, center=at) for at in np.linspace(-3.0, 3.0, 5)[:, None]]
        return float(simulate_many(plant, law, held, duration=3.0).largest_error.max())

    within: Any = {"gains": gains, "control_period": PERIOD, "delay": 1}
    with pytest.raises(GainError, match="only after an error of 3 rad"):
        adaptation_gain(model, gain_scale=1e-9, **within)
    gain = adaptation_gain(model, **within)
    assert fall(1e-9 * gain) > 1.0 > fall(gain)


def test_gains_that_a_delay_makes_unstable_are_refused_with_the_most_that_holds() -> None:
    model, gains = wrist()
    with pytest.raises(GainError, match=r"and a delay of 2, so no .* the limit 0\.618; use") as told:
        adaptation_gain(model, gains=gains, control_period=PERIOD, delay=2)
    share = float(str(told.value).split("at most ")[1].split(" ")[0])
    lower = Gains(gains.bandwidth, share * gains.damping)
    assert np.all(adaptation_gain(model, gains=lower, control_period=PERIOD, delay=2) > 0.0)


def test_gains_that_leave_nothing_are_refused() -> None:
    model, gains = wrist()
    with pytest.raises(GainError, match=r"these gains are unstable at a period of 0\.002 s"):
        adaptation_gain(model, gains=gains, control_period=2.0 * PERIOD)


def warned(arm: Mechanism, gain: Array, prior: Array | None) -> list[str]:
    model = ReducedModel(arm)
    damping = 0.5 / sampling_ratio(arm, 1.0, PERIOD).value * np.ones(arm.dof)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", StabilityWarning)
        SlotineLi(model, BANDWIDTH, damping, Gradient(gain), control_period=PERIOD, prior=prior)
    return [str(w.message) for w in caught if w.category is StabilityWarning]


def test_a_warning_comes_where_h_and_the_bound_reach_two_and_only_there() -> None:
    prior, gain = np.abs(MODEL.fundamental_parameters), np.ones(K)
    damping = 0.5 / sampling_ratio(ARM, 1.0, PERIOD).value
    h = sampling_ratio(ARM, damping, PERIOD, BANDWIDTH).value
    # with Gamma a multiple of one shape the bound stays: V_0 falls as the gain rises, so the prior is what is scaled
    bound = estimate_sampling_ratio(MODEL, gain, prior, BANDWIDTH, PERIOD)
    limit = (2.0 - h) / bound
    assert estimate_sampling_ratio(MODEL, 7.0 * gain, prior, BANDWIDTH, PERIOD) == pytest.approx(bound, rel=1e-12)
    assert estimate_sampling_ratio(MODEL, gain, 3.0 * prior, BANDWIDTH, PERIOD) == pytest.approx(3.0 * bound, rel=1e-12)
    assert warned(ARM, gain, 0.99 * limit * prior) == []
    (said,) = warned(ARM, gain, 1.01 * limit * prior)
    assert said.startswith(
        f"{ARM.name}: the sampling ratio of the gains is {h:.3g}, and estimates within the prior may"
    )
    assert "Reduce the adaptation gain" in said
    assert warned(ARM, gain, None) == []


def test_a_mapped_gain_is_symmetric_to_the_last_bit_and_taken() -> None:
    """K_r Gamma K_r' of gains over many decades: a product in another order differs by round-off."""
    for seed, links in ((3, 3), (5, 6), (8, 7)):
        arm = random_chain(seed, links)
        model = ReducedModel(arm)
        size = model.regrouping.shape[1]
        for decades in (1.0, 6.0):
            gain = 10.0 ** np.random.default_rng(seed).uniform(-decades, decades, size)
            mapped = mapped_gain(model, gain)
            np.testing.assert_array_equal(mapped, mapped.T)
            exact = model.regrouping @ np.diag(gain) @ model.regrouping.T
            np.testing.assert_allclose(mapped, exact, rtol=0.0, atol=1e-14 * np.abs(exact).max())
            assert Gradient(mapped).gain.shape == (len(model.columns),) * 2
