"""Sums of squares, least squares on them, and the choice of settings, against NumPy on rows written out."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.description import JointKind
from adaptctl.errors import InputError
from adaptctl.identification.choice import _near, _Selection, _tried, cutoffs_for, judged_at, predicted_squares
from adaptctl.identification.contradictions import forced
from adaptctl.identification.energy_differences import _integral
from adaptctl.identification.fit import FitSettings
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.held_out import late_blocks
from adaptctl.identification.hypotheses import LogMeaning, TriedHypothesis, _alike, validate_meaning
from adaptctl.identification.hypothesis_rows import _each_joint, relative_error
from adaptctl.identification.least_squares import _regressed, each_weighted, least_squares, weighted_least_squares
from adaptctl.identification.normal_equations import NormalEquations, block_edges, blocks_of
from adaptctl.identification.preparation import PreparationStep
from adaptctl.identification.torque_constants import validate_one_robot

choice = import_module("adaptctl.identification.choice")
SETTINGS = FitSettings(FrictionModel(), 1.0, 5.0)
TRUTH = np.array([1.0, -2.0, 0.5, 3.0])


def rows_of(noise: tuple[float, float] = (0.0, 0.0), count: int = 60) -> tuple[Any, Array]:
    """Rows of two joints and four parameters, and a mask of those that count."""
    rng = np.random.default_rng(0)
    Y = rng.normal(size=(count, 2, 4)) * [1.0, 1e3, 1e-3, 1.0]
    torque = Y @ (TRUTH / [1.0, 1e3, 1e-3, 1.0]) + np.array(noise) * rng.normal(size=(count, 2))
    rows = SimpleNamespace(regressor=Y, torque=torque, log=np.repeat([0, 1], count // 2), time=np.arange(count) % 30.0)
    return rows, rng.random((count, 2)) < 0.8


def equations(rows: Any, used: Array, blocks: int = 3) -> NormalEquations:
    return NormalEquations.of(rows, np.arange(len(used)) % blocks, blocks, used)


def test_sums_over_blocks_are_those_of_the_rows_written_out() -> None:
    rows, used = rows_of((0.1, 0.2))
    whole = equations(rows, used)
    x, chosen = TRUTH, np.isin(np.arange(60) % 3, [0, 2])
    some = whole.over([0, 2])
    misfit = (np.where(used, rows.regressor @ x - rows.torque, 0.0)[chosen] ** 2).sum(axis=0)
    np.testing.assert_allclose(some.misfit(x), misfit)
    np.testing.assert_allclose(whole.chosen([0, 2]).misfit(x), misfit)
    np.testing.assert_allclose(some.count[0], used[chosen].sum(axis=0))
    np.testing.assert_allclose(whole.square.sum(axis=0), (np.where(used, rows.torque, 0.0) ** 2).sum(axis=0))
    np.testing.assert_allclose(whole.plus(whole).misfit(x), 2.0 * whole.misfit(x))
    assert whole.without([]) is whole
    np.testing.assert_allclose(whole.without([1]).misfit(x), whole.misfit(x) * [1.0, 0.0])
    assert whole.without([0]).count.sum(axis=0).tolist() == [0.0, used[:, 1].sum()]
    A, b = whole.whitened(np.array([2.0, 0.5]))
    flat = (rows.regressor * (used / [2.0, 0.5])[..., None]).reshape(-1, 4)
    np.testing.assert_allclose(A, flat.T @ flat)
    np.testing.assert_allclose(b, flat.T @ (np.where(used, rows.torque, 0.0) / [2.0, 0.5]).ravel())


@pytest.mark.parametrize("columns", [[0, 1, 2, 3], [1, 3]])
def test_least_squares_are_numpys_in_any_units(columns: list[int]) -> None:
    rows, used = rows_of((0.1, 0.1))
    flat, torque = rows.regressor[used], rows.torque[used]
    A, b = equations(rows, used).whitened(np.ones(2))
    units = np.array([1.0, 1e3, 1e-3, 1.0])[columns]
    expected = np.linalg.lstsq(flat[:, columns] / units, torque)[0]
    found = least_squares(A, b, np.array(columns))
    np.testing.assert_allclose(found[columns] * units, expected, rtol=1e-6)
    assert not np.delete(found, columns).any()
    twin = np.r_[0, 0, 1:4]  # a column twice: halves of it, the least of all solutions
    double = least_squares(A[np.ix_(twin, twin)], b[twin], np.arange(5))
    whole = least_squares(A, b, np.arange(4))
    np.testing.assert_allclose(double, [0.5 * whole[0], 0.5 * whole[0], *whole[1:]], rtol=1e-6)


def test_a_joint_of_little_noise_counts_for_more() -> None:
    rows, used = rows_of((1e-3, 1.0), 600)
    x, deviations = weighted_least_squares(equations(rows, used), np.arange(4))
    np.testing.assert_allclose(deviations, [1e-3, 1.0], rtol=0.1)
    np.testing.assert_allclose(x * [1.0, 1e3, 1e-3, 1.0], TRUTH, atol=1e-3)
    exact, _ = rows_of()
    assert weighted_least_squares(equations(exact, used[:60]), np.arange(4))[1].max() < 1e-5


def test_each_block_is_weighted_by_itself_also_where_one_tells_nothing_of_a_column() -> None:
    rows, used = rows_of((1e-3, 1.0), 600)
    parts = [equations(rows, used & here) for here in (rows.time[:, None] < 10.0, rows.time[:, None] >= 5.0)]
    parts[0].normal[:, :, 3], parts[0].normal[..., 3], parts[0].moment[..., 3] = 0.0, 0.0, 0.0
    for *each, own in zip(*each_weighted(NormalEquations.stacked(parts), np.arange(4)), parts, strict=True):
        for found, alone in zip(each, weighted_least_squares(own, np.arange(4)), strict=True):
            np.testing.assert_allclose(found, alone, rtol=1e-9)


def test_blocks_are_of_equally_many_rows_and_end_with_logs() -> None:
    log, time = np.repeat([0, 1], [70, 30]), np.r_[0.1 * np.arange(70), 0.1 * np.arange(30)]
    edges = block_edges(log, time, 4)
    assert edges == [(0, 0.0), (0, pytest.approx(2.5)), (0, pytest.approx(5.0)), (1, 0.0), (1, pytest.approx(0.5))]
    rows: Any = type("Rows", (), {"log": log, "time": time - 0.01, "__len__": lambda self: 100})()
    found = blocks_of(rows, edges)
    assert np.bincount(found).tolist() == [26, 25, 19, 6, 24]
    assert (np.diff(found) >= 0).all()


@pytest.mark.parametrize(
    ("blocks", "late"),
    [
        ("a" * 5, [3, 4]),
        ("a" * 5 + "b" * 10, [3, 4, 11, 12, 13, 14]),
        ("abcde", [3, 4]),
    ],
)
def test_the_last_part_of_each_log_is_held_out(blocks: str, late: list[int]) -> None:
    motions = [SimpleNamespace(number=k, log=SimpleNamespace(source=source)) for k, source in enumerate(blocks)]
    evidence: Any = SimpleNamespace(motions=motions, edges=[(k, 0.0) for k in range(len(blocks))])
    assert late_blocks(evidence, 0.4) == late


def test_a_first_stage_is_the_projection_on_the_instruments() -> None:
    rng = np.random.default_rng(1)
    Z = rng.normal(size=(40, 3)) * [1.0, 1e4, 1e-4]
    Y = rng.normal(size=(40, 2))
    sound = Z / [1.0, 1e4, 1e-4]
    np.testing.assert_allclose(_regressed(Y, Z), sound @ np.linalg.lstsq(sound, Y)[0])
    padded = np.column_stack([Z, np.zeros(40), Z[:, 0]])
    np.testing.assert_allclose(_regressed(Y, padded), _regressed(Y, Z), atol=1e-10)


def test_integrals_are_by_trapezia() -> None:
    time = np.linspace(0.0, 2.0, 201)
    found = _integral(np.stack([time, np.ones(201)], axis=-1), 100.0)
    np.testing.assert_allclose(found, np.stack([0.5 * time**2, time], axis=-1), atol=1e-12)


@pytest.mark.parametrize(
    ("rate", "band", "expected"),
    [
        (1000.0, 5.0, (5.0, 10.0, 20.0, 25.0)),
        (1000.0, 12.0, (12.0, 24.0, 25.0, 48.0, 50.0)),
        (1000.0, 30.0, (25.0, 30.0, 50.0)),  # at most 50 Hz
        (100.0, 5.0, (5.0, 10.0)),  # at most a tenth of the rate
    ],
)
def test_cutoffs_are_of_the_band_and_at_most_a_tenth_of_the_rate(
    rate: float, band: float, expected: tuple[float, ...]
) -> None:
    assert cutoffs_for(rate, band) == expected
    evidence: Any = SimpleNamespace(rows=dict.fromkeys(expected))
    assert judged_at(evidence) == max((c for c in expected if c <= 25.0), default=min(expected))


def search_over(monkeypatch: pytest.MonkeyPatch, squares: list[Any]) -> tuple[_Selection, list[FitSettings]]:
    """Search, and its candidates, of weights 1, 2 ..., with squared errors the means over five groups."""
    each = [np.broadcast_to(own, 5) / 5.0 for own in squares]
    monkeypatch.setattr(choice, "predicted_squares", lambda _, settings: each[int(settings.weight) - 1])
    tried = [replace(SETTINGS, weight=k + 1.0) for k in range(len(each))]
    return _Selection(None, []), tried  # type: ignore[arg-type]


def word(settings: FitSettings) -> str:
    return f"{settings.weight:g}"


def test_a_later_setting_is_taken_where_it_is_better_by_a_share(monkeypatch: pytest.MonkeyPatch) -> None:
    def best(scores: list[float], share: float = 0.01) -> float:
        search, tried = search_over(monkeypatch, [score**2 for score in scores])
        found = search.best(tried, "weight", word, share)
        np.testing.assert_allclose([trial.relative_error for trial in search.trials], scores)
        assert [trial.candidate for trial in search.trials if trial.taken] == [f"{found.weight:g}"]
        return found.weight

    assert best([1.0, 0.995, 0.991, 1.0]) == 1.0
    assert best([1.0, 0.995, 0.989, 1.0]) == 3.0
    assert best([1.0, 0.98, 0.975, 0.965]) == 4.0
    assert best([1.0, 0.98, 0.975, 0.972]) == 2.0
    assert best([np.inf, 1.0, np.inf, 0.995]) == 2.0
    assert best([1.0, 0.996, 0.9955, 0.9], 0.003) == 4.0


# Less by 0.2 on average, with a standard error of the mean over the five groups of 0.19 and 0.21.
SURE, UNSURE = (0.8 - error * np.sqrt(2.0) * np.arange(-2.0, 3.0) for error in (0.19, 0.21))


def test_a_richer_setting_is_better_by_a_standard_error_over_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    search, tried = search_over(monkeypatch, [np.ones(5), UNSURE, SURE])
    assert [search.best(tried[:2], "", word).weight, search.best([tried[0], tried[2]], "", word).weight] == [1.0, 3.0]
    assert search.best(tried[:2], "", word, clear=0.0).weight == 2.0


def test_the_last_setting_is_at_most_a_standard_error_above_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    search, tried = search_over(monkeypatch, [1.3, UNSURE, np.ones(5), 1.5, np.inf])
    assert search.last(tried, "", word).weight == 3.0  # which the second is not surely better than
    assert [trial.candidate for trial in search.trials if trial.taken] == ["3"]
    search, tried = search_over(monkeypatch, [1.3, SURE, np.ones(5), 1.5, np.inf])
    assert search.last(tried, "", word).weight == 2.0
    search, tried = search_over(monkeypatch, [np.inf, np.inf])
    assert search.last(tried, "", word).weight == 1.0


@pytest.mark.parametrize(
    ("ratios", "weight"),
    [
        ((1.0, 1.02, 1.05, 1.2), 2.0),  # near least squares
        ((1.031, 1.04, 1.2, 1.5), 3.0),  # no body can be nearer: the last within a standard error
        ((1.4, 1.41, 1.41, 1.5), 3.0),
        ((1.41, 1.42, 1.5, 1.6), 2.0),  # perhaps another robot's log
    ],
)
def test_a_prior_is_heavier_where_no_body_can_follow_the_log(
    monkeypatch: pytest.MonkeyPatch, ratios: tuple[float, ...], weight: float
) -> None:
    search, tried = search_over(monkeypatch, [1.1, 1.0, UNSURE + 0.21, 1.3])
    evidence: Any = SimpleNamespace(blocks=5, fits=lambda settings, _: [int(settings.weight) - 1])
    monkeypatch.setattr(choice, "misfit_ratio", lambda _, fit: ratios[fit])
    assert replace(search, evidence=evidence).weighted(tried).weight == weight


def test_what_fails_is_no_candidate() -> None:
    def score(settings: FitSettings) -> float:
        if settings.weight == 1.0:
            raise InputError("no")
        return settings.weight

    found = [_tried(score, replace(SETTINGS, weight=x)) for x in (1.0, 2.0, np.nan, np.inf)]
    assert found == [np.inf, 2.0, np.inf, np.inf]
    with pytest.raises(KeyError):
        _tried(lambda _: {}["x"], SETTINGS)  # a mistake of the code's own


def test_priors_near_least_squares_have_three_percent_more_misfit() -> None:
    tried = [replace(SETTINGS, weight=float(k)) for k in range(4)]

    def near(*ratios: float) -> list[int]:
        return [int(settings.weight) for settings in _near(tried, ratios)]

    assert near(1.0, 1.02, 1.031, 1.2) == [0, 1]
    assert near(1.2, 1.22, 1.24, 1.25) == [0, 1]  # of the lightest where no body can have less
    assert near(1.02, 1.029, 1.04, 1.05) == [0, 1]
    assert near(np.inf, np.inf, np.inf, np.inf) == [0, 1, 2, 3]


def test_a_prediction_is_of_blocks_left_out_newtons_and_newton_meters_apart() -> None:
    asked: list[list[int]] = []

    class Rows:
        """Errors 1, 2 and 3 of torques 10, 10 and 30, by block."""

        def __init__(self, blocks: list[int]) -> None:
            self.square = np.tile([100.0, 100.0, 900.0], (len(blocks), 1))

        def misfit(self, x: Array) -> Array:
            return len(self.square) * np.array([1.0, 4.0, 9.0])

    def fits(settings: FitSettings, parts: list[list[int]]) -> Any:
        asked.extend(parts)
        return [SimpleNamespace(x=np.zeros(1))] * len(parts)

    def of(*kinds: JointKind) -> float:
        joints = [SimpleNamespace(kind=kind) for kind in kinds]
        mechanism = SimpleNamespace(dof=3, primary_joints=joints)
        evidence: Any = SimpleNamespace(
            mechanism=mechanism, blocks=20, band=5.0, fits=fits, equations=lambda settings, blocks: Rows(blocks)
        )
        squares = predicted_squares(evidence, SETTINGS)
        np.testing.assert_allclose(squares, squares.mean())
        return float(np.sqrt(squares.sum()))

    turn, slide = JointKind.REVOLUTE, JointKind.PRISMATIC
    assert of(turn, turn, turn) == pytest.approx(np.sqrt(14.0 / 1100.0))
    assert [sorted(set(range(20)) - set(blocks)) for blocks in asked] == [
        list(range(k, k + 4)) for k in range(0, 20, 4)
    ]
    assert of(turn, turn, slide) == pytest.approx(np.sqrt(0.5 * (5.0 / 200.0 + 9.0 / 900.0)))


def test_links_with_most_of_the_misfit_are_named() -> None:
    names = ("a.m", "a.I_zz", "b.m", "c.m", "d.viscous")
    A, least = np.diag([2.0, 2.0, 2.0, 2.0, 2.0]), np.array([1.0, 1.0, 1.0, 1.0, 1.0])
    x = least + np.sqrt([0.5, 0.5, 0.6, 0.4, 9.0])  # parts of the squares above the least, by parameter
    equation = SimpleNamespace(whitened=lambda deviations: (A, A @ least))
    evidence: Any = SimpleNamespace(
        blocks=1, equations=lambda *_: equation, mechanism=SimpleNamespace(parameter_names=names)
    )
    settings = SimpleNamespace(columns=lambda _: np.array([True] * 4 + [False]))
    fit: Any = SimpleNamespace(settings=settings, deviations=None, x=x)
    assert forced(evidence, fit) == ["a", "b"]  # the parts are 1, 0.6 and 0.4


def test_a_relative_error_is_the_geometric_mean_over_joints() -> None:
    made: Any = SimpleNamespace(
        square=np.array([[50.0, 0.0, 2.0], [50.0, 0.0, 2.0]]), misfit=lambda x: np.array([1.0, 0.0, 1.0])
    )
    assert relative_error(made, np.zeros(1)) == pytest.approx((0.1 * 0.5) ** 0.5, rel=1e-3)  # a dead joint is left out
    made.misfit = lambda x: np.zeros(3)
    assert relative_error(made, np.zeros(1)) == pytest.approx(0.003)


def test_slopes_of_torques_are_beside_friction_and_an_offset() -> None:
    rng = np.random.default_rng(2)
    v, told = rng.normal(size=(200, 3)), rng.normal(size=(200, 3))
    torque = told * [2.0, -0.5, 1.0] + 3.0 * v + 4.0 * np.sign(v) + 5.0
    used = np.ones((200, 3), dtype=bool)
    used[7:, 2] = False  # too few
    torque[10, 0], used[10, 0] = 1e6, False
    slopes, shares = _each_joint(SimpleNamespace(velocity=v, torque=torque), told, used)  # type: ignore[arg-type]
    np.testing.assert_allclose(slopes, [2.0, -0.5, 0.0], atol=1e-9)
    np.testing.assert_allclose(shares, [1.0, 1.0, 0.0], atol=1e-9)
    noisy = torque + np.array([1.0, 0.0, 0.0]) * rng.normal(size=(200, 3))
    _, shares = _each_joint(SimpleNamespace(velocity=v, torque=noisy), told, used)  # type: ignore[arg-type]
    assert shares[0] == pytest.approx(4.0 / 5.0, abs=0.06)  # of the variance


def meaning(sentence: str | None, refuses: bool) -> LogMeaning:
    step = PreparationStep("", "")
    return LogMeaning((), sentence, refuses, step, False, step)


def test_a_meaning_refuses_a_log_unless_it_is_trusted_or_its_torques_are_dead() -> None:
    assert validate_meaning(meaning(None, False), False) == ()
    assert validate_meaning(meaning("a spring", False), False) == ("a spring",)
    assert validate_meaning(meaning("a sign", True), True) == ("a sign",)
    with pytest.raises(InputError, match="a sign, or take the log as it is by"):
        validate_meaning(meaning("a sign", True), False)
    with pytest.raises(InputError, match="record the torque of elbow, or take"):
        validate_meaning(meaning("a sign", True), False, ["record the torque of elbow"])
    assert validate_meaning(meaning("a sign", True), True, ["record the torque of elbow"]) == ()
    assert validate_meaning(meaning("a spring", False), False, ["record the torque of elbow"]) == ("a spring",)


def test_meanings_that_fit_as_well_are_told_once_a_kind_the_best_first() -> None:
    def trial(kind: str, words: str, error: float, bound: bool = False) -> Any:
        return SimpleNamespace(trial=TriedHypothesis(kind, words, error, bound))

    others = [trial("sign", "second", 0.1), trial("zero", "other", 0.099), trial("sign", "first", 0.09),
              trial("swap", "a bound", 0.01, True), trial("tilt", "worse", 0.2)]  # fmt: skip
    assert _alike(others, 0.1).outcome == "first (1 more of its kind); other"
    assert _alike(others, 0.01).outcome == "nothing"


@pytest.mark.parametrize(
    ("sources", "ratio", "refused"),
    [(("a", "b"), 1.99, False), (("a", "b"), 2.01, True), (("a", "a"), 9.0, False), (("a", "b", "c"), 2.01, True)],
)
def test_logs_are_of_one_robot_unless_each_is_fitted_twice_as_well_alone(
    monkeypatch: pytest.MonkeyPatch, sources: tuple[str, ...], ratio: float, refused: bool
) -> None:
    asked: list[list[int]] = []

    def least(problem: Any, blocks: list[int]) -> Array:
        asked.append(blocks)
        return np.array([len(blocks) * 1.0, len(blocks) * 100.0])  # squares by a robot for each

    monkeypatch.setattr("adaptctl.identification.torque_constants._least", least)
    motions = [SimpleNamespace(number=k, log=SimpleNamespace(source=source)) for k, source in enumerate(sources)]
    edges = [(k, time) for k in range(len(sources)) for time in (0.0, 1.0)]
    evidence: Any = SimpleNamespace(motions=motions, edges=edges)
    whole = ratio**2 * len(edges) * np.array([1.0, 100.0])
    problem: Any = SimpleNamespace(squares=lambda x, c: whole)
    found: Any = SimpleNamespace(x=None, c=None)
    if refused:
        with pytest.raises(InputError, match=r"a, b.* fits them 2\.0 times worse"):
            validate_one_robot(problem, found, evidence)
    else:
        validate_one_robot(problem, found, evidence)
    assert sorted(b for group in asked for b in group) == list(range(len(edges)))
    assert len(asked) == len(set(sources))
