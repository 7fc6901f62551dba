"""MJCF: trees, inertias and loops against MuJoCo itself, and every wrong file."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adaptctl.arrays import Array
from adaptctl.description import ClosureKind, Description, JointKind, Limits, read, read_mjcf
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.errors import FileError, LoopError, SimplificationWarning
from adaptctl.files import MAX_BYTES
from adaptctl.identifiability import essential_space
from adaptctl.scalars import column

BODY = '<inertial pos=".1 0 .2" mass="1" diaginertia=".1 .12 .09"/>'
TILTED = '<inertial pos=".1 .2 .3" euler="10 20 30" mass="2" diaginertia=".1 .2 .25"/>'
FULL = '<inertial pos=".1 .2 .3" mass="1" fullinertia=".1 .2 .25 .01 .02 .03"/>'


@pytest.fixture(scope="module", autouse=True)
def _elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """MuJoCo writes its warnings into a file where it runs."""
    here = Path.cwd()
    os.chdir(tmp_path_factory.mktemp("mujoco"))
    yield
    os.chdir(here)


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


SHAPES = "".join(
    f'<geom {geom} pos=".1 -.2 .05" euler="10 20 30"/>'
    for geom in (
        'type="sphere" size=".1"',
        'type="capsule" size=".05 .2" density="500"',
        'type="cylinder" size=".05 .2" mass="0.3"',
        'type="ellipsoid" size=".1 .2 .3"',
        'type="box" size=".1 .2 .3" mass="2"',
        'size="1" mass="0"',
        'size="1" density="0"',
    )
)
ENDS = "".join(
    f'<geom type="{kind}" size="{size}" fromto=".1 .2 .3 -.2 .1 .05"/>'
    for kind, size in (
        ("capsule", ".05"),
        ("cylinder", ".04 1"),
        ("box", ".05"),
        ("box", ".05 .1"),
        ("ellipsoid", ".1"),
    )
)
CLASSES = (
    '<compiler angle="radian"/><default><joint axis="1 0 0" armature=".1"/><geom density="300"/>'
    '<default class="c"><joint axis="0 1 0" range="-1 2"/><geom type="capsule" size=".1 .2"/>'
    '<default class="d"><joint range="-3 3" armature=".2"/></default></default></default>'
)
FILES = {
    "a chain": mjcf(chain()),
    "full inertia": mjcf(chain(inertia1=FULL)),
    "armature, damping and friction": mjcf(chain(joint1='armature=".5" damping=".3"')),
    "a place for the joint": mjcf(chain(joint1='pos=".1 .2 .3"', joint2='pos="-.1 0 .2" type="slide"')),
    "a coordinate for the drawing": mjcf(chain(joint1='ref="30"', joint2='type="slide" ref=".4"')),
    "euler": mjcf(chain().replace('quat="1 2 3 4"', 'euler="10 20 30"')),
    "euler the other way": mjcf(
        chain().replace('quat="1 2 3 4"', 'euler="10 20 30"'), before='<compiler eulerseq="ZYx"/>'
    ),
    "axis and angle": mjcf(chain().replace('quat="1 2 3 4"', 'axisangle="1 2 3 40"')),
    "radians": mjcf(chain().replace('quat="1 2 3 4"', 'axisangle="1 2 3 .7"'), before='<compiler angle="radian"/>'),
    "z axis": mjcf(chain().replace('quat="1 2 3 4"', 'zaxis="1 -2 3"')),
    "z axis down": mjcf(chain().replace('quat="1 2 3 4"', 'zaxis="0 0 -2"')),
    "x and y axes": mjcf(chain().replace('quat="1 2 3 4"', 'xyaxes="1 2 3 0 1 0"')),
    "gravity": mjcf(chain(), before='<option gravity="1 2 3"/>'),
    "no gravity": mjcf(chain(), before='<option><flag gravity="disable"/></option>'),
    "geoms": mjcf(chain(inertia1=SHAPES)),
    "geoms from end to end": mjcf(chain(inertia1=ENDS)),
    "geoms beside an inertia": mjcf(chain(inertia1=BODY + SHAPES)),
    "geoms before an inertia": mjcf(chain(inertia1=BODY + SHAPES), before='<compiler inertiafromgeom="true"/>'),
    "geoms of some groups": mjcf(
        chain(inertia1='<geom size=".1" group="2"/><geom size=".2" group="4"/>'),
        before='<compiler inertiagrouprange="0 3"/>',
    ),
    "classes": mjcf(
        '<body name="a" childclass="c"><joint name="j1"/><geom size=".05"/><body name="b" pos="1 0 0">'
        '<joint name="j2" class="d"/><geom class="main" size=".1"/></body></body>',
        before=CLASSES,
    ),
    "frames": mjcf(
        f'<frame pos="1 2 3" euler="10 0 0"><body name="a" pos=".1 0 0"><joint name="j1"/>{BODY}'
        f'<frame euler="0 40 0" childclass="c"><geom size=".1" pos="0 0 .2"/><frame pos="0 1 0"><body name="b">'
        f'<joint name="j2"/>{FULL}</body></frame></frame></body></frame>',
        before=CLASSES,
    ),
    "a joint in a frame": mjcf(
        f'<body name="a"><frame pos="1 2 3" euler="10 0 0"><joint name="j1"/></frame>{BODY}</body>'
    ),
    "several joints on a body": mjcf(
        f'<body name="a" pos="1 0 0"><joint name="x" type="slide" axis="1 0 0"/>'
        f'<joint name="t" pos="0 .1 0" axis="0 1 1"/>'
        f'<joint name="z" type="slide" axis="0 0 1" armature=".2"/>{TILTED}<body name="b" pos=".3 0 0" euler="20 0 0">'
        f'<joint name="u" axis="1 0 0"/><joint name="w" axis="0 1 0" ref="20"/>{FULL}</body></body>'
    ),
    "bodies without joints": mjcf(
        f'<body name="base" pos="1 1 1" euler="0 30 0"><body name="a"><joint name="j1"/>{BODY}'
        f'<body name="mid" pos="0 1 0" euler="30 0 0">{TILTED}'
        f'<body name="b" pos="0 0 .3"><joint name="j2"/>{FULL}</body></body></body></body>'
        f'<body name="table" pos="3 0 0"><geom size="1"/></body>'
    ),
    "branches": mjcf(chain(more=f'<body name="c" pos="0 1 0"><joint name="j3"/>{FULL}</body>')),
}


@pytest.mark.parametrize("text", FILES.values(), ids=FILES.keys())
def test_the_same_motion_as_mujocos(tmp_path: Path, text: str) -> None:
    same_motion(reading(tmp_path, text), text)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 6))
def test_random_trees_move_as_in_mujoco(tmp_path_factory: pytest.TempPathFactory, seed: int, bodies: int) -> None:
    rng = np.random.default_rng(seed)

    def words(*values: float) -> str:
        return " ".join(f"{x:.6f}" for x in values)

    texts = ["" for _ in range(bodies)]
    for i in reversed(range(bodies)):
        kind, children = rng.choice(["hinge", "slide"]), texts[i + 1 :]
        inner = children[0] if children else ""
        texts[i] = (
            f'<body name="b{i}" pos="{words(*rng.uniform(-1, 1, 3))}" quat="{words(*rng.normal(size=4))}">'
            f'<joint name="j{i}" type="{kind}" axis="{words(*rng.normal(size=3))}" '
            f'pos="{words(*rng.uniform(-1, 1, 3))}" ref="{rng.uniform(-1, 1):.6f}"/>'
            f'<geom type="box" size="{words(*rng.uniform(0.1, 0.4, 3))}" '
            f'pos="{words(*rng.uniform(-1, 1, 3))}" quat="{words(*rng.normal(size=4))}"/>{inner}</body>'
        )
    text = mjcf(texts[0], before='<compiler angle="radian"/>')
    same_motion(reading(tmp_path_factory.mktemp("mjcf"), text), text, seed)


def test_names_kinds_limits_and_drives(tmp_path: Path) -> None:
    world = chain('range="-30 60" damping=".5" frictionloss=".25" armature=".1"', joint2='type="slide" range="-1 2"')
    actuators = (
        '<actuator><motor joint="j1" gear="-2" ctrlrange="-5 4"/><position joint="j2" forcerange="-3 3"/></actuator>'
    )
    robot = reading(tmp_path, mjcf(world, actuators))
    one, two = (link.joint for link in robot.links)
    assert (robot.name, robot.source) == ("some", "MJCF file robot.xml")
    assert [link.name for link in robot.links] == ["a", "b"]
    assert (one.kind, two.kind) == (JointKind.REVOLUTE, JointKind.PRISMATIC)
    assert one.limits == Limits(math.radians(-30), math.radians(60), effort=10.0)
    assert two.limits == Limits(-1.0, 2.0, effort=3.0)
    assert (one.drive.rotor_inertia, one.drive.viscous, one.drive.coulomb) == (0.1, 0.5, 0.25)
    assert (two.drive.rotor_inertia, two.drive.viscous, two.drive.coulomb) == (None, None, None)
    assert robot.loops is None


@pytest.mark.parametrize(
    ("joint", "before", "expected"),
    [
        ("", "", Limits()),
        ('range="-1 1"', '<compiler autolimits="false"/>', Limits()),
        ('range="-90 90" limited="false"', "", Limits()),
        ('range="-90 90" limited="true"', '<compiler autolimits="false"/>', Limits(-math.pi / 2, math.pi / 2)),
        ('range="-1 1"', '<compiler angle="radian"/>', Limits(-1, 1)),
        ('actuatorfrcrange="-7 5"', "", Limits(effort=7)),
    ],
)
def test_limits(tmp_path: Path, joint: str, before: str, expected: Limits) -> None:
    assert reading(tmp_path, mjcf(chain(joint), before=before)).links[0].joint.limits == expected


def test_efforts_of_several_actuators_add_and_the_joint_bounds_them(tmp_path: Path) -> None:
    motors = '<motor joint="j1" ctrlrange="-1 1"/><motor jointinparent="j1" ctrlrange="-2 2" gear="3"/>'
    assert reading(tmp_path, mjcf(chain(), f"<actuator>{motors}</actuator>")).links[0].joint.limits.effort == 7.0
    classes = '<default><motor ctrlrange="-4 4"/></default>'
    text = mjcf(chain('actuatorfrcrange="-3 3"'), '<actuator><motor joint="j1"/></actuator>', classes)
    assert reading(tmp_path, text).links[0].joint.limits.effort == 3.0


def test_links_between_several_joints_are_massless(tmp_path: Path) -> None:
    robot = reading(tmp_path, FILES["several joints on a body"])
    assert [link.name for link in robot.links] == ["a/x", "a/t", "a", "b/u", "b"]
    assert [link.massless for link in robot.links] == [True, True, False, True, False]
    assert len(robot.parameter_names) == 21
    assert robot.parameter_names[-1] == "z.rotor_inertia"


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
            data.qvel[places] = mechanism.equations.rates(column(q), column(v)).of
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


def test_an_equality_without_coefficients_is_one_to_one(tmp_path: Path) -> None:
    robot = reading(tmp_path, mjcf(GEARED, '<equality><joint joint1="j1" joint2="j2"/></equality>'))
    assert robot.loops is not None
    (coupling,) = robot.loops.couplings
    assert (coupling.name, coupling.ratio, coupling.offset) == ("joint1", 1.0, 0.0)


def test_what_is_not_active_binds_nothing(tmp_path: Path) -> None:
    pin = CLOSED["connect"]
    for text in (
        linkage(pin.replace("<connect", '<connect active="false"')),
        linkage(pin.replace("<connect", '<connect class="off"'), before=OFF),
        linkage(pin, before='<option><flag equality="disable"/></option>'),
    ):
        assert reading(tmp_path, text).loops is None


OFF = '<default><default class="off"><equality active="false"/></default></default>'


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
    u = np.array(mechanism.equations.rates(column(q), column(v)).of)
    h, inverse = 1e-5, np.argsort(places)
    forth, back = (state(q + s * u, u)[2] for s in (h, -h))
    M, bias, J = state(q, u)
    driven = np.zeros(3)
    driven[places[mechanism.description.primary[0]]] = torque[0]
    drift = -np.linalg.pinv(J, rcond=1e-8) @ ((forth - back) / (2 * h) @ u[inverse])
    free = np.linalg.svd(J)[2][2:].T
    a = drift + free @ np.linalg.solve(free.T @ M @ free, free.T @ (driven - bias - M @ drift))
    np.testing.assert_allclose(mechanism.forward_dynamics(p, v, torque), a[places][:1], rtol=1e-7)


def test_a_file_is_read_by_its_suffix_and_its_rank_found(tmp_path: Path) -> None:
    (tmp_path / "bars.xml").write_text(linkage(CLOSED["connect"]))
    assert read(tmp_path / "bars.xml").loops is not None
    mechanism = load(tmp_path / "bars.xml")
    assert mechanism.dof == 1
    found = essential_space(mechanism)
    assert found.rank == essential_space(mechanism, seed=1).rank
    assert found.certificate.gap > 1e6


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    for text, message in (
        (mjcf(chain('stiffness="3"')), r"robot\.xml: springs of joints are left out: j1"),
        (
            mjcf(chain().replace('name="b"', 'name="b" gravcomp="1"')),
            r"robot\.xml: gravity compensation is left out: b",
        ),
        (
            mjcf(chain(), '<tendon><fixed name="t"><joint joint="j1" coef="1"/></fixed></tendon>'),
            r"robot\.xml: tendons are left out: fixed 't'",
        ),
    ):
        with pytest.warns(SimplificationWarning, match=message):
            reading(tmp_path, text)


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
        (ONE.replace("<worldbody>", '<include file="x.xml"/><worldbody>'), "<include> is not read: put the other file"),
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
        (mjcf(chain('armature="-1"')), r"joint 'j1': rotor_inertia: expected a finite number of at least 0, got -1\.0"),
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
            "loops need primary joints, and no actuator drives a joint",
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
    deep = 300
    text = "".join(f'<body><joint name="j{i}"/>{BODY}' for i in range(deep)) + "</body>" * deep
    assert len(reading(tmp_path, mjcf(text)).links) == deep
