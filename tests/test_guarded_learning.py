"""Guarded learning: one step against dense matrices, a Lyapunov function, and what missed torques are taken for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import mostly_at_night, nightly
from sampled_loops import Loop, arm, gains, kinetic, loaded, loop, own_gain, posture, reduced, swinging

from adaptctl import Plant, SlotineLi, adaptive_controller, simulate_many
from adaptctl.arrays import Array
from adaptctl.compilation import compile_function
from adaptctl.compilation.kernel import Kernel
from adaptctl.control import AdaptiveState, GuardedLearning
from adaptctl.control.adaptation.doubt import CLEAR
from adaptctl.control.adaptation.guarded_learning import GRADIENT_SHARE
from adaptctl.control.adaptation.guarded_memory import GuardedMemory
from adaptctl.control.adaptation.payload_test import JudgedPeriod, PayloadSums, PayloadTest
from adaptctl.control.adaptation.recalled_step import Flow, recalled_step
from adaptctl.control.adaptation.stored import QUARANTINE
from adaptctl.control.adaptation.symmetric import from_triangle
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.pytree import leaves, like
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.scalars import Column, column, where
from adaptctl.simulation.effects import Encoder, Friction, PayloadHeld
from adaptctl.simulation.effects.effect import ActuatorEffect
from adaptctl.tuning import with_friction

ARM = "puma560_arm3"
K = len(reduced(ARM).columns)
TRUE = reduced(ARM).fundamental_parameters


def learner(period: float = 1e-3, **options: Any) -> SlotineLi:
    weight = 1.0 / (3.3e-3 * gains(ARM).damping) ** 2
    law = GuardedLearning(own_gain(ARM), weight, **options)
    given: Any = (8.0, gains(ARM).damping * min(1.0, 1e-3 / period), law, None, period)
    return SlotineLi(reduced(ARM), *given, torque_limits=np.inf)


def memory(state: AdaptiveState) -> GuardedMemory:
    found: GuardedMemory = state.law_state
    return found


@dataclass(frozen=True)
class Push(ActuatorEffect):
    """Torques (r,) that act besides the controller's from one time to another, s."""

    torque: tuple[float, ...]
    start: float
    stop: float

    rank: ClassVar[int] = 9

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        pass

    def initial_state(self, torque: Array, control_period: float) -> Array:
        return np.zeros((*torque.shape[:-1], 1))

    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        t = memory[0]
        level = where(t < self.start, 0.0, where(t < self.stop, 1.0, 0.0))
        return torque + Column(level * x for x in self.torque), Column((t + control_period,))


def dense(k: int, seed: int) -> tuple[Array, Array]:
    """A positive semidefinite matrix of less than full rank, and a vector."""
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(k // 2 + 1, k))
    return W.T @ W, rng.normal(size=k)


@given(k=st.integers(1, 45), rows=st.integers(1, 7), seed=st.integers(0, 999))
@settings(max_examples=40, deadline=None)
def test_a_recalled_step_is_that_of_dense_matrices(k: int, rows: int, seed: int) -> None:
    """On floats up to 45 parameters, the pass that native code and C make of loops."""
    rng = np.random.default_rng(seed + 1)
    (A, x), (N, right), W = dense(k, seed), dense(k, seed + 2), rng.normal(size=(rows, k))
    (shares, flow), upper = (rng.uniform(size=rows), Flow(0.9, 0.2, 0.7, 0.3)), np.triu_indices(k)
    given_rows = [column(w) for w in W]
    found = recalled_step(
        column(A[upper]), column(N[upper]), given_rows, column(shares), flow, column(x), column(right)
    )
    after = 0.9 * A + 0.2 * N
    inverse = np.linalg.inv(after + np.eye(k))
    np.testing.assert_allclose(from_triangle(np.array(found.information.of), k), after, rtol=1e-13, atol=1e-13)
    pending = 0.7 * N + W.T @ np.diag(shares) @ W
    np.testing.assert_allclose(from_triangle(np.array(found.pending.of), k), pending, rtol=1e-12, atol=1e-12)
    step = inverse @ (right + (0.3 * 0.9 * A + 0.2 * N) @ x)
    np.testing.assert_allclose(found.step.of, step, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.unsure.of, np.einsum("qi,ij,qj->q", W, inverse, W), rtol=1e-8)


@pytest.mark.parametrize("period", [1e-3, 2e-3, 5e-3])
def test_v_does_not_rise_while_nothing_is_doubted(period: float) -> None:
    """V = s'Ms/2 + x' (c P)^-1 x/2, x the parameter error; the gradient's part is sampled, hence a small allowance."""
    controller = learner(period, min_speed=0.0)
    run = loop(controller, arm(ARM), swinging(arm(ARM)), 3.0, period, off=0.05)
    law: Any = controller.adaptation_law
    errors = run.estimate - TRUE
    inverse = [np.linalg.inv(law.covariance(memory(state))) for state in run.states]
    V = kinetic(arm(ARM), run) + (0.5 / GRADIENT_SHARE) * np.einsum("ti,tij,tj->t", errors, np.array(inverse), errors)
    assert all(law.decision(memory(state)) == "model" for state in run.states)
    assert np.diff(V).max() < 2e-4 * V[0]
    assert V[-1] < 0.5 * V[0]


def step_of_memory(state: GuardedMemory, missed: Array, dt: float, law: GuardedLearning) -> tuple[Array, Array]:
    """P^-1 and the parameter step without tracking error, by dense matrices: the sum of a Newton step on what
    leaves quarantine and of a recall of what was known, the faster the calmer the loudest joint is."""
    scale, stored = np.sqrt(law.gain), state.stored
    recall = law.recall * (2.0 - min(1.0, np.max(np.asarray(state.watch.noise) * law.prediction_weight)))
    Q, pending = (from_triangle(x, K) for x in (stored.information, stored.pending))
    leave = 1.0 - 1.0 / (1.0 + dt / QUARANTINE)
    keep = 1.0 / (1.0 + law.forgetting * dt)
    after = keep * Q + leave * pending
    x = missed / scale
    force = leave * (pending @ x) + recall * dt * keep * (Q @ x)
    return after, scale * np.linalg.solve(np.eye(K) + after, force)


def test_a_step_is_that_of_dense_matrices() -> None:
    controller, mechanism = learner(min_speed=0.0), arm(ARM)
    law: Any = controller.adaptation_law
    run = loop(controller, mechanism, swinging(mechanism), 1.0)
    for before, after in zip(run.states[-5:-1], run.states[-4:], strict=True):
        information, step = step_of_memory(memory(before), before.estimate - TRUE, 1e-3, law)
        np.testing.assert_allclose(
            from_triangle(memory(after).stored.information, K), information, rtol=1e-9, atol=1e-9
        )
        moved = before.estimate - after.estimate
        tracked = GRADIENT_SHARE * law.covariance(memory(after)) @ regressor_gradient(before, after, run, mechanism)
        np.testing.assert_allclose(moved, step + tracked, rtol=1e-4, atol=1e-7 * np.abs(before.estimate).max())


def regressor_gradient(before: AdaptiveState, after: AdaptiveState, run: Loop, mechanism: Mechanism) -> Array:
    """Integral of Y's over a period, of the regressor at its start."""
    k = next(i for i, state in enumerate(run.states) if state is before)
    reference = swinging(mechanism)(run.time[k : k + 1])
    e, rate = run.p[k] - reference.p[0], run.v[k] - reference.v[0]
    Y = reduced(ARM).slotine_li_regressor(run.p[k], run.v[k], reference.v[0] - 8.0 * e, reference.a[0] - 8.0 * rate)
    return np.asarray(Y.T @ (0.5e-3 * (before.s + after.s)))


def measured(plant: Plant, controller: SlotineLi, duration: float = 20.0, **more: Any) -> Any:
    reference = swinging(plant.mechanism, amplitude=0.4)
    p = reference(np.zeros(1)).p[0] + 0.05
    return simulate_many(
        plant, controller, reference, duration=duration, p=p, v=np.zeros(3), batch_size=1, record_every=5, **more
    )


def final(runs: Any, first: float, last: float) -> float:
    between = (runs.time >= first) & (runs.time < last)
    return 1e3 * float(np.sqrt(np.mean(runs.error[between, 0] ** 2)))


def torque_error(estimate: Array) -> float:
    """Error of predicted torques along the motion, relative."""
    points = swinging(arm(ARM), amplitude=0.4)(np.linspace(0.0, 20.0, 300))
    Y = reduced(ARM).torque_regressor(points.p, points.v, points.a)
    return float(np.linalg.norm(Y @ (estimate - TRUE)) / np.linalg.norm(Y @ TRUE))


@lru_cache
def known(effects: tuple[Any, ...] = (), **more: Any) -> Any:
    law = SlotineLi(reduced(ARM), 8.0, gains(ARM).damping, None, TRUE, torque_limits=np.inf)
    return measured(Plant(arm(ARM), 1e-3, effects=effects), law, seed=1)


@pytest.mark.parametrize("noise", mostly_at_night([0.0, 0.03], 0.03))
def test_it_ends_at_the_error_of_the_true_parameters(noise: float) -> None:
    effects = (Encoder(velocity_noise=noise),) if noise else ()
    learned = measured(Plant(arm(ARM), 1e-3, effects=effects), learner(), seed=1)
    ratio = final(learned, 18.0, 20.0) / final(known(effects), 18.0, 20.0)
    assert ratio < (1.3 if noise else 2.0)


def test_a_dropped_load_is_told_from_a_push_and_learned() -> None:
    plant = Plant(arm(ARM), 1e-3, effects=[PayloadHeld(1.5, stop=8.0)])
    runs = measured(plant, learner(), seed=1)
    assert final(runs, 10.0, 12.0) < 10.0 * final(known(), 10.0, 12.0)
    assert final(runs, 18.0, 20.0) < 10.0 * final(known(), 18.0, 20.0)
    assert torque_error(runs.estimate[-1, 0]) < 0.02


@pytest.mark.parametrize("share", mostly_at_night([0.05, 0.1], 0.1))
def test_a_push_leaves_no_trace(share: float) -> None:
    limits = np.array([97.6, 186.4, 89.4])
    push = Push(tuple((share * limits).tolist()), 6.0, 11.0)
    runs = measured(Plant(arm(ARM), 1e-3, effects=[push]), learner(), seed=1)
    undisturbed = measured(Plant(arm(ARM), 1e-3), learner(), seed=1)
    assert final(runs, 15.0, 17.0) < 2.0 * final(undisturbed, 8.0, 10.0)  # as long learned; 80 during the push
    assert torque_error(runs.estimate[-1, 0]) < 0.01


@pytest.mark.parametrize("seconds", mostly_at_night([90.0, 600.0], 90.0))
def test_long_rest_with_friction_and_noise_leaves_the_estimate(seconds: float) -> None:
    """Friction of which the model has nothing, at rest, where it may hold any torque."""
    still = np.array(posture(arm(ARM)))
    plant = Plant(arm(ARM), 1e-3, effects=[Friction(coulomb=2.0, stribeck=1.0), Encoder(velocity_noise=0.01)])
    moved = measured(Plant(arm(ARM), 1e-3), learner(), 8.0).estimate[-1, 0]
    given: Any = (reduced(ARM), 8.0, gains(ARM).damping, GuardedLearning(own_gain(ARM), 10.0), moved)
    reference = swinging(arm(ARM), amplitude=0.0)
    rest = simulate_many(
        plant, SlotineLi(*given, torque_limits=np.inf), reference, duration=seconds, p=still, v=np.zeros(3),
        batch_size=1, record_every=1000, seed=3,
    )  # fmt: skip
    assert np.isfinite(rest.estimate).all()
    assert np.abs(rest.error[-60:]).max() < 0.05


class Verdict(NamedTuple):
    payload: float
    contact: float
    change: Array


@lru_cache
def judging(name: str, open_mind: float, width: int) -> tuple[Kernel, list[Array]]:
    """One period of the test, of which thousands are run, in native code; and the sums before the first."""
    model, T = reduced(name), 0.01
    zero, r, k = PayloadSums.zero(model), model.mechanism.dof, len(model.columns)
    shares = Column([400.0] * r)
    step = JudgedPeriod(T, 1.0, 0.0, shares, column(model.fundamental_parameters), column(gains(name).damping))
    test = PayloadTest(model, column(open_mind * own_gain(name)))

    def period(rows: Column, weights: Column, missed: Column, usual: Column, **sums: Column) -> tuple[Column, ...]:
        split, hung = ([Column(x.of[n * j : n * j + n]) for j in range(r)] for x, n in ((rows, k), (weights, width)))
        verdict = test.judged(split, hung, missed, T * shares, usual, like(zero, sums.values()), step)
        return Column((verdict.payload, verdict.contact)), verdict.change, *leaves(verdict.after)

    start = [np.array(part, dtype=np.float64) for part in leaves(zero)]
    sizes = {"rows": r * k, "weights": r * width, "missed": r, "usual": r}
    sizes |= {f"sum{i}": len(part) for i, part in enumerate(start)}
    return compile_function(period, sizes, name="judged"), start


def judged_by(name: str, rows: Array, weights: Array, missed: Array, noise: float, open_mind: float = 1.0) -> Verdict:
    """Verdict on missed torques (n, r) of regressors (n, r, k) and those of weights."""
    kernel, sums = judging(name, open_mind, weights.shape[-1])
    for Y, G, miss in zip(rows, weights, missed, strict=True):
        flags, change, *sums = kernel.call(Y.ravel(), G.ravel(), miss, np.full(len(miss), noise**2), *sums)
    return Verdict(float(flags[0]), float(flags[1]), change)


def judged(
    mass: float,
    seed: int,
    noise: float,
    offset: float = 0.05,
    vertical: float | None = None,
    open_mind: float = 1.0,
    usual: float = 1e-3,
) -> tuple[Verdict, float]:
    """Verdict on 3 s with a mass (kg) on the last link, or weights without inertia, or lines in time, and what its
    change leaves of the misses."""
    rng, model, T = np.random.default_rng(seed), reduced(ARM), 0.01
    reference = swinging(arm(ARM), seed % 7, 0.5)(np.arange(300) * T)
    rows = model.torque_regressor(reference.p, reference.v, reference.a)
    held = np.zeros(len(model.mechanism.parameter_names))
    held[20:30] = mass * np.array([1.0, offset, 0.0, 0.0, 0.0, 0.0, offset**2, 0.0, 0.0, offset**2])
    change = model.regrouping @ held
    weights = model.torque_regressor(reference.p, 0.0 * reference.v, 0.0 * reference.a)
    weights = weights[..., np.abs(weights).max(axis=(0, 1)) > 0.0]
    line = rng.uniform(2.0, 10.0, 3) + rng.uniform(-1.0, 1.0, 3) * (np.arange(300) * T)[:, None]
    pushed = line if vertical is None else weights @ rng.normal(size=weights.shape[-1]) * vertical
    missed = (rows @ -change if mass else pushed) + noise * rng.normal(size=(300, 3))
    verdict = judged_by(ARM, rows, weights, missed, max(noise, usual), open_mind)
    left = rows[-50:] @ (verdict.change - change)
    return verdict, float(np.abs(left).max() / max(np.abs(rows[-50:] @ change).max(), 1e-9))


@given(seed=st.integers(0, 999), noise=st.floats(0.0, 0.05))
@settings(max_examples=4, deadline=None)
def test_a_push_is_never_taken_for_a_payload(seed: int, noise: float) -> None:
    verdict, _ = judged(0.0, seed, noise)
    assert (verdict.payload, verdict.contact) == (0.0, 1.0)


@given(seed=st.integers(0, 999), mass=st.sampled_from([-4.0, -0.5, 0.5, 2.0]))
@settings(max_examples=4, deadline=None)
def test_a_vertical_push_at_any_link_is_never_taken_for_a_payload(seed: int, mass: float) -> None:
    verdict, _ = judged(0.0, seed, 0.0, vertical=mass)
    assert (verdict.payload, verdict.contact) == (0.0, 1.0)


def test_payloads_are_found_by_their_torques() -> None:
    found = [judged(2.0, seed, 0.0) for seed in range(8)]
    taken = [left for verdict, left in found if verdict.payload == 1.0]
    assert len(taken) >= 6
    assert max(taken) < 0.15


@pytest.mark.parametrize("usual", [0.3, 0.5])
def test_what_noise_may_hide_is_no_payload_where_a_push_explains_it(usual: float) -> None:
    """Both leave less than the noise, as of friction that rises with the load, but the push leaves nothing."""
    found = [judged(0.0, seed, 0.0, vertical=0.2, usual=usual)[0] for seed in range(6)]
    assert [verdict.payload for verdict in found] == [0.0] * 6


def test_a_load_beyond_the_prior_is_one_too() -> None:
    """A push has no prior: what the prior adds to the misses that a load leaves must not count against it."""
    assert [judged(2.0, seed, 0.0, open_mind=0.01)[0].payload for seed in range(2)] == [1.0, 1.0]


def test_a_load_that_takes_away_more_than_there_is_is_no_payload() -> None:
    """As a push feigns one: the last joint would be left with a negative inertia, and the loop could diverge."""
    assert [judged(-4.0, seed, 0.0, 0.5)[0].payload for seed in range(2)] == [0.0] * 2
    assert sum(judged(4.0, seed, 0.0, 0.5)[0].payload for seed in range(2)) >= 1.0


@pytest.mark.parametrize(
    ("inertia", "taken"), [((0.3, 0.3, 0.3), 1.0), ((0.3, -0.3, 0.3), 0.0), ((0.0, 0.0, 0.0), 1.0)]
)
def test_what_no_body_has_is_no_payload(inertia: tuple[float, float, float], taken: float) -> None:
    """Friction that sticks and slips can look like ten parameters, of an inertia that is negative about some axis."""
    name, times = "puma560_geared", 0.01 * np.arange(80)
    model, held = reduced(name), np.zeros(len(arm(name).parameter_names))
    held[50:60] = [2.0, 0.1, 0.0, 0.0, inertia[0], 0.0, inertia[1], 0.0, 0.0, inertia[2]]
    point = swinging(arm(name), 3, 0.8)(times)
    rows = model.torque_regressor(point.p, point.v, point.a)
    weights = model.torque_regressor(point.p, 0.0 * point.v, 0.0 * point.a)
    missed = rows @ (model.regrouping @ -held)
    weights = weights[..., np.abs(weights).max(axis=(0, 1)) > 0.0]
    assert judged_by(name, rows, weights, missed, 1e-3, 1e4).payload == taken


def test_an_announced_payload_is_taken_at_once_and_ends() -> None:
    controller = learner()
    law: Any = controller.adaptation_law
    run = loop(controller, arm(ARM), swinging(arm(ARM)), 4.0)
    state = run.states[-1]
    told = state._replace(law_state=law.expect_payload(memory(state)))
    assert law.decision(memory(told)) == "unknown"
    reference, body = swinging(arm(ARM)), Plant(arm(ARM), 1e-3, torque_limits=np.full(3, np.inf))
    moving, found = body.init(run.p[-1], run.v[-1]), []
    for k in range(3500):
        point = reference(np.array([4.0 + 1e-3 * k]))
        torque, told = controller.step(told, moving.p, moving.v, ReferencePoint(*(part[0] for part in point)))
        moving = body.step(moving, torque, loaded(arm(ARM), 1.0))
        found.append(law.decision(memory(told)))
    assert found[-1] == "model"
    assert found.index("payload") < 2000
    assert 1900 < found.count("payload") < 2100  # while nothing is doubted


def test_a_decision_has_a_time_limit() -> None:
    law = GuardedLearning(own_gain(ARM), 1e4, time_limit=1.0)
    controller = SlotineLi(reduced(ARM), 8.0, gains(ARM).damping, law, torque_limits=np.inf)

    def jumping(t: float) -> Array:
        return np.array([24.0, -27.0, 21.0]) * np.sign(np.sin(40.0 * t * t)) * (t > 3.0)

    run = loop(controller, arm(ARM), swinging(arm(ARM)), 7.0, disturbance=jumping)
    alarms = [float(memory(state).watch.alarm[0]) for state in run.states]
    assert max(alarms) > 0.9
    assert max(alarms) <= 1.0 + 2e-3
    assert CLEAR == 1.0


@nightly
def test_the_default_controller_learns_friction_too() -> None:
    controller = adaptive_controller(arm(ARM))
    assert [name for name in controller.model.names if name.endswith("coulomb")]
    plant = Plant(with_friction(arm(ARM)), 1e-3)
    true = plant.mechanism.inertial_parameters.copy()
    for k, name in enumerate(plant.mechanism.parameter_names):
        true[k] += 2.0 * name.endswith("viscous") + 3.0 * name.endswith("coulomb")
    runs = measured(plant, controller, parameters=true[None], seed=1)
    own = SlotineLi(
        controller.model, controller.bandwidth, controller.damping, None, controller.model.regrouping @ true
    )
    assert final(runs, 18.0, 20.0) < 2.0 * final(measured(plant, own, parameters=true[None]), 18.0, 20.0)
    assert adaptive_controller(arm(ARM), friction=False).model.names == reduced(ARM).names


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"recall": 600.0}, "recall: 600 1/s is too fast for a control period of 0.001 s; use at most 500 1/s"),
        ({"recall": -1.0}, "recall: expected a finite number of at least 0"),
        ({"time_limit": np.inf}, "time_limit: expected a finite number of at least 0"),
        ({"min_speed": -0.1}, "min_speed: expected finite speeds of at least 0"),
        ({"min_speed": [0.1, 0.1]}, "min_speed"),
        ({"forgetting": -1.0}, "forgetting: expected a finite number of at least 0"),
        ({"cutoff": 2000.0}, "cutoff"),
    ],
)
def test_absurd_settings_are_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        learner(**options)


def test_the_default_controller_refuses_what_is_no_yes_or_no() -> None:
    with pytest.raises(InputError, match="friction: expected True or False"):
        adaptive_controller(arm(ARM), friction=1)  # type: ignore[arg-type]
