"""Estimates that rigid bodies have, on fundamental parameters: the law on a lift, its theorem, and what it refuses."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import at_night
from sampled_loops import Loop, arm, dissipated, full, gains, kinetic, loaded, loop, reduced, swinging

from adaptctl.arrays import Array
from adaptctl.control import AdaptationLaw, ConsistentAdaptation, Gradient, Natural, SlotineLi, adaptation_gain
from adaptctl.control.adaptation.natural import pseudos
from adaptctl.errors import InputError
from adaptctl.identifiability import Constraints, ReducedModel, constrained, nearest_consistent

BODIES = ["puma560_geared", "semi_direct_drive"]
"""Arms whose links some rigid bodies are."""


def lifted(name: str, first: Array, rate: float | Array = 0.05, **options: object) -> SlotineLi:
    law = ConsistentAdaptation(rate, first, **options)  # type: ignore[arg-type]
    return SlotineLi(
        reduced(name), 8.0, gains(name).damping, law, reduced(name).regrouping @ first, torque_limits=np.inf
    )


def lifts(run: Loop) -> Array:
    return np.array([state.law_state.lift for state in run.states])


def smallest_eigenvalue(name: str, parameters: Array) -> float:
    """Of any link's pseudo-inertia, over its trace."""
    bodies = len(arm(name).description.bodies)
    matrices = pseudos(parameters[..., : 10 * bodies].reshape(-1, 10))
    return float((np.linalg.eigvalsh(matrices)[:, 0] / np.trace(matrices, axis1=1, axis2=2)).min())


@pytest.mark.parametrize("name", BODIES)
def test_the_lift_of_fundamental_parameters_is_natural_adaptation(name: str) -> None:
    """Tick for tick, from fewer columns: of a tree and of loops; at about as many operations."""
    first = 1.4 * arm(name).inertial_parameters
    natural = SlotineLi(full(name), 8.0, gains(name).damping, Natural(0.05), first, torque_limits=np.inf)
    controller = lifted(name, first)
    ours, theirs = (loop(law, arm(name), swinging(arm(name)), 0.3) for law in (controller, natural))
    np.testing.assert_allclose(ours.torque, theirs.torque, atol=1e-9 * np.abs(theirs.torque).max())
    np.testing.assert_allclose(lifts(ours), theirs.estimate, atol=1e-9)
    np.testing.assert_allclose(ours.estimate, theirs.estimate @ reduced(name).regrouping.T, atol=1e-9)
    assert np.abs(ours.estimate[-1] - ours.estimate[0]).max() > 1e-2
    assert controller.kernel is not None
    assert natural.kernel is not None
    assert controller.kernel.operations.flops == pytest.approx(natural.kernel.operations.flops, rel=0.02)


@settings(max_examples=3, deadline=None)
@given(
    name=st.sampled_from(BODIES),
    rate=st.floats(0.002, 0.05),
    weight=st.one_of(st.none(), st.floats(1e-3, 1.0)),
    mass=st.floats(0.0, 2.0),
    wrong=st.floats(0.5, 2.0),
    seed=st.integers(0, 100),
)
def test_v_falls(name: str, rate: float, weight: float | None, mass: float, wrong: float, seed: int) -> None:
    """V with the lift's divergence; without prediction by exactly s'Ks."""
    mechanism, true = arm(name), loaded(arm(name), mass)
    count = len(true) - 9 * len(mechanism.description.bodies)
    rates = rate * np.random.default_rng(seed).uniform(0.3, 1.0, count)
    controller = lifted(name, wrong * mechanism.inertial_parameters, rates, prediction_weight=weight)
    run = loop(controller, mechanism, swinging(mechanism, seed), 0.4, parameters=true)
    apart = Natural(rates).lyapunov_distance(full(name), lifts(run), true)
    V = kinetic(mechanism.with_parameters(true), run) + apart
    assert np.diff(V).max() < 1e-5 * V[0]
    lost = dissipated(run, controller.damping)[-1]
    if weight is None:
        assert abs(V[-1] + lost - V[0]) < 5e-2 * V[0]
    else:
        assert V[0] - V[-1] > 0.9 * lost


def test_prediction_is_solved_implicitly_however_heavy() -> None:
    """With weights that would overshoot a thousandfold V falls all the same, and the error more than without."""
    name = "semi_direct_drive"
    mechanism, true = arm(name), arm(name).inertial_parameters
    left = {}
    for weight in (None, 1.0, 1e6):
        run = loop(lifted(name, 1.5 * true, 0.05, prediction_weight=weight), mechanism, swinging(mechanism), 1.0)
        V = kinetic(mechanism, run) + Natural(0.05).lyapunov_distance(full(name), lifts(run), true)
        assert np.diff(V).max() < 1e-4 * V[0]
        left[weight] = float(V[-1] / V[0])
    assert left[1.0] < 0.8 * left[None]
    assert left[1e6] < left[1.0]


@pytest.mark.parametrize("weight", [None, at_night(1.0)])
def test_whatever_disturbs_the_estimate_is_some_rigid_bodies(weight: float | None) -> None:
    """40 N m of disturbance and noise: the gradient's leaves the set within the second."""
    name = "puma560_geared"
    mechanism, model = arm(name), reduced(name)
    size = np.array([40.0, 40.0, 40.0, 4.0, 4.0, 4.0])
    first = mechanism.inertial_parameters

    def shaken(controller: SlotineLi) -> Loop:
        reference = swinging(mechanism)
        return loop(
            controller,
            mechanism,
            reference,
            1.0,
            noise=0.01,
            disturbance=lambda t: size * np.sin(20.0 * t + np.arange(6)),
        )

    run = shaken(lifted(name, first, 0.05, prediction_weight=weight))
    assert smallest_eigenvalue(name, lifts(run)[::10]) > 0.0
    assert lifts(run)[:, 60:].min() > 0.0
    assert np.abs(run.estimate[-1] - run.estimate[0]).max() > 0.1
    np.testing.assert_allclose(run.estimate, lifts(run) @ model.regrouping.T, atol=1e-9)
    gradient = SlotineLi(
        model, 8.0, gains(name).damping, Gradient(adaptation_gain(model, gain_scale=1.0)), model.regrouping @ first
    )
    if weight is None:
        assert nearest_consistent(model, run.estimate[-1]).is_feasible
        assert not nearest_consistent(model, shaken(gradient).estimate[-1]).is_feasible


NAME = "semi_direct_drive"
TRUE = arm(NAME).inertial_parameters


def outside() -> Array:
    """No body: a link with less mass than its first moments need."""
    parameters = TRUE.copy()
    parameters[10] = 1e-6
    return parameters


def on(law: AdaptationLaw, initial: Array | None) -> SlotineLi:
    return SlotineLi(reduced(NAME), 8.0, gains(NAME).damping, law, initial)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (
            lambda: lifted(NAME, outside()),
            "consistent adaptation: the lift of link2 is not physically consistent: its pseudo-inertia",
        ),
        (
            lambda: on(ConsistentAdaptation(0.1, TRUE), None),
            "the initial estimate does not match the lift: .* initial=model.regrouping",
        ),
        (
            lambda: on(ConsistentAdaptation(0.1, TRUE), 1.1 * reduced(NAME).fundamental_parameters),
            "does not match the lift",
        ),
        (
            lambda: on(ConsistentAdaptation(0.1, TRUE[:30]), reduced(NAME).fundamental_parameters),
            "consistent adaptation: lift: expected all 50 parameters, got 30",
        ),
        (lambda: ConsistentAdaptation(0.0, TRUE), "gain: expected positive numbers"),
        (lambda: lifted(NAME, TRUE, np.ones(3)), "natural adaptation: gain: expected a number, or"),
        (lambda: ConsistentAdaptation(0.1, TRUE, -1.0), "consistent adaptation: prediction_weight"),
        (lambda: lifted(NAME, TRUE, prediction_weight=np.ones(99)), "consistent adaptation: prediction_weight"),
        (lambda: ConsistentAdaptation(0.1, np.full(50, np.nan)), "consistent adaptation: lift"),
        (lambda: lifted(NAME, TRUE, prediction_weight=1.0, cutoff=2000.0), "use at most 1000 rad/s"),
    ],
)
def test_what_cannot_be_is_refused(make: object, says: str) -> None:
    with pytest.raises(InputError, match=says):
        make()  # type: ignore[operator]


@pytest.mark.parametrize(
    ("fixed", "weight", "says"),
    [
        ("link2.mc_z", None, "^consistent adaptation: adapts .* remove link2.mc_z: remove"),
        ("joint1.rotor_inertia", 0.1, r"^consistent adaptation: .* fix .*: joint1.rotor_inertia \(0\.5\)\. Remove"),
        ("joint1.rotor_inertia", None, ""),
    ],
)
def test_a_lift_needs_whole_links_and_with_prediction_no_known_values(
    fixed: str, weight: float | None, says: str
) -> None:
    model = ReducedModel.full(constrained(arm("puma560_geared"), Constraints({fixed: 0.5})))
    lift = model.mechanism.inertial_parameters
    with pytest.raises(InputError, match=says) if says else nullcontext():
        ConsistentAdaptation(0.1, lift, weight).validate(model, model.regrouping @ lift, 1e-3)
