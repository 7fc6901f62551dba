"""Estimates leave: into URDF, MJCF and Pinocchio models, of which nothing but inertias changes; frames survive."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from mjcf_files import BODY, chain, mjcf
from robot_files import urdf

import adaptctl
from adaptctl.description import builtin_file
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError, InputError, NotFoundError
from adaptctl.identifiability import ReducedModel, nearest_consistent

SCENE = builtin_file("scene")
UR5 = urdf("ur5_robot.urdf")


def estimated(arm: Mechanism, seed: int = 0) -> Mechanism:
    """The arm with estimates that rigid bodies have: each link's inertia by another factor."""
    factors = np.random.default_rng(seed).uniform(0.5, 2.0, len(arm.description.bodies))
    values = np.array(arm.inertial_parameters)
    values[: 10 * len(factors)] *= np.repeat(factors, 10)
    return arm.with_parameters(values)


def torques(arm: Mechanism, seed: int = 1) -> tuple[np.ndarray, ...]:
    p, v, a = np.random.default_rng(seed).uniform(-1.0, 1.0, (3, 20, arm.dof))
    return p, v, a, arm.inverse_dynamics(p, v, a)


def without_inertials(text: bytes) -> bytes:
    return re.sub(rb"<inertial>.*?</inertial>|<inertial\b[^>]*/>", b"", text, flags=re.DOTALL)


def close(found: object, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_urdf_to_estimates_to_urdf_to_pinocchio(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        arm = estimated(adaptctl.load(UR5))
    arm.write_into(UR5, tmp_path / "robot.urdf")
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "robot.urdf"))
    p, v, a, expected = torques(arm)
    data = model.createData()
    close([pinocchio.rnea(model, data, *state) for state in zip(p, v, a, strict=True)], expected)
    assert without_inertials((tmp_path / "robot.urdf").read_bytes()) == without_inertials(UR5.read_bytes())


def test_mjcf_to_estimates_to_mjcf_to_mujoco(tmp_path: Path) -> None:
    arm = estimated(adaptctl.load(SCENE, root="stand"))
    arm.write_into(SCENE, tmp_path / "scene.xml", root="stand")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "scene.xml"))
    p, v, a, expected = torques(arm)
    close(Mechanism.from_mujoco(model).inverse_dynamics(p, v, a), expected)
    assert without_inertials((tmp_path / "scene.xml").read_bytes()) == SCENE.read_bytes()
    box = mujoco.MjModel.from_xml_path(str(SCENE)).body("box").mass
    np.testing.assert_array_equal(model.body("box").mass, box)  # what is no link is as it was


FIXED = f'<body name="tool" pos=".1 0 .1" euler="0 20 0">{BODY}<geom size=".1"/></body>'


@pytest.mark.parametrize(
    "text",
    [
        mjcf(chain()),
        mjcf(chain(more=FIXED)),
        mjcf(chain(inertia1='<geom size=".1"/>', inertia2='<geom type="box" size=".1 .2 .3"/>')),
        mjcf("<!-- > -->" + chain().replace("<inertial", "<!-- <inertial/> --><inertial").replace("><", ">\n\t<")),
        mjcf(chain(), before='<compiler angle="radian"/>') + "<!-- the end -->",
    ],
)
def test_all_else_of_an_mjcf_file_stays_byte_for_byte(text: str, tmp_path: Path) -> None:
    (tmp_path / "in.xml").write_bytes(text.encode())
    arm = estimated(adaptctl.load(tmp_path / "in.xml"))
    arm.write_into(tmp_path / "in.xml", tmp_path / "out.xml")
    p, v, a, expected = torques(arm)
    close(adaptctl.load(tmp_path / "out.xml").inverse_dynamics(p, v, a), expected)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    close(Mechanism.from_mujoco(model).inverse_dynamics(p, v, a), expected)
    assert without_inertials((tmp_path / "out.xml").read_bytes()) == without_inertials(text.encode())


def test_a_file_whose_mechanism_has_not_changed_is_as_it_was(tmp_path: Path) -> None:
    adaptctl.load(SCENE, root="stand").write_into(SCENE, tmp_path / "same.xml", root="stand")
    assert (tmp_path / "same.xml").read_bytes() == SCENE.read_bytes()


def test_fundamental_estimates_leave_through_the_nearest_consistent_bodies(tmp_path: Path) -> None:
    arm = adaptctl.load(SCENE, root="stand")
    model = ReducedModel(arm)
    beta = 1.2 * model.fundamental_parameters
    with pytest.raises(FileError, match="its inertia is not physically consistent"):
        arm.with_parameters(model.embed(beta)).write_into(SCENE, tmp_path / "scene.xml", root="stand")
    assert not (tmp_path / "scene.xml").exists()
    lifted = arm.with_parameters(nearest_consistent(model, beta).parameters)
    lifted.write_into(SCENE, tmp_path / "scene.xml", root="stand")
    p, v, a, expected = torques(lifted)
    back, plain = (m.with_drives(Drive()) for m in (adaptctl.load(tmp_path / "scene.xml", root="stand"), lifted))
    close(back.inverse_dynamics(p, v, a), plain.inverse_dynamics(p, v, a))
    np.testing.assert_allclose(expected, model.inverse_dynamics(p, v, a, beta), atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("original", "message"),
    [
        ("other.xml", "does not match some"),
        ("geoms.xml", "inertiafromgeom: expected 'auto', got 'true'"),
        ("whole.xml", "its body is in an included file"),
        ("robot.toml", "expected a URDF or MJCF file"),
        ("none.xml", "cannot be read"),
    ],
)
def test_files_that_inertias_are_not_written_into(original: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "in.xml").write_text(mjcf(chain()))
    arm = estimated(adaptctl.load(tmp_path / "in.xml"))
    (tmp_path / "other.xml").write_text(mjcf(chain().replace('"j1"', '"shoulder"').replace(".5", ".6")))
    (tmp_path / "geoms.xml").write_text(mjcf(chain(), before='<compiler inertiafromgeom="true"/>'))
    (tmp_path / "part.xml").write_text(f"<mujocoinclude>{chain()}</mujocoinclude>")
    (tmp_path / "whole.xml").write_text(
        '<mujoco model="some"><worldbody><include file="part.xml"/></worldbody></mujoco>'
    )
    with pytest.raises(InputError, match=message):
        arm.write_into(tmp_path / original, tmp_path / "out.xml")
    assert not (tmp_path / "out.xml").exists()


def robot(name: str) -> pinocchio.Model:
    return pinocchio.buildModelFromUrdf(str(urdf(name)))


@pytest.mark.parametrize("name", ["panda.urdf", "ur5_robot.urdf", "talos_left_arm.urdf"])
def test_frames_survive_the_way_to_mechanisms_and_back(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = robot(name)
        back = adaptctl.load(model).to_pinocchio()
    assert back.nframes == model.nframes
    assert sorted(frame.name for frame in back.frames) == sorted(frame.name for frame in model.frames)
    q = pinocchio.randomConfiguration(model)
    one, other = model.createData(), back.createData()
    pinocchio.framesForwardKinematics(model, one, q)
    pinocchio.framesForwardKinematics(back, other, q)
    for frame in list(model.frames)[1:]:
        i, k = (m.getFrameId(frame.name, frame.type) for m in (model, back))
        np.testing.assert_allclose(other.oMf[k].homogeneous, one.oMf[i].homogeneous, atol=1e-12)


def test_estimates_go_back_into_the_users_own_model() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = robot("panda.urdf")
        arm = estimated(adaptctl.load(model))
    changed = arm.in_pinocchio(model)
    p, v, a, _ = torques(arm)
    drives = arm.with_drives(Drive()).inverse_dynamics(p, v, a)
    data = changed.createData()
    changed.armature[:] = 0.0
    close([pinocchio.rnea(changed, data, *state) for state in zip(p, v, a, strict=True)], drives)
    assert [str(frame) for frame in changed.frames] != []
    assert changed.nframes == model.nframes
    assert not np.allclose(changed.inertias[1].mass, model.inertias[1].mass)
    with pytest.raises(NotFoundError, match="unknown joint 'yaw'"):
        adaptctl.load(SCENE, root="stand").in_pinocchio(model)
