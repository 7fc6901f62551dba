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
        (LAUGHS + ONE, "a <!DOCTYPE .* has no place here, and entities are refused"),
        (ONE.replace('"some"', '"&b;"'), r"not well-formed XML \(undefined entity"),
        (ONE.replace("mujoco", "robot"), "the root element must be <mujoco>, got <robot>"),
        (ONE.replace("<worldbody>", '<include file="x.xml"/><worldbody>'), "<include> of 'x.xml': .*no such file"),
        (ONE.replace("worldbody", "wordbody"), "<wordbody> is not read; sections that are: compiler, option"),
        ("<mujoco/>", "no joint moves: expected a hinge or a slide"),
        (mjcf(f'<body name="a">{BODY}</body>'), "no joint moves: expected a hinge or a slide"),
        (mjcf("<joint/>"), "<worldbody>: the world has no joint and no inertia"),
        (
            mjcf(chain() + chain().replace('"a"', '"z"').replace('"b"', '"y"').replace('"j', '"k')),
            "more than one root body moves, 'a' and 'z': each is a mechanism of its own",
        ),
        (mjcf(chain('type="ball"')), "joint 'j1': type 'ball' is not read: build it of hinges"),
        (mjcf(chain('type="screw"')), "joint 'j1': unknown type 'screw'; expected one of hinge, slide"),
        (mjcf(chain('axsi="1 0 0"')), "joint 'j1': unknown attribute 'axsi'; expected one of name, class, type"),
        (mjcf(chain().replace('"0 1 0"', '"0 0 0"')), "joint 'j1': axis must not be zero"),
        (
            mjcf(chain().replace('"0 1 0"', '"0 1"')),
            "joint 'j1': axis of <joint>: expected 3 finite numbers, got '0 1'",
        ),
        (mjcf(chain('pos="0 0 nan"')), "joint 'j1': pos of <joint>: expected 3 finite numbers, got '0 0 nan'"),
        (mjcf(chain('range="1 -1"')), r"joint 'j1': position limits: expected lower < upper, got 0\.01"),
        (mjcf(chain('limited="true"')), "joint 'j1': limited, but no range is given"),
        (
            mjcf(chain('armature="-1"')),
            r"joint 'j1': rotor_inertia: expected a finite number of at least 0 and at most 1e.20, got -1\.0",
        ),
        (mjcf(chain('damping="1 2"')), "joint 'j1': damping: only the first coefficient is understood, got '1 2'"),
        (mjcf(chain().replace('"j2"', '"j1"')), "some: joint names must be unique, got 'j1' more than once"),
        (mjcf(chain().replace('"b"', '"a"')), "two bodies are named 'a': names must be unique"),
        (mjcf(chain().replace('"b"', '"world"')), "two bodies are named 'world'"),
        (mjcf(chain().replace('name="b"', 'nmae="b"')), "body 'body3': unknown attribute 'nmae'; expected one of name"),
        (mjcf(chain().replace('name="b"', 'name="b" mocap="true"')), "body 'b': a mocap body is moved by hand"),
        (mjcf(chain().replace("quat", 'euler="1 2 3" quat')), "body 'b': <body> has quat and euler: keep one"),
        (mjcf(chain().replace('"1 2 3 4"', '"0 0 0 0"')), "body 'b': quat must not be zero"),
        (
            mjcf(chain().replace('quat="1 2 3 4"', 'quat="1 2 3"')),
            "body 'b': quat of <body>: expected 4 finite numbers",
        ),
        (mjcf(chain(more='<replicate count="3"/>')), "body 'a': <replicate> is not read; what is: body, frame, joint"),
        (
            mjcf(chain(inertia1="<inertial mass='1' diaginertia='1 1 1'/>")),
            "body 'a': <inertial> needs the attribute pos",
        ),
        (
            mjcf(chain(inertia1="<inertial pos='0 0 0' diaginertia='1 1 1'/>")),
            "body 'a': <inertial> needs the attribute mass",
        ),
        (
            mjcf(chain(inertia1="<inertial pos='0 0 0' mass='1'/>")),
            "body 'a': <inertial> needs one of diaginertia and full",
        ),
        (mjcf(chain(inertia1=BODY.replace('"1"', '"-1"'))), r"body 'a': mass must not be negative, got -1\.0"),
        (mjcf(chain(inertia1=BODY + BODY)), "body 'a': <body> has 2 elements <inertial>, expected one"),
        (
            mjcf(chain(inertia1=f'<frame pos="1 0 0">{BODY}</frame>')),
            "body 'a': <inertial> within a <frame> is not read",
        ),
        (
            mjcf(chain(inertia1='<geom name="g" type="mesh" mesh="m"/>')),
            "body 'a': geom 'g': the inertia of a mesh is not worked",
        ),
        (mjcf(chain(inertia1='<geom size=".1" shellinertia="true"/>')), "body 'a': <geom>: shellinertia is not read"),
        (mjcf(chain(inertia1="<geom/>")), "body 'a': <geom>: <geom> needs the attribute size"),
        (
            mjcf(chain(inertia1='<geom type="box" size=".1"/>')),
            "body 'a': <geom>: size of <geom>: expected 3 finite numbers, got '.1'",
        ),
        (
            mjcf(chain(inertia1='<geom type="capsule" size=".1" fromto="0 0 0 0 0 0"/>')),
            "body 'a': <geom>: fromto ends where it begins",
        ),
        (mjcf(chain(inertia1='<geom size=".1" fromto="0 0 0 0 0 1"/>')), "body 'a': <geom>: a sphere has no fromto"),
        (mjcf(chain(inertia1='<geom class="x" size=".1"/>')), "<geom>: there is no default class 'x'; there are main"),
        (
            mjcf(chain(), before="<default><default/></default>"),
            "<default> within class 'main' needs the attribute class",
        ),
        (
            mjcf(chain(), before='<compiler angle="grad"/>'),
            "<compiler>: angle: expected one of degree, radian, got 'grad'",
        ),
        (
            mjcf(chain(), before='<compiler eulerseq="xyw"/>'),
            "<compiler>: eulerseq: expected three of x, y, z, X, Y, Z",
        ),
        (mjcf(chain(), before='<compiler coordinate="global"/>'), "<compiler>: coordinate: only local coordinates"),
        (mjcf(chain(), before='<compiler settotalmass="1"/>'), "<compiler>: settotalmass: masses are not scaled"),
        (mjcf(chain(), before='<compiler boundmass="1"/>'), "<compiler>: boundmass: masses are not bounded"),
        (mjcf(chain(), before='<compiler balanceinertia="true"/>'), "<compiler>: balanceinertia: inertias are not"),
        (mjcf(chain(), before='<option gravity="0 0"/>'), "<option>: gravity of <option>: expected 3 finite numbers"),
        (
            linkage(EQUAL.replace('"rod"', '"rot"')),
            "equality 'pin': there is no body 'rot'; there are world, base, crank",
        ),
        (linkage(EQUAL.replace(' body1="rod"', "")), "equality 'pin': <connect> needs the attribute body1"),
        (linkage(EQUAL.replace('anchor=".55 0 .2"', "")), "equality 'pin': <connect> needs the attribute anchor"),
        (
            linkage('<connect name="pin" site1="tip" site2="top"/>'),
            "equality 'pin': there is no site 'top'; there are tip",
        ),
        (
            linkage('<weld body1="rod" body2="pad"/>'),
            "equality 'weld1': both ends are on one rigid body, rod: remove it",
        ),
        (linkage('<weld body1="base"/>'), "equality 'weld1': both ends are on one rigid body, the world: remove it"),
        (
            linkage('<tendon name="t" tendon1="x"/>'),
            "equality 't': <tendon> is not read; equalities that are read: con",
        ),
        (
            linkage('<glue body1="rod"/>'),
            "equality 'glue1': <glue> is unknown; equalities that are read: connect, weld, j",
        ),
        (
            linkage('<joint joint1="rod"/>'),
            "equality 'joint1': holds joint 'rod' still: leave the joint out, or name joi",
        ),
        (
            linkage('<joint joint1="rod" joint2="rad"/>'),
            "equality 'joint1': there is no joint 'rad'; there are crank, rod",
        ),
        (linkage('<joint joint1="rod" joint2="rod"/>'), "equality 'joint1': .* joint 'rod' cannot follow itself"),
        (
            linkage('<joint joint1="rod" joint2="crank" polycoef="0 1 2"/>'),
            "equality 'joint1': polycoef: only a linear relation is understood",
        ),
        (
            linkage('<joint joint1="rod" joint2="crank"/><joint joint1="rocker" joint2="rod"/>'),
            "coupling 'joint2': joint 'rocker' follows 'rod', which itself follows another joint",
        ),
        (
            linkage(EQUAL, actuator=""),
            "loops need primary joints, and no actuator drives a joint: .*, among crank, rod, roc",
        ),
        (
            linkage(EQUAL, actuator=MOTOR.replace("crank", "handle")),
            "<motor>: there is no joint 'handle'; there are crank, rocker, rod",
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
            "2 joints are primary, but the loops leave only 1 free",
        ),
        (linkage(EQUAL + EQUAL.replace("pin", "again")), "closure 'again' is redundant"),
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
