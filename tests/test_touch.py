"""External torques while a law learns: MuJoCo's forces, alarms at a stated rate, and what they are taken for."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
import pytest
from nightly import mostly_at_night

import adaptctl
from adaptctl.arrays import Array
from adaptctl.compilation import compile_function
from adaptctl.control import ExternalTorque, GuardedLearning, SlotineLi, Touch, tool_wrench, with_external_torque
from adaptctl.control.adaptation.external_torque import KINDS, Missed
from adaptctl.control.adaptation.external_torque import judged as judged_by
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.two_stage_filter import FilteredPrediction
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.pytree import leaves
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column
from adaptctl.simulation.mujoco_plant import MuJoCoPlant

PERIOD, CUTOFF = 1e-3, 60.0
SCENE = """
<mujoco><option timestep="0.001" gravity="0 -9.81 0"/><worldbody>
  <body name="post" pos="{post}"><geom type="capsule" size=".05 .5"/></body>
  <body name="upper"><joint name="a" axis="0 0 1" range="-170 170"/>
    <geom type="capsule" size=".03" fromto="0.1 0 0 .4 0 0"/>
    <body name="fore" pos=".4 0 0"><joint name="b" axis="0 0 1" range="-170 170"/>
      <geom type="capsule" size=".03" fromto="0.1 0 0 .4 0 0"/></body></body>
</worldbody>
<actuator><motor joint="a" ctrlrange="-60 60"/><motor joint="b" ctrlrange="-30 30"/></actuator></mujoco>
"""
REFERENCE = adaptctl.Sinusoids(*(np.array(x) for x in ([0.3, 0.5], [0.4, 0.3], [0.5, 0.8])))


@lru_cache
def scene(post: str = "9 9 9") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE.format(post=post))


@lru_cache
def learner() -> Any:
    """A law that begins at nine tenths of the arm's parameters."""
    arm = MuJoCoPlant.of(scene(), PERIOD).mechanism
    model = ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
    gain = np.maximum(0.3 * model.fundamental_parameters**2, 1e-4)
    law = GuardedLearning(gain, 1.0 / np.array([0.05, 0.03]) ** 2, cutoff=10.0)
    start = 0.9 * model.fundamental_parameters
    given: Any = (model, 8.0, [4.0, 1.0], law, start)
    return with_external_torque(SlotineLi(*given, torque_limits=np.inf))


class Felt:
    """A run on MuJoCo: external torques seen, levels, decisions, and MuJoCo's own torques through the same filters."""

    def __init__(self, duration: float, push: Any = None, post: str = "9 9 9", every: Any = None) -> None:
        law, plant = learner(), MuJoCoPlant.of(scene(post), PERIOD)
        first = REFERENCE(0.0)
        body, state = plant.init(first.p, first.v), law.init(first.p, first.v)
        self.states, self.true, stages = [], [], np.zeros((2, 2))
        keep, data = np.exp(-CUTOFF * PERIOD), plant._scene._data
        fore = plant.model.body("fore").id
        for k in range(round(duration / PERIOD)):
            point = REFERENCE(k * PERIOD)
            torque, state = law.step(state, body.p, body.v, ReferencePoint(*point))
            self.states.append(state)
            self.true.append(stages[1].copy())
            data.xfrc_applied[fore, :3] = 0.0 if push is None else push(k * PERIOD)
            acting = self._pushed(plant, data, fore)
            body = plant.step(body, torque)
            acting = acting + data.qfrc_constraint
            stages[0] = keep * stages[0] + (1.0 - keep) * acting
            stages[1] = keep * stages[1] + (1.0 - keep) * stages[0]
        touches = [s.law_state.touch for s in self.states]
        self.torque, self.level = (np.array([getattr(t, name) for t in touches]) for name in ("torque", "level"))
        self.decision = np.array([s.law_state.watch.decision[0] for s in self.states])
        self.true = np.array(self.true)

    @staticmethod
    def _pushed(plant: Any, data: Any, body: int) -> Array:
        """Torques of the force at the body's center of mass."""
        jacobian = np.zeros((3, 2))
        mujoco.mj_jacBodyCom(plant.model, data, jacobian, None, body)
        return np.asarray(jacobian.T @ data.xfrc_applied[body, :3])


def from_to(first: float, last: float) -> slice:
    return slice(round(first / PERIOD), round(last / PERIOD))


@lru_cache
def hand() -> Felt:
    """8 N for two seconds, after ten of learning."""
    return Felt(16.0, lambda t: (8.0, 0.0, 0.0) if 10.0 <= t < 12.0 else 0.0)


def test_external_torques_are_those_of_mujocos_forces() -> None:
    felt, held = hand(), from_to(10.0, 12.5)
    assert np.abs(felt.true[held]).max() > 3.0
    assert np.abs(felt.torque - felt.true)[held].max() < 0.03 * np.abs(felt.true[held]).max()
    assert np.abs(felt.torque[from_to(8.0, 10.0)]).max() < 0.02


def test_a_push_is_a_doubt_within_hundredths_of_a_second_and_is_not_learned() -> None:
    felt = hand()
    seen = np.flatnonzero(felt.decision[from_to(10.0, 12.0)] > 0.0)
    assert 0 < seen[0] <= 20
    assert (felt.decision[from_to(10.05, 12.9)] > 0.0).all()
    before, after = (felt.states[round(t / PERIOD)] for t in (9.99, 15.9))
    true = learner().model.fundamental_parameters
    errors = [np.abs(s.estimate - true).max() for s in (before, after)]
    assert errors[1] < 2.0 * errors[0] + 1e-3
    assert felt.decision[-1] == 0.0


def test_external_torques_are_those_of_mujocos_contacts() -> None:
    """A post in the way of the hand, which it hits at speed."""
    felt = Felt(8.0, post="0.32 0.66 0")
    touched = np.abs(felt.true).max(axis=1) > 1.0
    assert touched.sum() > 100
    last = np.flatnonzero(touched)[-1]
    off = np.abs(felt.torque - felt.true)[from_to(4.0, 8.0)]
    assert off.max() < 0.05 * np.abs(felt.true).max()
    assert (felt.decision[touched] > 0.0).mean() > 0.9
    assert last > 4000


def noise_of(lanes: int, steps: int, T: float, rng: Any) -> Array:
    """White noise through both filters, (steps, lanes)."""
    keep, stages, made = np.exp(-CUTOFF * T), np.zeros((2, lanes)), np.empty((steps, lanes))
    for k in range(steps):
        stages[0] = keep * stages[0] + (1.0 - keep) * rng.normal(size=lanes)
        stages[1] = keep * stages[1] + (1.0 - keep) * stages[0]
        made[k] = stages[1]
    return made


PROBES, SIZE = slice(3 + 2 * KINDS, 5 + 2 * KINDS), 8 + 2 * KINDS


@lru_cache
def judging(per_hour: float, T: float) -> Any:
    """Native code of the observer's judgement of one joint that always moves: next state of a torque and a state."""
    observer, sizes = ExternalTorque(CUTOFF, per_hour), (1, 1, KINDS, KINDS, 1, 2, 2, 1)
    passed: Any = Period(None, None, None, None, None, None, T, T, None)  # type: ignore[arg-type]

    def judged(torque: Column, state: Column) -> Column:
        numbers = iter(state)
        parts: Any = [Column(next(numbers) for _ in range(size)) for size in sizes]
        prediction: Any = FilteredPrediction([], torque, *2 * [Column((1.0,))], None)  # type: ignore[arg-type]
        missed = Missed(torque, Column((0.0,)), Column((1e6,)), 0.0)
        after = judged_by(observer, prediction, missed, passed, [0.1], Touch(*parts, None))  # type: ignore[arg-type]
        return Column(number for part in after[:-1] for number in part)

    return compile_function(judged, {"torque": 1, "state": sum(sizes)}, name="judged")


@pytest.mark.parametrize("heavy", mostly_at_night([False, True], False))
def test_noise_passes_the_level_at_the_stated_rate(heavy: bool) -> None:
    """Of a Gaussian variable, and of one that is three times as large for one second in four."""
    lanes, T, per_hour, seconds = 300, 16e-3, 60.0, 500.0
    noise = noise_of(lanes, round(seconds / T), T, np.random.default_rng(1))
    if heavy:
        noise[(np.arange(len(noise)) * T) % 4.0 < 1.0] *= 3.0
    kernel, state = judging(per_hour, T), np.zeros((lanes, SIZE))
    state[:, PROBES] = 2.5, 3.8
    held, alarms = np.zeros(lanes), 0
    for k, torque in enumerate(noise):
        state = kernel.map(torque[:, None], state)
        above = np.abs(state[:, 0]) > state[:, 1]
        alarms += int((above & (held <= 0.0)).sum()) if k * T > 250.0 else 0
        held = np.where(above, 1.0, held - T)
    expected = per_hour * lanes * (seconds - 250.0) / 3600.0
    assert 0.6 * expected < alarms < 1.4 * expected


def test_a_torque_that_rises_is_seen_before_it_has_raised_the_level() -> None:
    """By 20 deviations a second, after 10 s of noise: no minute has told yet what it seldom passes."""
    lanes, T, begin = 50, 4e-3, 2500
    noise = noise_of(lanes, begin + 125, T, np.random.default_rng(2))
    noise[begin:] += 20.0 * noise[:begin].std() * T * np.arange(125)[:, None]
    kernel, state, seen = judging(60.0, T), np.zeros((lanes, SIZE)), np.zeros(lanes, dtype=bool)
    state[:, PROBES] = 2.5, 3.8
    for k, torque in enumerate(noise):
        state = kernel.map(torque[:, None], state)
        seen |= (k >= begin) & (np.abs(state[:, 0]) > state[:, 1])
    assert seen.mean() > 0.9


def test_code_is_the_law_in_python() -> None:
    law, point = learner(), REFERENCE(0.0)
    state = hand().states[10_050]
    given = (point.p, point.v, *point)
    torque, after = law.step(state, point.p, point.v, ReferencePoint(*point))
    bare = law.fixed().python_step(*given, *leaves(state))
    np.testing.assert_allclose(bare[0], torque, rtol=1e-9)
    for one, other in zip(bare[1:], leaves(after), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-9)


def test_a_wrench_at_the_tool_is_the_push_but_for_what_the_posture_hides() -> None:
    arm = adaptctl.load("puma560_measured")
    p, wrench = np.array([0.3, -0.5, 0.2, 0.1, 0.6, 0.3]), np.array([5.0, -3.0, 8.0, 0.4, 0.2, -0.6])
    found = tool_wrench(arm, p, jacobian_at(arm, p).T @ wrench)
    np.testing.assert_allclose((*found.force, *found.moment), wrench, atol=1e-9)
    assert found.told == ""
    straight = p * np.array([1.0, 1.0, 1.0, 1.0, 0.0, 1.0])  # axes 4 and 6 are in line
    jacobian = jacobian_at(arm, straight)
    found = tool_wrench(arm, straight, jacobian.T @ wrench)
    assert found.hidden.shape == (1, 6)
    np.testing.assert_allclose(jacobian.T @ found.hidden[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(jacobian.T @ (*found.force, *found.moment), jacobian.T @ wrench, atol=1e-9)


def jacobian_at(arm: Any, p: Array) -> Array:
    """MuJoCo's Jacobian (6, r) at the last link's origin."""
    model = arm.to_mujoco()
    data, jacobian, last = mujoco.MjData(model), np.zeros((6, arm.dof)), arm.links[-1].name
    data.qpos[:] = p
    mujoco.mj_forward(model, data)
    point = Tip(arm, last, np.zeros(3)).at(p)
    mujoco.mj_jac(model, data, jacobian[:3], jacobian[3:], point, model.body(last).id)
    return jacobian


def test_a_planar_arm_names_what_it_cannot_feel() -> None:
    arm = learner().model.mechanism
    found = tool_wrench(arm, [0.3, 0.5], [2.0, 1.0], link="fore", point=(0.4, 0.0, 0.0))
    assert [name in found.told for name in ("force_z", "moment_x", "moment_y")] == [True] * 3
    np.testing.assert_allclose(found.unexplained, 0.0, atol=1e-12)
    upper = tool_wrench(arm, [0.3, 0.5], [2.0, 1.0], link="upper", level=[1.0, 0.1])
    assert abs(upper.unexplained[1]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("make", "error", "said"),
    [
        (lambda: ExternalTorque(0.0), InputError, "external torque: cutoff: expected a positive number in rad/s"),
        (lambda: ExternalTorque(alarms_per_hour=-1.0), InputError, "alarms_per_hour: expected a positive number"),
        (lambda: ExternalTorque(np.nan), InputError, "cutoff: .* got nan"),
        (lambda: with_external_torque(learner(), cutoff=2e3), InputError, "use at most 1000 rad/s"),
        (lambda: with_external_torque(replace(learner(), adaptation=None)), InputError, "expected one with Guarded"),
        (lambda: with_external_torque("law"), InputError, "expected one with GuardedLearning"),
        (lambda: replace(learner().adaptation, external_torque=60.0), InputError, "external_torque"),
        (lambda: tool_wrench(learner().model.mechanism, [0.0], [1.0, 2.0]), InputError, "p: "),
        (lambda: tool_wrench(learner().model.mechanism, [0.0, 0.0], [1.0, np.nan]), NonFiniteError, "torque"),
        (lambda: tool_wrench(learner().model.mechanism, [0.0, 0.0], [1.0, 2.0], link="hand"), InputError, "no link"),
        (lambda: tool_wrench(learner().model.mechanism, [0, 0], [1, 2], level=0.0), InputError, "level"),
    ],
)
def test_what_is_wrong_is_refused(make: Any, error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        make()


def test_the_observer_changes_no_law_that_has_none() -> None:
    bare = replace(learner(), adaptation=replace(learner().adaptation, external_torque=None))  # type: ignore[type-var]
    point = REFERENCE(0.0)
    states = [law.init(point.p, point.v) for law in (bare, learner())]
    for k in range(20):
        now = REFERENCE(k * PERIOD)
        made = [law.step(s, now.p, now.v, now) for law, s in zip((bare, learner()), states, strict=True)]
        np.testing.assert_allclose(made[0][0], made[1][0], rtol=1e-9)
        states = [s for _, s in made]
    assert states[0].logged_state.shape == (1,)
    assert states[1].logged_state.shape == (5,)
