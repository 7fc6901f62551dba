"""Composite and concurrent learning: what they remember, how they forget, and that they converge once excited."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import at_night, turn_by_turn
from sampled_loops import (
    RANGES,
    arm,
    dissipated,
    full,
    gains,
    integral,
    kinetic,
    loaded,
    loop,
    own_gain,
    posture,
    reduced,
    swinging,
)

from adaptctl.arrays import Array
from adaptctl.control import (
    AdaptationLaw,
    CompositeLearning,
    ConcurrentLearning,
    CushionedFloor,
    Gradient,
    SafetyFilter,
    Sinusoids,
    SlotineLi,
    StoppedReference,
    adaptation_gain,
)
from adaptctl.control.adaptation.composite_learning import LearningMemory
from adaptctl.control.adaptation.gradient import MIN_POWER
from adaptctl.control.adaptation.symmetric import Equation, directional_update
from adaptctl.errors import InputError
from adaptctl.identifiability import essential_space
from adaptctl.scalars import Column
from adaptctl.simulation import Plant, simulate_many
from adaptctl.simulation.effects import PayloadHeld

ARMS = ["puma560_arm3", "semi_direct_drive"]
SMALL = "puma560_arm3"
K = len(reduced(SMALL).columns)
ONES = np.ones(K)


def on(name: str, law: AdaptationLaw, **options: object) -> SlotineLi:
    options = {"torque_limits": np.inf} | options
    return SlotineLi(reduced(name), 8.0, gains(name).damping, law, **options)  # type: ignore[arg-type]


def memory(state: object) -> LearningMemory:
    return state.law_state  # type: ignore[attr-defined, no-any-return]


def quadratic(error: Array, matrices: Array) -> Array:
    return np.asarray(np.einsum("ti,tij,tj->t", error, matrices, error))


@settings(max_examples=3, deadline=None)
@given(
    name=st.sampled_from(ARMS),
    weight=st.floats(1e-3, 1.0),
    forgetting=st.floats(0.0, 5.0),
    recall=st.floats(0.0, 5.0),
    mass=st.floats(0.0, 2.0),
    alarm=st.sampled_from([1.0, np.inf]),
    seed=st.integers(0, 99),
)
def test_composite_learning(
    name: str, weight: float, forgetting: float, recall: float, mass: float, alarm: float, seed: int
) -> None:
    """V with the gain that memory makes falls, by what memory takes too; z stays Q true, and Q positive."""
    mechanism, true = arm(name), loaded(arm(name), mass)
    adaptation = CompositeLearning(own_gain(name), weight, 20.0, forgetting, recall, reset_power=alarm)
    law, beta = on(name, adaptation), reduced(name).regrouping @ true
    run = loop(law, mechanism, swinging(mechanism, seed), 0.4, parameters=true)
    Q = np.array([adaptation.remembered(memory(state)) for state in run.states])
    scale = np.sqrt(adaptation.gain)
    assert np.linalg.eigvalsh(Q * np.outer(scale, scale))[:, 0].min() > -1e-9
    error = run.estimate - beta
    V = kinetic(mechanism.with_parameters(true), run) + 0.5 * quadratic(error, Q + np.diag(1.0 / adaptation.gain))
    lost = dissipated(run, law.damping) + integral(run, recall * quadratic(error, Q))
    assert np.diff(V).max() < 1e-5 * V[0]
    assert V[-1] - V[0] < -0.9 * lost[-1]
    known = np.array([memory(state).known for state in run.states]) / scale
    np.testing.assert_allclose(known, Q @ beta, atol=2e-2 * np.abs(known).max())


@settings(max_examples=3, deadline=None)
@given(
    name=st.sampled_from(ARMS),
    weight=st.floats(1e-3, 1.0),
    threshold=st.floats(1e-3, 10.0),
    mass=st.floats(0.0, 2.0),
    seed=st.integers(0, 99),
)
def test_concurrent_learning(name: str, weight: float, threshold: float, mass: float, seed: int) -> None:
    """V falls, whatever is on the stack."""
    mechanism, true = arm(name), loaded(arm(name), mass)
    law = on(name, ConcurrentLearning(own_gain(name), weight, 20.0, 4, threshold))
    run = loop(law, mechanism, swinging(mechanism, seed), 0.4, parameters=true)
    apart = Gradient(own_gain(name)).lyapunov_distance(reduced(name), run.estimate, reduced(name).regrouping @ true)
    V = kinetic(mechanism.with_parameters(true), run) + apart
    assert np.diff(V).max() < 1e-5 * V[0]
    assert V[-1] - V[0] < -0.9 * dissipated(run, law.damping)[-1]


@lru_cache
def after_interval_excitation(kind: type[AdaptationLaw], seconds: float = 8.0) -> tuple[float, float]:
    """Parameter errors over the first one, at the end of 3 s of excitation, and after rest."""
    mechanism, gain, beta = arm(SMALL), own_gain(SMALL), reduced(SMALL).fundamental_parameters
    law = {
        Gradient: lambda: Gradient(gain),
        CushionedFloor: lambda: CushionedFloor(gain, 30.0, 20.0, 1.0),
        CompositeLearning: lambda: CompositeLearning(gain, 30.0, 20.0, 1.0, 4.0),
        ConcurrentLearning: lambda: ConcurrentLearning(gain, 30.0, 20.0, 16, 900.0),
    }[kind]()
    shape = 0.3 * np.array([[1.0, 0.7, 0.9], [0.5, 0.6, 0.5]])
    moving = Sinusoids(posture(mechanism), shape, [[0.4, 0.55, 0.7], [1.3, 1.1, 0.9]], start_time=0.3)
    run = loop(on(SMALL, law, control_period=2e-3), mechanism, StoppedReference(moving, 3.0, 0.5), seconds, 2e-3)
    errors = np.linalg.norm((run.estimate - beta) / np.sqrt(gain), axis=1)
    return float(errors[1500] / errors[0]), float(errors[-1] / errors[0])


@pytest.mark.parametrize("kind", [CompositeLearning, ConcurrentLearning])
def test_parameters_converge_after_interval_excitation(kind: type[AdaptationLaw]) -> None:
    """At rest the gradient stands still, and so does what forgets; what remembers goes on."""
    excited, rested = after_interval_excitation(kind)
    assert rested < 0.5 * excited
    _, gradient = after_interval_excitation(Gradient)
    assert rested < 0.1 * gradient


def test_composite_learning_ends_nearer_than_what_forgets() -> None:
    assert after_interval_excitation(CompositeLearning)[1] < 0.3 * after_interval_excitation(CushionedFloor)[1]


def learned_again(law: AdaptationLaw) -> Array:
    """Tracking errors (2,): over the second before 2 kg are picked up, and over the last of 6 s with them."""
    mechanism = arm(SMALL)
    plant = Plant(mechanism, 2e-3, torque_limits=np.inf, effects=(PayloadHeld(2.0, 6.0),))
    first = 0.7 * reduced(SMALL).fundamental_parameters
    controller = on(SMALL, law, initial=first, control_period=2e-3)
    run = simulate_many(plant, controller, swinging(mechanism), duration=12.0)
    error = run.error[:, 0]
    return np.array([np.sqrt(np.mean(error[part] ** 2)) for part in (slice(2500, 3000), slice(5500, None))])


def test_a_changed_payload_is_learned_again() -> None:
    before, after = learned_again(CompositeLearning(own_gain(SMALL), 0.1, 10.0, 2.0, reset_power=0.3))
    kept, _ = learned_again(Gradient(1e-6 * own_gain(SMALL)))
    assert before < 0.1 * kept
    assert after < 2.0 * before


def test_directions_that_are_not_seen_are_kept_and_those_seen_forgotten() -> None:
    """What motion told, in nats, is kept at rest, where the floor forgets all but gravity."""
    mechanism, gain = arm(SMALL), own_gain(SMALL)
    left: dict[type, float] = {}
    for law in (CompositeLearning(gain, 1.0, 20.0, 3.0), CushionedFloor(gain, 1.0, 20.0, 3.0)):
        run = loop(
            on(SMALL, law, control_period=2e-3), mechanism, StoppedReference(swinging(mechanism), 2.0, 0.5), 5.0, 2e-3
        )
        scale = np.sqrt(np.outer(gain, gain))
        told = [-np.linalg.slogdet(law.covariance(run.states[k].law_state) / scale)[1] for k in (1250, -1)]
        left[type(law)] = float(told[1] / told[0])
    assert left[CompositeLearning] > 0.9
    assert left[CushionedFloor] < 0.85


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), share=st.floats(0.0, 1.0))
def test_a_direction_is_forgotten_for_itself(seed: int, share: float) -> None:
    """Q - share Q w w'Q/(w'Q w): what is known across w, in Q's sense, stays; along w a share is gone."""
    rng = np.random.default_rng(seed)
    root, w, true = rng.normal(size=(6, 6)), rng.normal(size=6), rng.normal(size=6)
    Q = root @ root.T
    entries, z = Column(Q[np.triu_indices(6)].tolist()), Column((Q @ true).tolist())
    after, known = directional_update(entries, z, [Equation(Column(w.tolist()), share, MIN_POWER)])
    found = np.zeros((6, 6))
    found[np.triu_indices(6)] = after.of
    found = found + np.triu(found, 1).T
    np.testing.assert_allclose(found @ w, (1.0 - share) * Q @ w, atol=1e-9 * np.abs(Q @ w).max())
    across = rng.normal(size=6)
    across -= w * (w @ Q @ across) / (w @ Q @ w)
    np.testing.assert_allclose(found @ across, Q @ across, atol=1e-9 * np.abs(Q).max() * np.abs(across).max() * 10)
    np.testing.assert_allclose(known.of, found @ true, atol=1e-9 * np.abs(Q).max() * 10)
    assert np.linalg.eigvalsh(found)[0] > -1e-9 * np.abs(Q).max()


@pytest.mark.parametrize(("kind", "name"), turn_by_turn([CompositeLearning, ConcurrentLearning], ARMS))
def test_nothing_is_remembered_of_periods_that_guards_hold_back(kind: type[AdaptationLaw], name: str) -> None:
    """As it is without guards where these never act; and neither memory nor estimate moves where they always do."""
    mechanism = arm(name)
    options = {"stack_size": 2, "novelty_threshold": 1e-3} if kind is ConcurrentLearning else {}
    bare = on(name, kind(own_gain(name), 0.1, 20.0, **options))  # type: ignore[call-arg]
    free, held = (SafetyFilter(bare, torque_limits=limit) for limit in (1e6, 1e-3))
    alone, ours, weak = (loop(law, mechanism, swinging(mechanism), 0.05) for law in (bare, free, held))
    np.testing.assert_allclose(ours.torque, alone.torque, atol=1e-9 * np.abs(alone.torque).max())
    assert max(float(state.logged_state[0]) for state in ours.states) > 0.0
    assert max(float(state.logged_state[0]) for state in weak.states) == 0.0
    np.testing.assert_array_equal(weak.estimate, np.zeros_like(weak.estimate))


@pytest.mark.parametrize("kind", [at_night(CompositeLearning), ConcurrentLearning])
def test_what_no_motion_tells_is_left_alone_among_all_parameters(kind: type[AdaptationLaw]) -> None:
    """Gamma^-1 times what was learned is in the essential space, whatever is remembered; and the arm is tracked."""
    mechanism, model = arm(SMALL), full(SMALL)
    gain = adaptation_gain(model, RANGES, 0.3)
    options = {"stack_size": 3, "novelty_threshold": 1e-3} if kind is ConcurrentLearning else {}
    law = SlotineLi(model, 8.0, gains(SMALL).damping, kind(gain, 0.1, 20.0, **options), control_period=2e-3)  # type: ignore[call-arg]
    run = loop(law, mechanism, swinging(mechanism), 2.0, 2e-3)
    space = essential_space(mechanism)
    moved = run.estimate[-1] / np.sqrt(gain)
    hidden = space.null_basis / np.sqrt(gain)[:, None]
    hidden /= np.linalg.norm(hidden, axis=0)
    assert np.abs(hidden.T @ moved).max() < 1e-8 * np.linalg.norm(moved)
    assert max(float(state.logged_state[0]) for state in run.states) > 0.0
    assert np.linalg.norm(run.s[-1]) < 0.2 * np.linalg.norm(run.s[0])


@pytest.mark.parametrize(
    "law",
    [
        lambda gain: CompositeLearning(gain, 1.0, excitation_threshold=1e12),
        lambda gain: ConcurrentLearning(gain, 1.0, novelty_threshold=1e12),
    ],
    ids=["composite", "concurrent"],
)
def test_a_threshold_that_nothing_passes_leaves_the_gradient(law: Callable[[Array], AdaptationLaw]) -> None:
    """And the memory says that nothing was learned."""
    mechanism, gain = arm(SMALL), own_gain(SMALL)
    ours, theirs = (
        loop(on(SMALL, one), mechanism, swinging(mechanism), 0.3) for one in (law(gain), Gradient(gain, 0.5, 0.0))
    )
    np.testing.assert_allclose(ours.torque, theirs.torque, atol=1e-9 * np.abs(theirs.torque).max())
    assert max(float(state.law_state.learned[0]) for state in ours.states) == 0.0


def test_the_stack_keeps_the_newest_samples_that_differ() -> None:
    """As many as there is room for; nothing new is kept at rest."""
    mechanism, gain = arm(SMALL), own_gain(SMALL)
    law = on(SMALL, ConcurrentLearning(gain, 1.0, 20.0, 3, 1.0), control_period=2e-3)
    run = loop(law, mechanism, StoppedReference(swinging(mechanism), 1.5, 0.5), 3.0, 2e-3)
    kept = np.array([state.law_state.learned[0] for state in run.states])
    torques = np.array([state.law_state.torques for state in run.states])
    assert kept[:1000].sum() > 6
    assert kept[-250:].sum() == 0.0
    moved = np.abs(np.diff(torques, axis=0)).max(axis=1) > 0.0
    np.testing.assert_array_equal(moved, kept[1:] > 0.0)
    for k in np.flatnonzero(kept)[1:]:
        np.testing.assert_array_equal(torques[k][3:], torques[k - 1][:6])


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: ConcurrentLearning(ONES, stack_size=0), "expected 1 to 64, got 0; use Gradient without"),
        (lambda: ConcurrentLearning(ONES, stack_size=-2), "expected 1 to 64, got -2"),
        (lambda: ConcurrentLearning(ONES, stack_size=65), "expected 1 to 64, got 65"),
        (lambda: ConcurrentLearning(ONES, stack_size=2.5), r"stack_size: expected a whole number, got 2\.5"),  # type: ignore[arg-type]
        (
            lambda: ConcurrentLearning(ONES, novelty_threshold=0.0),
            "threshold: expected a positive number of 1/s, since at 0 every period would replace a sample, got 0",
        ),
        (lambda: ConcurrentLearning(ONES, novelty_threshold=np.nan), "threshold: expected a positive number of 1/s"),
        (lambda: ConcurrentLearning(ONES, -1.0), "concurrent learning: prediction_weight"),  # type: ignore[arg-type]
        (lambda: on(SMALL, ConcurrentLearning(np.ones(30))), "30 parameters, but the basis has 15"),
        (lambda: on(SMALL, ConcurrentLearning(ONES, cutoff=2000.0)), "use at most 1000 rad/s"),
        (
            lambda: CompositeLearning(ONES, excitation_threshold=-1.0),
            "threshold: expected a finite number of at least 0",
        ),
        (lambda: CompositeLearning(ONES, recall=-1.0), "recall: expected a finite number of at least 0, got -1"),
        (
            lambda: CompositeLearning(ONES, reset_power=0.0),
            "reset_power: expected a positive number of W, or infinity, got 0",
        ),
        (lambda: CompositeLearning(ONES, forgetting=-1.0), "composite learning: forgetting: expected a finite number"),
        (lambda: CompositeLearning(-ONES), "composite learning: gain: expected positive"),
        (lambda: on(SMALL, CompositeLearning(ONES, recall=900.0)), "recall: 900 1/s is too fast .* use at most 500"),
        (lambda: on(SMALL, CompositeLearning(np.ones(4))), "composite learning: gain: expected 15 numbers"),
        (lambda: StoppedReference(swinging(arm(SMALL)), -1.0), "stopped reference: stop: expected a finite number"),
        (lambda: StoppedReference(swinging(arm(SMALL)), 1.0, 0.0), "stopped reference: duration: expected a positive"),
    ],
)
def test_what_cannot_be_is_refused(make: Callable[[], object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        make()


def test_a_halted_reference_comes_to_rest_with_its_own_derivatives() -> None:
    reference = StoppedReference(swinging(arm(SMALL)), 1.0, 0.5)
    t = np.linspace(0.5, 2.5, 20001)
    point, step = reference(t), t[1] - t[0]
    np.testing.assert_allclose(np.gradient(point.p, step, axis=0)[1:-1], point.v[1:-1], atol=1e-5)
    np.testing.assert_allclose(np.gradient(point.v, step, axis=0)[1:-1], point.a[1:-1], atol=5e-3)
    before = t < 1.0
    np.testing.assert_array_equal(point.p[before], swinging(arm(SMALL))(t[before]).p)
    assert np.abs(point.v[t > 1.5]).max() == 0.0
    assert np.abs(point.a[t > 1.5]).max() == 0.0


@pytest.mark.parametrize("samples", [1, 64])
def test_the_shortest_and_the_longest_stack_are_accepted(samples: int) -> None:
    assert ConcurrentLearning(ONES, stack_size=samples).stack_size == samples
