"""MJCF's free joints, against MuJoCo, whose own have a quaternion."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import FileError, SimplificationWarning
from adaptctl.identifiability import essential_space

INERTIA = '<inertial pos=".1 .2 .3" euler="10 20 30" mass="2" diaginertia=".1 .2 .25"/>'
TEXT = f"""<mujoco>
  <option><flag energy="enable"/></option>
  <worldbody><body name="trunk" pos=".1 .2 .3" euler="10 20 30"><freejoint/>{INERTIA}
    <body name="leg" pos="0 0 .5"><joint name="hip" axis="1 2 3"/>{INERTIA}</body></body></worldbody>
</mujoco>"""
SIX = ("x", "y", "z", "yaw", "pitch", "roll")


def reading(folder: Path, text: str) -> Mechanism:
    (folder / "robot.xml").write_text(text)
    with pytest.warns(SimplificationWarning, match="the base floats: .* pushed by six ideal forces that no robot has"):
        return load(folder / "robot.xml", floating_base=True)


def set_state(model: mujoco.MjModel, data: mujoco.MjData, p: Array, v: Array) -> None:
    """What slides and angles are in MuJoCo's coordinates: a place and velocity in the world, and the trunk's own."""
    turned, quaternion = np.empty(9), np.empty(4)
    mujoco.mju_quat2Mat(turned, model.qpos0[3:7])
    R, (roll, pitch, yaw) = turned.reshape(3, 3), map(rotation_about, np.eye(3), p[5:2:-1])
    mujoco.mju_mat2Quat(quaternion, (R @ yaw @ pitch @ roll).ravel())
    data.qpos[:] = [*(model.qpos0[:3] + R @ p[:3]), *quaternion, *p[6:]]
    rates = roll.T @ (pitch.T @ [0.0, 0.0, v[3]] + [0.0, v[4], 0.0]) + [v[5], 0.0, 0.0]
    data.qvel[:] = [*(R @ v[:3]), *rates, *v[6:]]


@pytest.mark.parametrize("text", [TEXT, TEXT.replace("<freejoint", '<joint type="free" axis="1 2 3" name="trunk"')])
def test_energies_are_mujocos(tmp_path: Path, text: str) -> None:
    mechanism, model = reading(tmp_path, text), mujoco.MjModel.from_xml_string(text)
    assert mechanism.description.joint_names == (*(f"trunk_{axis}" for axis in SIX), "hip")
    data, differences = mujoco.MjData(model), []
    for p, v in np.random.default_rng(0).uniform(-1.0, 1.0, (5, 2, mechanism.dof)):
        set_state(model, data, p, v)
        mujoco.mj_forward(model, data)
        still, total = (mechanism.energy_regressor(p, u) @ mechanism.inertial_parameters for u in (0.0 * v, v))
        assert total - still == pytest.approx(data.energy[1], rel=1e-12)
        differences.append(still - data.energy[0])
    assert np.ptp(differences) < 1e-12 * abs(still)  # potentials agree but for where zero is


def test_gymnasiums_own_robots() -> None:
    """An ant: 8 hinges with armature and damping and 10 + 7 * 8 of its links; two a link are the drives'."""
    with pytest.warns(SimplificationWarning, match="pushed by six ideal forces"):
        ant = load(Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets" / "ant.xml", floating_base=True)
    drives = sum(name.startswith(("hip", "ankle")) for name in ant.parameter_names)
    assert essential_space(ant).rank == 10 + 7 * 8 + 8
    assert drives == 16


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            TEXT.replace("<freejoint/>", '<freejoint damping="1"/>'),
            "<freejoint>: MuJoCo: unrecognized attribute",
        ),
        (
            TEXT.replace("<freejoint/>", '<joint type="free" armature=".1"/>'),
            r"joint 'trunk': armature: expected 0 for a free joint, got 0\.1",
        ),
        (
            TEXT.replace("<freejoint/>", '<freejoint/><joint axis="1 0 0"/>'),
            "body 'trunk': a free joint must be the only joint of its body, and the bodies above",
        ),
        (
            TEXT.replace('<joint name="hip" axis="1 2 3"/>', "<freejoint/>"),
            "body 'leg': a free joint must be the only joint",
        ),
    ],
)
def test_what_cannot_float(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "robot.xml").write_text(text)
    for floating_base in (False, True) if "armature" not in message else (True,):
        with pytest.raises(FileError, match=message):
            load(tmp_path / "robot.xml", floating_base=floating_base)
