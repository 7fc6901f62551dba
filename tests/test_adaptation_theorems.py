"""Adaptation laws: V falls by what is dissipated, over gains, payloads and references, on a tree and on a loop."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled_loops import (
    RANGES,
    Loop,
    arm,
    dissipated,
    distance,
    full,
    gains,
    integral,
    kinetic,
    loaded,
    loop,
    own_gain,
    reduced,
    swinging,
)

from adaptctl.arrays import Array, stacked_rows
from adaptctl.control import (
    AdaptationLaw,
    AdaptiveController,
    BoundedGainForgetting,
    Composite,
    CushionedFloor,
    DeadZone,
    EModification,
    Gradient,
    Natural,
    Projection,
    SigmaModification,
    SlotineLi,
    Subspace,
    adaptation_gain,
    mapped_gain,
)
from adaptctl.control.adaptation.composite import momentum_columns
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.energy import momentum_terms
from adaptctl.scalars import column

ARMS = ["puma560_measured", "semi_direct_drive"]
SMALL = "puma560_arm3"
BODIES = ["puma560_geared", "semi_direct_drive"]
"""Arms whose links some rigid bodies are."""


def rise(V: Array) -> float:
    """The largest rise of V from one period to the next, over V(0)."""
    return float(np.diff(V).max() / V[0])


def imbalance(V: Array, lost: Array) -> float:
    """|V + what was dissipated - V(0)| over V(0), at the end."""
    return float(abs(V[-1] + lost[-1] - V[0]) / V[0])


def slotine_li(name: str, adaptation: AdaptationLaw, **options: object) -> SlotineLi:
    options = {"torque_limits": np.inf} | options
    return SlotineLi(reduced(name), 8.0, gains(name).damping, adaptation, **options)  # type: ignore[arg-type]


def prediction_errors(run: Loop, controller: AdaptiveController, true: Array) -> Array:
    """W error (T, r), from the filters' memory: F[lambda H + N] is what it is after the next sample, undone."""
    law, model = controller.adaptation_law, controller.model
    assert isinstance(law, Composite | BoundedGainForgetting | CushionedFloor)
    mechanism, rate = model.mechanism, law.cutoff * run.period
    keep = np.exp(-rate)
    old = (1.0 - keep) / rate - keep
    found = momentum_terms(mechanism.equations, column(mechanism.configuration(run.p)), column(run.v), model.columns)
    momentum, forces = (stacked_rows(rows, run.p.shape[:-1]) for rows in found)
    memories = [s.law_state if isinstance(law, Composite) else s.law_state.filtered for s in run.states]
    joints, places = np.array([(i, j) for i, row in enumerate(momentum_columns(model)) for j in row]).T
    ahead = np.zeros(momentum.shape)
    ahead[:, joints, places] = [memory.regressor for memory in memories]
    filtered = (ahead - old * (law.cutoff * momentum + forces)) / keep
    rows = law.cutoff * momentum - filtered
    return np.einsum("tij,tj->ti", rows, run.estimate - true)


@settings(max_examples=4, deadline=None)
@given(
    name=st.sampled_from(ARMS),
    bandwidth=st.floats(4.0, 12.0),
    ratio=st.floats(2.0, 8.0),
    rate=st.floats(0.02, 0.4),
    mass=st.floats(0.0, 2.0),
    theta=st.sampled_from([0.5, 1.0]),
    seed=st.integers(0, 100),
)
def test_gradient(name: str, bandwidth: float, ratio: float, rate: float, mass: float, theta: float, seed: int) -> None:
    """Without torque limits: where a torque is clipped, a law stops learning and V may rise."""
    mechanism, model = arm(name), reduced(name)
    gradient = Gradient(own_gain(name, rate), theta)
    law = SlotineLi(model, bandwidth, ratio / 4.0 * gains(name).damping, gradient, torque_limits=np.inf)
    true = loaded(mechanism, mass)
    run = loop(law, mechanism, swinging(mechanism, seed), 0.5, parameters=true)
    V = kinetic(mechanism.with_parameters(true), run) + distance(law, run, true)
    assert rise(V) < 1e-6
    assert imbalance(V, dissipated(run, law.damping)) < (5e-3 if theta == 0.5 else 5e-2)


@settings(max_examples=4, deadline=None)
@given(name=st.sampled_from(ARMS), count=st.integers(1, 15), seed=st.integers(0, 100))
def test_subspace(name: str, count: int, seed: int) -> None:
    """Where the truth differs from the first estimate along the directions alone, all is as with `Gradient`."""
    mechanism, true = arm(name), reduced(name).fundamental_parameters
    rng = np.random.default_rng(seed)
    directions = np.sqrt(own_gain(name) / len(true))[:, None] * rng.normal(size=(len(true), count))
    law = slotine_li(
        name, Subspace(np.ones(count), directions), initial=true - 3.0 * directions @ rng.normal(size=count)
    )
    run = loop(law, mechanism, swinging(mechanism, seed), 0.4)
    V = kinetic(mechanism, run) + distance(law, run, mechanism.inertial_parameters)
    assert rise(V) < 1e-5
    assert imbalance(V, dissipated(run, law.damping)) < 5e-2


@settings(max_examples=3, deadline=None)
@given(
    name=st.sampled_from(ARMS),
    weight=st.floats(1e-3, 10.0),
    cutoff=st.floats(5.0, 50.0),
    mass=st.floats(0.0, 2.0),
    seed=st.integers(0, 100),
)
def test_composite(name: str, weight: float, cutoff: float, mass: float, seed: int) -> None:
    """V falls as -s'Ks - eps'R eps; the implicit rule takes a little more than that."""
    mechanism = arm(name)
    law = slotine_li(name, Composite(own_gain(name), weight, cutoff))
    true = loaded(mechanism, mass)
    run = loop(law, mechanism, swinging(mechanism, seed), 0.5, parameters=true)
    V = kinetic(mechanism.with_parameters(true), run) + distance(law, run, true)
    missed = prediction_errors(run, law, law.model.regrouping @ true)
    lost = dissipated(run, law.damping) + integral(run, weight * (missed**2).sum(axis=1))
    assert rise(V) < 1e-5
    assert V[-1] - V[0] < -0.9 * lost[-1]


LEAST_SQUARES = {
    "name": st.sampled_from([SMALL, "semi_direct_drive"]),  # six joints' covariance takes long to compile
    "weight": st.floats(1e-3, 1.0),
    "forgetting": st.floats(0.0, 5.0),
    "mass": st.floats(0.0, 2.0),
    "seed": st.integers(0, 99),
}


@settings(max_examples=3, deadline=None)
@given(**LEAST_SQUARES, bound=st.floats(1.0, 10.0))
def test_bounded_gain_forgetting(
    name: str, weight: float, forgetting: float, mass: float, seed: int, bound: float
) -> None:
    """V with the covariance itself falls, and the covariance stays positive and within its bound."""
    law = slotine_li(name, BoundedGainForgetting(own_gain(name), weight, forgetting=forgetting, bound=bound))
    relative = least_squares_hold(law, loaded(arm(name), mass), seed)
    assert np.trace(relative, axis1=1, axis2=2).max() <= bound * relative.shape[1] * (1.0 + 1e-12)


@settings(max_examples=2, deadline=None)
@given(**LEAST_SQUARES)
def test_cushioned_floor(name: str, weight: float, forgetting: float, mass: float, seed: int) -> None:
    """The same, and no direction's gain rises above the first."""
    law = slotine_li(name, CushionedFloor(own_gain(name), weight, forgetting=forgetting))
    relative = least_squares_hold(law, loaded(arm(name), mass), seed)
    assert np.linalg.eigvalsh(relative)[:, -1].max() <= 1.0 + 1e-12


def least_squares_hold(law: SlotineLi, true: Array, seed: int) -> Array:
    """What the theorem of composite adaptation by least squares says; the covariances (T, k, k) over the gain."""
    mechanism, adaptation, beta = law.model.mechanism, law.adaptation_law, law.model.regrouping @ true
    assert isinstance(adaptation, BoundedGainForgetting | CushionedFloor)
    run = loop(law, mechanism, swinging(mechanism, seed), 0.4, parameters=true)
    covariances = np.array([adaptation.covariance(state.law_state) for state in run.states])
    relative = covariances / np.sqrt(adaptation.gain) / np.sqrt(adaptation.gain)[:, None]
    assert np.linalg.eigvalsh(relative)[:, 0].min() > 0.0
    error = run.estimate - beta
    V = kinetic(mechanism.with_parameters(true), run) + 0.5 * np.einsum(
        "ti,ti->t", error, np.linalg.solve(covariances, error[..., None])[..., 0]
    )
    missed = prediction_errors(run, law, beta)
    weights = np.asarray(adaptation.prediction_weight)
    lost = dissipated(run, law.damping) + integral(run, 0.5 * (weights * missed**2).sum(axis=1))
    assert rise(V) < 1e-5
    assert V[-1] - V[0] < -0.9 * lost[-1]
    return np.asarray(relative)


@settings(max_examples=5, deadline=None)
@given(
    name=st.sampled_from(BODIES),
    rate=st.floats(0.002, 0.05),
    mass=st.floats(0.0, 2.0),
    wrong=st.floats(0.5, 2.0),
    seed=st.integers(0, 100),
)
def test_natural(name: str, rate: float, mass: float, wrong: float, seed: int) -> None:
    mechanism, model = arm(name), full(name)
    count = len(model.columns) - 9 * len(mechanism.description.bodies)
    rates = rate * np.random.default_rng(seed).uniform(0.3, 1.0, count)
    law = SlotineLi(
        model,
        8.0,
        gains(name).damping,
        Natural(rates),
        initial=wrong * mechanism.inertial_parameters,
        torque_limits=np.inf,
    )
    true = loaded(mechanism, mass)
    run = loop(law, mechanism, swinging(mechanism, seed), 0.4, parameters=true)
    V = kinetic(mechanism.with_parameters(true), run) + distance(law, run, true)
    assert rise(V) < 1e-5
    assert imbalance(V, dissipated(run, law.damping)) < 5e-2  # V(0) is mostly kinetic where the first estimate is right


def laws_on(name: str) -> dict[str, tuple[AdaptiveController, float]]:
    """Laws whose V falls by exactly -s'Ks, at two periods each."""
    found = {}
    for period in (1e-3, 2.5e-4):
        damping, initial = gains(name).damping, 1.5 * arm(name).inertial_parameters
        free = {"control_period": period, "torque_limits": np.inf}
        found[f"gradient {period}"] = SlotineLi(reduced(name), 8.0, damping, own_gain(name), **free), period
        found[f"natural {period}"] = SlotineLi(full(name), 8.0, damping, Natural(0.02), initial, **free), period
    return found  # type: ignore[return-value]


@pytest.mark.parametrize("law", ["gradient", "natural"])
def test_a_held_torque_costs_one_order(law: str) -> None:
    name, mechanism = "semi_direct_drive", arm("semi_direct_drive")
    misses = []
    for period in (1e-3, 2.5e-4):
        controller, _ = laws_on(name)[f"{law} {period}"]
        run = loop(controller, mechanism, swinging(mechanism), 0.4, period)
        V = kinetic(mechanism, run) + distance(controller, run, mechanism.inertial_parameters)
        misses.append(imbalance(V, dissipated(run, gains(name).damping)))
    assert misses[0] / misses[1] == pytest.approx(4.0, rel=0.3)


@pytest.mark.parametrize("law", [Gradient, Composite])
def test_reduced_and_full_adaptation_are_one_controller(law: type[Gradient] | type[Composite]) -> None:
    name, mechanism = "semi_direct_drive", arm("semi_direct_drive")
    everything = adaptation_gain(full(name), RANGES, 0.1)
    pairs = ((full(name), everything), (reduced(name), mapped_gain(reduced(name), everything)))
    torques = [
        loop(SlotineLi(model, 8.0, gains(name).damping, law(gain)), mechanism, swinging(mechanism), 0.3).torque
        for model, gain in pairs
    ]
    assert np.abs(torques[0] - torques[1]).max() < 1e-8 * np.abs(torques[0]).max()


@pytest.mark.parametrize(("name", "excess"), [("puma560_arm3", 5.0), ("semi_direct_drive", 3.0)])
def test_the_trapezium_holds_v_where_euler_lets_it_rise(name: str, excess: float) -> None:
    """Euler needs T_c lambda_max(K^-1 Y Gamma Y') < 1; the trapezium still holds V at some times that."""
    mechanism, model, damping = arm(name), reduced(name), gains(name).damping
    reference = swinging(mechanism)
    points = reference(np.linspace(0.0, 1.0, 200))
    gain = own_gain(name)
    scaled = model.slotine_li_regressor(points.p, points.v, points.v, points.a) * np.sqrt(gain)
    largest = 1e-3 * np.linalg.norm(scaled / np.sqrt(damping)[:, None], ord=2, axis=(1, 2)).max() ** 2
    highest = {}
    for euler, size in ((False, excess), (True, excess), (True, 0.5)):
        law = slotine_li(name, Gradient(size / largest * gain, 0.0 if euler else 0.5, 0.0))
        run = loop(law, mechanism, reference, 2.0, off=0.01)
        V = kinetic(mechanism, run) + distance(law, run, mechanism.inertial_parameters)
        highest[euler, size] = V.max() / V[0]
    assert highest[False, excess] < 1.001
    assert highest[True, 0.5] < 1.001
    assert highest[True, excess] > 1.5


def shaken(mechanism: Mechanism, size: float | Array) -> object:
    """A disturbance torque of a given size at every joint, N m."""
    frequencies = np.linspace(1.0, 3.0, mechanism.dof)
    return lambda t: size * np.sin(2.0 * np.pi * frequencies * t)


@settings(max_examples=5, deadline=None)
@given(name=st.sampled_from(ARMS), rate=st.floats(0.05, 2.0), size=st.floats(0.0, 0.2), seed=st.integers(0, 100))
def test_sigma_modification_keeps_its_bound(name: str, rate: float, size: float, seed: int) -> None:
    """V' <= -c V + b with c = min(sigma, min lambda(M^-1 K)) and b = sigma V_prior + d'K^-1d/2."""
    mechanism, model, K = arm(name), reduced(name), gains(name).damping
    law = slotine_li(name, SigmaModification(own_gain(name), rate))
    run = loop(law, mechanism, swinging(mechanism, seed), 1.0, disturbance=shaken(mechanism, size * K))  # type: ignore[arg-type]
    V = kinetic(mechanism, run) + distance(law, run, mechanism.inertial_parameters)
    beta = model.fundamental_parameters
    b = rate * 0.5 * (beta**2 / own_gain(name)).sum() + 0.5 * size**2 * K.sum()
    slowest = 1.0 / np.linalg.eigvalsh(mechanism.mass_matrix(run.p) / np.sqrt(np.outer(K, K))).max()
    assert V.max() <= max(V[0], b / min(rate, slowest)) * (1.0 + 1e-3)


@pytest.mark.parametrize("name", ARMS)
def test_e_modification_leaves_the_truth_in_peace(name: str) -> None:
    """On the trajectory with true estimates the leak is silent; sigma's is not."""
    mechanism, true = arm(name), reduced(name).fundamental_parameters
    moved = {}
    for law in (EModification, SigmaModification):
        controller = slotine_li(name, law(own_gain(name), leakage=0.5), initial=true)
        run = loop(controller, mechanism, swinging(mechanism), 2.0, off=0.0)
        moved[law] = np.abs(run.estimate - true).max()
    assert moved[EModification] < 0.05 * moved[SigmaModification]


@settings(max_examples=5, deadline=None)
@given(name=st.sampled_from(ARMS), rate=st.floats(0.05, 2.0), size=st.floats(0.0, 0.2), seed=st.integers(0, 100))
def test_e_modification_keeps_its_bound(name: str, rate: float, size: float, seed: int) -> None:
    """V' <= |s| (|d| + nu V_prior - nu V_parameters - k |s|), k the least damping: V falls outside that box."""
    mechanism, model, K = arm(name), reduced(name), gains(name).damping
    law = slotine_li(name, EModification(own_gain(name), rate))
    run = loop(law, mechanism, swinging(mechanism, seed), 1.0, disturbance=shaken(mechanism, size * K))  # type: ignore[arg-type]
    V = kinetic(mechanism, run) + distance(law, run, mechanism.inertial_parameters)
    pull = size * np.linalg.norm(K) + rate * 0.5 * (model.fundamental_parameters**2 / own_gain(name)).sum()
    heaviest = np.linalg.eigvalsh(mechanism.mass_matrix(run.p)).max()
    assert V.max() <= max(V[0], 0.5 * heaviest * (pull / K.min()) ** 2 + pull / rate) * (1.0 + 1e-3)


@settings(max_examples=5, deadline=None)
@given(name=st.sampled_from(ARMS), size=st.floats(0.01, 0.2), mass=st.floats(0.0, 2.0), seed=st.integers(0, 100))
def test_dead_zone_learns_only_where_v_falls(name: str, size: float, mass: float, seed: int) -> None:
    """Whatever disturbs within the bound: inside the zone estimates stand still, outside V falls."""
    mechanism, K, true = arm(name), gains(name).damping, loaded(arm(name), mass)
    adaptation = DeadZone.for_disturbance(own_gain(name), K, size * K)
    law = slotine_li(name, adaptation)
    run = loop(law, mechanism, swinging(mechanism, seed), 0.5, disturbance=shaken(mechanism, size * K), parameters=true)  # type: ignore[arg-type]
    V = kinetic(mechanism.with_parameters(true), run) + distance(law, run, true)
    mean = 0.5 * (run.s[1:] + run.s[:-1]) / adaptation.width
    moved = (run.estimate[1:] != run.estimate[:-1]).any(axis=1)
    np.testing.assert_array_equal(moved, (mean**2).sum(axis=1) > 1.0)
    assert np.diff(V)[moved].max(initial=0.0) < 1e-5 * V[0]


def bounds_of_projection(name: str) -> tuple[Array, Array]:
    """Bounds near the true parameters and zero."""
    beta, reach = reduced(name).fundamental_parameters, 0.3 * np.sqrt(own_gain(name, 1.0))
    return np.minimum(beta, 0.0) - reach, np.maximum(beta, 0.0) + reach


@settings(max_examples=4, deadline=None)
@given(name=st.sampled_from(ARMS), size=st.floats(0.5, 1.0), seed=st.integers(0, 100))
def test_projection_keeps_its_bounds_and_v(name: str, size: float, seed: int) -> None:
    mechanism, K = arm(name), gains(name).damping
    lower, upper = bounds_of_projection(name)
    law = slotine_li(name, Projection(Gradient(own_gain(name), theta=0.5, cap=0.0), lower, upper))
    run = loop(law, mechanism, swinging(mechanism, seed), 0.5)
    V = kinetic(mechanism, run) + distance(law, run, mechanism.inertial_parameters)
    assert rise(V) < 1e-6
    shaky = loop(law, mechanism, swinging(mechanism, seed), 0.5, disturbance=shaken(mechanism, size * K))  # type: ignore[arg-type]
    for estimate in (run.estimate, shaky.estimate):
        assert np.all((estimate >= lower) & (estimate <= upper))


@pytest.mark.parametrize("name", ARMS)
def test_without_projection_its_bounds_are_left(name: str) -> None:
    mechanism, K = arm(name), gains(name).damping
    lower, upper = bounds_of_projection(name)
    free = slotine_li(name, Gradient(own_gain(name)))
    loose = loop(free, mechanism, swinging(mechanism), 0.5, disturbance=shaken(mechanism, K)).estimate  # type: ignore[arg-type]
    assert not np.all((loose >= lower) & (loose <= upper))


def test_noise_makes_the_gradient_drift_and_robust_laws_stay() -> None:
    """Hardly any excitation, noisy velocities: the gradient's error grows with time, the others' settles. The backward
    rule multiplies the noise of one tick by that of the next, which have nothing to do with each other."""
    name, mechanism, model = SMALL, arm(SMALL), reduced(SMALL)
    beta, gain = model.fundamental_parameters, own_gain(SMALL)
    first = 0.7 * beta
    laws: dict[str, AdaptationLaw] = {
        "gradient": Gradient(gain, 0.5, 0.0),
        "backward": Gradient(gain),
        "sigma": SigmaModification(gain, 0.3, first),
        "e": EModification(gain, 0.5, first),
        "dead zone": DeadZone(gain, 1.5),
    }
    half, end = {}, {}
    for law, adaptation in laws.items():
        controller = slotine_li(name, adaptation, initial=first, control_period=2e-3)
        run = loop(controller, mechanism, swinging(mechanism, amplitude=0.05), 24.0, 2e-3, noise=0.5)
        errors = np.linalg.norm(run.estimate - beta, axis=1)
        half[law], end[law] = errors[len(errors) // 2], errors[-1]
    assert end["gradient"] > 1.7 * half["gradient"]
    assert end["backward"] < 1.2 * half["backward"]
    assert all(end[law] < 0.6 * end["gradient"] for law in ("sigma", "e", "dead zone"))
    assert end["e"] < 1.1 * half["e"]
    assert end["dead zone"] < 1.1 * half["dead zone"]
