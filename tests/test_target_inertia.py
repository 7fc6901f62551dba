"""Impedances whose inertia is not the arm's own, driven by a measured or an estimated force."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from driven_robots import RecordedRobot
from nightly import mostly_at_night, nightly
from test_impedance import DAMPING, HOME, PERIOD, REST, STILL, TOOL, model, place

import adaptctl
from adaptctl.arrays import Array
from adaptctl.control import GuardedLearning, JointImpedance, TaskImpedance, Workspace, with_external_torque
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains.force_feedback import DrivenLoop, FeltForce
from adaptctl.control.wrench_torque import WrenchTorque
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.envs import ContactEnv, TrackingEnv
from adaptctl.envs.contact import LINK, joint_path
from adaptctl.envs.contact import TOOL as CONTACT_TOOL
from adaptctl.errors import GainError, InputError
from adaptctl.experiments.contact import Contact
from adaptctl.hardware import ForceReading
from adaptctl.hardware.force_sensor import ForceSensor, validate_felt
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import HandPush
from adaptctl.simulation.mujoco_plant import MuJoCoPlant

UNFILTERED = 1e4
"""rad/s"""
AT_HOME = Workspace.along(model().mechanism, HOME[None], margin=1e-6)
OWN = model().mechanism.mass_matrix(HOME)
KILOGRAMS = [1.5, 0, 1.0, 0, 0, 0]


def joints(inertia: Any, **settings: Any) -> JointImpedance:
    given: dict[str, Any] = {"inertia": inertia, "force_cutoff": UNFILTERED, "torque_limits": np.inf} | settings
    return JointImpedance(model(), 40.0, DAMPING, None, model().fundamental_parameters, PERIOD, **given)


def tool(**settings: Any) -> TaskImpedance:
    given: dict[str, Any] = TOOL | {"inertia": 0.1, "tool_inertia": KILOGRAMS, "force_cutoff": UNFILTERED} | settings
    true = model().fundamental_parameters
    return TaskImpedance(model(), 10.0, DAMPING, None, true, PERIOD, torque_limits=np.inf, **given)


def felt(state: Any, torque: Array) -> Any:
    return state._replace(controller_state=state.controller_state._replace(felt=torque))


def jacobian(p: Array) -> Array:
    """Jacobian (2, 2) of the tool along x and z, by differences."""
    ends = [(place(p + h) - place(p - h)) / 2e-6 for h in 1e-6 * np.eye(2)]
    return np.array(ends).T[[0, 2]]


def answer(law: Any, hertz: float, torque: Array, home: Array = HOME, about: Any = None) -> Array:
    """Complex amplitude (r,) of the joints in MuJoCo under a torque of some frequency, which is felt at each tick."""
    omega, samples, still = 2.0 * np.pi * hertz, round(2.0 / hertz / PERIOD), ReferencePoint(home, 0 * home, 0 * home)
    plant, state = about or (MuJoCoPlant.of(law.model.mechanism, PERIOD), law.init(home, 0.0 * home))
    body, found, last = plant.init(home, 0.0 * home), np.zeros(len(home), complex), 0.0 * home
    for k in range(samples + 1500):
        now = torque * np.cos(omega * k * PERIOD)
        given, state = law.step(felt(state, 0.5 * (last + now)), body.p, body.v, still)
        last, body = now, plant.step(body, given + now)
        if k >= 1500:
            found = found + (body.p - home) * np.exp(-1j * omega * (k + 0.5) * PERIOD) * (2.0 / samples)
    return found


@pytest.mark.parametrize("share", mostly_at_night([0.5, 2.0], 0.5))
def test_joints_answer_as_the_target_inertia_does(share: float) -> None:
    omega, torque = 4.0 * np.pi, np.array([0.3, 0.1])
    wanted = np.linalg.solve(40.0 * np.eye(2) - omega**2 * share * OWN + 1j * omega * np.diag(DAMPING), torque)
    found = answer(joints(share * OWN), 2.0, torque)
    assert np.abs(found - wanted).max() < 0.03 * np.abs(wanted).max()


@nightly
def test_a_tool_answers_as_its_target_inertia_does() -> None:
    omega, force, J = 4.0 * np.pi, np.array([3.0, -2.0]), jacobian(HOME)
    mass, damping, stiffness = (np.diag(np.take(x, [0, 2])) for x in (KILOGRAMS, *list(TOOL.values())[:0:-1]))
    wanted = np.linalg.solve(stiffness - omega**2 * mass + 1j * omega * damping, force)
    found = J @ answer(tool(), 2.0, J.T @ force)
    assert np.abs(found - wanted).max() < 0.03 * np.abs(wanted).max()


@nightly
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_sweep_with_an_unknown_load_shows_the_target_inertia(share: float) -> None:
    """A PUMA 560 that learned 2 kg in its hand within 10 s: inertia and damping from 0.5 to 5 Hz."""
    asked = Contact(scene="air")
    arm = asked.mechanism()
    reduced = ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
    plant, path = ContactEnv(arm, scene="air").plant, joint_path(arm, 20.0, "air")
    tracking = asked.contenders(arm, reduced.basis)[0].controller
    body, state = plant.init(path(0.0).p, path(0.0).v), tracking.init(path(0.0).p, path(0.0).v)
    for k in range(10_000):
        given, state = tracking.step(state, body.p, body.v, path(PERIOD * k))
        body = plant.step(body, given)
    home, K = path(10.0).p, np.array([200.0, 200.0, 100.0])
    M = share * arm.mass_matrix(home).diagonal()
    D, near = 1.4 * np.sqrt(K * M), Workspace.along(arm, home[None])
    driven: dict[str, Any] = {"inertia": M, "force_cutoff": UNFILTERED}
    law = JointImpedance(reduced, K, D, tracking.adaptation, tracking.initial, PERIOD, near, **driven)
    start = law.init(home, 0.0 * home)._replace(estimate=state.estimate, law_state=state.law_state)
    for hertz in (0.5, 2.0, 5.0):
        omega, unit = 2.0 * np.pi * hertz, np.diag([4.0, 4.0, 1.5])
        moved = np.array([answer(law, hertz, one, home, (plant, start)) for one in unit]).T @ np.linalg.inv(unit)
        found = np.linalg.inv(moved).diagonal()
        assert found.imag / omega == pytest.approx(D, rel=0.05)
        assert (K - found.real) / omega**2 == pytest.approx(M, rel=0.05)


def test_an_inertia_that_swings_at_a_spring_is_refused_with_the_smallest() -> None:
    with pytest.raises(GainError, match=r"two_link: inertia: .* up to 1000 N m/rad .* at least 1.68 times"):
        joints(0.05 * OWN, workspace=AT_HOME)


def between_springs(stiffness: float) -> MuJoCoPlant:
    """The two-link arm with springs from its joints to the world."""
    scene = model().mechanism.to_mujoco()
    scene.opt.timestep, scene.jnt_stiffness[:], scene.qpos_spring[:] = 1e-4, stiffness, HOME
    return MuJoCoPlant.of(scene, PERIOD)


def swing(law: Any, stiffness: float, seconds: float) -> Array:
    """Sizes of an arm's motion between springs, in ten parts of the time."""
    plant, state = between_springs(stiffness), law.init(HOME, REST)
    body, sizes = plant.init(HOME + 1e-3, REST), []
    for _ in range(round(seconds / PERIOD)):
        given, state = law.step(felt(state, -stiffness * (body.p - HOME)), body.p, body.v, STILL)
        body = plant.step(body, given)
        sizes.append(float(np.abs(body.p - HOME).max()))
    return np.array(sizes).reshape(10, -1).max(axis=1)


def test_each_of_few_postures_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    judged: list[Array] = []
    monkeypatch.setattr(
        "adaptctl.control.impedance.validate_inertia", lambda name, loop, most: judged.append(loop.mass)
    )
    postures = np.array([HOME, [0.0, 3.0]])
    joints(0.6 * OWN, workspace=Workspace.along(model().mechanism, postures, margin=1e-6))
    np.testing.assert_allclose(judged, [model().mechanism.mass_matrix(postures)])


@nightly
def test_what_is_accepted_comes_to_rest_between_springs_and_what_is_refused_swings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At 10 kN m/rad, where the smallest is about 0.4 of the arm's own inertia."""
    sizes = swing(joints(0.45 * OWN, workspace=AT_HOME, surroundings=1e4), 1e4, 0.3)
    assert sizes[-1] < 0.1 * sizes[0]
    with pytest.raises(GainError):
        joints(0.2 * OWN, workspace=AT_HOME, surroundings=1e4)
    monkeypatch.setattr("adaptctl.control.impedance.validate_inertia", lambda *given: None)
    assert swing(joints(0.2 * OWN), 1e4, 0.3)[-1] > 10.0 * sizes[0]


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: joints(0.0), "^inertia: "),
        (lambda: joints([[1.0, 2.0], [2.0, 1.0]]), "inertia: expected a positive definite matrix"),
        (lambda: joints(1.0, tank=5.0), "tank: .* leave out one"),
        (lambda: joints(1.0, force_cutoff=None), "inertia: nothing tells the external torque"),
        (lambda: joints(1.0, force_cutoff=-1.0), "^force_cutoff: expected a positive"),
        (lambda: joints(None), "^force_cutoff: has no effect"),
        (lambda: joints(1.0, surroundings=np.nan), "^surroundings: "),
        (lambda: tool(inertia=None), "^tool_inertia: expected one with inertia"),
        (lambda: tool(tool_inertia=None), "^tool_inertia: expected one with inertia"),
        (lambda: tool(tool_inertia=[1.5, 1.0, 1.0, 0, 0, 0]), "^tool_inertia: .* and 0 elsewhere"),
        (lambda: tool(inertia=OWN), "^inertia: "),
    ],
)
def test_wrong_inertias_are_told(make: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        make()


def test_a_wrench_acts_on_joints_as_mujocos_does() -> None:
    """On the last link of a PUMA 560, and of a tree whose first link holds two others."""
    for robot in ("puma560_measured", "two_link"):
        arm = adaptctl.load(robot)
        plant, rng = MuJoCoPlant.of(arm, PERIOD), np.random.default_rng(0)
        p, wrench = 0.5 * rng.normal(size=arm.dof), rng.normal(size=6)
        plant.init(p, 0.0 * p)
        data, link, found = plant._scene._data, plant.arm.bodies[-1], np.zeros(plant._scene._model.nv)
        point = data.xpos[link] + 0.1
        mujoco.mj_applyFT(plant._scene._model, data, wrench[:3], wrench[3:], point, link, found)
        assert WrenchTorque(arm)(p, wrench, point) == pytest.approx(found, abs=1e-9)


def test_a_force_without_its_point_drives_no_inertia() -> None:
    law, sensor = joints(0.6 * OWN, workspace=AT_HOME), ForceSensor(None, 1.0)
    for silent in (None, sensor):
        with pytest.raises(InputError, match="no force with its point"):
            validate_felt(law, silent, law.model.mechanism)
    sensor.point = np.zeros(3)
    validate_felt(law, sensor, law.model.mechanism)
    looped = adaptctl.load("semi_direct_drive_parallelogram")
    with pytest.raises(InputError, match=f"{looped.name}: through loops .* leave out force_cutoff"):
        validate_felt(law, sensor, looped)
    validate_felt(joints(None, force_cutoff=None, workspace=AT_HOME), sensor, looped)


class SensingRobot(RecordedRobot):
    """A robot that is pushed at its last link's center of mass from a time on, and measures that, with a bias."""

    begins, knows_the_point = 1.0, True
    push = np.array([6.0, 0.0, 3.0])

    def read(self) -> Any:
        data: Any = self.plant._scene._data
        self.acting = self.push if self._count * self.period >= self.begins else 0.0 * self.push
        data.xfrc_applied[-1, :3] = self.acting
        return super().read()

    def force(self) -> ForceReading:
        point = self.plant._scene._data.xipos[-1].copy() if self.knows_the_point else None
        return ForceReading(self._count * self.period, np.array([3.0, -1.0, -25.0]) + self.acting, point=point)


def driven(law: Any, path: Any, seconds: float, **about: Any) -> tuple[Any, Any]:
    robot = SensingRobot(model().mechanism, law.control_period, start=HOME)
    for name, value in about.items():
        setattr(robot, name, value)
    return adaptctl.drive(robot, law, path, seconds, on_touch="ignore", lead_in=0.8, max_error=0.9), robot


@nightly
def test_a_robots_sensor_drives_the_target_inertia() -> None:
    """The joints yield by the torques of the push over their stiffness."""
    law = JointImpedance(
        model(), 40.0, DAMPING, None, model().fundamental_parameters, 4e-3, inertia=0.5 * OWN, force_cutoff=200.0
    )
    still = adaptctl.Sinusoids(HOME, REST, np.ones(2))
    run, robot = driven(law, still, 2.6)
    moved, data = run.rollout.p[-1], robot.plant._scene._data
    torque = WrenchTorque(model().mechanism)(moved, np.append(robot.push, REST.repeat(2)[:3]), data.xipos[-1])
    assert moved - HOME == pytest.approx(torque / 40.0, rel=0.01)
    with pytest.raises(InputError, match="robot: it measures no force with its point"):
        driven(law, still, 1.0, knows_the_point=False)


@nightly
def test_the_forces_of_an_environment_drive_the_target_inertia() -> None:
    """A hand of 20 N moves the tool of a PUMA 560 along its springs."""
    env = ContactEnv(scene="air", duration=1.0, pushes=[HandPush([0.0, 20.0, 0.0], start=0.0, duration=2.0)])
    reduced = ReducedModel.full(env.mechanism)
    given: Any = reduced, 50.0, 20.0, None, reduced.fundamental_parameters, 1e-3
    along: dict[str, Any] = {"tool_stiffness": [1e3, 1e3, 1e3, 0, 0, 0], "tool_damping": [200.0, 200, 200, 0, 0, 0]}
    near = Workspace.along(env.mechanism, joint_path(env.mechanism, 1.0, "air")(np.array([0.0])).p, margin=0.2)
    law = TaskImpedance(
        *given, near, link=LINK, tool=np.array(CONTACT_TOOL), inertia=1.0, tool_inertia=[9.0, 9, 9, 0, 0, 0],
        force_cutoff=500.0, **along,
    )  # fmt: skip
    run = adaptctl.rollout(env, law, seed=0)
    tip = Tip(env.mechanism, LINK, np.array(CONTACT_TOOL))
    moved = tip.at(run.p[-1]) - tip.at(run.reference_p[-1])
    assert moved == pytest.approx([0.0, 0.02, 0.0], abs=2e-3)
    with pytest.raises(InputError, match="tells no force of contacts"):
        adaptctl.rollout(TrackingEnv(model().mechanism, duration=0.02, control_period=PERIOD), joints(OWN), seed=0)


@nightly
def test_an_impedance_learns_the_arm_while_it_is_pushed_if_that_is_measured() -> None:
    """Pushed from the start, when every miss counts as ignorance."""
    base = adaptctl.adaptive_controller(model().mechanism, control_period=4e-3)
    feeling, true = with_external_torque(base), base.model.fundamental_parameters
    law = JointImpedance(base.model, 40.0, DAMPING, feeling.adaptation, 0.99 * true, 4e-3)
    wave, errors = adaptctl.Sinusoids(HOME, np.array([0.4, 0.3]), np.array([0.5, 0.8])), []
    for known in (True, False):
        run, _ = driven(law, wave, 15.0, begins=1.2, knows_the_point=known)
        errors.append(float(np.linalg.norm(run.rollout.estimate[-1] - true) / np.linalg.norm(true)))
    assert errors[0] < 0.01
    assert errors[1] > 0.1


@nightly
def test_an_observer_drives_a_target_inertia() -> None:
    """After some motion a torque held for 2 s moves the joints by torque over stiffness, without a sensor."""
    law = GuardedLearning(np.full(6, 0.05), 400.0, trial=False)
    given: Any = model(), 40.0, DAMPING
    feeling = with_external_torque(JointImpedance(*given, law, model().fundamental_parameters, PERIOD))
    soft = JointImpedance(
        *given, feeling.adaptation, feeling.initial, PERIOD, inertia=0.7 * OWN, surroundings=100.0, torque_limits=np.inf
    )
    plant, state = MuJoCoPlant.of(model().mechanism, PERIOD), soft.init(HOME, REST)
    body, torque = plant.init(HOME, REST), np.array([4.0, -2.0])
    wave = adaptctl.Sinusoids(HOME, np.array([0.4, 0.5]), np.array([0.8, 1.1]), start_time=0.5)
    for k in range(7000):
        given, state = soft.step(state, body.p, body.v, wave(PERIOD * k) if k < 4000 else STILL)
        body = plant.step(body, given + (torque if k > 5000 else REST))
    assert body.p - HOME == pytest.approx(torque / 40.0, rel=0.02)


def test_loops_that_are_checked_are_the_arm_s_in_postures_all_over_its_workspace(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With the filter of a measured force, or both of an estimated one."""
    seen: list[tuple[DrivenLoop, float]] = []
    monkeypatch.setattr("adaptctl.control.impedance.validate_inertia", lambda name, *given: seen.append(given))
    joints(0.5 * OWN, force_cutoff=70.0, delay=2, surroundings=300.0)
    ((loop, surroundings),) = seen
    assert (loop.force, loop.period, surroundings) == (FeltForce(70.0, 1, 2), PERIOD, 300.0)
    count = len(loop.mass)
    assert 8 <= count < 16
    assert np.ptp(loop.mass[:, 0, 0]) > 0.1 * OWN[0, 0]
    for matrices, expected in (
        (loop.inertia, 0.5 * OWN),
        (loop.damping, np.diag(DAMPING)),
        (loop.stiffness, 40.0 * np.eye(2)),
    ):
        np.testing.assert_allclose(matrices, np.broadcast_to(expected, (count, 2, 2)), atol=1e-9)
    joints(0.5 * OWN, workspace=AT_HOME)
    np.testing.assert_allclose(seen[-1][0].mass[0], OWN, rtol=1e-4)


@pytest.mark.parametrize("stages", [1, 2])
def test_a_period_of_a_checked_loop_is_that_of_a_mass_on_a_spring(stages: int) -> None:
    mass, inertia, damping, stiffness, spring, period = 2.0, 0.7, 3.0, 40.0, 300.0, 4e-3
    matrices = (np.full((1, 1, 1), x) for x in (mass, inertia, damping, stiffness))
    loop = DrivenLoop(*matrices, [], period, FeltForce(50.0, stages, 2))
    x, v, target, first, second, held, last = state = np.random.default_rng(0).normal(size=7)
    keep, w = np.exp(-50.0 * period), np.sqrt(spring / mass)
    rest, turn = held / spring, w * period
    one = keep * first + (1.0 - keep) * -spring * x
    force, two = (one, one) if stages == 1 else (second, keep * second + (1.0 - keep) * one)
    wanted = (force - damping * v - stiffness * x) / (1.5 * inertia)
    moved = rest + (x - rest) * np.cos(turn) + v / w * np.sin(turn)
    speed = v * np.cos(turn) - w * (x - rest) * np.sin(turn)
    expected = [moved, speed, target + period * wanted, one, two, last, mass * wanted - damping * (v - target) - force]
    assert loop._step(1.5, np.full((1, 1, 1), spring))[0] @ state == pytest.approx(expected, rel=1e-9)
