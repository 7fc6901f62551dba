"""Steps of interior points, against slopes, edges and matrices that are found from the links themselves."""

from __future__ import annotations

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_pseudo_inertia, pseudo_inertia
from adaptctl.identification import interior_point
from adaptctl.identification.entropic import POSITIVE_WEIGHT, EntropicPrior
from adaptctl.identification.interior_point import (
    DIRECTIONS,
    LEAST_WEIGHT,
    RIDGE_RATIO,
    Map,
    Newton,
    Points,
    Problems,
    _raised,
)

rng = np.random.default_rng(5)
WEIGHT, LINKS, P = 0.3, 2, 23  # two links, two parameters that are positive, and one of any sign


def body() -> Array:
    """A positive definite matrix (4, 4), as pseudo-inertias are."""
    return np.asarray((root := rng.normal(size=(4, 4))) @ root.T + 0.1 * np.eye(4))


@pytest.fixture
def problem() -> Problems:
    tens = np.stack([from_pseudo_inertia(body()) for _ in range(LINKS)])
    Y = rng.normal(size=(2, 60, P))
    b = np.einsum("mni,mn->mi", Y, rng.normal(size=(2, 60)))
    return Problems.made(Y.mT @ Y, b, EntropicPrior(tens, np.array([20, 22]), np.array([0.5, 2.0])), WEIGHT)


@pytest.fixture
def newton(problem: Problems) -> Newton:
    """At any point: the multipliers are not those of the parameters."""
    scaling, values = rng.normal(size=(2, LINKS, 4, 4)), rng.uniform(0.5, 2.0, (2, LINKS, 4))
    sizes, own = rng.uniform(0.5, 2.0, (2, 2)), rng.uniform(0.5, 2.0, (2, 2))
    return Newton(problem, at(scaling, values, sizes, own))


def at(scaling: Array, values: Array, sizes: Array, own: Array) -> Points:
    links = scaling @ (values[..., None] * scaling.mT)
    tens = [[from_pseudo_inertia(one) for one in each] for each in links]
    x = np.concatenate([np.reshape(tens, (2, -1)), np.zeros((2, 3))], axis=1)
    x[:, [20, 22]], x[:, 21] = sizes * own, rng.normal(size=2)
    return Points(x, scaling, values, sizes, own)


def pairs(point: Points, k: int) -> tuple[list[Array], list[Array]]:
    """Matrices of parameters and of multipliers: links' and, of one entry, those of positive parameters."""
    primal = [G @ np.diag(V) @ G.T for G, V in zip(point.scaling[k], point.values[k], strict=True)]
    dual = [inv.T @ np.diag(V) @ inv for inv, V in zip(np.linalg.inv(point.scaling[k]), point.values[k], strict=True)]
    primal += [np.array([[s * v]]) for s, v in zip(point.sizes[k], point.own[k], strict=True)]
    return primal, dual + [np.array([[v / s]]) for s, v in zip(point.sizes[k], point.own[k], strict=True)]


def weights() -> Array:
    return np.array([WEIGHT] * 4 * LINKS + [POSITIVE_WEIGHT] * 2)


def changes(point: Points, k: int) -> Array:
    """Changes (P, P) of the parameters by unit steps, a column each."""
    out = np.eye(P)
    for i, G in enumerate(point.scaling[k]):
        columns = [from_pseudo_inertia(G @ D @ G.T) for D in DIRECTIONS]
        out[10 * i : 10 * i + 10, 10 * i : 10 * i + 10] = np.array(columns).T
    out[[20, 22], [20, 22]] = point.sizes[k]
    return out


def test_unit_steps_are_turned_into_parameters_and_slopes_back(newton: Newton) -> None:
    own, step, problem = newton.map, rng.normal(size=(2, P)), newton.problem
    curvature = own.curvature(problem.root)
    for k in range(2):
        J = changes(newton.point, k)
        np.testing.assert_allclose(own.forth(step)[k], J @ step[k], atol=1e-12)
        np.testing.assert_allclose(own.back(step)[k], J.T @ step[k], atol=1e-12)
        np.testing.assert_allclose(curvature[k], J.T @ problem.A[k] @ J, rtol=1e-9, atol=1e-8)
    parts = newton.parted(step)
    np.testing.assert_allclose(newton.joined(*parts)[:, problem.penalised], step[:, problem.penalised])
    np.testing.assert_allclose(np.square(parts[0]).sum(axis=(1, 2, 3)), np.square(step[:, :20]).sum(axis=1))


def test_parameters_without_a_divergence_have_a_little_curvature(problem: Problems) -> None:
    assert np.flatnonzero(~problem.penalised).tolist() == [21]
    problem.A[1, 21, 21] = 0.0
    expected = np.zeros((2, P))
    expected[:, 21] = RIDGE_RATIO * problem.A[0, 21, 21], 1.0
    np.testing.assert_allclose(problem.ridge, expected)
    np.testing.assert_allclose(problem.degrees, weights())
    np.testing.assert_allclose(problem.unit, [WEIGHT] * 20 + [POSITIVE_WEIGHT, 0.0, POSITIVE_WEIGHT])


def test_a_divergence_that_round_off_hides_counts_more(problem: Problems) -> None:
    x = rng.normal(size=(2, P))
    x[1] *= 1e14
    fitted = np.array([abs(b @ own) for b, own in zip(problem.b, x, strict=True)])
    np.testing.assert_allclose(problem.times(x), [1.0, LEAST_WEIGHT * fitted[1] / weights().sum()])


def test_the_lagrangian_slopes_as_the_objective_less_the_multipliers(newton: Newton) -> None:
    """Also where its divergence is lost in round-off; errors are relative to the weights."""
    problem, point, prior = newton.problem, newton.point, newton.problem.prior
    for k in range(2):
        J, multipliers, slope = changes(point, k), pairs(point, k)[1], problem.A[k] @ point.x[k] - problem.b[k]
        tens = [pseudo_inertia(ten) for ten in prior.tens]
        pull = [WEIGHT * np.linalg.inv(ten) - Z for ten, Z in zip(tens, multipliers, strict=False)]
        own = [POSITIVE_WEIGHT / s - Z[0, 0] for s, Z in zip(prior.scales, multipliers[2:], strict=True)]
        slope[[20, 22]] += own
        expected = J.T @ slope
        for i, G in enumerate(point.scaling[k]):
            expected[10 * i : 10 * i + 10] += [np.sum(pull[i] * (G @ D @ G.T)) for D in DIRECTIONS]
        np.testing.assert_allclose(newton.slope[k], expected, rtol=1e-9, atol=1e-9)
        relative = np.abs(np.delete(expected, 21)) / np.sqrt([WEIGHT] * 20 + [POSITIVE_WEIGHT] * 2)
        assert newton.slope_error[k] == pytest.approx(relative.max())


def test_a_point_ends_where_parameters_times_multipliers_are_the_weights(newton: Newton) -> None:
    for k in range(2):
        values = [np.linalg.eigvals(X @ Z).real for X, Z in zip(*pairs(newton.point, k), strict=True)]
        ratios = np.concatenate(values) / weights()
        np.testing.assert_allclose(np.sort(newton.ratios[k]), np.sort(ratios))
        assert newton.spread[k] == pytest.approx(ratios.mean())
        assert newton.error[k] == pytest.approx(max(np.abs(ratios - 1.0).max(), newton.slope_error[k]))
        size = abs(newton.problem.b[k] @ newton.point.x[k]) + WEIGHT
        assert newton.fall[k] == pytest.approx(np.abs(ratios - 1.0) @ weights() / size)


def test_the_fall_near_the_end_is_that_of_newtons_decrement(problem: Problems) -> None:
    values, own = np.full((2, LINKS, 4), WEIGHT**0.5), np.full((2, 2), POSITIVE_WEIGHT**0.5)
    newton = Newton(problem, at(rng.normal(size=(2, LINKS, 4, 4)), values, np.ones((2, 2)), own))
    for k in range(2):
        J = changes(newton.point, k)
        bent = J.T @ problem.A[k] @ J + np.diag(problem.penalised + problem.ridge[k])
        size = abs(problem.b[k] @ newton.point.x[k]) + WEIGHT
        least = newton.slope[k] @ np.linalg.solve(bent, newton.slope[k])
        assert newton.fall[k] == pytest.approx(0.5 * least / size, rel=1e-6)


def test_a_step_solves_the_equations_made_linear(newton: Newton) -> None:
    """The squares' slope is the multipliers', and V (S + T) with its transpose is twice what is left to the target."""
    bent, own, target = rng.normal(size=(2, LINKS, 4, 4)), rng.normal(size=(2, 2)), np.array([1.5, 3.0])
    bent = bent + bent.mT
    step, multipliers = newton.step(target, bent, own)
    (S, s), (T, t) = map(newton.parted, (step, multipliers))
    for k in range(2):
        J = changes(newton.point, k)
        left = J.T @ newton.problem.A[k] @ J @ step[k] + newton.slope[k] - multipliers[k]
        np.testing.assert_allclose(left, 0.0, atol=1e-7)
        for i, V in enumerate(map(np.diag, newton.point.values[k])):
            both = V @ (S + T)[k, i]
            left = 2.0 * (target[k] * WEIGHT * np.eye(4) - V @ V - bent[k, i])
            np.testing.assert_allclose(both + both.T, left, atol=1e-8)
        v = newton.point.own[k]
        np.testing.assert_allclose(v * (s + t)[k], target[k] * POSITIVE_WEIGHT - v**2 - own[k], atol=1e-8)


@pytest.mark.parametrize("what", [0, 1])
def test_a_share_of_a_step_ends_short_of_the_edge(newton: Newton, what: int) -> None:
    """At the edge a matrix has an eigenvalue of zero; small steps are taken whole."""
    steps = [np.zeros((2, P)), np.zeros((2, P))]
    steps[what][0], steps[what][1, [20, 22]] = 5.0 * rng.normal(size=P), (-10.0, 1.0)
    share = newton.share((steps[0], steps[1]), 0.9)
    S, s = newton.parted(steps[what] * share[:, None] / 0.9)
    V = newton.point.values[0, :, :, None] * np.eye(4)
    least = min(np.linalg.eigvalsh(V + S[0]).min(), (newton.point.own[0] + s[0]).min())
    assert least == pytest.approx(0.0, abs=1e-9)
    assert share[1] == pytest.approx(0.9 * newton.point.own[1, 0] / 10.0)
    assert newton.share((0.001 * steps[0], 0.001 * steps[1]), 0.9).tolist() == [1.0, 1.0]


def test_points_move_as_parameters_and_multipliers_do(newton: Newton) -> None:
    steps, share = 0.5 * rng.normal(size=(2, 2, P)), np.array([0.2, 0.1])
    moved = newton.moved(steps[0], steps[1], share)
    for k in range(2):
        (S, s), (T, t) = newton.parted(share[k] * steps[0]), newton.parted(share[k] * steps[1])
        primal, dual = pairs(newton.point, k)
        found, other = pairs(moved, k)
        for i, (G, inverse) in enumerate(
            zip(newton.point.scaling[k], np.linalg.inv(newton.point.scaling[k]), strict=True)
        ):
            np.testing.assert_allclose(found[i], primal[i] + G @ S[k, i] @ G.T, atol=1e-9)
            np.testing.assert_allclose(other[i], dual[i] + inverse.T @ T[k, i] @ inverse, rtol=1e-6)
            np.testing.assert_allclose(pseudo_inertia(moved.x[k, 10 * i : 10 * i + 10]), found[i], atol=1e-9)
        sizes = newton.point.sizes[k]
        np.testing.assert_allclose(np.ravel(found[2:]), np.ravel(primal[2:]) + sizes * s[k])
        np.testing.assert_allclose(np.ravel(other[2:]), np.ravel(dual[2:]) + t[k] / sizes)
        expected = newton.point.x[k, 20:] + share[k] * steps[0, k, 20:] * [sizes[0], 1.0, sizes[1]]
        np.testing.assert_allclose(moved.x[k, 20:], expected)


@pytest.mark.parametrize("near", [False, True])
def test_a_search_begins_at_the_prior_or_as_far_from_the_edge_as_data_push(problem: Problems, near: bool) -> None:
    """Near its end multipliers are those of the end; else P Z is a tenth of the largest push over the weights."""
    problem.b[1] *= 1e3
    given = np.tile(problem.prior.start(P), (2, 1))
    given[:, 21], given[:, 20] = 7.0, 0.2
    point = problem.start(given, near)
    for k in range(2):
        primal, dual = pairs(point, k)
        for X, ten in zip(primal, problem.prior.tens, strict=False):
            np.testing.assert_allclose(X, pseudo_inertia(ten), atol=1e-9)
        np.testing.assert_allclose(np.ravel(primal[2:]), given[k, [20, 22]])
        others = np.delete(np.arange(P), 21)
        free = (problem.b[k, 21] - problem.A[k, 21, others] @ given[k, others]) / problem.A[k, 21, 21]
        assert point.x[k, 21] == pytest.approx(free, rel=1e-6)
        slope = problem.A[k] @ point.x[k] - problem.b[k]
        slope[20] += POSITIVE_WEIGHT * (1.0 / problem.prior.scales[0] - 1.0 / 0.2)  # all others are at the prior
        roots = [np.linalg.cholesky(pseudo_inertia(ten)) for ten in problem.prior.tens]
        push = [slope[10 * i : 10 * i + 10] @ from_pseudo_inertia(R @ D @ R.T) / WEIGHT
                for i, R in enumerate(roots) for D in DIRECTIONS]  # fmt: skip
        push += (slope[[20, 22]] * given[k, [20, 22]] / POSITIVE_WEIGHT).tolist()
        times = 1.0 if near else max(1.0, 0.1 * np.abs(push).max())
        for X, Z, weight in zip(primal, dual, [WEIGHT] * 2 + [POSITIVE_WEIGHT] * 2, strict=True):
            np.testing.assert_allclose(X @ Z, times * weight * np.eye(len(X)), rtol=1e-6, atol=1e-6 * times)


def test_means_of_ratios_are_those_after_the_steps(newton: Newton) -> None:
    steps, share = 0.3 * rng.normal(size=(2, 2, P)), np.array([0.8, 0.3])
    found = newton._mean(steps[0], steps[1], share)
    moved = newton.moved(steps[0], steps[1], share)
    for k in range(2):
        means = [
            np.trace(X @ Z) / w for X, Z, w in zip(*pairs(moved, k), [WEIGHT] * 2 + [POSITIVE_WEIGHT] * 2, strict=True)
        ]
        assert found[k] == pytest.approx(sum(means) / len(weights()))


@pytest.mark.parametrize(("short", "raised"), [(-0.1, 0.0), (5e-14, 1e-13), (5e-11, 1e-9), (5e-8, 1e-7)])
def test_a_matrix_that_round_off_made_indefinite_is_raised_as_little_as_is_enough(short: float, raised: float) -> None:
    matrix = np.array([[1.0, 1.0 + short], [1.0 + short, 1.0]])
    np.testing.assert_allclose(_raised(matrix) - matrix, raised * np.eye(2), rtol=0.01, atol=1e-15)


def test_a_matrix_that_is_far_from_definite_has_its_least_eigenvalues_raised() -> None:
    np.testing.assert_allclose(np.linalg.eigvalsh(_raised(np.array([[1.0, 3.0], [3.0, 1.0]]))), [4e-7, 4.0])


def test_directions_of_links_are_orthonormal() -> None:
    flat = DIRECTIONS.reshape(10, 16)
    np.testing.assert_allclose(flat @ flat.T, np.eye(10), atol=1e-15)
    step = rng.normal(size=(1, 10))
    own = Map.of(np.eye(4)[None, None], np.ones((1, 0)), np.empty(0, dtype=np.int64))
    np.testing.assert_allclose(pseudo_inertia(own.forth(step)[0]), np.tensordot(step[0], DIRECTIONS, 1), atol=1e-15)


def test_the_residual_is_newtons_decrement_over_the_squares(problem: Problems) -> None:
    """By the divergence's second derivatives in the parameters themselves; infinite where bodies cannot be."""
    own, x = problem.of([1]), problem.prior.start(P)
    x[:20], x[20:] = np.ravel([from_pseudo_inertia(body()) for _ in range(LINKS)]), (0.4, -1.0, 3.0)
    slope = own.A[0] @ x - own.b[0] + own.prior.gradient(x, WEIGHT)
    least = slope @ np.linalg.solve(own.A[0] + own.prior.curvature(x, WEIGHT), slope)
    assert own.residual(x[None]) == pytest.approx(0.5 * least / (abs(own.b[0] @ x) + WEIGHT), rel=1e-6)
    squares = 0.5 * x @ own.A[0] @ x - own.b[0] @ x
    assert own.height(x) == pytest.approx(squares + own.prior.divergence(x, WEIGHT))
    for place, value in ((20, 0.0), (22, -1.0), (0, -1.0)):
        outside = x.copy()
        outside[place] = value
        assert own.residual(outside[None]) == np.inf


def test_equations_of_any_units_are_solved() -> None:
    units = 10.0 ** rng.uniform(-6.0, 6.0, (2, 4))
    matrices = np.stack([body(), body()]) * units[:, :, None] * units[:, None]
    x = rng.normal(size=(2, 4)) / units
    found = interior_point.solver(matrices)(np.einsum("mij,mj->mi", matrices, x))
    np.testing.assert_allclose(found * units, x * units, rtol=1e-6)


def test_a_point_near_zero_is_as_far_from_the_end_as_its_weights(newton: Newton) -> None:
    """Where the slope is none; a ratio of nothing is an error of one."""
    values, own = 1e-6 * newton.point.values, 1e-6 * newton.point.own
    near = Newton(newton.problem, at(newton.point.scaling, values, newton.point.sizes, own))
    near.__dict__["slope_error"] = np.zeros(2)
    np.testing.assert_allclose(near.error, 1.0, atol=1e-9)


@pytest.mark.parametrize("shares", [(0.2, 0.1), (0.2, 0.29), (0.31, 0.9)])
def test_short_steps_are_replaced_by_longer_ones_that_only_center(
    newton: Newton, shares: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On three times the mean of parameters times multipliers; after one to the end, and one with its corrector."""
    targets: list[Array] = []
    own, step = iter([0.6, *shares]), Newton.step
    monkeypatch.setattr(Newton, "step", lambda self, target, *bent: targets.append(target) or step(self, target, *bent))
    monkeypatch.setattr(Newton, "share", lambda self, steps, most: np.full(2, next(own)))
    moved = newton.next_point(10.0)
    np.testing.assert_array_equal(targets[0], np.ones(2))
    centered = len(targets) == 3
    assert centered == (shares[0] < 0.3)
    if centered:
        np.testing.assert_allclose(targets[2], 3.0 * newton.spread)
        best = newton.moved(*newton.step(targets[2]), np.full(2, shares[1])).x
        assert np.allclose(moved.x, best) == (shares[1] > shares[0])


@pytest.mark.parametrize(("leap", "tried"), [(10.0, 3), (np.inf, 1)])
def test_steps_that_leap_have_less_of_the_corrector(
    newton: Newton, leap: float, tried: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    corrected, bents, one = Newton._corrected, [], np.ones(2)
    monkeypatch.setattr(Newton, "_mean", lambda self, *steps: 1e9 * self.spread)
    monkeypatch.setattr(Newton, "share", lambda self, steps, most: 0.5 * one)
    monkeypatch.setattr(Newton, "moved", lambda self, *steps: None)
    monkeypatch.setattr(Newton, "_corrected", lambda self, *own: bents.append(own[2]) or corrected(self, *own))
    newton.next_point(0.0, leap)
    np.testing.assert_array_equal(bents, [one, 0.25 * one, 0.0 * one][:tried])
