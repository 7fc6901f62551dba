"""Kinds of motion whose noise an observer of external torques tells apart, and the squares it counts, by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.control import ExternalTorque, Touch
from adaptctl.control.adaptation import two_stage_filter
from adaptctl.control.adaptation.external_torque import KINDS, Missed, judged
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.two_stage_filter import FilteredPrediction
from adaptctl.scalars import Column

FAST, CREEPING, STILL = range(3)
T, CUTOFF, MIN_SPEED = 1e-3, 40.0, 0.1
SETTLED = 4.0 / CUTOFF


def after(speed: float, moving: float, torque: float = 2.0, alarmed: float = 0.0, seen: float = 0.0) -> Touch:
    """State of one joint after a period, whose noise was 1 before, over so many seconds of each kind."""
    none, one, each = Column((0.0,)), Column((1.0,)), Column((1.0,) * KINDS)
    before: Any = Touch(
        none, none, each, Column((seen,) * KINDS), none, Column((2.5, 3.8)), Column((0.0, 0.0)), Column((moving,)), None
    )  # type: ignore[arg-type]
    missed = Missed(Column((torque,)), none, Column((1e6,)), alarmed)
    prediction: Any = FilteredPrediction([], one, Column((speed,)), one, None)  # type: ignore[arg-type]
    period: Any = Period(None, *5 * [None], T, T, None)  # type: ignore[arg-type]
    return judged(ExternalTorque(CUTOFF, 60.0), prediction, missed, period, [MIN_SPEED], before)


@pytest.mark.parametrize(
    ("speed", "moving", "kind"),
    [
        (0.41, 1.0, FAST),
        (-0.41, 1.0, FAST),
        (0.39, 1.0, CREEPING),
        (-0.101, 1.0, CREEPING),
        (0.099, 1.0, STILL),
        (1.0, SETTLED + 0.5 * T, FAST),
        (1.0, SETTLED - 1.5 * T, STILL),  # it turned, and filters hold what was before
    ],
)
def test_noise_is_learned_of_one_kind_of_motion(speed: float, moving: float, kind: int) -> None:
    found = after(speed, moving, torque=3.0)
    assert [float(x) for x in found.seen] == [T * (k == kind) for k in range(KINDS)]
    assert [float(x) for x in found.noise] == [9.0 if k == kind else 1.0 for k in range(KINDS)]  # the first square
    assert float(found.moving[0]) == pytest.approx(moving + T if abs(speed) > MIN_SPEED else 0.0)


@pytest.mark.parametrize(("torque", "alarmed", "counted"), [(2.0, 0.0, 4.0), (20.0, 0.0, 9.0), (20.0, 1.0, 2.0)])
def test_a_push_counts_as_nine_times_the_noise_and_as_twice_while_doubted(
    torque: float, alarmed: float, counted: float
) -> None:
    """After four seconds a square is one of those of a second."""
    found = after(1.0, 5.0, torque, alarmed, seen=4.0 - T)
    assert float(found.noise[FAST]) == pytest.approx(1.0 + T * (counted - 1.0), rel=1e-6)
    assert float(found.seen[FAST]) == pytest.approx(4.0)


def test_squares_are_averaged_over_a_minute_at_most() -> None:
    found = after(1.0, 5.0, 2.0, seen=1000.0)
    assert float(found.noise[FAST]) == pytest.approx(1.0 + T / 60.0 * 3.0, rel=1e-6)


def test_levels_before_any_torque_are_those_of_gaussian_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which passes a level c of its deviation at a rate w/pi exp(-c^2/2), w being the cutoff."""
    observer = ExternalTorque(CUTOFF, 60.0)
    probes = np.sqrt(2.0 * np.log(CUTOFF / np.pi * np.array([3.0, 3.0, 60.0, 60.0])))
    monkeypatch.setattr(two_stage_filter, "start", lambda *_: None)
    model: Any = SimpleNamespace(mechanism=SimpleNamespace(dof=2))
    start = observer.start(model, np.zeros(2), np.zeros(2), T)
    np.testing.assert_allclose(start.probes, probes)
    assert [len(part) for part in start[:-1]] == [2, 2, 6, 6, 2, 4, 4, 2]
