"""MJCF's equality constraints, against MuJoCo: what is closed, welded and coupled stays so."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mjcf_files import BODY, CLOSED, FULL, OFF, chain, linkage, mjcf, order, reading, same_motion

from adaptctl.arrays import Array
from adaptctl.description import ClosureKind, Description
from adaptctl.dynamics import Mechanism
from adaptctl.scalars import column

pytestmark = pytest.mark.usefixtures("elsewhere")


def same_loops(description: Description, text: str) -> None:
    """MuJoCo finds nothing left between what we closed, and no velocity across what we hold together."""
    mechanism, model = Mechanism(description), mujoco.MjModel.from_xml_string(text)
    assert mechanism.continuation is not None
    data, places = mujoco.MjData(model), order(model, description)
    reference = mechanism.continuation.reference
    for step in (-0.05, 0.0, 0.1):
        q = mechanism.configuration(reference[list(description.primary)] + step)
        for v in np.eye(mechanism.dof):
            data.qpos[places] = q
            data.qvel[places] = mechanism.equations.joint_velocities(column(q), column(v)).of
            mujoco.mj_forward(model, data)
            assert data.ne >= model.nv - mechanism.dof
            assert np.abs(data.efc_pos[: data.ne]).max() < 1e-11
            assert np.abs(data.efc_vel[: data.ne]).max() < 1e-11


@pytest.mark.parametrize("equality", CLOSED.values(), ids=CLOSED.keys())
def test_loops_close_as_in_mujoco(tmp_path: Path, equality: str) -> None:
    text = linkage(equality)
    robot = reading(tmp_path, text)
    assert robot.loops is not None
    assert robot.loops.primary == ("crank",)
    (closure,) = robot.loops.closures
    assert (closure.name, closure.kind) == ("pin", ClosureKind.POINT)
    assert {closure.first, closure.second} == {"rod", "rocker"}
    same_motion(robot, text)
    same_loops(robot, text)


WELDED = """
<body name="post"><joint name="lift" type="slide" axis="0 0 1"/>{body}
  <body name="arm" pos=".1 0 0"><joint name="turn" axis="0 0 1" ref="20"/>
    <joint name="tilt" axis="0 1 .3" pos=".05 0 .1"/>{body}
    <body name="hand" pos=".4 .1 0" euler="10 0 0"><joint name="roll" axis="1 .2 0" pos="0 -.1 .2"/>
      <joint name="pan" axis=".1 .3 1" pos=".2 .3 .1"/><joint name="out" type="slide" axis="0 1 0" ref=".3"/>
      <joint name="in" axis="0 1 .4" pos="-.1 .2 .3"/><joint name="up" axis="1 0 1" pos=".1 -.3 0"/>
      {body}<site name="grip" pos="0 0 .1" euler="0 20 0"/></body></body>
  <body name="block" pos=".5 .1 .2">{body}<site name="knob" {knob}/></body>
</body>
""".replace("{body}", BODY)


def welded() -> str:
    """The site on the block is where the hand's is as the file draws them."""
    model = mujoco.MjModel.from_xml_string(mjcf(WELDED.replace("{knob}", "")))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    block, grip = data.body("block"), data.site("grip")
    place = block.xmat.reshape(3, 3).T @ (grip.xpos - block.xpos)
    attitude = np.zeros(4)
    mujoco.mju_mat2Quat(attitude, (block.xmat.reshape(3, 3).T @ grip.xmat.reshape(3, 3)).ravel())
    pos, quat = (" ".join(map(repr, x.tolist())) for x in (place, attitude))
    return WELDED.replace("{knob}", f'pos="{pos}" quat="{quat}"')


WELDS = {
    "as drawn": '<weld name="grasp" body1="hand" body2="block"/>',
    "as said": '<weld name="grasp" body1="hand" body2="block" anchor=".01 .02 .03" '
    'relpose=".03 -.03 .2 .98 -.1 .1 .03"/>',
    "by sites": '<weld name="grasp" site1="grip" site2="knob"/>',
    "to the world": '<weld name="grasp" body1="hand"/>',
}


@pytest.mark.parametrize("equality", WELDS.values(), ids=WELDS.keys())
def test_welds_hold_as_in_mujoco(tmp_path: Path, equality: str) -> None:
    driven = '<actuator><motor joint="lift"/><motor joint="turn"/></actuator>'
    text = mjcf(welded(), f"<equality>{equality}</equality>{driven}", '<option gravity="0 1 -5"/>')
    robot = reading(tmp_path, text)
    assert robot.loops is not None
    assert robot.loops.closures[0].kind is ClosureKind.WELD
    assert dict(robot.loops.reference) == {"turn": math.radians(20), "out": 0.3}
    same_motion(robot, text)
    same_loops(robot, text)


GEARED = chain(more=f'<body name="c" pos="0 1 0"><joint name="j3" ref="10"/>{FULL}</body>')


def test_coupled_joints_follow_as_in_mujoco(tmp_path: Path) -> None:
    equality = '<equality><joint name="gear" joint1="j2" joint2="j3" polycoef=".1 -2 0 0 0"/></equality>'
    text = mjcf(GEARED, equality)
    robot = reading(tmp_path, text)
    assert robot.loops is not None
    assert robot.loops.primary == ("j1", "j3")
    same_loops(robot, text)
    driven = reading(tmp_path, mjcf(GEARED, equality + '<actuator><motor joint="j1"/><motor joint="j2"/></actuator>'))
    assert driven.loops is not None
    assert driven.loops.primary == ("j1", "j2")
    (coupling,) = driven.loops.couplings
    assert (coupling.follower, coupling.leader, coupling.ratio) == ("j3", "j2", -0.5)
    same_loops(driven, text)


def test_a_follower_of_a_follower_follows_as_in_mujoco(tmp_path: Path) -> None:
    pairs = (
        '<joint joint1="j2" joint2="j3" polycoef=".1 -2 0 0 0"/><joint joint1="j3" joint2="j1" polycoef="-.2 3 0 0 0"/>'
    )
    text = mjcf(GEARED, f"<equality>{pairs}</equality>")
    robot = reading(tmp_path, text)
    assert robot.loops is not None
    assert robot.loops.primary == ("j1",)
    assert [(c.follower, c.leader, c.ratio) for c in robot.loops.couplings] == [("j2", "j1", -6.0), ("j3", "j1", 3.0)]
    same_loops(robot, text)


def test_an_equality_without_coefficients_is_one_to_one(tmp_path: Path) -> None:
    robot = reading(tmp_path, mjcf(GEARED, '<equality><joint joint1="j1" joint2="j2"/></equality>'))
    assert robot.loops is not None
    (coupling,) = robot.loops.couplings
    assert (coupling.name, coupling.ratio, coupling.offset) == ("joint1", 1.0, 0.0)


@pytest.mark.filterwarnings("ignore:.*no actuator drives these joints:adaptctl.errors.SimplificationWarning")
def test_what_is_not_active_binds_nothing(tmp_path: Path) -> None:
    pin = CLOSED["connect"]
    for text in (
        linkage(pin.replace("<connect", '<connect active="false"')),
        linkage(pin.replace("<connect", '<connect class="off"'), before=OFF),
        linkage(pin, before='<option><flag equality="disable"/></option>'),
    ):
        assert reading(tmp_path, text).loops is None


def test_projected_dynamics_of_a_loop_are_mujocos(tmp_path: Path) -> None:
    """MuJoCo's own mass matrix, bias force and constraint Jacobian; the Jacobian's rate by a difference."""
    text = linkage(CLOSED["connect"])
    mechanism = Mechanism(reading(tmp_path, text))
    model = mujoco.MjModel.from_xml_string(text)
    data, places = mujoco.MjData(model), order(model, mechanism.description)

    def state(q: Array, u: Array) -> tuple[Array, Array, Array]:
        data.qpos[places], data.qvel[places] = q, u
        mujoco.mj_forward(model, data)
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        J = data.efc_J.reshape(-1, model.nv)[: data.ne].copy()
        return M, data.qfrc_bias.copy(), J

    p, v, torque = np.array([0.2]), np.array([1.5]), np.array([0.7])
    q = mechanism.configuration(p)
    u = np.array(mechanism.equations.joint_velocities(column(q), column(v)).of)
    h, inverse = 1e-5, np.argsort(places)
    forth, back = (state(q + s * u, u)[2] for s in (h, -h))
    M, bias, J = state(q, u)
    driven = np.zeros(3)
    driven[places[mechanism.description.primary[0]]] = torque[0]
    drift = -np.linalg.pinv(J, rcond=1e-8) @ ((forth - back) / (2 * h) @ u[inverse])
    free = np.linalg.svd(J)[2][2:].T
    a = drift + free @ np.linalg.solve(free.T @ M @ free, free.T @ (driven - bias - M @ drift))
    np.testing.assert_allclose(mechanism.forward_dynamics(p, v, torque), a[places][:1], rtol=1e-7)
