"""Consistent estimates of hard problems: every one ends at its minimum, by conditions that are checked on their own."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest
from nightly import mostly_at_night
from random_trees import random_chain

from adaptctl.arrays import Array
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.identification import entropic
from adaptctl.identification.entropic import EntropicPrior, consistent_estimate, kkt_residual

SIZE = 4


def problem(seed: int) -> tuple[Array, Array, EntropicPrior, float]:
    """Four links, two positive parameters and two of any sign: contradictory, rank-short, or of scales 1e-6 to 1e6."""
    rng, P = np.random.default_rng(seed), 10 * SIZE + 4
    tens = np.stack([link.inertia for link in random_chain(seed, SIZE).links])
    prior = EntropicPrior(tens, np.array([P - 4, P - 3]), 10.0 ** rng.uniform(-3.0, 1.0, 2))
    rank = int(rng.integers(1, P)) if seed % 3 == 1 else P
    scales = 10.0 ** rng.uniform(-6.0, 6.0, P if seed % 3 == 2 else 1)
    Y = rng.normal(size=(3 * P, rank)) @ rng.normal(size=(rank, P)) * scales
    true = prior.start(P) * (1.0 + 0.3 * rng.normal(size=P))
    torque = Y @ (-(10.0 ** rng.uniform(-2.0, 3.0)) * true if seed % 3 == 0 else true)
    torque += 0.01 * np.abs(torque).max() * rng.normal(size=len(torque))
    return Y.T @ Y, Y.T @ torque, prior, 10.0 ** rng.uniform(-4.0, 2.0)


@pytest.mark.parametrize("count", mostly_at_night([45, 1000], 45))
def test_every_problem_ends_at_a_consistent_minimum_in_like_time(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also those whose data ask for negative masses, or have columns that no data tell apart. Work is in steps."""
    slope, taken = entropic._Squares.slope, Counter[int]()

    def counted(self: entropic._Squares, *given: Any) -> Array:
        taken[seed] += 1
        return slope(self, *given)

    monkeypatch.setattr(entropic._Squares, "slope", counted)
    residuals = []
    for seed in range(count):
        A, b, prior, weight = problem(seed)
        x = consistent_estimate(A, b, prior, weight)
        residuals.append(kkt_residual(A, b, prior, weight, x))
        assert all(np.linalg.eigvalsh(pseudo_inertia(ten))[0] > 0.0 for ten in x[: 10 * SIZE].reshape(-1, 10))
        assert np.all(x[prior.positive] > 0.0)
    assert max(residuals) < 1e-4
    assert np.median(residuals) < 1e-9
    steps = np.array(list(taken.values()))
    assert len(steps) == count
    assert steps.max() <= 3.0 * np.median(steps)


def test_the_residual_is_that_of_the_objectives_slope() -> None:
    """By differences of the objective along relative steps; at the prior itself it is not small."""
    A, b, prior, weight = problem(4)
    assert kkt_residual(A, b, prior, weight, prior.start(len(b))) > 1e-3
    x = consistent_estimate(A, b, prior, weight)
    rng = np.random.default_rng(0)

    def objective(y: Array) -> float:
        return float(0.5 * y @ A @ y - b @ y + prior.divergence(y, weight))

    for _ in range(20):
        step = 1e-5 * rng.normal(size=len(x)) * np.abs(x)
        if np.isfinite(objective(x + step)) and np.isfinite(objective(x - step)):
            assert objective(x + step) + objective(x - step) >= 2.0 * objective(x) - 1e-9 * abs(objective(x))
            slope = objective(x + step) - objective(x - step)
            bent = objective(x + step) + objective(x - step) - 2.0 * objective(x)
            assert abs(slope) < 0.2 * abs(bent) + 1e-9 * (1.0 + abs(objective(x)))


def test_a_warm_start_ends_where_a_cold_one_does() -> None:
    A, b, prior, weight = problem(7)
    cold = consistent_estimate(A, b, prior, weight)
    near = consistent_estimate(A, b, prior, 30.0 * weight)
    np.testing.assert_allclose(A @ consistent_estimate(A, b, prior, weight, near), A @ cold, rtol=1e-6, atol=1e-6)
