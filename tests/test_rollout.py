"""Closed-loop runs: what is recorded, interruption, and environments that are and are not fit."""

from __future__ import annotations

import signal
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit

from adaptctl.arrays import Array
from adaptctl.control import ComputedTorque
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import DivergedRunWarning, InputError, NonFiniteError
from adaptctl.scalars import Column
from adaptctl.simulation import Rollout, rollout


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


@pytest.fixture(scope="module")
def env(puma: Mechanism) -> TrackingEnv:
    return TrackingEnv(puma, 3, duration=0.3, initial_error=0.1)


@pytest.fixture(scope="module")
def controller(puma: Mechanism) -> ComputedTorque:
    return ComputedTorque(puma, 20.0)


@pytest.fixture(scope="module")
def run(env: TrackingEnv, controller: ComputedTorque) -> Rollout:
    return rollout(env, controller, seed=0)


class Rail(gymnasium.Env[Array, Array]):
    """A kilogram on a rail, which knows nothing of adaptctl but the observation's slices."""

    control_period = 0.01
    observation_slices = {  # noqa: RUF012
        name: slice(i, i + 1) for i, name in enumerate(("reference_a", "reference_v", "reference_p", "v", "p"))
    }
    observation_space = gymnasium.spaces.Box(-10.0, 10.0, (5,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        self.p, self.v = 1.0, 0.0
        return self.observed(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        self.v += 0.01 * float(action[0])
        self.p += 0.01 * self.v
        return self.observed(), -abs(self.p), False, False, {}

    def observed(self) -> Array:
        return np.array([0.0, 0.0, 0.0, self.v, self.p], dtype=np.float32)


class Spring(Controller[tuple[()]]):
    """Pulls every joint to its reference, and forgets."""

    dof = 1

    def initial_state(self, p: Array, v: Array) -> tuple[()]:
        return ()

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: tuple[()]) -> tuple[Column, tuple[()]]:
        return -1.0 * (p - reference.p) - 1.0 * (v - reference.v), ()


def test_samples_are_the_states_and_the_torques_on_them(
    run: Rollout, env: TrackingEnv, controller: ComputedTorque
) -> None:
    """Replaying the recorded torques gives the recorded states."""
    assert run.time.shape == (300,)
    assert run.p.shape == run.reference_a.shape == run.torque.shape == (300, 6)
    assert run.estimate.shape == (300, 0)
    assert (run.reached_end, run.terminated, run.control_period) == (True, False, 1e-3)
    observation, info = env.reset(seed=0)
    where = env.observation_slices
    for k in range(300):
        np.testing.assert_array_equal(run.p[k], observation[where["p"]])
        np.testing.assert_array_equal(run.reference_v[k], observation[where["reference_v"]])
        assert (run.time[k], run.energy[k]) == (info["time"], info["energy"])
        observation, reward, _, _, info = env.step(run.torque[k])
        assert run.reward[k] == reward
    reference = env.reference(run.time)
    np.testing.assert_allclose(run.error, run.p - reference.p, atol=1e-15)
    np.testing.assert_allclose(run.reference_a, reference.a, atol=1e-15)
    state = controller.init(run.p[7], run.v[7])
    point = ReferencePoint(run.reference_p[7], run.reference_v[7], run.reference_a[7])
    np.testing.assert_array_equal(run.torque[7], controller.step(state, run.p[7], run.v[7], point)[0])


def test_the_error_decays_as_computed_torque_says(run: Rollout) -> None:
    """Critically damped at 20/s from 0.1 rad at rest: (1 + 20 t) exp(-20 t), up to the hold of 1 ms."""
    expected = 0.1 * (1.0 + 20.0 * run.time) * np.exp(-20.0 * run.time)
    np.testing.assert_allclose(run.error, np.broadcast_to(expected[:, None], run.error.shape), atol=2e-3)


def test_a_seed_gives_one_run_and_arrays_are_read_only(puma: Mechanism, controller: ComputedTorque) -> None:
    env = TrackingEnv(puma, duration=0.05)
    first, again, other = (rollout(env, controller, seed=seed) for seed in (5, 5, 6))
    assert first.p.tobytes() == again.p.tobytes()
    assert first.torque.tobytes() == again.torque.tobytes()
    assert not np.array_equal(first.p, other.p)
    with pytest.raises(ValueError, match="read-only"):
        first.p[0, 0] = 1.0


def test_clipped_torques_are_told(puma: Mechanism) -> None:
    env = TrackingEnv(puma, 3, duration=0.2, initial_error=0.3)
    run = rollout(env, ComputedTorque(puma, 25.0), seed=0)
    limits = puma.effort_limits
    np.testing.assert_array_equal(run.applied, np.clip(run.torque, -limits, limits))
    np.testing.assert_array_equal(run.clipped, (np.abs(run.torque) > limits).any(axis=1))
    assert 0 < run.clipped.sum() == run.info["clipped"] < 200


def test_options_reach_the_environment(env: TrackingEnv, controller: ComputedTorque, run: Rollout) -> None:
    with pytest.warns(DivergedRunWarning, match="the environment ended the run after"):
        loaded = rollout(env, controller, seed=0, options={"payload": 2.0})
    assert np.abs(loaded.error[-1]).max() > 10.0 * np.abs(run.error[-1]).max()


def test_a_passed_bound_ends_the_run(puma: Mechanism) -> None:
    without = ComputedTorque(puma, 20.0, parameters=np.zeros(60))
    with pytest.warns(DivergedRunWarning, match="the environment ended the run after"):
        run = rollout(TrackingEnv(puma, 3, duration=2.0), without, seed=0)
    assert run.terminated
    assert not run.interrupted
    assert not run.reached_end
    assert 0 < len(run.time) < 2000


def test_progress_is_told_seldom(env: TrackingEnv, controller: ComputedTorque) -> None:
    told: list[float] = []
    rollout(env, controller, progress=told.append)
    np.testing.assert_allclose(told, np.arange(1, 101) / 100)


def test_an_interrupted_run_keeps_what_was_computed(env: TrackingEnv, controller: ComputedTorque, run: Rollout) -> None:
    def interrupt(share: float) -> None:
        if share > 0.5:
            signal.raise_signal(signal.SIGINT)

    half = rollout(env, controller, seed=0, progress=interrupt)
    assert half.interrupted
    assert len(half.time) == 153
    np.testing.assert_array_equal(half.p, run.p[:153])
    np.testing.assert_array_equal(half.torque, run.torque[:153])


def test_any_environment_with_slices_will_do() -> None:
    """In another order, of float32, of unknown length, telling nothing in `info`."""
    short = rollout(TimeLimit(Rail(), 50), Spring())
    assert len(short.time) == 50
    assert np.isnan(short.energy).all()
    np.testing.assert_array_equal(short.torque, short.applied)
    np.testing.assert_allclose(short.time, 0.01 * np.arange(50))
    np.testing.assert_allclose(short.torque, -short.p - short.v, atol=1e-15)


def test_memory_grows_where_the_length_is_unknown() -> None:
    class Ending(Rail):
        def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
            observation, reward, *_ = super().step(action)
            self.taken = getattr(self, "taken", 0) + 1
            return observation, reward, False, self.taken == 3000, {}

    run = rollout(Ending(), Spring())
    assert run.p.shape == (3000, 1)
    assert np.abs(run.p[-1]).max() < 1e-3 * np.abs(run.p[0]).max()


def test_unfit_environments_are_refused(env: TrackingEnv, controller: ComputedTorque) -> None:
    with pytest.raises(InputError, match="needs a control_period in s and observation_slices"):
        rollout(gymnasium.make("Pendulum-v1"), controller)
    with pytest.raises(InputError, match="has 1 joints, but the controller has 6"):
        rollout(Rail(), controller)
    with pytest.raises(InputError, match="has 6 joints, but the controller has 1"):
        rollout(env, Spring())

    class Blind(Rail):
        observation_slices = {"p": slice(0, 1)}  # noqa: RUF012

    with pytest.raises(InputError, match="missing: v, reference_p, reference_v, reference_a"):
        rollout(Blind(), Spring())


def test_what_a_controller_raises_passes(env: TrackingEnv, puma: Mechanism) -> None:
    bad = TrackingEnv(puma, lambda t: ReferencePoint(*np.full((3, *np.shape(t), 6), np.nan)), duration=0.1)
    with pytest.raises(NonFiniteError, match="reference"):
        rollout(bad, ComputedTorque(puma, 10.0))


@pytest.mark.parametrize("seed", ["x", -1, 1.5])
def test_a_seed_that_is_no_whole_number_is_refused(seed: object) -> None:
    env = TrackingEnv(load("two_link"), duration=0.1)
    with pytest.raises(InputError, match="seed"):
        rollout(env, ComputedTorque(env.mechanism, 5.0), seed=seed)  # type: ignore[arg-type]
