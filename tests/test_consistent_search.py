"""When searches for consistent estimates end, where they begin again, and what is taken of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.identification import consistent_estimate as search
from adaptctl.identification.consistent_estimate import MAX_STEPS, MAX_WARM_STEPS, SMALL_SLOPE, _inside, _starts
from adaptctl.identification.entropic import EntropicPrior

BALL = from_center_of_mass(2.0, np.zeros(3), 0.1 * np.eye(3))
PRIOR = EntropicPrior(BALL[None], np.empty(0, dtype=np.int64), np.empty(0))


class Told:
    """Rows of searches, of which some can be chosen."""

    def __init__(self, *parts: Any) -> None:
        self.x, self.error, self.fall, self.slope = (np.asarray(part, dtype=float) for part in parts)

    def of(self, which: Any) -> Told:
        return Told(self.x[which], self.error[which], self.fall[which], self.slope[which])


class Scripted:
    """Newton's equations of which errors, falls and errors of slopes are told for every step, which adds 1 to x."""

    def __init__(self, problem: Told, point: Told) -> None:
        self.point, step = point, point.x[:, 0].astype(int)
        rows = np.arange(len(step))
        self.error, self.fall, self.slope_error = (
            told[rows, step] for told in (problem.error, problem.fall, problem.slope)
        )

    def next_point(self, small_slope: float, leap: float) -> Told:
        if np.isnan(self.error).any():
            raise np.linalg.LinAlgError
        return Told(self.point.x + 1.0, self.point.error, self.point.fall, self.point.slope)


def series(values: Any) -> Array:
    """What is told of each step, the last one for ever."""
    return np.asarray([*values, *[values[-1]] * MAX_STEPS])[: MAX_STEPS + 1]


CASES = {
    "the error is small": ([1.0, 1e-2, 1e-8, 0.9e-8], [1.0], [0.0], 60, 3, True),
    "nothing would fall": ([1.0], [1.0, 1e-14, 0.9e-14], [0.0], 60, 2, True),
    "the error stays near the end": ([0.5, 0.09], [1.0], [0.0], 60, 5, True),
    "the error stays far from the end": ([0.1], [1.0], [0.0], 60, 60, False),
    "small falls stay": ([1.0], [1e-9, 0.9e-10], [0.0], 60, 5, True),
    "larger falls stay": ([1.0], [1e-10], [0.0], 60, 60, False),
    "errors become half as large": (0.09 * 0.5 ** np.arange(40), [1.0], [0.0], 60, 24, True),
    "falls become half as large": ([1.0], 0.9e-10 * 0.5 ** np.arange(40), [0.0], 60, 14, True),
    "one smaller error begins anew": ([0.09, 0.09, 0.09, 0.09, 0.04], [1.0], [0.0], 60, 8, True),
    "errors are compared with the best": ([0.01, 0.09, 0.03, 0.05, 0.02], [1.0], [0.0], 60, 4, True),
    "the slope is not small in time": ([0.5], [1.0], [10.1], 7, 7, False),
    "the slope is not small where all else ends": ([0.5] * 7 + [0.0], [1.0], [10.1], 7, 7, False),
    "falls are small at a slope that is not": ([1.0], [1e-11], [10.1], 7, 7, False),
    "the slope is small in time": ([0.5], [1.0], [99.0] * 7 + [10.0], 7, 60, False),
}


def ended(names: list[str], most: int) -> tuple[list[float], list[bool]]:
    parts = [np.stack([series(CASES[name][k]) for name in names]) for k in range(3)]
    told: Any = Told(np.zeros((len(names), 1)), *parts)
    x, converged = search._searched(told, told, most, SMALL_SLOPE)
    return x[:, 0].tolist(), converged.tolist()


@pytest.mark.parametrize("most", [60, 7])
def test_searches_end_where_nothing_is_left_or_nothing_changes(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each by itself and all at once."""
    monkeypatch.setattr(search, "Newton", Scripted)
    names = [name for name, case in CASES.items() if case[3] == most]
    expected = [float(CASES[name][4]) for name in names], [CASES[name][5] for name in names]
    alone = [ended([name], most) for name in names]
    assert ([x for (x,), _ in alone], [end for _, (end,) in alone]) == expected
    assert ended(names, most) == expected


def test_a_search_whose_equations_cannot_be_solved_ends_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Others with it are begun again, each by itself."""
    monkeypatch.setattr(search, "Newton", Scripted)
    bad: Any = Told([[0.0]], [series([0.5, np.nan])], [series([1.0])], [series([0.0])])
    x, converged = search._searched(bad, bad, 60, SMALL_SLOPE)
    assert (x.tolist(), converged.tolist()) == ([[1.0]], [False])
    two = bad.of([0, 0])
    with pytest.raises(np.linalg.LinAlgError):
        search._searched(two, two, 60, SMALL_SLOPE)


@pytest.mark.parametrize("near", [True, False])
def test_searches_that_fail_together_are_made_alone(near: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that fails alone has no end."""
    asked: list[list[float]] = []

    def searched(problem: Any, point: Array, most: int, slope: float) -> tuple[Array, Array]:
        assert (most, slope) == (MAX_WARM_STEPS if near else MAX_STEPS, 3.0)
        asked.append(point[:, 0].tolist())
        if 1.0 in point:
            raise FloatingPointError
        return point + 0.5, point[:, 0] > 1.0

    def of(which: list[int]) -> Any:
        return SimpleNamespace(of=of, start=lambda x, own: x if own == near else None)

    monkeypatch.setattr(search, "_searched", searched)
    found = search._ends(of([]), np.array([[0.0], [1.0], [2.0]]), near, 3.0)
    assert asked == [[0.0, 1.0, 2.0], [0.0], [1.0], [2.0]]
    np.testing.assert_array_equal([end for end, _ in found], [[0.5], [np.nan], [2.5]])
    assert [converged for _, converged in found] == [False, False, True]


@pytest.mark.parametrize(
    ("times", "far"),
    [(1.0, False), (29.0, False), (31.0, True), (1.0 / 29.0, False), (1.0 / 31.0, True), (-99.0, False)],
)
def test_searches_begin_at_a_multiple_of_links_that_are_far_from_what_data_ask_for(times: float, far: bool) -> None:
    """After starts that are given and the prior itself; then again, with all slopes small."""
    A = np.diag(np.arange(1.0, 12.0))[None].repeat(2, 0)
    origin = np.tile([*BALL, 5.0], (2, 1))
    links = np.array([[*BALL, 0.0]] * 2)
    b = np.einsum("mij,mj->mi", A, links) * np.array([[times], [1.0]])
    b[:, 10] = 1e6  # is of no link
    problem: Any = SimpleNamespace(A=A, b=b, prior=PRIOR)
    given = np.ones((2, 11))
    first, *others = list(_starts(problem, origin, given))
    np.testing.assert_array_equal(first[0], given)
    assert (first[1], first[2]) == (True, SMALL_SLOPE)
    assert [(near, slope) for _, near, slope in others] == [
        (False, slope) for slope in (SMALL_SLOPE, np.inf) for _ in range(1 + far)
    ]
    for x, _, _ in others[:: 1 + far]:
        np.testing.assert_array_equal(x, origin)
    for x, _, _ in others[1::2] if far else ():
        np.testing.assert_allclose(x[0], [*times * BALL, 5.0])
        np.testing.assert_array_equal(x[1], origin[1])
    assert len(list(_starts(problem, origin, None))) == len(others)


def test_links_that_data_tell_nothing_of_have_no_multiple() -> None:
    problem: Any = SimpleNamespace(A=np.zeros((1, 10, 10)), b=BALL[None] / (BALL @ BALL), prior=PRIOR)
    assert len(list(_starts(problem, BALL[None], None))) == 2


def taken(ends: list[list[tuple[float, bool]]], heights: dict[float, float], residual: float = 1.0) -> float:
    """What is taken of scripted ends of rounds of a search, from starts that are near for all but the last two."""
    rounds = iter(ends)
    own = SimpleNamespace(height=lambda x: heights.get(float(x[0]), 0.0), residual=lambda x: residual)
    problem = SimpleNamespace(of=lambda which: own, b=np.zeros((1, 10)), prior=PRIOR)
    patch = pytest.MonkeyPatch()
    with patch.context() as inside:
        starts = [(np.zeros((1, 10)), len(ends) - k > 2, 0.0) for k in range(len(ends))]
        inside.setattr(search, "_starts", lambda *_: starts)
        inside.setattr(search, "_ends", lambda *_: [(np.full(10, x), ok) for x, ok in next(rounds)])
        inside.setattr(search, "_inside", lambda x, _: x)
        return float(search._estimates(problem, None)[0, 0])  # type: ignore[arg-type]


def test_the_first_end_that_is_a_minimum_is_taken_or_else_the_lowest() -> None:
    """One that is nearly a minimum too, unless the search began near the end and was cut short."""
    heights = {1.0: 3.0, 2.0: 1.0, 3.0: 2.0, 4.0: np.inf}
    assert taken([[(1.0, False)], [(2.0, True)], [(3.0, True)]], heights) == 2.0
    assert taken([[(1.0, False)], [(2.0, False)], [(3.0, False)]], heights) == 2.0
    assert taken([[(4.0, False)], [(np.nan, False)], [(3.0, False)]], heights) == 3.0
    assert taken([[(4.0, False)], [(np.nan, False)]], heights) == BALL[0]
    assert taken([[(1.0, False)], [(3.0, False)], [(2.0, False)]], heights, 0.9e-3) == 3.0
    assert taken([[(1.0, False)], [(3.0, False)], [(2.0, False)]], heights, 1e-3) == 2.0


@pytest.mark.parametrize(("least", "moved"), [(2e-14, False), (0.5e-14, True), (-1e-6, True), (-1e3, True)])
def test_links_outside_the_cone_are_brought_a_little_nearer_to_the_prior(least: float, moved: bool) -> None:
    """By no more than round-off, or about as much as they are outside; other parameters stay."""
    values = np.array([1.0, 1.0, 1.0, least])  # of the pseudo-inertia, the last one its mass
    x = np.array([least, 0.0, 0.0, 0.0, 2.0, 0.0, 2.0, 0.0, 0.0, 2.0, 7.0])
    found = _inside(x, PRIOR)
    assert found[10] == 7.0
    inside = np.linalg.eigvalsh(PRIOR.matrices(found))[0]
    assert inside[0] > 1e-14 * inside[-1]
    assert (not np.array_equal(found, x)) is moved
    share = (found[0] - x[0]) / (BALL[0] - x[0])
    assert share <= 4.0 * max(-values.min(), 1e-13) / (BALL[0] - values.min())
