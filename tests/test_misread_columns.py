"""Logs whose sampling rate changes, and whose positions are velocities: told by what the columns show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_logs import known, motion

from adaptctl.arrays import Array
from adaptctl.description.joint import Limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification import rate_change
from adaptctl.identification.columns import JointLog
from adaptctl.identification.preparation import prepare
from adaptctl.identification.rate_change import _bend, _factor, validate_one_rate

RATE, ROWS = 200.0, 2000


def log_of(position: Array, velocity: Array | None = None) -> JointLog:
    return JointLog("mine.csv", np.arange(len(position)) / RATE, position, position, velocity)


def moved(seed: int, dof: int = 3) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations of a rich motion."""
    return motion(dof, np.random.default_rng(seed), ROWS / RATE, RATE)[1:]


def limited(speed: float) -> Mechanism:
    """A chain whose joints have a limit of the speed."""
    arm = known(0).guess
    wide = Limits(-20.0, 20.0, speed, 1e6)
    links = [replace(link, joint=replace(link.joint, limits=wide)) for link in arm.links]
    return type(arm)(replace(arm.description, links=tuple(links)))


@pytest.mark.parametrize("factor", [2, 4, 10])
@pytest.mark.parametrize("rows", [ROWS, ROWS // 2])
def test_a_rate_that_changes_is_told_at_its_row(factor: int, rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rate_change, "COMPARED", rows)
    monkeypatch.setattr(rate_change, "BEFORE", rows // 4)
    half = ROWS // 2
    slower = moved(2)[0][np.r_[:half, half:ROWS:factor]]
    for position, row in ((slower, half), (slower[::-1], len(slower) - 1 - half)):
        ratio = float(factor) if row == half else 1.0 / factor
        with pytest.raises(
            InputError,
            match=r"row to row: the sampling rate changes there, .*give each row its own time, or cut the log",
        ) as told:
            validate_one_rate(log_of(position))
        time, times = (float(str(told.value).split(word)[0].split()[-1]) for word in (" s on,", " times as far"))
        assert time == pytest.approx(row / RATE, abs=1.5 / RATE)
        assert times == pytest.approx(ratio, rel=0.15)


@pytest.mark.parametrize("seed", range(8))
def test_a_rate_that_stays_is_told_nothing_whatever_else_there_is(seed: int) -> None:
    """Noise, lost rows, a slip of one encoder, and a start and a stop."""
    rng = np.random.default_rng(seed)
    position = moved(seed, 2 + seed % 4)[0] + 10.0 ** rng.uniform(-6.0, -2.5) * rng.normal(size=(ROWS, 2 + seed % 4))
    lost = np.delete(position, np.s_[900 : 901 + int(rng.integers(30))], axis=0)
    slipped = position + 0.5 * (np.arange(ROWS) > 700)[:, None] * np.eye(position.shape[1])[0]
    begun = np.concatenate([np.repeat(position[:1], 300, axis=0), position, np.repeat(position[-1:], 300, axis=0)])
    for right in (position, lost, slipped, begun):
        validate_one_rate(log_of(right))


def changing(*ways: float, span: int = 1) -> tuple[float, int, float] | None:
    """What is found of two joints that move by such ways, each for twenty rows but the last three, and one at rest."""
    *before, own, first, last = ways
    steps = np.concatenate([np.repeat(before, 20), np.repeat([own, first, last], [20, 1, 20])])
    return _bend(np.cumsum(steps)[:, None] * [0.01, -0.02, 0.0], span)


@pytest.mark.parametrize(
    ("ways", "found"),
    [
        ((1.0, 1.6, 1.6), 1.6),
        ((1.0, 1.4, 1.4), None),  # a change of speed
        ((1.6, 1.0, 1.0), 1.0 / 1.6),
        ((1.0, 14.5, 14.5), 14.5),
        ((1.0, 15.5, 15.5), None),  # a jump
        ((1.0, 2.0, 2.44), 2.0),
        ((1.0, 2.0, 2.49), None),  # it does not last
        ((1.0, 2.0, 1.6), None),
        ((1.47, 1.0, 2.0, 2.0), 2.0),
        ((1.53, 1.0, 2.0, 2.0), None),  # there is half as large a change elsewhere
    ],
)
def test_a_rate_changes_where_ways_have_a_lasting_factor_that_is_twice_any_other_change(
    ways: tuple[float, ...], found: float | None
) -> None:
    row = 20 * (len(ways) - 2)
    for span in (1, 2) if ways[-1] == ways[-2] else (1,):
        told = changing(*ways, span=span)
        assert (told is None) == (found is None)
        if told and found:
            clear, at, factor = told
            assert (at, factor) == (row - 1, pytest.approx(found))
            elsewhere = abs(ways[0] - ways[1]) if len(ways) == 4 else 1e-9
            assert clear == pytest.approx(abs(ways[-2] - ways[-3]) / elsewhere) or clear > 1e6


@pytest.mark.parametrize(("later", "found"), [(2.47, True), (2.53, False)])
def test_changes_after_that_of_a_rate_count_too(later: float, found: bool) -> None:
    steps = np.repeat([1.0, 2.0, later], 20)
    assert (_bend(np.cumsum(steps)[:, None] * [0.01, -0.02], 1) is not None) == found


@pytest.mark.parametrize(
    ("before", "after", "factor"),
    [
        ([1.0, 1.0], [3.0, 2.8], 2.9),
        ([1.0, -0.21, 0.1], [2.0, -0.42, 0.2], 2.0),
        ([1.0, -0.19, 0.1], [2.0, -0.38, 0.2], 1.0),  # one joint alone
        ([1.0], [2.0], 1.0),
        ([1.0, 1.0], [2.0, 1.25], 1.625),
        ([1.0, 1.0], [2.0, 1.15], 1.0),  # not along
        ([0.0, 0.0], [2.0, 2.0], 1.0),
    ],
)
def test_a_factor_is_that_of_ways_of_several_joints_alike(
    before: list[float], after: list[float], factor: float
) -> None:
    assert _factor(np.array(before), np.array(after)) == pytest.approx(factor)


def test_positions_and_velocities_in_each_others_columns_are_told_apart_from_wrong_units() -> None:
    p, v, a = moved(1)
    arm = limited(20.0)
    prepare(log_of(p, v), arm)
    with pytest.raises(InputError, match="they are exchanged; exchange their names, in the log or by columns"):
        prepare(log_of(v, p), arm)
    for both in (p, v):
        with pytest.raises(InputError, match=r"columns of position and velocity have the same values: .* omit the"):
            prepare(log_of(both, both), arm)
    with pytest.raises(InputError, match=r"joint 'joint0': logged velocities are .* times the differentiated"):
        prepare(log_of(p, a), arm)


def test_positions_that_are_velocities_are_asked_for_where_these_are_within_all_limits() -> None:
    p, v, _ = moved(1)
    arm = limited(1.05 * float(np.abs(v).max()))
    fast = "joint 'joint.' moves at .*; {}check the gear ratio, and whether positions are in deg"
    velocities = fast.format("are positions velocities, as which all joints' are within the limits. Else ")
    with pytest.raises(InputError, match=velocities):
        prepare(log_of(v), arm)
    with pytest.raises(InputError, match=fast.format("")):
        prepare(log_of(20.0 * p), arm)
