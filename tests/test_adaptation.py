"""Adaptation laws one by one: what each keeps whatever happens, what freezes, and what is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from nightly import turn_by_turn
from sampled_loops import RANGES, arm, full, gains, loop, posture, reduced, swinging

from adaptctl.arrays import Array
from adaptctl.compilation import trace
from adaptctl.control import (
    AdaptationLaw,
    BoundedGainForgetting,
    Composite,
    CompositeLearning,
    ConcurrentLearning,
    CushionedFloor,
    DeadZone,
    EModification,
    Gradient,
    GuardedLearning,
    Natural,
    Period,
    Projection,
    ReferencePoint,
    SigmaModification,
    Sinusoids,
    SlotineLi,
    Subspace,
    adaptation_gain,
    limits,
    lyapunov,
)
from adaptctl.control.adaptation.composite import Filtered, TorqueFilter
from adaptctl.control.adaptation.law import NoMemory
from adaptctl.control.adaptation.natural import moved_body
from adaptctl.control.pytree import leaves
from adaptctl.description.inertia import from_pseudo_inertia, pseudo_inertia
from adaptctl.errors import InputError, NotFoundError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column

NAMES = ["puma560_arm3", "semi_direct_drive"]


def gain(name: str) -> Array:
    return adaptation_gain(reduced(name), RANGES, 0.3)


def widely(name: str) -> tuple[Array, Array]:
    k = len(reduced(name).columns)
    return np.full(k, -0.5), np.full(k, 0.5)


LAWS: dict[str, Callable[[str], AdaptationLaw]] = {
    "gradient": lambda name: Gradient(gain(name)),
    "euler": lambda name: Gradient(gain(name), 0.0, 0.0),
    "matrix": lambda name: Gradient(np.diag(gain(name))),
    "sigma": lambda name: SigmaModification(gain(name), 0.2),
    "e": lambda name: EModification(gain(name), 0.5, np.ones(len(gain(name)))),
    "dead zone": lambda name: DeadZone(gain(name), 0.01),
    "projection": lambda name: Projection(Composite(gain(name), 0.1), *widely(name)),
    "composite": lambda name: Composite(gain(name), 0.1),
    "subspace": lambda name: Subspace(np.ones(4), np.eye(len(gain(name)))[:, 1:5]),
    "bounded-gain forgetting": lambda name: BoundedGainForgetting(gain(name), 0.1),
    "cushioned floor": lambda name: CushionedFloor(gain(name), 0.1),
    "composite learning": lambda name: CompositeLearning(gain(name), 0.1, reset_power=1.0),
    "guarded learning": lambda name: GuardedLearning(gain(name), 0.1),
    "concurrent learning": lambda name: ConcurrentLearning(gain(name), 0.1, stack_size=3, novelty_threshold=1e-3),
}


K = len(reduced("puma560_arm3").columns)
ONES, ZERO = np.ones(K), np.zeros(3)


def on(name: str, law: AdaptationLaw | None, **options: object) -> SlotineLi:
    return SlotineLi(reduced(name), 8.0, gains(name).damping, law, **options)  # type: ignore[arg-type]


def natural(name: str) -> SlotineLi:
    initial = 1.3 * arm(name).inertial_parameters
    return SlotineLi(full(name), 8.0, gains(name).damping, Natural(0.02), initial)


def second_tick(controller: SlotineLi, name: str, elapsed: float) -> tuple[list[Array], list[Array]]:
    """The leaves of what a tick gives, natively and on floats, a tick after the first."""
    r = arm(name).dof
    p, v = posture(arm(name)) + 0.1, np.linspace(-1.0, 1.0, r)
    point = ReferencePoint(posture(arm(name)), np.full(r, 0.3), np.full(r, -0.5))
    _, state = controller.step(controller.init(p, v), p, v, point)
    state = state._replace(dt=np.array([elapsed]))
    torque, after = controller.step(state, p + 1e-3 * v, 0.99 * v, point)
    plain = controller.python_step(p + 1e-3 * v, 0.99 * v, *point, *leaves(state))
    return [torque, *leaves(after)], plain


@pytest.mark.parametrize(
    ("law", "name"), turn_by_turn([*sorted(LAWS, key="composite learning".__eq__, reverse=True)], NAMES)
)
def test_native_code_and_floats_learn_alike(name: str, law: str) -> None:
    controller = on(name, LAWS[law](name), initial=np.linspace(-0.4, 0.4, len(gain(name))))
    for native, plain in zip(*second_tick(controller, name, controller.control_period), strict=True):
        np.testing.assert_allclose(native, plain, rtol=0, atol=1e-11 * max(np.abs(plain).max(initial=0.0), 1.0))


def test_natural_adaptation_is_the_same_natively() -> None:
    controller = natural("semi_direct_drive")
    for native, plain in zip(*second_tick(controller, "semi_direct_drive", controller.control_period), strict=True):
        np.testing.assert_allclose(native, plain, rtol=0, atol=1e-11 * max(np.abs(plain).max(initial=0.0), 1.0))


@pytest.mark.parametrize("law", [law for law in LAWS if law != "dead zone"])
def test_nothing_is_learned_from_a_period_that_does_not_count(law: str) -> None:
    name = "puma560_arm3"
    initial = np.linspace(-0.4, 0.4, len(gain(name)))
    controller = on(name, LAWS[law](name), initial=initial)
    frozen, counted = (second_tick(controller, name, elapsed)[0][1] for elapsed in (0.0, controller.control_period))
    np.testing.assert_array_equal(frozen, initial)
    assert np.abs(counted - initial).max() > 1e-6


def test_a_bare_gain_is_gradient_adaptation() -> None:
    name, reference = "puma560_arm3", swinging(arm("puma560_arm3"))
    runs = [loop(on(name, law), arm(name), reference, 0.2) for law in (gain(name), Gradient(gain(name)))]  # type: ignore[arg-type]
    np.testing.assert_array_equal(runs[0].torque, runs[1].torque)


def test_a_whole_gain_of_many_parameters_is_applied_in_loops() -> None:
    """Written out, it was half of the code of a law, and nearly all of a humanoid's."""
    gain, x = np.eye(20) + 0.1, np.arange(20.0)
    law = Gradient(gain)
    routine = trace(lambda gains, x: law.substituted(gains).applied(x), {"gains": 400, "x": 20}, name="applied")
    assert len(routine.subroutines) == 1
    np.testing.assert_allclose(law.applied(column(x)).of, gain @ x, rtol=1e-12)


def test_the_dead_zone_stands_still_within() -> None:
    """Within the zone no digit moves; outside it learns."""
    name, mechanism = "puma560_arm3", arm("puma560_arm3")
    run = loop(on(name, DeadZone(gain(name), 0.2), torque_limits=np.inf), mechanism, swinging(mechanism), 3.0)
    between = 0.5 * (run.s[1:] + run.s[:-1])
    within = ((between / 0.2) ** 2).sum(axis=1) <= 1.0
    moved = np.abs(np.diff(run.estimate, axis=0)).max(axis=1) > 0.0
    np.testing.assert_array_equal(moved, ~within)
    assert within.any()
    assert moved.any()


def test_least_squares_go_on_forgetting_where_others_stop() -> None:
    """One joint alone moves. What nothing excites brings bounded-gain forgetting, and so all its gains, to a stop."""
    name, mechanism = "puma560_arm3", arm("puma560_arm3")
    reference = Sinusoids(posture(mechanism), [0.0, 0.0, 0.3], [1.0, 1.0, 0.7], start_time=0.3)
    lowest = {}
    for law in (BoundedGainForgetting(gain(name), 1.0), CushionedFloor(gain(name), 1.0)):
        run = loop(on(name, law), mechanism, reference, 8.0)
        scale = np.sqrt(np.outer(law.gain, law.gain))
        found = [np.linalg.eigvalsh(law.covariance(run.states[k].law_state) / scale)[0] for k in (3999, 7999)]
        lowest[type(law)] = found[1] / found[0]
    assert lowest[BoundedGainForgetting] < 0.7
    assert lowest[CushionedFloor] > 0.9


@pytest.mark.parametrize("s", [[0.3, -0.4, 1.2], [0.03, -0.04, 0.12], [0.0, 5.0, 0.0], [0.0, 0.0, 0.0]])
def test_e_modification_leaks_by_the_length_of_s(s: list[float]) -> None:
    """Where nothing excites, a period leaves (estimate + T_c nu |s| prior)/(1 + T_c nu |s|)."""
    name, period, rate = "puma560_arm3", 2e-3, 0.7
    prior, estimate = np.linspace(1.0, 2.0, K), np.linspace(-1.0, 1.0, K)
    law = EModification(ONES, rate, prior)
    now = silent(period, before=1.5 * np.array(s), after=0.5 * np.array(s))
    after, _ = law.law(reduced(name), column(estimate), now, NoMemory())
    share = period * rate * float(np.linalg.norm(s))
    np.testing.assert_allclose(after.of, (estimate + share * prior) / (1.0 + share), rtol=1e-13)


@pytest.mark.parametrize("period", [1e-3, 8e-3])
@pytest.mark.parametrize("weight", [0.2, np.array([0.1, 3.0, 20.0])])
def test_composite_solves_its_prediction_error_implicitly(period: float, weight: float | Array) -> None:
    """(Gamma^-1 + T_c W'R W) after = Gamma^-1 before + T_c W'R F[tau], whatever the period."""
    name, rng = "puma560_arm3", np.random.default_rng(3)
    model, law = reduced(name), Composite(gain(name), weight, 15.0)  # type: ignore[arg-type]
    q, estimate = posture(arm(name)), rng.normal(size=K)
    memory = law.initial_state(model, estimate, q + 0.3, rng.normal(size=3), period)
    memory = Filtered(*(column(part) for part in memory))
    now = silent(period, q=q, v=rng.normal(size=3), torque=rng.normal(size=3))
    after, _ = law.law(model, column(estimate), now, memory)
    rows, torque, _ = TorqueFilter(15.0, period).predicted(model, now, memory)
    W, R = np.array([row.of for row in rows]), np.diag(np.broadcast_to(weight, 3))
    information = np.diag(1.0 / gain(name)) + period * W.T @ R @ W
    wanted = np.linalg.solve(information, estimate / gain(name) + period * W.T @ R @ np.array(torque.of))
    assert np.abs(wanted - estimate).max() > 1e-3
    np.testing.assert_allclose(after.of, wanted, rtol=1e-9, atol=1e-12)


def silent(
    period: float,
    *,
    before: Array = ZERO,
    after: Array = ZERO,
    torque: Array = ZERO,
    q: Array = ZERO,
    v: Array = ZERO,
) -> Period:
    """A control period of three joints whose gradient is zero whatever s."""
    parts = (column(part) for part in (before, after, torque, q, v))
    return Period(lambda sliding: Column.zeros(K), *parts, period, period, Column.zeros(3))


def test_a_dead_zone_for_a_disturbance_holds_it() -> None:
    """Where s'Ks <= d'K^-1 d the disturbance may win: the zone of `for_disturbance` is exactly that."""
    K, torque = np.array([10.0, 20.0, 5.0]), np.array([1.0, 2.0, 0.5])
    zone = DeadZone.for_disturbance(np.ones(3), K, torque)
    s = np.random.default_rng(0).normal(size=(1000, 3))
    np.testing.assert_allclose(
        ((s / zone.width) ** 2).sum(axis=1), (s**2 * K).sum(axis=1) / (torque**2 / K).sum(), rtol=1e-12
    )


consistent = arrays(np.float64, (4, 4), elements=st.floats(-1.0, 1.0)).map(
    lambda G: from_pseudo_inertia((np.eye(4) + 0.5 * G) @ (np.eye(4) + 0.5 * G).T + 1e-3 * np.eye(4))
)


@settings(max_examples=120)
@given(ten=consistent, slope=arrays(np.float64, (10,), elements=st.floats(-10.0, 10.0)), size=st.floats(-3.0, 6.0))
def test_a_body_stays_a_body_whatever_the_slope(ten: Array, slope: Array, size: float) -> None:
    moved = np.array(moved_body(ten.tolist(), (10.0**size * slope).tolist()))
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(moved))
    assert eigenvalues[0] > -1e-12 * eigenvalues[-1]
    assert np.linalg.slogdet(pseudo_inertia(moved))[0] == 1.0


@settings(max_examples=10)
@given(ten=consistent, slope=arrays(np.float64, (10,), elements=st.floats(-1.0, 1.0)))
def test_small_steps_do_not_wear_a_body_away(ten: Array, slope: Array) -> None:
    """Two hundred steps to and fro end where they began, to the round-off of their sizes: none is added by standing."""
    assert moved_body(ten.tolist(), [0.0] * 10) == ten.tolist()
    forth, moved = (1e-10 * slope).tolist(), ten.tolist()
    back = [-x for x in forth]
    for _ in range(100):
        moved = moved_body(moved_body(moved, forth), back)
    assert np.abs(np.array(moved) - ten).max() < 1e-13 * np.abs(ten).max()


@settings(max_examples=25)
@given(ten=consistent, slope=arrays(np.float64, (10,), elements=st.floats(-1.0, 1.0)))
def test_a_small_step_follows_the_geodesic_to_fourth_order(ten: Array, slope: Array) -> None:
    from scipy.linalg import expm, sqrtm

    P = pseudo_inertia(ten)
    L = np.zeros((4, 4))
    basis = np.array([pseudo_inertia(unit) for unit in np.eye(10)]).reshape(10, 16)
    L = (np.linalg.pinv(basis) @ slope).reshape(4, 4)
    root = np.real(sqrtm(P))
    size = np.linalg.norm(root @ L @ root)
    assume(size > 1e-3)
    misses = []
    for step in (0.4 / size, 0.2 / size):
        geodesic = root @ expm(-step * root @ L @ root) @ root
        moved = pseudo_inertia(np.array(moved_body(ten.tolist(), (step * slope).tolist())))
        misses.append(np.abs(moved - geodesic).max())
    assert misses[1] <= misses[0] / 20.0 + 1e-12 * np.abs(P).max()


def test_natural_adaptation_keeps_every_body_a_body_when_shaken() -> None:
    """40 N m of disturbance, noise, and a rate at which the estimate moves a lot."""
    name = "puma560_geared"
    mechanism = arm(name)
    law = SlotineLi(full(name), 8.0, gains(name).damping, Natural(0.05), mechanism.inertial_parameters)
    size = np.array([40.0, 40.0, 40.0, 4.0, 4.0, 4.0])
    run = loop(
        law,
        mechanism,
        swinging(mechanism),
        1.0,
        disturbance=lambda t: size * np.sin(20.0 * t + np.arange(6)),
        noise=0.01,
    )
    bodies = run.estimate[:, :60].reshape(-1, 6, 10)[::10]
    smallest = min(np.linalg.eigvalsh(pseudo_inertia(ten))[0] for bodies_now in bodies for ten in bodies_now)
    assert smallest > 0.0
    assert np.abs(run.estimate[-1] - run.estimate[0]).max() > 0.1
    assert run.estimate[:, 60:].min() > 0.0


def test_adapting_along_directions_is_a_gain_of_lower_rank() -> None:
    """W diag(g) W' as a gain: all directions are `Gradient`'s controller, fewer never leave their span."""
    name, mechanism = "puma560_arm3", arm("puma560_arm3")
    directions = np.random.default_rng(0).normal(size=(K, K))
    whole = directions @ np.diag(gain(name)) @ directions.T
    runs = [
        loop(on(name, law), mechanism, swinging(mechanism), 0.2)
        for law in (Subspace(gain(name), directions), Gradient(whole, 0.5, 0.0))
    ]
    np.testing.assert_allclose(runs[0].torque, runs[1].torque, atol=1e-9 * np.abs(runs[1].torque).max())
    few = directions[:, :3]
    estimates = loop(on(name, Subspace(gain(name)[:3], few)), mechanism, swinging(mechanism), 0.2).estimate
    beyond = estimates - estimates @ np.linalg.pinv(few).T @ few.T
    assert np.abs(beyond).max() < 1e-12 * np.abs(estimates).max()
    assert np.abs(estimates[-1]).max() > 0.1


def test_the_truth_is_at_no_distance_and_everything_else_at_some() -> None:
    name = "semi_direct_drive"
    model, true = full(name), arm(name).inertial_parameters
    law = Natural(0.1)
    estimates = np.array([true, 1.1 * true, 2.0 * true])
    found = law.lyapunov_distance(model, estimates, true)
    assert found[0] == pytest.approx(0.0, abs=1e-9)
    assert 0.0 < found[1] < found[2]
    assert np.isinf(law.lyapunov_distance(model, true, -true))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: on("puma560_arm3", Gradient(np.ones(30))), "30 parameters, but the basis has 15"),
        (lambda: on("puma560_arm3", Gradient(np.ones(4))), "adaptation gain: expected 15 numbers, .* got 4"),
        (lambda: Gradient(-ONES), "positive"),
        (lambda: SigmaModification(ONES, 0.0), "leakage rate"),
        (lambda: SigmaModification(ONES, 1.0, np.ones(3)), "leakage: prior"),
        (lambda: DeadZone(ONES, 0.0), "dead zone: width"),
        (lambda: on("puma560_arm3", DeadZone(ONES, np.ones(6))), "dead zone: width"),
        (lambda: Projection(Gradient(np.diag(ONES)), -ONES, ONES), "couples the errors of the parameters"),
        (lambda: Projection(Gradient(ONES), ONES, -ONES), "lower < upper"),
        (lambda: Projection(Gradient(ONES), np.full(K, np.nan), ONES), "infinite for no bound"),
        (
            lambda: on("puma560_arm3", Projection(Gradient(ONES), ONES, 2.0 * ONES)),
            r"initial estimate of link1.I_yy is 0, outside its bounds \[1, 2\]",
        ),
        (lambda: Composite(ONES, -1.0), "composite: prediction_weight"),
        (lambda: on("puma560_arm3", Composite(ONES, cutoff=2000.0)), "use at most 1000 rad/s"),
        (lambda: on("puma560_arm3", Composite(ONES, cutoff=np.inf)), "cutoff: expected a positive number"),
        (lambda: Gradient(np.ones(0)), r"adaptation gain: expected numbers \(k,\), .* got shape \(0,\)"),
        (lambda: Gradient(np.ones((0, 0))), r"adaptation gain: expected numbers \(k,\), .* got shape \(0, 0\)"),
        (lambda: BoundedGainForgetting(np.ones(0)), r"gain: expected Gamma's diagonal \(k,\), got shape \(0,\)"),
        (lambda: BoundedGainForgetting(np.diag(ONES)), "gain: expected Gamma's diagonal"),
        (lambda: CompositeLearning(np.diag(ONES)), "gain: expected Gamma's diagonal"),
        (lambda: BoundedGainForgetting(ONES, bound=0.5), "bound: expected a finite number of at least 1"),
        (lambda: BoundedGainForgetting(ONES, forgetting=-1.0), "forgetting: expected a finite number of at least 0"),
        (lambda: on("puma560_arm3", BoundedGainForgetting(ONES, forgetting=101.0)), "use at most 100 1/s"),
        (lambda: CushionedFloor(-ONES), "cushioned floor: gain: expected positive"),
        (
            lambda: CushionedFloor(ONES, forgetting=-1.0),
            "cushioned floor: forgetting: expected a finite",
        ),
        (lambda: on("puma560_arm3", CushionedFloor(np.ones(30))), "30 parameters, but the basis has 15"),
        (lambda: Subspace(np.ones(2), np.ones((K, 2))), "directions are linearly dependent"),
        (lambda: Subspace(np.ones(1), np.zeros((K, 1))), "directions are linearly dependent"),
        (lambda: Subspace(np.ones(3), np.eye(K)[:, :2]), r"subspace: gain: expected shape \(2,\)"),
        (lambda: Subspace(np.zeros(2), np.eye(K)[:, :2]), "subspace: gain: expected positive"),
        (lambda: Subspace(np.ones(K), np.ones(K)), r"expected shape \(k, s\)"),
        (lambda: on("puma560_arm3", Subspace(np.ones(2), np.eye(4)[:, :2])), "directions: expected 15 numbers"),
        (lambda: Natural(0.0), "natural adaptation: gain"),
        (lambda: Natural(np.array([1.0, np.nan])), "gain: expected positive numbers"),
        (
            lambda: SlotineLi(full("semi_direct_drive"), 8.0, 50.0, Natural(np.ones(3))),
            "expected a number, or 5 of them, one for each of 5 links and 0 parameters of drives, got 3",
        ),
        (lambda: on("puma560_arm3", Natural(0.1)), "15 base parameters do not"),
        (
            lambda: SlotineLi(full("puma560_arm3"), 8.0, 50.0, Natural(0.1)),
            "the initial estimate of link1 is not physically consistent",
        ),
        (
            lambda: SlotineLi(
                full("puma560_geared"),
                8.0,
                gains("puma560_geared").damping,
                Natural(0.1),
                arm("puma560_geared").inertial_parameters * np.r_[np.ones(60), np.zeros(6)],
            ),
            "initial estimate of joint1.rotor_inertia must be positive",
        ),
    ],
)
def test_what_cannot_be_is_refused(make: Callable[[], object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        make()


def test_bounds_are_made_from_names_that_are_kept() -> None:
    model: ReducedModel = reduced("puma560_arm3")
    lower, upper = limits(model, {"link1.I_yy": (0.0, 5.0)})
    assert (lower[0], upper[0]) == (0.0, 5.0)
    assert np.isinf(lower[1:]).all()
    assert np.isinf(upper[1:]).all()
    with pytest.raises(NotFoundError, match="the basis regroups it into others"):
        limits(model, {"link2.m": (0.0, 5.0)})
    with pytest.raises(NotFoundError, match=r"has no parameter 'link1.I_yyy' \(did you mean 'link1.I_yy'\?\)"):
        limits(model, {"link1.I_yyy": (0.0, 5.0)})


def test_a_function_v_that_a_run_cannot_tell_is_refused() -> None:
    name, mechanism = "puma560_arm3", arm("puma560_arm3")
    controller = on(name, BoundedGainForgetting(gain(name), 0.1))
    run = loop(controller, mechanism, swinging(mechanism), 0.01)
    point = swinging(mechanism)(run.time)

    class Told:
        p, v, estimate, reference_p, reference_v = run.p, run.v, run.estimate, point.p, point.v

    with pytest.raises(InputError, match="needs more than the recorded estimate"):
        lyapunov(controller, Told(), mechanism)


def test_a_projection_is_projected_again() -> None:
    """Its own function is still a sum over single parameters, so tighter bounds may be laid around it."""
    inner = Projection(Gradient(np.ones(3)), -2.0 * np.ones(3), 2.0 * np.ones(3))
    assert Projection(inner, -np.ones(3), np.ones(3)).inner is inner
