"""Files of an identified robot: which are written, what each of them gives again, and what it cannot hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import AdaptctlError
from adaptctl.identification import Validation
from adaptctl.identification.written import WrittenRobot, _judged, write_robots

URDF = """<?xml version="1.0"?>
<robot name="arm"><link name="ground"/>
  <link name="one"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.2"/></inertial></link>
  <link name="two"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.15"/></inertial></link>
  <joint name="a" type="revolute"><parent link="ground"/><child link="one"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="3" effort="50"/></joint>
  <joint name="b" type="prismatic"><parent link="one"/><child link="two"/><axis xyz="1 0 0"/>
    <origin xyz="0.3 0 0"/><limit lower="-2" upper="2" velocity="3" effort="50"/></joint>
</robot>"""
PLAIN = Drive(viscous=0.5, coulomb=0.25)
rng = np.random.default_rng(0)
p, v, a = rng.normal(size=(3, 9, 2))


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    path = tmp_path / "arm.URDF"
    path.write_text(URDF)
    return path


def found_of(mechanism: Mechanism) -> Any:
    """An identification of a robot, held-out rows of which are those above."""
    measured = mechanism.inverse_dynamics(*(own[:, : mechanism.dof] for own in (p, v, a)))

    def judged(robot: Mechanism) -> tuple[Validation, None]:
        predicted = robot.inverse_dynamics(*(own[:, : robot.dof] for own in (p, v, a)))
        return Validation("rows", 25.0, np.arange(9.0), measured, predicted, units), None

    units = ("N m", "N")[: mechanism.dof]
    held_out = SimpleNamespace(judged=judged)
    motions = [SimpleNamespace(velocity=part[:, : mechanism.dof]) for part in (v[:4], v[4:])]
    return SimpleNamespace(mechanism=mechanism, held_out=held_out, motions=motions, validation=judged(mechanism)[0])


def test_a_robot_is_written_in_each_format_that_can_say_it(urdf: Path, tmp_path: Path) -> None:
    """In URDF where it was read of that, and beside nothing where all is said."""
    before = load(urdf)
    arm = before.with_parameters(1.1 * before.inertial_parameters).with_drives(PLAIN)
    found = found_of(arm)
    for given, names in (
        ((urdf, before), ["robot.toml", "robot.urdf", "robot.xml"]),
        ((urdf, None), ["robot.toml", "robot.xml"]),
        ((None, before), ["robot.toml", "robot.xml"]),
        ((urdf.with_suffix(".toml"), before), ["robot.toml", "robot.xml"]),
    ):
        written = list(write_robots(tmp_path, found, *given))
        assert [one.name for one in written] == names
        for one in written:
            assert one.validation.relative_error < 1e-9
            np.testing.assert_allclose(one.robot.inertial_parameters, arm.inertial_parameters, rtol=1e-9, atol=1e-12)
            assert (one.missing, one.note(found)) == ((), None)
    assert "adaptctl identify" not in (tmp_path / "robot.urdf").read_text()


def test_urdf_has_no_place_for_rotors_gravity_and_locks_and_says_so(urdf: Path, tmp_path: Path) -> None:
    before = load(urdf, gravity=[0.0, 0.0, -1.62], lock={"b": 0.25})
    found = found_of(before.with_drives(Drive(0.125, 0.5, 0.25)))
    _, written, _ = write_robots(tmp_path, found, urdf, before)
    assert (written.name, written.missing) == ("robot.urdf", ("a rotor inertia 0.125",))
    assert written.robot.description.gravity.tolist() == [0.0, 0.0, -1.62]
    assert written.robot.description.locked == {"b": 0.25}
    text = (tmp_path / "robot.urdf").read_text()
    assert "no place for a rotor inertia 0.125; gravity [0.0, 0.0, -1.62] m/s^2; the locked joints b=0.25;" in text


def test_coupled_drives_are_named_and_have_no_place_in_mjcf(urdf: Path, tmp_path: Path) -> None:
    before = load(urdf)
    coupled = replace(PLAIN, turns_with=(("a", -0.5),))
    found = found_of(before.with_drives([PLAIN, coupled]))
    toml, other, *more = write_robots(tmp_path, found, urdf, before)
    assert (toml.missing, other.missing) == ((), ("b turns with a (-0.5)",))
    for one in more:
        assert one.missing == other.missing
    assert [link.joint.drive.turns_with for link in other.robot.links] == [(), ()]
    assert toml.robot.links[1].joint.drive == coupled


def test_what_a_robot_warns_of_is_not_said_again_for_each_file(urdf: Path, tmp_path: Path) -> None:
    before = load(urdf)
    D = before.inertial_parameters.copy()
    D[4] = -1.0  # no body's
    found = found_of(before.with_parameters(D))
    assert len(list(write_robots(tmp_path, found, urdf, before))) == 2  # MuJoCo takes none that no body has


def test_a_file_that_gives_other_joints_is_an_error(urdf: Path) -> None:
    held = load(urdf, lock={"b": 0.0})
    with pytest.raises(AdaptctlError, match=r"has 1 joints instead of 2"):
        _judged(urdf, found_of(load(urdf)), held)


def test_a_note_tells_of_the_error_where_that_is_another() -> None:
    def of(*factors: float) -> Validation:
        return Validation("rows", 25.0, np.zeros(1), np.ones((1, 2)), np.array([factors]), ("N m", "N"))

    found: Any = SimpleNamespace(validation=of(1.01, 1.02))
    same, worse = (
        WrittenRobot("robot.urdf", found, of(*f), ("x", "y")).note(found) for f in ((1.01, 1.02), (1.1, 1.2))
    )
    assert same == "robot.urdf: URDF has no place for x; y"
    assert worse is not None
    assert "10.0% of the measured torque, 20.0% of the measured force instead of 1.0%, 2.0%" in worse
