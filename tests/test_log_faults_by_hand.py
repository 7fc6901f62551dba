"""Faults of logs, just within and just beyond what counts as one, on columns small enough to be reckoned by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.description import Joint
from adaptctl.errors import InputError
from adaptctl.identification import log_checks as checks
from adaptctl.identification.hypothesis_rows import HypothesisRows
from adaptctl.identification.lasting_noise import Whitening
from adaptctl.identification.listed_hypotheses import _weighs
from adaptctl.identification.one_way import one_way_joints
from adaptctl.identification.position_faults import frozen_position, odd_stamps, slips
from adaptctl.identification.preparation import _validate_small_steps
from adaptctl.identification.time_scale import ScaledTimes, TimeScale
from adaptctl.identification.validation import _swing_words

JOINT = Joint("j")
STEADY = 0.01 * np.arange(400.0)
"""A position that moves by 0.01 rad a row"""
OWN = np.sin(np.arange(400.0))
"""Torques of which no two are the same"""


@pytest.mark.parametrize(("off", "told"), [(0.07, False), (0.09, True)])
def test_a_joint_jumps_eight_times_as_far_as_it_moves(off: float, told: bool) -> None:
    values = STEADY.copy()
    values[200] += off
    assert np.flatnonzero(checks._impossible(values)[0]).tolist() == [200] * told


@pytest.mark.parametrize(("off", "told"), [(0.009, False), (0.012, True)])
def test_a_joint_that_hardly_moves_jumps_a_hundredth_of_a_radian(off: float, told: bool) -> None:
    values = 1e-4 * np.arange(400.0)
    values[200] += off
    assert checks._impossible(values)[0].any() == told


@pytest.mark.parametrize(("rows", "told"), [(20, True), (21, False)])
def test_an_outlier_is_back_within_twenty_rows(rows: int, told: bool) -> None:
    values = STEADY.copy()
    values[200 : 200 + rows] += 1.0
    assert np.count_nonzero(checks._impossible(values)[0]) == rows * told


def test_rows_between_two_outliers_are_sound() -> None:
    values = STEADY.copy()
    values[[200, 205]] += 1.0
    assert np.flatnonzero(checks._impossible(values)[0]).tolist() == [200, 205]


@pytest.mark.parametrize(("times", "told"), [(11.0, False), (13.0, True)])
def test_a_spike_is_twelve_times_the_noise(times: float, told: bool) -> None:
    torque = np.random.default_rng(0).normal(size=400)
    torque[195:206] = 0.0
    noise = np.median(np.abs(torque - checks.median_of_five(torque)))
    torque[200] = times * noise
    assert checks._spiked(torque)[200] == told


@pytest.mark.parametrize(("off", "told"), [(0.95, False), (1.05, True)])
def test_a_spike_is_half_the_range_of_torques(off: float, told: bool) -> None:
    torque = np.linspace(-1.0, 1.0, 401)
    torque[200] += off
    assert checks._spiked(torque)[200] == told


@pytest.mark.parametrize(
    ("counts", "told"),
    [
        ([9, 1, 1, 1, 1, 1], False),
        ([10, 1, 1, 1, 1, 1], True),
        ([11, 1, 1, 1, 1, 2], False),
        ([12, 1, 1, 1, 1, 2], True),
        ([12, 1, 1, 1, 1, 1, 3], True),
        ([12, 1, 1, 1, 1], False),
    ],
)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_clipped_torques_are_six_times_as_many_as_any_of_the_next_five(
    counts: list[int], told: bool, sign: float
) -> None:
    torque = sign * np.repeat(-np.arange(1.0, len(counts) + 1.0), counts)
    assert list(checks._clipped(torque)) == [(-sign, counts[0])] * told


@pytest.mark.parametrize(("count", "told"), [(19, False), (20, True)])
def test_clipped_torques_are_a_share_of_the_rows(count: int, told: bool) -> None:
    torque = np.linspace(0.0, 1.0, 10_000)
    torque[-count:] = 2.0
    assert bool(list(checks._clipped(torque))) == told


def frozen(torque: Array, rows: int, period: float) -> bool:
    """Whether a torque is found frozen that keeps one value for some rows from row 100 on."""
    held = np.concatenate([torque[:100], np.full(rows, torque[100] + 1e-3), torque[101:]])
    found = checks._frozen(held, 0.01 * np.arange(len(held)), period * np.arange(len(held)))
    assert found in ((0, 0), (100, 100 + rows))
    return found != (0, 0)


@pytest.mark.parametrize(
    ("rows", "period", "run", "told"),
    [
        (19, 0.01, 1, False),
        (20, 0.01, 1, True),
        (25, 4e-3, 1, False),
        (27, 4e-3, 1, True),
        (29, 0.01, 3, False),
        (31, 0.01, 3, True),
    ],
)
def test_a_frozen_torque_lasts_a_tenth_of_a_second_and_ten_usual_runs(
    rows: int, period: float, run: int, told: bool
) -> None:
    assert frozen(np.repeat(OWN, run)[101 - 100 % run - 1 if run > 1 else 0 :], rows, period) == told


@pytest.mark.parametrize(("rows", "told"), [(31, False), (32, True)])
def test_a_frozen_torque_lasts_four_times_as_long_as_the_fifth_longest_run(rows: int, told: bool) -> None:
    torque = OWN.copy()
    for start in (200, 230, 260, 290):
        torque[start : start + 8] = torque[start]
    assert frozen(torque, rows, 0.01) == told


def test_torques_fall_to_zero_where_they_are_clearly_there_and_never_negative() -> None:
    assert checks._falls(np.tile([1.0, 0.16, 0.02, 0.0], 5)) == 5
    assert checks._falls(np.tile([1.0, 0.14, 0.05, 1.0], 5)) == 0
    assert checks._falls(np.append(np.tile([1.0, 0.0], 5), -1e-9)) == 0


@pytest.mark.parametrize(("width", "told"), [(2e-4, True), (4e-4, False)])
def test_a_dead_torque_changes_by_less_than_a_share_of_the_others(width: float, told: bool) -> None:
    torque = [np.array([0.0, 1.0]), np.array([5.0, 5.0 + width])]
    assert checks._dead([np.array([0.0, 0.02])] * 2, torque).tolist() == [False, told]
    assert not checks._dead([np.array([0.0, 0.009])] * 2, torque).any()


def test_a_quantum_is_that_of_columns_whose_values_come_again() -> None:
    assert checks._quantum(np.repeat(0.1 * np.arange(50), 3)) == pytest.approx(0.1)
    assert checks._quantum(np.repeat(0.1 * np.arange(50), 2)) == 0.0
    assert checks._quantum(np.zeros(50)) == 0.0


@pytest.mark.parametrize(
    ("speed", "step", "beside", "told"),
    [
        (1e-3, 0.009, 0.0, False),
        (1e-3, 0.012, 0.0, True),
        (0.01, 0.075, 0.0, False),
        (0.01, 0.085, 0.0, True),
        (0.01, 0.1, 0.024, True),
        (0.01, 0.1, 0.026, False),
    ],
)
def test_an_encoder_slips_eight_times_as_far_as_it_moves_and_four_times_as_far_as_beside(
    speed: float, step: float, beside: float, told: bool
) -> None:
    ways = np.full(400, speed)
    ways[200], ways[201] = step, beside or speed
    values = np.concatenate([[0.0], np.cumsum(ways)])
    assert slips(values, np.ones(400), np.zeros(401, dtype=np.bool_)) == [201] * told
    assert slips(values, np.ones(400), np.arange(401) == 200) == []


@pytest.mark.parametrize(
    ("rows", "period", "speed", "least", "told"),
    [
        (19, 0.01, 0.01, 1e-4, False),
        (20, 0.01, 0.01, 1e-4, True),
        (25, 4e-3, 0.01, 1e-4, False),
        (27, 4e-3, 0.01, 1e-4, True),
        (40, 0.01, 0.0024, 1e-4, False),
        (40, 0.01, 0.0026, 1e-4, True),
    ],
)
def test_a_frozen_position_stops_and_starts_at_a_quarter_of_the_top_speed(
    rows: int, period: float, speed: float, least: float, told: bool
) -> None:
    ways = np.full(400, 0.01)
    ways[200:220], ways[20] = speed, least
    ways = np.insert(ways, 210, np.zeros(rows - 1))
    values = np.concatenate([[0.0], np.cumsum(ways)])
    assert bool(list(frozen_position(period * np.arange(len(values)), values, JOINT))) == told


def stamped(factors: Array, jitter: float = 0.0, rows: int = 6) -> list[str]:
    """Words on the stamps of two joints that move by some factors (2,) of their way in some rows."""
    phase = 2.0 * np.pi * np.arange(300) / 300.0
    ways = np.column_stack([1.02 - np.cos(phase), 2.04 - 2.0 * np.cos(phase + 0.1)])
    ways[100 : 100 + 16 * rows : 16] *= factors
    time = np.arange(301.0) + jitter * (np.arange(301) % 10 == 0)
    return odd_stamps(time, np.concatenate([[[0.0, 0.0]], np.cumsum(ways * np.diff(time)[:, None], axis=0)]))


@pytest.mark.parametrize(
    ("factors", "jitter", "told"),
    [
        ((1.45, 1.45), 0.0, True),
        ((1.35, 1.35), 0.0, False),
        ((0.55, 0.55), 0.0, True),
        ((2.12, 1.88), 0.0, True),
        ((2.2, 1.8), 0.0, False),
        ((1.0, 2.0), 0.0, False),
        ((2.0, 2.0), 0.08, True),
        ((2.0, 2.0), 0.12, False),
    ],
)
def test_rows_are_lost_where_all_joints_move_alike_and_two_fifths_off(
    factors: tuple[float, float], jitter: float, told: bool
) -> None:
    assert bool(stamped(np.array(factors), jitter)) == told


@pytest.mark.parametrize(("rows", "told"), [(4, False), (5, True)])
def test_rows_are_lost_five_times_or_not_at_all(rows: int, told: bool) -> None:
    assert bool(stamped(np.array([2.0, 2.0]), rows=rows)) == told


@pytest.mark.parametrize(
    ("back", "speed", "told"), [(9, 1.0, True), (11, 1.0, False), (100, 0.09, True), (100, 0.11, False)]
)
def test_a_joint_has_one_way_where_a_hundredth_of_its_rows_has_the_other(back: int, speed: float, told: bool) -> None:
    velocity = 3.0 * np.append(np.ones(1000 - back), np.full(back, -speed))
    rows = {1.0: SimpleNamespace(velocity=np.column_stack([velocity, -velocity]))}
    arm = SimpleNamespace(primary_joints=[JOINT, Joint("k")])
    evidence: Any = SimpleNamespace(band=1.0, rows=rows, mechanism=arm)
    assert one_way_joints(evidence) == ["j", "k"] * told


@pytest.mark.parametrize(("mean", "told"), [(0.09, True), (-0.09, True), (0.11, False), (-0.11, False)])
def test_positions_swing_about_zero_that_are_a_tenth_of_their_swing_off(mean: float, told: bool) -> None:
    swing = np.array([[1.0, 1.0], [-1.0, -1.0]])
    evidence: Any = SimpleNamespace(motions=[SimpleNamespace(position=swing + np.array([mean, 0.0]))])
    assert ("about 0" in _swing_words(evidence)) == told


@pytest.mark.parametrize("octave", [-2.3, -0.4, 0.1, 0.4, 3.0])
def test_times_are_of_the_scale_that_fits_best(octave: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Or of the log's where none of half an octave or more is better."""
    monkeypatch.setattr(ScaledTimes, "_error", lambda self, blocks: lambda some: abs(some - octave))
    found = np.log2(ScaledTimes(None, None).best().value)  # type: ignore[arg-type]
    assert found == (pytest.approx(octave, abs=0.04) if abs(octave) > 0.25 else 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_times_are_at_most_five_and_a_half_octaves_off(sign: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four, a half, and its halves down to a thirty-second."""
    monkeypatch.setattr(ScaledTimes, "_error", lambda self, blocks: lambda some: abs(some - sign * 9.0))
    found = ScaledTimes(None, None).best()  # type: ignore[arg-type]
    assert sign * np.log2(found.value) == pytest.approx(5.5 - 1.0 / 32.0)


def test_the_scale_of_times_deviates_as_the_jackknife_of_its_blocks_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whose variance is n - 1 times that of the estimates without each block (Efron 1982)."""

    def error(self: ScaledTimes, blocks: Sequence[int]) -> Callable[[float], float]:
        (left,) = set(range(6)) - {*blocks} or {0}
        return lambda octave: abs(octave - 1.0 - left / 32.0)

    monkeypatch.setattr(ScaledTimes, "_error", error)
    found = ScaledTimes(None, None).best()  # type: ignore[arg-type]
    each = np.log(2.0) * np.arange(6) / 32.0
    assert (found.value, found.deviation) == (
        2.0,
        pytest.approx(np.sqrt(5.0 / 6.0 * np.sum((each - each.mean()) ** 2))),
    )


@pytest.mark.parametrize(
    ("value", "deviation", "counts"), [(1.26, 0.0, True), (1.24, 0.0, False), (0.5, 0.08, True), (0.5, 0.09, False)]
)
def test_times_are_wrong_by_a_quarter_and_eight_deviations(value: float, deviation: float, counts: bool) -> None:
    assert TimeScale(value, deviation).counts == counts


def test_a_scale_of_times_is_told_with_its_interval() -> None:
    assert TimeScale(2.0, 0.1).words == "true times are 2 times the log's (95 % within 1.64 to 2.43)"


def test_a_body_that_was_carried_has_a_mass() -> None:
    assert [_weighs(1, np.array([9.0, mass])) for mass in (-1.0, 0.0, 1e-9)] == [False, False, True]


def test_rows_count_that_are_faster_than_a_share_of_their_joints_peak() -> None:
    peaks = np.array([3.0, 0.5])
    rows = SimpleNamespace(velocity=np.outer([-0.051, 0.049, 1.0], peaks), moving=np.array([True, True, False]))
    own = SimpleNamespace(rows=rows, velocity=np.stack([peaks, -peaks]))
    assert HypothesisRows.used.func(own).tolist() == [[True, True], [False, False], [False, False]]


@pytest.mark.parametrize(("step", "told"), [(0.75 * np.pi, ""), (0.751 * np.pi, "at 0.2 s by 2.36 rad besides")])
def test_steps_beside_jumps_by_turns_are_of_less_than_half_a_turn(step: float, told: str) -> None:
    """By a quarter less; a joint that does not jump may move as it likes."""
    position = np.column_stack([np.zeros(4), [0.0, 3.0, 0.0, 0.0], [0.1, 0.1, 0.1, 0.1]])
    position[3, 0] = -step
    log: Any = SimpleNamespace(source="log", time=0.1 * np.arange(4), position=position)
    arm: Any = SimpleNamespace(primary_joints=[JOINT, Joint("k"), Joint("l")])
    with pytest.raises(InputError, match=told) if told else nullcontext():
        _validate_small_steps(log, position, [2, 0], arm)
    _validate_small_steps(log, position, [], arm)


def test_rows_are_as_white_by_parts_as_at_once() -> None:
    time, values = 0.1 * np.arange(9.0), np.random.default_rng(0).normal(size=(9, 1))
    found = []
    for parts in ([range(9)], [range(4), range(4, 9)]):
        own, whitening = values.copy(), Whitening([0.3], 2.0)
        for part in parts:
            own[part] = whitening._innovations(0, np.zeros(len(part), np.int64), time[part], values[part])
        found.append(own)
    np.testing.assert_allclose(*found)
