"""Quaternions and default namespaces, as files of other tools have them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_urdf import ROBOT, reading

from adaptctl.description import read_mjcf, read_urdf
from adaptctl.description.writers.robot_file import write_robot
from adaptctl.errors import FileError


def test_quaternions_turn_as_rpy_does(tmp_path: Path) -> None:
    shape = '<visual><origin {}/><geometry><sphere radius="0.1"/></geometry></visual>'
    turned = [
        f'<origin xyz="1 2 3" {turn}/>'
        for turn in ('rpy="0.4 0 0"', f'quat_xyzw="{2 * np.sin(0.2)} 0 0 {2 * np.cos(0.2)}"')
    ]
    by_rpy, by_quaternion = (
        reading(
            tmp_path,
            ROBOT.replace("<axis", f"{origin}<axis").replace(
                "<inertial>", f"{shape.replace('<origin {}/>', origin)}<inertial>{origin}"
            ),
        )
        for origin in turned
    )
    for one, other in zip(by_rpy.links, by_quaternion.links, strict=True):
        np.testing.assert_allclose(other.parent_to_joint.rotation, one.parent_to_joint.rotation, atol=1e-15)
        np.testing.assert_allclose(other.parent_to_joint.translation, [1.0, 2.0, 3.0])
        np.testing.assert_allclose(other.inertia, one.inertia, atol=1e-14)
    for one, other in zip(by_rpy.visuals, by_quaternion.visuals, strict=True):
        np.testing.assert_allclose(other.pose.rotation, one.pose.rotation, atol=1e-15)


def test_a_default_namespace_is_read_through(tmp_path: Path) -> None:
    plain = reading(tmp_path, ROBOT)
    named = reading(tmp_path, ROBOT.replace("<robot", '<robot xmlns="http://www.ros.org"'))
    np.testing.assert_array_equal(named.links[0].inertia, plain.links[0].inertia)
    np.testing.assert_array_equal(named.links[0].joint.axis, plain.links[0].joint.axis)
    write_robot(tmp_path / "new.urdf", tmp_path / "robot.urdf", named)
    assert read_urdf(tmp_path / "new.urdf").links[0].joint.name == "hinge"
    with pytest.raises(FileError, match="the root element must be <robot>"):
        reading(tmp_path, ROBOT.replace("<robot", '<x:robot xmlns:x="a"').replace("</robot", "</x:robot"))
    with pytest.raises(FileError, match="xacro"):
        reading(tmp_path, ROBOT.replace("<robot", '<robot xmlns="http://ros.org/wiki/xacro"'))


def test_a_default_namespace_of_mjcf_is_read_through(tmp_path: Path) -> None:
    inner = '<worldbody><body name="rod"><joint name="hinge"/><geom size="0.1"/></body></worldbody></mujoco>'
    (tmp_path / "a.xml").write_text("<mujoco>" + inner)
    (tmp_path / "b.xml").write_text('<mujoco xmlns="http://www.mujoco.org">' + inner)
    plain, named = read_mjcf(tmp_path / "a.xml"), read_mjcf(tmp_path / "b.xml")
    np.testing.assert_array_equal(named.links[0].inertia, plain.links[0].inertia)
