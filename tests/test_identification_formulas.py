"""Formulas of identification against least squares, inverses and searches written otherwise, on random numbers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.control.references import Sinusoids
from adaptctl.description.drive import DriveParameter
from adaptctl.errors import InputError
from adaptctl.identification import delay, robot_motion, taking
from adaptctl.identification.delay import _with_lags
from adaptctl.identification.drives_content import PayloadEntry
from adaptctl.identification.fit import positive_columns
from adaptctl.identification.hypothesis_rows import _windows
from adaptctl.identification.instruments import _weakest
from adaptctl.identification.least_squares import explained_squares
from adaptctl.identification.loaded_equations import _first_ten
from adaptctl.identification.momentum_balance import PackedRegressor
from adaptctl.identification.noise_choice import _lasts
from adaptctl.identification.robot_motion import RobotMotion, _slowed, _smaller
from adaptctl.identification.springs import _doubts
from adaptctl.identification.taking import _between, _explained
from adaptctl.identification.time_scale import ScaledTimes
from adaptctl.identification.torque_constants import validate_payload
from adaptctl.identification.turned_torques import _turn

rng = np.random.default_rng(11)


def test_times_of_another_scale_are_more_gravity_and_torque() -> None:
    """Times k times as long: the torques and gravity of rows are k^2 times what they were."""
    inertia, pull, torque = rng.normal(size=(30, 1, 4)), rng.normal(size=(30, 1, 4)), rng.normal(size=(30, 1))
    own = SimpleNamespace(torque=torque)
    rows: Any = SimpleNamespace(rows=own, packed=np.zeros((1, 4)), used=rng.random((30, 1)) < 0.8)
    times = ScaledTimes.of(rows, lambda multiple: PackedRegressor.of(inertia + multiple * pull))
    for scale, blocks in ((1.5, range(6)), (0.7, (0, 2, 5))):
        counted = rows.used[:, 0] & np.isin(np.arange(30) // 5, blocks)
        Y, t = (inertia + scale**2 * pull)[counted, 0], scale**2 * torque[counted, 0]
        found = times.equations(scale, blocks)
        np.testing.assert_allclose(found.normal[0, 0], Y.T @ Y, atol=1e-9)
        np.testing.assert_allclose(found.moment[0, 0], Y.T @ t, atol=1e-9)
        np.testing.assert_allclose((found.square[0, 0], found.count[0, 0]), (t @ t, len(t)), atol=1e-9)


def test_the_drives_terms_that_must_be_positive_have_their_sizes() -> None:
    """A rotor that of a tenth of a link's mean moment of inertia; one of massless links is small, but some."""
    kinds = (DriveParameter.ROTOR_INERTIA, DriveParameter.VISCOUS, DriveParameter.OFFSET, DriveParameter.COULOMB)
    about = SimpleNamespace(bodies=(0, 1), drive_parameters=[(0, kind) for kind in kinds])
    tens = np.zeros((2, 10))
    tens[0, [4, 6, 9]], tens[1, [4, 6, 9]] = (1.0, 2.0, 3.0), (3.0, 4.0, 5.0)
    for given, rotor in ((tens, 0.1 * 3.0), (0.0 * tens, 1e-6)):
        columns, sizes = positive_columns(SimpleNamespace(description=about), given)  # type: ignore[arg-type]
        assert columns.tolist() == [20, 21, 23]
        assert sizes == pytest.approx([rotor, 1.0, 1.0])


@pytest.mark.parametrize("turned", [20, 50, 70])
def test_a_torque_turns_where_least_squares_explains_most_by_its_negative(turned: int) -> None:
    """Rows that do not count do not; they are in no order."""
    time, Y = rng.permutation(np.repeat(0.1 * np.arange(100), 2)), rng.normal(size=(200, 2, 3))
    here = np.arange(200) >= 15
    torque = np.where(time[:, None] >= 0.1 * turned - 1e-9, [1.0, -1.0], 1.0) * (Y @ [1.0, -2.0, 3.0])
    torque[~here] = 1e3
    A, b = np.einsum("nji,njk->ik", Y[here], Y[here]), np.einsum("nji,nj->i", Y[here], torque[here])
    rows: Any = SimpleNamespace(
        rows=SimpleNamespace(time=time, torque=torque),
        packed=SimpleNamespace(joint=lambda j: (np.arange(3), Y[:, j])),
        explained=lambda columns, added, deviations: explained_squares(A, b + added),
    )
    other, one = np.diag([1.0, -1.0]), np.ones(2)
    at, gain = _turn(rows, here, other, one, 1)
    assert at == pytest.approx(0.1 * turned)
    flat = Y[here].reshape(-1, 3)
    assert gain == pytest.approx(np.linalg.lstsq(flat, torque[here].ravel())[1][0] / 185)
    assert _turn(rows, here & (np.arange(200) < 17), other, one, 1) == (np.inf, 0.0)


def test_rows_of_a_payload_are_summed_between_instants(monkeypatch: pytest.MonkeyPatch) -> None:
    time, edges = np.array([0.5, 1.0, 1.9, 2.5, 3.5, 9.0]), np.array([1.0, 2.0, 3.0, 4.0])
    Y, torque, used = rng.normal(size=(6, 2, 5)), rng.normal(size=(6, 2)), rng.random((6, 2)) < 0.7
    carried, weight, columns = np.array([True, True, True, True, False, True]), np.array([0.5, 3.0]), [4, 0, 2]
    rows = SimpleNamespace(regressor=Y, torque=torque, time=time, used=lambda least: used)
    monkeypatch.setattr(taking, "in_log", lambda *_: carried)
    evidence: Any = SimpleNamespace(parts=lambda cutoff: [(rows, None, None, np.ones(2))] * 2)
    N, m = _between(edges, None, evidence, 8.0, columns, weight)  # type: ignore[arg-type]
    place = [0, 0, 0, 1, None, 2]  # before the first and after the last they belong to these
    for e in range(3):
        own = [(weight[j] * Y[i, j, columns], weight[j] * torque[i, j])
               for i in range(6) for j in range(2) if place[i] == e and used[i, j]]  # fmt: skip
        np.testing.assert_allclose(N[e], 2.0 * sum((np.outer(y, y) for y, _ in own), np.zeros((3, 3))), atol=1e-12)
        np.testing.assert_allclose(m[e], 2.0 * sum((t * y for y, t in own), np.zeros(3)), atol=1e-12)


def test_a_body_taken_at_an_instant_explains_what_its_columns_do_from_then_on() -> None:
    Y, t, parts = rng.normal(size=(40, 5)), rng.normal(size=40), np.repeat(np.arange(4), 10)
    sums = [(Y[parts == e].T @ Y[parts == e], Y[parts == e].T @ t[parts == e]) for e in range(4)]
    found = _explained(*map(np.array, zip(*sums, strict=True)), 3)
    for k in (1, 2, 3):
        late = np.where((parts >= k)[:, None] | (np.arange(5) < 3), Y, 0.0)
        x = np.linalg.lstsq(late, t)[0]
        assert found[k - 1] == pytest.approx(t @ late @ x)


def test_a_spring_is_doubted_by_three_deviations_of_its_torque() -> None:
    A = (Y := rng.normal(size=(60, 6))).T @ Y
    regressor, columns = rng.normal(size=(60, 2, 6)), np.array([0, 1, 3, 5])
    evidence: Any = SimpleNamespace(rows={9.0: SimpleNamespace(regressor=regressor)})
    found = _doubts(A, columns, [(3, 1), (5, 0)], evidence, 9.0, np.array([0.0, 4.0]))
    deviations = np.sqrt(np.diag(np.linalg.inv(A[np.ix_(columns, columns)])))
    swings = regressor[:, 1, 3].std(), regressor[:, 0, 5].std()
    expected = [3.0 * deviations[2] * swings[0] / 4.0, 3.0 * deviations[3] * swings[1]]  # no torque counts as 1
    assert found == pytest.approx(expected, rel=1e-6)
    Y[:, 5] = Y[:, 0]
    assert _doubts(Y.T @ Y, columns, [(5, 0)], evidence, 9.0, np.ones(2)) == [np.inf]


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_instruments_tell_least_of_what_they_explain_the_smallest_share_of(scale: float) -> None:
    """F is the explained share over the rest, times the degrees of freedom that 40 rows leave each of two."""

    def of(diagonal: list[float], rows: float) -> Any:
        return SimpleNamespace(
            blocks=2, rows=[5.0], mechanism=SimpleNamespace(parameter_names=("a", "b", "c")),
            equations=lambda *_: equations(diagonal, rows), independent=lambda _: np.array([0, 2]),
        )  # fmt: skip

    def equations(diagonal: list[float], rows: float) -> Any:
        return SimpleNamespace(whitened=lambda _: (np.diag(diagonal), None), count=np.array([[rows / 2.0, rows / 2.0]]))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("adaptctl.identification.instruments.weighted_least_squares", lambda *_: (None, None))
        told = _weakest(of([8.0, 1.0, 4.0], 80.0), of([2.0 * scale, 1.0, 0.4 * scale], 40.0))
    share = 0.05 * scale  # of c: 0.1 of its rows' squares, which are twice as many; of a: an eighth
    F = share / (1.0 - share) * (40.0 / 2.0 - 1.0)
    assert told == f"c (F = {F:.3g}, which is weak)"


@pytest.mark.parametrize("lasting", [0.0, 0.3, 3.0])
def test_errors_last_as_long_as_they_follow_from_those_before(lasting: float) -> None:
    """In one log, at even steps, and where they are known."""
    time, log = np.tile(0.05 * np.arange(100), 2), np.repeat([0, 1], 100)
    time[150:] += 0.4
    error = np.exp(-time / lasting) if lasting else np.where(np.arange(200) % 40 < 20, 1.0, 0.0) * rng.normal(size=200)
    error[100:150] *= -1.0
    error[150:] *= 7.0
    error[30] = np.nan
    rows: Any = SimpleNamespace(time=time, log=log)
    assert _lasts(rows, error, (3.0, 1.0, 0.3, 0.0)) == lasting


@pytest.mark.parametrize(("mass", "off", "fits"), [(2.0, 0.49, True), (2.0, 0.51, False), (-1.0, 0.1, False)])
@pytest.mark.parametrize(("center", "near"), [(0.049, True), (0.051, False)])
def test_a_payload_is_shown_by_a_quarter_of_its_mass_and_five_centimetres(
    mass: float, off: float, fits: bool, center: float, near: bool
) -> None:
    variances = np.full(45, 1e9)
    variances[30:34] = np.square([off, 0.01, center * abs(mass), 0.02])
    found: Any = SimpleNamespace(
        covariance=np.diag(variances), x=np.append(np.zeros(30), [mass] * 15),
        deviations=lambda one: np.sqrt(np.diag(one @ np.diag(variances) @ one.T)),
    )  # fmt: skip
    evidence: Any = SimpleNamespace(prior=SimpleNamespace(tens=np.zeros((2, 10))))
    payload = PayloadEntry(log="a.csv", link="tool")
    if fits and near:
        validate_payload(None, found, 1, payload, evidence)  # type: ignore[arg-type]
    else:
        with pytest.raises(InputError, match=r"a\.csv: the log hardly shows it"):
            validate_payload(None, found, 1, payload, evidence)  # type: ignore[arg-type]


def test_what_is_unknown_of_a_payload_is_that_of_a_ball() -> None:
    """Of a decimetre, about its centre: two fifths of the mass times the square of the radius."""
    ten = _first_ten(PayloadEntry(log="a", link="b", mass=3.0, center_of_mass=(0.0, 0.0, 0.2)))
    ball, far = 0.4 * 3.0 * 0.01, 3.0 * 0.04
    assert ten == pytest.approx([3.0, 0.0, 0.0, 0.6, ball + far, 0.0, ball + far, 0.0, 0.0, ball])
    assert _first_ten(PayloadEntry(log="a", link="b"))[0] == 1.0


def test_rates_of_friction_beside_parameters_have_the_inverse_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    Y, lags, weight = rng.normal(size=(50, 2, 6)), rng.normal(size=(50, 2, 2)), rng.random((50, 2))
    names = ("j.viscous", "j.coulomb", "j.offset", "k.viscous", "k.coulomb", "k.offset")
    joints = [SimpleNamespace(name="j"), SimpleNamespace(name="k")]
    evidence: Any = SimpleNamespace(mechanism=SimpleNamespace(parameter_names=names, primary_joints=joints))
    rates = {float(Y[0, 0, c]): lags[..., k] for k, c in enumerate((1, 4))}
    monkeypatch.setattr(delay, "_rate", lambda rows, values: rates[float(values[0, 0])])
    weighted = (weight[..., None] * Y).reshape(-1, 6)
    inverse = np.linalg.inv(Y.reshape(-1, 6).T @ weighted)
    rows: Any = SimpleNamespace(regressor=Y)
    wider, whole = _with_lags(evidence, rows, weight, inverse)
    np.testing.assert_array_equal(wider, np.concatenate([Y, lags], axis=-1))
    flat = wider.reshape(-1, 8)
    np.testing.assert_allclose(whole, np.linalg.inv(flat.T @ (weight.reshape(-1, 1) * flat)), atol=1e-12)


def motion(size: float = 1.0) -> RobotMotion:
    reference = Sinusoids(np.array([0.4]), np.array([size]), np.array([0.5]), np.array([0.3]))
    return RobotMotion(reference, np.zeros(1), np.zeros(1), period=8.0, fade=1.0)


@pytest.mark.parametrize("most", [3.0, 1.0, 0.5])
def test_a_motion_becomes_smaller_by_quarters_until_it_is_allowed(most: float) -> None:
    """About the pose at which it begins."""
    found = _smaller(motion(), lambda p: bool(np.abs(p).max() < most))
    share = float(np.max(found.reference.amplitude))
    k = round(np.log(share) / np.log(0.75))
    assert share == pytest.approx(0.75**k)
    assert float(found.reference.center[0]) == pytest.approx(0.4 * share)
    largest = np.abs(motion().sampled(50.0)[1]).max()
    assert 0.75**k * largest < most * 1.001
    assert k == 0 or 0.75 ** (k - 1) * largest > most
    with pytest.raises(InputError, match="no collision-free motion"):
        _smaller(motion(), lambda p: False)


@pytest.mark.parametrize("use", [0.9, 1.1, 40.0])
def test_a_motion_becomes_as_slow_as_its_limits_ask(use: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_motion, "_use", lambda one, *_: use / (one.duration / 10.0) ** 2)
    arm: Any = SimpleNamespace(name="arm")
    found = _slowed(motion(), arm, None)  # type: ignore[arg-type]
    assert found.duration == pytest.approx(10.0 * max(1.0, np.sqrt(use)), rel=1e-3)
    assert use / (found.duration / 10.0) ** 2 <= 1.0
    monkeypatch.setattr(robot_motion, "_use", lambda *_: 1.1)
    with pytest.raises(InputError, match="even for a slow motion"):
        _slowed(motion(), arm, None)  # type: ignore[arg-type]


@pytest.mark.parametrize(("instants", "most", "starts"), [(900, 900, [0]), (5000, 1000, [*range(0, 5000, 544)][:10])])
def test_windows_are_spread_over_a_long_motion(
    instants: int, most: int, starts: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adaptctl.identification.hypothesis_rows.replace", lambda _, **given: SimpleNamespace(**given))
    whole: Any = SimpleNamespace(first=5, every=2, position=np.arange(instants), velocity=-np.arange(instants))
    found = list(_windows(whole, np.arange(instants), most))
    assert [int(one.position[0]) for one, _ in found] == pytest.approx(starts, abs=10)
    assert sum(len(one.position) for one, _ in found) == most
    assert found[-1][0].position[-1] == instants - 1
    for one, acceleration in found:
        assert one.first == 5 + 2 * int(one.position[0])
        np.testing.assert_array_equal(one.position, acceleration)
        np.testing.assert_array_equal(one.velocity, -acceleration)
