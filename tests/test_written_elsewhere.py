"""Files as other programs write them: prefixes, encodings, leftovers, chains that a loop joins, constraints twice."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import adaptctl
from adaptctl.description import Closure, Coupling, Description, read
from adaptctl.description.loops import given_once
from adaptctl.errors import FileError, SimplificationWarning

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="30" velocity="3"/></joint>
</robot>
"""
MJCF = """<mujoco model="four"><worldbody>
<body name="a"><joint name="ja" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 1"/>
<body name="c" pos="0 0 1"><joint name="jc" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 1 0 0"/></body>
</body>
<body name="b" pos="1 0 0"><joint name="jb" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 1"/></body>
</worldbody><equality><connect name="pin" body1="c" body2="b" anchor="1 0 0"/></equality>
<actuator><motor joint="ja"/></actuator></mujoco>
"""


def reading(folder: Path, text: str | bytes, name: str = "arm.urdf") -> Description:
    file = folder / name
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return read(file)


def same(one: Description, other: Description) -> None:
    assert one.joint_names == other.joint_names
    np.testing.assert_array_equal(one.inertial_parameters, other.inertial_parameters)
    assert one.links[0].joint.limits == other.links[0].joint.limits


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("</robot>", '<drake:group name="g"><drake:member link="rod"/></drake:group></robot>'),
        ('<limit lower="-1"', '<limit drake:acceleration="2.5" lower="-1"'),
        ('<link name="base"/>', '<link name="base"><sim:inertial><mass value="9"/></sim:inertial></link>'),
        ("</robot>", '<gazebo reference="$(arg prefix)rod"><xacro:insert/><mu>${mu}</mu></gazebo></robot>'),
        ("</robot>", '<xacro:property name="m" value="${2 * 3}"/></robot>'),
        ("</robot>", '<xacro:macro name="x"><link name="y"/></xacro:macro></robot>'),
        ('<link name="base"/>', '<link name="base"><inertial><mass value="1.02"/></inertial></link>'),
        ('<link name="base"/>', '<link name="base"><inertial/></link>'),
        ("<robot", '<robot xmlns="http://www.ros.org" xmlns:drake="http://drake.mit.edu"'),
        ("</robot>", '<x xmlns="http://other"><link name="z"/></x></robot>'),
        ("</robot>", '<link xmlns="http://other" name="z"/><d:b/></robot>'),
    ],
)  # fmt: skip
def test_what_no_equation_needs_is_left_out(tmp_path: Path, old: str, new: str) -> None:
    same(reading(tmp_path, URDF.replace(old, new, 1)), reading(tmp_path, URDF, "plain.urdf"))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("<link name", "<xacro:link name", "xacro"),
        ('<link name="rod">', '<link name="rod"><xacro:insert/>', "xacro"),
        ("</robot>", "<xacro:arm/></robot>", "xacro"),
        ("</robot>", '<xacro:include filename="a.xacro"/></robot>', "xacro"),
        ('<mass value="2"/>', '<mass value="${m}"/>', "xacro"),
        ('<mass value="2"/>', "", "needs an element <mass>"),
        ('<mass value="2"/>', '<d:mass value="2"/>', "needs an element <mass>"),
        ("</robot>", "<d:b></robot>", "not well-formed XML"),
    ],
)
def test_what_an_equation_needs_is_refused(tmp_path: Path, old: str, new: str, told: str) -> None:
    with pytest.raises(FileError, match=told):
        reading(tmp_path, URDF.replace(old, new, 1))


@pytest.mark.parametrize("encoding", ["ISO-8859-1", "windows-1252", "iso-8859-15", "latin1"])
def test_declared_encodings_are_read(tmp_path: Path, encoding: str) -> None:
    text = URDF.replace('"1.0"?', f'"1.0" encoding="{encoding}"?').replace('"hinge"', '"Höhe"')
    arm = reading(tmp_path, text.encode(encoding))
    assert arm.joint_names == ("Höhe",)
    assert reading(tmp_path, text).joint_names == ("Höhe",), "UTF-8 in spite of what is declared"


def test_other_bytes_are_refused(tmp_path: Path) -> None:
    for text in (URDF, URDF.replace('"1.0"?', '"1.0" encoding="utf-8"?')):
        with pytest.raises(FileError, match="is not UTF-8"):
            reading(tmp_path, text.replace('"hinge"', '"Höhe"').encode("latin-1"))


def test_a_file_of_another_encoding_is_written_in_it(tmp_path: Path) -> None:
    text = URDF.replace('"1.0"?', '"1.0" encoding="ISO-8859-1"?').replace('"rod"', '"Ölfuß"')
    (tmp_path / "arm.urdf").write_bytes(text.encode("latin-1"))
    arm = adaptctl.load(tmp_path / "arm.urdf")
    arm.with_parameters(1.5 * arm.inertial_parameters).write_into(tmp_path / "arm.urdf", tmp_path / "new.urdf")
    assert "Ölfuß".encode("latin-1") in (tmp_path / "new.urdf").read_bytes()
    new = adaptctl.load(tmp_path / "new.urdf")
    np.testing.assert_allclose(new.inertial_parameters, 1.5 * arm.inertial_parameters, rtol=1e-12)


def test_prefixes_of_mjcf_are_left_out(tmp_path: Path) -> None:
    text = MJCF.replace("</worldbody>", "<x:thing/></worldbody>").replace('<body name="a">', '<body x:id="3" name="a">')
    same(reading(tmp_path, text, "arm.xml"), reading(tmp_path, MJCF, "plain.xml"))


def test_chains_side_by_side_that_a_loop_joins_are_one_mechanism(tmp_path: Path) -> None:
    """A parallelogram: the second chain turns as the first, and the coupler stays level."""
    (tmp_path / "four.xml").write_text(MJCF)
    four = adaptctl.load(tmp_path / "four.xml")
    assert (four.dof, len(four.links), [link.parent for link in four.links]) == (1, 3, [-1, 0, -1])
    np.testing.assert_allclose(four.configuration([0.3]), [0.3, -0.3, 0.3], atol=1e-9)
    both = MJCF.replace("</actuator>", '<motor joint="jb"/></actuator>')
    alone = both.replace('<connect name="pin" body1="c" body2="b" anchor="1 0 0"/>', "")
    with pytest.raises(FileError, match="2 root bodies move, 'a', 'b', each a separate mechanism"):
        reading(tmp_path, alone, "alone.xml")
    with pytest.raises(FileError, match="2 root bodies move"):
        reading(tmp_path, both.replace('name="pin"', 'name="pin" active="false"'), "off.xml")


def test_chains_that_gears_join_are_one_mechanism(tmp_path: Path) -> None:
    gear = '<joint joint1="jb" joint2="ja" polycoef="0 2 0 0 0"/>'
    geared = MJCF.replace('<connect name="pin" body1="c" body2="b" anchor="1 0 0"/>', gear)
    (tmp_path / "geared.xml").write_text(geared.replace('"ja"/></a', '"ja"/><motor joint="jc"/></a'))
    arm = adaptctl.load(tmp_path / "geared.xml")
    np.testing.assert_allclose(arm.configuration([0.2, 0.1]), [0.2, 0.1, 0.4], atol=1e-12)


@pytest.mark.parametrize("again", ["", 'name="again" '])
def test_a_constraint_given_twice_is_taken_once(tmp_path: Path, again: str) -> None:
    pin = f'<connect {again}body1="b" body2="c" anchor="0 0 1"/></equality>'
    (tmp_path / "twice.xml").write_text(MJCF.replace("</equality>", pin))
    with pytest.warns(SimplificationWarning, match=f"constraints given twice are taken once: {again and 'again'}"):
        twice = read(tmp_path / "twice.xml")
    assert twice.loops is not None
    assert [closure.name for closure in twice.loops.closures] == ["pin"]


def test_a_mimic_given_twice_is_taken_once(tmp_path: Path) -> None:
    tip = '<joint name="j2" type="continuous"><parent link="rod"/><child link="tip"/>' + 2 * '<mimic joint="hinge"/>'
    more = URDF.replace("</robot>", f'<link name="tip"/>{tip}</joint></robot>')
    with pytest.raises(SimplificationWarning, match="constraints given twice are taken once: j2"):
        reading(tmp_path, more)
    with pytest.raises(FileError, match="has 2 elements <mimic>"):
        reading(tmp_path, more.replace('<mimic joint="hinge"/></joint>', '<mimic joint="hinge" offset="1"/></joint>'))


def test_toml_closures_given_twice_are_taken_once(tmp_path: Path) -> None:
    robots = Path(adaptctl.description.__file__ or "").parent / "robots"
    text = (robots / "semi_direct_drive.toml").read_text()
    closure = text[text.index("[[closures]]") :]
    closure = closure[: closure.find("\n[", 2) if closure.find("\n[[", 2) > 0 else len(closure)]
    (tmp_path / "twice.toml").write_text(text + "\n" + closure.replace('name = "elbow"', 'name = "again"'))
    with pytest.warns(SimplificationWarning, match="constraints given twice are taken once: again"):
        twice = read(tmp_path / "twice.toml")
    assert twice.geometry_sha256 == read("semi_direct_drive").geometry_sha256


def test_constraints_that_differ_are_kept() -> None:
    gears = [
        Coupling("a", "x", "y"),
        Coupling("b", "x", "y", 2.0),
        Coupling("c", "x", "y", 1.0, 0.1),
        Coupling("d", "x", "y"),
    ]
    assert given_once(gears) == (tuple(gears[:3]), ("d",))
    pins = [Closure("a", "x", "y"), Closure("b", "y", "x"), Closure("c", "x", "z")]
    assert given_once(pins) == ((pins[0], pins[2]), ("b",))
