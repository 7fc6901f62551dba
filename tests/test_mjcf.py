"""MJCF: trees and inertias against MuJoCo itself; names, limits, drives, and what is left out."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mjcf_files import (
    BODY,
    CLOSED,
    FULL,
    TILTED,
    chain,
    linkage,
    mjcf,
    reading,
    same_motion,
)

from adaptctl.description import JointKind, Limits, read
from adaptctl.dynamics import load
from adaptctl.errors import SimplificationWarning
from adaptctl.identifiability import essential_space

pytestmark = pytest.mark.usefixtures("elsewhere")

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
    "a shell": mjcf(chain(inertia1='<geom size=".1" shellinertia="true"/>')),
    "copies": mjcf(
        chain(
            more='<replicate count="3" euler="0 0 40"><body name="c" pos="1 0 0"><geom size=".1"/></body></replicate>'
        )
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
    with pytest.warns(
        SimplificationWarning, match=r"actuators without torque input .*'actuator 1' \(a position servo\)"
    ):
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
        ('range="-1 1" limited="false"', '<compiler autolimits="false"/>', Limits()),
        ('range="-90 90" limited="false"', "", Limits()),
        ('range="-90 90" limited="true"', '<compiler autolimits="false"/>', Limits(-math.pi / 2, math.pi / 2)),
        ('range="-1 1"', '<compiler angle="radian"/>', Limits(-1, 1)),
        ('actuatorfrcrange="-7 5"', "", Limits(effort=7)),
    ],
)
def test_limits(tmp_path: Path, joint: str, before: str, expected: Limits) -> None:
    assert reading(tmp_path, mjcf(chain(joint), before=before)).links[0].joint.limits == expected


@pytest.mark.filterwarnings("ignore:.*no actuator drives these joints:adaptctl.errors.SimplificationWarning")
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
        (mjcf(chain('stiffness="3 1"')), r"robot\.xml: joint springs that are not linear are ignored: j1"),
        (
            mjcf(chain().replace('name="b"', 'name="b" gravcomp="1"')),
            r"robot\.xml: gravity compensation is ignored: b",
        ),
        (
            mjcf(chain(), '<tendon><fixed name="t"><joint joint="j1" coef="1"/></fixed></tendon>'),
            r"robot\.xml: tendons are ignored: fixed 't'",
        ),
    ):
        with pytest.warns(SimplificationWarning, match=message):
            reading(tmp_path, text)
