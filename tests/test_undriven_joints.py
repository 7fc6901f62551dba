"""Joints that no actuator of an MJCF file drives: fingers on tendons, passive loops, poles of carts."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from mjcf_files import CLOSED, linkage

from adaptctl.description.readers.registry import read_model
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import SimplificationWarning
from adaptctl.identifiability import essential_space
from adaptctl.tuning import tune

NOTE = "no actuator drives these joints, which are taken as driven"
TEN = '<inertial pos=".01 .02 .1" mass="{}" diaginertia=".02 .02 .01"/>'
FINGER = '<body name="{0}" pos="0 {1} .2"><joint name="{0}" type="slide" axis="0 {1} 0" range="0 .04"/>{2}</body>'
HAND = f"""<mujoco><worldbody><body name="upper"><joint name="shoulder" axis="0 1 0" range="-90 90"/>{TEN.format(2)}
    <body name="hand" pos="0 0 .4"><joint name="wrist" axis="1 0 0" range="-90 90"/>{TEN.format(1)}
      {FINGER.format("left", 1, TEN.format(0.1))}{FINGER.format("right", -1, TEN.format(0.1))}</body></body></worldbody>
  <equality><joint joint1="left" joint2="right"/></equality>
  <tendon><fixed name="split"><joint joint="left" coef=".5"/><joint joint="right" coef=".5"/></fixed></tendon>
  <actuator><motor joint="shoulder" ctrlrange="-60 60"/><motor joint="wrist" ctrlrange="-20 20"/>
    <general tendon="split" ctrlrange="0 255"/></actuator></mujoco>"""


def written(folder: Path, text: str) -> Path:
    (folder / "robot.xml").write_text(text)
    return folder / "robot.xml"


def test_fingers_on_a_tendon_are_one_more_primary_joint(tmp_path: Path) -> None:
    path = written(tmp_path, HAND)
    with pytest.warns(SimplificationWarning) as said:
        arm = load(path)
    assert [str(one.message).removeprefix(f"{path}: ") for one in said] == [
        "tendons are ignored: fixed 'split'",
        f"{NOTE}: right",
    ]
    assert [joint.name for joint in arm.primary_joints] == ["shoulder", "wrist", "right"]
    np.testing.assert_allclose(arm.configuration([0.1, 0.2, 0.03]), [0.1, 0.2, 0.03, 0.03])
    assert tune(arm).verified[0].is_learning


def test_two_fingers_without_gears_are_two_more(tmp_path: Path) -> None:
    loose = HAND.replace('<equality><joint joint1="left" joint2="right"/></equality>', "")
    with pytest.warns(SimplificationWarning) as said:
        assert load(written(tmp_path, loose)).dof == 4
    assert str(said[-1].message).endswith(f"{NOTE}: left, right")


@pytest.mark.parametrize("equality", CLOSED)
def test_a_loop_that_nothing_drives_is_driven_at_the_joint_nearest_the_base(tmp_path: Path, equality: str) -> None:
    """As one whose crank a motor drives."""
    with pytest.warns(SimplificationWarning, match=f"{NOTE}: crank"):
        alone = load(written(tmp_path, linkage(CLOSED[equality], actuator="")))
    driven = load(written(tmp_path, linkage(CLOSED[equality])))
    assert [joint.name for joint in alone.primary_joints] == ["crank"]
    p = np.array([[0.0], [0.1], [-0.2]])
    np.testing.assert_allclose(alone.configuration(p), driven.configuration(p), atol=1e-12)
    assert essential_space(alone).rank == essential_space(driven).rank


def test_of_a_loop_and_a_pendulum_on_it_both_are_primary(tmp_path: Path) -> None:
    """The loop's rank says which joints it determines: of the three that no motor drives two."""
    bob = '<body name="bob" pos="0 0 .1"><joint name="swing" axis="0 1 0"/><geom size=".03"/></body></body>'
    text = linkage(CLOSED["connect"]).replace('</body>\n<body name="rocker"', f'{bob}\n<body name="rocker"')
    with pytest.warns(SimplificationWarning, match=f"{NOTE}: swing"):
        arm = load(written(tmp_path, text))
    assert [joint.name for joint in arm.primary_joints] == ["crank", "swing"]
    with pytest.warns(SimplificationWarning, match=f"{NOTE}: swing"):
        compiled = Mechanism(read_model(mujoco.MjModel.from_xml_string(text)))
    np.testing.assert_allclose(compiled.configuration([0.1, 0.2]), arm.configuration([0.1, 0.2]), atol=1e-12)
