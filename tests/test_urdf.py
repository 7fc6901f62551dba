"""URDF: real robots against Pinocchio's own reader, and every wrong file."""

from __future__ import annotations

import math
import re
import warnings
from importlib.metadata import files
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from nightly import mostly_at_night
from robot_files import urdf

from adaptctl.description import Description, JointKind, Limits, from_pinocchio, read_urdf, to_pinocchio
from adaptctl.description.drive import Drive
from adaptctl.errors import FileError, SimplificationWarning
from adaptctl.files import MAX_BYTES

MOTIONLESS = ("quadrotor_base.urdf", "iris_simple.urdf", "ur3.urdf")
ROBOTS = sorted(Path(str(f.locate())) for f in files("example-robot-data") or () if f.suffix == ".urdf")
MOVING = [path for path in ROBOTS if path.name not in MOTIONLESS]

BODY = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
LINKS = f'<link name="base"/><link name="arm">{BODY}</link>'
ENDS = '<parent link="base"/><child link="arm"/>'
JOINT = f'<joint name="hinge" type="revolute">{ENDS}<axis xyz="0 1 0"/></joint>'
ROBOT = f'<robot name="one">{LINKS}{JOINT}</robot>'
BELOW = """<link name="loose"/><joint name="below" type="KIND"><parent link="arm"/><child link="loose"/></joint>"""


def reading(folder: Path, text: str) -> Description:
    (folder / "robot.urdf").write_text(text)
    return read_urdf(folder / "robot.urdf")


def pinocchio_torques(
    model: pinocchio.Model, names: list[str], q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> np.ndarray:
    """Inverse dynamics of the model, its joints taken by name; unbounded ones have cosine and sine in its q."""
    state = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
    joints = [model.joints[model.getJointId(name)] for name in names]
    for joint, *numbers in zip(joints, q, v, a, strict=True):
        angle = numbers[0]
        state[0][joint.idx_q : joint.idx_q + joint.nq] = angle if joint.nq == 1 else (math.cos(angle), math.sin(angle))
        state[1][joint.idx_v], state[2][joint.idx_v] = numbers[1:]
    return pinocchio.rnea(model, model.createData(), *state)[[joint.idx_v for joint in joints]]


def same_torques(description: Description, model: pinocchio.Model) -> None:
    names, ours = [link.joint.name for link in description.links], to_pinocchio(description)
    assert sorted(names) == sorted(list(model.names)[1:])
    rng = np.random.default_rng(0)
    for q, v, a in rng.uniform(-2, 2, (3, 3, len(names))):
        expected = pinocchio_torques(model, names, q, v, a)
        torque = pinocchio.rnea(ours, ours.createData(), q, v, a)
        assert np.abs(torque - expected).max() <= 1e-12 * max(1.0, np.abs(expected).max())


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.parametrize(
    "path", mostly_at_night(MOVING, *MOVING[::3]), ids=lambda path: f"{path.parent.parent.name}/{path.stem}"
)
def test_real_robots_have_pinocchios_torques(path: Path) -> None:
    model, description = pinocchio.buildModelFromUrdf(str(path)), read_urdf(path)
    same_torques(description, model)
    same_torques(from_pinocchio(model), model)


def test_the_robots_that_matter_most_are_among_them() -> None:
    assert {"ur5_robot", "panda", "talos_full_v2", "talos_reduced"} <= {path.stem for path in MOVING}
    assert len(MOVING) > 50


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.parametrize("name", MOTIONLESS)
def test_real_robots_without_joints_that_move_are_refused(name: str) -> None:
    with pytest.raises(FileError, match=f"{name}: (no moving joint|no <link> elements)"):
        read_urdf(urdf(name))


def test_right_angles_of_a_real_arm_are_exact() -> None:
    """Eleven digits of pi leave 5e-12; the UR5 has full ones, and none of its twists is off by a rounding."""
    for link in read_urdf(urdf("ur5_robot.urdf")).links:
        near = np.abs(link.parent_to_joint.rotation)
        assert np.all((near == 0) | (near == 1) | ((near > 1e-12) & (near < 1 - 1e-12)))


def test_panda_as_the_file_has_it() -> None:
    panda = read_urdf(urdf("panda.urdf"))
    assert panda.name == "panda"
    assert panda.links[0].name == "panda_link1"
    assert panda.links[0].joint.limits == Limits(-2.8973, 2.8973, 2.175, 87.0)
    assert [link.joint.kind for link in panda.links].count(JointKind.PRISMATIC) == 2
    assert panda.loops is not None
    assert panda.loops.primary == panda.joint_names[:-1]
    (coupling,) = panda.loops.couplings
    assert (coupling.follower, coupling.leader) == ("panda_finger_joint2", "panda_finger_joint1")
    assert (coupling.ratio, coupling.offset) == (1.0, 0.0)


def test_a_small_robot(tmp_path: Path) -> None:
    one = reading(tmp_path, ROBOT)
    link = one.links[0]
    assert (one.name, link.name, link.joint.name, link.parent) == ("one", "arm", "hinge", -1)
    np.testing.assert_array_equal(link.joint.axis, [0, 1, 0])
    np.testing.assert_array_equal(link.inertia, [2, 0, 0, 0, 1, 0, 1, 0, 0, 1])
    assert link.joint.limits == Limits()
    assert one.source == "URDF file robot.urdf"


def test_friction_is_the_joints_drive(tmp_path: Path) -> None:
    """What is zero is not modelled: exporters write zeros when nobody knows."""
    for attributes, drive in {
        'damping="0.7" friction="0.2"': Drive(viscous=0.7, coulomb=0.2),
        'damping="0" friction="0.0"': Drive(),
        'friction="3"': Drive(coulomb=3.0),
        "": Drive(),
    }.items():
        text = ROBOT.replace("</joint>", f"<dynamics {attributes}/></joint>")
        assert reading(tmp_path, text).links[0].joint.drive == drive
    assert reading(tmp_path, ROBOT).parameter_names == reading(tmp_path, text).parameter_names


def test_what_may_be_left_out(tmp_path: Path) -> None:
    text = f'<robot><link name="base"/><link name="arm"/><joint name="j" type="continuous">{ENDS}</joint></robot>'
    robot = reading(tmp_path, text)
    assert robot.name == "robot"
    np.testing.assert_array_equal(robot.links[0].joint.axis, [1, 0, 0])
    np.testing.assert_array_equal(robot.inertial_parameters, np.zeros(10))


def tree(joints: list[tuple[str, str, str, str]]) -> str:
    """Joints (name, type, parent, child), each at an odd place, every link with a body."""
    links = {end: None for _, _, parent, child in joints for end in (parent, child)}
    place = '<origin xyz="0.1 -0.2 0.3" rpy="0.4 0.5 -0.6"/>'
    bodies = "".join(f'<link name="{name}">{BODY.replace("<mass", place + "<mass")}</link>' for name in links)
    edges = "".join(
        f'<joint name="{name}" type="{kind}">{place}<parent link="{parent}"/><child link="{child}"/>'
        '<axis xyz="1 2 -2"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for name, kind, parent, child in joints
    )
    return f'<robot name="tree">{bodies}{edges}</robot>'


def test_links_behind_fixed_joints_are_carried(tmp_path: Path) -> None:
    text = tree(
        [
            ("late", "revolute", "tool", "finger"),
            ("f0", "fixed", "world", "stand"),
            ("j1", "revolute", "stand", "arm"),
            ("f1", "fixed", "arm", "flange"),
            ("f2", "fixed", "flange", "tool"),
            ("j2", "prismatic", "arm", "slide"),
            ("j3", "continuous", "tool", "spinner"),
            ("side", "revolute", "world", "lamp"),
        ]
    )
    description = reading(tmp_path, text)
    parents = {k.name: description.links[k.parent].name if k.parent >= 0 else None for k in description.links}
    assert parents == {"arm": None, "finger": "arm", "spinner": "arm", "slide": "arm", "lamp": None}
    same_torques(description, pinocchio.buildModelFromXML(text))


def limit(text: str, kind: str = "revolute") -> str:
    joint = f'<joint name="hinge" type="{kind}">{ENDS}<limit {text}/></joint>'
    return f'<robot name="one">{LINKS}{joint}</robot>'


@pytest.mark.parametrize(
    ("text", "kind", "expected"),
    [
        ('lower="-1" upper="2" velocity="3" effort="4"', "revolute", Limits(-1, 2, 3, 4)),
        ('lower="-1" upper="2"', "prismatic", Limits(-1, 2)),
        ('upper="2"', "revolute", Limits(0, 2)),
        ('velocity="3" effort="4"', "revolute", Limits(velocity=3, effort=4)),
        ('lower="-1" upper="2" velocity="3"', "continuous", Limits(velocity=3)),
    ],
)
def test_limits(tmp_path: Path, text: str, kind: str, expected: Limits) -> None:
    assert reading(tmp_path, limit(text, kind)).links[0].joint.limits == expected


@pytest.mark.parametrize(
    ("text", "zeros"),
    [
        ('lower="0" upper="0" velocity="0" effort="0"', "lower = upper = 0, velocity 0, effort 0"),
        ('lower="0.0" upper="0"', "lower = upper = 0"),
        ('velocity="0"', "velocity 0"),
        ('effort="0"', "effort 0"),
    ],
)
def test_limits_of_zero_are_no_limits_but_said(tmp_path: Path, text: str, zeros: str) -> None:
    words = rf"robot\.urdf: limits of zero are read as no limits: hinge \({zeros}\)"
    with pytest.warns(SimplificationWarning, match=words):
        robot = reading(tmp_path, limit(text))
    assert robot.links[0].joint.limits == Limits()


TWO = (
    f'<robot name="two">{LINKS}<link name="hand"/>{JOINT}<joint name="wrist" type="revolute"><parent link="arm"/>'
    '<child link="hand"/><axis xyz="0 0 1"/><mimic joint="hinge" multiplier="-2" offset="0.5"/></joint></robot>'
)


def test_a_mimic_joint_follows_its_leader(tmp_path: Path) -> None:
    loops = reading(tmp_path, TWO).loops
    assert loops is not None
    assert loops.primary == ("hinge",)
    (coupling,) = loops.couplings
    assert (coupling.follower, coupling.leader, coupling.ratio, coupling.offset) == ("wrist", "hinge", -2.0, 0.5)


def test_a_mimic_joint_of_a_mimic_joint_follows_the_first_leader(tmp_path: Path) -> None:
    tip = (
        '<link name="tip"/><joint name="nail" type="revolute"><parent link="hand"/><child link="tip"/>'
        '<axis xyz="0 0 1"/><mimic joint="wrist" multiplier="3" offset="-1"/></joint></robot>'
    )
    loops = reading(tmp_path, TWO.replace("</robot>", tip)).loops
    assert loops is not None
    assert loops.primary == ("hinge",)
    found = [(c.follower, c.leader, c.ratio, c.offset) for c in loops.couplings]
    assert found == [("wrist", "hinge", -2.0, 0.5), ("nail", "hinge", -6.0, 0.5)]


@pytest.mark.parametrize(
    "text", [TWO.replace('mimic joint="hinge"', 'mimic joint="other"'), TWO.replace("revolute", "fixed", 1)]
)
def test_mimic_joints_without_a_moving_leader_are_independent_but_said(tmp_path: Path, text: str) -> None:
    wanted = r"robot\.urdf: mimic joints whose leader does not move are read as independent: wrist"
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        robot = reading(tmp_path, text)
    assert any(re.search(wanted, str(warning.message)) for warning in said)
    assert robot.loops is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            TWO.replace("<axis", '<mimic joint="wrist"/><axis', 1),
            "coupling 'hinge mimics wrist': joint 'hinge' follows 'wrist', but its leaders follow in a ring",
        ),
        (TWO.replace('"hinge" multiplier', '"wrist" multiplier'), "joint 'wrist': <mimic>: .* cannot follow itself"),
        (TWO.replace('"-2"', '"0"'), r"joint 'wrist': <mimic>: .* expected a finite ratio other than zero"),
        (TWO.replace('"-2"', '"twice"'), "joint 'wrist': multiplier of <mimic>: expected a finite number, got 'twice'"),
        (TWO.replace('mimic joint="hinge"', "mimic"), "joint 'wrist': <mimic> needs the attribute joint"),
    ],
)
def test_wrong_mimic_joints(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=r"robot\.urdf: " + message):
        reading(tmp_path, text)


def test_an_ordinary_file_raises_no_warning(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reading(tmp_path, ROBOT)
        read_urdf(urdf("ur5_robot.urdf"))


def second(joint: str, link: str = "") -> str:
    return ROBOT.replace("</robot>", link + joint + "</robot>")


def edge(name: str, parent: str, child: str) -> str:
    return f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint>'


LAUGHS = '<!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
OUTSIDE = '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/hostname">]>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"not well-formed XML \(no element found"),
        ("hello", r"not well-formed XML \(syntax error: line 1"),
        (ROBOT.replace("</robot>", ""), r"not well-formed XML \(no element found: line 1"),
        (ROBOT.replace("robot", "mujoco"), "the root element must be <robot>, got <mujoco>"),
        (LAUGHS + ROBOT.replace('"one"', '"&b;"'), "<!DOCTYPE ...> and entities are not supported"),
        (OUTSIDE + ROBOT.replace('"one"', '"&a;"'), "<!DOCTYPE ...> and entities are not supported"),
        (ROBOT.replace('"one"', '"&b;"'), r"not well-formed XML \(undefined entity"),
        (
            '<robot xmlns:xacro="http://ros.org/x/xacro"><xacro:arm/></robot>',
            "contains xacro macros; expand them first",
        ),
        ("<robot/>", "no <link> elements"),
        ('<robot><link name="a"/></robot>', "no moving joint: expected a revolute, continuous or prismatic joint"),
        (ROBOT.replace("revolute", "fixed"), "no moving joint"),
        (
            ROBOT.replace("</robot>", BELOW.replace("KIND", "floating") + "</robot>"),
            "joint 'below': type 'floating' is only for a base; build it from revolute",
        ),
        (
            ROBOT.replace("</robot>", BELOW.replace("KIND", "planar") + "</robot>"),
            "joint 'below': type",
        ),
        (ROBOT.replace("revolute", "floating"), r"no moving joint: .*; the base 'base' is held still, and floats with"),
        (
            ROBOT.replace("revolute", "hinge"),
            "joint 'hinge': unknown type 'hinge'; expected one of revolute, continuous",
        ),
        (ROBOT.replace(' type="revolute"', ""), "joint 'hinge': <joint> needs the attribute type"),
        (
            ROBOT.replace('parent link="base"', 'parent link="bse"'),
            "joint 'hinge': its parent link 'bse' does not exist",
        ),
        (ROBOT.replace('child link="arm"', 'child link="am"'), "joint 'hinge': its child link 'am' does not exist"),
        (ROBOT.replace('<parent link="base"/>', ""), "joint 'hinge': <joint> needs an element <parent>"),
        (ROBOT.replace('<child link="arm"/>', "<child/>"), "joint 'hinge': <child> needs the attribute link"),
        (second('<link name="lost"/>'), "more than one root link, 'base', 'lost'; connect all but one"),
        (second(edge("back", "arm", "base")), "links in a cycle: 'arm', 'base'"),
        (second(edge("self", "x", "x"), '<link name="x"/>'), "links in a cycle: 'x'"),
        (
            second(edge("again", "base", "arm")),
            "link 'arm' is the child of two joints, 'hinge' and 'again': URDF does not allow loops",
        ),
        (second('<link name="arm"/>'), "two <link> elements are named 'arm'"),
        (second(edge("hinge", "arm", "x"), '<link name="x"/>'), "two <joint> elements are named 'hinge'"),
        (ROBOT.replace('<link name="base"/>', "<link/>"), "<link> number 1 has no name"),
        (ROBOT.replace(' name="hinge"', ""), "<joint> number 1 has no name"),
        (ROBOT.replace("0 1 0", "0 0 0"), "joint 'hinge': axis: expected a vector other than zero"),
        (ROBOT.replace("0 1 0", "0 1"), "joint 'hinge': xyz of <axis>: expected 3 finite numbers, got '0 1'"),
        (ROBOT.replace("0 1 0", "0 nan 0"), "joint 'hinge': xyz of <axis>: expected 3 finite numbers, got '0 nan 0'"),
        (ROBOT.replace('mass value="2"', 'mass value="-2"'), r"link 'arm': mass must not be negative, got -2\.0"),
        (
            ROBOT.replace('mass value="2"', 'mass value="2 kg"'),
            "link 'arm': value of <mass>: expected a finite number, got",
        ),
        (
            ROBOT.replace('mass value="2"', f'mass value="{"9" * 400}"'),
            r"link 'arm': value of <mass>: expected a finite number, got '9{30,40}\.\.\.9{30,40}'",
        ),
        (
            ROBOT.replace('mass value="2"', 'mass value="inf"'),
            "link 'arm': value of <mass>: expected a finite number, got",
        ),
        (
            ROBOT.replace('mass value="2"', 'mass value="1_0"'),
            "link 'arm': value of <mass>: expected a finite number, got",
        ),
        (ROBOT.replace('mass value="2"', "mass"), "link 'arm': <mass> needs the attribute value"),
        (ROBOT.replace('<mass value="2"/>', ""), "link 'arm': <inertial> needs an element <mass>"),
        (
            ROBOT.replace('ixy="0"', 'ixy="x"'),
            r"link 'arm': ixy of <inertia>: expected a finite number, got 'x'",
        ),
        (ROBOT.replace('ixy="0" ', ""), "link 'arm': <inertia> needs the attribute ixy"),
        (ROBOT.replace(BODY, BODY * 2), "link 'arm': <link> has 2 elements <inertial>, expected one"),
        (ROBOT.replace("<axis", '<origin xyz="0 0 x"/><axis'), "joint 'hinge': xyz of <origin>: expected 3 finite"),
        (ROBOT.replace("<axis", '<origin rpy="0 inf 0"/><axis'), "joint 'hinge': rpy of <origin>: expected 3 finite"),
        (
            ROBOT.replace("<axis", '<origin quat_xyzw="0 0 0 1" rpy="0 0 0"/><axis'),
            "joint 'hinge': <origin> has rpy and quat_xyzw; give one of them",
        ),
        (
            ROBOT.replace("<axis", '<origin quat_xyzw="0 0 0 0"/><axis'),
            "joint 'hinge': quat_xyzw of <origin> must not be zero",
        ),
        (limit('lower="1" upper="-1"'), r"joint 'hinge': position limits: expected lower < upper, got 1\.0 and -1\.0"),
        (limit('lower="1" upper="1"'), "joint 'hinge': position limits: expected lower < upper"),
        (limit('lower="-1" upper="1" effort="many"'), "joint 'hinge': effort of <limit>: expected a finite number"),
    ],
)
def test_wrong_files(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=r"robot\.urdf: " + message):
        reading(tmp_path, text)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    with pytest.raises(FileError, match=r"robot\.urdf: cannot be read \(no such file or directory\)"):
        read_urdf(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(FileError, match=r"robot\.urdf: byte 0 is not UTF-8"):
        read_urdf(path)
    path.write_bytes(b" " * (MAX_BYTES + 1))
    with pytest.raises(FileError, match=r"robot\.urdf: larger than"):
        read_urdf(path)


def test_a_long_chain_is_no_trouble(tmp_path: Path) -> None:
    joints = [(f"j{i}", "revolute" if i % 4 == 0 else "fixed", f"l{i}", f"l{i + 1}") for i in range(1000)]
    assert len(reading(tmp_path, tree(joints)).links) == 250


@pytest.mark.parametrize("given", ['velocity="-1" effort="-1"', 'velocity="-1" effort="7"', 'effort="-1e-3"'])
def test_negative_limits_are_none_but_said(tmp_path: Path, given: str) -> None:
    """A habit of some files, as by Pinocchio, which keeps the numbers."""
    words = "negative limits of effort or velocity are read as none: hinge"
    with pytest.warns(SimplificationWarning) as said:
        limits = reading(tmp_path, limit(f'lower="-1" upper="1" {given}')).links[0].joint.limits
    assert [str(one.message) for one in said] == [f"{tmp_path / 'robot.urdf'}: {words}"]
    assert (limits.velocity, limits.effort) == (np.inf, 7.0 if "7" in given else np.inf)
    model = pinocchio.buildModelFromXML(limit('lower="-1" upper="1" velocity="1" effort="1"'))
    model.velocityLimit[0] = model.effortLimit[0] = -1.0
    with pytest.warns(SimplificationWarning, match=words):
        own = from_pinocchio(model).links[0].joint.limits
    assert (own.velocity, own.effort) == (np.inf, np.inf)


def arm(upper: str = BODY, elbow: str = "0.4 0 0", origin: str = "", more: str = "") -> str:
    """Two joints with limits, of which an end may be left out or moved."""
    bound = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
    hand = BODY.replace("<mass", f"{origin}<mass")
    return (
        f'<robot name="arm"><link name="base"/><link name="upper">{upper}</link><link name="hand">{hand}</link>'
        f'<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>{bound}</joint>'
        f'<joint name="elbow" type="revolute"><parent link="upper"/><child link="hand"/><origin xyz="{elbow}"/>'
        f"{more or bound}</joint></robot>"
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (arm(upper=""), "<inertial> are taken as massless.*: upper$"),
        (arm(more="<dynamics/>"), "without <limit>.*: elbow$"),
        (arm(elbow="400 0 0"), "millimetres: origin of joint 'elbow' at 400 m$"),
        (arm(origin='<origin xyz="0 0 -150"/>'), "millimetres: origin of link 'hand' at 150 m$"),
        (
            arm(more='<limit lower="-1" upper="1"/><mimic joint="sholder"/>'),
            r"independent: elbow, of unknown leader 'sholder' \(did you mean 'shoulder'\?\)$",
        ),
    ],
)
def test_what_a_file_hardly_means_is_said(tmp_path: Path, text: str, words: str) -> None:
    with pytest.warns(SimplificationWarning, match=words) as said:
        reading(tmp_path, text)
    assert len(said) == 1


def test_bodies_within_a_joint_of_several_axes_may_be_massless(tmp_path: Path) -> None:
    """Nor does a file of one kind of joints without any limits say more than that it has none."""
    assert len(reading(tmp_path, arm(upper="", elbow="0 0 0")).links) == 2
    assert len(reading(tmp_path, TWO.replace("<mimic", "<unread").replace('<link name="hand"/>', HAND)).links) == 2


HAND = f'<link name="hand">{BODY}</link>'
