"""Columns, units and logs that cannot be meant: each refused by name, not taken for what it is not."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from adaptctl.description import Description, Joint, JointKind, Limits, Link, Pose
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError, InputError
from adaptctl.identification import identify
from adaptctl.identification.columns import JointLog, joint_columns
from adaptctl.identification.log_files import LogTable, read_log
from adaptctl.identification.preparation import prepare
from adaptctl.identification.unknown_columns import unused_joints

REVOLUTE, PRISMATIC = JointKind.REVOLUTE, JointKind.PRISMATIC
LIMITS = Limits(-1.0, 1.0, velocity=2.0, effort=30.0)
SI = {"time": "s", "position": "rad", "velocity": "rad/s", "torque": "N m"}


def arm(*kinds: JointKind) -> Mechanism:
    place = Pose(np.eye(3), np.array([0.5, 0.0, 0.0]))
    inertia = from_center_of_mass(2.0, [0.2, 0.0, 0.1], 0.05 * np.eye(3))
    links = [
        Link(
            f"link{i}", i - 1, Joint(f"j{i}", kind, np.array([0.0, 1.0, 0.0]), LIMITS), place, Pose.identity(), inertia
        )
        for i, kind in enumerate(kinds)
    ]
    return Mechanism(Description("arm", tuple(links), np.array([0.0, 0.0, -9.81])))


def log_of(mechanism: Mechanism) -> LogTable:
    whats = [
        f"{what}.{joint.name}" for joint in mechanism.primary_joints for what in ("position", "velocity", "effort")
    ]
    return LogTable("log.csv", {name: np.arange(200.0) for name in ("time", *whats)})


@pytest.mark.parametrize(
    ("kinds", "what", "unit", "message"),
    [
        ((PRISMATIC,), "position", "deg", "unit of position: joint 'j0' slides: expected m or mm, got 'deg'"),
        ((PRISMATIC,), "velocity", "rpm", "unit of velocity: joint 'j0' slides: expected m/s or mm/s, got 'rpm'"),
        ((PRISMATIC,), "torque", "mNm", "unit of torque: joint 'j0' slides: expected N, got 'mNm'"),
        ((REVOLUTE,), "position", "mm", "unit of position: joint 'j0' turns: expected rad, deg, rev or mrad, got 'mm'"),
        ((REVOLUTE,), "position", "m", "unit of position: joint 'j0' turns: expected rad, deg, rev or mrad, got 'm'"),
        ((REVOLUTE,), "velocity", "m/s", "unit of velocity: joint 'j0' turns: expected rad/s, deg/s or rpm, got"),
        ((REVOLUTE,), "torque", "N", "unit of torque: joint 'j0' turns: expected N m or mN m, got 'N'"),
        ((REVOLUTE, PRISMATIC), "position", "deg", "unit of position: joint 'j1' slides: expected m or mm, got 'deg'"),
        ((PRISMATIC, REVOLUTE), "position", "mm", "unit of position: joint 'j1' turns: expected rad, deg, rev or mrad"),
    ],
)
def test_units_of_other_joints_are_refused(kinds: tuple[JointKind, ...], what: str, unit: str, message: str) -> None:
    mechanism = arm(*kinds)
    with pytest.raises(InputError, match=message):
        joint_columns(mechanism, log_of(mechanism), units=SI | {what: unit})


@pytest.mark.parametrize("kinds", [(REVOLUTE,), (PRISMATIC,), (REVOLUTE, PRISMATIC)])
def test_si_units_as_messages_of_ros_have_them_are_of_any_joints(kinds: tuple[JointKind, ...]) -> None:
    mechanism = arm(*kinds)
    assert joint_columns(mechanism, log_of(mechanism), units=SI).units.position == 1.0
    linear = {"time": "s", "position": "m", "velocity": "m/s", "torque": "N"}
    if PRISMATIC in kinds:
        assert joint_columns(mechanism, log_of(mechanism), units=linear).units.torque == 1.0


def test_a_column_is_of_one_joint() -> None:
    mechanism = arm(REVOLUTE, REVOLUTE)
    with pytest.raises(
        InputError, match=r"columns: position: 'position\.j0' is given for joint 'j0' and 'j1'; in a pattern"
    ):
        joint_columns(mechanism, log_of(mechanism), {"position": "position.j0"}, SI)


def test_all_unknown_units_are_told_at_once() -> None:
    mechanism = arm(REVOLUTE)
    wrong = SI | {"time": "millis", "torque": "Nmm"}
    with pytest.raises(InputError, match=r"unit of time: .* got 'millis'; unit of torque: "):
        joint_columns(mechanism, log_of(mechanism), units=wrong)


def test_joints_that_the_robot_has_not_are_told() -> None:
    mechanism, log = arm(REVOLUTE, REVOLUTE), log_of(arm(REVOLUTE, REVOLUTE, REVOLUTE))
    drives = joint_columns(mechanism, log, units=SI)
    (told,) = unused_joints(log, drives, mechanism)
    assert "j2" in told
    assert "j0" not in told
    assert unused_joints(log_of(mechanism), drives, mechanism) == []


def test_names_of_columns_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(b"time,position.\xe9\x01\n1,2\n")
    with pytest.raises(FileError, match=r"log\.csv: not a text table \('utf-8' codec can't decode byte 0xe9"):
        read_log(tmp_path / "log.csv")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("time;p\n0;1\n0,5;-2,25\n1;3e-1\n", [1.0, -2.25, 0.3]),
        ("time\tp\n0\t1,5\n1\t2,5\n", [1.5, 2.5]),
        ("time;p\n0;1.5\n1;2.5\n", [1.5, 2.5]),
        ("time;p;note\n0;1.5;1,5\n1;2.5;\n", [1.5, 2.5]),
    ],
)
def test_decimal_commas_are_read_where_they_separate_nothing(text: str, found: list[float], tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(text)
    np.testing.assert_array_equal(read_log(tmp_path / "log.csv").column("p", "position"), found)


def test_a_log_is_not_judged_by_itself(tmp_path: Path) -> None:
    mechanism = arm(REVOLUTE)
    table = log_of(mechanism)
    rows = np.stack(list(table.columns.values()), axis=-1)
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(table.columns), comments="")
    shutil.copy(tmp_path / "log.csv", tmp_path / "other.csv")
    log, same = tmp_path / "log.csv", tmp_path / "." / "log.csv"
    (tmp_path / "link.csv").symlink_to(log)
    for logs, others, message in (
        ([log], [same], "validate: .*log.csv is also used for the fit"),
        ([log, tmp_path / "other.csv"], [tmp_path / "link.csv"], "validate: .*link.csv is also used for the fit"),
        ([log, same], [], "logs: .*log.csv is given twice"),
        ([log], [tmp_path / "other.csv", tmp_path / "other.csv"], "validate: .*other.csv is given twice"),
    ):
        with pytest.raises(InputError, match=message):
            identify(logs, mechanism, units=SI, validate=others)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"units": SI | {"time": None}}, "units: time: expected a text, got None"),
        ({"columns": {"position": 3}}, "columns: position: expected a text, got 3"),
        ({"friction": ("viscous", "coulomb")}, r"friction: expected a text such as viscous,coulomb, got \('viscous'"),
        ({"friction": 3}, "friction: expected a text such as viscous,coulomb, got 3"),
        ({"skip_steps": "limits"}, "skip_steps: expected a list of names, got the text 'limits'"),
    ],
)
def test_arguments_of_another_kind_are_named(given: dict[str, Any], message: str, tmp_path: Path) -> None:
    mechanism = arm(REVOLUTE)
    time = np.arange(200) / 100.0
    columns = {"time": time, "position.j0": np.sin(time), "velocity.j0": np.cos(time), "effort.j0": 5.0 * np.sin(time)}
    rows = np.stack(list(columns.values()), axis=-1)
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(columns), comments="")
    with pytest.raises(InputError, match=message):
        identify(tmp_path / "log.csv", mechanism, **({"units": SI} | given))


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ((1.0, 1.0, 1e3), r"joint 'j0' has a torque of .* N, but the limit of the robot is 30"),
        (
            (1e2, 1.0, 1.0),
            "joint 'j0' moves at .* m/s, but the limit of the robot is 2; check the gear ratio, "
            "and whether positions are in mm",
        ),
    ],
)
def test_limits_of_what_slides_are_told_in_its_units(factors: tuple[float, float, float], message: str) -> None:
    time = np.arange(400) / 100.0
    far, _, strong = factors
    log = JointLog("log", time, far * np.sin(time)[:, None], strong * np.cos(time)[:, None])
    with pytest.raises(InputError, match=message):
        prepare(log, arm(PRISMATIC))


def test_a_joint_that_rests_in_all_pieces_is_told(recwarn: pytest.WarningsRecorder) -> None:
    """It moves only in what is left out, before a hole: its velocities cannot be compared."""
    time = np.concatenate([np.arange(20) / 100.0, 10.0 + np.arange(400) / 100.0])
    p = np.stack([np.sin(time), np.where(time < 5.0, time, 0.2)], axis=-1)
    v = np.stack([np.cos(time), np.where(time < 5.0, 1.0, 0.0)], axis=-1)
    _, steps = prepare(JointLog("log", time, p, 1.0 + p, v), arm(REVOLUTE, REVOLUTE))
    outcome = next(step.outcome for step in steps if step.name == "velocities")
    assert outcome.startswith("logged velocities are 1.0")
    assert not recwarn.list
