"""Joints held fast, frames of links that fixed joints hold, and gravity of a tilted mount."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from random_trees import random_chain

import adaptctl
from adaptctl.cli.main import main
from adaptctl.description.drive import Drive
from adaptctl.dynamics import load
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.errors import FileError, InputError, NotFoundError
from adaptctl.identification.argument_words import in_flags
from adaptctl.identification.columns import JointLog
from adaptctl.identification.drives_file import Drives, MotorEntry, Units
from adaptctl.identification.own_gravity import validate_not_added, with_own_gravity
from adaptctl.logs.table import LogTable
from adaptctl.simulation.effects import Payload, PayloadHeld

LINK = (
    '<link name="{0}"><inertial><origin xyz=".1 .02 {1}" rpy=".1 .2 .3"/><mass value="1.{1}"/>'
    '<inertia ixx=".02" ixy=".001" ixz="0" iyy=".03" iyz="0" izz=".04"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz=".3 .1 .2" rpy=".3 -.2 .5"/>'
    '<axis xyz="{4}"/><limit lower="{5}" upper="3" effort="900" velocity="3"/>{6}</joint>'
)


def urdf(mimic: str = "") -> str:
    links = '<link name="base"/>' + "".join(LINK.format(name, i + 1) for i, name in enumerate("abcd"))
    joints = [
        JOINT.format("j1", "revolute", "base", "a", "0 0 1", -3, ""),
        JOINT.format("j2", "prismatic", "a", "b", "0 1 0", -3, ""),
        JOINT.format("j3", "revolute", "b", "c", "1 0 0", 0.5, ""),
        JOINT.format("j4", "revolute", "c", "d", "0 1 0", -3, mimic),
    ]
    tool = '<link name="tool0"/><joint name="jt" type="fixed"><parent link="d"/><child link="tool0"/>'
    tool += '<origin xyz=".3 0 .05" rpy=".3 .5 -1"/></joint>'
    return f'<robot name="arm">{links}{"".join(joints)}{tool}</robot>'


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    (tmp_path / "arm.urdf").write_text(urdf())
    return tmp_path / "arm.urdf"


def test_a_locked_arm_moves_as_the_whole_one_with_that_joint_still(arm: Path) -> None:
    whole, rng = load(arm), np.random.default_rng(0)
    for held in ({"j2": 0.4}, {"j1": 1.0, "j3": 0.7}, {"j4": None, "j2": -0.2}):
        locked, free = whole.locked(held), [j for j in range(4) if f"j{j + 1}" not in held]
        p, v, a = np.zeros((3, 4))
        p[free], v[free], a[free] = rng.normal(size=(3, len(free)))
        for name, value in held.items():
            p[int(name[1]) - 1] = value or 0.0
        expected = whole.inverse_dynamics(p, v, a)[free]
        np.testing.assert_allclose(locked.inverse_dynamics(p[free], v[free], a[free]), expected, rtol=1e-12, atol=1e-12)
        assert [joint.name for joint in locked.primary_joints] == [f"j{j + 1}" for j in free]
        assert load(arm, lock=held).description == locked.description


def test_followers_are_held_with_their_leaders(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(urdf('<mimic joint="j3" multiplier="-0.5" offset="0.3"/>'))
    whole = load(tmp_path / "arm.urdf")
    for held in ({"j3": 0.6}, {"j4": 0.0}):
        locked = whole.locked(held)
        assert (locked.dof, locked.description.loops) == (2, None)
        expected = whole.inverse_dynamics([0.2, 0.1, 0.6], [0.5, -0.4, 0.0], [1.0, 2.0, 0.0])[:2]
        np.testing.assert_allclose(locked.inverse_dynamics([0.2, 0.1], [0.5, -0.4], [1.0, 2.0]), expected, rtol=1e-12)
    kept = whole.locked({"j1": 0.2})
    expected = whole.inverse_dynamics([0.2, 0.1, 0.6], [0.0, -0.4, 0.3], [0.0, 2.0, 1.0])[1:]
    np.testing.assert_allclose(kept.inverse_dynamics([0.1, 0.6], [-0.4, 0.3], [2.0, 1.0]), expected, rtol=1e-12)


def test_joints_of_loops_are_locked_together() -> None:
    whole = load("semi_direct_drive")
    names = [joint.name for joint in whole.primary_joints]
    p = whole.neutral_configuration
    locked = whole.locked({names[0]: float(p[0])})
    v = np.array([0.0, *np.linspace(0.3, 0.5, len(p) - 1)])
    np.testing.assert_allclose(
        locked.inverse_dynamics(p[1:], v[1:], v[1:]), whole.inverse_dynamics(p, v, v)[1:], rtol=1e-9
    )
    with pytest.raises(InputError, match=r"lock: joints? .* in a loop with .*; lock these too"):
        whole.locked({names[1]: float(p[1])})
    passive = next(name for name in whole.description.joint_names if name not in names)
    with pytest.raises(
        InputError, match=f"lock: joint '{passive}' depends on others by a loop; lock those: {names[0]}"
    ):
        whole.locked({passive: 0.0})
    rest = whole.locked(dict(zip(names[1:], p[1:].tolist(), strict=True)))
    assert (rest.dof, rest.description.loops) == (1, None)
    torque = whole.inverse_dynamics(p, [0.5, *np.zeros(len(p) - 1)], [1.0, *np.zeros(len(p) - 1)])[0]
    np.testing.assert_allclose(rest.inverse_dynamics(p[:1], [0.5], [1.0]), [torque], rtol=1e-9)


@pytest.mark.parametrize(
    ("held", "error", "message"),
    [
        ({"j9": 0.0}, NotFoundError, r"lock: arm has no joint 'j9'.*joints: j1, j2, j3, j4"),
        ({"j3": None}, InputError, r"'j3': 0 rad is outside its limits, 0.5 to 3; give .* such as j3=1.75"),
        ({"j2": np.nan}, InputError, r"'j2': expected a finite position in m"),
        ({"j1": 0, "j2": 0, "j3": 1, "j4": 0}, InputError, "all joints of arm are locked; at least one must move"),
        (["j1=x"], InputError, "'j1': expected a position in rad or m, got 'x'"),
        (["j1", "j1=2"], InputError, "'j1' is given twice"),
        ("j1", InputError, "expected joints with their positions, or a list of names, got the text 'j1'"),
    ],
)  # fmt: skip
def test_joints_that_cannot_be_locked_are_told(arm: Path, held: object, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        load(arm).locked(held)  # type: ignore[arg-type]


def test_a_shaft_that_others_turn_is_not_held() -> None:
    whole = random_chain(1, 3)
    drives = [Drive() for _ in range(3)]
    drives[2] = Drive(0.1, turns_with=((whole.links[1].joint.name, 1.0),))
    coupled = whole.with_drives(drives)
    with pytest.raises(InputError, match="turns with other joints too, so that it is not held"):
        coupled.locked([whole.links[2].joint.name])
    held = coupled.locked([whole.links[1].joint.name])
    np.testing.assert_allclose(
        held.inverse_dynamics([0.1, 0.2], [1.0, 2.0], [3.0, 4.0]),
        coupled.inverse_dynamics([0.1, 0.0, 0.2], [1.0, 0.0, 2.0], [3.0, 0.0, 4.0])[[0, 2]],
    )


def test_a_payload_hangs_on_a_link_by_the_name_in_the_urdf(arm: Path) -> None:
    model = pin.buildModelFromUrdf(str(arm))
    place = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.5, -1.0), np.array([0.3, 0.0, 0.05]))
    center = np.array([0.02, 0.01, 0.08])
    inertia = np.array([[0.3, 0.05, 0.02], [0.05, 0.4, -0.03], [0.02, -0.03, 0.25]])
    model.appendBodyToJoint(4, pin.Inertia(1.5, center, inertia), place)
    p, z = np.array([0.1, 0.2, 0.7, -0.4]), np.zeros(4)
    expected = pin.aba(model, model.createData(), p, z, z)
    for held in (load(arm), load(arm).locked({})):
        effects = [PayloadHeld(Payload(1.5, center, inertia), link="tool0")]
        plant = adaptctl.Plant(held, 1e-6, effects=effects)
        found = plant.step(plant.init(p, z), z).v / 1e-6
        np.testing.assert_allclose(found, expected, rtol=1e-5)
    with pytest.raises(NotFoundError, match=r"payload: unknown link 'tool1'; links: a, b, c, d, tool0"):
        adaptctl.Plant(load(arm), 1e-4, effects=[PayloadHeld(1.0, link="tool1")])


def test_links_of_locked_joints_are_frames_where_they_were(arm: Path) -> None:
    whole = load(arm)
    locked = whole.locked({"j4": 0.5, "j1": 0.2})
    frames = {frame.name: frame for frame in locked.description.frames}
    assert set(frames) == {"base", "tool0", "a", "d"}
    assert [frames[name].link for name in ("base", "a", "d", "tool0")] == [-1, -1, 1, 1]
    model = pin.buildModelFromUrdf(str(arm))
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array([0.2, 0.3, 0.6, 0.5]))
    expected = data.oMf[model.getFrameId("tool0")].translation
    tip = Tip(locked, "tool0", np.zeros(3))
    np.testing.assert_allclose(tip.at([0.3, 0.6]), expected, atol=1e-12)


def test_gravity_of_a_tilted_mount_is_that_of_a_turned_base(arm: Path) -> None:
    turned = pin.buildModelFromUrdf(str(arm))
    turned.gravity.linear = np.array([4.905, 0.0, -8.4957])
    p, v, a = np.random.default_rng(1).normal(size=(3, 4))
    found = load(arm, gravity=[4.905, 0.0, -8.4957]).inverse_dynamics(p, v, a)
    np.testing.assert_allclose(found, pin.rnea(turned, turned.createData(), p, v, a), rtol=1e-10)
    assert not load(arm, gravity=(0, 0, 0)).inverse_dynamics(p, 0 * v, 0 * a).any()


def test_every_command_takes_them(arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flags = ["--gravity", "0", "0", "0", "--lock", "j2=0.4", "j3=0.7"]
    assert main(["basis", str(arm), "--json", *flags]) == 0
    held = load(arm, gravity=np.zeros(3), lock=["j2=0.4", "j3=0.7"])
    assert json.loads(capsys.readouterr().out)["robot"]["sha256"] == held.description.sha256
    assert main(["basis", str(arm), "--lock", "j3"]) == 2
    assert "outside its limits" in capsys.readouterr().err
    for command in ("gains", "excite", "tune", "design", "export", "identify", "drive"):
        assert main([command, "--help"]) == 0
        said = capsys.readouterr().out
        assert "--gravity" in said
        assert "--lock" in said


def test_an_identified_arm_with_locked_joints_and_tilted_base_is_written_and_judged(arm: Path, tmp_path: Path) -> None:
    flags = {"gravity": [4.905, 0.0, -8.4957], "lock": ["j2=0.4", "j3=0.7"]}
    held, t = load(arm, **flags), np.arange(1000) / 100.0
    p = np.stack([np.sin(1.3 * t), np.cos(2.1 * t) + 0.3 * np.sin(t)], axis=-1)
    v = np.stack([1.3 * np.cos(1.3 * t), -2.1 * np.sin(2.1 * t) + 0.3 * np.cos(t)], axis=-1)
    a = np.stack([-1.69 * np.sin(1.3 * t), -4.41 * np.cos(2.1 * t) - 0.3 * np.sin(t)], axis=-1)
    rows = np.column_stack([t, p, held.inverse_dynamics(p, v, a) + 2.0 * v])
    names = "time,position.j1,position.j4,torque.j1,torque.j4"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=names, comments="")
    line = ["identify", str(tmp_path / "log.csv"), "--robot", str(arm), "--out", str(tmp_path / "out")]
    line += ["--units", "time=s", "position=rad", "torque=N m", "--friction", "viscous", "--cutoff", "12.5"]
    assert main([*line, "--prior-weight", "1", "--gravity", "4.905", "0", "-8.4957", "--lock", *flags["lock"]]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["validation"]["relative_error"] < 2e-3
    assert summary["files"]["robot.urdf"]["relative_error"] < 0.05
    assert b"the locked joints j2=0.4, j3=0.7" in (tmp_path / "out" / "robot.urdf").read_bytes()
    assert main(line) == 2


def test_joints_that_a_log_has_not_are_offered_to_be_locked(arm: Path, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time,position.j1,position.j4,effort.j1,effort.j4\n" + "0,1,2,3,4\n" * 9)
    units = {"time": "s", "position": "rad", "torque": "N m"}
    with pytest.raises(InputError, match=r"has 2 of 4 joints; if the others did not move: --lock j2 j3$"):
        in_flags(adaptctl.identify)(tmp_path / "log.csv", arm, units=units)


def drives_of(*ratios: list[float]) -> Drives:
    motors = tuple(MotorEntry(name=f"m{i}", position=f"q{i}", torque=f"i{i}") for i in range(1, 5))
    return Drives(("j1", "j2", "j3", "j4"), np.array(ratios), np.array([0.1, 0.2, 0.3, 0.4]), motors, "time", UNITS)


UNITS = Units(1.0, 1.0, 1.0)


def test_drives_of_locked_joints_are_left_out(arm: Path) -> None:
    drives = drives_of([10, 0, 2, 0], [0, 20, 0, 0], [0, 0, 30, 0], [1, 0, 0, -40])
    held = drives.ordered_like(load(arm, lock=["j3=0.7"]))
    joints = np.array([0.3, -0.2, 0.7, 0.5])
    motors = drives.transmission @ (joints - drives.offsets)
    np.testing.assert_allclose(held.position(motors[[0, 1, 3]]), joints[[0, 1, 3]])
    np.testing.assert_allclose(held.torque([1.0, 2.0, 3.0]), drives.torque([1.0, 2.0, 0.0, 3.0])[[0, 1, 3]])
    with pytest.raises(InputError, match="the motors of j1 turn with other joints too"):
        drives.ordered_like(load(arm, lock=["j1"]))
    with pytest.raises(InputError, match=r"but arm has j1, j2, j3, j4; if the others did not move: --lock j4$"):
        replace(
            drives, joints=drives.joints[:3], transmission=np.eye(3), offsets=np.zeros(3), motors=drives.motors[:3]
        ).ordered_like(load(arm))


def test_gravity_is_added_to_compensated_torques(arm: Path) -> None:
    robot, rng = load(arm), np.random.default_rng(0)
    p, v, a = rng.uniform(0.5, 1.0, size=(3, 50, 4))
    weightless = load(arm, gravity=np.zeros(3))
    log = JointLog("run.csv", np.arange(50.0), p, weightless.inverse_dynamics(p, v, a))
    known = drives_of(*np.eye(4).tolist())
    found = with_own_gravity(log, robot, known)
    np.testing.assert_allclose(found.torque, robot.inverse_dynamics(p, v, a), rtol=1e-10, atol=1e-10)
    assert "added to 50 rows" in found.notes[0]
    with pytest.raises(FileError, match="hold the robot's own compensation; leave out --compensated"):
        validate_not_added(LogTable("run.parquet", {"flag.compensation.j1": np.ones(3)}))
    motors = tuple(
        MotorEntry(name=m.name, position=m.position, torque=m.torque, torque_constant="unknown") for m in known.motors
    )
    with pytest.raises(InputError, match="expected known torque constants"):
        with_own_gravity(log, robot, replace(known, motors=motors))


def test_what_is_said_of_locked_joints_is_a_copy() -> None:
    given = {"elbow": 0.5}
    arm = replace(load("two_link").description, locked=given)
    given["wrist"] = 1.0
    assert arm.locked == {"elbow": 0.5}
