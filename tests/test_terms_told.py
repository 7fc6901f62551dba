"""What files, payloads, torque constants and hypotheses say of a fit, by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.control.excitation.motion_limits import MotionLimits
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.readers.entries import Tensor
from adaptctl.dynamics import load
from adaptctl.errors import InputError
from adaptctl.identification import contradictions, lasting_errors, regular_range, taking
from adaptctl.identification.drives_content import MotorEntry, PayloadEntry, UnitsEntry
from adaptctl.identification.drives_file import _completed
from adaptctl.identification.filtered_dynamics import Rows
from adaptctl.identification.fit import FitSettings
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.gathering import _turns, _validate_enough
from adaptctl.identification.hypotheses import TriedHypothesis
from adaptctl.identification.hypothesis_rows import LEAST_ERROR, HypothesisRows, _mean_errors
from adaptctl.identification.lasting_errors import _scores
from adaptctl.identification.listed_hypotheses import _payloads
from adaptctl.identification.loaded_equations import _known
from adaptctl.identification.loaded_fit import LoadedFit
from adaptctl.identification.momentum_balance import _may_differ
from adaptctl.identification.mujoco_bodies import UNIT, MujocoBodies
from adaptctl.identification.payloads import (
    known_ten,
    payload_columns,
    taken_there,
    with_unknown_payloads,
    without_payloads,
)
from adaptctl.identification.preparation import PreparationStep
from adaptctl.identification.regular_range import SHRINKAGE, regular_limits
from adaptctl.identification.report import _word, best_hypotheses
from adaptctl.identification.torque_constants import _constants, _identified, _relative_deviations, _stated
from adaptctl.identification.uncertainty import Student
from adaptctl.identification.written import missing_terms

rng = np.random.default_rng(3)
PUMA = load("puma560_measured")
BODY = {"mass": 2.0, "center_of_mass": (0.1, 0.0, 0.2), "inertia_at_center": Tensor(xx=0.03, yy=0.03, zz=0.02)}
LINK = PUMA.description.body_names[2]


@pytest.mark.parametrize(
    ("relative", "word"),
    [(0.0, "predicted"), (0.199, "predicted"), (0.2, "roughly predicted"), (0.499, "roughly predicted"),
     (0.5, "poorly predicted"), (0.999, "poorly predicted"), (1.0, "not predicted")],
)  # fmt: skip
def test_joints_are_predicted_up_to_a_fifth_and_not_from_their_own_torque_on(relative: float, word: str) -> None:
    assert _word(relative, False)[0] == word
    assert _word(relative, True)[0] == "left out"


def test_of_each_kind_the_best_hypothesis_is_shown_and_the_best_kind_first() -> None:
    tried = [TriedHypothesis(kind, "", error) for kind, error in (("as is", 0.1), ("a", 0.4), ("b", 0.3), ("a", 0.2))]
    found: Any = SimpleNamespace(hypotheses=(*tried, TriedHypothesis("b", "", 0.5)))
    assert [(t.kind, t.error) for t in best_hypotheses(found)] == [("as is", 0.1), ("a", 0.2), ("b", 0.3)]
    assert best_hypotheses(SimpleNamespace(hypotheses=())) == []  # type: ignore[arg-type]


def test_terms_that_a_format_has_no_place_for_are_told_with_their_values() -> None:
    drives = [link.joint.drive for link in PUMA.links]
    drives[0] = replace(Drive(rotor_inertia=0.5, viscous=1.0), offset=-0.25)
    robot = PUMA.with_drives([drives[0], *[Drive()] * 5])
    name = robot.primary_joints[0].name
    assert missing_terms(robot, "robot.urdf") == (f"{name} rotor inertia 0.5, offset -0.25",)
    assert missing_terms(robot, "robot.xml") == (f"{name} offset -0.25",)
    assert missing_terms(robot, "robot.toml") == ()


def rows_of_two_logs(n: int = 12) -> tuple[Any, list[Any]]:
    """Rows of logs "a" and "b", of six each, half a second apart."""
    log = np.repeat([0, 1], n // 2)
    Y, torque = rng.normal(size=(n, 6, len(PUMA.parameter_names))), rng.normal(size=(n, 6))
    time = np.tile(0.5 * np.arange(n // 2), 2)
    rows = Rows(4.0, time, Y, torque, torque, torque, log, np.ones(n, dtype=bool))
    return rows, [SimpleNamespace(number=k, log=SimpleNamespace(source=name)) for k, name in enumerate("ab")]


def test_a_known_payload_is_subtracted_from_when_it_is_taken_on() -> None:
    """Rows within a period of the cut-off of that do not count."""
    rows, motions = rows_of_two_logs()
    payload = PayloadEntry(log="b", link=LINK, after=1.0, **BODY)
    drives: Any = SimpleNamespace(payloads=(payload,), constants=np.ones(6))
    carried = (rows.log == 1) & (rows.time >= 1.0)
    columns = payload_columns(payload, rows, motions, PUMA)
    np.testing.assert_array_equal(columns, rows.regressor[..., 20:30] * carried[:, None, None])
    found = without_payloads(rows, motions, PUMA, drives)
    np.testing.assert_allclose(found.torque, rows.torque - columns @ known_ten(payload))
    assert np.flatnonzero(~found.moving).tolist() == [8]
    assert taken_there(drives, "b", np.array([0.75, 0.76, 1.24, 1.25]), 4.0).tolist() == [False, True, True, False]
    assert not taken_there(drives, "a", np.array([1.0]), 4.0).any()
    open_constants: Any = SimpleNamespace(payloads=(payload,), constants=np.array([1.0, np.nan]))
    np.testing.assert_array_equal(without_payloads(rows, motions, PUMA, open_constants).torque, rows.torque)


@pytest.mark.parametrize(
    ("change", "count"),
    [({"mass": None}, 0), ({"center_of_mass": None}, 1), ({"inertia_at_center": None}, 4), ({}, 10)],
)
def test_of_a_payload_is_known_what_its_entry_has(change: dict[str, Any], count: int) -> None:
    payload = PayloadEntry(log="b", link=LINK, **(BODY | change))
    found = _known(payload, SimpleNamespace(mechanism=PUMA), 60)  # type: ignore[arg-type]
    assert [one.place for one in found] == list(range(60, 60 + count))
    center = np.array(BODY["center_of_mass"]) if "center_of_mass" not in change else np.zeros(3)
    ten = from_center_of_mass(2.0, center, np.diag([0.03, 0.03, 0.02]))
    np.testing.assert_allclose([one.value for one in found], ten[:count])
    np.testing.assert_allclose([one.size for one in found], [2.0, *[0.2] * 3, *[0.02] * 6][:count])


def test_a_payload_that_no_body_is_is_refused_by_its_log() -> None:
    with pytest.raises(InputError, match=r"payload in b: .*not physically consistent"):
        known_ten(PayloadEntry(log="b", link=LINK, **(BODY | {"mass": -2.0})))


@pytest.mark.parametrize(
    ("given", "told"),
    [((None, 2.0, None), "give payloads"), ((None, None, 1.0), "give payloads"), (({"c": "x"}, None, None), "'c'"),
     (({"a": "x"}, 0.0, None), "payload_mass")],
)  # fmt: skip
def test_payloads_are_of_the_logs_given_and_of_a_mass(given: tuple[Any, Any, Any], told: str) -> None:
    drives: Any = SimpleNamespace(payloads=())
    with pytest.raises(InputError, match=told):
        with_unknown_payloads(drives, ["a", "b"], *given)


def fit(constants: Array, deviations: Array) -> tuple[Any, Any, Any]:
    """Drives with unknown constants of two of three motors, the problem and a fit with deviations of 1/k."""
    motors = tuple(SimpleNamespace(name=f"m{k}") for k in range(3))
    known = np.array([5.0, np.nan, np.nan])
    drives: Any = SimpleNamespace(motors=motors, constants=known, payloads=())
    problem: Any = SimpleNamespace(unknown=np.array([1, 2]))
    covariance = np.diag([0.0, 0.0, *deviations**2])
    return drives, problem, LoadedFit(np.zeros(2), 1.0 / constants, covariance, Student(30))


def test_torque_constants_are_told_with_their_deviations_or_refused() -> None:
    constants = np.array([5.0, 4.0, -0.5])
    drives, problem, found = fit(constants, np.array([0.01, 0.1]))
    ratio = Student(30).quantile_ratio
    np.testing.assert_allclose(_relative_deviations(found, problem, True), ratio * np.array([0.04, 0.05]))
    words, given = _constants(drives, problem, found)
    np.testing.assert_allclose(given, constants)
    assert f"m1 4 (deviation {4.0 * 0.04 * ratio:.1g}), m2 -0.5 (deviation {0.5 * 0.05 * ratio:.1g})" in words[0]
    together = np.sqrt(0.04**2 + 0.05**2) / 2.0  # of their ratio, half of it each
    np.testing.assert_allclose(_relative_deviations(found, problem, False), ratio * together)
    drives, problem, found = fit(constants, np.array([0.01, 0.25 * 2.0 / ratio]))
    with pytest.raises(InputError, match=r"m1, m2: .*m2 is known to 25%"):
        _constants(drives, problem, found)


def test_a_body_found_is_told_in_the_frame_of_its_entry() -> None:
    ten = from_center_of_mass(2.0, np.array([0.1, 0.0, 0.2]), np.diag([0.03, 0.03, 0.02]))
    root = rng.normal(size=(10, 10))
    covariance = np.zeros((80, 80))
    covariance[70:80, 70:80] = root @ root.T
    x = np.concatenate([np.zeros(70), ten])
    evidence: Any = SimpleNamespace(mechanism=PUMA, prior=SimpleNamespace(tens=np.zeros((6, 10))))
    payload = PayloadEntry(log="b", link=LINK, mass=2.0)
    found = _identified(evidence, LoadedFit(x, np.ones(1), covariance, Student(9)), 1, payload)
    np.testing.assert_allclose(found.ten, ten, atol=1e-12)
    np.testing.assert_allclose(found.covariance, Student(9).quantile_ratio ** 2 * root @ root.T)
    stated = _stated(payload, found)
    np.testing.assert_allclose(known_ten(stated), ten, atol=1e-12)
    assert _stated(payload, None) is payload


def test_errors_of_hypotheses_are_geometric_means_over_joints_that_have_torques() -> None:
    squares = np.array([[4.0, 0.0, 9.0], [4.0, 1.0, 9.0]])
    misfits = np.array([[1.0, 5.0, 1.0], [0.0, 5.0, 9.0]])
    shares = np.array([[0.25, 1.0 / 9.0], [0.0, 1.0]]) + LEAST_ERROR**2
    np.testing.assert_allclose(_mean_errors(misfits, squares), np.sqrt(np.sqrt(shares[:, 0] * shares[:, 1])))


def hypotheses(transmission: float = 1.0, kinds: tuple[bool, ...] = (True, True, False)) -> Any:
    joints = [SimpleNamespace(kind=SimpleNamespace(is_revolute=own)) for own in kinds]
    drives = SimpleNamespace(transmission=transmission * np.eye(3))
    evidence: Any = SimpleNamespace(drives=drives, mechanism=SimpleNamespace(primary_joints=joints))
    none = np.zeros((2, 3))
    return HypothesisRows(evidence, (), none, none, none)


def test_large_torques_are_a_tenth_of_the_largest_of_their_kind() -> None:
    assert hypotheses()._large(np.array([[3.0, 0.31, 1e3], [4.0, 0.40, 0.0]])).tolist() == [True, True, True]
    assert hypotheses()._large(np.array([[3.0, 0.29, 1e-3], [4.0, 0.39, 0.0]])).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("slopes", "shares", "gear", "expected"),
    [
        ([0.09, 0.05], [0.5, 0.41], 1.0, True),
        ([0.11, 0.05], [0.5, 0.5], 1.0, False),  # not a tenth
        ([0.09, 0.03], [0.5, 0.5], 1.0, False),  # not alike
        ([0.09, 0.05], [0.5, 0.4], 1.0, False),  # little explained
        ([-11.0, 5.0], [0.5, 0.5], 11.0, True),
        ([11.0, 5.0], [0.5, 0.5], 10.0, False),  # without gears
        ([9.0, 5.0], [0.5, 0.5], 11.0, False),
    ],
)
def test_torques_seem_of_gears_other_side_where_all_are_a_tenth_or_ten_times_the_links(
    slopes: list[float], shares: list[float], gear: float, expected: bool
) -> None:
    assert hypotheses(gear)._geared(np.array(slopes), np.array(shares)) is expected


def test_a_payload_is_doubted_at_each_last_link_in_each_of_several_logs() -> None:
    """Its ten columns count in that log's rows; a mass that is not positive is none."""
    rows, _ = rows_of_two_logs()
    own: Any = SimpleNamespace(
        rows=rows, sources=["a", "b"], of_source=lambda source: rows.log == "ab".index(source),
        evidence=SimpleNamespace(mechanism=PUMA), packed=SimpleNamespace(beside=lambda columns: columns),
        sums=lambda regressor, torque: regressor,
    )  # fmt: skip
    for source, found in zip("ab", doubts := list(_payloads(own)), strict=True):
        assert PUMA.description.body_names[-1] in found.words
        expected = rows.regressor[..., 50:60] * own.of_source(source)[:, None, None]
        np.testing.assert_array_equal(found.equations(), expected)
    x = np.zeros(len(PUMA.parameter_names) + 10)
    assert not doubts[0].holds(x)
    x[len(PUMA.parameter_names)] = 0.5
    assert doubts[0].holds(x)
    assert doubts[0].told(x) == ", of 0.5 kg"
    own.sources = ["a"]
    assert list(_payloads(own)) == []


def test_lasting_errors_are_summed_with_the_weights_of_each_joint(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of rows that count and columns that are kept; here of white noise of its own variance."""
    rows, _ = rows_of_two_logs()
    used, x, kept = rng.random((12, 6)) < 0.7, rng.normal(size=rows.regressor.shape[-1]), np.array([0, 4, 7])
    used[:, 2] = False
    given: list[tuple[Array, float]] = []
    monkeypatch.setattr(
        lasting_errors, "lasting_covariance", lambda Y, e, share: given.append((e, share)) or Y.T @ Y * (e @ e)
    )
    evidence: Any = SimpleNamespace(fitted_rows=lambda settings: rows, counted=lambda settings: used)
    found = _scores(evidence, SimpleNamespace(settings=None, x=x, deviations=np.arange(1.0, 7.0)), kept)  # type: ignore[arg-type]
    expected = np.zeros_like(found)
    for j in (0, 1, 3, 4, 5):
        e = (rows.regressor[:, j] @ x - rows.torque[:, j]) * used[:, j]
        Y = rows.regressor[:, j][used[:, j]][:, kept] / (j + 1.0) ** 2
        expected[np.ix_(kept, kept)] += Y.T @ Y * (e @ e)
        np.testing.assert_allclose(given.pop(0)[0], e)
    np.testing.assert_allclose(found, expected)


@pytest.mark.parametrize("true", [0.0, 3.456, 9.4])
def test_the_instant_of_a_body_is_found_to_a_hundredth_of_a_hundredth(
    true: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By what each inner edge explains, most near the true instant, of the log's whole time."""
    asked: list[Array] = []
    monkeypatch.setattr(taking, "weighted_least_squares", lambda *_: (None, np.array([0.5, 4.0])))
    monkeypatch.setattr(taking, "_between", lambda edges, *_: asked.append(edges) or (None, None))
    monkeypatch.setattr(taking, "_explained", lambda own, weight, shared: -np.abs(asked[-1][1:-1] - true))
    times = [("b", (0.0, 5.0)), ("b", (5.0, 10.0)), ("a", (-9.0, 99.0))]
    logs = [SimpleNamespace(source=name, time=np.array(ends)) for name, ends in times]
    evidence: Any = SimpleNamespace(
        independent=lambda settings: np.array([1, 2]), mechanism=PUMA, logs=logs, sums=lambda cutoff, slow: None
    )
    found = taking._instant(PayloadEntry(log="b", link=LINK), evidence, 4.0)
    assert (asked[0][0], asked[0][-1], len(asked[0])) == (0.0, 10.0, 101)
    assert (asked[1][0], asked[1][-1]) == (0.0, 10.0)
    assert found == pytest.approx(true, abs=0.0021)


def test_a_motors_own_name_and_units_go_before_those_of_all() -> None:
    units = UnitsEntry(time="s", position="rad", torque="N m", velocity="rad/s")
    plain = _completed(MotorEntry(position="p", torque="t"), "elbow", units)
    assert (plain.name, plain.position_unit, plain.velocity_unit) == ("elbow", "rad", "rad/s")
    own = MotorEntry(name="m", position="p", torque="t", position_unit="deg", velocity_unit="deg/s")
    assert _completed(own, "elbow", units) == own


def test_entries_that_are_zero_by_structure_are_left_out() -> None:
    assert [_may_differ(entry) for entry in (0, 0.0, 0.5, np.zeros(3))] == [False, False, True, True]


def test_a_reach_is_in_units_of_the_toolboxs_coordinates(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    toolbox = SimpleNamespace(Parameter=lambda *given, modifier: made.append((given, modifier)))
    monkeypatch.setattr("adaptctl.identification.mujoco_bodies.import_module", lambda name: toolbox)
    written: list[Any] = []
    own: Any = SimpleNamespace(bodies=np.zeros((2, 10)), write=lambda spec, x: written.append(x))
    MujocoBodies.to_sysid(own, "links", 3.0)
    (((name, start, least, most), modifier),) = made
    assert name == "links"
    np.testing.assert_array_equal(start, np.zeros(20))
    np.testing.assert_allclose(UNIT * np.stack([least, most]), [[-3.0] * 20, [3.0] * 20])
    modifier(None, SimpleNamespace(value=np.array([2.0])))
    assert written == [2.0 * UNIT]


@pytest.mark.parametrize(
    ("outcome", "told"), [("0 jumps", False), ("skipped", False), ("1 jumps", True), ("10 jumps", True)]
)
def test_full_turns_that_were_removed_are_remarked(outcome: str, told: bool) -> None:
    steps = [PreparationStep("resample", "3 holes"), PreparationStep("unwrap", outcome)]
    assert _turns(steps) == [outcome] * told


def test_logs_have_a_second_and_a_half_of_motion_together() -> None:
    pieces: list[Any] = [SimpleNamespace(source="a", rate=10.0, moving=np.arange(20) < k) for k in (8, 7)]
    assert _validate_enough(pieces) == pytest.approx(1.5)
    pieces[1].moving[6] = False
    with pytest.raises(InputError, match=r"a: the log has only 1.4 s of motion; at least 1.5 s"):
        _validate_enough(pieces)


def test_a_box_that_is_irregular_somewhere_shrinks_about_the_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    """By twentieths until all of it is regular; here from the fourth time on."""
    home, ends = np.array([0.5, -0.5]), (np.array([-1.0, -2.0]), np.array([1.0, 2.0]))
    asked: list[Array] = []

    def keeps_regular(mechanism: Any, p: Array) -> Array:
        asked.append(p)
        return np.full(len(p), len(asked) > 3)

    monkeypatch.setattr(regular_range, "keeps_regular", keeps_regular)
    monkeypatch.setattr(regular_range, "_box", lambda keeps, home, lower, upper, rng: (lower, upper))
    loops = SimpleNamespace(reference=np.array([7.0, *home]), primary=[1, 2])
    description = SimpleNamespace(joint_names=(), primary=(), loops=None)
    arm: Any = SimpleNamespace(continuation=loops, description=description, name="arm")
    limits = MotionLimits(*ends, np.ones(2), np.ones(2))
    found = regular_limits(arm, limits)
    for own, end in zip((found.lower, found.upper), ends, strict=True):
        np.testing.assert_allclose(own, home + SHRINKAGE**3 * (end - home))
    for p, k in zip(asked, range(4), strict=True):
        np.testing.assert_allclose(p.min(axis=0), home + SHRINKAGE**k * (ends[0] - home))
        np.testing.assert_allclose(p.max(axis=0), home + SHRINKAGE**k * (ends[1] - home))
    monkeypatch.setattr(regular_range, "keeps_regular", lambda mechanism, p: np.zeros(len(p), dtype=bool))
    with pytest.raises(InputError, match="near a singularity everywhere"):
        regular_limits(arm, limits)


@pytest.mark.parametrize(
    ("ratio", "light", "errors", "told"),
    [
        (1.03, 9.0, (1.0, 0.1), None),
        (1.04, 1.03, (1.03, 1.0), None),
        (1.04, 1.03, (0.104, 0.1), "by the weight 10 of the prior and most at arm"),
        (1.5, 1.4, (0.2, 0.1), "40.0% forced by arm, whatever the prior"),
        (1.5, 1.41, (0.2, 0.1), "41.0% forced by arm"),
    ],
)
def test_a_misfit_above_least_squares_is_told_where_those_predict_better(
    ratio: float, light: float, errors: tuple[float, float], told: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By more than 3 %; from 40 % that bodies cannot help, the log may be another robot's."""
    fits = {
        name: SimpleNamespace(settings=FitSettings(FrictionModel(), 10.0, 4.0, 0.0), x=name)
        for name in ("own", "light")
    }
    monkeypatch.setattr(contradictions, "misfit_ratio", lambda evidence, fit: ratio if fit is fits["own"] else light)
    monkeypatch.setattr(contradictions, "forced", lambda evidence, fit: ["arm"])
    evidence: Any = SimpleNamespace(blocks=2, ordinary=lambda *_: "free", fit=lambda *_: fits["light"])
    held: Any = SimpleNamespace(of=lambda x: SimpleNamespace(relative_error=errors[x == "free"]))
    found = contradictions.excess_misfit(evidence, fits["own"], held)  # type: ignore[arg-type]
    assert (found.warning is None) == (told is None)
    assert told is None or told in str(found.warning)
    assert (contradictions.OTHER_ROBOT in str(found.warning)) == (light == 1.41)
