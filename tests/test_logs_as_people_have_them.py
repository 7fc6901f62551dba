"""Logs as people have them: each gives the columns of the clean log, or is refused in words that lead on."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from test_joint_columns import REVOLUTE, SI, arm

from adaptctl.description.drive import Limits
from adaptctl.errors import FileError, InputError
from adaptctl.identification.columns import JointLog, joint_columns, joint_log
from adaptctl.identification.log_files import read_log
from adaptctl.identification.preparation import prepare
from adaptctl.logs.arrow import forget, numbers
from adaptctl.logs.table import _seconds_of

ARM = arm(REVOLUTE, REVOLUTE)
T = np.arange(400) / 100.0
Q = np.stack([np.sin(T), 0.8 * np.cos(2.0 * T)], axis=-1)
V = np.stack([np.cos(T), -1.6 * np.sin(2.0 * T)], axis=-1)
TAU = np.stack([3.0 * np.cos(T), 5.0 * np.sin(3.0 * T)], axis=-1)
HEAD = [f"{what}.j{i}" for what in ("position", "velocity", "effort") for i in range(2)]
CELLS = [[f"{x:.9f}" for x in row] for row in np.column_stack([Q, V, TAU])]
ROWS = [[f"{t:.4f}", *row] for t, row in zip(T, CELLS, strict=True)]
EPOCH = 1_726_000_000


def lines(rows: list[list[str]], *before: list[str] | str, mark: str = ",") -> str:
    return "\n".join(line if isinstance(line, str) else mark.join(line) for line in [*before, *rows]) + "\n"


def joint_log_of(
    path: Path, columns: dict[str, str] | None = None, rate: float | None = None, **units: str
) -> JointLog:
    log = read_log(path)
    return joint_log(log, joint_columns(ARM, log, columns, SI | units, rate is None), rate)


def stamps(form: Callable[[int], list[str]]) -> list[list[str]]:
    return [[*form(round(1e9 * t)), *row] for t, row in zip(T, CELLS, strict=True)]


def numpy_text() -> str:
    return "\n".join("  ".join(row) for row in ROWS) + "\n"


def grouped(thousands: str, decimal: str, mark: str, quote: str = "") -> str:
    """The log in ms and mN m, with marks between thousands."""
    rows = np.column_stack([1e3 * T, Q, V, 1e3 * TAU])
    to = str.maketrans({",": thousands, ".": decimal})
    return lines(
        [[f"{quote}{f'{x:,.9f}'.translate(to)}{quote}" for x in row] for row in rows], ["time", *HEAD], mark=mark
    )


THOUSANDS = {"time": "ms", "torque": "mN m"}
BY_NUMBER = {"time": "1", "position": "2-3", "velocity": "4,5", "torque": "6-7"}
FORMS: dict[str, tuple[str, dict[str, Any], str]] = {
    "plain": (lines(ROWS, ["time", *HEAD]), {}, ""),
    "comments, also between rows": (
        lines([*ROWS[:9], ["# a mark"], *ROWS[9:]], "# arm 3", "# 100 Hz", ["time", *HEAD]),
        {},
        "1 lines of comments",
    ),
    "names in the last comment": (lines(ROWS, "# arm 3", ["# time", *HEAD]), {}, ""),
    "a row of units": (
        lines(ROWS, ["time", *HEAD], ["[s]", *["rad"] * 2, *["rad/s"] * 2, "Nm", "N·m"]),
        {},
        "read as units",
    ),
    "files one after the other, each with its head": (
        lines([*ROWS[:200], ["arm 3"], ["time", *HEAD], *ROWS[200:]], "arm 3", ["time", *HEAD]),
        {},
        "2 lines that repeat those above the numbers were left out",
    ),
    "such files with blanks and decimal commas": (
        lines([*ROWS[:200], ["time", *"abcdef"], *ROWS[200:]], ["time", *"abcdef"], mark=" ").replace(".", ","),
        {"columns": BY_NUMBER},
        "1 lines that repeat those above the numbers were left out",
    ),
    "last line cut off": (lines([*ROWS, ROWS[0][:2]], ["time", *HEAD]), {}, "last line, which is cut off"),
    "a row twice": (lines([*ROWS[:9], *ROWS[8:]], ["time", *HEAD]), {}, "1 rows that repeat the one before"),
    "empty rows of another topic": (
        lines([r for row in ROWS for r in (row, [f"{float(row[0]) + 1e-3:.4f}", *[""] * 6])], ["time", *HEAD]),
        {},
        "400 rows without content",
    ),
    "no names": (lines(ROWS), {"columns": BY_NUMBER}, ""),
    "blanks between numbers": (numpy_text(), {"columns": BY_NUMBER}, ""),
    "no names, no time": (
        lines(CELLS),
        {"columns": {"position": "1-2", "velocity": "3-4", "torque": "5-6"}, "rate": 100.0},
        "",
    ),
    "no time": (lines(CELLS, HEAD), {"rate": 100.0}, ""),
    "numbers of named columns": (lines(ROWS, ["clock", *"abcdef"]), {"columns": BY_NUMBER}, ""),
    "tabs and decimal commas": (
        lines(ROWS, ["time", *HEAD], mark="\t")
        .replace(".", ",")
        .replace("n,j", "n.j")
        .replace("y,j", "y.j")
        .replace("t,j", "t.j"),
        {},
        "",
    ),
    "thousands by commas, quoted": (grouped(",", ".", ",", '"'), THOUSANDS, ""),
    "thousands by points, quoted": (grouped(".", ",", ",", '"'), THOUSANDS, ""),
    "thousands by commas": (grouped(",", ".", "\t"), THOUSANDS, ""),
    "thousands by blanks": (grouped(" ", ",", ";"), THOUSANDS, ""),
    "thousands by narrow blanks": (grouped("\u202f", ",", "\t"), THOUSANDS, ""),
    "thousands by points": (grouped(".", ",", ";"), THOUSANDS, ""),
    "thousands by apostrophes": (grouped("'", ".", ";"), THOUSANDS, ""),
    "marks at the ends of rows": (lines([[*row, ""] for row in ROWS], ["time", *HEAD]), {}, ""),
    "quoted": (lines([[f'"{x}"' for x in row] for row in ROWS], [f'"{x}"' for x in ("time", *HEAD)]), {}, ""),
    "ns since 1970": (lines(stamps(lambda ns: [str(EPOCH * 10**9 + ns)]), ["time", *HEAD]), {"time": "ns"}, ""),
    "sec and nanosec": (
        lines(stamps(lambda ns: [str(EPOCH + ns // 10**9), str(ns % 10**9)]), ["stamp.sec", "stamp.nanosec", *HEAD]),
        {"columns": {"time": "stamp.nanosec"}, "time": "ns"},
        "stamp.sec and stamp.nanosec are taken as one stamp",
    ),
    "secs and nsecs": (
        lines(stamps(lambda ns: [str(EPOCH + ns // 10**9), str(ns % 10**9)]), ["secs", "nsecs", *HEAD]),
        {"columns": {"time": "secs"}},
        "secs and nsecs are taken as one stamp",
    ),
    "ISO times": (
        lines(stamps(lambda ns: [f"2026-09-01 12:00:{ns / 1e9:09.6f}".removesuffix(".000000")]), ["time", *HEAD]),
        {},
        "",
    ),
    "ISO times with T and Z": (
        lines(stamps(lambda ns: [f"2026-09-01T12:00:{ns / 1e9:06.3f}Z"]), ["time", *HEAD]),
        {},
        "",
    ),
    "numbers in comments": (
        lines([[*row, "moving"] for row in ROWS], *["#; 1; 2; 3; 4; 5; 6; 7; 8; 9"] * 9, ["time", *HEAD, "state"]),
        {},
        "",
    ),
    "times of day": (lines(stamps(lambda ns: [f"12:00:{ns / 1e9:09.6f}"]), ["time", *HEAD]), {}, ""),
}


@pytest.mark.parametrize("name", FORMS)
def test_a_text_log_gives_the_numbers_of_the_clean_one(name: str, tmp_path: Path) -> None:
    text, given, note = FORMS[name]
    (tmp_path / "log.csv").write_text(text)
    found = joint_log_of(tmp_path / "log.csv", **given)
    np.testing.assert_allclose(found.time - found.time[0], T, atol=1e-6)
    for own, right in ((found.position, Q), (found.velocity, V), (found.torque, TAU)):
        np.testing.assert_allclose(own, right, atol=1e-8)
    assert [note in one for one in found.notes] == ([True] if note else [])


def test_a_mark_that_may_be_between_thousands_or_before_decimals_is_refused(tmp_path: Path) -> None:
    rows = [[*row[:-1], f"{1.0 + i / 1000:.3f}".replace(".", ",")] for i, row in enumerate(ROWS)]
    (tmp_path / "log.csv").write_text(lines(rows, ["time", *HEAD], mark=";"))
    with pytest.raises(FileError, match=r"effort\.j1.* 400 of 400 rows not finite, .* its first text is '1,000'"):
        joint_log_of(tmp_path / "log.csv")


@pytest.mark.parametrize("cell", ["nan", "NaN", "#N/A"])
def test_a_cell_that_is_not_a_number_is_an_empty_one(cell: str, tmp_path: Path) -> None:
    rows = [[*row[:-1], cell] if i == 9 else row for i, row in enumerate(ROWS)]
    (tmp_path / "log.csv").write_text(lines(rows, ["time", *HEAD]))
    found = joint_log_of(tmp_path / "log.csv")
    np.testing.assert_allclose(found.torque[9, 1], 0.5 * (TAU[8, 1] + TAU[10, 1]), rtol=1e-6)
    assert found.notes[0].endswith("1 empty cells were filled by straight lines between the numbers around them")


def test_latin_1_is_read_and_its_units(tmp_path: Path) -> None:
    head = ["Zeit", "Größe 1", "Größe 2", *"abcd"]
    text = lines(ROWS, head, ["s", *["°"] * 2, *["°/s"] * 2, "Nm", "Nm"], mark=";").replace(".", ",")
    (tmp_path / "log.csv").write_bytes(text.encode("latin-1"))
    found = read_log(tmp_path / "log.csv")
    assert list(found.columns)[:3] == head[:3]
    assert list(found.units.values()) == ["s", *["deg"] * 2, *["deg/s"] * 2, *["N m"] * 2]
    np.testing.assert_allclose(found.columns["Größe 2"], Q[:, 1], atol=1e-8)


def test_utf_16_is_read(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(lines(ROWS, ["time", *HEAD]), encoding="utf-16")
    np.testing.assert_allclose(joint_log_of(tmp_path / "log.csv").position, Q, atol=1e-8)


@pytest.mark.parametrize("mark", [b"\xff\xfe", b"\xfe\xff"])
@pytest.mark.parametrize("between", [",", " "])
@pytest.mark.parametrize("lost", [0, 1])
def test_a_cut_last_line_of_utf_16_is_left_out(mark: bytes, between: str, lost: int, tmp_path: Path) -> None:
    text = lines([*ROWS, ROWS[0][:2]], ["time", *HEAD], mark=between).rstrip()
    cut = mark + text.encode("utf-16-le" if mark == b"\xff\xfe" else "utf-16-be")
    (tmp_path / "log.csv").write_bytes(cut[: len(cut) - lost])
    found = read_log(tmp_path / "log.csv")
    assert len(found) == len(ROWS)
    assert found.notes == ("the last line, which is cut off, was left out",)


def test_long_utf_16_is_read_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("adaptctl.logs.text_form.HEAD", 3000)
    (tmp_path / "log.csv").write_bytes(b"\xfe\xff" + lines(ROWS, ["time", *HEAD]).encode("utf-16-be"))
    assert len(read_log(tmp_path / "log.csv")) == len(ROWS)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_a_wrong_line_is_named_by_its_own_number(encoding: str, ending: str, tmp_path: Path) -> None:
    text = lines([*ROWS[:9], ["arm", "left"], *ROWS[9:]], ["arm", "left"], ["time", *HEAD])
    (tmp_path / "log.csv").write_bytes(text.replace("\n", ending).encode(encoding))
    with pytest.raises(FileError, match="line 12 has 2 cells, not 7: 'arm,left'"):
        read_log(tmp_path / "log.csv")


def test_topics_in_rows_of_their_own_are_joined_by_straight_lines(tmp_path: Path) -> None:
    with (tmp_path / "log.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *HEAD])
        for t, q, v in zip(T, Q, V, strict=True):
            writer.writerow([t, *q, *v, "", ""])
            if not 1.0 < t < 1.5:
                shifted = [3.0 * np.cos(t + 4e-3), 5.0 * np.sin(3.0 * (t + 4e-3))]
                writer.writerow([t + 4e-3, *[""] * 4, *shifted])
    found = joint_log_of(tmp_path / "log.csv")
    kept = np.isin(T.round(4), found.time.round(4))
    assert not kept[(T > 1.02) & (T < 1.48)].any()
    assert kept.sum() == len(found) > 340
    np.testing.assert_allclose(found.position, Q[kept], atol=1e-8)
    np.testing.assert_allclose(found.torque, TAU[kept], atol=2e-3)
    assert ["empty cells were filled" in note for note in found.notes] == [True, False]
    assert "far from numbers of other columns" in found.notes[1]


@pytest.mark.parametrize(
    ("text", "given", "message"),
    [
        (
            lines(ROWS), {}, "has no line of column names, and 7 columns; give their numbers, if they are time, "
            "positions, velocities, torques: --columns time=1 position=2-3 velocity=4-5 torque=6-7$",
        ),
        (lines([row[:4] for row in CELLS]), {}, "if they are positions, torques: --columns position=1-2 torque=3-4 "),
        (lines(ROWS), {"columns": BY_NUMBER | {"torque": "6-8"}}, "columns: 6-8: expected numbers from 1 to 7"),
        (lines(ROWS), {"columns": BY_NUMBER | {"torque": "5-7"}}, "torque: 5-7 has 3 columns, but the robot 2 joints"),
        (
            lines(stamps(lambda ns: [f"01.09.2026 12:00:{ns / 1e9:06.3f}"]), ["time", *HEAD]), {},
            r"its first text is '01\.09\.2026 12:00:00\.000'; write s, or dates as 2026-09-01 12:00:00\.005$",
        ),
        (lines([*ROWS[:9], ["7"], *ROWS[9:]], ["time", *HEAD]), {}, r"line 11 has 1 cells, not 7: '7'"),
        (
            lines([*ROWS[:9], ["0.5", '"7', *ROWS[9][2:]], *ROWS[10:]], ["time", *HEAD]),
            {},
            "line 11 opens a quotation mark that is not closed: '0.5,",
        ),
        (lines([[*row[:6], "ERR"] for row in ROWS], ["time", *HEAD]), {}, r"'effort.j1'.*its first text is 'ERR'"),
        (lines(CELLS, HEAD), {}, "no column 'time' for the time; specify it: --columns time=NAME, or the rate"),
        (lines(ROWS, ["time", *HEAD]), {"position": "counts"}, "for counts, a unit over their number, such as rev/"),
        (lines(ROWS, ["time,q", *HEAD]), {}, "line 1 has 8 names, and line 2 7 numbers"),
        (
            lines(stamps(lambda ns: [f"2026-09-01 12:00:{ns / 1e9:09.6f}"]), ["time", *HEAD]), {"time": "ms"},
            "column 'time' is in s; leave out another unit of time",
        ),
        (
            lines([[*row[:6], ""] for row in ROWS], ["time", *HEAD]), {},
            "column 'effort.j1' has 0 numbers, and empty cells else; give another column, or a log that has it",
        ),
        (
            lines([r for row in CELLS for r in (row, [""] * 6)], HEAD), {"rate": 100.0},
            "400 rows have empty cells, so that rows are not evenly spaced in time",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_known_is_asked_for(text: str, given: dict[str, Any], message: str, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises((FileError, InputError), match=message):
        joint_log_of(tmp_path / "log.csv", **given)


def wrapped(position: np.ndarray, unit: float) -> np.ndarray:
    return np.floor(position / unit) % round(2.0 * np.pi / unit)


def test_counts_and_angles_from_0_to_360_are_continued(tmp_path: Path) -> None:
    counts = wrapped(Q, 2.0 * np.pi / 4096)
    rows = [[f"{t:.4f}", *(f"{x:.9g}" for x in row)] for t, row in zip(T, np.column_stack([counts, TAU]), strict=True)]
    (tmp_path / "log.csv").write_text(lines(rows, ["time", *HEAD[:2], *HEAD[4:]]))
    (piece,), steps = prepare(joint_log_of(tmp_path / "log.csv", position="rev/4096"), ARM, ("limits",))
    np.testing.assert_allclose(piece.position, Q, atol=2.0 * np.pi / 4096)
    found = [step.outcome for step in steps if step.name == "unwrap"]
    assert found == ["4 jumps by full turns removed from the angles"]


def test_positions_beyond_narrow_limits_are_told_what_would_fit() -> None:
    ranges = ((0.2, 2.5), (-1.5, 0.1))
    links = [
        replace(link, joint=replace(link.joint, limits=Limits(*ends, 20.0, 50.0)))
        for link, ends in zip(ARM.description.links, ranges, strict=True)
    ]
    robot = type(ARM)(replace(ARM.description, links=tuple(links)))
    within = np.stack([1.3 + 0.9 * np.sin(T), -0.7 + 0.6 * np.cos(2.0 * T)], axis=-1)
    prepare(JointLog("log.csv", T, within, TAU), robot)
    flag = "; or leave out this check by --skip-steps limits$"
    for position, words in (
        (within * [-1.0, 1.0], "are 0.2 to 2.5; of the other sign they would be within; check units.*" + flag),
        (within[:, ::-1], "are 0.2 to 2.5; .*exchanged with those of 'j1' they would be within; check"),
        (within + np.array([9.0, 0.0]), "are 0.2 to 2.5; check units"),
    ):
        with pytest.raises(InputError, match=words):
            prepare(JointLog("log.csv", T, position, TAU), robot, ("unwrap",))


def test_turns_that_cannot_be_told_are_refused(tmp_path: Path) -> None:
    fast = np.column_stack([70.0 * T + 5.0 * np.sin(T), Q[:, 1]])
    log = JointLog("log.csv", T[::4], fast[::4] % (2.0 * np.pi), TAU[::4])
    with pytest.raises(InputError, match=r"joint 'j0' jumps by full turns, and at .* may be more than half a turn"):
        prepare(log, ARM, ("limits",))


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1e3, r"leave out that row; it goes from -?\d+ to \d+ rad: give its unit, such as position=mrad$"),
        (4096 / (2.0 * np.pi), "leave out that row; it has whole numbers, as counts are: give their unit, .*rev/4096$"),
    ],
)
def test_turns_that_cannot_be_told_are_asked_for_their_unit(factor: float, words: str) -> None:
    other = factor * Q
    log = JointLog("log.csv", T, np.round(other) if factor < 1e3 else other, TAU)
    with pytest.raises(InputError, match=words):
        prepare(log, ARM, ("limits",))


def test_lists_episodes_and_dates_of_parquet_are_read(tmp_path: Path) -> None:
    n = len(T) // 2
    columns = {
        "timestamp": np.r_[T[:n], T[:n]],
        "episode_index": np.repeat([0, 1], n),
        "observation.state": pa.array(Q.tolist()),
        "observation.effort": pa.array(TAU.tolist(), pa.list_(pa.float64(), 2)),
    }
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    names = {"time": "timestamp", "position": "observation.state[{0}]", "torque": "observation.effort[{0}]"}
    found = joint_log_of(tmp_path / "log.parquet", names)
    np.testing.assert_array_equal(found.position, Q)
    assert "2 episodes, whose stamps begin anew" in found.notes[0]
    assert len(prepare(found, ARM)[0]) == 2
    whole = EPOCH * 10**9 + np.round(1e9 * T).astype(np.int64)
    for time, unit in ((pa.array(whole, pa.timestamp("ns")), "s"), (whole, "ns"), (whole.astype(np.uint64), "ns")):
        flat = dict(zip(HEAD, np.column_stack([Q, V, TAU]).T, strict=True))
        pq.write_table(pa.table({"time": time, **flat}), tmp_path / "log.parquet")
        np.testing.assert_allclose(joint_log_of(tmp_path / "log.parquet", time=unit).time, T, atol=1e-9)


def test_what_has_been_read_is_forgotten(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(lines(ROWS, ["time", *HEAD]))
    tables = [read_log(tmp_path / "log.csv")]
    held = pa.total_allocated_bytes()
    forget(tables)
    assert not tables
    assert pa.total_allocated_bytes() < held


@pytest.mark.parametrize("begin", [2**53 - 1, 2**53 + 1, -(2**53) - 9, 2**61])
def test_whole_numbers_that_floats_cannot_tell_apart_keep_their_differences(begin: int) -> None:
    [column] = numbers("stamp", pa.array([*(begin + k for k in (0, 1, 5, 8)), None]))
    assert [column.values[k] - column.values[0] for k in range(4)] == [0.0, 1.0, 5.0, 8.0]
    assert np.isnan(column.values[4])
    assert column.first == begin
    [small] = numbers("stamp", pa.array([0, 2**52]))
    assert (small.first, small.values.tolist()) == (None, [0.0, 2.0**52])


@pytest.mark.parametrize(
    ("seconds", "parts", "joined"),
    [
        ([7.0, 8.0], [0.0, 999_999_999.0], True),
        ([7.0, np.nan], [5.0, np.nan], True),
        ([7.0, np.nan], [0.0, 5.0], True),
        ([7.0, 8.0], [0.0, 1e9], False),
        ([7.0, 8.0], [-1.0, 5.0], False),
        ([7.0, 8.0], [0.5, 5.0], False),
        ([7.0, 8.5], [0.0, 5.0], False),
        ([7.0, np.nan], [np.nan, 5.0], False),
    ],
)
def test_parts_of_a_second_belong_to_whole_ones(seconds: list[float], parts: list[float], joined: bool) -> None:
    columns = {"Stamp.sec": np.array(seconds), "stamp.nanosec": np.array(parts)}
    log: Any = SimpleNamespace(columns=columns)
    assert _seconds_of("stamp.nanosec", log) == ("Stamp.sec" if joined else None)
    assert _seconds_of("Stamp.sec", log) is None
