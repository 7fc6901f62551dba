"""Decisions of identification just within and just beyond what they are taken by."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.description import Joint, Limits
from adaptctl.identification import choice, listed_hypotheses
from adaptctl.identification.choice import _Selection
from adaptctl.identification.entropic import EntropicPrior
from adaptctl.identification.exchanged_columns import are_velocities
from adaptctl.identification.fit import LogEvidence
from adaptctl.identification.hypothesis_rows import HypothesisRows
from adaptctl.identification.listed_hypotheses import _gravities
from adaptctl.identification.preparation import MAX_RANGE_EXCESS, _fitting


@pytest.mark.parametrize(("beyond", "told"), [(0.0, "of the other sign"), (1e-6, "")])
@pytest.mark.parametrize("lower", [False, True])
def test_positions_of_the_other_sign_are_within_limits_by_an_excess(beyond: float, told: str, lower: bool) -> None:
    arm: Any = SimpleNamespace(primary_joints=[Joint("j", limits=Limits(-1.0, 2.0))])
    least, most = -2.0 - MAX_RANGE_EXCESS - beyond * (not lower), 1.0 + MAX_RANGE_EXCESS + beyond * lower
    assert told in _fitting(np.array([least]), np.array([most]), arm, 0)
    assert bool(_fitting(np.array([least]), np.array([most]), arm, 0)) is bool(told)


def test_positions_are_exchanged_where_each_is_within_the_others_limits() -> None:
    names, ranges = "jkl", ((-1.0, 1.0), (2.0, 4.0), (-9.0, 9.0))
    joints = [Joint(name, limits=Limits(*own)) for name, own in zip(names, ranges, strict=True)]
    least, most = np.array([2.5, -0.5, -8.0]), np.array([3.5, 0.5, 8.0])
    assert _fitting(least, most, SimpleNamespace(primary_joints=joints), 0) == (  # type: ignore[arg-type]
        "exchanged with those of 'k' they would be within; "
    )


def test_sums_are_kept_for_twelve_settings_at_most() -> None:
    made: list[int] = []
    sums = SimpleNamespace(over=lambda blocks: SimpleNamespace(without=lambda left: made.append(blocks[0]) or blocks))
    evidence: Any = SimpleNamespace(_summed={}, sums=lambda *_: sums)
    settings: Any = SimpleNamespace(cutoff=1.0, slow=0.0, lasting=(), left_out=())
    for block in (*range(12), *range(12), 12, 0):
        assert LogEvidence.equations(evidence, settings, [block]) == [block]
        assert len(evidence._summed) <= 12
    assert made == [*range(13), 0]  # the thirteenth takes the place of all


@pytest.mark.parametrize(
    ("kinds", "placeholders"),
    [([1], False), ([1, 1], True), ([1, 2], False), ([1, 1, 2, 3], False), ([1, 1, 1, 2, 3], True)],
)
def test_more_than_half_of_several_links_alike_are_placeholders(kinds: list[int], placeholders: bool) -> None:
    ten = np.array([1.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.1, 0.0, 0.0, 0.1])
    prior = EntropicPrior(np.outer(kinds, ten), np.zeros(0, dtype=np.int64), np.zeros(0))
    assert prior.is_placeholder is placeholders


@pytest.mark.parametrize(
    ("slope", "gear", "told"),
    [(0.09, 1.0, True), (0.11, 1.0, False), (11.0, 11.0, True), (11.0, 9.0, False), (9.0, 11.0, False)],
)
def test_torques_are_on_the_other_side_of_gears_that_are_ten_times_off(slope: float, gear: float, told: bool) -> None:
    drives = SimpleNamespace(transmission=np.diag([1.0, -gear]))
    rows: Any = SimpleNamespace(evidence=SimpleNamespace(drives=drives), _steady=lambda *_: True)
    slopes = np.array([0.9 * slope, -slope])
    assert HypothesisRows._geared(rows, slopes, np.ones(2)) is told
    rows._steady = lambda *_: False
    assert not HypothesisRows._geared(rows, slopes, np.ones(2))


@pytest.mark.parametrize(
    ("share", "slopes", "steady"),
    [(0.41, (1.0, -2.9), True), (0.39, (1.0, 2.9), False), (0.41, (1.0, 3.1), False), (0.9, (-3.1, 1.0), False)],
)
def test_slopes_are_alike_within_a_factor_of_three_that_explain_two_fifths(
    share: float, slopes: tuple[float, float], steady: bool
) -> None:
    assert HypothesisRows._steady(None, np.array(slopes), np.array([0.9, share])) is steady  # type: ignore[arg-type]


@pytest.mark.parametrize(("angle", "refuses"), [(0.19, False), (0.21, True)])
def test_gravity_is_refused_that_is_a_fifth_of_a_radian_off(
    angle: float, refuses: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    down = np.array([0.0, 0.0, -20.0])
    tilted = 20.0 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    monkeypatch.setattr(listed_hypotheses, "_Pull", SimpleNamespace(of=lambda *_: SimpleNamespace(none=None)))
    monkeypatch.setattr(listed_hypotheses, "_under", lambda mechanism, gravity: None)
    monkeypatch.setattr(listed_hypotheses, "_tilted", lambda rows, pull, tried: tilted)
    times = SimpleNamespace(best=lambda: SimpleNamespace(words="", value=1.0), equations=len)
    monkeypatch.setattr(listed_hypotheses, "ScaledTimes", SimpleNamespace(of=lambda *_: times))
    mechanism = SimpleNamespace(description=SimpleNamespace(gravity=down), num_energy_parameters=0)
    evidence = SimpleNamespace(mechanism=mechanism, drives=SimpleNamespace(time="t"))
    still = np.zeros((1, 1))
    rows: Any = SimpleNamespace(
        evidence=evidence, position=still, velocity=still, acceleration=still, sums=len, regressor=lambda *_: None,
        rows=SimpleNamespace(torque=None),
    )  # fmt: skip
    turned = [one.refuses for one in _gravities(rows) if one.kind == "gravity turned"]
    assert turned == [True] * 5 + [refuses]  # along the axes of the base but that of the file, and tilted


def test_heavier_priors_than_those_near_the_best_are_tried_at_last(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[Any] = [SimpleNamespace(weight=float(k)) for k in range(6)]
    asked: list[list[float]] = []
    monkeypatch.setattr(choice, "misfit_ratio", lambda evidence, fit: 1.0)
    monkeypatch.setattr(choice, "_near", lambda given, ratios: given[:3])
    monkeypatch.setattr(choice, "_rests", lambda evidence: [])
    monkeypatch.setattr(
        _Selection, "best", lambda self, given, *_: asked.append([s.weight for s in given]) or given[-1]
    )
    evidence: Any = SimpleNamespace(blocks=2, fits=lambda settings, parts: [None])
    assert _Selection(evidence, []).weighted(tried).weight == 5.0
    assert asked == [[0.0, 1.0, 2.0], [2.0, 3.0, 4.0, 5.0]]


@pytest.mark.parametrize(
    ("speed", "drift", "told"), [(2.0, 0.99, True), (-2.0, -0.99, True), (2.001, 0.99, False), (2.0, 1.01, False)]
)
def test_velocities_are_within_their_limits_and_lead_to_positions_that_are(
    speed: float, drift: float, told: bool
) -> None:
    """Of all joints in all logs: 2 rad/s, and a range of 1 rad from wherever a log begins."""
    joints = [Joint(name, limits=Limits(3.0, 4.0, velocity=2.0)) for name in "ab"]
    time = 0.1 * np.arange(11)
    still = np.zeros((11, 2))
    moving = still.copy()
    moving[:, 1] = drift
    moving[4:8, 0] = speed, -speed, -speed, speed
    assert are_velocities([(time, still), (time, moving)], joints) == told
