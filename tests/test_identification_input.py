"""Bad logs and bad files: each refused by name, with nothing written."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from nightly import mostly_at_night
from random_trees import random_chain
from synthetic_logs import known

from adaptctl.cli.main import main
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import FileError, InputError, NotFoundError
from adaptctl.identifiability import Constraints, constrained
from adaptctl.identification import identify, read_drives
from adaptctl.identification.columns import joint_columns, joint_log
from adaptctl.identification.entropic import prior_links
from adaptctl.identification.examples import example
from adaptctl.identification.identify import identified
from adaptctl.identification.log_files import LogTable, read_log, table
from adaptctl.identification.preparation import prepare

MOTORS = range(1, 7)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """The example's files, to spoil."""
    with example("tx40") as found:
        shutil.copy(found.robot, tmp_path / "tx40.urdf")
        shutil.copy(found.drives, tmp_path / "drives.toml")
        log = pq.read_table(found.log).slice(0, 2500)
    pq.write_table(log, tmp_path / "log.parquet")
    return tmp_path


def columns(files: Path) -> dict[str, np.ndarray]:
    read = pq.read_table(files / "log.parquet")
    return {name: read[name].to_numpy().astype(np.float64) for name in read.column_names}


Spoil = Callable[[dict[str, np.ndarray]], object]


def times(name: str, factor: float) -> Spoil:
    def spoil(log: dict[str, np.ndarray]) -> None:
        for column in log:
            if column.startswith(name):
                log[column] = factor * log[column]

    return spoil


def put(name: str, where: slice, value: float) -> Spoil:
    def spoil(log: dict[str, np.ndarray]) -> None:
        log[name] = log[name].copy()
        log[name][where] = value

    return spoil


def cut(count: int) -> Spoil:
    def spoil(log: dict[str, np.ndarray]) -> None:
        log.update({name: values[:count] for name, values in log.items()})

    return spoil


def at_rest(log: dict[str, np.ndarray]) -> None:
    rng = np.random.default_rng(0)
    for name in log:
        if name.startswith("motor_position"):
            log[name] = log[name][0] + 1e-5 * rng.normal(size=len(log[name]))


def exchanged(log: dict[str, np.ndarray]) -> None:
    names = [name for name in log if name.startswith("motor_position")]
    for name in names:
        other = name.replace("position", "torque")
        log[name], log[other] = log[other], log[name]


BAD: dict[str, tuple[Spoil, str]] = {
    "missing column": (
        lambda log: log.pop("motor_torque_3"),
        "no column 'motor_torque_3' for torque of motor_3; did you",
    ),
    "constant position": (
        put("motor_position_2", slice(None), 1.0),
        "'motor_position_2' is 1 in every row: the joint is",
    ),
    "constant torque": (put("motor_torque_4", slice(None), 0.0), "'motor_torque_4' is 0 in every row: no torque was"),
    "torque of a position": (
        lambda log: log.update({"motor_torque_5": log["motor_position_5"]}),
        "'motor_position_5' and 'motor_torque_5' have the same numbers",
    ),
    "NaN": (
        put("motor_torque_1", slice(7, 9), np.nan),
        r"'motor_torque_1' .*: 2 of 2500 rows not finite, the first is row 8 \(nan\)",
    ),
    "infinity": (
        put("motor_position_1", slice(3, 4), np.inf),
        r"'motor_position_1' .*: 1 of 2500 rows not finite, the first is row 4 \(inf\)",
    ),
    "repeated stamp": (put("time", slice(10, 11), 0.0094), "'time': the stamp 0.0094 of row 11 is repeated; time must"),
    "stamps backwards": (
        put("time", slice(10, 11), 0.0),
        "'time': the stamp 0 of row 11 is smaller than the previous one",
    ),
    "rows for time": (
        lambda log: log.update(time=np.arange(len(log["time"]), dtype=float)),
        "'time' counts rows .* and is not a time; give the sampling rate with --sample-rate HZ",
    ),
    "three samples": (cut(3), "has 3 samples; at least 100 are needed"),
    "too short": (
        cut(150),
        r"150 consecutive samples are too few|the log has only 0\.15 s of motion; at least 1\.5 s are needed",
    ),
    "milliseconds": (
        times("time", 1e3),
        r"the sampling rate is 1 Hz, .*; check the unit of time \(ms taken for s\), or record faster",
    ),
    "microseconds": (times("time", 1e-3), r"the sampling rate is 1e\+06 Hz, .* \(s taken for ms\)"),
    "degrees": (
        times("motor_position", 180.0 / np.pi),
        "joint 'joint_1' moves at .*; check the gear ratio, and whether positions are in deg",
    ),
    "another robot": (
        lambda log: log.update(motor_position_2=log["motor_position_2"] + 200.0),
        "joint 'joint_2' moves from .*, but the limits of the robot file are -2.18 to 2.18; .* the log is this robot's",
    ),
    "milli": (
        times("motor_torque", 1e3),
        "joint 'joint_1' has a torque of .* N m, but the limit of the robot is 132; check the unit of torque",
    ),
    "positions for torques": (
        exchanged,
        "joint 'joint_1' has a torque of .*, and whether positions and torques are exchanged, as the torques",
    ),
    "wrong sign": (
        times("motor_torque_4", -1.0),
        "column 'motor_torque_4' has the other sign: .*negate it, or .* by --trust-log",
    ),
    "noise for torque": (
        lambda log: log.update({f"motor_torque_{i}": 0.1 * np.random.default_rng(i).normal(size=2500) for i in MOTORS}),
        "the equations of staubli_tx40 do not explain .* of the torques; check .* this robot's, .* no velocities; with",
    ),
    "at rest": (at_rest, "the arm is at rest throughout"),
}


@pytest.mark.parametrize("fault", mostly_at_night(BAD, *list(BAD)[::2]))
def test_a_bad_log_is_refused_by_name_and_nothing_is_written(
    fault: str, files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, message = BAD[fault]
    log = columns(files)
    spoil(log)
    pq.write_table(pa.table(log), files / "bad.parquet")
    line = [
        files / "bad.parquet",
        "--robot",
        files / "tx40.urdf",
        "--drives",
        files / "drives.toml",
        "--out",
        files / "out",
    ]
    assert main(["identify", *map(str, line)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(said)
    assert "bad.parquet" in said
    assert not (files / "out").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[0, 32, 0, 0, 0, 0]", "[0, 32, 0, 0, 0]", r"\$.transmission: expected a row for each of 6 motors"),
        (
            "[0, 32, 0, 0, 0, 0]",
            "[32, 0, 0, 0, 0, 0]",
            r"\$.transmission\[1\]: motor 'motor_2' must turn its own joint",
        ),
        ('"joint_6"]', '"joint_5"]', r"\$.joints: expected unique names"),
        ('"joint_6"]', '"tool"]', "the drives are for the joints .*tool, but staubli_tx40 has .*joint_6"),
        ('position = "rad"', 'position = "grad"', "unit of position: expected one of rad, deg, rev"),
        ('torque = "N m"', 'torque = "A"', r"\$.motors\[0\].torque_constant is missing: 'A' is not a torque"),
        ("joint_offsets_deg", "joint_offsets = [0, 0, 0, 0, 0, 0]\njoint_offsets_deg", "offsets are given twice"),
        ("time =", "colour = 1\ntime =", "unknown field `colour`.*expected one of schema"),
        (
            'torque = "motor_torque_1"',
            'torque = "motor_torque_1", torque_constant = 2.0',
            r"\[0\].torque_constant: the log has",
        ),
    ],
)
def test_a_bad_drives_file_is_refused_by_name(old: str, new: str, message: str, files: Path) -> None:
    text = (files / "drives.toml").read_text()
    assert old in text
    (files / "bad.toml").write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        read_drives(files / "bad.toml").ordered_like(load(files / "tx40.urdf"))


def test_all_errors_of_a_drives_file_are_told_at_once_and_what_has_one_meaning_needs_no_key(tmp_path: Path) -> None:
    text = """joints = ["a", "b"]
transmission = [[50, 0], [0, 80]]
units = { time = "s", position = "rad", torque = "N m" }
motors = [{ position = "p", torque = "c" }, { position = "p2", torque = "c2" }]
"""
    (tmp_path / "short.toml").write_text(text)
    found = read_drives(tmp_path / "short.toml")
    assert (found.time, [motor.name for motor in found.motors]) == ("time", ["a", "b"])
    wrong = text.replace('["a", "b"]', '"a"').replace('"rad", torque = "N m"', "3").replace("{ position =", "{ pos =")
    (tmp_path / "wrong.toml").write_text(wrong)
    with pytest.raises(FileError) as error:
        read_drives(tmp_path / "wrong.toml")
    told = ["7 errors", "`$.joints` (line 1)", '`torque` is missing, such as torque = "N m" - at `$.units`']
    for word in (*told, "`$.units.position`", "`pos` - at `$.motors[0]`", "`pos` - at `$.motors[1]`"):
        assert word in str(error.value)
    (tmp_path / "meant.toml").write_text(text.replace("80", "0").replace('"s"', '"h"').replace('"rad"', '"turn"'))
    with pytest.raises(FileError, match=r"3 errors: .*must turn.*unit of time.*unit of position.*\(line 3\)$"):
        read_drives(tmp_path / "meant.toml")


def test_drives_of_other_joints_and_columns_are_told_at_once(files: Path) -> None:
    text = (files / "drives.toml").read_text()
    (files / "bad.toml").write_text(text.replace('"joint_6"', '"tool"').replace('"motor_torque_1"', '"tau_1"'))
    with pytest.raises(InputError, match=r"the drives are for .*tool, but .*no columns 'tau_1'; columns: time,"):
        identify(files / "log.parquet", files / "tx40.urdf", files / "bad.toml")


def test_velocities_that_disagree_tell_wrong_units(files: Path) -> None:
    mechanism = random_chain(1, 2)
    time = np.arange(1000) / 250.0
    p = np.stack([np.sin(time), np.cos(2.0 * time)], axis=-1)
    v = np.stack([np.cos(time), -2.0 * np.sin(2.0 * time)], axis=-1)
    names = [joint.name for joint in mechanism.primary_joints]

    def log(factor: float, scale: float = 1.0) -> LogTable:
        found = {"time": scale * time}
        for j, name in enumerate(names):
            found |= {
                f"{name}.position": p[:, j],
                f"{name}.velocity": factor * v[:, j],
                f"{name}.torque": p[:, j] + v[:, j],
            }
        return table("mine.csv", found.items())

    units = {"time": "s", "position": "rad", "velocity": "rad/s", "torque": "N m"}

    def prepared(log: LogTable, **other: str) -> None:
        drives = joint_columns(mechanism, log, units=units | other)
        prepare(joint_log(log, drives), mechanism)

    prepared(log(1.0))
    prepared(log(180.0 / np.pi), velocity="deg/s")
    for wrong, message in (
        (180.0 / np.pi, "logged velocities are 57.2. times the differentiated positions: velocities in deg/s"),
        (np.pi / 180.0, "0.0174.* times .*: positions in deg taken for rad"),
        (-1.0, "-(1|0.9997) times .*: one of them has the wrong sign"),
    ):
        with pytest.raises(InputError, match=message):
            prepared(log(wrong))
    with pytest.raises(InputError, match=r"1000 times .*: time in s taken for ms|the sampling rate is 2.5e.05 Hz"):
        prepared(log(1.0), time="ms")


def test_what_is_not_stated_is_asked_for_by_name() -> None:
    mechanism = random_chain(1, 2)
    numbers = np.arange(200.0)
    log = table(
        "arm.csv", {"t": numbers, **{f"q{i}": numbers for i in (1, 2)}, **{f"cur{i}": numbers for i in (1, 2)}}.items()
    )
    with pytest.raises(
        InputError, match=r"the columns of each joint's position and torque are unknown.*--columns.*columns: t, q1"
    ):
        joint_columns(mechanism, log)
    with pytest.raises(InputError, match=r"the columns of each joint's torque are unknown"):
        joint_columns(mechanism, log, {"position": "q{}"})
    with pytest.raises(
        InputError, match=r"no column 'p1' for position; .*torque are unknown; .*units .*columns: t, q1"
    ):
        joint_columns(mechanism, log, {"position": "p{}"})
    named = {"position": "q{}", "torque": "cur{}"}
    with pytest.raises(InputError, match=r"no column 'time' for the time; the units of .*--columns time=t "):
        joint_columns(mechanism, log, named)
    named |= {"time": "t"}
    with pytest.raises(InputError, match="units of time, position, torque are unknown; give"):
        joint_columns(mechanism, log, named)
    units = {"time": "s", "position": "rad"}
    with pytest.raises(InputError, match="torques in A need torque constants; give a drives file"):
        joint_columns(mechanism, log, named, units | {"torque": "A"})
    told = LogTable(log.source, log.columns, {"cur1": "%", "cur2": "%"})
    with pytest.raises(InputError, match="torques in % need torque constants; give a drives file"):
        joint_columns(mechanism, told, named, units)
    with pytest.raises(InputError, match="columns: expected time, position, torque, velocity, got 'angle'"):
        joint_columns(mechanism, log, {"angle": "q{}"})
    assert joint_columns(mechanism, log, named, units | {"torque": "Nm"}).motors[1].torque == "cur2"


def test_columns_of_a_table_are_equally_long() -> None:
    with pytest.raises(FileError, match=r"mine\.csv: column 'q' has 3 rows, but 'time' has 2"):
        table("mine.csv", [("time", np.arange(2.0)), ("q", np.arange(3.0))])
    with pytest.raises(FileError, match=r"mine\.csv: column 'q' has 0 rows"):
        table("mine.csv", [("time", np.arange(2.0)), ("q", np.empty(0))])


def test_text_logs_are_read_whatever_separates_them(tmp_path: Path) -> None:
    for mark in (",", ";", "\t"):
        (tmp_path / "log.csv").write_text(
            mark.join(("time", "q", "note")) + "\n" + mark.join(("0.5", "2", "start")) + "\n"
        )
        read = read_log(tmp_path / "log.csv")
        assert (read.column("time", "time"), read.column("q", "position")) == ([0.5], [2.0])
        with pytest.raises(FileError, match=r"column 'note' .*the first is row 1 \(nan\)"):
            read.column("note", "position")
    for text, message in (
        ("", "not a text table|no rows"),
        ("a,b\n", "no rows"),
        ("a,b\n1\n", "not a text table"),
    ):
        (tmp_path / "bad.csv").write_text(text)
        with pytest.raises(FileError, match=message):
            read_log(tmp_path / "bad.csv")
    (tmp_path / "twice.csv").write_text("a,a\n1,2\n")
    assert {name: values[0] for name, values in read_log(tmp_path / "twice.csv").columns.items()} == {
        "a (1)": 1.0,
        "a (2)": 2.0,
    }
    (tmp_path / "bad.parquet").write_bytes(b"nonsense")
    with pytest.raises(FileError, match="not a Parquet file"):
        read_log(tmp_path / "bad.parquet")
    with pytest.raises(FileError, match="does not exist"):
        read_log(tmp_path / "nowhere.csv")
    for name, way in (
        ("log.mat", "write its columns, .*"),
        ("log.csv.gz", "unpack it"),
        ("log.xlsx", "write its sheet "),
    ):
        (tmp_path / name).write_bytes(b"x")
        with pytest.raises(FileError, match=rf"logs are read from .csv, .*not from \.{name.rpartition('.')[2]}; {way}"):
            read_log(tmp_path / name)


def test_columns_of_lists_keep_their_unit(tmp_path: Path) -> None:
    numbers = np.arange(6.0)
    pairs = pa.FixedSizeListArray.from_arrays(pa.array(np.arange(12.0)), 2)
    fields = [pa.field("time", pa.float64(), metadata={"unit": "s"})]
    fields += [pa.field(name, pairs.type, metadata={"unit": unit}) for name, unit in (("p", "deg"), ("tau", "mN m"))]
    pq.write_table(pa.Table.from_arrays([numbers, pairs, pairs], schema=pa.schema(fields)), tmp_path / "log.parquet")
    log = read_log(tmp_path / "log.parquet")
    assert log.units == {"time": "s", "p[0]": "deg", "p[1]": "deg", "tau[0]": "mN m", "tau[1]": "mN m"}
    np.testing.assert_array_equal(log.column("p[1]", "position"), [1, 3, 5, 7, 9, 11])
    arm = random_chain(1, 2).description
    links = tuple(replace(link, joint=replace(link.joint, name=str(i))) for i, link in enumerate(arm.links))
    drives = joint_columns(
        Mechanism(replace(arm, links=links)), log, {"position": "p[{joint}]", "torque": "tau[{joint}]"}
    )
    assert (drives.units.position, drives.units.torque) == (np.pi / 180.0, 1e-3)


def test_columns_of_lists_are_named_by_numbers_from_0(tmp_path: Path) -> None:
    pairs = pa.FixedSizeListArray.from_arrays(pa.array(np.arange(12.0)), 2)
    pq.write_table(pa.table({"time": np.arange(6.0), "p": pairs, "tau": pairs}), tmp_path / "log.parquet")
    named = {"position": "p[{0}]", "torque": "tau[{0}]"}
    units = {"time": "s", "position": "rad", "torque": "N m"}
    drives = joint_columns(random_chain(1, 2), read_log(tmp_path / "log.parquet"), named, units)
    assert [(motor.position, motor.torque) for motor in drives.motors] == [("p[0]", "tau[0]"), ("p[1]", "tau[1]")]


def test_columns_of_lists_of_other_things_than_numbers_are_left_out(tmp_path: Path) -> None:
    pairs = pa.FixedSizeListArray.from_arrays(pa.array([True, None] * 4), 2)
    texts = pa.FixedSizeListArray.from_arrays(pa.array(list("abcdefgh")), 2)
    nested = pa.FixedSizeListArray.from_arrays(pa.FixedSizeListArray.from_arrays(pa.array(np.arange(16.0)), 2), 2)
    columns = {"time": np.arange(4.0), "note": texts, "pose": nested, "on": pairs}
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    log = read_log(tmp_path / "log.parquet")
    assert list(log.columns) == ["time", "on[0]", "on[1]"]
    np.testing.assert_array_equal(log.columns["on[0]"], np.ones(4))
    assert np.isnan(log.columns["on[1]"]).all()


def test_priors_are_made_consistent_and_said() -> None:
    with example("tx40") as files:
        arm = load(files.robot)
    tens, remarks = prior_links(arm)
    assert len(remarks) == 1
    assert remarks[0].startswith("link_6: its inertia in the robot file is not physically consistent")
    np.testing.assert_array_equal(tens[:5].ravel(), arm.inertial_parameters[:50])
    np.testing.assert_array_equal(tens[5][:4], arm.inertial_parameters[50:54])
    D = arm.inertial_parameters.copy()
    D[20:30] = 0.0
    with pytest.raises(InputError, match="link 'link_3' has no mass in the robot file"):
        prior_links(arm.with_parameters(D))


def test_constraints_on_parameters_are_refused_and_not_left_out() -> None:
    case = known(1, 2, duration=4.0)
    slim = constrained(case.guess, Constraints({"link1.mc_z": 0.0}))
    with pytest.raises(InputError, match=r"does not support constraints .*; give `mechanism\.unconstrained`"):
        identified(slim, case.drives, [case.log])


def test_the_command_says_what_it_needs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for line, message in (
        (["log.csv"], "--robot is missing: give a robot file, or try the example: adaptctl identify tx40"),
        (["log.csv", "--robot", "puma560_measured"], "log.csv: does not exist"),
        (["tx40", "--columns", "position", "--out", str(tmp_path / "out")], "--columns: expected WHAT=NAME, such as"),
        (
            ["tx40", "--payload", "1.0", "--out", str(tmp_path / "out")],
            "--payload: expected LOG=LINK, such as loaded.csv=tool0, got '1.0'",
        ),
        (["tx40", "--friction", "glue", "--out", str(tmp_path / "out")], "friction: expected some of viscous"),
        (["tx40", "--skip-steps", "thinking", "--out", str(tmp_path / "out")], "--skip-steps: expected resample, "),
    ):
        assert main(["identify", *line]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    with pytest.raises(NotFoundError, match="unknown example 'ur5'; examples: tx40"), example("ur5"):
        pass
