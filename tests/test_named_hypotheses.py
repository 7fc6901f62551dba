"""Which hypothesis about columns is named, by scripted errors; and zeros and instants that are searched for."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.errors import AdaptctlError
from adaptctl.identification import hypotheses, listed_hypotheses, taking
from adaptctl.identification.drives_content import PayloadEntry
from adaptctl.identification.filtered_dynamics import Rows
from adaptctl.identification.hypotheses import TriedHypothesis, _alike, _or_else, _Trial, _tried
from adaptctl.identification.least_squares import weighted_least_squares
from adaptctl.identification.listed_hypotheses import Hypothesis, _zero
from adaptctl.identification.momentum_balance import PackedRegressor
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.taking import _instant


class Errors(NamedTuple):
    """Equations of which errors are told: of least squares, and of the consistent estimate."""

    least: float
    consistent: float


def named(
    each: Sequence[tuple[float, float]],
    monkeypatch: pytest.MonkeyPatch,
    dof: int = 3,
    **more: Any,
) -> tuple[list[_Trial], int | None, list[Errors]]:
    """What is tried of hypotheses with such errors, and the best one, where the log as it is has an error of 1."""
    asked: list[Errors] = []

    def failing() -> Any:
        raise AdaptctlError

    def consistent(fits: Sequence[tuple[Errors, Any]], start: Any) -> list[str]:
        asked.extend(equations for equations, _ in fits)
        return ["consistent"] * len(fits)

    def made(k: int, own: tuple[float, float]) -> Hypothesis:
        return Hypothesis(f"kind {k}", f"{k}", "do", failing if own[0] == 0.0 else lambda: Errors(*own), **more)  # type: ignore[arg-type, return-value]

    monkeypatch.setattr(hypotheses, "relative_error", lambda errors, x: getattr(errors, x))
    monkeypatch.setattr(hypotheses, "listed_hypotheses", lambda *_: [made(k, own) for k, own in enumerate(each)])
    rows: Any = SimpleNamespace(least=lambda equations: ("least", None), consistent=consistent)
    rows.evidence = SimpleNamespace(mechanism=SimpleNamespace(dof=dof))
    found, best = _tried(rows, None, 1.0, None)  # type: ignore[arg-type]
    return found, best, asked


@pytest.mark.parametrize(
    ("each", "best"),
    [
        ([(0.5, 0.6), (0.4, 0.7)], 0),  # the other takes less than a third off
        ([(0.5, 0.6), (0.4, 0.5)], 1),
        ([(0.5, 0.66)], 0),
        ([(0.5, 0.67)], None),
        ([(1.04, 0.6)], 0),
        ([(1.06, 0.6)], None),
        ([(0.32, 0.2), (0.3, 0.3)], 1),  # least squares say that the first is no better
        ([(0.31, 0.2), (0.3, 0.3)], 0),
        ([(0.31, 0.3), (0.3, 0.3)], 0),
        ([], None),
    ],
)
def test_that_hypothesis_is_named_that_fits_best_and_takes_a_third_off(
    each: list[tuple[float, float]], best: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert named(each, monkeypatch)[1] == best


def test_hypotheses_that_least_squares_do_not_tell_apart_are_tried_as_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twenty at most; one whose equations fail is none."""
    found, _, asked = named([(0.5, 0.9), (0.0, 0.0), (0.499, 0.9), (0.3, 0.9)], monkeypatch)
    assert [errors.least for errors in asked] == [0.3, 0.5, 0.499]
    assert [own.trial.words for own in found] == ["0", "2", "3"]
    assert [own.trial.is_bound for own in found] == [False] * 3
    found, _, asked = named([(0.5, 0.9)] * 23, monkeypatch)
    assert len(asked) == 20
    assert sum(own.trial.is_bound for own in found) == 3


@pytest.mark.parametrize(
    ("dof", "error", "named_so"), [(6, 0.81, True), (6, 0.82, False), (2, 0.66, True), (2, 0.68, False)]
)
def test_what_is_only_warned_of_asks_as_much_of_three_joints(
    dof: int, error: float, named_so: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert (named([(0.5, error)], monkeypatch, dof, refuses=False)[1] == 0) is named_so


def test_what_does_not_hold_of_its_own_parameters_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    assert named([(0.5, 0.5)], monkeypatch, holds=lambda x: x != "consistent")[1] is None
    found, best, _ = named([(0.5, 0.5)], monkeypatch, holds=lambda x: x == "consistent", told=lambda x: f", by {x}")
    assert best == 0
    assert found[0].trial.words == "0, by consistent"


def trial(kind: str, words: str, error: float, bound: bool = False) -> _Trial:
    own = Hypothesis(kind, words, f"mend {words}", None)  # type: ignore[arg-type]
    return _Trial(own, TriedHypothesis(kind, words, error, bound), None, np.zeros(1), np.zeros(1))  # type: ignore[arg-type]


def test_other_meanings_are_told_that_fit_as_well_to_a_twentieth() -> None:
    """Of each kind the best."""
    best = trial("a", "best", 0.2)
    others = [trial("b", "b2", 0.205), trial("b", "b1", 0.201), trial("c", "c1", 0.211), trial("a", "a2", 0.2)]
    found = _or_else([best, *others, trial("d", "d1", 0.1, True), trial("e", "e1", 0.2099)], best)
    assert found == ("; or, as the log tells as well, b1: mend b1; or, as the log tells as well, e1: mend e1")
    assert _alike(others, 0.2).outcome == "a2; b1 (1 more of its kind)"
    assert _alike([trial("b", "b1", 0.1, True)], 0.2).outcome == "nothing"


@pytest.mark.parametrize("off", [0.3, -0.2, 1e-4])
def test_a_zero_is_that_at_which_least_squares_fits_best(off: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a torque that rises with the third power of an angle, by a factor that is not known."""
    position = np.linspace(-1.0, 1.0, 200)

    def moved(rows: Any, change: Array, shift: Array) -> PackedRegressor:
        np.testing.assert_array_equal(change, np.eye(2))
        angle = position + shift[1]
        columns = np.stack([angle, np.ones(200)], axis=-1)
        return PackedRegressor.of(np.stack([np.zeros((200, 2)), columns ** [[3.0, 1.0]]], axis=1))

    torque = np.column_stack([np.zeros(200), 3.0 * (position + off) ** 3 + 0.5])

    def sums(regressor: PackedRegressor, own: Array) -> NormalEquations:
        whole = regressor.whole
        made = Rows(1.0, position, whole, own, own, own, np.zeros(200, dtype=int), np.ones(200, dtype=bool))
        return NormalEquations.of(made, np.zeros(200, dtype=int), 1, np.ones((200, 2), dtype=bool))

    def least(equations: NormalEquations) -> tuple[Array, Array]:
        return weighted_least_squares(equations, np.arange(equations.moment.shape[-1]))

    monkeypatch.setattr(listed_hypotheses, "_moved", moved)
    rows: Any = SimpleNamespace(rows=SimpleNamespace(torque=torque), sums=sums, least=least)
    assert _zero(rows, np.array([0.0, 1.0])) == pytest.approx(off, rel=0.02, abs=1e-6)


@pytest.mark.parametrize(
    ("steps", "found"),
    [
        ((0.9, -0.2, 0.7, 0.1), 0.8),
        ((-0.9, -0.6, -0.5), -1.5),
        ((0.3, 0.9e-3, 0.4), 0.3009),
        ((0.3, 1.1e-3, 0.4), 0.7011),
    ],
)
def test_zeros_are_searched_by_three_steps_of_half_a_radian_at_most_until_they_are_small(
    steps: tuple[float, ...], found: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    each = iter(steps)
    regressor = PackedRegressor.of(np.ones((5, 1, 2)))
    monkeypatch.setattr(listed_hypotheses, "_moved", lambda *_: regressor)

    def least(own: PackedRegressor) -> tuple[Array, None]:
        count = own.shape[1]
        return np.ones(2) if count == 2 else np.array([1.0, 1.0, next(each)]), None

    rows: Any = SimpleNamespace(rows=SimpleNamespace(torque=None), sums=lambda own, torque: own, least=least)
    assert _zero(rows, np.ones(1)) == pytest.approx(found)


@pytest.mark.parametrize("instant", [12.3456, 10.15, 19.87])
def test_a_payload_is_taken_at_the_instant_that_explains_its_logs_best(
    instant: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To half of a hundredth of two hundredths of the log's time."""
    place = SimpleNamespace(link="b")
    monkeypatch.setattr(taking, "payload_place", lambda *_: place)
    monkeypatch.setattr(taking, "weighted_least_squares", lambda *_: (None, np.array([4.0])))
    seen: list[Any] = []

    def between(edges: Array, payload: Any, evidence: Any, cutoff: float, columns: list[int], weight: Array) -> Any:
        seen.append((columns, weight.tolist()))
        return edges, None

    def explained(edges: Array, moment: None, shared: int) -> Array:
        assert shared == 2
        return -np.abs(edges[1:-1] - instant)

    monkeypatch.setattr(taking, "_between", between)
    monkeypatch.setattr(taking, "_explained", explained)
    mechanism = SimpleNamespace(description=SimpleNamespace(body_names=("a", "b")))
    times = [np.array([15.0, 20.0]), np.array([10.0, 14.0]), np.array([0.0, 99.0])]
    logs = [SimpleNamespace(time=t, source=name) for t, name in zip(times, ("x.csv", "x.csv", "y.csv"), strict=True)]
    evidence: Any = SimpleNamespace(mechanism=mechanism, logs=logs, independent=lambda _: np.array([3, 7]))
    evidence.sums = lambda *_: None
    found = _instant(PayloadEntry(log="x.csv", link="b"), evidence, 9.0)
    assert found == pytest.approx(instant, abs=0.5 * 0.2 / 99.0 + 1e-9)
    assert seen == [([3, 7, *range(10, 20)], [0.25])] * 2
