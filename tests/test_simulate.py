"""Whole runs in native code are those of the Gymnasium loop: states, records, ends, faults, interruption."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RescaleAction, TimeLimit
from nightly import at_night, mostly_at_night
from random_trees import random_chain
from sampled_loops import RANGES, arm, full, gains, reduced, swinging

from adaptctl.arrays import Array
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.control import (
    AdaptationLaw,
    AdaptiveComputedTorque,
    BoundedGainForgetting,
    Composite,
    ComputedTorque,
    Controller,
    DeadZone,
    EModification,
    Gradient,
    Natural,
    PassivityIntegral,
    PDGravity,
    Projection,
    SafetyFilter,
    SigmaModification,
    SlotineLi,
    Subspace,
    TaskSpaceSlotineLi,
    adaptation_gain,
)
from adaptctl.control.controller import ReferencePoint
from adaptctl.description.drive import Drive
from adaptctl.envs import TrackingEnv
from adaptctl.errors import DivergedRunWarning, InputError, NonFiniteError, NotCompiledWarning, TraceError
from adaptctl.scalars import Column, maximum
from adaptctl.simulation import Integrator, Rollout, RungeKutta4, SemiImplicitEuler, rollout, simulate
from adaptctl.simulation.effects import (
    ActuatorLag,
    ControlDelay,
    Effect,
    Encoder,
    FilteredDifferences,
    Friction,
    LoadEffect,
    Payload,
    PayloadHeld,
    TorqueLimit,
    TorqueRateLimit,
)
from adaptctl.simulation.simulate import EpisodeRun

SMALL, LOOP = "puma560_arm3", "semi_direct_drive"
EFFECTS: dict[str, list[Effect]] = {
    "filtered differences": [FilteredDifferences(80.0)],
    "encoder": [Encoder(1e-4, 2e-5, 1e-3)],
    "payload": [PayloadHeld(1.5, 0.2, 0.6005), PayloadHeld(0.5, 0.3)],
    "friction": [Friction(0.5, 1.0, 0.5)],
    "lag": [ActuatorLag(4e-3)],
    "rate limit": [TorqueRateLimit(5e3)],
    "torque limit": [TorqueLimit(25.0)],
    "delay": [ControlDelay(2)],
}


def gain(name: str) -> Array:
    return adaptation_gain(reduced(name), RANGES, 0.3)


def on(name: str, adaptation: AdaptationLaw[Any]) -> SlotineLi:
    first = 1.2 * reduced(name).fundamental_parameters
    return SlotineLi(reduced(name), 8.0, gains(name).damping, adaptation, first)


CONTROLLERS: dict[str, Callable[[str], Controller[Any]]] = {
    "pd": lambda name: PDGravity.from_model(reduced(name), 300.0, gains(name).damping),
    "computed torque": lambda name: ComputedTorque.from_model(reduced(name), 8.0),
    "adaptive computed torque": lambda name: AdaptiveComputedTorque(
        reduced(name), 8.0, 1.2 * reduced(name).fundamental_parameters, 0.05 * gain(name)
    ),
    "integral": lambda name: PassivityIntegral(reduced(name), 8.0, gains(name).damping, gain(name)),
    "task space": lambda name: TaskSpaceSlotineLi(
        reduced(name), 8.0, gains(name).damping, gain(name), reference_in_joints=True, singularity=0.1
    ),
    "gradient": lambda name: on(name, Gradient(gain(name))),
    "sigma": lambda name: on(name, SigmaModification(gain(name), 0.2)),
    "e": lambda name: on(name, EModification(gain(name), 0.5)),
    "dead zone": lambda name: on(name, DeadZone(gain(name), 0.01)),
    "composite": lambda name: on(name, Composite(gain(name), 0.1)),
    "projection": lambda name: on(name, Projection(Gradient(gain(name)), np.full(15, -50.0), np.full(15, 50.0))),
    "bounded-gain forgetting": lambda name: on(name, BoundedGainForgetting(gain(name), 0.1)),
    "subspace": lambda name: on(name, Subspace(np.ones(4), np.eye(len(gain(name)))[:, 1:5])),
    "guarded": lambda name: SafetyFilter(on(name, Gradient(gain(name))), 25.0, 3e3, estimate_bounds=(-50.0, 50.0)),
    "guarded, not adaptive": lambda name: SafetyFilter(
        ComputedTorque.from_model(reduced(name), 8.0), 20.0, stop_damping=5.0
    ),
}


@lru_cache
def environment(name: str, effects: str = "", duration: float = 1.0) -> TrackingEnv:
    return TrackingEnv(
        arm(name),
        swinging(arm(name)),
        duration=duration,
        initial_error=0.05,
        effects=EFFECTS.get(effects, ()),
        torque_limits=60.0,
        error_bound=np.inf,
    )


def validate_equal(native: Rollout, python: Rollout, tolerance: float = 1e-9) -> None:
    """Every array within a tolerance relative to its largest number, and everything else the same."""
    for field in fields(Rollout):
        got, wanted = getattr(native, field.name), getattr(python, field.name)
        if isinstance(wanted, np.ndarray):
            assert not got.flags.writeable
            np.testing.assert_allclose(
                got, wanted, rtol=0.0, atol=tolerance * np.abs(wanted).max(initial=1e-300), err_msg=field.name
            )
        elif field.name not in ("wall_time", "flags", "info"):
            assert got == wanted, field.name
    assert list(native.flags) == list(python.flags)
    assert list(native.info) == list(python.info)
    assert native.info.get("flags") == python.info.get("flags")
    for name in native.flags:
        np.testing.assert_array_equal(native.flags[name], python.flags[name])
    for name in native.info.keys() - {"flags"}:
        np.testing.assert_allclose(native.info[name], python.info[name], rtol=tolerance)


def both(env: gymnasium.Env[Any, Any], controller: Controller[Any], **arguments: Any) -> Rollout:
    """A run in native code, after it was compared with the Gymnasium loop's."""
    python, native = rollout(env, controller, **arguments), simulate(env, controller, **arguments)
    validate_equal(native, python)
    return native


@pytest.mark.parametrize("law", mostly_at_night(CONTROLLERS, *list(CONTROLLERS)[::3]))
def test_every_law_runs_as_in_the_gymnasium_loop(law: str) -> None:
    run = both(environment(SMALL), CONTROLLERS[law](SMALL))
    assert len(run.time) == 1000
    assert run.reached_end


@pytest.mark.parametrize("effects", mostly_at_night(EFFECTS, *list(EFFECTS)[::2]))
def test_every_effect_acts_as_in_the_gymnasium_loop(effects: str) -> None:
    run = both(environment(SMALL, effects), on(SMALL, Gradient(gain(SMALL))), seed=7)
    assert run.measured_p is not None
    assert all(run.flags[name].any() for name in run.flags if name != "clipped")


@pytest.mark.parametrize("law", ["gradient", at_night("computed torque"), at_night("task space")])
def test_loops_run_as_in_the_gymnasium_loop(law: str) -> None:
    both(environment(LOOP), CONTROLLERS[law](LOOP))


@pytest.mark.parametrize(("integrator", "open_by"), [(RungeKutta4(), 1e-12), (SemiImplicitEuler(), 1e-7)])
def test_loops_stay_closed(integrator: Integrator, open_by: float) -> None:
    mechanism = arm(LOOP)
    env = TrackingEnv(mechanism, swinging(mechanism), duration=3.0, integrator=integrator)
    started = time.perf_counter()
    made = EpisodeRun(env.episode(), CONTROLLERS["gradient"](LOOP))
    run, q = made.driven(), made.reached.q
    assert 0.0 < run.wall_time <= time.perf_counter() - started
    assert len(run.time) == 3000
    assert np.abs(run.v).max() > 1.0
    residual = mechanism.equations.residual(Column(q.tolist()))
    assert np.abs(residual.of).max() < open_by


def test_estimates_of_rigid_bodies_run_as_in_the_gymnasium_loop() -> None:
    first = 1.2 * arm(LOOP).inertial_parameters
    both(environment(LOOP), SlotineLi(full(LOOP), 8.0, gains(LOOP).damping, Natural(0.02), first))


def test_all_effects_at_once_on_an_arm_with_drives_that_learns_and_is_guarded() -> None:
    effects = [effect for some in EFFECTS.values() for effect in some]
    mechanism = arm(SMALL).with_drives(Drive(rotor_inertia=0.1, viscous=0.5))
    env = TrackingEnv(
        mechanism, duration=1.0, effects=effects, integrator=SemiImplicitEuler(), substeps=2, error_bound=np.inf
    )
    run = both(env, SafetyFilter(ComputedTorque(mechanism, 8.0), 40.0, stop_damping=5.0), seed=3)
    names = ("torque_limited", "rate_limited", "payload", "torque_limited", "rate_limited")
    assert tuple(run.flags)[:3] == names[:3]
    np.testing.assert_array_equal(run.flags["payload"][[198, 199, 300, 599, 600]], [0.0, 1.5, 2.0, 2.0, 0.5])


def test_seeds_options_and_wrappers_of_make_are_the_same() -> None:
    env = gymnasium.make(
        "adaptctl.envs:adaptctl/Tracking-v0", robot=arm(SMALL), duration=1.5, effects=[Encoder(noise=1e-4)]
    )
    controller = ComputedTorque(arm(SMALL), 8.0)
    first = both(env, controller, seed=5, options={"payload": 1.0, "initial_error": 0.03})
    state = env.unwrapped.np_random.bit_generator.state
    rollout(env, controller, seed=5, options={"payload": 1.0, "initial_error": 0.03})
    assert env.unwrapped.np_random.bit_generator.state == state
    assert not np.array_equal(first.p, simulate(env, controller, seed=6).p)
    drawn = simulate(env, controller, seed=5), simulate(env, controller)  # Gymnasium's generator goes on
    assert not np.array_equal(*(run.reference_p for run in drawn))


def test_the_environment_takes_no_step_before_it_is_reset() -> None:
    env, controller = environment(SMALL, "payload"), ComputedTorque(arm(SMALL), 8.0)
    env.reset()
    simulate(env, controller)
    with pytest.raises(gymnasium.error.ResetNeeded, match="the episode is over"):
        env.step(np.zeros(3))


def test_a_passed_bound_ends_the_run_where_the_loop_ends() -> None:
    env = TrackingEnv(arm(SMALL), 3, duration=3.0, error_bound=0.3, effects=[Encoder(noise=1e-4)])
    controller = ComputedTorque(arm(SMALL), 8.0, parameters=np.zeros(30))
    with pytest.warns(
        DivergedRunWarning, match=r"the environment ended the run after [\d.]+ s, before its end"
    ) as told:
        run = both(env, controller, seed=0)
    assert {str(one.message).partition(":")[0] for one in told} == {"rollout", "simulate"}
    assert run.terminated
    assert 0 < len(run.time) < 3000
    assert not run.reached_end
    left = env.np_random.random()
    with pytest.warns(DivergedRunWarning, match="rollout: the environment ended the run"):
        rollout(env, controller, seed=0)
    assert left == env.np_random.random()


def test_a_loop_that_nears_its_singularity_ends_the_run() -> None:
    env = TrackingEnv(arm(LOOP), swinging(arm(LOOP)), duration=3.0, error_bound=np.inf)
    with pytest.warns(DivergedRunWarning):
        run = both(env, ComputedTorque(arm(LOOP), 8.0, parameters=np.zeros(50)))
    assert run.terminated


@pytest.mark.filterwarnings("ignore::adaptctl.errors.ReferenceWarning")
def test_a_law_that_runs_away_raises_what_the_loop_raises() -> None:
    class Halting(Spring):
        """Its stiffness has a pole where its reference comes to in a while."""

        def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Any) -> tuple[Column, Any]:
            late = 1.0 / maximum(0.5 - reference.a[0], 0.0)
            return Column(late * x * (reference.a[0] - reference.a[0] + 1.0) for x in p), memory

    def ramp(t: Any) -> ReferencePoint:
        return ReferencePoint(*np.broadcast_to(np.asarray(t)[..., None], (3, *np.shape(t), 3)))

    env = TrackingEnv(arm(SMALL), ramp, duration=3.0, error_bound=np.inf)
    told = []
    for drive in (rollout, simulate):
        with pytest.raises(NonFiniteError, match="the torque is not finite for finite arguments") as raised:
            drive(env, Halting())
        told.append((str(raised.value), env.np_random.bit_generator.state))
    assert told[0] == told[1]


def test_a_motion_that_runs_away_raises_what_the_loop_raises() -> None:
    class Pushing(Spring):
        """Pushes the faster the faster it goes."""

        def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Any) -> tuple[Column, Any]:
            return 1e3 * v + Column((1.0, 1.0, 1.0)), memory

    env = TrackingEnv(arm(SMALL), swinging(arm(SMALL)), duration=3.0, error_bound=np.inf, torque_limits=1e200)
    told = []
    for drive in (rollout, simulate):
        with pytest.raises(NonFiniteError, match="diverged after") as raised, np.errstate(over="ignore"):
            drive(env, Pushing())
        told.append(str(raised.value))
    assert told[0] == told[1]


def test_an_interrupted_run_keeps_what_was_computed() -> None:
    env, controller = environment(SMALL, duration=12.5), ComputedTorque(arm(SMALL), 8.0)
    whole, told = simulate(env, controller), list[float]()

    def interrupt(share: float) -> None:
        told.append(share)
        if share > 0.5:
            signal.raise_signal(signal.SIGINT)

    part = simulate(env, controller, progress=interrupt)
    assert told == [0.16, 0.8]
    assert (part.interrupted, len(part.time), part.info["time"]) == (True, 10_000, 10.0)
    np.testing.assert_array_equal(part.p, whole.p[:10_000])
    np.testing.assert_array_equal(part.estimate, whole.estimate[:10_000])

    def at_once(t: Any) -> ReferencePoint:
        if np.size(t) == 1001:
            signal.raise_signal(signal.SIGINT)
        return swinging(arm(SMALL))(t)

    nothing = simulate(TrackingEnv(arm(SMALL), at_once, duration=1.0), controller)
    assert (nothing.interrupted, nothing.p.shape, nothing.flags) == (True, (0, 3), {})


def test_what_changes_all_along_is_followed() -> None:
    class Leaking(LoadEffect):
        def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
            """It fits any."""

        def mass(self, time: float) -> float:
            return 2.0 - time

        def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
            return Payload(self.mass(time)).added_to(parameters, len(links) - 1)

    env = TrackingEnv(arm(SMALL), swinging(arm(SMALL)), duration=0.05, effects=[Leaking()])
    run = both(env, ComputedTorque(arm(SMALL), 8.0))
    np.testing.assert_allclose(run.flags["payload"], 1.999 - run.time, atol=1e-12)


class Spring(Controller[tuple[()]]):
    """Pulls every joint to its reference, and forgets."""

    dof = 3

    def initial_state(self, p: Array, v: Array) -> tuple[()]:
        return ()

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: tuple[()]) -> tuple[Column, tuple[()]]:
        return -20.0 * (p - reference.p) - 5.0 * (v - reference.v), ()


class OwnStep(Spring):
    """In NumPy, with a step of its own."""

    def step(self, state: tuple[()], p: Any, v: Any, reference: ReferencePoint) -> tuple[Array, tuple[()]]:
        return 20.0 * (reference.p - p), ()


@pytest.mark.parametrize(
    ("wrapped", "controller", "reason"),
    [
        (lambda env: RescaleAction(env, -1.0, 1.0), Spring(), "the wrapper RescaleAction is not supported"),
        (lambda env: TimeLimit(env, 20), Spring(), "the time limit is unknown"),
        (lambda env: env, OwnStep(), "OwnStep has a custom step"),
    ],
)
def test_what_cannot_be_compiled_is_driven_step_by_step(
    wrapped: Any, controller: Spring, reason: str, tmp_path: Path
) -> None:
    env = wrapped(environment(SMALL, duration=0.05))
    with pytest.warns(NotCompiledWarning, match=f"{reason}.*running step by step with rollout"):
        run = simulate(env, controller, seed=1, stream=tmp_path / "run.parquet")
    validate_equal(run, rollout(env, controller, seed=1))
    np.testing.assert_array_equal(Rollout.load(tmp_path / "run.parquet").p, run.p)


def test_environments_with_a_step_of_their_own_are_driven_step_by_step() -> None:
    class Windy(TrackingEnv):
        def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
            return super().step(np.asarray(action) + 1.0)

    class Noted(TrackingEnv):
        """It begins as it likes, and its episodes are those of every other."""

        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, Any]:
            return super().reset(seed=seed, options={"initial_error": 0.02})

    both(Noted(arm(SMALL), swinging(arm(SMALL)), duration=0.02), Spring())
    env = Windy(arm(SMALL), swinging(arm(SMALL)), duration=0.02)
    with pytest.warns(NotCompiledWarning, match="Windy has a custom step"):
        run = simulate(env, Spring())
    np.testing.assert_allclose(run.applied, run.torque + 1.0)


def test_arms_too_long_to_compile_are_driven_step_by_step() -> None:
    chain = random_chain(0, MAX_COMPILED_LINKS + 1)
    env = TrackingEnv(chain, duration=0.002)
    with pytest.warns(NotCompiledWarning, match=f"{MAX_COMPILED_LINKS + 1} links are too many to compile"):
        assert simulate(env, ComputedTorque(chain, 5.0)).reached_end


def test_what_does_not_fit_is_refused_as_by_the_loop() -> None:
    with pytest.raises(InputError, match="has 3 joints, but the controller has 6"):
        simulate(environment(SMALL), ComputedTorque(arm("puma560_measured"), 8.0))
    with pytest.raises(InputError, match="needs a control_period in s and observation_slices"):
        simulate(gymnasium.make("Pendulum-v1"), Spring())

    class Branching(Spring):
        def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Any) -> tuple[Column, Any]:
            return (p if p[0] > 0.0 else v), memory

    with pytest.raises(TraceError, match="where"):
        simulate(environment(SMALL), Branching())
