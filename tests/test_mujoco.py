"""MuJoCo as a neighbour: scenes, models read and made, and MuJoCo as the plant."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from mjcf_files import BODY, chain, mjcf
from nightly import nightly

import adaptctl
from adaptctl.cli.main import main
from adaptctl.control import ComputedTorque, Sinusoids
from adaptctl.description import builtin_file
from adaptctl.description.drive import Drive
from adaptctl.description.readers.mujoco_arm import servo
from adaptctl.dynamics import Mechanism
from adaptctl.envs import MuJoCoTrackingEnv
from adaptctl.errors import (
    FileError,
    InputError,
    NonFiniteError,
    PhysicalConsistencyWarning,
    SimplificationWarning,
)
from adaptctl.experiments.adaptive import AdaptiveTracking
from adaptctl.hardware import MuJoCoRobot
from adaptctl.simulation import simulate_many
from adaptctl.simulation.mujoco_plant import MuJoCoPlant

BOX = '<body name="box" pos="1 0 0.05"><freejoint/><geom type="box" size=".05 .05 .05" density="100"/></body>'
OTHER = chain().replace('"a"', '"z"').replace('"b"', '"y"').replace('"j', '"k')
LIMITED = chain('range="-90 90"')
STAND = f'<body name="stand" pos="0 0 1" euler="0 0 30">{LIMITED}</body>'
SERVO = '<actuator><motor joint="j1" ctrlrange="-9 9"/><position name="hold" joint="j2" kp="50"/></actuator>'
CART = (
    '<body name="cart"><joint name="rail" type="slide"/><geom size=".1"/>'
    f'<body name="stand">{chain()}</body></body><body name="free"><freejoint/><geom size=".1"/></body>'
)


def written(folder: Path, text: str, name: str = "scene.xml") -> Path:
    (folder / name).write_text(text)
    return folder / name


def same_torques(one: Mechanism, other: Mechanism, bound: float = 1e-12) -> None:
    p, v, a = np.random.default_rng(0).uniform(-1, 1, (3, 5, one.dof))
    expected = one.inverse_dynamics(p, v, a)
    np.testing.assert_allclose(other.inverse_dynamics(p, v, a), expected, rtol=0, atol=bound * np.abs(expected).max())


@pytest.mark.parametrize(
    ("world", "root"), [(BOX + STAND, "stand"), (OTHER + STAND + BOX, "a"), (OTHER + STAND, "stand")]
)
def test_an_arm_is_picked_out_of_a_scene_as_if_it_stood_alone(tmp_path: Path, world: str, root: str) -> None:
    alone = adaptctl.load(written(tmp_path, mjcf(STAND), "alone.xml"))
    path = written(tmp_path, mjcf(world))
    picked = adaptctl.load(path, root=root)
    compiled = adaptctl.load(mujoco.MjModel.from_xml_path(str(path)), root=root)
    for arm in (picked, compiled):
        assert [link.name for link in arm.links] == ["a", "b"]
        assert arm.primary_joints[0].limits.upper == pytest.approx(np.pi / 2)
        same_torques(alone, arm)


def test_physics_of_mujoco_are_not_taken_for_our_own() -> None:
    plant = MuJoCoPlant.of("puma560_measured", 1e-3)
    law, still = ComputedTorque(plant.mechanism, 8.0), Sinusoids(*np.zeros((3, 6)))
    with pytest.raises(InputError, match="simulate_many: MuJoCoPlant has a custom step: use `rollout`"):
        simulate_many(plant, law, still, duration=0.1)


def test_floating_bodies_are_objects_of_a_compiled_scene() -> None:
    arm = Mechanism.from_mujoco(mujoco.MjModel.from_xml_string(mjcf(BOX + STAND)))
    assert [joint.name for joint in arm.primary_joints] == ["j1", "j2"]


def test_scenes_of_several_files_are_read_as_one(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    written(tmp_path, f"<mujocoinclude>{chain()}</mujocoinclude>", "parts/arm.xml")
    written(tmp_path, '<mujoco><option gravity="0 0 -1"/><include file="parts/more.xml"/></mujoco>', "option.xml")
    written(tmp_path, "<mujoco><default><geom density='10'/></default></mujoco>", "parts/more.xml")
    world = f'<worldbody><include file="parts/arm.xml"/>{BOX}</worldbody>'
    path = written(tmp_path, f'<mujoco><include file="option.xml"/>{world}</mujoco>')
    same_torques(Mechanism.from_mujoco(mujoco.MjModel.from_xml_path(str(path))), adaptctl.load(path, root="a"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('<include file="/etc/passwd"/>', "outside the file's folder"),
        ('<include file="../scene.xml"/>', "outside the file's folder"),
        ('<include file="scene.xml"/>', "'scene.xml' is included twice"),
        ('<include file="none.xml"/>', "include> of 'none.xml': .*cannot be read"),
        ('<include file="wrong.xml"/>', "include> of 'wrong.xml': .*expected|must be <mujocoinclude>"),
        ("<include/>", "needs the attribute file"),
    ],
)
def test_includes_that_are_refused(tmp_path: Path, text: str, message: str) -> None:
    written(tmp_path, "<robot/>", "wrong.xml")
    with pytest.raises(FileError, match=message):
        adaptctl.load(written(tmp_path, f"<mujoco>{text}<worldbody>{chain()}</worldbody></mujoco>"))


@pytest.mark.parametrize(
    ("world", "root", "error", "message"),
    [
        (STAND, "stnad", InputError, "unknown body 'stnad' \\(did you mean 'stand'"),
        (STAND + OTHER, None, InputError, "stand.* and .*z|'stand', 'z'"),
        (CART, "stand", InputError, "is attached to 'cart', which moves"),
        (f'<body name="block">{BODY}</body>{STAND}', "block", InputError, "no moving joint"),
    ],
)
def test_roots_that_are_refused_by_both_readers(
    tmp_path: Path, world: str, root: str | None, error: type[Exception], message: str
) -> None:
    path = written(tmp_path, mjcf(world))
    with pytest.raises(error, match=message):
        adaptctl.load(path, root=root)
    with pytest.raises(error, match=message):
        adaptctl.load(mujoco.MjModel.from_xml_path(str(path)), root=root)


def test_a_root_is_for_scenes_only() -> None:
    with pytest.raises(InputError, match="root: only for MJCF files"):
        adaptctl.load("puma560", root="a")
    with pytest.raises(InputError, match=r"expected a robot's name, a file, a pinocchio\.Model or a mujoco\.MjModel"):
        adaptctl.load(3)


def test_equalities_of_the_rest_are_left_out_and_those_between_arms_refused(tmp_path: Path) -> None:
    gripper = OTHER + STAND
    apart = '<equality><joint joint1="k1" joint2="k2"/></equality>'
    across = '<equality><weld name="grip" body1="b" body2="y"/></equality>'
    for text in (mjcf(gripper, apart),):
        assert adaptctl.load(written(tmp_path, text), root="stand").description.loops is None
        assert Mechanism.from_mujoco(mujoco.MjModel.from_xml_string(text), "stand").dof == 2
    with pytest.raises(InputError, match="body 'y' is not part of"):
        adaptctl.load(written(tmp_path, mjcf(gripper, across)), root="stand")
    with pytest.raises(InputError, match="body 'y' is not part of"):
        Mechanism.from_mujoco(mujoco.MjModel.from_xml_string(mjcf(gripper, across)), "stand")


@pytest.mark.parametrize(
    ("kinds", "gain", "bias", "said"),
    [
        ((0, 0, 0), [5.0, 7.0, 9.0], [0.0, -5.0, -1.0], ""),
        ((1, 0, 0), [5.0, 7.0, 9.0], [0.0, 0.0, 0.0], "actuator dynamics"),
        ((0, 0, 1), [5.0, 7.0, 9.0], [2.0, -5.0, -1.0], "a position servo"),
        ((0, 0, 1), [5.0, 7.0, 9.0], [2.0, 0.0, -5.0], "a velocity servo"),
        ((0, 0, 1), [5.0, 7.0, 9.0], [2.0, -1.0, -5.0], "state-dependent force"),
        ((0, 0, 1), [0.0, 7.0, 9.0], [2.0, 0.0, 0.0], "state-dependent force"),
        ((0, 1, 1), [5.0, 7.0, 9.0], [2.0, -5.0, 0.0], "state-dependent force"),
        ((0, 1, 1), [5.0, 7.0, 9.0], [2.0, 0.0, -5.0], "state-dependent force"),
    ],
)
def test_servos_are_told_by_gain_and_bias(
    kinds: tuple[int, int, int], gain: list[float], bias: list[float], said: str
) -> None:
    """MuJoCo's force is gain u + bias: constants and factors of position and of velocity."""
    names = ("actuator_dyntype", "actuator_gaintype", "actuator_biastype")
    model: Any = SimpleNamespace(
        **{name: [kind] for name, kind in zip(names, kinds, strict=True)},
        actuator_gainprm=[gain],
        actuator_biasprm=[bias],
    )
    assert servo(model, 0) == said


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PlausibilityWarning")
def test_servos_are_named_as_what_they_are(tmp_path: Path) -> None:
    path = written(tmp_path, mjcf(STAND, SERVO))
    with pytest.warns(SimplificationWarning, match=r"without torque input .*'hold' \(a position servo\)"):
        adaptctl.load(path)
    model = mujoco.MjModel.from_xml_path(str(path))
    with pytest.warns(SimplificationWarning, match=r"without torque input .*'hold' \(a position servo\)"):
        arm = Mechanism.from_mujoco(model)
    assert arm.effort_limits.tolist() == [9.0, np.inf]
    with (
        pytest.warns(SimplificationWarning),
        pytest.raises(InputError, match=r"'hold' \(a position servo\).*servos_off"),
    ):
        MuJoCoPlant.of(model, 1e-3)
    with pytest.warns(SimplificationWarning):
        plant = MuJoCoRobot(model, 1e-3).plant
    free = MuJoCoPlant.of(mujoco.MjModel.from_xml_string(mjcf(STAND)), 1e-3, torque_limits=[9.0, np.inf])
    one, other = (each.init([0.3, -0.2], [0.0, 0.0]) for each in (plant, free))
    for _ in range(50):
        one, other = plant.step(one, [1.0, 2.0]), free.step(other, [1.0, 2.0])
    np.testing.assert_array_equal(one.p, other.p)
    assert model.actuator_gainprm[1, 0] == 50.0  # the user's own model is as it was


def test_models_that_are_made_have_the_same_torques_and_drives() -> None:
    arm = adaptctl.load("puma560_measured")
    rough = arm.with_drives([Drive(0.1 * k, 0.2, 0.3) for k in range(6)])
    back = Mechanism.from_mujoco(rough.to_mujoco())
    same_torques(arm.with_drives(Drive()), back.with_drives(Drive()))
    assert [link.joint.drive for link in back.links][1:] == [link.joint.drive for link in rough.links][1:]
    np.testing.assert_allclose(back.effort_limits, arm.effort_limits)
    assert [joint.limits.lower for joint in back.primary_joints] == [joint.limits.lower for joint in arm.primary_joints]


def test_what_mujoco_cannot_be() -> None:
    with pytest.warns(PhysicalConsistencyWarning):
        assigned = adaptctl.load("puma560")
    with pytest.raises(InputError, match=r"inertia of .* is not physically consistent"):
        assigned.to_mujoco()
    with pytest.raises(InputError, match="models of loops and coupled drives are not supported"):
        adaptctl.load("semi_direct_drive").to_mujoco()
    bent = adaptctl.load("puma560_measured").with_drives(Drive(stribeck=0.2))
    with pytest.raises(InputError, match="joint 'joint1': MuJoCo supports only viscous and Coulomb friction"):
        bent.to_mujoco()


def test_the_plant_moves_as_mujoco_does_and_is_a_function_of_its_state() -> None:
    model = mujoco.MjModel.from_xml_string(mjcf(BOX + STAND))
    plant, data = MuJoCoPlant.of(model, 0.01), mujoco.MjData(model)
    state = first = plant.init([0.2, 0.1], [0.0, 0.5])
    joints = [int(model.joint(name).qposadr[0]) for name in ("j1", "j2")]
    speeds = [int(model.joint(name).dofadr[0]) for name in ("j1", "j2")]
    data.qpos[joints], data.qvel[speeds] = state.p, state.v
    for _ in range(20):
        state = plant.step(state, [3.0, -2.0])
        data.qfrc_applied[speeds] = [3.0, -2.0]
        mujoco.mj_step(model, data, 5)
    np.testing.assert_array_equal(state.p, data.qpos[joints])
    assert state.time == pytest.approx(0.2)
    again = first
    for _ in range(20):
        again = plant.step(again, [3.0, -2.0])
    np.testing.assert_array_equal(again.p, state.p)


def test_without_contacts_both_plants_agree_the_better_the_shorter_the_steps() -> None:
    arm = adaptctl.load("puma560_measured")
    apart = []
    for step in (2e-3, 5e-4):
        model = arm.to_mujoco()
        model.opt.timestep = step
        plants = (adaptctl.Plant(arm, 2e-3), MuJoCoPlant.of(arm, 2e-3))
        plants = (plants[0], MuJoCoPlant(arm, 2e-3, model=model))
        states = [plant.init(0.3 * np.ones(6), np.zeros(6)) for plant in plants]
        for _ in range(50):
            states = [
                plant.step(state, [1.0, 40.0, 8.0, 0.0, 0.0, 0.0]) for plant, state in zip(plants, states, strict=True)
            ]
        apart.append(float(np.abs(states[0].p - states[1].p).max()))
    assert 3.0 < apart[0] / apart[1] < 5.5  # of first order
    assert apart[1] < 2e-3


def test_true_parameters_and_payloads_reach_mujoco() -> None:
    arm = adaptctl.load("puma560_measured")
    changed = np.array(arm.inertial_parameters)
    changed[50] += 2.0
    plants, true = (adaptctl.Plant(arm, 1e-3, 4), MuJoCoPlant.of(arm, 1e-3)), (arm.inertial_parameters, changed)
    light, heavy = [], []
    for plant in plants:
        states = [plant.init(0.3 * np.ones(6), np.zeros(6), D) for D in true]
        for _ in range(100):
            states = [plant.step(s, np.zeros(6), D) for s, D in zip(states, true, strict=True)]
        light.append(states[0].p), heavy.append(states[1].p)
    np.testing.assert_allclose(light[0], light[1], atol=1e-3)
    np.testing.assert_allclose(heavy[0], heavy[1], atol=1e-3)
    assert np.abs(light[0] - heavy[0]).max() > 5e-3


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        (Drive(stribeck=0.2), "joint 'joint1': MuJoCo supports only viscous and Coulomb friction"),
        (Drive(square_root=0.2), "supports only viscous and Coulomb friction"),
        (Drive(offset=0.2), "supports only viscous and Coulomb friction"),
        (Drive(viscous=0.2, turns_with=(("joint2", 0.5),)), "models of loops and coupled drives are not supported"),
    ],
)
def test_true_parameters_that_mujoco_has_no_place_for_are_refused(drive: Drive, message: str) -> None:
    arm = adaptctl.load("puma560_measured")
    rough = arm.with_drives([drive] + [Drive()] * 5)
    plant = MuJoCoPlant(rough, 1e-3, model=arm.to_mujoco())
    heavier = np.array(rough.inertial_parameters)
    heavier[50] += 2.0
    with pytest.raises(InputError, match=message):
        plant.init(np.zeros(6), np.zeros(6), heavier)


def test_a_step_is_a_function_of_what_it_is_given() -> None:
    """Other parameters are those of the calls that give them, and of no later one."""
    arm = adaptctl.load("puma560_measured")
    plant, heavier = MuJoCoPlant.of(arm, 1e-3), 1.5 * np.array(arm.inertial_parameters)
    start = plant.init(0.3 * np.ones(6), np.zeros(6))
    first, other, again = (plant.step(start, np.ones(6), D) for D in (None, heavier, None))
    np.testing.assert_array_equal(again.v, first.v)
    assert np.abs(other.v - first.v).max() > 1e-6
    plant.init(0.3 * np.ones(6), np.zeros(6), heavier)
    np.testing.assert_array_equal(plant.step(start, np.ones(6)).v, first.v)


def test_contacts_are_mujocos() -> None:
    wall = '<geom type="box" size="1 1 .1" pos="0 0 -.3"/>'
    swing = (
        '<body name="arm" pos="0 0 .2"><joint name="hinge" axis="0 1 0"/>'
        '<geom type="capsule" size=".03" fromto="0 0 0 .6 0 0"/></body>'
    )
    ends = []
    for world in (swing, wall + swing):
        plant = MuJoCoPlant.of(mujoco.MjModel.from_xml_string(mjcf(world)), 5e-3)
        state = plant.init([0.0], [0.0])
        for _ in range(100):
            state = plant.step(state, [0.0])
        ends.append(float(state.p[0]))
    assert ends[0] > 1.5 > ends[1]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"body": "nobody"}, "unknown body 'nobody'"),
        ({"control_period": 0.0}, "control_period: expected a positive time"),
        ({"torque_limits": -1.0}, "torque_limits: expected"),
        ({"robot": "none.xml"}, "none.xml: cannot be read"),
        ({"robot": "nobody"}, "unknown robot 'nobody'"),
    ],
)
def test_settings_that_are_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        MuJoCoTrackingEnv(**settings)


def test_actions_and_motions_that_are_refused() -> None:
    env = gymnasium.make("adaptctl/MuJoCoTracking-v0", reference=1)
    env.reset(seed=0)
    with pytest.raises(NonFiniteError, match="torque"):
        env.step(np.full(6, np.nan))
    with pytest.raises(InputError, match=r"expected shape \(6,\)"):
        env.step(np.zeros(5))
    with pytest.raises(InputError, match="effects are not supported"):
        MuJoCoPlant.of("puma560_measured", 1e-3, effects=(adaptctl.simulation.effects.ControlDelay(1),))
    with pytest.raises(InputError, match="expected a MuJoCo model"):
        MuJoCoPlant(adaptctl.load("puma560_measured"), 1e-3)


def test_a_motion_that_runs_away_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log there
    plant = MuJoCoPlant.of("puma560_measured", 1e-3, torque_limits=np.inf)

    def pushed() -> None:
        state = plant.init(np.zeros(6), np.zeros(6))
        for _ in range(50):
            state = plant.step(state, np.full(6, 1e150))

    with pytest.raises(NonFiniteError, match="the MuJoCo simulation diverged"):
        pushed()


def test_the_environment_keeps_gymnasiums_rules_and_controllers_drive_it() -> None:
    from gymnasium.utils.env_checker import check_env

    env = gymnasium.make("adaptctl/MuJoCoTracking-v0", reference=1, duration=0.2, initial_error=0.05)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r".*For Box action spaces, we recommend")  # ours are torques in N m
        check_env(env.unwrapped, skip_render_check=True)
    arm = env.unwrapped.mechanism
    controller = adaptctl.ComputedTorque(arm, 8.0)
    runs = [adaptctl.rollout(env, controller, seed=3) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].p, runs[1].p)
    assert np.abs(runs[0].error[-1]).max() < np.abs(runs[0].error[0]).max()
    with pytest.warns(adaptctl.errors.NotCompiledWarning, match="MuJoCoPlant has a custom step"):
        same = adaptctl.simulate(env, controller, seed=3)
    np.testing.assert_array_equal(same.p, runs[0].p)


SCENE = builtin_file("scene")


def test_experiments_run_on_mujoco(tmp_path: Path) -> None:
    run = ["experiment", "run", "adaptive", "--robot", str(SCENE), "--duration", "1"]
    assert main([*run, "--plant", "mujoco", "--out", str(tmp_path / "one")]) == 0
    summary = json.loads((tmp_path / "one" / "summary.json").read_text())
    errors = {name: run["rms_error"] for name, run in summary["runs"].items()}
    assert errors["learning"] < errors["adaptation-off"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--plant", "bullet"], "plant: expected adaptctl, mujoco or both, got 'bullet'"),
        (["--plant", "mujoco", "--root", "nobody", "--robot", str(SCENE)], "unknown body 'nobody'"),
        (["--plant", "mujoco", "--robot", "none.xml"], "none.xml: cannot be read"),
        (["--root", "stand"], "root: only for MJCF files"),
    ],
)
def test_command_lines_that_are_refused(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["experiment", "run", "adaptive", *options, "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_two_plants_differ_by_integration_and_by_contacts() -> None:
    free = AdaptiveTracking(plant="both", robot=str(SCENE), root="stand", duration=2.0).compare(lambda *_: None)
    found = {finding.name: finding.value for finding in free.findings}
    assert found["plants_apart_fine"] < 0.3 * found["plants_apart"] < 0.3e-2
    assert free.answer is not None
    assert "is caused by MuJoCo's integrator" in free.answer


def test_two_plants_are_not_one_twice() -> None:
    with pytest.raises(InputError, match="plant: expected adaptctl, mujoco or both, got 'twice'"):
        AdaptiveTracking(plant="twice")


@nightly
def test_stops_are_no_matter_of_integration(tmp_path: Path) -> None:
    stopped = SCENE.read_text().replace('range="-100 100"', 'range="-100 100" frictionloss="3"')
    path = written(tmp_path, stopped)
    compared = AdaptiveTracking(plant="both", robot=str(path), root="stand", duration=2.0).compare(lambda *_: None)
    assert compared.answer is not None
    assert "integration does not explain the difference" in compared.answer
