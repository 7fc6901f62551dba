"""MJCF files that cannot be read: each refused with the element and what would be right."""

from __future__ import annotations

from pathlib import Path

import pytest
from mjcf_files import BODY, CLOSED, MOTOR, chain, linkage, mjcf, reading

from adaptctl.description import read_mjcf
from adaptctl.dynamics import load
from adaptctl.errors import FileError, LoopError
from adaptctl.files import MAX_BYTES

LAUGHS = '<!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
ONE = mjcf(chain())
EQUAL = CLOSED["connect"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"not well-formed XML \(no element found"),
        (ONE.replace("</mujoco>", ""), r"not well-formed XML \(no element found"),
        (LAUGHS + ONE, "<!DOCTYPE ...> and entities are not supported"),
        (ONE.replace('"some"', '"&b;"'), r"not well-formed XML \(undefined entity"),
        (ONE.replace("mujoco", "robot"), "the root element must be <mujoco>, got <robot>"),
        (ONE.replace("<worldbody>", '<include file="x.xml"/><worldbody>'), "<include> of 'x.xml': .*no such file"),
        (ONE.replace("worldbody", "wordbody"), "<wordbody> is not supported; supported: compiler, option"),
        ("<mujoco/>", "no moving joint: expected a hinge or a slide"),
        (mjcf(f'<body name="a">{BODY}</body>'), "no moving joint: expected a hinge or a slide"),
        (mjcf("<joint/>"), "<joint>: MuJoCo: World body cannot have joints"),
        (
            mjcf(chain() + chain().replace('"a"', '"z"').replace('"b"', '"y"').replace('"j', '"k')),
            "2 root bodies move, 'a', 'z', each a separate mechanism; select one, .* root='a'",
        ),
        (
            mjcf(chain('type="ball"/><joint name="own"')),
            "body 'a': a ball joint must be the last joint of its body, and the only one",
        ),
        (mjcf(chain('type="screw"')), "joint 'j1': MuJoCo: invalid keyword: 'screw'"),
        (mjcf(chain('axsi="x"')), "joint 'j1': MuJoCo: unrecognized attribute: 'axsi'"),
        (mjcf(chain().replace('"0 1 0"', '"0 0 0"')), "joint 'j1': MuJoCo: axis too small in joint"),
        (
            mjcf(chain().replace('"0 1 0"', '"0 1"')),
            "joint 'j1': axis of <joint>: expected 3 finite numbers, got '0 1'",
        ),
        (mjcf(chain('pos="0 0 nan"')), "joint 'j1': pos of <joint>: expected 3 finite numbers, got '0 0 nan'"),
        (mjcf(chain('range="1 -1"')), "joint 'j1': range: expected lower < upper, got 1 and -1"),
        (mjcf(chain('limited="true"')), r"joint 'j1': MuJoCo: range\[0\] should be smaller than range\[1\]"),
        (
            mjcf(chain('armature="-1"')),
            r"joint 'j1': rotor_inertia: expected a finite number of at least 0 and at most 1e.20, got -1\.0",
        ),
        (mjcf(chain('damping="1 2"')), "joint 'j1': damping: only the first coefficient is supported"),
        (mjcf(chain().replace('"j2"', '"j1"')), "joint 'j1': MuJoCo: repeated name 'j1' in joint"),
        (mjcf(chain().replace('"b"', '"a"')), "body 'a': MuJoCo: repeated name 'a' in body"),
        (mjcf(chain().replace('"b"', '"world"')), "body 'world': MuJoCo: repeated name 'world' in body"),
        (mjcf(chain().replace('name="b"', 'nmae="b"')), "body 'body3': MuJoCo: unrecognized attribute: 'nmae'"),
        (
            mjcf(chain().replace('name="b"', 'name="b" mocap="true"')),
            "body 'b': MuJoCo: mocap body 'b' is not",
        ),
        (
            mjcf(chain().replace("quat", 'euler="1 2 3" quat')),
            "body 'b': MuJoCo: multiple orientation specifiers",
        ),
        (mjcf(chain().replace('"1 2 3 4"', '"0 0 0 0"')), "body 'b': MuJoCo: zero quaternion is not allowed"),
        (
            mjcf(chain().replace('quat="1 2 3 4"', 'quat="1 2 3"')),
            "body 'b': quat of <body>: expected 4 finite numbers",
        ),
        (
            mjcf(chain(more="<composite/>")),
            "body 'a': <composite> is not supported; supported: body, frame, replicate, joint",
        ),
        (
            mjcf(chain(more='<attach model="x" prefix="y"/>')),
            "body 'a': <attach> is not supported; supported: body, frame",
        ),
        (
            mjcf(chain(inertia1="<inertial mass='1' diaginertia='1 1 1'/>")),
            "<inertial>: MuJoCo: required attribute missing: 'pos'",
        ),
        (
            mjcf(chain(inertia1="<inertial pos='0 0 0' diaginertia='1 1 1'/>")),
            "<inertial>: MuJoCo: required attribute missing: 'mass'",
        ),
        (
            mjcf(chain(inertia1="<inertial pos='0 0 0' mass='1'/>")),
            "body 'a': MuJoCo: mass and inertia of moving bodies must be larger",
        ),
        (mjcf(chain(inertia1=BODY.replace('"1"', '"-1"'))), r"<inertial>: mass must not be negative, got -1\.0"),
        (mjcf(chain(inertia1=BODY + BODY)), "body 'a': MuJoCo: unique element 'inertial' found 2 times"),
        (
            mjcf(chain(inertia1=f'<frame pos="1 0 0">{BODY}</frame>')),
            "<frame>: <inertial> is not supported; supported: body, frame",
        ),
        (
            mjcf(chain(inertia1='<geom name="g" type="mesh" mesh="m"/>')),
            "geom 'g': unknown mesh 'm', which its inertia depends on",
        ),
        (mjcf(chain(inertia1="<geom/>")), "<geom>: MuJoCo: size 0 must be positive in geom"),
        (
            mjcf(chain(inertia1='<geom type="box" size=".1"/>')),
            "<geom>: MuJoCo: size 1 must be positive in geom",
        ),
        (
            mjcf(chain(inertia1='<geom type="capsule" size=".1" fromto="0 0 0 0 0 0"/>')),
            "<geom>: MuJoCo: fromto points too close in geom",
        ),
        (
            mjcf(chain(inertia1='<geom size=".1" fromto="0 0 0 0 0 1"/>')),
            "<geom>: MuJoCo: fromto requires capsule",
        ),
        (mjcf(chain(inertia1='<geom class="x" size=".1"/>')), "<geom>: MuJoCo: unknown default class name 'x'"),
        (
            mjcf(chain(), before="<default><default/></default>"),
            "<default>: MuJoCo: empty class name",
        ),
        (
            mjcf(chain(), before='<compiler angle="grad"/>'),
            "<compiler>: MuJoCo: invalid keyword: 'grad'",
        ),
        (
            mjcf(chain(), before='<compiler eulerseq="xyw"/>'),
            "<compiler>: eulerseq: expected three of x, y, z, X, Y, Z",
        ),
        (
            mjcf(chain(), before='<compiler coordinate="global"/>'),
            "<compiler>: coordinate: expected 'local', as in MuJoCo",
        ),
        (mjcf(chain(), before='<option gravity="0 0 -1e18"/>'), "some: gravity: expected at most 1e.09"),
        (
            mjcf(chain(), before='<compiler settotalmass="1"/>'),
            "<compiler>: settotalmass: not supported: scale the masses",
        ),
        (
            mjcf(chain(), before='<compiler boundmass="1"/>'),
            "<compiler>: boundmass: not supported; write the final masses",
        ),
        (mjcf(chain(), before='<compiler balanceinertia="true"/>'), "<compiler>: balanceinertia: not supported; write"),
        (
            mjcf(chain(), before='<option gravity="0 0"/>'),
            "<option>: MuJoCo: attribute 'gravity' does not have",
        ),
        (
            linkage(EQUAL.replace('"rod"', '"rot"')),
            "connect 'pin': MuJoCo: unknown element 'rot' in equality",
        ),
        (linkage(EQUAL.replace(' body1="rod"', "")), "connect 'pin': MuJoCo: one of .*body1.* must be specified"),
        (linkage(EQUAL.replace('anchor=".55 0 .2"', "")), "connect 'pin': MuJoCo: one of .*anchor.* must be specified"),
        (
            linkage('<connect name="pin" site1="tip" site2="top"/>'),
            "connect 'pin': MuJoCo: unknown element 'top' in equality",
        ),
        (
            linkage('<weld body1="rod" body2="pad"/>'),
            "equality 'weld1': both ends are on the same rigid body, rod; remove it",
        ),
        (
            linkage('<weld body1="base"/>'),
            "equality 'weld1': both ends are on the same rigid body, the world; remove it",
        ),
        (
            linkage('<tendon name="t" tendon1="x"/>'),
            "equality 't': <tendon> is not supported; supported: con",
        ),
        (
            linkage('<glue body1="rod"/>'),
            "equality 'glue1': <glue> is unknown; supported: connect, weld, j",
        ),
        (
            linkage('<joint joint1="rod"/>'),
            "equality 'joint1': fixes joint 'rod'; remove the joint, or give joi",
        ),
        (
            linkage('<joint joint1="rod" joint2="rad"/>'),
            "<joint>: MuJoCo: unknown element 'rad' in equality",
        ),
        (linkage('<joint joint1="rod" joint2="rod"/>'), "<joint>: MuJoCo: element 'rod' is repeated in equality"),
        (
            linkage('<joint joint1="rod" joint2="crank" polycoef="0 1 2"/>'),
            "equality 'joint1': polycoef: expected a linear relation",
        ),
        (
            linkage('<joint joint1="rod" joint2="rocker"/><joint joint1="rocker" joint2="rod"/>'),
            "coupling 'joint1': joint 'rod' follows 'rocker', but its leaders follow in a ring",
        ),
        (
            linkage(EQUAL, actuator=MOTOR.replace("crank", "handle")),
            "<motor>: MuJoCo: unknown transmission target 'handle'",
        ),
    ],
)
def test_wrong_files(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=r"robot\.xml: " + message):
        reading(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            linkage(EQUAL, MOTOR.replace("</", '<motor joint="rod"/></')),
            "2 joints are primary, but the loops have only 1 degrees",
        ),
        (
            linkage('<connect name="pin" site1="tip" site2="far"/>').replace(
                '<site name="end"', '<site name="far" pos="9 0 0"/><site name="end"'
            ),
            "closure 'pin' cannot close at the reference configuration",
        ),
    ],
)
def test_loops_that_cannot_be_are_refused_when_loaded(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "robot.xml").write_text(text)
    with pytest.raises(LoopError, match=r"robot\.xml: some: " + message):
        load(tmp_path / "robot.xml")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "robot.xml"
    with pytest.raises(FileError, match=r"robot\.xml: cannot be read \(no such file or directory\)"):
        read_mjcf(path)
    path.write_bytes(b" " * (MAX_BYTES + 1))
    with pytest.raises(FileError, match=r"robot\.xml: larger than"):
        read_mjcf(path)


def test_deep_nesting_is_no_trouble(tmp_path: Path) -> None:
    deep = 250
    text = "".join(f'<body><joint name="j{i}"/>{BODY}' for i in range(deep)) + "</body>" * deep
    assert len(reading(tmp_path, mjcf(text)).links) == deep
