"""Single steps of adaptation laws against dense matrices, and the settings that they refuse or begin with."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled_loops import arm, gains, posture, reduced

from adaptctl.arrays import Array
from adaptctl.control import (
    BoundedGainForgetting,
    Composite,
    CompositeLearning,
    ConcurrentLearning,
    CushionedFloor,
    Gradient,
    ReleasedGradient,
    SlotineLi,
    Subspace,
    TaskSpaceSlotineLi,
)
from adaptctl.control.adaptation.composite import TorqueFilter, momentum_columns, validate_cutoff
from adaptctl.control.adaptation.gradient import MIN_POWER
from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.control.adaptation.sample_stack import sample_stack
from adaptctl.control.adaptation.symmetric import (
    Equation,
    directional_update,
    first_triangle,
    from_triangle,
    symmetric_product,
    symmetric_trace,
)
from adaptctl.control.controller import ReferencePoint
from adaptctl.errors import InputError
from adaptctl.scalars import Column, column

ARM = "puma560_arm3"
K = len(reduced(ARM).columns)


def symmetric(k: int) -> Array:
    A = np.random.default_rng(k).normal(size=(k, k))
    return A + A.T


@pytest.mark.parametrize("k", range(1, 6))
def test_triangles_hold_symmetric_matrices(k: int) -> None:
    A, x = symmetric(k), np.linspace(-1.0, 2.0, k)
    entries = A[np.triu_indices(k)]
    np.testing.assert_array_equal(from_triangle(entries, k), A)
    np.testing.assert_array_equal(from_triangle(first_triangle(k), k), np.eye(k))
    np.testing.assert_allclose(symmetric_product(column(entries), column(x)).of, A @ x, atol=1e-14)
    assert symmetric_trace(column(entries), k) == pytest.approx(np.trace(A), abs=1e-14)


@pytest.mark.parametrize("entries", [1, 5, 7])
def test_a_triangle_of_three_rows_has_six_entries(entries: int) -> None:
    with pytest.raises(ValueError, match=f"size {entries}"):
        from_triangle(np.ones(entries), 3)


@pytest.mark.parametrize(("forgotten", "learned"), [(0.3, 0.7), (0.3, 0.0), (0.0, 0.7), (0.0, 0.0)])
def test_composite_learning_forgets_and_learns_along_a_row(forgotten: float, learned: float) -> None:
    """Q - forgotten Q w (w'Q w)^-1 w'Q + learned w w', and z = Q x of a true x stays so."""
    k, rng = 4, np.random.default_rng(0)
    root, w, x = rng.normal(size=(k, k)), rng.normal(size=k), rng.normal(size=k)
    Q = root @ root.T
    expected = Q - forgotten * np.outer(Q @ w, Q @ w) / (w @ Q @ w) + learned * np.outer(w, w)
    equation = Equation(column(w), forgotten, MIN_POWER, learned=learned, gained=learned * float(w @ x))
    information, known = directional_update(column(Q[np.triu_indices(k)]), column(Q @ x), [equation])
    np.testing.assert_allclose(from_triangle(np.array(information.of), k), expected, atol=1e-12)
    np.testing.assert_allclose(known.of, expected @ x, atol=1e-12)


def test_an_empty_memory_forgets_nothing_and_stays_finite() -> None:
    empty, w = Column.zeros(3), Column((1.0, -2.0))
    equation = Equation(w, 0.5, MIN_POWER, learned=0.1, gained=0.1 * 3.0)
    information, known = directional_update(empty, Column.zeros(2), [equation])
    np.testing.assert_allclose(information.of, [0.1, -0.2, 0.4], rtol=1e-14)
    np.testing.assert_allclose(known.of, [0.3, -0.6], rtol=1e-14)


def test_one_equation_is_solved_implicitly() -> None:
    """after = before - weight Gamma w (w'after - torque), and with a weight beyond bounds w'after is the torque."""
    rng = np.random.default_rng(1)
    gamma, w, before, torque = rng.uniform(0.5, 2.0, 3), rng.normal(size=3), rng.normal(size=3), 0.7
    learn = sample_stack(((0, 1, 2),), 1, 3, is_whole=False)
    for weight in (0.0, 0.4, 1e12):
        stored = column(before), column(gamma), column(w), Column((torque,))
        after = np.array(learn(*stored, column(w), Column((9.0,)), Column((weight,)), Column((1.0, 1.0, 1.0)))[0].of)
        if weight < 1e6:
            np.testing.assert_allclose(after, before - weight * gamma * w * (w @ after - torque), atol=1e-13)
        else:
            assert w @ after == pytest.approx(torque, abs=1e-9)


@pytest.mark.parametrize("weights", [[1.0, 1.0, 1.0], [0.2, 3.0, 5.0]])
@pytest.mark.parametrize(("novelty", "kept"), [(0.8, 0.0), (1.5, 1.0)])
def test_concurrent_learning_keeps_what_is_newer_than_1_per_second(
    novelty: float, kept: float, weights: list[float]
) -> None:
    """The default threshold of sum_i R_i d_i'Gamma d_i, over an empty stack."""
    model, (p, v) = reduced(ARM), (posture(arm(ARM)), np.linspace(0.5, 1.5, 3))
    moved = (column(x) for x in (0.0 * v, 0.0 * v, np.ones(3), p, v))
    period = Period(lambda s: Column.zeros(K), *moved, 1e-3, 1e-3, column(np.ones(3)))
    law, initial = ConcurrentLearning(np.ones(K), np.array(weights), stack_size=2), np.zeros(K)
    memory = law.initial_state(model, initial, p, 0.0 * v, 1e-3)
    _, stack = replace(law, novelty_threshold=1e-30).law(model, column(initial), period, as_columns(memory))
    sizes = list(map(len, momentum_columns(model)))
    d = np.split(np.array(stack.rows.of[: sum(sizes)]), np.cumsum(sizes)[:-1])
    scaled = replace(law, gain=np.full(K, novelty / sum(R * (row @ row) for R, row in zip(weights, d, strict=True))))
    _, found = scaled.law(model, column(initial), period, as_columns(memory))
    assert found.learned[0] == kept


class OnePeriod(NamedTuple):
    """A period after rest in which all is learned: the linear equation W x = tau, and Y' times the integral of s."""

    period: Period
    memory: Any
    W: Array
    torque: Array
    descent: Array


def one_period(
    law: BoundedGainForgetting | CushionedFloor | CompositeLearning, T: float, rng: np.random.Generator
) -> OnePeriod:
    model, (p, v), Y = reduced(ARM), (posture(arm(ARM)), np.linspace(0.5, 1.5, 3)), rng.normal(size=(3, K))
    before, after, torque = rng.normal(size=(3, 3))
    moved = map(column, (before, after, torque, p, v))
    period = Period(lambda s: column(Y.T @ np.array(s.of)), *moved, T, T, column(np.ones(3)))
    memory: Any = as_columns(law.initial_state(model, np.zeros(K), p, 0.0 * v, T))
    rows, wanted, _ = TorqueFilter(law.cutoff, T).predicted(model, period, memory.filtered)
    W = np.array([row.of for row in rows])
    return OnePeriod(period, memory, W, np.array(wanted.of), 0.5 * T * Y.T @ (before + after))


def positive(rng: np.random.Generator, k: int = K) -> Array:
    """A positive definite matrix (k, k)."""
    root = rng.normal(size=(k, k)) / np.sqrt(k)
    return 0.5 * np.eye(k) + root @ root.T


def test_least_squares_with_bounded_gain_solve_all_equations_at_once_and_then_forget() -> None:
    """P^-1 grows by T W'R W, and the estimate goes by P Y's with the old P and P W'R T (tau - W estimate) with the new
    one; then P forgets."""
    rng, T = np.random.default_rng(2), 1e-3
    gain, R = rng.uniform(0.5, 2.0, K), np.diag(rng.uniform(5.0, 50.0, 3))
    law = BoundedGainForgetting(gain, np.diag(R), forgetting=3.0, bound=1.5)
    period, memory, W, torque, descent = one_period(law, T, rng)
    memory = memory._replace(covariance=column(positive(rng)[np.triu_indices(K)]))
    estimate, P = rng.normal(size=K), law.covariance(memory)
    after = np.linalg.inv(np.linalg.inv(P) + T * W.T @ R @ W)
    moved = estimate - P @ descent
    expected = moved + T * after @ W.T @ R @ (torque - W @ moved)
    rate = 3.0 * (1.0 - np.trace(after / gain[:, None]) / (1.5 * K))
    found, left = law.law(reduced(ARM), column(estimate), period, memory)
    np.testing.assert_allclose(found.of, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(law.covariance(left), (1.0 + T * rate) * after, rtol=1e-9, atol=1e-9)


def test_a_cushioned_floor_forgets_towards_the_gain_and_descends_with_the_new_covariance() -> None:
    """(1 + T lambda) P^-1 = P^-1 + T lambda Gamma^-1, then T W'R W more; and a step by P along Y's and W'R eps."""
    rng, T = np.random.default_rng(3), 1e-3
    gain, R = rng.uniform(0.5, 2.0, K), np.diag(rng.uniform(5.0, 50.0, 3))
    law = CushionedFloor(gain, np.diag(R), forgetting=30.0)
    period, memory, W, torque, descent = one_period(law, T, rng)
    memory = memory._replace(information=column(positive(rng)[np.triu_indices(K)]))
    estimate, share = rng.normal(size=K), 30.0 * T
    floor = np.diag(1.0 / gain)
    before = from_triangle(memory.information.of, K) / np.sqrt(np.outer(gain, gain))
    after = (before + share * floor) / (1.0 + share) + T * W.T @ R @ W
    expected = estimate - np.linalg.solve(after, descent + T * W.T @ R @ (W @ estimate - torque))
    found, left = law.law(reduced(ARM), column(estimate), period, memory)
    np.testing.assert_allclose(found.of, expected, rtol=1e-9, atol=1e-9)
    kept = from_triangle(left.information.of, K) / np.sqrt(np.outer(gain, gain))
    np.testing.assert_allclose(kept, after, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("excess", [0.0, 2.5])
def test_composite_learning_forgets_learns_and_recalls_in_one_step(excess: float) -> None:
    """With Gamma = 1: Q and z fade by 1/(1 + T lambda excess) where more power than the alarm's is missed, forget
    lambda T/(1 + lambda T) along each row in turn and learn it; the step is (1 + Q)^-1 times all slopes."""
    rng, T, forgetting, recall = np.random.default_rng(5), 1e-3, 40.0, 3.0
    law = CompositeLearning(np.ones(K), np.diag(R := np.diag(rng.uniform(5.0, 50.0, 3))), forgetting=forgetting)
    period, memory, W, torque, descent = one_period(law, T, rng)
    estimate, Q, z = rng.normal(size=K), positive(rng), rng.normal(size=K)
    miss = W @ estimate - torque
    law = replace(law, recall=recall, reset_power=float(miss @ R @ miss) / (1.0 + excess))
    memory = memory._replace(information=column(Q[np.triu_indices(K)]), known=column(z))
    Q, z = (x / (1.0 + forgetting * T * excess) for x in (Q, z))
    for row, measured, weight in zip(W, torque, np.diag(R), strict=True):
        along, share = Q @ row / (row @ Q @ row), forgetting * T / (1.0 + forgetting * T)
        z = z - share * (row @ z) * along + T * weight * measured * row
        Q = Q - share * (row @ Q @ row) * np.outer(along, along) + T * weight * np.outer(row, row)
    slope = descent + T * W.T @ R @ miss + recall * T * (Q @ estimate - z)
    found, left = law.law(reduced(ARM), column(estimate), period, memory)
    np.testing.assert_allclose(found.of, estimate - np.linalg.solve(np.eye(K) + Q, slope), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(from_triangle(np.array(left.information.of), K), Q, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(left.known.of, z, rtol=1e-9, atol=1e-9)


def test_a_subspace_counts_the_errors_along_its_directions_over_their_gains() -> None:
    """An error W c + rest, W'rest = 0, has c'Gamma^-1 c/2; a step goes by W Gamma W' times the descent."""
    rng, model = np.random.default_rng(6), reduced(ARM)
    W, gain, c = rng.normal(size=(K, 4)), rng.uniform(0.2, 5.0, 4), rng.normal(size=4)
    law = Subspace(gain, W)
    rest = np.linalg.qr(W, mode="complete")[0][:, 4:] @ rng.normal(size=K - 4)
    true = rng.normal(size=K)
    term = law.lyapunov_term(model, column(true + W @ c + rest), column(true))
    assert term == pytest.approx(0.5 * c @ (c / gain), rel=1e-9)
    period, _, _, _, descent = one_period(CushionedFloor(np.ones(K)), 1e-3, rng)
    found, _ = law.law(model, column(true), period, NoMemory())
    np.testing.assert_allclose(found.of, true - W @ (gain * (W.T @ descent)), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("theta", [0.0, 0.5, 1.0])
def test_a_step_down_the_gradient_is_worth_half_of_what_the_damping_takes_out_at_most(theta: float) -> None:
    """T x'Gamma x n goes to s'Ks/2 as the gain grows, and to T x'Gamma x as it falls; s is `theta` of the way along."""
    rng, T = np.random.default_rng(4), 1e-3
    Y, (before, after) = rng.normal(size=(3, K)), rng.normal(size=(2, 3))
    s, damping = before + theta * (after - before), np.array([1.0, 2.0, 3.0])
    still = Column.zeros(3)
    moved = (column(before), column(after), still, still, still)
    period = Period(lambda s: column(Y.T @ np.array(s.of)), *moved, T, T, column(damping))
    x, power = Y.T @ s, s @ (damping * s)
    for size, worth in ((1e12, 0.5 * power), (1e-9, 1e-9 * T * x @ x)):
        estimate, _ = Gradient(np.full(K, size), theta=theta).law(reduced(ARM), Column.zeros(K), period, NoMemory())
        assert -x @ np.array(estimate.of) == pytest.approx(worth, rel=1e-6)


def test_the_first_covariance_is_the_gain() -> None:
    law = BoundedGainForgetting(np.linspace(0.1, 3.0, K))
    memory = law.initial_state(reduced(ARM), np.zeros(K), posture(arm(ARM)), np.zeros(3), 1e-3)
    np.testing.assert_allclose(law.covariance(memory), np.diag(law.gain), rtol=1e-15)


def as_columns(memory: object) -> object:
    """A memory whose arrays are columns of floats, as a law sees them."""
    if isinstance(memory, np.ndarray):
        return column(memory)
    return type(memory)(*map(as_columns, memory))  # type: ignore[call-overload, misc]


@pytest.mark.parametrize("weight", [-1.0, 0.0, np.nan, [1.0, 2.0]])
def test_composite_refuses_weights_that_are_not_positive_or_not_one_a_joint(weight: object) -> None:
    with pytest.raises(InputError, match="composite: prediction_weight: expected"):
        SlotineLi(reduced(ARM), 8.0, gains(ARM).damping, Composite(np.ones(K), weight))  # type: ignore[arg-type]


def test_composite_refuses_a_negative_weight_at_once() -> None:
    with pytest.raises(InputError, match="composite: prediction_weight: expected"):
        Composite(np.ones(K), np.array([1.0, -1.0, 1.0]))


def test_a_filter_may_be_as_fast_as_its_refusal_says() -> None:
    """A cutoff of one over the period: exactly 1000 1/s for 1 ms, and no more."""
    validate_cutoff(1000.0, 1e-3)
    with pytest.raises(InputError, match=r"1001 rad/s is too fast .* use at most 1000 rad/s"):
        validate_cutoff(1001.0, 1e-3)


def test_a_released_gradient_begins_with_one_normaliser_of_1() -> None:
    memory = ReleasedGradient(np.ones(K)).initial_state(reduced(ARM), np.zeros(K), np.zeros(3), np.zeros(3), 1e-3)
    np.testing.assert_array_equal(memory.n, [1.0])


def test_without_damping_a_tool_has_exactly_the_velocity_asked() -> None:
    """J v_r = x_d' - Lambda (x - x_d) where the error is small: `singularity` is zero unless given."""
    r, p = 3, posture(arm(ARM)) + 0.1
    law = TaskSpaceSlotineLi(reduced(ARM), 6.0, gains(ARM).damping)
    x, rows = law.point(column(p))
    near = np.array(x.of) + 1e-6 * np.array([3.0, -2.0, 1.0])
    asked = ReferencePoint(*map(column, (near, np.array([0.5, -0.4, 0.3]), np.zeros(3))))
    state = as_columns(law.init(p, np.zeros(r)))
    v_r = law.reference_velocity(column(p), column(p), Column.zeros(r), asked, state)[0]  # type: ignore[arg-type]
    wanted = np.array(asked.v.of) - 6.0 * (np.array(x.of) - np.array(asked.p.of))
    np.testing.assert_allclose([row @ v_r for row in rows], wanted, rtol=1e-6)


@settings(max_examples=10, deadline=None)
@given(k=st.integers(1, 20), r=st.integers(1, 4), novel=st.booleans(), is_whole=st.booleans(), seed=st.integers(0, 999))
def test_a_stack_takes_a_new_sample_and_learns_from_all(k: int, r: int, novel: bool, is_whole: bool, seed: int) -> None:
    """Each equation after the other, of the newest sample first: an implicit step for its torque."""
    rng, count, dt = np.random.default_rng(seed), 3, 0.1
    places = tuple(tuple(sorted(rng.choice(k, rng.integers(1, k + 1), replace=False).tolist())) for _ in range(r))
    size = sum(map(len, places))
    Gamma = positive(rng, k) if is_whole else np.diag(rng.uniform(0.5, 2.0, k))
    x, rows, torques = rng.normal(size=k), rng.normal(size=(count, size)), rng.normal(size=(count, r))
    sample, torque, weights = rng.normal(size=size), rng.normal(size=r), rng.uniform(0.5, 2.0, r)

    def equations(entries: Array) -> Array:
        W, parts = np.zeros((r, k)), np.split(entries, np.cumsum(list(map(len, places)))[:-1])
        for i, (at, part) in enumerate(zip(places, parts, strict=True)):
            W[i, list(at)] = part
        return W

    apart = equations(sample - rows[0])
    novelty = float(np.sum(weights * np.einsum("ij,jk,ik->i", apart, Gamma, apart)))
    numbers = np.array([novelty * (0.9 if novel else 1.1), 0.7, dt])
    gain = Gamma.ravel() if is_whole else np.diag(Gamma)
    given_ = x, gain, rows.ravel(), torques.ravel(), sample, torque, weights, numbers
    found = sample_stack(places, count, k, is_whole)(*map(column, given_))
    if novel:
        rows, torques = np.vstack([sample, rows[:-1]]), np.vstack([torque, torques[:-1]])
    for entries, measured in zip(rows, torques, strict=True):
        for w, tau, R in zip(equations(entries), measured, weights, strict=True):
            x = x - dt * R * Gamma @ w * (w @ x - tau) / (1.0 + dt * R * (w @ Gamma @ w))
    for part, expected in zip(found, (x, rows.ravel(), torques.ravel(), [0.7 * novel]), strict=True):
        np.testing.assert_allclose(part.of, expected, rtol=1e-9, atol=1e-9)
