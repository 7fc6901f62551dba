"""Impedances: stiffness and damping felt, what a period carries, and energy given to the surroundings."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
import pytest
from nightly import nightly
from scipy.spatial.transform import Rotation

import adaptctl
import adaptctl.hardware
from adaptctl.arrays import Array
from adaptctl.compilation import compile_function
from adaptctl.control import GuardedLearning, HeldState, JointImpedance, TaskImpedance, Workspace, largest_stiffness
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.passivity_based import Instant, ReferenceVelocity
from adaptctl.control.task_impedance import _pull, _turning
from adaptctl.description.drive import Drive
from adaptctl.description.writers.mujoco_model import mjcf_text
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.errors import GainError, InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Mat, column
from adaptctl.simulation.mujoco_plant import MuJoCoPlant

PERIOD = 1e-3
HOME, REST = np.array([0.3, 0.9]), np.zeros(2)
STILL = ReferencePoint(HOME, REST, REST)
DAMPING = np.array([6.0, 3.0])
TOOL: Any = {
    "tool": [0.3, 0.0, 0.0],
    "tool_stiffness": [400.0, 0, 300.0, 0, 0, 0],
    "tool_damping": [60.0, 0, 60.0, 0, 0, 0],
}


@lru_cache
def model() -> ReducedModel:
    arm = adaptctl.load("two_link")
    return ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))


def joints(**settings: Any) -> JointImpedance:
    return JointImpedance(
        model(), 40.0, DAMPING, None, model().fundamental_parameters, PERIOD, torque_limits=np.inf, **settings
    )


def tool(**settings: Any) -> TaskImpedance:
    given = TOOL | {"torque_limits": np.inf} | settings
    return TaskImpedance(model(), 10.0, DAMPING, None, model().fundamental_parameters, PERIOD, **given)


def place(p: Array) -> Array:
    """Tool point (3,) of the two-link arm."""
    poses = link_poses(model().mechanism, p)
    return np.asarray(poses.translations[-1] + poses.rotations[-1] @ TOOL["tool"])


class Pushed:
    """A law that holds an arm in MuJoCo, pushed at the joints or at the tool."""

    def __init__(self, law: Any) -> None:
        self.law, self.plant = law, MuJoCoPlant.of(law.model.mechanism, PERIOD)
        self.body = self.plant.init(HOME, REST)
        self.state = law.init(HOME, REST)
        data, self.link = self.plant._scene._data, self.plant.arm.bodies[-1]
        self.tool = data.xmat[self.link].reshape(3, 3).T @ (place(HOME) - data.xpos[self.link])

    def hold(self, seconds: float, torque: Any = REST, force: Any = None) -> Array:
        data, link = self.plant._scene._data, self.link
        for _ in range(round(seconds / PERIOD)):
            given, self.state = self.law.step(self.state, self.body.p, self.body.v, STILL)
            data.xfrc_applied[link] = 0.0
            if force is not None:
                lever = data.xpos[link] + data.xmat[link].reshape(3, 3) @ self.tool - data.xipos[link]
                data.xfrc_applied[link] = [*force, *np.cross(lever, force)]
            self.body = self.plant.step(self.body, given + torque)
        return np.asarray(self.body.p)


def test_joints_yield_by_torque_over_stiffness() -> None:
    pushed = Pushed(joints())
    for torque in ([3.0, -2.0], [-3.0, 2.0], [0.5, 0.5]):
        assert pushed.hold(1.5, np.array(torque)) - HOME == pytest.approx(np.array(torque) / 40.0, rel=1e-3)


@pytest.mark.parametrize("hertz", [2.0, 5.0])
def test_joints_answer_a_sinusoid_as_mass_spring_and_damper_do(hertz: float) -> None:
    """Small motions in MuJoCo against (K - M w^2 + i w D)^-1, whose imaginary part is the damping."""
    law, omega, force = joints(), 2.0 * np.pi * hertz, np.array([0.3, 0.1])
    plant, state = MuJoCoPlant.of(law.model.mechanism, PERIOD), law.init(HOME, REST)
    body, found, samples = plant.init(HOME, REST), np.zeros(2, complex), round(2.0 / hertz / PERIOD)
    for k in range(samples + 2000):
        torque, state = law.step(state, body.p, body.v, STILL)
        body = plant.step(body, torque + force * np.cos(omega * k * PERIOD))
        if k >= 2000:
            found = found + (body.p - HOME) * np.exp(-1j * omega * (k + 1) * PERIOD) * (2.0 / samples)
    M = law.model.mechanism.mass_matrix(HOME)
    answer = np.linalg.solve(40.0 * np.eye(2) - omega**2 * M + 1j * omega * np.diag(DAMPING), force)
    assert np.abs(found - answer).max() < 0.02 * np.abs(answer).max()


def test_a_tool_yields_by_force_over_stiffness_and_keeps_its_share_of_the_joints_out() -> None:
    pushed = Pushed(tool())
    for force in ([10.0, 0.0, 0.0], [-6.0, 0.0, 8.0]):
        moved = place(pushed.hold(1.5, force=force)) - place(HOME)
        assert moved * [400.0, 0.0, 300.0] == pytest.approx(np.array(force), abs=0.05)


def test_a_force_beyond_the_most_carries_the_tool_away() -> None:
    """A push of 12 N against at most 8 moves on at (12 - 8)/60 m/s; one of 6 N is held."""
    pushed = Pushed(tool(most_force=8.0))
    assert (place(pushed.hold(1.5, force=[6.0, 0.0, 0.0])) - place(HOME))[0] == pytest.approx(6.0 / 400.0, rel=0.02)
    before = place(pushed.hold(1.0, force=[0.0, 0.0, -12.0]))
    after = place(pushed.hold(0.3, force=[0.0, 0.0, -12.0]))
    assert (after - before)[2] / 0.3 == pytest.approx(-4.0 / 60.0, rel=0.1)


def over_a_table(height: float, stiffness: float) -> MuJoCoPlant:
    """The two-link arm with a ball of 2 cm as its tool, over a table that gives way as a spring."""
    spec = mujoco.MjSpec.from_string(mjcf_text(model().mechanism.description))
    spec.option.timestep = 2.5e-4
    ball, box = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX
    spec.body("lower").add_geom(type=ball, size=[0.02, 0, 0], pos=[0.6, 0.0, 0.0], mass=0)
    top = spec.worldbody.add_body(name="table", pos=[0.6, 0.0, height - 0.07], gravcomp=1)
    give = {"axis": [0, 0, 1], "stiffness": stiffness, "damping": 0.2 * np.sqrt(0.3 * stiffness)}
    top.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, **give)
    top.add_geom(type=box, size=[0.2, 0.2, 0.05], mass=0.3, solref=[0.001, 1.0])
    return MuJoCoPlant.of(spec.compile(), PERIOD, "upper")


def reaching(x: float, z: float) -> Array:
    """Joints that bring the tool to a point, by the law of cosines."""
    elbow = np.arccos((x * x + z * z - 0.4**2 - 0.6**2) / (2.0 * 0.4 * 0.6))
    return np.array([np.arctan2(z, x) - np.arctan2(0.6 * np.sin(elbow), 0.4 + 0.6 * np.cos(elbow)), elbow])


def test_a_reference_behind_a_surface_presses_with_the_most_force() -> None:
    """MuJoCo's contact force of a table of 10 kN/m, after an approach at no more than 8 N over 160 N s/m."""
    x, _, z = place(HOME)
    goal = reaching(x, z - 0.08)
    law = tool(
        most_force=[1e3, 1e3, 8.0],
        tool_damping=[60.0, 0, 160.0, 0, 0, 0],
        tool_stiffness=[400.0, 0, 2000.0, 0, 0, 0],
        workspace=Workspace.along(model().mechanism, [HOME, goal], margin=0.2),
    )
    plant, behind = over_a_table(z - 0.03, 1e4), ReferencePoint(goal, REST, REST)
    body, state, speeds, felt, wrench = plant.init(HOME, REST), law.init(HOME, REST), [], [], np.zeros(6)
    for _ in range(1800):
        torque, state = law.step(state, body.p, body.v, behind)
        before, body = place(body.p)[2], plant.step(body, torque)
        speeds.append((before - place(body.p)[2]) / PERIOD)
        data = plant._scene._data
        if data.ncon:
            mujoco.mj_contactForce(plant._scene._model, data, 0, wrench)
        felt.append(float(wrench[0]) if data.ncon else 0.0)
    assert 0.045 < max(speeds) < 0.051
    assert np.array(felt[1500:]) == pytest.approx(8.0, abs=0.1)


def test_drive_keeps_the_tank_through_a_stop() -> None:
    """What an earlier state is taken from has other energies."""
    law = joints(tank=3.0)
    old = law.init(HOME, REST)
    now = old._replace(controller_state=old.controller_state._replace(energy=np.array([1.5]), p=HOME + 0.1))
    kept = HeldState(law).at(old, now).controller_state
    assert kept.energy == pytest.approx([1.5])
    assert kept.p == pytest.approx(HOME + 0.1)


@nightly
def test_drive_takes_a_tank() -> None:
    robot = adaptctl.hardware.MuJoCoRobot(model().mechanism, PERIOD, start=HOME)
    run = adaptctl.drive(robot, joints(tank=3.0), adaptctl.Sinusoids(HOME, [0.2, 0.2], [0.8, 1.1]), duration=4.0)
    assert (run.stopped, run.by_robot) == ("", False)


def test_a_spring_that_stops_growing_is_the_slope_of_its_energy() -> None:
    for way in (0.01, -0.03, 0.2, -0.5):
        slope = (_pull(400.0, 20.0, way + 1e-6)[1] - _pull(400.0, 20.0, way - 1e-6)[1]) / 2e-6
        assert _pull(400.0, 20.0, way)[0] == pytest.approx(slope, rel=1e-6)
    assert _pull(0.0, 20.0, 0.2) == (0.0, 0.0)


def test_moments_are_the_slope_of_the_quaternions_energy() -> None:
    """The energy is 2 e' K e of the quaternion's vector part e."""
    rng, K = np.random.default_rng(0), np.array([3.0, 20.0, 7.0])

    def energy(turned: Rotation) -> float:
        return float(2.0 * K @ turned.as_quat()[:3] ** 2)

    for turned in Rotation.random(20, rng=rng):
        moment, own = _turning(Mat.of(turned.as_matrix()), column(K))
        assert own == pytest.approx(energy(turned), rel=1e-12)
        for axis, part in zip(np.eye(3), moment, strict=True):
            ends = [energy(Rotation.from_rotvec(h * axis) * turned) for h in (1e-6, -1e-6)]
            assert part == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-7)


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_up_to_the_largest_stiffness_a_slow_motion_gives_energy(delay: int) -> None:
    """Work of a held spring and damper along sinusoids, counted; beyond twice it the fastest takes energy out."""
    D = 5.0
    most = float(largest_stiffness(D, PERIOD, delay))
    fastest = 0.25 * np.pi / (PERIOD * (delay + 0.5))
    for share, omega in ((1.0, 0.02), (1.0, 0.5), (1.0, 0.98), (2.0, 0.98), (0.5, 1.3)):
        t = PERIOD * np.arange(200_001)
        x, v = np.sin(omega * fastest * t), omega * fastest * np.cos(omega * fastest * t)
        late = slice(0, len(t) - 1 - delay)
        force = -(share * most) * x[late] - D * v[late]
        given = -float(force @ np.diff(x)[delay:])
        assert (given > 0.0) == (share * np.tan(omega * np.pi / 4.0) < omega), (share, omega)


def test_a_stiffness_that_the_period_does_not_carry_is_refused_with_the_largest() -> None:
    most = float(largest_stiffness(6.0, 0.02)[()])
    with pytest.raises(GainError, match=rf"shoulder: 600 is above {most:.4g}, the largest"):
        JointImpedance(model(), [600.0, 10.0], [6.0, 0.5], None, None, 0.02)
    with pytest.raises(GainError, match=r"stiffness of z: 900000 is above 9.425e\+04"):
        tool(tool_stiffness=[400.0, 0, 9e5, 0, 0, 0])
    with pytest.raises(GainError, match=r"sampling ratio is .* above the limit of 1.5; use at most"):
        tool(tool_damping=[60.0, 0, 6000.0, 0, 0, 0])
    with pytest.raises(GainError, match="a delay of 4: its sampling ratio"):
        replace(joints(), damping=[60.0, 9.0], delay=4)


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"tool_stiffness": [1.0, 2.0]}, r"tool_stiffness: expected shape \(6,\)"),
        ({"tool_stiffness": [-1.0, 2.0, 0, 0, 0, 0]}, "tool_stiffness: expected numbers of at least 0"),
        ({"most_force": [1.0, 0.0, 2.0]}, "most_force: expected positive forces"),
        ({"most_force": np.nan}, "most_force: expected positive forces"),
        ({"link": "hand"}, "unknown link 'hand'"),
        ({"singularity": 0.0}, "singularity"),
        ({"tank": -1.0}, "tank: expected a positive energy"),
        ({"delay": 0.5}, "^delay: expected a whole number"),
    ],
)
def test_wrong_settings_are_told(settings: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        tool(**settings)


def test_a_wrong_delay_is_told_before_gains() -> None:
    with pytest.raises(InputError, match=r"^delay: expected a whole number"):
        joints(delay=-1)


def test_an_arm_with_loops_has_no_task_impedance() -> None:
    arm = adaptctl.load("semi_direct_drive")
    with pytest.raises(InputError, match="has loops"):
        TaskImpedance(ReducedModel.full(arm), 1.0, 1.0, tool_stiffness=np.ones(6), tool_damping=np.ones(6))


def test_a_push_moves_no_estimate_of_an_impedance() -> None:
    """A learning law that doubts would follow it, and the arm would come back."""
    law = GuardedLearning(np.full(6, 0.05), 400.0)
    soft = JointImpedance(model(), 40.0, DAMPING, law, model().fundamental_parameters, PERIOD)
    assert not soft.adaptation.trial  # type: ignore[union-attr]
    pushed = Pushed(soft)
    wave = adaptctl.Sinusoids(HOME, np.array([0.4, 0.5]), np.array([0.8, 1.1]), start_time=0.5)
    for k in range(2000):
        given, pushed.state = soft.step(pushed.state, pushed.body.p, pushed.body.v, wave(PERIOD * k))
        pushed.body = pushed.plant.step(pushed.body, given)
    pushed.hold(1.0)
    assert pushed.hold(2.0, np.array([4.0, -3.0])) - HOME == pytest.approx([0.1, -0.075], rel=0.02)


class Tussle:
    """Arms whose references move and jump and whose stiffness changes, against dampers, walls and pushes."""

    def __init__(self, law: Any, arms: int, seed: int) -> None:
        self.law, self.rng, self.N = law, np.random.default_rng(seed), arms
        self.p, self.v = self.rng.uniform(-1.0, 1.0, (arms, 2)), np.zeros((arms, 2))
        self.state, self.gains = law.init(self.p, self.v), np.tile(law.packed, (arms, 1))
        self.center, self.amplitude = self.p.copy(), self.rng.uniform(0.0, 0.8, (arms, 2))
        self.omega, self.contacts = self.rng.uniform(0.6, 6.0, (arms, 2)), 0
        self.began = 0.0
        self.spring, self.damper = np.zeros((arms, 1)), np.zeros((arms, 1))
        self.anchor, self.push, self.work, self.least = self.p.copy(), 0.0 * self.p, np.zeros(arms), np.zeros(arms)

    def run(self, periods: int) -> None:
        self.plant = held_motion(self.law.model.mechanism)
        for k in range(periods):
            self._change(np.flatnonzero(self.rng.random(self.N) < PERIOD / 0.4))
            point = self._goal(self.began + PERIOD * k)
            torque, self.state = self.law.step_tuned(self.gains, self.state, self.p, self.v, point)
            force = self.push - self.spring * (self.p - self.anchor) - self.damper * self.v
            p, self.v = self.plant(self.p, self.v, torque + force)
            self.work = self.work + (force * (p - self.p)).sum(axis=1)
            self.p, self.least = p, np.minimum(self.least, self.work)

    def _goal(self, t: float) -> ReferencePoint:
        w, swing = self.omega, self.amplitude
        return ReferencePoint(
            self.center + swing * (1.0 - np.cos(w * t)), swing * w * np.sin(w * t), swing * w * w * np.cos(w * t)
        )

    def _change(self, arms: Array) -> None:
        n, own = len(arms), self.law.packed
        self.contacts += n
        self.spring[arms] = self.rng.choice([0.0, 1.0], (n, 1)) * 10.0 ** self.rng.uniform(0.0, 2.5, (n, 1))
        self.damper[arms] = self.rng.choice([0.0, 1.0], (n, 1)) * 10.0 ** self.rng.uniform(-1.0, 0.6, (n, 1))
        self.push[arms] = self.rng.choice([0.0, 1.0], (n, 1)) * self.rng.normal(0.0, 4.0, (n, 2))
        self.anchor[arms] = self.p[arms]
        self.center[arms] += self.rng.choice([0.0, 1.0], (n, 1)) * self.rng.uniform(-0.3, 0.3, (n, 2))
        stiff = [i for i, name in enumerate(_named(self.law)) if "stiffness" in name]
        self.gains[np.ix_(arms, stiff)] = own[stiff] * 10.0 ** self.rng.uniform(-0.6, 0.6, (n, 1))


def _named(law: Any) -> list[str]:
    return [name for name, values in law.numbers.items() for _ in range(values.size)]


@lru_cache
def held_motion(arm: Mechanism) -> Any:
    """Runge and Kutta's step of many arms under held torques."""
    D, equations, h = column(arm.inertial_parameters), arm.equations, PERIOD

    def step(p: Column, v: Column, torque: Column) -> tuple[Column, Column]:
        def slope(p: Column, v: Column) -> tuple[Column, Column]:
            return v, equations.forward_dynamics(p, v, torque, D)

        a1, b1 = slope(p, v)
        a2, b2 = slope(p + (0.5 * h) * a1, v + (0.5 * h) * b1)
        a3, b3 = slope(p + (0.5 * h) * a2, v + (0.5 * h) * b2)
        a4, b4 = slope(p + h * a3, v + h * b3)
        return p + (h / 6.0) * (a1 + 2.0 * a2 + 2.0 * a3 + a4), v + (h / 6.0) * (b1 + 2.0 * b2 + 2.0 * b3 + b4)

    return compile_function(step, {"p": 2, "v": 2, "torque": 2}).map


@pytest.mark.parametrize("law", [joints, tool])
def test_with_a_tank_the_surroundings_never_get_more_than_it_held(law: Any) -> None:
    """From rest; without a tank the same arms give far more."""
    tussle = Tussle(law(tank=1.0), 40, 0)
    tussle.run(800)
    assert tussle.least.min() >= -1.0
    assert tussle.least.min() < -0.7
    assert np.isfinite(tussle.p).all()


def test_the_weight_that_a_tank_leaves_out_is_that_of_one_recursion() -> None:
    """Gravity and friction apart, against M a_r + C v_r + g + friction at rest."""
    arm = model().mechanism.with_drives(Drive(rotor_inertia=0.02, viscous=0.3, coulomb=0.5))
    reduced = ReducedModel.full(arm)
    law = JointImpedance(reduced, 40.0, DAMPING, None, reduced.fundamental_parameters, tank=2.0)
    p, v_r, D = column([0.3, 0.9]), column([0.4, -0.7]), column(arm.inertial_parameters)
    wanted = ReferenceVelocity(v_r, Column.zeros(2), None)
    at = Instant(p, p, v_r, v_r, ReferencePoint(p, v_r, v_r), wanted, D)
    none = Column.zeros(2)
    whole = arm.equations.motion(p, none, v_r, none).torque(D)
    assert list(law._weight(at, v_r, D)) == pytest.approx(list(whole), rel=1e-12)


def test_friction_that_a_brake_leaves_unused_comes_out_of_the_tank() -> None:
    """A reference runs away, and a brake takes the work: of what was to overcome friction at its speed, too."""
    arm = model().mechanism.with_drives(Drive(rotor_inertia=0.02, viscous=3.0, coulomb=0.3))
    reduced, brake, taken = ReducedModel.full(arm), 10.0, 0.0
    true = reduced.fundamental_parameters
    law = JointImpedance(reduced, 40.0, DAMPING, None, true, PERIOD, torque_limits=np.inf, tank=5.0)
    plant, state = held_motion(arm), law.init(HOME[None], REST[None])
    p, v, rate = HOME[None], REST[None], np.array([[2.0, -2.0]])
    for k in range(1000):
        torque, state = law.step(state, p, v, ReferencePoint(HOME + rate * k * PERIOD, rate, 0.0 * rate))
        before, force = p, -brake * v
        p, v = plant(p, v, torque + force)
        taken -= float((force * (p - before)).sum())
    assert 3.0 < taken < 5.0


@nightly
def test_without_a_tank_moving_references_give_energy_without_end() -> None:
    tussle = Tussle(joints(), 40, 0)
    tussle.run(800)
    assert tussle.least.min() < -1.5
