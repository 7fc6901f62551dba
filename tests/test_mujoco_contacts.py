"""Contacts of MuJoCo's arms along their references: found, told, and kept clear of."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from comparisons import comparison
from nightly import nightly
from rerun.chunk import RrdReader

import adaptctl
from adaptctl.cli.main import main
from adaptctl.control import PDGravity
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.envs import ContactEnv, MuJoCoTrackingEnv
from adaptctl.envs.contact import CLEARANCE, INTO, LINK, TOOL, beside, joint_path, surroundings_of
from adaptctl.errors import InputError, ReferenceWarning
from adaptctl.experiments.contact import Contact
from adaptctl.experiments.push_findings import answer_of_push, findings_of_push
from adaptctl.recording import ControllerRun
from adaptctl.recording.contact_force import contact_forces, contact_points
from adaptctl.recording.rerun_recording import write_recording
from adaptctl.recording.summary import summary
from adaptctl.recording.touches import touches
from adaptctl.simulation import HandPush
from adaptctl.simulation.mujoco_plant import MuJoCoPlant, clear_of_contacts, contacts_along, contacts_at

SCENE = """
<mujoco><option timestep="0.001"/><worldbody>
  <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -1"/>
  <body name="post" pos="{post} 0 0"><geom type="capsule" size=".05 .5"/></body>
  <body name="ball" pos="2 0 -.9"><freejoint/><geom size=".1"/></body>
  <body name="upper"><joint name="a" axis="0 0 1" range="-170 170"/>
    <geom type="capsule" size=".03" fromto="0.1 0 0 .4 0 0"/>
    <body name="fore" pos=".4 0 0"><joint name="b" axis="0 0 1" range="-170 170"/>
      <geom type="capsule" size=".03" fromto="0.1 0 0 .4 0 0"/></body></body>
</worldbody>
<actuator><motor joint="a" ctrlrange="-20 20"/><motor joint="b" ctrlrange="-10 10"/></actuator></mujoco>
"""


def scene(folder: Path, post: float = -0.6) -> Path:
    (folder / "scene.xml").write_text(SCENE.format(post=post))
    return folder / "scene.xml"


def reference(center: float, amplitude: float = 0.3) -> Sinusoids:
    return Sinusoids(np.array([center, 0.0]), np.array([amplitude, 0.1]), np.array([0.1, 0.2]))


def plant(path: Path) -> MuJoCoPlant:
    return MuJoCoPlant.of(str(path), 1e-3)


def test_contacts_are_those_of_the_arm_alone(tmp_path: Path) -> None:
    arm = plant(scene(tmp_path))
    turned = np.array([[0.0, 0.0], [np.pi, 0.0], [0.0, 2.9], [np.pi, 0.0]])
    assert contacts_at(arm, turned) == {("post", "fore"): 2}
    assert not contacts_along(arm, reference(0.0))
    assert contacts_along(arm, reference(3.0))["post", "fore"] > 20


@pytest.mark.filterwarnings("ignore:reference. a goes to:adaptctl.errors.ReferenceWarning")
def test_a_reference_that_touches_something_is_told_of(tmp_path: Path) -> None:
    path = scene(tmp_path)
    MuJoCoTrackingEnv(str(path), reference(0.0))
    with pytest.warns(ReferenceWarning, match=r"'post' and 'fore' are in contact at \d+ of 201 times, but the model"):
        MuJoCoTrackingEnv(str(path), reference(3.0))


def test_references_are_drawn_in_until_nothing_touches(tmp_path: Path) -> None:
    arm, free = plant(scene(tmp_path)), reference(0.0)
    assert clear_of_contacts(arm, free) is free
    clear = clear_of_contacts(arm, reference(3.0))
    assert not contacts_along(arm, clear)
    assert 0.5 < clear.center[0] < 3.0
    np.testing.assert_allclose(clear.amplitude[0, 0] / 0.3, clear.center[0] / 3.0)


def test_a_scene_whose_arm_begins_in_contact_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no contact-free motion .*: 'post' and 'fore' are in contact"):
        clear_of_contacts(plant(scene(tmp_path, post=0.6)), reference(0.0))


@nightly
def test_the_experiment_keeps_clear(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The post stands where the reference of this seed would go; without it the arm learns as well."""
    model = mujoco.MjModel.from_xml_path(str(scene(tmp_path)))
    drawn = adaptctl.tune(adaptctl.Mechanism.from_mujoco(model), seed=3).reference
    swing = drawn(np.linspace(0.0, 6.0, 601)).p
    a, b = swing[np.abs(swing).sum(axis=1).argmax()]  # far from the scene's own posture, which is to stay free
    end = 0.4 * np.array([np.cos(a), np.sin(a)]) + 0.3 * np.array([np.cos(a + b), np.sin(a + b)])
    text = SCENE.format(post=0).replace('pos="0 0 0"', f'pos="{end[0]:.3f} {end[1]:.3f} 0"')
    (tmp_path / "scene.xml").write_text(text)
    arm = plant(tmp_path / "scene.xml")
    assert contacts_along(arm, drawn)
    out = tmp_path / "out"
    command = ["experiment", "run", "adaptive", "--robot", str(tmp_path / "scene.xml"), "--plant", "mujoco"]
    assert main([*command, "--seed", "3", "--duration", "6", "--out", str(out), "--overwrite"]) == 0, (
        capsys.readouterr()
    )
    found = json.loads((out / "summary.json").read_text())
    assert found["final_rms_error"] < 0.5 * found["final_rms_error_adaptation_off"]


RESTING = """
<mujoco><option timestep="0.001"/><worldbody>
  <geom name="block" type="box" size=".1 .1 .1" pos=".5 .03 -.12"/>
  <body name="rod"><joint name="a" axis="0 1 0"/>
    <inertial mass="2" pos=".2 0 0" diaginertia=".01 .01 .01"/>
    <geom type="sphere" size=".02 .02 .02" pos=".5 .03 0"/></body>
</worldbody><actuator><motor joint="a" ctrlrange="-20 20"/></actuator></mujoco>
"""


@pytest.mark.parametrize("shapes", [("box", "sphere"), ("sphere", "box")])
def test_the_force_of_a_contact_is_told_with_its_point(tmp_path: Path, shapes: tuple[str, str]) -> None:
    """A rod that rests on a block: the moment of the block's force is that of its weight, less the motor's. MuJoCo
    names a sphere before a box."""
    block, tip = shapes
    text = RESTING.replace('"box"', f'"{block}"').replace('"sphere" size=".02', f'"{tip}" size=".02')
    (tmp_path / "rod.xml").write_text(text)
    arm = plant(tmp_path / "rod.xml")
    state = arm.init([0.0], [0.0])
    for _ in range(1000):
        state = arm.step(state, [-1.5])
    told = dict(zip(arm.flags, state.flags, strict=True))
    assert told["contact_force_z"] == pytest.approx((2.0 * 9.81 * 0.2 - 1.5) / 0.5, rel=1e-3)
    place = [told[f"contact_point_{axis}"] for axis in "xyz"]
    np.testing.assert_allclose(place, [0.5, 0.03, -0.02], atol=2e-3)
    lifted = arm.step(arm.init([-0.5], [0.0]), [0.0])
    assert not lifted.flags.any()


SKYWARD = HandPush([0.0, 0.0, 10.0], start=0.0005, duration=0.002, point=[0.5, 0.03, 0.0])


def test_a_push_turns_a_rod_by_its_moment_and_is_told(tmp_path: Path) -> None:
    """Against m l^2 + I of the rod, once the push has begun and until it has ended."""
    (tmp_path / "rod.xml").write_text(RESTING)
    pushed, free = (MuJoCoPlant.of(tmp_path / "rod.xml", 1e-3, pushes=given) for given in ((SKYWARD,), ()))
    states = [plant.init([-0.5], [0.0]) for plant in (pushed, free)]
    gained, told = [0.0], []
    for _ in range(4):
        states = [plant.step(state, [0.0]) for plant, state in zip((pushed, free), states, strict=True)]
        gained.append(float(states[0].v[0] - states[1].v[0]))
        told.append(states[0].flags)
    turned = -10.0 * 0.5 * np.cos(0.5) * 1e-3 / (2.0 * 0.2**2 + 0.01)
    np.testing.assert_allclose(np.diff(gained), [0.0, turned, turned, 0.0], rtol=1e-3, atol=1e-5)
    place = [0.5 * np.cos(0.5), 0.03, 0.5 * np.sin(0.5)]
    np.testing.assert_allclose(told[1], [0.0, 0.0, 10.0, *place], atol=1e-3)
    assert not told[0].any()
    assert not told[3].any()


def test_a_push_rises_and_falls_as_fast_within_its_duration() -> None:
    push = HandPush([0.0, 0.0, 4.0], start=1.0, duration=4.0, rise=2.0)
    times = (0.9, 1.0, 1.5, 3.0, 4.5, 5.0, 5.1)
    assert [push.at(t)[2] for t in times] == pytest.approx([0.0, 0.0, 1.0, 4.0, 1.0, 0.0, 0.0])
    at_once = replace(push, rise=0.0)
    assert [at_once.at(t)[2] for t in times] == [0.0, 4.0, 4.0, 4.0, 4.0, 0.0, 0.0]


def test_of_several_pushes_the_sum_is_told_and_the_mean_point_by_their_sizes(tmp_path: Path) -> None:
    (tmp_path / "rod.xml").write_text(RESTING)
    other = replace(SKYWARD, force=[0.0, 30.0, 0.0], point=[0.1, 0.03, 0.0])
    arm = MuJoCoPlant.of(tmp_path / "rod.xml", 1e-3, pushes=(SKYWARD, other))
    state = arm.init([-0.5], [0.0])
    for _ in range(2):
        state = arm.step(state, [0.0])
    place = [0.2 * np.cos(0.5), 0.03, 0.2 * np.sin(0.5)]
    np.testing.assert_allclose(state.flags, [0.0, 30.0, 10.0, *place], atol=1e-3)


def test_a_push_is_that_of_its_states_time(tmp_path: Path) -> None:
    (tmp_path / "rod.xml").write_text(RESTING)
    arm = MuJoCoPlant.of(tmp_path / "rod.xml", 1e-3, pushes=(SKYWARD,))
    before = arm.step(arm.init([-0.5], [0.0]), [0.0])
    during = arm.step(before, [0.0])
    arm.step(arm.step(during, [0.0]), [0.0])
    again = arm.step(before, [0.0])
    np.testing.assert_array_equal((*again.v, *again.flags), (*during.v, *during.flags))
    assert not arm.init([-0.5], [0.0]).flags.any()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"force": [0.0, np.nan, 0.0]}, r"push: force: expected finite numbers, got \[0.0, nan, 0.0\]"),
        ({"force": 20.0}, r"push: force: expected shape \(3,\), got \(\)"),
        ({"point": [0.0, np.inf, 0.0]}, "push: point: expected finite numbers"),
        ({"start": -1.0}, "push: start: expected a time in s from 0 to 1e[+]09, got -1.0"),
        ({"start": np.nan}, "push: start: expected a time in s from 0 .* got nan"),
        ({"duration": -5.0}, "push: duration: expected a time in s above 0, got -5.0"),
        ({"rise": 3.0}, "push: rise: expected a time in s from 0 to 2.5, half of the duration, got 3.0"),
    ],
)
def test_a_push_that_is_none_is_refused(changed: dict[str, Any], said: str) -> None:
    given: dict[str, Any] = {"force": [0.0, 20.0, 0.0], "start": 8.0, "duration": 5.0}
    with pytest.raises(InputError, match=said):
        HandPush(**given | changed)


def test_an_arm_is_pushed_at_the_links_that_it_has() -> None:
    push = HandPush([0.0, 20.0, 0.0], 0.0, 5.0, body="hand")
    with pytest.raises(InputError, match=r"push: there is no link 'hand'; expected one of link1, link2, link3"):
        ContactEnv(pushes=[push])
    with pytest.raises(InputError, match=r"push: there is no link 'Link2' \(did you mean 'link2'\?\); expected one of"):
        ContactEnv(pushes=[replace(push, body="Link2")])
    with pytest.raises(InputError, match="push: start: expected a time before 4 s, the end of the run, got 4"):
        ContactEnv(pushes=[replace(push, start=4.0)], duration=4.0)
    with pytest.raises(InputError, match="scene: expected table, wall, air, got 'floor'"):
        ContactEnv(scene="floor")


@pytest.mark.parametrize("pushes", [SKYWARD, None, "abc", [{"force": [0.0, 20.0, 0.0]}]])
def test_what_is_no_sequence_of_pushes_is_refused(pushes: Any) -> None:
    with pytest.raises(InputError, match=r"^pushes: expected a sequence of HandPush"):
        ContactEnv(pushes=pushes)
    with pytest.raises(InputError, match=r"^push: time: expected a number, got 'x'"):
        SKYWARD.at("x")  # type: ignore[arg-type]


def test_the_tool_goes_behind_the_wall() -> None:
    """Distances of the tool, a ball, in MuJoCo."""
    env, distances = ContactEnv(scene="wall", duration=0.02), []
    model = env.plant.model
    data, place = mujoco.MjData(model), np.zeros(6)
    ball, box = (int(model.body(name).geomadr[0] + model.body(name).geomnum[0] - 1) for name in (LINK, "wall"))
    for p in joint_path(env.mechanism, 12.0, "wall")(np.array([8.0, 9.0, 12.0])).p:
        data.qpos[:3] = p
        mujoco.mj_forward(model, data)
        distances.append(mujoco.mj_geomDistance(model, data, ball, box, 1.0, place))
    assert distances[0] > distances[1] == pytest.approx(CLEARANCE, abs=1e-3)
    assert distances[2] < 0.0


@pytest.mark.parametrize("name", ["table", "wall"])
def test_a_surface_swings_on_its_spring_and_fades_as_its_damper_says(name: str) -> None:
    """At sqrt(k/m) of 0.3 kg, with a damping ratio of a quarter, of which a swing leaves exp(-pi/2/sqrt(1 - 1/16))."""
    model = ContactEnv(scene=name, surface=3e3, duration=0.02).plant.model
    data, joint = mujoco.MjData(model), model.body(name).jntadr[0]
    at = int(model.jnt_qposadr[joint])
    mujoco.mj_resetData(model, data)
    data.qpos[at] = 0.01
    swing = 2.0 * np.pi / np.sqrt((1.0 - 0.25**2) * 3e3 / 0.3)
    mujoco.mj_step(model, data, round(swing / model.opt.timestep))
    assert data.qpos[at] / 0.01 == pytest.approx(np.exp(-0.5 * np.pi / np.sqrt(1.0 - 0.25**2)), rel=0.05)


def test_a_hand_pushes_the_tool() -> None:
    env = ContactEnv(scene="air", duration=0.1, pushes=[HandPush([0.0, 20.0, 0.0], start=0.05, duration=1.0)])
    run = adaptctl.rollout(env, PDGravity(env.mechanism, 5.0, [10.0, 10.0, 10.0]), seed=0)
    np.testing.assert_allclose(contact_forces(run)[[40, 98], 1], [0.0, 20.0 * 49 / 50], rtol=0.03)
    place = Tip(env.mechanism, LINK, np.array(TOOL)).at(run.p[-1])
    np.testing.assert_allclose(contact_points(run)[-1], place, atol=1e-3)


def test_a_run_keeps_the_forces_of_its_contacts() -> None:
    env = ContactEnv(duration=0.02, surface=3e3)
    found = adaptctl.rollout(env, PDGravity(env.mechanism, 5.0, [10.0, 10.0, 10.0]), seed=0)
    assert set(found.flags) == set(env.plant.flags)
    assert not contact_forces(found).any()


def test_forces_are_averaged_over_fifty_milliseconds(tmp_path: Path) -> None:
    env = ContactEnv(duration=0.2)
    run = adaptctl.rollout(env, PDGravity(env.mechanism, 5.0, [10.0, 10.0, 10.0]), seed=0)
    pushed = replace(run, flags={**run.flags, "contact_force_z": np.where(run.time >= 0.1, 8.0, 0.0)})
    forces = contact_forces(pushed)[:, 2]
    np.testing.assert_allclose(forces[[99, 100, 124, 149, 199]], [0.0, 8.0 / 50.0, 4.0, 8.0, 8.0])


def test_a_force_keeps_its_point_while_a_contact_opens_and_closes() -> None:
    """A contact that closes in every tenth sample only, and is open at the end."""
    env = ContactEnv(duration=0.2)
    run = adaptctl.rollout(env, PDGravity(env.mechanism, 5.0, [10.0, 10.0, 10.0]), seed=0)
    closed = (run.time >= 0.1) & (np.arange(len(run.time)) % 10 == 0)
    touch = {"contact_force_x": -10.0 * closed, "contact_point_x": 0.67 * closed, "contact_point_z": 0.35 * closed}
    points = contact_points(replace(run, flags={**run.flags, **touch}))
    np.testing.assert_allclose(points[[110, 115, 199]], np.tile([0.67, 0.0, 0.35], (3, 1)))
    assert not points[:99].any()


@pytest.mark.parametrize("scene", ["table", "wall"])
def test_a_surface_is_drawn_where_it_is(scene: str) -> None:
    model, (drawn,) = beside(ContactEnv(duration=0.02).mechanism, scene, 1e4), surroundings_of(scene)
    box = model.body(scene)
    np.testing.assert_allclose(drawn.pose.translation, box.pos)
    np.testing.assert_allclose(drawn.solid.size, 2.0 * model.geom_size[box.geomadr[0]])  # type: ignore[union-attr]
    assert surroundings_of("air") == ()


def test_the_tool_goes_where_the_task_says_over_a_table_on_a_spring() -> None:
    """MuJoCo's own kinematics and geometry, after the way back from joints."""
    env = ContactEnv(duration=16.0, surface=3e3)
    model = beside(env.mechanism, "table", 3e3)
    data, sizes = mujoco.MjData(model), model.geom_size
    table, ball = model.body("table"), int(np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE)[-1])
    spring = int(table.jntadr[0])
    damping = model.dof_damping[model.jnt_dofadr[spring]]
    assert model.jnt_stiffness[spring] == 3e3
    assert damping / (2.0 * np.sqrt(3e3 * table.mass[0])) == pytest.approx(0.25)  # of critical

    def tool(time: float) -> list[float]:
        point = env.trajectory(time)  # type: ignore[operator,misc]
        for joint, p in zip(env.mechanism.primary_joints, point.p, strict=True):
            data.qpos[model.joint(joint.name).qposadr] = p
        mujoco.mj_forward(model, data)
        return list(data.geom_xpos[ball])

    assert tool(0.0) == pytest.approx([0.5, 0.15, 0.55], abs=1e-4)
    assert tool(2.5) == pytest.approx([0.5, 0.15 - 0.25, 0.55 + 0.1], abs=1e-3)
    assert tool(3.125)[0] == pytest.approx(0.5 + 0.1, abs=1e-3)
    assert tool(7.0) == pytest.approx([0.5, 0.15, 0.55], abs=1e-3)
    top = data.xpos[table.id][2] + sizes[table.geomadr[0], 2]
    for time, height in ((9.0, 0.015), (12.0, -0.05), (15.75, -0.05)):
        assert tool(time)[2] - sizes[ball, 0] - top == pytest.approx(height, abs=1e-3)
    assert tool(15.75)[1] == pytest.approx(0.15 - 0.2, abs=1e-3)  # three quarters of a wipe at 0.2 Hz
    middle = tool(12.0)[:2]
    assert np.abs(np.array(middle) - data.xpos[table.id][:2]).max() < 1e-3


def test_what_a_push_leaves_behind_is_told() -> None:
    """Of a run of 10 s in samples of 1 s, pushed from 3 to 6 s."""
    time, one = np.arange(10.0), np.ones((10, 1))
    error = np.array([9.0, 1.0, 1.0, 4.0, 4.0, 4.0, 2.0, 2.0, 9.0, 9.0])[:, None]
    given: dict[str, Any] = {"time": time, "p": 1e-3 * error, "reference_p": 0.0 * one, "estimate": 0.1 * error}
    doubts = np.array([0.0, 1.0, 0.0, 0.0, 1.0, 2.0, 0.0, 1.0, 0.0, 0.0])[:, None]
    env = ContactEnv(scene="air", duration=0.02)
    run = adaptctl.rollout(env, PDGravity(env.mechanism, 5.0, [10.0, 10.0, 10.0]), seed=0)
    told = ControllerRun("law", "Law", "", replace(run, logged_state=doubts, **given))
    found = list(findings_of_push(HandPush([0.0, 20.0, 0.0], 3.0, 3.0), told, lambda x: abs(float(x[0]))))
    values = {finding.name: finding.value for finding in found}
    assert values == {
        "error_before.law": pytest.approx(1.0),
        "error_pushed.law": pytest.approx(4.0),
        "error_after.law": pytest.approx(2.0),
        "parameter_error_before.law": pytest.approx(100.0 / 9.0),
        "parameter_error_after.law": pytest.approx(100.0),
        "felt_after.law": 1.0,
    }
    assert touches(told, ["a", "b", "c"]) == []
    assert answer_of_push(found, [told]) == "After the push, the RMS errors of joints in 2 s are 2 mrad (Law)."
    assert answer_of_push([], [told]) is None
    unended = list(findings_of_push(HandPush([0.0, 20.0, 0.0], 3.0, 30.0), told, lambda x: abs(float(x[0]))))
    assert answer_of_push(unended, [told]) is None


def test_touches_are_events_in_summary_and_recording(tmp_path: Path) -> None:
    """Above the level from 2 to 4 s, with a gap of 0.5 s, and from 6 to 7 s; in samples of 0.1 s."""
    time = 0.1 * np.arange(100)
    felt = np.where((time > 1.95) & (time < 4.05) & (abs(time - 3.0) > 0.25) | (time > 5.95) & (time < 7.05), 3.0, 0.2)
    made = comparison(adaptctl.load("two_link"), samples=100)
    rollout = replace(
        made.subject.rollout, time=time, logged_state=np.stack([0 * time, 0 * time, -felt, time**0, time**0], 1)
    )
    touched = replace(made.subject, law="SlotineLi + GuardedLearning", rollout=rollout)
    shown = replace(made, runs=(touched, *made.runs[1:]), surroundings=surroundings_of("wall"))
    found = summary(shown)["runs"]["adaptive"]["touches"]
    assert [(round(one["start"], 9), round(one["end"], 9), one["joint"], one["torque"]) for one in found] == [
        (2.0, 4.0, "elbow", -3.0),
        (6.0, 7.0, "elbow", -3.0),
    ]
    write_recording(tmp_path / "recording.rrd", shown)
    chunks = {str(chunk.entity_path): chunk for chunk in RrdReader(tmp_path / "recording.rrd").store().stream()}
    said = chunks["/touches"].to_record_batch()["TextLog:text"].flatten().to_pylist()
    assert said == ["touched: elbow feels -3 N·m", "touch ends"] * 2
    assert "/world/surroundings/visual/0" in chunks


@nightly
@pytest.mark.parametrize(("push", "ratio"), [("0 20 0", 0.5), ("0 0 -20", 1.0), ("0 0 20 --push-duration 2", 1.0)])
def test_a_hand_is_felt_and_not_learned(push: str, ratio: float, tmp_path: Path) -> None:
    """20 N at the tool, which the gradient takes for errors of its model, and which look like a load's weight."""
    out = tmp_path / "out"
    command = ["experiment", "run", "contact", "--scene", "air", "--out", str(out), "--push", *push.split()]
    assert main(command) == 0
    found = {name: told["value"] for name, told in json.loads((out / "summary.json").read_text())["findings"].items()}
    assert found["felt_after.tracking"] < 0.03
    assert found["error_after.tracking"] < ratio * found["error_after.gradient"]
    assert found["parameter_error_after.tracking"] < 2.0 * found["parameter_error_before.tracking"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"push": (0.0, 20.0)}, "push: expected 3 numbers, a force in N along x, y and z, got 2"),
        ({"push": (0.0, np.nan, 0.0)}, "push: expected numbers from -500 to 500, got nan"),
        (
            {"push": (0.0, 20.0, 0.0), "push_start": 20.0},
            "push: start: expected a time before 20 s, the end of the run, got 20",
        ),
        ({"push": (0.0, 20.0, 0.0), "push_rise": 3.0}, "push: rise: expected a time in s from 0 to 2.5"),
        ({"push_start": 3.0}, "push_start: has no effect without a push: add push, its force in N along x, y and z"),
        ({"push": (0.0, 0.0, 0.0), "push_link": "link2"}, "push_link: has no effect without a push"),
        ({"push": (0.0, 20.0, 0.0), "push_link": "Tool"}, r"got 'Tool' \(did you mean 'tool'\?\)"),
        (
            {"push": (0.0, 20.0, 0.0), "push_link": "joint4"},
            "push_link: expected tool, link1, link2, link3, got 'joint4'",
        ),
        ({"scene": "air", "force": 20.0}, "force: has no effect in air: add scene table or wall"),
        ({"push_duration": -5.0}, "push_duration: expected a number from 0.001 to 300, got -5"),
        ({"scene": "floor"}, "scene: expected table, wall, air, got 'floor'"),
    ],
)
def test_settings_of_a_contact_that_cannot_be_are_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        Contact(**given)


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        ("--push-start 10", "--push-start: has no effect without a push: add push"),
        ("--push-link tool --push 0 0 -0.0", "--push-link: has no effect without a push"),
        ("--push-rise 0 --scene air", "--push-rise: has no effect without a push"),
        ("--scene air --push 0 20 0 --force 10", "--force: has no effect in air: add scene table or wall"),
    ],
)
def test_flags_at_their_defaults_that_count_for_nothing_are_refused(
    flags: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["experiment", "run", "contact", "--out", str(tmp_path / "out"), *flags.split()]) == 2
    assert capsys.readouterr().err.startswith(f"adaptctl: {said}")


def test_an_arm_without_a_pumas_wrist_presses_on_no_table() -> None:
    with pytest.raises(InputError, match=r"robot: expected a PUMA 560, with joints joint1 to joint6, got 'two_link'"):
        ContactEnv("two_link")


@nightly
def test_what_is_not_known_of_a_load_goes_into_the_table(tmp_path: Path) -> None:
    """The impedance that learns presses as asked; that of the file presses by the load's weight more."""
    out = tmp_path / "out"
    assert main(["experiment", "run", "contact", "--out", str(out), "--payload", "1.5", "--force", "12"]) == 0
    found = json.loads((out / "summary.json").read_text())["findings"]
    assert found["mean_force.impedance"]["value"] == pytest.approx(12.0, abs=0.2)
    assert found["mean_force.adaptation-off"]["value"] == pytest.approx(12.0 + 1.5 * 9.81, abs=0.5)
    assert found["mean_force.tracking"]["value"] > 100.0


@nightly
@pytest.mark.parametrize("surface", [1e3, 1e4, 1e5])
@pytest.mark.parametrize("scene", ["table", "wall"])
def test_a_force_is_kept_on_soft_and_hard_surfaces(scene: str, surface: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """10 N without wiping, with 2 kg unknown: RMS error from 2 s after the touch to 20 s."""
    monkeypatch.setattr("adaptctl.envs.contact.WIPE", 0.0)
    asked = Contact(scene=scene, surface=surface)
    arm = asked.mechanism()
    basis = adaptctl.fundamental_basis(adaptctl.essential_space(arm))
    run = adaptctl.rollout(asked.environment(arm), asked.contenders(arm, basis)[0].controller, seed=0)
    force = -contact_forces(run) @ INTO[scene]
    touched = int(np.flatnonzero(force > 0.5)[0])
    assert np.sqrt(np.mean((force[touched + 2000 :] - 10.0) ** 2)) < 0.3
