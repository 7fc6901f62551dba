"""Whether a log is its robot's and how sure its fit is, on equations of a few parameters."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.description import Joint
from adaptctl.description.drive import DriveParameter
from adaptctl.errors import InputError
from adaptctl.identification import uncertainty as uncertainties
from adaptctl.identification import validation
from adaptctl.identification.column_units import Units
from adaptctl.identification.columns import JointLog
from adaptctl.identification.hypothesis_rows import HypothesisRows
from adaptctl.identification.logged_velocities import compared_velocities
from adaptctl.identification.momentum_balance import MomentumBalance
from adaptctl.identification.uncertainty import Student, uncertainty
from adaptctl.identification.validation import _drives_alone, validate_plausible

rng = np.random.default_rng(17)
ARM: Any = SimpleNamespace(primary_joints=[Joint("a"), Joint("b")])
TIME = np.arange(400) / 100.0
SWING = np.stack([np.sin(3.0 * TIME), np.cos(2.0 * TIME)], axis=-1)
RATES = np.stack([3.0 * np.cos(3.0 * TIME), -2.0 * np.sin(2.0 * TIME)], axis=-1)


def halves(position: Array, velocity: Array | None) -> list[JointLog]:
    """A log in two pieces."""
    parts = (slice(None, 150), slice(150, None))
    return [
        JointLog("a.csv", TIME[own], position[own], position[own], None if velocity is None else velocity[own])
        for own in parts
    ]


def compared(logged: Array, found: Array = RATES) -> str:
    return compared_velocities("a.csv", halves(SWING, logged), [found[:150], found[150:]], ARM)


def test_logged_velocities_are_within_a_tenth_of_those_found() -> None:
    """By least squares over all pieces; a joint that rests in both is as found."""
    assert compared(RATES * [1.09, 0.91]) == "logged velocities are 0.910 to 1.090 of differentiated positions"
    rest = RATES * [1.0, 1e-5]
    assert compared(rest, rest * [1.02, 9.0]) == "logged velocities are 0.980 to 1.000 of differentiated positions"
    assert compared_velocities("a.csv", halves(SWING, None), [RATES], ARM) == "no logged velocities"
    one = [halves(SWING, None)[0], halves(SWING, RATES)[1]]
    assert compared_velocities("a.csv", one, [RATES], ARM) == "no logged velocities"


@pytest.mark.parametrize(
    ("factors", "told"),
    [
        ((1.0, 1.11), "'b': logged velocities are 1.11 times the differentiated positions; give"),
        ((0.89, 1.0), "'a': logged velocities are 0.89 times the differentiated positions; give"),
        (
            (1.0, -1.0),
            "'b': logged velocities are -1 times the differentiated positions: one of them has the wrong sign",
        ),
        ((57.3, 57.3), "'a': logged velocities are 57.3 times the differentiated positions: velocities in deg/s"),
    ],
)
def test_other_velocities_are_refused_by_their_ratio(factors: tuple[float, float], told: str) -> None:
    with pytest.raises(InputError, match="joint ") as refused:
        compared(RATES * factors)
    assert told in str(refused.value)


def test_velocities_of_a_joint_that_is_found_to_rest_have_no_ratio() -> None:
    with pytest.raises(InputError, match="joint 'b'"):
        compared(RATES, RATES * [1.0, 0.0])


def test_columns_are_exchanged_or_copied_if_all_joints_are() -> None:
    """Positions whose rates are not the logged velocities, but whose values or integrals these are."""
    found = np.gradient(RATES, TIME, axis=0)
    with pytest.raises(InputError, match="they are exchanged"):
        compared_velocities("a.csv", halves(RATES, SWING), [found[:150], found[150:]], ARM)
    with pytest.raises(InputError, match="have the same values"):
        compared(SWING)
    mixed = np.column_stack([SWING[:, 0], RATES[:, 1]])
    with pytest.raises(InputError, match="joint 'a'"):
        compared(mixed)


def test_the_uncertainty_is_the_jackknife_of_blocks_and_what_the_prior_holds_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Three parameters of one link and one of a drive, which the last columns of the rows do not tell."""
    weight = 0.7
    parts = [(rows.T @ rows, rng.normal(size=4)) for rows in rng.normal(size=(5, 9, 4))]
    curvature = sum(A for A, _ in parts)
    pull = np.diag([3.0, 2.0, 1.0, 0.0])
    monkeypatch.setattr(uncertainties, "_blocks", lambda *_: parts)
    monkeypatch.setattr(uncertainties, "_pull", lambda *_: pull)
    settings = SimpleNamespace(weight=weight, columns=lambda mechanism: np.ones(4))
    fit: Any = SimpleNamespace(settings=settings, curvature=curvature, x=np.ones(4))
    prior = SimpleNamespace(tens=np.zeros((1, 3)), distance=lambda x: 2.5)
    evidence: Any = SimpleNamespace(prior_of=lambda _: prior, independent=lambda _: np.array([0, 1, 3]), mechanism=None)
    found = uncertainty(evidence, fit)
    H = curvature + pull
    left_out = [np.linalg.solve(H - A, score) for A, score in parts]
    np.testing.assert_allclose(found.sampling, 4.0 * np.cov(np.array(left_out).T, bias=True), rtol=1e-8)
    inverse = np.linalg.inv(H)
    np.testing.assert_allclose(found.nominal, inverse, rtol=1e-8)
    told = np.trace((inverse @ curvature)[:3, :3])
    assert told > 1.0
    np.testing.assert_allclose(found.bias, weight * 2.0 * 2.5 / told * inverse @ pull @ inverse, rtol=1e-8, atol=1e-12)
    own = np.ix_([0, 1, 3], [0, 1, 3])
    np.testing.assert_allclose(found.alone[own], np.linalg.inv(curvature[own]), rtol=1e-6)
    assert not found.alone[2].any()
    assert (found.student, found.untold.tolist()) == (Student(5), [])
    fit.curvature = 1e-3 * curvature  # which determines not one parameter
    inverse = np.linalg.inv(fit.curvature + pull)
    found = uncertainty(evidence, fit)
    np.testing.assert_allclose(found.bias, weight * 2.0 * 2.5 * inverse @ pull @ inverse, rtol=1e-6, atol=1e-9)
    fit.curvature = curvature.copy()
    fit.curvature[3] = fit.curvature[:, 3] = curvature[0] * np.array([1.0, 1.0, 1.0, 0.0])
    fit.curvature[3, 3] = fit.curvature[0, 0]
    fit.curvature[0, 3] = fit.curvature[3, 0] = fit.curvature[0, 0]  # the last column is the first
    assert uncertainty(evidence, fit).untold.tolist() == [0, 3]


def evidence_of(left: float, power: float, needed: bool, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Evidence of which a share of the torques is left, and friction's power at joint b is a share of its largest."""
    size = np.sqrt(np.mean(RATES[:, 1] ** 2))
    torque = np.column_stack([RATES[:, 0], np.full(400, 1.0)])
    rows = SimpleNamespace(velocity=RATES, torque=torque)
    names = ("a.viscous", "a.coulomb", "b.viscous", "b.coulomb")
    x = np.array([1.0, 0.0, power / size, 0.0])
    equations = SimpleNamespace(misfit=lambda x: np.array([1.0, 2.0]))
    seen: list[Any] = []

    def fitted(evidence: Any, terms: Any, cutoff: float) -> Any:
        seen.append(terms)
        return equations, x, np.ones(2), left if len(seen) == 1 else 0.4

    monkeypatch.setattr(validation, "_freely_fitted", fitted)
    monkeypatch.setattr(validation, "_is_needed", lambda *given: given[2] == "b." and needed)
    monkeypatch.setattr(validation, "_swing_words", lambda _: "")
    motors = [SimpleNamespace(position=f"q{k}", torque=f"u{k}") for k in range(2)]
    mechanism = SimpleNamespace(parameter_names=names, primary_joints=ARM.primary_joints, name="arm")
    return SimpleNamespace(
        rows={9.0: SimpleNamespace(moved=rows)}, mechanism=mechanism, drives=SimpleNamespace(motors=motors), seen=seen
    )


@pytest.mark.parametrize(
    ("left", "power", "needed", "told"),
    [
        (0.49, -0.29, True, ""),
        (0.49, -0.31, True, "the friction estimated for joint 'b' is negative"),
        (0.49, -0.31, False, ""),
        (0.51, 0.2, True, "do not explain 51% of the torques"),
    ],
)
def test_a_log_is_refused_whose_friction_drives_or_that_leaves_half_of_the_torques(
    left: float, power: float, needed: bool, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence = evidence_of(left, power, needed, monkeypatch)
    if not told:
        validate_plausible(evidence, "log", 9.0)
        return
    with pytest.raises(InputError, match=told) as refused:
        validate_plausible(evidence, "log", 9.0)
    if left > 0.5:
        assert "such as 'q1' and 'u1', of which most is left" in str(refused.value)


@pytest.mark.parametrize(("left", "fits"), [(0.51, 2), (0.49, 1)])
def test_springs_are_tried_where_half_of_the_torques_is_left(
    left: float, fits: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence = evidence_of(left, 0.0, False, monkeypatch)
    validate_plausible(evidence, "log", 9.0, (DriveParameter.STIFFNESS,))
    assert len(evidence.seen) == fits
    assert ("stiffness" in evidence.seen[-1].words) == (fits == 2)


@pytest.mark.parametrize("links", [True, False])
def test_drives_alone_are_fitted_to_what_known_links_leave(links: bool) -> None:
    Y, t, tens = rng.normal(size=(60, 13)), rng.normal(size=60), rng.normal(size=(1, 10))
    mask = np.array([1.0] * 11 + [0.0, 1.0])
    settings = SimpleNamespace(columns=lambda _: mask)
    equations = SimpleNamespace(whitened=lambda deviations: (Y.T @ Y, Y.T @ t))
    evidence: Any = SimpleNamespace(equations=lambda *_: equations, prior=SimpleNamespace(tens=tens), mechanism=None)
    fit: Any = SimpleNamespace(settings=settings, deviations=np.ones(1))
    known = np.concatenate([links * tens[0], np.zeros(3)])
    found = _drives_alone(evidence, fit, range(3), links)
    np.testing.assert_allclose(found[:10], known[:10])
    np.testing.assert_allclose(found[[10, 12]], np.linalg.lstsq(Y[:, [10, 12]], t - Y @ known)[0], rtol=1e-6)
    assert found[11] == 0.0


@pytest.mark.parametrize(
    ("unit", "slopes", "told"),
    [
        ("N m", (1.9e3, 2e2), "about 1.9e+03 times those of the robot file's links: mN m taken for N m"),
        ("N m", (2.1e3, 2e2), None),
        ("N m", (0.51e3, 0.0), "mN m taken for N m; give torque='mN m'"),
        ("N m", (0.49e3, 0.0), None),
        ("mN m", (1.1e-3, 9.0), "N m taken for mN m; give torque='N m'"),
        ("mN m", (1.1e3, 9.0), None),
        ("A", (1.1e3, 9.0), None),
    ],
)
def test_torques_a_thousand_times_those_of_the_links_are_in_another_unit(
    unit: str, slopes: tuple[float, float], told: str | None
) -> None:
    """By the joints whose links need much; a placeholder's say nothing."""
    factor = {"N m": 1.0, "mN m": 1e-3, "A": 0.7}[unit]
    drives = SimpleNamespace(units=Units(1.0, 1.0, factor))
    prior = SimpleNamespace(is_placeholder=False)
    rows: Any = SimpleNamespace(
        _slopes=(np.array(slopes), np.ones(2), np.array([True, False])),
        evidence=SimpleNamespace(drives=drives, prior=prior),
        _steady=lambda slopes, shares: len(slopes) == 1,
        sources=["a.csv", "b.csv"],
    )
    found = HypothesisRows.other_unit(rows)
    assert found is None if told is None else told in (found or "")
    prior.is_placeholder = True
    assert HypothesisRows.other_unit(rows) is None


@pytest.mark.parametrize(
    ("states", "many", "links", "native"),
    [(29_999, False, 2, False), (10**9, False, 2, True), (0, True, 2, True), (10**9, True, 10**4, False)],
)
def test_regressors_are_compiled_for_many_samples_of_short_chains(
    states: int, many: bool, links: int, native: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adaptctl.identification.momentum_balance.is_long", lambda _: False)
    monkeypatch.setattr("adaptctl.identification.momentum_balance.COMPILE_AFTER_STATES", 30_000)
    own: Any = SimpleNamespace(description=SimpleNamespace(links=range(links)))
    balance = MomentumBalance(own, many)
    balance._states = states
    assert balance._compiles is native
    monkeypatch.setattr("adaptctl.identification.momentum_balance.is_long", lambda _: True)
    assert not balance._compiles
