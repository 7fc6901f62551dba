"""Ball joints of MJCF, which become three hinges, against MuJoCo, whose own have a quaternion."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError, SimplificationWarning
from adaptctl.identifiability import essential_space

INERTIA = '<inertial pos=".1 .2 .3" euler="10 20 30" mass="2" diaginertia=".1 .2 .25"/>'
TEXT = f"""<mujoco><option><flag energy="enable"/></option>
  <worldbody><body name="arm" pos=".1 .2 .3" euler="10 20 30"><joint name="first" axis="1 2 3"/>{INERTIA}
    <body name="stick" pos="0 0 .5" euler="40 0 0"><joint name="ball" type="ball" pos=".05 .1 -.2"/>{INERTIA}
      <body name="tip" pos=".3 0 0"><joint name="last" axis="0 1 0"/>{INERTIA}</body></body></body></worldbody>
</mujoco>"""
AXES = ("0 0 1", "0 1 0", "1 0 0")
JOINTS = ("first", "ball_yaw", "ball_pitch", "ball_roll", "last")


def reading(folder: Path, text: str = TEXT) -> Mechanism:
    (folder / "robot.xml").write_text(text)
    return load(folder / "robot.xml")


def rates(p: Array) -> Array:
    """Matrix (3, 3) of the ball's angular velocity, in the stick's axes, by the rates of its three hinges."""
    _, pitch, roll = map(rotation_about, np.eye(3)[::-1], p[1:4])
    return np.column_stack([roll.T @ pitch.T @ [0.0, 0.0, 1.0], roll.T @ [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


def mujocos(model: mujoco.MjModel, p: Array, v: Array) -> mujoco.MjData:
    data = mujoco.MjData(model)
    yaw, pitch, roll = map(rotation_about, np.eye(3)[::-1], p[1:4])
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, (yaw @ pitch @ roll).ravel())
    data.qpos[:] = [p[0], *quaternion, p[4]]
    data.qvel[:] = [v[0], *(rates(p) @ v[1:4]), v[4]]
    mujoco.mj_forward(model, data)
    return data


def test_energies_and_torques_are_mujocos(tmp_path: Path) -> None:
    mechanism, model = reading(tmp_path), mujoco.MjModel.from_xml_string(TEXT)
    assert mechanism.description.joint_names == JOINTS
    assert [link.massless for link in mechanism.links] == [False, True, True, False, False]
    rests = []
    for p, v, a in np.random.default_rng(0).uniform(-1.0, 1.0, (5, 3, 5)):
        data = mujocos(model, p, v)
        still, total = (mechanism.energy_regressor(p, u) @ mechanism.inertial_parameters for u in (0.0 * v, v))
        assert total - still == pytest.approx(data.energy[1], rel=1e-12)
        rests.append(still - data.energy[0])
        change = (rates(p + 1e-5 * v) - rates(p - 1e-5 * v)) / 2e-5
        data.qacc[:] = [a[0], *(rates(p) @ a[1:4] + change @ v[1:4]), a[4]]
        mujoco.mj_inverse(model, data)
        force = data.qfrc_inverse
        expected = [force[0], *(rates(p).T @ force[1:4]), force[4]]
        np.testing.assert_allclose(mechanism.inverse_dynamics(p, v, a), expected, atol=1e-8)
    assert np.ptp(rests) < 1e-12 * abs(still)  # potentials agree but for where zero is


def test_a_ball_is_three_hinges_through_one_point(tmp_path: Path) -> None:
    """As three hinges through one point, the last of which carries the body."""
    arm = reading(tmp_path)
    assert len(arm.parameter_names) == 30
    by_hinges = TEXT.replace(
        '<joint name="ball" type="ball" pos=".05 .1 -.2"/>',
        "".join(f'<joint name="{n}" pos=".05 .1 -.2" axis="{a}"/>' for n, a in zip("zyx", AXES, strict=True)),
    )
    assert essential_space(arm).rank == essential_space(reading(tmp_path, by_hinges)).rank


def test_the_second_hinge_keeps_off_its_singularity(tmp_path: Path) -> None:
    for unit in ("degree", "radian"):
        text = TEXT.replace("<option>", f'<compiler angle="{unit}"/><option>')
        limits = [link.joint.limits for link in reading(tmp_path, text).links[1:4]]
        assert [bool(np.isfinite(one.upper)) for one in limits] == [False, True, False]
        assert (limits[1].lower, limits[1].upper) == pytest.approx((-np.radians(80), np.radians(80)))


def test_what_hinges_do_not_have_is_said(tmp_path: Path) -> None:
    text = TEXT.replace('type="ball"', 'type="ball" damping=".1" range="0 60"')
    with pytest.warns(SimplificationWarning, match="friction, armature, limits and actuators of ball .* ignored: ball"):
        arm = reading(tmp_path, text)
    assert len(arm.parameter_names) == 30
    text = TEXT.replace("</mujoco>", '<actuator><motor name="m" joint="ball" gear="1 0 0"/></actuator></mujoco>')
    with pytest.warns(SimplificationWarning, match="ignored: m"):
        reading(tmp_path, text)
    with pytest.raises(InputError, match=r"'stick' has a ball joint, 'ball', .* load its file, where it becomes three"):
        load(mujoco.MjModel.from_xml_string(TEXT))
