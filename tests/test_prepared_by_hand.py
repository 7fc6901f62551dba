"""Steps that make logs ready, on columns whose results are reckoned by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import welch

from adaptctl.arrays import Array
from adaptctl.description import Joint, JointKind, Limits
from adaptctl.errors import FileError, InputError
from adaptctl.identification import preparation
from adaptctl.identification.columns import JointLog, _jumps_by_turns
from adaptctl.identification.complete_rows import complete_rows
from adaptctl.identification.filtered_dynamics import RowFilter, SmoothMotion, motion_band, position_spectrum
from adaptctl.identification.gathering import _validate_enough
from adaptctl.identification.log_files import table
from adaptctl.identification.preparation import PreparedLog, filtered, prepare, whole_ends

TURN = 2.0 * np.pi


def log_of(*columns: Array, time: Array | None = None, rate: float = 100.0, **more: Any) -> JointLog:
    position = np.stack(columns, axis=-1)
    return JointLog(
        "a.csv", np.arange(len(position)) / rate if time is None else time, position, 5.0 * position, **more
    )


def arm_of(*joints: Joint, loops: Any = None) -> Any:
    return SimpleNamespace(primary_joints=joints, description=SimpleNamespace(loops=loops))


def turning(lower: float, upper: float) -> Joint:
    return Joint("j", limits=Limits(lower, upper))


RISING = np.linspace(0.0, 9.0, 91)


@pytest.mark.parametrize(
    ("limits", "turns"),
    [((-1.0, 10.0), 0), ((-8.0, 4.0), -1), ((5.0, 20.0), 1), ((-0.1, 8.8), 0), ((-6.3, 8.0), -1), ((-20.0, -3.0), -2)],
)
def test_angles_that_jump_are_continued_and_shifted_into_their_limits(limits: tuple[float, float], turns: int) -> None:
    """One that slides is neither."""
    slide = Joint("s", kind=JointKind.PRISMATIC, limits=Limits(-1.0, 1.0))
    log = log_of(np.remainder(RISING, TURN), 7.0 * (RISING > 4.0))
    found, jumps = preparation._unwrapped(log, arm_of(turning(*limits), slide))
    np.testing.assert_allclose(found.position[:, 0], RISING + turns * TURN, atol=1e-12)
    np.testing.assert_array_equal(found.position[:, 1], log.position[:, 1])
    assert jumps == 1
    held, _ = preparation._unwrapped(log, arm_of(turning(*limits), slide, loops=()))
    np.testing.assert_allclose(held.position[:, 0], RISING, atol=1e-12)


@pytest.mark.parametrize(
    ("first", "least", "most", "shifted"),
    [(5.0, 0.0, 6.28, True), (5.0, -0.1, 6.0, False), (5.0, 0.0, 6.3, False), (1.0, 0.0, 6.28, False)],
)
def test_angles_of_one_turn_from_zero_on_are_shifted_into_limits(
    first: float, least: float, most: float, shifted: bool
) -> None:
    """If all joints' are from 0 to a turn: then they count so."""
    log = log_of(np.linspace(first, first + 1.0, 50), np.linspace(least, most, 50))
    found, jumps = preparation._unwrapped(log, arm_of(turning(-3.0, 3.0), turning(-9.0, 9.0)))
    np.testing.assert_allclose(found.position - log.position, [[-TURN * shifted, 0.0]] * 50, atol=1e-12)
    assert jumps == 0


def test_steps_beside_jumps_are_looked_at() -> None:
    columns = np.remainder(RISING, TURN)
    columns[20:] += 2.4
    with pytest.raises(InputError, match=r"by 2\.5 rad besides"):
        preparation._unwrapped(log_of(np.remainder(columns, TURN)), arm_of(turning(-20.0, 20.0)))
    steep = np.where(np.arange(91) < 40, 0.0, 2.4)
    log = log_of(steep)
    assert preparation._unwrapped(log, arm_of(turning(-20.0, 20.0)))[0].position is log.position


def test_stamps_that_jitter_are_joined_by_straight_lines_unless_the_samples_are_even() -> None:
    even = np.arange(300) / 100.0
    stamps = even + 2e-3 * np.sin(np.arange(300.0)) * (np.arange(300) % 299 > 0)
    log, how = preparation._resampled(log_of(3.0 * stamps, time=stamps, velocity=stamps[:, None]))
    np.testing.assert_allclose(log.time, even, atol=1e-12)
    np.testing.assert_allclose(log.position[:, 0], 3.0 * even, atol=1e-12)
    np.testing.assert_allclose(log.torque[:, 0], 15.0 * even, atol=1e-12)
    assert log.velocity is not None
    np.testing.assert_allclose(log.velocity[:, 0], even, atol=1e-12)
    steps = np.diff(stamps)
    assert how == f"stamps {steps.min():.3g} to {steps.max():.3g} s apart, resampled at 100 Hz"
    late = log_of(np.sin(even), time=stamps)
    log, how = preparation._resampled(late)
    np.testing.assert_allclose(log.time, even, atol=1e-12)
    assert log.position is late.position
    assert how.endswith("of samples that are even, as positions show: taken at 100 Hz")
    still = log_of(even)
    assert preparation._resampled(still) == (still, "even at 100 Hz")


def test_pieces_are_between_holes_and_of_fifty_samples() -> None:
    stamps = np.arange(200) / 100.0
    stamps[60:] += 0.072  # 8.2 periods
    stamps[109:] += 0.5
    stamps[159:] += 0.068  # 7.8 periods
    log = log_of(stamps, time=stamps, velocity=stamps[:, None])
    found = list(preparation._pieces(log))
    assert [len(piece) for piece in found] == [60, 91]
    for piece, start in zip(found, (0, 109), strict=True):
        for part in (piece.time, piece.position[:, 0], piece.torque[:, 0] / 5.0, piece.velocity[:, 0]):  # type: ignore[index]
            np.testing.assert_allclose(part, stamps[start : start + len(piece)])
    for count in (49, 50):
        short = log_of(stamps[:count], time=stamps[:count])
        assert preparation._prepared(short, short.time > 0.0).rate == pytest.approx(100.0)
        if count == 50:
            assert len(list(preparation._pieces(short))) == 1
        else:
            with pytest.raises(InputError, match="no 50 consecutive samples"):
                list(preparation._pieces(short))


@pytest.mark.parametrize(
    ("rate", "told"), [(19.0, "ms taken for s"), (21.0, ""), (0.99e5, ""), (1.01e5, "s taken for ms")]
)
def test_rates_are_those_of_most_steps_of_arms(rate: float, told: str) -> None:
    stamps = np.arange(100) / rate
    stamps[50:] += 40.0 / rate
    if told:
        with pytest.raises(InputError, match=rf"\({told}\)"):
            preparation._validate_plausible_rate(log_of(stamps, time=stamps))
    else:
        preparation._validate_plausible_rate(log_of(stamps, time=stamps))


@pytest.mark.parametrize(("rate", "lost"), [(200.0, 12), (30.0, 12), (1000.0, 22), (1e4, 0)])
def test_speeds_are_slopes_of_smoothed_positions_and_stay_at_both_ends(rate: float, lost: int) -> None:
    """A parabola is smoothed to itself and something; a kernel as long as the log leaves plain differences."""
    time = np.arange(120) / rate
    found = preparation._speed(log_of(time**2, -3.0 * time, rate=rate))
    inner = slice(max(lost, 1), 120 - max(lost, 1))
    np.testing.assert_allclose(found[inner, 0], 2.0 * time[inner], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], -3.0)
    if lost:
        np.testing.assert_allclose(found[[0, -1], 0], 2.0 * time[[lost, -1 - lost]], rtol=1e-9)


@pytest.mark.parametrize("count", [20, 24, 25, 26])
def test_columns_are_filtered_in_parts_as_at_once(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preparation, "SAMPLES_AT_ONCE", 7)
    column, kernel = np.random.default_rng(0).normal(size=count), np.arange(1.0, 6.0)
    np.testing.assert_allclose(preparation._filtered_in_parts(column, kernel), filtered(column, kernel), atol=1e-12)


def test_rests_shorter_than_a_tenth_of_a_second_are_motion() -> None:
    moving = np.ones(200, dtype=bool)
    for start, end in ((0, 9), (30, 39), (60, 71), (180, 200)):
        moving[start:end] = False
    expected = np.ones(200, dtype=bool)
    expected[60:71], expected[180:] = False, False
    time = np.arange(200) / 100.0 + 1e-9 * np.arange(200)
    np.testing.assert_array_equal(preparation._bridged(moving, time), expected)
    assert preparation._bridged(np.arange(200) < 195, time).all()


def test_an_arm_moves_where_a_joint_is_faster_than_a_hundredth_of_its_speed_in_all_pieces() -> None:
    """And than 1 mrad/s."""
    logs: Any = [SimpleNamespace(time=np.arange(100.0))] * 2
    speeds = [np.zeros((100, 2)), np.zeros((100, 2))]
    speeds[0][0, 0], speeds[1][1, 1] = -2.0, 0.05
    speeds[1][20:40, 0], speeds[1][60:80, 1] = 0.021, 1.1e-3
    speeds[1][40:60, 0], speeds[1][80:, 1] = 0.019, 0.9e-3
    found = preparation._moving(logs, speeds)[1]
    assert np.flatnonzero(found).tolist() == [1, *range(20, 40), *range(60, 80)]


def test_ends_of_parts_are_the_least_and_greatest_of_all() -> None:
    parts = [np.array([[1.0, -2.0], [0.5, 3.0]]), np.array([[0.7, -4.0], [2.0, 1.0]])]
    np.testing.assert_array_equal(whole_ends(parts), [[0.5, -4.0], [2.0, 3.0]])


def prepared(position: Array, rate: float, torque: Array | None = None) -> PreparedLog:
    time, count = 3.0 + np.arange(len(position)) / rate, len(position)
    given = position if torque is None else torque
    return PreparedLog("a.csv", rate, time, position, given, np.arange(count) >= count // 2)


@pytest.mark.parametrize(("count", "rate", "length"), [(1000, 100.0, 800), (1000, 5.0, 64), (300, 100.0, 300)])
def test_spectra_are_of_eight_seconds_by_welch(count: int, rate: float, length: int) -> None:
    position = np.random.default_rng(0).normal(size=(count, 2))
    frequency, power = position_spectrum(prepared(position, rate))
    expected = welch(position, rate, nperseg=length, axis=0)
    np.testing.assert_allclose(frequency, expected[0], atol=1e-12)
    np.testing.assert_allclose(power, expected[1], rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize(
    ("second", "frequency", "band"),
    [(0.12, 4.0, 4.0), (0.05, 4.0, 1.0), (0.12, 60.0, 1.0), (0.12, 49.0, 49.0)],
)
def test_the_band_has_nearly_all_of_the_speeds_squares_below_the_motions_cutoff(
    second: float, frequency: float, band: float
) -> None:
    """Of the second of two sines, by the ratio of its speed to the other's; the wider band of two joints counts."""
    time = np.arange(3200) / 400.0
    position = np.sin(TURN * time) + second / frequency * np.sin(TURN * frequency * time)
    found = motion_band([prepared(np.stack([position, 1e-3 * np.sin(TURN * time)], axis=-1), 400.0)])
    assert found == pytest.approx(band, abs=0.26)


def test_what_does_not_move_has_the_widest_band() -> None:
    assert motion_band([prepared(np.ones((900, 1)), 200.0)]) == 50.0


def test_rows_have_the_torques_and_the_motion_of_their_instants() -> None:
    """Torques that rise steadily are so behind any filter, with their slope; the arm moves within the whole kernel."""
    time = np.arange(2000) / 250.0
    log = prepared(np.sin(time)[:, None], 250.0, np.stack([4.0 * (3.0 + time), 7.0 - 3.0 - time], axis=-1))
    motion = SmoothMotion.of(log, 2, 20.0)
    assert motion.every == 1
    for cutoff in (3.0, 10.0):
        own = RowFilter.of(motion, cutoff)
        times, count = own.times(motion), len(own.signal(motion.velocity))
        rows = own.rows(motion, np.zeros((count, 1, 1)))
        np.testing.assert_array_equal(rows.time, times)
        np.testing.assert_allclose(rows.torque, np.stack([4.0 * times, 7.0 - times], axis=-1), rtol=1e-9)
        np.testing.assert_allclose(rows.change, [[4.0, -1.0]] * count, rtol=1e-6)
        np.testing.assert_allclose(np.diff(times), own.every / 250.0)
        width = (own.taps // 2) / 250.0
        np.testing.assert_array_equal(rows.moving, times - width >= log.time[1000] - 1e-9)
        assert times[0] == pytest.approx(log.time[motion.first] + width)
        assert times[-1] + width <= log.time[-1 - motion.first] + 1e-9 < times[-1] + width + own.every / 250.0


@pytest.mark.parametrize(
    ("rate", "cutoff", "every"), [(1000.0, 20.0, 5), (1000.0, 21.0, 4), (90.0, 50.0, 1), (1000.0, 10.0, 10)]
)
def test_a_smooth_motion_has_ten_samples_in_a_period_of_its_cutoff(rate: float, cutoff: float, every: int) -> None:
    motion = SmoothMotion.of(prepared(np.ones((4000, 1)), rate), 0, cutoff)
    assert (motion.every, motion.cutoff) == (every, min(cutoff, 0.2 * rate))


@pytest.mark.parametrize(("cutoff", "whole", "every"), [(3.0, 0, 3), (3.0, 10**6, 16), (20.0, 0, 2), (3.0, 399, 1)])
def test_rows_are_four_in_a_period_of_their_cutoff_and_four_hundred_in_all(
    cutoff: float, whole: int, every: int
) -> None:
    motion = replace(SmoothMotion.of(prepared(np.ones((8000, 1)), 1000.0), 0, 20.0), whole=whole)
    assert 1200 < len(motion.position) < 1600
    assert RowFilter.of(motion, cutoff).every == every


@pytest.mark.parametrize(("lasts", "enough"), [(1.4, False), (1.5, True)])
def test_a_log_has_one_and_a_half_seconds_of_motion(lasts: float, enough: bool) -> None:
    pieces: Any = [
        SimpleNamespace(source="a.csv", rate=100.0, moving=np.arange(400) < 50),
        SimpleNamespace(source="a.csv", rate=200.0, moving=np.arange(400) < round(200.0 * (lasts - 0.5))),
    ]
    if enough:
        assert _validate_enough(pieces) == pytest.approx(lasts)
        return
    with pytest.raises(InputError, match=r"only 1\.4 s of motion; at least 1\.5 s"):
        _validate_enough(pieces)


@pytest.mark.parametrize(("samples", "rows"), [(4, 0), (5, 1), (6, 2), (9, 2)])
def test_a_chunk_has_rows_where_it_is_as_long_as_the_kernel(samples: int, rows: int) -> None:
    """Of which two at each end are zeros that the samples lack; no more rows than were asked for."""
    values, kernel = np.random.default_rng(0).normal(size=(samples, 3)), np.arange(1.0, 6.0)
    found = RowFilter(9.0, np.pad(kernel, 2), 1).balanced(values, 0, 2)
    assert found.shape == (rows, 3)
    for k in range(rows):
        np.testing.assert_allclose(found[k], kernel[::-1] @ values[k : k + 5])


@pytest.mark.parametrize(
    ("scale", "offset", "told"),
    [(1.0, 0.0, True), (0.95, 0.0, True), (0.85, 0.0, False), (1.01, 0.0, False), (1.0, 9.0, True)],
)
def test_positions_within_a_turn_jump_by_it(scale: float, offset: float, told: bool) -> None:
    saw = scale * np.remainder(0.02 * np.arange(1571.0), TURN) + offset
    assert _jumps_by_turns(saw) == told


def test_positions_that_go_to_and_fro_or_jump_all_the_time_are_no_turns() -> None:
    assert not _jumps_by_turns(np.pi * np.sin(0.02 * np.arange(1000.0)))
    assert not _jumps_by_turns(TURN * (np.arange(100) % 2))
    steep = np.remainder(np.arange(200.0), TURN)
    assert not _jumps_by_turns(steep)  # steps of 1 rad
    stairs = 0.98 * TURN * np.repeat([0.0, 0.3, 1.0], 50)
    assert not _jumps_by_turns(stairs)  # steps of up to 0.7 turns


def columns_of(**columns: Any) -> Any:
    return table("a.csv", columns.items())


def test_episodes_whose_stamps_begin_anew_follow_after_a_hundred_periods() -> None:
    episode, stamps = np.repeat([0.0, 1.0, 2.0], 3), np.array([0.0, 0.1, 0.2, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    for name in ("episode_index", "episode"):
        found = complete_rows(columns_of(**{name: episode, "t": stamps, "q": np.arange(9.0)}), ["q"], "t")
        np.testing.assert_allclose(found.columns["t"], [0.0, 0.1, 0.2, 10.2, 10.3, 10.4, 10.5, 10.6, 10.7])
        assert any("2 episodes" in note for note in found.notes)
    single = columns_of(episode=np.arange(3.0), t=np.zeros(3), q=np.arange(3.0))
    np.testing.assert_allclose(complete_rows(single, ["q"], "t").columns["t"], [0.0, 1.0, 2.0])
    plain = columns_of(episode=np.zeros(9), t=stamps, q=np.arange(9.0))
    np.testing.assert_array_equal(complete_rows(plain, ["q"], "t").columns["t"], stamps)


def test_rows_without_numbers_at_the_ends_and_repeated_rows_are_left_out() -> None:
    stamps = np.array([0.0, 0.1, 0.2, 0.2, 0.2, 0.3, 0.4])
    q = np.array([np.nan, 1.0, 2.0, 2.0, 3.0, 4.0, np.inf])
    found = complete_rows(columns_of(t=stamps, q=q), ["q"], "t")
    np.testing.assert_allclose(found.columns["q"], [1.0, 2.0, 3.0, 4.0])
    assert [note.split()[0] for note in found.notes] == ["2", "1"]
    none = complete_rows(columns_of(t=stamps, q=np.full(7, np.nan)), ["q"], "t")
    assert len(none) == 7  # nothing is equal to no number


def test_a_log_at_rest_is_told_so() -> None:
    still = JointLog("a.csv", np.arange(300) / 100.0, np.zeros((300, 1)), np.ones((300, 1)))
    with pytest.raises(InputError, match="at rest throughout"):
        prepare(still, arm_of(turning(-1.0, 1.0)))


def test_rows_of_a_rate_have_no_empty_cells() -> None:
    log = replace(columns_of(q=np.ones(3), u=np.ones(3)), empty={"q": np.eye(3, dtype=bool)[0], "u": np.ones(3, bool)})
    assert complete_rows(log, ["v"], None) is log
    with pytest.raises(FileError, match="1 rows have empty cells"):
        complete_rows(log, ["q"], None)
