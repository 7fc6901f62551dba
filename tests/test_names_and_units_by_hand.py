"""What names, sizes and units of columns tell, and files of one log put together, on tables of a few rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from adaptctl.errors import FileError, InputError
from adaptctl.identification.column_names import UNIT_TO_GIVE, _likely, column_name, likely_pair
from adaptctl.identification.column_units import each_joint, factor, validate_fitting
from adaptctl.identification.columns import _one_of, _pattern, _validate_all_joints, same_place
from adaptctl.identification.drives_content import DrivesFile, MotorEntry, UnitsEntry, wrong_drives
from adaptctl.identification.joined_files import joined
from adaptctl.identification.unknown_columns import _likely_units, likely_unit, named_unit, validate_numbers
from adaptctl.logs.table import LogTable
from adaptctl.logs.units import POSITION, TIME, TORQUE, VELOCITY

TWO = np.array([0.0, 1.0])


def columns_of(*names: str, **columns: Any) -> LogTable:
    return LogTable("a.csv", {**dict.fromkeys(names, TWO), **{name: np.asarray(own) for name, own in columns.items()}})


@pytest.mark.parametrize(
    ("what", "name", "unit"),
    [
        ("position", "q1_deg", "deg"),
        ("torque", "tau [Nm]", "N m"),
        ("torque", "current(mA)", "mA"),
        ("torque", "current_A", "A"),
        ("position", "joint_A", ""),
        ("position", "deg_1", ""),
        ("time", "stamp.NS", "ns"),
    ],
)
def test_a_unit_is_the_last_word_of_a_name(what: str, name: str, unit: str) -> None:
    assert named_unit(what, name) == unit


@pytest.mark.parametrize(
    ("what", "values", "unit"),
    [
        ("time", [0.0, 1.1e5, 2.2e5], "ns"),
        ("time", [0.0, 0.9e5, 1.8e5], "us"),
        ("time", [3.0, 1.0, -200.0, -401.0], "us"),
        ("time", [0.0, 99.0, 198.0], "ms"),
        ("time", [0.0, 0.11, 0.22], "ms"),
        ("time", [0.0, 0.09, 0.18, 9.0], "s"),
        ("time", [7.0], "s"),
        ("time", [0.0, 200.0, np.nan], "s"),
        ("position", [-9.6, 0.0], "deg"),
        ("position", [-9.4, 9.4], "rad"),
        ("velocity", [-99.0, 0.0], "rad/s"),
        ("torque", [-99.0, 0.0], "N m"),
    ],
)
def test_without_a_unit_in_its_name_the_size_of_a_columns_numbers_tells_it(
    what: str, values: list[float], unit: str
) -> None:
    assert likely_unit(what, ["x"], columns_of(x=values)) == unit


def test_units_of_columns_that_are_not_there_are_to_be_given_but_for_times() -> None:
    log = columns_of("current_1", "q_deg", "s_mm", "s")
    assert likely_unit("position", ["x"], log) == likely_unit("torque", [], log) == UNIT_TO_GIVE
    assert likely_unit("time", [], log) == likely_unit("time", ["x"], log) == "s"
    assert likely_unit("torque", ["current_1"], log) == "A"
    assert likely_unit("position", ["current_1"], log) == "rad"
    assert _likely_units("position", ["q_deg", "s_mm"], log) == "deg,mm"
    assert _likely_units("position", ["q_deg", "q_deg"], log) == "deg"
    assert _likely_units("position", ["q_deg", "s"], log) == "deg"
    assert _likely_units("torque", ["q_deg", "s_mm"], log) == "deg"


def test_columns_are_likely_by_words_then_letters_and_those_of_wanted_values_last() -> None:
    log = columns_of("q_1", "target_position_1", "m_position", "tau_q", "pos_1", "Effort[Nm]", "m_1", "cmd_m")
    assert list(_likely("position", log)) == ["m_position", "pos_1", "q_1", "target_position_1"]
    assert list(_likely("torque", log)) == ["tau_q", "Effort[Nm]", "m_1", "cmd_m"]


@pytest.mark.parametrize(
    ("names", "pair"),
    [
        (("q1", "q2"), "position=q{}"),
        (("q0", "q1"), "position=q{0}"),
        (("q_a", "q_b"), "'position=q_{joint}'"),
        (("a1_q1", "a1_q2"), "position=a1_q{}"),
        (("q1", "x2"), "position=NAMES"),
        (("q1", "q2", "pos_1"), "position=q{}"),
    ],
)
def test_a_pattern_is_offered_that_there_are_columns_of(names: tuple[str, ...], pair: str) -> None:
    assert likely_pair("position", ["a", "b"], columns_of(*names)).strip("'") == pair.strip("'")


def test_a_column_is_given_by_its_name_or_its_number_from_one() -> None:
    log = columns_of("x", "y", "z")
    assert [column_name(given, log) for given in ("y", "3", "1-2", "other")] == ["y", "z", "1-2", "other"]


@pytest.mark.parametrize(("pattern", "names"), [("q{}", "q1 q2 q3"), ("q{0}", "q0 q1 q2")])
def test_numbered_columns_are_no_more_than_joints(pattern: str, names: str) -> None:
    log = columns_of(*names.split(), "q9")
    validate_numbers("position", pattern, ["a", "b", "c"], log)
    first, second, unused = names.split()
    with pytest.raises(InputError, match=rf"has 3 columns, but .* 2 joints .*: {unused} .*position={first},{second}$"):
        validate_numbers("position", pattern, ["a", "b"], log)


@pytest.mark.parametrize(
    ("what", "each", "turns", "told"),
    [
        ("position", ["deg", "mm"], [True, False], ""),
        ("position", ["rad", "rad"], [True, False], ""),  # each joint's own unit of SI
        ("position", ["deg", "deg"], [True, False], "'j1' slides: expected m or mm, got 'deg'; or else"),
        ("position", ["rad", "rad"], [False, False], ""),
        ("position", ["rad", "m"], [False, False], "'j0' slides: expected m or mm, got 'rad'"),
        ("position", ["m", "m"], [True, True], "'j0' turns: expected rad, deg, rev or mrad, got 'm'"),
        ("position", ["m/4096", "m/4096"], [True, True], "got 'm/4096'"),
        ("velocity", ["deg/s", "deg/s"], [True, False], "'j1' slides: expected m/s or mm/s, got 'deg/s'; or else"),
        ("torque", ["mN m"], [False], "'j0' slides: expected N, got 'mN m'"),
        ("torque", ["N"], [True], "'j0' turns: expected N m or mN m, got 'N'"),
        ("time", ["ms"], [True], ""),
    ],
)
def test_units_are_angles_where_joints_turn_and_lengths_where_they_slide(
    what: str, each: list[str], turns: list[bool], told: str
) -> None:
    joints = {f"j{k}": turn for k, turn in enumerate(turns)}
    if not told:
        validate_fitting({what: each}, joints, "; or else")
        return
    with pytest.raises(InputError) as refused:
        validate_fitting({what: each}, joints, "; or else")
    assert str(refused.value).endswith(told)


def test_units_are_one_for_all_joints_or_one_for_each() -> None:
    assert each_joint("position", "deg", "abc") == ["deg"] * 3
    assert each_joint("position", "deg, mm,rad", "abc") == ["deg", "mm", "rad"]
    assert each_joint("position", "deg", "a") == ["deg"]
    with pytest.raises(InputError, match=r"each of 3 joints \(a, b, c\), got 2: deg,mm"):
        each_joint("position", "deg,mm", "abc")


@pytest.mark.parametrize(
    ("what", "symbol", "value"),
    [("position", "rev/4096", 2.0 * np.pi / 4096.0), ("position", "mm/10", 1e-4), ("velocity", "rpm", np.pi / 30.0)],
)
def test_a_unit_over_counts_is_that_of_one_count(what: str, symbol: str, value: float) -> None:
    assert factor(what, symbol) == pytest.approx(value)


@pytest.mark.parametrize("symbol", ["rev/0", "rev/x", "/4096", "foot/12"])
def test_a_unit_over_anything_else_is_none(symbol: str) -> None:
    with pytest.raises(InputError, match="for counts, a unit over their number"):
        factor("position", symbol)
    with pytest.raises(InputError, match=r"got 'furlong'$"):
        factor("velocity", "furlong")


def test_a_log_is_the_same_by_its_path_or_its_name() -> None:
    assert same_place("a/b.csv", "b.csv")
    assert same_place("a/b.csv", "a//b.csv")
    assert not same_place("a/b.csv", "a/c.csv")


def drives_file(constants: Sequence[Any] = (None, None), torque: str = "N m", **more: Any) -> DrivesFile:
    motors = [MotorEntry(position=f"q{i}", torque=f"u{i}", torque_constant=k) for i, k in enumerate(constants)]
    units = UnitsEntry(time="s", position="rad", torque=torque)
    return DrivesFile(
        **{"joints": ["a", "b"], "transmission": [[2.0, 0.0], [1.0, 3.0]], "motors": motors, "units": units, **more}
    )


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (drives_file(), []),
        (drives_file(joints=["a", "a"]), ["$.joints: expected unique"]),
        (drives_file(transmission=[[1.0, 0.0]]), ["$.transmission: expected a row for each of 2 motors"]),
        (drives_file(transmission=[[1.0], [0.0]]), ["$.transmission: expected a row"]),
        (drives_file([None]), ["$.transmission: expected a row for each of 1 motors"]),
        (drives_file(transmission=[[1.0, 2.0], [1.0, 0.0]]), ["$.transmission[1]: motor 'b' must turn its own"]),
        (drives_file(transmission=[[1.0, 2.0], [2.0, 4.0]]), ["$.transmission: the matrix is singular"]),
        (drives_file(transmission=[[1.0, 0.0], [0.0, 0.9e-6]]), ["$.transmission: the matrix is singular"]),
        (drives_file(transmission=[[1.0, 0.0], [0.0, 1.1e-6]]), []),
        (drives_file([1.0, -1.0]), []),
        (
            drives_file([2.0, 0.0]),
            ["$.motors[0].torque_constant: the log has torques", "$.motors[1].torque_constant: exp"],
        ),
        (drives_file(["unknown", None]), ["$.motors[0].torque_constant: the log has torques"]),
        (drives_file([np.inf, "unknown"], "A"), ["$.motors[0].torque_constant: expected a number"]),
        (drives_file([0.5, None], "A"), ["$.motors[1].torque_constant is missing"]),
        (drives_file([9.0, 9.0], "pound"), ["$.units.torque: unit of torque"]),
        (drives_file(joint_offsets=[1.0, 2.0]), []),
        (drives_file(joint_offsets_deg=[1.0]), ["$.joint_offsets: expected a number for each of 2 joints, got 1"]),
        (drives_file(joint_offsets=[1.0], joint_offsets_deg=[1.0]), ["the joint offsets are given twice"]),
    ],
)
def test_all_that_is_wrong_in_a_drives_file_is_told(content: DrivesFile, told: list[str]) -> None:
    found = list(wrong_drives(content))
    assert len(found) == len(told)
    for words, start in zip(found, told, strict=True):
        assert words.startswith(start)


def part(name: str, begin: float | None, numbered: bool = False, **columns: Any) -> LogTable:
    own = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    return LogTable(f"dir/{name}.csv", own, numbered=numbered, begin={} if begin is None else {"time": begin})


def test_files_are_joined_by_their_stamps_which_count_from_the_firsts_beginning() -> None:
    """A column that several have is named by its file; cells are empty where a file has no such stamp."""
    first, second = (
        part("p", 100.0, time=[0.0, 1.0, 2.0], q=[1.0, 2.0, 3.0]),
        part("u", 101.0, time=[0.0, 0.5], q=[8.0, 9.0]),
    )
    found = joined("both", [first, second])
    np.testing.assert_allclose(found.columns["time"], [0.0, 1.0, 1.5, 2.0])
    np.testing.assert_array_equal(found.columns["p.q"], [1.0, 2.0, np.nan, 3.0])
    np.testing.assert_array_equal(found.columns["u.q"], [np.nan, 8.0, 9.0, np.nan])
    assert found.empty["u.q"].tolist() == [True, False, False, True]
    assert "2 files were joined by their stamps" in found.notes
    with pytest.raises(FileError, match="since 1970"):
        joined("both", [first, part("u", None, time=[0.0], q=[1.0])])


def test_files_of_equal_stamps_or_without_any_are_joined_row_by_row() -> None:
    stamps = [0.0, 1.0]
    found = joined("both", [part("p", None, time=stamps, q=[1.0, 2.0]), part("u", None, time=stamps, u=[3.0, 4.0])])
    assert list(found.columns) == ["time", "q", "u"]
    assert found.notes[-1].endswith("row by row")
    numbered = [part("p", None, True, **{"1": [1.0], "2": [2.0]}), part("u", None, True, **{"1": [3.0]})]
    found = joined("both", numbered)
    assert {name: own.tolist() for name, own in found.columns.items()} == {"1": [1.0], "2": [2.0], "3": [3.0]}
    assert found.numbered
    with pytest.raises(FileError, match=r"\(p\.csv 1, u\.csv 2\)"):
        joined("both", [part("p", None, q=[1.0]), part("u", None, u=[1.0, 2.0])])
    units = [LogTable(f"{unit}.csv", {"time": TWO}, {"time": unit}) for unit in ("s", "ms")]
    with pytest.raises(FileError, match="other units"):
        joined("both", units)


ROS = {"position": "position.{joint}", "torque": "effort.{joint}"}
OWN = {"position": "p.{joint}", "torque": "applied.{joint}"}


@pytest.mark.parametrize(
    ("names", "given", "found"),
    [
        ("position.a position.b effort.a effort.b", {}, ROS),
        ("position.a position.b effort.a effort.b velocity.a", {}, ROS),  # not of all joints
        ("position.a position.b effort.a effort.b velocity.a velocity.b", {}, {**ROS, "velocity": "velocity.{joint}"}),
        ("p.a p.b applied.a applied.b", {"time": "t"}, OWN),
        ("p.a p.b q1 q2", {"torque": "q{}"}, {"position": "p.{joint}", "torque": "q{}"}),
        ("p.a p.b applied.a applied.b", {"velocity": "w{}"}, {**OWN, "velocity": "w{}"}),
        ("x1 x2", {"position": "x{}", "torque": "u{}"}, {"position": "x{}", "torque": "u{}"}),
        ("p.a p.b x1", {"torque": "u{}"}, {"torque": "u{}"}),
        ("a_torque b_torque v.a v.b", {}, {"torque": "{joint}_torque"}),
    ],
)
def test_columns_are_those_of_usual_names_that_all_joints_have(
    names: str, given: dict[str, str], found: dict[str, str]
) -> None:
    assert _pattern(columns_of(*names.split()), ["a", "b"], given) == found


@pytest.mark.parametrize(
    ("names", "given", "told"),
    [
        ("position.a effort.a effort.b", {}, "no column 'position.b' for position; the log has 1 of 2 joints"),
        ("p.b applied.b", {}, "no column 'p.a' for position; the log has 1 of 2 joints"),
        ("p.a applied.b", {}, ""),
        ("p.a q1", {"torque": "q{}"}, ""),
        ("p.a p.b applied.a applied.b", {}, ""),
    ],
)
def test_a_log_of_some_of_the_joints_is_told_from_one_of_other_names(
    names: str, given: dict[str, str], told: str
) -> None:
    log = columns_of(*names.split())
    if not told:
        _validate_all_joints(log, ["a", "b"], given)
        return
    with pytest.raises(FileError) as refused:
        _validate_all_joints(log, ["a", "b"], given)
    assert told in str(refused.value)


def test_units_of_a_quantity_are_one_whatever_their_spelling() -> None:
    assert _one_of(["N m", "Nm"], "torque", "a.csv") == "N m"
    for what, units, more in (("position", ["rad", "deg"], True), ("torque", ["N m", "A"], False)):
        with pytest.raises(InputError, match=rf"have different units \({', '.join(units)}\)") as refused:
            _one_of(units, what, "a.csv")
        assert ("or give one for each joint" in str(refused.value)) is more


def test_a_turn_is_360_degrees_and_a_minute_60_seconds() -> None:
    assert POSITION["rev"] == pytest.approx(math.radians(360.0))
    assert 360.0 * POSITION["deg"] == pytest.approx(POSITION["rev"])
    assert 60.0 * VELOCITY["rpm"] == pytest.approx(POSITION["rev"])
    assert VELOCITY["deg/s"] == POSITION["deg"]
    for factors, *steps in (
        (TIME, "s", "ms", "us", "ns"),
        (POSITION, "m", "mm"),
        (POSITION, "rad", "mrad"),
        (TORQUE, "N m", "mN m"),
    ):
        for whole, part in pairwise(steps):
            assert factors[part] == pytest.approx(1e-3 * factors[whole])
    assert VELOCITY["mm/s"] == POSITION["mm"]
    ones = ((TIME, "s"), (POSITION, "rad"), (POSITION, "m"), (VELOCITY, "rad/s"))
    assert [factors[name] for factors, name in (*ones, (TORQUE, "N"), (VELOCITY, "m/s"))] == [1.0] * 6
