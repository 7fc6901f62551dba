"""Theorems of discrete adaptation: within their bounds nothing rises, beyond them something does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from nightly import mostly_at_night

from adaptctl.arrays import Array, stacked
from adaptctl.control import Gradient, ReleasedGradient
from adaptctl.control.adaptation.law import AdaptationLaw, Period
from adaptctl.errors import InputError
from adaptctl.scalars import Column

T, R, K, PROBLEMS = 1e-3, 3, 5, 2000
GAMMA = np.array([0.1, 0.5, 1.0, 3.0, 10.0])


class Loop(NamedTuple):
    """Linear error equations M (s+ - s) = -T (K s - Y b) of many problems, with the sampling ratio h each."""

    M: Array
    damping: Array
    h: Array

    def advanced(self, s: Array, b: Array, Y: Array) -> Array:
        force = np.einsum("nij,nj->ni", Y, b) - self.damping * s
        return np.asarray(s + T * np.linalg.solve(self.M, force[..., None])[..., 0])


def loops(rng: np.random.Generator, h: float) -> Loop:
    """Random mass matrices, their damping scaled to the sampling ratio."""
    A = rng.normal(size=(PROBLEMS, R, R))
    M = A @ np.swapaxes(A, 1, 2) + 0.05 * np.eye(R)
    damping = rng.uniform(0.2, 5.0, (PROBLEMS, R))
    largest = np.linalg.eigvals(np.linalg.solve(M, damping[:, :, None] * np.eye(R))).real.max(axis=1)
    return Loop(M, damping * (h / (T * largest))[:, None], np.full(PROBLEMS, h))


def regressors(rng: np.random.Generator, loop: Loop, a: Array) -> Array:
    """Random Y (n, r, k) with T lambda_max(K^-1 Y Gamma Y') = a."""
    Y = rng.normal(size=(PROBLEMS, R, K))
    scaled = Y * np.sqrt(GAMMA) / np.sqrt(loop.damping)[:, :, None]
    return np.asarray(Y * np.sqrt(a / T)[:, None, None] / np.linalg.norm(scaled, ord=2, axis=(1, 2))[:, None, None])


def columns(rows: Array) -> Column:
    return Column(list(rows.T))


Energy = Callable[[Loop, Array, Array, Any], Array]


def V(loop: Loop, s: Array, b: Array, memory: Any) -> Array:
    """s'Ms/2 + b'Gamma^-1 b/2."""
    return 0.5 * np.einsum("ni,nij,nj->n", s, loop.M, s) + 0.5 * (b**2 / GAMMA).sum(axis=1)


def W(loop: Loop, s: Array, b: Array, memory: Any) -> Array:
    """The trapezium's: s'(M - T K/2)s/2 + b'Gamma^-1 b/2."""
    return V(loop, s, b, memory) - 0.25 * T * (loop.damping * s**2).sum(axis=1)


def normalised(loop: Loop, s: Array, b: Array, memory: Any) -> Array:
    """s'Ms/(2n) + b'Gamma^-1 b/2."""
    kinetic = 0.5 * np.einsum("ni,nij,nj->n", s, loop.M, s)
    return np.asarray(kinetic / np.broadcast_to(memory.n[0], len(s)) + 0.5 * (b**2 / GAMMA).sum(axis=1))


def largest_rise(
    law: Callable[[Loop], AdaptationLaw[Any]], energy: Energy, h: float, a: Callable[[Any], Array], ticks: int = 40
) -> float:
    """The largest relative rise in a tick, of any problem, with Y drawn anew at every tick; the law's own code."""
    rng = np.random.default_rng(0)
    loop = loops(rng, h)
    adaptation = law(loop)
    memory: Any = adaptation.initial_state(None, np.zeros(K), np.zeros(R), np.zeros(R), T)  # type: ignore[arg-type]
    s, b, worst = rng.normal(size=(PROBLEMS, R)), rng.normal(size=(PROBLEMS, K)) * np.sqrt(GAMMA), 0.0
    s *= np.exp(rng.uniform(-6.0, 6.0, (PROBLEMS, 1)))
    for _ in range(ticks):
        Y = regressors(rng, loop, a(rng))
        after = loop.advanced(s, b, Y)

        def gradient(x: Column, Y: Array = Y) -> Column:
            entries = stacked(x.of, (PROBLEMS,))
            return columns(np.einsum("nij,ni->nj", Y, entries))

        none = Column.zeros(R)
        period = Period(gradient, columns(s), columns(after), none, none, none, T, T, columns(loop.damping))
        estimate, later = adaptation.law(None, columns(b), period, memory)  # type: ignore[arg-type]
        new = stacked(estimate.of, (PROBLEMS,))
        before = energy(loop, s, b, later if isinstance(adaptation, ReleasedGradient) else memory)
        if isinstance(adaptation, ReleasedGradient):
            n = np.broadcast_to(np.asarray(memory.n[0]), PROBLEMS)
            before = energy(loop, s, b, memory._replace(n=[n]))
        now = energy(loop, after, new, later)
        worst = max(worst, float(((now - before) / np.abs(before)).max()))
        s, b, memory = after, new, later
        rest = np.abs(s).max(axis=1) < 1e-8
        s[rest] = rng.normal(size=(int(rest.sum()), R))
    return worst


def constant(a: float) -> Callable[[Any], Array]:
    return lambda rng: np.full(PROBLEMS, a)


@pytest.mark.parametrize("h", mostly_at_night([0.1, 0.8, 1.5, 1.9], 0.8, 1.9))
def test_the_backward_rule_lets_v_fall_while_a_plus_h_is_below_two(h: float) -> None:
    backward = Gradient(GAMMA, cap=0.0)
    assert largest_rise(lambda loop: backward, V, h, lambda rng: rng.uniform(0.0, 0.999 * (2.0 - h), PROBLEMS)) < 1e-12
    assert largest_rise(lambda loop: backward, V, h, constant(2.5 * (2.0 - h))) > 1e-3


@pytest.mark.parametrize("h", mostly_at_night([0.1, 1.0, 1.99], 1.99))
def test_the_trapezium_lets_its_function_fall_while_a_is_below_two(h: float) -> None:
    trapezium = Gradient(GAMMA, 0.5, 0.0)
    assert largest_rise(lambda loop: trapezium, W, h, lambda rng: rng.uniform(0.0, 1.999, PROBLEMS)) < 1e-12
    assert largest_rise(lambda loop: trapezium, W, h, constant(2.5)) > 1e-3


def test_eulers_rule_lets_v_rise_where_the_others_do_not() -> None:
    assert largest_rise(lambda loop: Gradient(GAMMA, 0.0, 0.0), V, 0.2, constant(1.5)) > 1e-2
    assert largest_rise(lambda loop: Gradient(GAMMA, 1.0, 0.0), V, 0.2, constant(1.5)) < 1e-12


def decays(loop: Loop) -> float:
    """The least eigenvalue of M^-1 K of all problems."""
    return float(np.linalg.eigvals(np.linalg.solve(loop.M, loop.damping[:, :, None] * np.eye(R))).real.min())


def any_gain(rng: Any) -> Array:
    return np.asarray(10.0 ** rng.uniform(-2.0, 4.0, PROBLEMS))


@pytest.mark.parametrize("h", mostly_at_night([0.1, 1.0, 1.8], 1.8))
def test_the_released_normaliser_lets_its_function_fall_for_every_a(h: float) -> None:
    def within(loop: Loop) -> ReleasedGradient:
        return ReleasedGradient(GAMMA, 0.5 * (2.0 - h) * decays(loop), 2.0 / (2.0 - h))

    def too_fast(loop: Loop) -> ReleasedGradient:
        return ReleasedGradient(GAMMA, 1e3, 2.0 / (2.0 - h))

    def too_little(loop: Loop) -> ReleasedGradient:
        return ReleasedGradient(GAMMA, 1e-3, 0.1 / (2.0 - h))

    assert largest_rise(within, normalised, h, any_gain) < 1e-12
    assert largest_rise(too_fast, normalised, h, any_gain) > 1e-3
    assert largest_rise(too_little, normalised, h, constant(30.0)) > 1e-3


def test_the_share_has_no_theorem() -> None:
    """V itself rises with the share where a is large: what the docs say is only experience."""
    assert largest_rise(lambda loop: Gradient(GAMMA), V, 1.0, constant(100.0)) > 1e-3


def test_the_share_is_one_as_the_gain_goes_to_zero() -> None:
    small, none = (largest_rise(lambda loop, c=c: Gradient(GAMMA, cap=c), V, 1.0, constant(1e-6)) for c in (2.0, 0.0))
    assert abs(small - none) < 1e-6


@pytest.mark.parametrize("h", [0.1, 1.5])
def test_the_default_lets_v_fall_while_a_is_below_a_half_for_every_accepted_h(h: float) -> None:
    assert largest_rise(lambda loop: Gradient(GAMMA), V, h, lambda rng: rng.uniform(0.0, 0.5, PROBLEMS)) < 1e-12


def test_the_trapezium_with_the_cap_lets_its_function_fall_while_a_is_below_two() -> None:
    trapezium = Gradient(GAMMA, 0.5)
    assert largest_rise(lambda loop: trapezium, W, 1.5, lambda rng: rng.uniform(0.0, 1.999, PROBLEMS)) < 1e-12


def test_a_step_is_worth_at_most_twice_what_the_damping_takes_and_a_share_of_it_beyond() -> None:
    """T n x'Gamma x <= 2 s'Ks, and s'Ks/cap where a whole step would be worth more, whatever Y."""
    rng = np.random.default_rng(1)
    for scale in 10.0 ** np.linspace(-6, 6, 49):
        Y, before, s, damping = scale * rng.normal(size=(R, K)), *rng.normal(size=(2, R)), rng.uniform(0.1, 10.0, R)
        period = Period(
            lambda x, Y=Y: Column((np.asarray(x.of) @ Y).tolist()),
            Column(before.tolist()), Column(s.tolist()), *(Column.zeros(R),) * 3, T, T, Column(damping.tolist()),
        )  # fmt: skip
        moved, _ = Gradient(GAMMA).law(None, Column.zeros(K), period, None)  # type: ignore[arg-type]
        power, whole = s @ (damping * s), T * (s @ Y) @ (GAMMA * (s @ Y))
        assert -(s @ Y) @ np.asarray(moved.of) <= power * (0.5 if whole > 2.0 * power else 2.0) * (1.0 + 1e-12)


def test_nothing_is_learned_at_rest_and_while_frozen() -> None:
    rest, one = Column.zeros(R), Column(np.ones(R).tolist())
    for s, elapsed in ((rest, T), (one, 0.0)):
        period = Period(lambda x: Column([float(sum(x.of))] * K), s, s, rest, rest, rest, T, elapsed, one)
        for law in (Gradient(GAMMA), ReleasedGradient(GAMMA)):
            memory: Any = law.initial_state(None, np.zeros(K), np.zeros(R), np.zeros(R), T)  # type: ignore[arg-type]
            moved, _ = law.law(None, Column.zeros(K), period, memory)  # type: ignore[arg-type]
            np.testing.assert_array_equal(moved.of, 0.0)


@pytest.mark.parametrize(
    ("law", "says"),
    [
        (lambda: Gradient(GAMMA, theta=1.5), "theta: expected a number from 0"),
        (lambda: Gradient(GAMMA, cap=-1.0), "cap: expected a finite number of at least 0"),
        (lambda: ReleasedGradient(GAMMA, release=0.0), "release: expected a positive finite number"),
        (lambda: ReleasedGradient(GAMMA, share=np.nan), "share: expected a positive finite number"),
    ],
)
def test_settings_out_of_range_are_refused(law: Callable[[], object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        law()
