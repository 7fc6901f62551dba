"""Calls with arguments of another kind are refused with what they should be."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import adaptctl
from adaptctl.cli.main import main
from adaptctl.contest.contest_file import Contest
from adaptctl.control import Sinusoids, excitation_trajectory, sliding_variable
from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError, InputError, NotFoundError
from adaptctl.hardware import HardwareLimits, MuJoCoRobot, drive, motion_about, with_rotors
from adaptctl.identification import read_drives
from adaptctl.identification.argument_words import in_flags
from adaptctl.identification.column_units import Units
from adaptctl.tuning.named_laws import named_law

WRONG = cast(Any, "two_link")


@pytest.fixture(scope="module")
def arm() -> Mechanism:
    return adaptctl.load("two_link")


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda arm: adaptctl.adaptive_controller(WRONG), "adaptive_controller: expected a Mechanism, as load(...)"),
        (lambda arm: excitation_trajectory(arm), "excitation trajectory: expected a ReducedModel, as ReducedModel("),
        (lambda arm: sliding_variable(arm, arm), "sliding variable: expected a Controller, as SlotineLi(...) is one"),
        (lambda arm: adaptctl.identify(np.zeros((9, 5)), arm), "logs: expected files, got array([0., 0., 0., 0., 0.])"),
        (lambda arm: adaptctl.identify([None], arm), "logs: expected files, got None"),
        (lambda arm: Sinusoids(None, [0.1, 0.1], [0.1, 0.1]), "center: expected numbers, got None"),
        (lambda arm: Sinusoids([0.0, None], [0.1, 0.1], [0.1, 0.1]), "center: expected numbers, got [0.0, None]"),
        (
            lambda arm: adaptctl.tune(arm, reference=cast(Any, np.zeros((9, 2)))),
            "reference: expected a Reference, as Spl",
        ),
        (
            lambda arm: drive(MuJoCoRobot(arm), adaptctl.ComputedTorque(arm, 8.0), WRONG, 1.0),
            "reference: expected a Reference, as Spline(positions,",
        ),
        (
            lambda arm: adaptctl.load(cast(Any, np.zeros((9, 2)))),
            "expected a robot's name, a file, a pinocchio.Model or",
        ),
        (lambda arm: motion_about([0.0] * 3, HardwareLimits.of(arm)), "posture: expected shape (..., 2), got (3,)"),
        (lambda arm: motion_about([0.0] * 2, WRONG), "limits: expected a HardwareLimits, as HardwareLimits.of(mech"),
        (lambda arm: with_rotors(WRONG), "with_rotors: expected a Mechanism, as load(...) gives one, got 'two_link'"),
        (lambda arm: arm.mass_matrix(None), "two_link: p: expected numbers of shape (..., 2), got None"),
    ],
)
def test_it_is_told_in_a_line(call: Callable[[Any], object], told: str, arm: Mechanism) -> None:
    with pytest.raises(InputError) as error:
        call(arm)
    assert told in str(error.value)
    assert "\n" not in str(error.value)


def test_a_log_and_its_columns_nearly_right_are_offered(arm: Mechanism, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,q1 [deg],q2 [deg]\n0,1,2\n1,2,3\n")
    with pytest.raises(FileError, match=r"lag\.csv: does not exist \(did you mean 'log\.csv'\?\)"):
        adaptctl.identify(tmp_path / "lag.csv", arm)
    with pytest.raises(
        InputError, match=r"no column 'q1' for position \(did you mean q1 \[deg\]\?\); .*torque are unkn"
    ):
        adaptctl.identify(tmp_path / "log.csv", arm, columns={"position": "q{}"})
    both = {"position": "2-3", "torque": "3,2", "time": "T"}
    units = {"position": "deg", "torque": "Nm", "time": "s"}
    with pytest.raises(InputError, match=r"no column 'T' for time; columns: t, q1 \[deg\], q2 \[deg\]$"):
        adaptctl.identify(tmp_path / "log.csv", arm, columns=both, sample_rate=100.0, units=units)


@pytest.mark.parametrize("given", ["deg", ["q1", "q2"]])
def test_columns_and_units_are_mappings(given: Any, arm: Mechanism, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("Time,a\n0,1\n1,2\n")
    for name in ("columns", "units"):
        with pytest.raises(InputError, match=rf"^{name}: expected a mapping such as {{'position': \.\.\.}}, got"):
            adaptctl.identify(log, arm, **{name: given})


@pytest.mark.parametrize(
    ("column", "pair"),
    [
        ("Time", "time=Time"),
        ("t [ms]", "'time=t [ms]'"),
        ("a", "time=NAME"),
        ("Time(ms)", "'time=Time(ms)'"),
        ("header.stamp.sec", "time=header.stamp.sec"),
        ("%time", "time=%time"),
    ],
)
def test_a_time_of_another_name_is_offered(column: str, pair: str, arm: Mechanism, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text(f"tau,{column},q1,q2,u1,u2\n0,0,0,0,0,0\n1,1,1,1,1,1\n")
    with pytest.raises(InputError) as error:
        in_flags(adaptctl.identify)(log, arm, columns={"position": "q{}", "torque": "u{}"})
    assert f": --columns {pair} position=q{{}} torque=u{{}} --units time=" in str(error.value)
    units = {"time": "s", "position": "rad", "torque": "N m"}
    with pytest.raises(InputError) as error:
        in_flags(adaptctl.identify)(log, arm, columns={"position": "q{}", "torque": "u{}"}, units=units)
    assert f"specify it: --columns {pair}, or the rate of even rows: --sample-rate HZ" in str(error.value)


@pytest.mark.parametrize(
    ("columns", "pairs"),
    [
        ("time,p.joint1,p.joint2,torque.joint1,torque.joint2", "position=p.joint{} torque=torque.joint{}"),
        ("t,q1 [deg],q2 [deg],M1 [Nm],M2 [Nm]", "'position=q{} [deg]' 'torque=M{} [Nm]'"),
        ("t,q0,q1,tau0,tau1", "position=q{0} torque=tau{0}"),
        ("t,power1,power2,pos_shoulder,pos_elbow,i1,i2", "position=pos_{joint} torque=NAMES"),
        ("t,q1,Torque10,Torque20", "position=NAMES torque=Torque{}0"),
        (
            "__time,/arm/j1/position,/arm/j2/position,/arm/j1/effort,/arm/j2/effort",
            "position=/arm/j{}/position torque=/arm/j{}/effort",
        ),
        (
            "t,target_q_0,target_q_1,actual_q_0,actual_q_1,actual_current_0,actual_current_1",
            "position=actual_q_{0} torque=actual_current_{0}",
        ),
        ("Time(ms),JntPos1,JntPos2,JntTrq1,JntTrq2", "position=JntPos{} torque=JntTrq{}"),
        ("%TIME,AXIS_ACT_A1,AXIS_ACT_A2,AXIS_TOR_A1,AXIS_TOR_A2", "position=AXIS_ACT_A{} torque=AXIS_TOR_A{}"),
    ],
)
def test_columns_that_a_log_has_are_offered(columns: str, pairs: str, arm: Mechanism, tmp_path: Path) -> None:
    log, n = tmp_path / "log.csv", columns.count(",") + 1
    log.write_text("\n".join([columns, *(",".join([str(k)] * n) for k in range(2))]))
    with pytest.raises(InputError) as error:
        in_flags(adaptctl.identify)(log, arm)
    assert f" {pairs} --units time=" in str(error.value)


def test_a_log_with_more_joints_than_the_robot_is_refused_with_what_would_be_unused(
    arm: Mechanism, tmp_path: Path
) -> None:
    names = ["time", *(f"{what}{j}" for what in ("q", "tau") for j in range(1, 4))]
    (tmp_path / "log.csv").write_text("\n".join([",".join(names), *(",".join([str(k)] * 7) for k in range(2))]))
    with pytest.raises(InputError, match=r"q\{\} has 3 columns, but the robot 2 joints .*: q3 would be .*=q1,q2$"):
        in_flags(adaptctl.identify)(tmp_path / "log.csv", arm, columns={"position": "q{}", "torque": "tau{}"})


def test_a_drives_file_to_edit_is_written(arm: Mechanism, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, file = tmp_path / "log.csv", tmp_path / "drives.toml"
    log.write_text("ms,m1_pos,m2_pos,m1_cur,m2_cur\n0,1,2,3,4\n4,1,2,3,4\n")
    assert main(["identify", str(log), "--robot", "two_link", "--template", str(file)]) == 0
    found = read_drives(file).ordered_like(arm)
    assert f"--drives {file}" in capsys.readouterr().out
    assert found.time == "ms"
    assert found.units == Units(1e-3, 1.0, None)
    assert [(motor.name, motor.position, motor.torque) for motor in found.motors] == [
        ("shoulder", "m1_pos", "m1_cur"),
        ("elbow", "m2_pos", "m2_cur"),
    ]


NAMELESS = "uptime_ms,Schulter_grad,Ellbogen_grad,I_a,I_b\n0,1,2,3,4\n4,1,2,3,4\n"


def test_what_no_name_tells_is_not_made_up(arm: Mechanism, tmp_path: Path) -> None:
    """Neither columns nor units: a file with what is to be replaced is refused until it is."""
    log, file = tmp_path / "log.csv", tmp_path / "drives.toml"
    log.write_text(NAMELESS)
    with pytest.raises(InputError, match="no names are recognised as position or torque: in place of NAMES") as error:
        in_flags(adaptctl.identify)(log, arm)
    assert "position=NAMES torque=NAMES --units time=ms position=UNIT torque=UNIT" in str(error.value)
    assert main(["identify", str(log), "--robot", "two_link", "--template", str(file)]) == 0
    with pytest.raises(FileError, match="got 'UNIT'"):
        read_drives(file)


def test_units_are_those_that_names_end_with(arm: Mechanism, tmp_path: Path) -> None:
    log, file = tmp_path / "log.csv", tmp_path / "drives.toml"
    log.write_text("t_ms,pos_shoulder_mm,pos_elbow_mm,cur_shoulder_A,cur_elbow_A\n0,1,2,3,4\n4,1,2,3,4\n")
    assert main(["identify", str(log), "--robot", "two_link", "--template", str(file)]) == 0
    assert read_drives(file).units == Units(1e-3, 1e-3, None)
    log.write_text("t_ms,Hub_mm,Arm_grad,I_a,I_b\n0,1,2,3,4\n4,1,2,3,4\n")
    with pytest.raises(InputError, match="position=mm,deg"):
        in_flags(adaptctl.identify)(log, arm, columns={"position": "Hub_mm,Arm_grad"})


def test_all_columns_are_told_or_how_many_there_are(arm: Mechanism, tmp_path: Path) -> None:
    names = ["a", *(f"b{k}" for k in range(40))]
    (tmp_path / "log.csv").write_text("\n".join([",".join(names), *(",".join([str(k)] * 41) for k in range(2))]))
    with pytest.raises(InputError, match=r"columns: a, b0, .*, b28, \.\.\. \(41 in all\)$"):
        in_flags(adaptctl.identify)(tmp_path / "log.csv", arm)


@pytest.mark.parametrize(
    ("name", "column", "unit"),
    [
        ("stamp_ms", [0.0, 4.0], "time=ms"),
        ("stamp", [0.0, 4000.0], "time=us"),
        ("stamp", [0.0, 0.004], "time=s"),
    ],
)
def test_units_are_offered_by_names_and_sizes(
    name: str, column: list[float], unit: str, arm: Mechanism, tmp_path: Path
) -> None:
    rows = [f"{t},{20 * t},1,2,3" for t in column]
    (tmp_path / "log.csv").write_text("\n".join([f"{name},q1,q2,tau1_nm,tau2_nm", *rows]))
    with pytest.raises(InputError) as error:
        in_flags(adaptctl.identify)(tmp_path / "log.csv", arm)
    angle = "deg" if column[1] > 1.0 else "rad"
    assert f"--units {unit} position={angle} 'torque=N m' (" in str(error.value)


def test_a_law_in_capitals_is_offered_in_small_letters() -> None:
    with pytest.raises(NotFoundError, match=r"unknown law 'Slotine-Li' \(did you mean 'slotine-li'\?\); laws: "):
        named_law("Slotine-Li", cast(Any, None), cast(Any, None))


def test_files_of_other_kinds_are_told(arm: Mechanism, tmp_path: Path) -> None:
    log, robot = tmp_path / "run" / "trace.parquet", tmp_path / "robot.toml"
    log.parent.mkdir()
    log.write_text("")
    with pytest.raises(FileError, match=r"run: is a folder of results; its log is .*trace\.parquet$"):
        adaptctl.identify(log.parent, arm)
    robot.write_text('schema = "adaptctl/mechanism/1"\nname = "arm"\n')
    with pytest.raises(FileError, match="expected one of 'adaptctl/drives/1'; this is a robot file"):
        read_drives(robot)
    with pytest.raises(InputError, match=r'mine\.py: expected a TOML file, .* laws = \[".*mine\.py:CLASS"\]'):
        Contest.of(tmp_path / "mine.py")
