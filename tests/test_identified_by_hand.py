"""Parts of identifications on a few numbers, against what they are by definition."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.control.excitation.motion_limits import MotionLimits
from adaptctl.description import Joint
from adaptctl.identification import delay, listed_hypotheses, long_logs
from adaptctl.identification.column_names import offer
from adaptctl.identification.contradictions import poorly_predicted
from adaptctl.identification.energy_differences import _integral
from adaptctl.identification.filtered_dynamics import ROWS_PER_PERIOD
from adaptctl.identification.identification import Identification, _is_positive
from adaptctl.identification.late_stamps import are_even
from adaptctl.identification.long_logs import Stretches
from adaptctl.identification.regular_range import _box, _oblique
from adaptctl.identification.robot_motion import joint_trajectory
from adaptctl.identification.taking import _explained
from adaptctl.identification.written import _nonnegative


@pytest.mark.parametrize(
    ("columns", "joints", "expected"),
    [
        (7, 3, "time=1 position=2-4 torque=5-7"),
        (6, 3, "position=1-3 torque=4-6 --sample-rate"),
        (10, 3, "time=1 position=2-4 velocity=5-7 torque=8-10"),
        (9, 3, "position=1-3 velocity=4-6 torque=7-9 --sample-rate"),
        (3, 1, "position=1 velocity=2 torque=3 --sample-rate"),
        (12, 5, "with the numbers of its columns"),
        (5, 1, "with the numbers of its columns"),
    ],
)
def test_columns_without_names_are_offered_in_their_usual_order(columns: int, joints: int, expected: str) -> None:
    log: Any = SimpleNamespace(columns=[None] * columns)
    assert expected in offer(log, joints)


@pytest.mark.parametrize(
    ("wanted", "expected"), [([2.0, 3.0], (0.5, 2.0)), ([2.0, -1.0], (0.3, 0.0)), ([-3.0, 2.0], (0.0, 2.0))]
)
def test_friction_is_of_the_nearest_terms_that_are_not_negative(
    wanted: list[float], expected: tuple[float, float]
) -> None:
    columns = np.array([[4.0, 0.0], [2.0, 1.0]])
    assert _nonnegative(columns, np.array(wanted)) == pytest.approx(expected)


def test_work_is_the_area_under_power() -> None:
    time = np.linspace(0.0, 2.0, 21)
    np.testing.assert_allclose(_integral(np.stack([time, 1.0 - time], 1), 10.0)[:, 0], 0.5 * time**2, atol=1e-12)


@pytest.mark.parametrize("late", [False, True])
def test_even_samples_are_smooth_in_even_times_alone(late: bool) -> None:
    even = 0.01 * np.arange(500)
    stamps = even + 3e-3 * np.random.default_rng(0).uniform(-1.0, 1.0, 500)
    position = np.sin(3.0 * (even if late else stamps))
    assert are_even(np.column_stack([position, np.zeros(500)]), stamps, even) == late


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_box_is_cut_where_the_least_of_it_is_lost(sign: float) -> None:
    """Of a square of 4, a corner is cut off by an eighth of one side, and not by three of the other."""

    def keeps(p: Array) -> Any:
        return (sign * p[:, 0] < 1.5) | (sign * p[:, 1] < 0.5)

    ends = np.full(2, -2.0), np.full(2, 2.0)
    found = _box(keeps, np.zeros(2), *ends, np.random.default_rng(0))
    expected = np.array([[-2.0, -2.0], [1.5, 2.0]])[:: int(sign)] * sign
    np.testing.assert_allclose(found, expected, atol=0.05)


@pytest.mark.parametrize(("least", "ends"), [(-0.5, (-0.5, 0.7)), (-np.inf, (-3.0, 0.7))])
def test_a_condition_is_a_side_in_place_of_its_widest_joint(least: float, ends: tuple[float, float]) -> None:
    """With a twentieth of its width kept clear."""
    condition = SimpleNamespace(weights={"a": 1.0, "b": 1.0}, lower=least, upper=0.7)
    description = SimpleNamespace(joint_names=("a", "b"), primary=(0, 1), loops=SimpleNamespace(conditions=[condition]))
    arm: Any = SimpleNamespace(description=description)
    one = np.ones(2)
    limits = MotionLimits(np.array([-1.0, -2.0]), np.array([1.0, 2.0]), np.array([3.0, 4.0]), one)
    found = _oblique(arm, limits)
    np.testing.assert_allclose(found.axes, [[1.0, 0.0], [-1.0, 1.0]])
    margin = 0.025 * (ends[1] - ends[0])
    np.testing.assert_allclose(found.lower, [-1.0, ends[0] + margin])
    np.testing.assert_allclose(found.upper, [1.0, ends[1] - margin])
    np.testing.assert_allclose(found.velocity, [2.0, 2.0])


def test_a_change_from_an_instant_on_explains_what_least_squares_says() -> None:
    rng = np.random.default_rng(0)
    Y, torque, parts = rng.normal(size=(40, 3)), rng.normal(size=40), np.arange(40) // 10
    N = np.stack([Y[parts == e].T @ Y[parts == e] for e in range(4)])
    m = np.stack([Y[parts == e].T @ torque[parts == e] for e in range(4)])
    for k, found in enumerate(_explained(N, m, 2), start=1):
        rows = np.where(np.arange(3) < 2, Y, Y * (parts >= k)[:, None])
        assert found == pytest.approx(torque @ rows @ np.linalg.lstsq(rows, torque)[0])


@pytest.mark.parametrize(
    ("held_out", "left", "told"),
    [
        ((0.24, 0.1), 0.15, ""),
        ((0.26, 0.1), 0.15, "26% of a's (10% where fitted) torques"),
        ((0.1, 0.24), 0.15, ""),
        ((0.1, 0.26), 0.15, ""),
        ((0.2, 0.2), 0.19, ""),
        ((0.2, 0.2), 0.21, "21% of the torques in the band of the motion, most at a"),
    ],
)
def test_rows_held_out_are_told_that_are_far_worse_than_those_fitted(
    held_out: tuple[float, float], left: float, told: str
) -> None:
    """Of joints that are judged: b is left out."""
    sums = SimpleNamespace(misfit=lambda x: np.array([0.01, 0.01]), square=np.ones((1, 2)))
    motors = [SimpleNamespace(position="p", torque="t")] * 2
    evidence: Any = SimpleNamespace(
        equations=lambda settings, blocks: sums,
        blocks=1,
        mechanism=SimpleNamespace(primary_joints=[Joint("a"), Joint("b")]),
        drives=SimpleNamespace(motors=motors),
    )
    fit: Any = SimpleNamespace(settings=SimpleNamespace(judging=lambda cutoff: None), x=None)
    judged: Any = SimpleNamespace(
        joint_relative_errors=np.array(held_out),
        cutoff=5.0,
        left_out=(1,),
        relative_error=left,
        joint_rms_errors=np.array([1.0, 2.0]),
    )
    words = list(poorly_predicted(evidence, fit, judged))
    assert len(words) == bool(told)
    assert told in "".join(words)


@pytest.mark.parametrize("joints", [1, 2])
def test_the_signs_of_all_torques_are_doubted_beside_that_of_each(joints: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listed_hypotheses, "_mixing", MagicMock())
    monkeypatch.setattr(listed_hypotheses, "_Motion", MagicMock())
    monkeypatch.setattr(listed_hypotheses, "turned_torques", lambda *given: ())
    rows = MagicMock()
    rows.evidence.mechanism.dof, rows.evidence.drives.motors = joints, [MagicMock()] * joints
    kinds = Counter(one.kind for one in listed_hypotheses._signs(rows))
    assert kinds.pop("sign of all torques", 0) == joints - 1
    assert set(kinds.values()) == {joints}


@pytest.mark.parametrize(
    ("name", "row", "positive"),
    [
        ("j1.viscous", [0.0, 1.0], True),
        ("j1.rotor_inertia", [1.0, 0.0], True),
        ("j1.rotor_inertia", [1.0, 0.5], False),  # beside links it is no rotor's own
        ("j1.offset", [0.0, 1.0], False),
        ("link1.mc_x", [1.0, 0.0], False),
    ],
)
def test_drives_own_terms_that_are_never_negative_are_positive(name: str, row: list[float], positive: bool) -> None:
    assert _is_positive(name, np.array(row)) == positive


def test_intervals_are_nearly_two_deviations_about_the_estimate_and_of_friction_from_zero_on() -> None:
    names = ("j1.viscous", "j2.viscous", "j1.offset", "j2.offset")
    model = SimpleNamespace(regrouping=np.eye(4))
    own: Any = SimpleNamespace(names=names, model=model, estimate=np.array([1.0, 9.0, 1.0, 1.0]))
    own.deviations, own.interval_deviations = np.array([1.0, 1.0, 1.0, np.inf]), None
    found = Identification.intervals.fget(own)  # type: ignore[attr-defined]
    np.testing.assert_allclose(found, [[0.0, 2.96], [7.04, 10.96], [-0.96, 2.96], [np.nan, np.nan]])
    own.interval_deviations = np.array([0.5, 1.0, 1.0, 1.0])
    assert Identification.intervals.fget(own)[0] == pytest.approx([0.02, 1.98])  # type: ignore[attr-defined]


def test_a_motion_is_a_message_of_its_samples_with_whole_seconds_apart() -> None:
    """Nanoseconds that round up to a second are one less."""
    time, p = np.array([0.0, 1.25, 2.9999999999]), np.random.default_rng(1).normal(size=(3, 3, 2))
    motion: Any = SimpleNamespace(sampled=lambda rate: (time, p[0], p[1], p[2], None))
    found = joint_trajectory(motion, ("a", "b"), 50.0)
    assert found["joint_names"] == ["a", "b"]
    times = [(one["time_from_start"]["sec"], one["time_from_start"]["nanosec"]) for one in found["points"]]
    assert times == [(0, 0), (1, 250_000_000), (2, 999_999_999)]
    for what, values in zip(("positions", "velocities", "accelerations"), p, strict=True):
        np.testing.assert_allclose([one[what] for one in found["points"]], values, rtol=1e-8)


@pytest.mark.parametrize(("seconds", "long"), [(1000.0, False), (1001.0, True)])
def test_logs_are_long_by_the_memory_of_their_rows(seconds: float, long: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A row has 8 bytes for each joint and parameter; of each cut-off there are some in a period."""
    mechanism = SimpleNamespace(dof=2, parameter_names=("x",) * 5)
    logs: Any = [SimpleNamespace(time=range(round(own * 10.0)), rate=10.0) for own in (seconds - 400.0, 400.0)]
    stretches = Stretches(logs, mechanism, None, 50.0, (2.0, 3.0))  # type: ignore[arg-type]
    monkeypatch.setattr(long_logs, "LONG", 1000.0 * 8.0 * 2.0 * 5.0 * ROWS_PER_PERIOD * 5.0)
    assert stretches.are_long is long
    monkeypatch.setattr(long_logs, "MANY", round(seconds * 10.0) - 1)
    assert stretches.are_long


@pytest.mark.parametrize(("dof", "rows", "most"), [(2, 4000.0, 0.1), (9, 10.0, 400.0 / (8.0 * 19.0))])
def test_a_long_log_keeps_a_part_of_each_block(
    dof: int, rows: float, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of rows' bytes in a second, or of the samples' where they are more; at most until the next block of its log."""
    monkeypatch.setattr(long_logs, "KEPT", 1200.0)
    monkeypatch.setattr(long_logs, "_cut", lambda log, start, stop: log.time[[start, stop - 1]].tolist())
    monkeypatch.setattr(long_logs, "SmoothMotion", SimpleNamespace(of=lambda part, *_: part))
    monkeypatch.setattr(long_logs, "replace", lambda part, whole: part)
    logs = [SimpleNamespace(time=0.01 * np.arange(500), rate=1.0) for _ in range(2)]
    own: Any = SimpleNamespace(
        mechanism=SimpleNamespace(dof=dof), logs=logs, _bytes=rows, edges=[(0, 0.0), (0, 0.05), (1, 0.0)], smooth=9.0,
        _grids=[SimpleNamespace(samples=500)] * 2,
    )  # fmt: skip
    expected = [[0.0, 0.05], [0.05, 0.05 + most], [0.0, most]]
    np.testing.assert_allclose(Stretches.windows(own), expected, atol=0.011)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "errors", "told"),
    [(0.004, (2.0, 1.0), "earlier"), (-0.004, (2.0, 1.0), "later"), (0.004, (1.0, 1.0), None)],
)
def test_a_delay_is_taken_off_where_rows_held_out_are_predicted_better(
    value: float, errors: tuple[float, float], told: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def evidence(name: str) -> Any:
        fit = SimpleNamespace(x=name, deviations=np.ones(1))
        return SimpleNamespace(blocks=2, name=name, advanced=lambda by: evidence(f"{name} {by}"), fit=lambda *_: fit)

    monkeypatch.setattr(delay, "_error", lambda judged, x, deviations: errors[str(value) in judged.name])
    monkeypatch.setattr(delay, "_settings", lambda *_: None)
    likely: Any = SimpleNamespace(counts=True, value=value, words="late", outcome="4 ms")
    found = delay.without_delay(likely, evidence("fitted"), evidence("held"))
    assert (found.remark is None) == (told is None)
    assert told is None or f"as much {told} " in str(found.remark)
    names = [f"fitted {value}", f"held {value}"] if told else ["fitted", "held"]
    assert [found.evidence.name, found.judged.name] == names  # type: ignore[attr-defined]
    likely.counts = False
    assert delay.without_delay(likely, evidence("fitted"), evidence("held")).remark is None
