"""Bases of robots: held in every format, floating where that is asked for."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from robot_files import urdf

from adaptctl.cli.main import main
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import FileError, InputError, SimplificationWarning
from adaptctl.simulation.mujoco_plant import MuJoCoPlant, as_mujoco

HELD = "the base is held still, and floats with floating_base=True (--floating-base): trunk"
LOUD = "the base floats: in closed loop it is pushed by six ideal forces that no robot has"
TEN = '<inertial pos="{} .01 .02" mass="{}" diaginertia=".1 .2 .25"/>'
LEG = (
    '<body name="hip{0}" pos="0 {0} 0"><joint name="swing{0}" axis="1 0 0"/>{1}'
    '<body name="shank{0}" pos="0 0 -.3"><joint name="knee{0}" axis="0 1 0"/>{2}</body></body>'
)
LEGS = "".join(LEG.format(side, TEN.format(0.02, 0.5), TEN.format(0, 0.2)) for side in ("1", "-1"))
TRUNK = f'<body name="trunk" pos="0 0 .5" euler="0 0 30">FREE{TEN.format(0.1, 4)}{LEGS}</body>'
JOINTS = ("swing1", "knee1", "swing-1", "knee-1")
MOTORS = "".join(f'<motor joint="{name}" ctrlrange="-20 20"/>' for name in JOINTS)
SIX = tuple(f"trunk_{suffix}" for suffix in ("x", "y", "z", "yaw", "pitch", "roll"))
BOX = '<body name="box" pos="1 0 .1"><freejoint/><geom size=".1"/></body>'


def scene(folder: Path, free: str = "<freejoint/>", more: str = "") -> Path:
    (folder / "legs.xml").write_text(
        f"<mujoco><worldbody>{TRUNK.replace('FREE', free)}{more}</worldbody><actuator>{MOTORS}</actuator></mujoco>"
    )
    return folder / "legs.xml"


def energies_are_mujocos(held: Mechanism, model: mujoco.MjModel) -> None:
    """Of a base that stands still: MuJoCo's mass matrix and gravity torques without the free joint's rows."""
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    full, first = np.empty((model.nv, model.nv)), model.nv - held.dof
    for p in rng.uniform(-2.0, 2.0, (5, held.dof)):
        data.qpos[-held.dof :] = p
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        np.testing.assert_allclose(held.mass_matrix(p), full[first:, first:], atol=1e-12)
        bias = held.inverse_dynamics(p, 0 * p, 0 * p)
        np.testing.assert_allclose(bias, data.qfrc_bias[first:], atol=1e-12)


@pytest.mark.parametrize("more", ["", BOX])
def test_mjcf_holds_a_free_base_and_says_so(tmp_path: Path, more: str) -> None:
    path = scene(tmp_path, more=more)
    with pytest.warns(SimplificationWarning) as said:
        held = load(path)
    assert [str(one.message) for one in said] == [f"{path}: {HELD}"]
    assert held.description.joint_names == JOINTS
    model = mujoco.MjModel.from_xml_string(path.read_text().replace(BOX, ""))
    energies_are_mujocos(held, model)
    with pytest.warns(SimplificationWarning, match="MuJoCo model, body 'trunk': the base is held still"):
        compiled = load(mujoco.MjModel.from_xml_path(str(path)))
    np.testing.assert_allclose(compiled.mass_matrix([0.1, 0.2, 0.3, 0.4]), held.mass_matrix([0.1, 0.2, 0.3, 0.4]))


@pytest.mark.parametrize("free", ["<freejoint/>", ""])
def test_mjcf_floats_on_request_with_or_without_a_free_joint(tmp_path: Path, free: str) -> None:
    path = scene(tmp_path, free, BOX)
    with pytest.warns(SimplificationWarning) as said:
        floating = load(path, floating_base=True)
    assert [str(one.message) for one in said] == [f"{path}: {LOUD}"]
    assert floating.description.joint_names == (*SIX, *JOINTS)
    total = sum(link.inertia[0] for link in floating.links)
    assert total == pytest.approx(4.0 + 2 * 0.7)
    assert floating.mass_matrix(np.zeros(10))[0, 0] == pytest.approx(total)


def test_a_body_that_turns_on_its_own_joint_is_no_base(tmp_path: Path) -> None:
    path = scene(tmp_path, '<joint name="own"/>')
    with pytest.raises(FileError, match=r"body 'trunk' moves on a joint of its own, 'own': there is no base to float"):
        load(path, floating_base=True)


def test_what_only_floats_names_the_flag(tmp_path: Path) -> None:
    (tmp_path / "drone.xml").write_text(f"<mujoco><worldbody>{BOX}</worldbody></mujoco>")
    with pytest.raises(FileError, match=r"no moving joint: .*; the base 'box' is held still.*--floating-base"):
        load(tmp_path / "drone.xml")
    with pytest.warns(SimplificationWarning, match="pushed by six ideal forces"):
        assert load(tmp_path / "drone.xml", floating_base=True).dof == 6


def test_a_held_base_may_have_armature(tmp_path: Path) -> None:
    path = scene(tmp_path, '<joint type="free" armature=".1" damping="2"/>')
    with pytest.warns(SimplificationWarning, match="the base is held still"):
        assert load(path).dof == 4


def test_the_mesh_of_a_held_base_need_not_be_there(tmp_path: Path) -> None:
    """Its inertia plays no part; that of a floating base does."""
    mesh = '<mujoco><asset><mesh name="m" file="gone.stl"/></asset>'
    path = scene(tmp_path, '<geom type="mesh" mesh="m"/>')
    path.write_text(path.read_text().replace("<mujoco>", mesh).replace(TEN.format(0.1, 4), ""))
    assert load(path).dof == 4
    with pytest.raises(FileError, match=r"mesh 'm': no such file: 'gone.stl'|no such file"):
        load(path, floating_base=True)


def test_the_only_mechanism_with_motors_is_meant(tmp_path: Path) -> None:
    """Of a door beside a robot: named, and left out also of MuJoCo's plant."""
    door = '<body name="door" pos="2 0 0"><joint name="hinge"/><geom size=".1"/></body>'
    path = scene(tmp_path, "", door)
    with pytest.warns(SimplificationWarning) as said:
        robot = load(path)
    left_out = "other bodies that move, but have no actuator, are left out: door"
    assert [str(one.message) for one in said] == [f"{path}: {left_out}"]
    assert robot.description.joint_names == JOINTS
    with pytest.warns(SimplificationWarning, match=left_out):
        assert MuJoCoPlant.of(path, 1e-3).mechanism.dof == 4
    assert load(path, root="door").description.joint_names == ("hinge",)
    both = path.read_text().replace("</actuator>", '<motor joint="hinge"/></actuator>')
    (tmp_path / "both.xml").write_text(both)
    with pytest.raises(FileError, match=r"2 root bodies move, 'trunk', 'door', .* \(--root trunk\)"):
        load(tmp_path / "both.xml")


def test_mujocos_plant_holds_the_base_of_a_file(tmp_path: Path) -> None:
    """As the controller's model does: without torques the legs swing, and the trunk stays where it is."""
    path = scene(tmp_path, more=BOX)
    with pytest.warns(SimplificationWarning, match="the base is held still: trunk"):
        model = as_mujoco(path)
    assert (model.nv, model.njnt) == (10, 5)  # four hinges, and the box
    plant = MuJoCoPlant.of(model, 1e-3)
    assert [joint.name for joint in plant.mechanism.primary_joints] == list(JOINTS)
    with (
        pytest.warns(SimplificationWarning, match="the base is held still"),
        pytest.raises(InputError, match="the base 'trunk' floats in this MuJoCo model"),
    ):
        MuJoCoPlant.of(mujoco.MjModel.from_xml_path(str(path)), 1e-3)


LINK = (
    '<link name="{}"><inertial><mass value="1"/><origin xyz="0 0 .1"/>'
    '<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
EDGE = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><axis xyz="0 1 0"/></joint>'


def tree(folder: Path, *edges: tuple[str, str, str, str]) -> Path:
    names = dict.fromkeys(name for edge in edges for name in edge[2:])
    links = "".join(LINK.format(name) for name in names).replace(LINK.format("world"), '<link name="world"/>')
    (folder / "tree.urdf").write_text(f'<robot name="tree">{links}{"".join(EDGE.format(*e) for e in edges)}</robot>')
    return folder / "tree.urdf"


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_urdf_holds_what_stands_on_a_floating_joint(tmp_path: Path, kind: str) -> None:
    path = tree(tmp_path, ("base", kind, "world", "trunk"), ("hip", "continuous", "trunk", "leg"))
    with pytest.warns(SimplificationWarning) as said:
        held = load(path)
    assert [str(one.message) for one in said] == [f"{path}: {HELD}"]
    assert held.description.joint_names == ("hip",)
    with pytest.warns(SimplificationWarning) as said:
        floating = load(path, floating_base=True)
    assert [str(one.message) for one in said] == [f"{path}: {LOUD}"]
    assert floating.mass_matrix(np.zeros(7))[0, 0] == pytest.approx(2.0)


def test_urdf_says_that_a_heavy_base_with_limbs_is_held(tmp_path: Path) -> None:
    legs = [(f"{name}{k}", "continuous", *ends) for k in "12" for name, ends in
            (("hip", ("trunk", f"thigh{k}")), ("knee", (f"thigh{k}", f"shank{k}")))]  # fmt: skip
    with pytest.warns(SimplificationWarning) as said:
        load(tree(tmp_path, *legs))
    assert [str(one.message) for one in said] == [f"{tmp_path / 'tree.urdf'}: {HELD}"]
    load(tree(tmp_path, *legs[:2]))  # an arm on the ground: no warning


def test_commands_say_what_floats_once(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = str(scene(tmp_path))
    for command in ("basis", "gains"):
        assert main([command, path, "--json"]) == 0
        assert capsys.readouterr().err == f"adaptctl: note: {path}: {HELD}\n"
        assert main([command, path, "--floating-base", "--json"]) == 0
        assert capsys.readouterr().err == f"adaptctl: note: {path}: {LOUD}\n"


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
def test_estimates_go_back_into_the_file_of_a_floating_robot(tmp_path: Path) -> None:
    for source in (scene(tmp_path), urdf("double_pendulum.urdf")):
        for floating_base in (False, True):
            robot = load(source, floating_base=floating_base)
            inertias = np.arange(len(robot.parameter_names)) < robot.num_energy_parameters
            heavier = robot.with_parameters(np.where(inertias, 1.5, 1.0) * robot.inertial_parameters)
            heavier.write_into(source, tmp_path / f"heavier{source.suffix}")
            again = load(tmp_path / f"heavier{source.suffix}", floating_base=floating_base)
            np.testing.assert_allclose(again.inertial_parameters, heavier.inertial_parameters, atol=1e-12)
