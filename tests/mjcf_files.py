"""MJCF files of chains and of linkages, and MuJoCo's motion to compare with."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from adaptctl.description import Description, read_mjcf
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.scalars import column

BODY = '<inertial pos=".1 0 .2" mass="1" diaginertia=".1 .12 .09"/>'
TILTED = '<inertial pos=".1 .2 .3" euler="10 20 30" mass="2" diaginertia=".1 .2 .25"/>'
FULL = '<inertial pos=".1 .2 .3" mass="1" fullinertia=".1 .2 .25 .01 .02 .03"/>'


def mjcf(world: str, more: str = "", before: str = "") -> str:
    return f'<mujoco model="some">{before}<worldbody>{world}</worldbody>{more}</mujoco>'


def chain(joint1: str = "", inertia1: str = BODY, joint2: str = "", inertia2: str = TILTED, more: str = "") -> str:
    one = f'<joint name="j1" axis="0 1 0" {joint1}/>'
    two = f'<body name="b" pos="0 0 .5" quat="1 2 3 4"><joint name="j2" axis="1 2 3" {joint2}/>{inertia2}</body>'
    return f'<body name="a" pos=".1 .2 .3">{one}{inertia1}{two}{more}</body>'


def reading(folder: Path, text: str) -> Description:
    (folder / "robot.xml").write_text(text)
    return read_mjcf(folder / "robot.xml")


def order(model: mujoco.MjModel, description: Description) -> list[int]:
    """Where our joints are in MuJoCo's vectors, all of whose joints have one coordinate."""
    return [int(model.joint(name).qposadr[0]) for name in description.joint_names]


def same_motion(description: Description, text: str, seed: int = 0) -> None:
    """Mass matrix and bias forces at random states, loops left open."""
    model = mujoco.MjModel.from_xml_string(text)
    data, tree = mujoco.MjData(model), TreeEquations.of(description)
    places, rng = order(model, description), np.random.default_rng(seed)
    assert sorted(places) == list(range(model.nv))
    M = np.zeros((model.nv, model.nv))
    D = column(description.inertial_parameters)
    for q, v in rng.uniform(-1, 1, (3, 2, model.nv)):
        data.qpos[places], data.qvel[places] = q, v
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, M)
        bias = (data.qfrc_bias - data.qfrc_passive)[places]
        ours = np.array(tree.mass_matrix(column(q), D), dtype=float)
        np.testing.assert_allclose(ours, M[np.ix_(places, places)], rtol=0, atol=1e-12 * np.abs(M).max())
        speed = column(v)
        force = tree.inverse_dynamics(column(q), speed, speed, column(0.0 * v), D)
        np.testing.assert_allclose(force.of, bias, rtol=0, atol=1e-11 * max(1.0, np.abs(bias).max()))


FOUR_BAR = """
<body name="crank"><joint name="crank" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 .2"/>
  <body name="rod" pos="0 0 .2"><joint name="rod" axis="0 1 0"/>
    <geom type="capsule" size=".02" fromto="0 0 0 .55 0 .2"/>
    <site name="tip" pos=".55 0 .2"/>
    <body name="pad" pos=".55 0 .2" euler="0 30 0"><geom size=".03"/><site name="pad" pos="0 0 0"/></body>
  </body>
</body>
<body name="rocker" pos=".6 0 0"><joint name="rocker" axis="0 1 0"/>
    <geom type="capsule" size=".02" fromto="0 0 0 -.05 0 .4"/><site name="end" pos="-.05 0 .4"/></body>
"""
LINKAGE = f"<body name='base' pos='1 2 3' euler='0 0 40'>{FOUR_BAR}</body>"
MOTOR = '<actuator><motor joint="crank"/></actuator>'


def linkage(equality: str, actuator: str = MOTOR, before: str = "") -> str:
    return mjcf(LINKAGE, f"<equality>{equality}</equality>{actuator}", before)


CLOSED = {
    "connect": '<connect name="pin" body1="rod" body2="rocker" anchor=".55 0 .2"/>',
    "connect of sites": '<connect name="pin" site1="tip" site2="end"/>',
    "connect on a body without a joint": '<connect name="pin" body1="pad" body2="rocker" anchor="0 0 0"/>',
    "connect the other way": '<connect name="pin" body1="rocker" body2="pad" anchor="-.05 0 .4"/>',
}


OFF = '<default><default class="off"><equality active="false"/></default></default>'
