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
from adaptctl.identification import listed_hypotheses
from adaptctl.identification.column_names import offer
from adaptctl.identification.contradictions import poorly_predicted
from adaptctl.identification.energy_differences import _integral
from adaptctl.identification.late_stamps import are_even
from adaptctl.identification.regular_range import _box, _oblique
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
