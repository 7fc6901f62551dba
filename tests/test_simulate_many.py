"""Many runs at once are those of one after the other, each its own, and what is kept of them is bounded."""

from __future__ import annotations

import signal
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from nightly import mostly_at_night, turn_by_turn
from random_trees import random_chain
from sampled_loops import arm, gains, posture, reduced, swinging

from adaptctl.arrays import Array
from adaptctl.compilation import compile_step
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.control import ComputedTorque, MinimumJerk, PDGravity, Sinusoids, SlotineLi
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.dynamics import Mechanism
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation import Plant, rollout, simulate, simulate_many
from adaptctl.simulation.closed_loop import ClosedLoop
from adaptctl.simulation.effects import (
    ControlDelay,
    Effect,
    Encoder,
    FilteredDifferences,
    PayloadHeld,
    TorqueLimit,
)

pytestmark = pytest.mark.usefixtures("optimized")

SMALL, LOOP, PERIOD = "puma560_arm3", "semi_direct_drive", 1e-3
REAL: list[Effect] = [
    ControlDelay(1), TorqueLimit(50.0), PayloadHeld(1.0, 0.1, 0.2), Encoder(1e-4), FilteredDifferences(100.0)
]  # fmt: skip
LIMIT = 60.0


def learning(name: str) -> SlotineLi:
    first = 1.2 * reduced(name).fundamental_parameters
    return SlotineLi(reduced(name), 8.0, gains(name).damping, np.full(len(first), 0.05), first)


def real(mechanism: Mechanism, effects: list[Effect]) -> Plant:
    return Plant(mechanism, PERIOD, torque_limits=LIMIT, effects=effects)


def one_by_one(
    name: str, effects: list[Effect], references: list[Any], parameters: Array, off: Array, duration: float
) -> list[Any]:
    """The same runs in Gymnasium's loop."""
    env = TrackingEnv(
        arm(name), duration=duration, effects=effects, error_bound=np.inf, torque_limits=LIMIT, initial_error=0.0
    )
    found = []
    for reference, true, error in zip(references, parameters, off, strict=True):
        options = {"trajectory": reference, "parameters": true, "initial_error": error}
        found.append(rollout(env, learning(name), seed=0, options=options))
    return found


@pytest.mark.parametrize("name", [SMALL, LOOP])
@pytest.mark.parametrize("effects", [[], [PayloadHeld(1.0, 0.1, 0.2)]], ids=["ideal", "loaded"])
def test_a_run_by_itself_is_the_same_to_the_last_bit(name: str, effects: list[Effect]) -> None:
    """By `simulate`, and by `simulate_many` as one of several or alone."""
    law, reference = learning(name), swinging(arm(name), seed=2, amplitude=0.05)
    env = TrackingEnv(arm(name), reference, duration=0.4, effects=effects, error_bound=np.inf, torque_limits=LIMIT)
    started, run = (
        env.episode(options={"initial_error": 0.02}).state,
        simulate(env, law, options={"initial_error": 0.02}),
    )
    for off in (np.zeros((1, 1)), np.array([[0.0], [0.01], [-0.01]])):
        start = {"p": started.p + off, "v": np.broadcast_to(started.v, (len(off), law.dof))}
        many = simulate_many(env.plant, law, reference, duration=0.4, **start)
        for part in ("p", "v", "reference_p", "torque", "applied", "estimate"):
            np.testing.assert_array_equal(getattr(many, part)[:, 0], getattr(run, part), err_msg=part)


@pytest.mark.parametrize(
    ("name", "effects", "kind"),
    mostly_at_night(
        product([SMALL, LOOP], [[], REAL], ["sinusoids", "samples", "one"]),
        *((SMALL, [], "samples"), (SMALL, REAL, "one"), (LOOP, REAL, "sinusoids"), (LOOP, [], "samples")),
    ),
)
def test_each_arm_runs_as_it_does_alone(name: str, effects: list[Effect], kind: str) -> None:
    mechanism, members, duration = arm(name), 5, 0.3
    rng = np.random.default_rng(1)
    references: list[Any] = [swinging(mechanism, seed=k, amplitude=0.05) for k in range(members)]
    if kind == "samples":
        home = posture(mechanism)
        references[2:] = [MinimumJerk([home, home + 0.1 * k], [0.0, duration]) for k in range(2, members)]
    if kind == "one":
        references = references[:1] * members
    parameters = mechanism.inertial_parameters * rng.uniform(0.95, 1.05, (members, 1))
    off = 0.05 * rng.normal(size=(members, mechanism.dof))
    start = [reference(0.0) for reference in references]
    together = simulate_many(
        real(mechanism, effects),
        learning(name),
        references[0] if kind == "one" else references,
        duration=duration,
        parameters=parameters,
        p=np.array([point.p for point in start]) + off,
        v=np.array([point.v for point in start]),
    )
    assert together.complete
    assert together.finite.all()
    alone = one_by_one(name, effects, references, parameters, off, duration)
    for k, run in enumerate(alone):
        for column in ("p", "v", "reference_p", "reference_v", "torque", "applied", "estimate"):
            wanted = getattr(run, column)
            np.testing.assert_allclose(
                getattr(together, column)[:, k],
                wanted,
                rtol=0.0,
                atol=1e-9 * max(np.abs(wanted).max(), 1e-3),
                err_msg=column,
            )
        np.testing.assert_allclose(together.rms_error[k], np.sqrt((run.error**2).mean(axis=0)), rtol=1e-9)
        np.testing.assert_allclose(together.largest_error[k], np.abs(run.error).max(axis=0), rtol=1e-9)
    np.testing.assert_array_equal(together.time, alone[0].time)


def test_arms_of_another_loop_and_those_there_are_not_are_refused() -> None:
    own, other = (
        ClosedLoop(Plant(arm(SMALL), PERIOD), law) for law in (PDGravity(arm(SMALL), 9.0, 9.0), learning(SMALL))
    )
    arms, others = own.compiled().ensemble(2), other.compiled().ensemble(2)
    state = own.plant.init(np.zeros(3), np.zeros(3))
    says = "closed loop: expected memory_0 of length 3, got 15"
    with pytest.raises(InputError, match=says):
        own.set_state(others, state, own.controller.init(state.p, state.v))
    with pytest.raises(InputError, match=says):
        own.get_state(others, 0.0)
    for wrong in (-1, 2, 0.5):
        with pytest.raises(InputError, match="closed loop: member: expected a whole number from 0 to 1"):
            own.get_state(arms, 0.0, wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "effects"), turn_by_turn([SMALL, LOOP], [REAL, []]))
def test_a_period_in_lanes_is_one_on_floats(name: str, effects: list[Effect]) -> None:
    mechanism, members, rng = arm(name), 5, np.random.default_rng(3)
    loop, true = ClosedLoop(real(mechanism, effects), learning(name)), mechanism.inertial_parameters
    columns = {part: rng.normal(size=(members, size)) for part, size in (loop.reference | loop.noise).items()}
    p = posture(mechanism) + 0.1 * rng.normal(size=(members, mechanism.dof))
    start = loop.plant.init(p, rng.normal(size=p.shape), true, columns["noise"])
    told = {"parameters": true} | columns
    found = []
    for lanes in (1, 2, 4, 8):
        given = {"state": loop.state, "constants": loop.held, "per_member_inputs": loop.reference | loop.noise}
        arms = compile_step(loop.step, **given, lanes=lanes).ensemble(members)
        loop.set_state(arms, start, loop.controller.init(start.p, start.v))
        arms.held["parameters"] = true
        states = {part: arms.state[part] for part in loop.state}
        outputs = arms.run(1, {part: values[None] for part, values in columns.items()})
        found.append([*(arms.state[part] for part in loop.state), *outputs])
    for k in range(members):
        rows = {part: np.broadcast_to(x, (members, x.shape[-1]))[k] for part, x in (states | told).items()}
        plain = loop.step(**{part: Column(row.tolist()) for part, row in rows.items()})
        for native in found:
            for got, wanted in zip(native, plain, strict=True):
                largest = np.abs(wanted.of).max(initial=1.0)
                np.testing.assert_allclose(got[k], wanted.of, rtol=0.0, atol=1e-12 * largest)


def test_a_sample_now_and_then_is_one_of_all_samples() -> None:
    mechanism, law = arm(SMALL), learning(SMALL)
    plant = real(mechanism, [Encoder(noise=1e-4), PayloadHeld(1.0, 0.1, 0.2)])
    every = {
        n: simulate_many(
            plant, law, swinging(mechanism), duration=0.25, batch_size=3, seed=4, record_every=n, threads=threads
        )
        for n, threads in ((1, 1), (7, 2), (250, 1))
    }
    for n, runs in every.items():
        np.testing.assert_array_equal(runs.time, every[1].time[::n])
        for column in ("p", "v", "reference_p", "torque", "estimate", "error"):
            np.testing.assert_array_equal(getattr(runs, column), getattr(every[1], column)[::n])
        np.testing.assert_array_equal(runs.rms_error, every[1].rms_error)
    assert not np.array_equal(every[1].torque[:, 0], every[1].torque[:, 1])  # each has noise of its own
    other = simulate_many(plant, law, swinging(mechanism), duration=0.25, batch_size=3, seed=5, record_every=250)
    assert not np.array_equal(other.rms_error, every[1].rms_error)
    with pytest.raises(ValueError, match="read-only"):
        other.p[0] = 0.0


def test_one_reference_for_all_is_that_of_each() -> None:
    mechanism = arm(SMALL)
    plant, law, one = Plant(mechanism, PERIOD), learning(SMALL), swinging(mechanism)
    off = np.array([[0.1], [0.0], [-0.1]]) + one(0.0).p
    shared = simulate_many(plant, law, [one] * 3, duration=0.2, p=off)
    given = simulate_many(plant, law, one, duration=0.2, p=off)
    own = simulate_many(plant, law, [replace(one) for _ in off], duration=0.2, p=off)
    for name in ("p", "torque", "estimate", "reference_p", "rms_error", "lyapunov_rise"):
        np.testing.assert_array_equal(getattr(shared, name), getattr(given, name))
        np.testing.assert_allclose(getattr(shared, name), getattr(own, name), rtol=1e-9, atol=1e-12)
    assert simulate_many(plant, law, [one] * 5, duration=0.01).p.shape == (10, 5, 3)
    with pytest.raises(InputError, match="in all arguments, got reference 4, p 3"):
        simulate_many(plant, law, [one] * 4, duration=0.2, p=off)


def test_an_arm_that_is_lost_takes_no_other_with_it() -> None:
    mechanism = arm(SMALL)
    plant, law = Plant(mechanism, PERIOD), ComputedTorque(mechanism, 8.0)
    parameters = np.tile(mechanism.inertial_parameters, (9, 1))
    parameters[4] = 0.0  # no force moves it by a finite acceleration
    runs = simulate_many(plant, law, swinging(mechanism), duration=1.0, parameters=parameters, record_every=100)
    alone = simulate_many(plant, law, swinging(mechanism), duration=1.0, record_every=100)
    lost = np.arange(9) == 4
    np.testing.assert_array_equal(runs.finite, ~lost)
    for column in ("p", "torque"):
        np.testing.assert_array_equal(
            getattr(runs, column)[:, ~lost], np.repeat(getattr(alone, column), 8, axis=1), err_msg=column
        )


def test_arms_may_begin_with_estimates_of_their_own() -> None:
    mechanism, law, members = arm(SMALL), learning(SMALL), 3
    at = posture(mechanism)
    memory = law.init(np.tile(at, (members, 1)), np.zeros((members, 3)))
    memory.estimate[:] *= np.array([[1.0], [0.5], [1.0]])
    still = Sinusoids(at, np.zeros(3), np.zeros(3))
    runs = simulate_many(Plant(mechanism, PERIOD), law, still, duration=0.05, memory=memory)
    np.testing.assert_array_equal(runs.estimate[0], memory.estimate)
    np.testing.assert_array_equal(runs.torque[:, 0], runs.torque[:, 2])
    assert np.all(runs.rms_error[1] > 2.0 * runs.rms_error[0])


def test_interrupted_runs_keep_what_was_computed() -> None:
    mechanism, law = arm(SMALL), learning(SMALL)

    def interrupt(share: float) -> None:
        if share > 0.5:
            signal.raise_signal(signal.SIGINT)

    arguments: dict[str, Any] = {"duration": 0.2, "batch_size": 2, "record_every": 10}
    whole = simulate_many(Plant(mechanism, PERIOD), law, swinging(mechanism), **arguments)
    part = simulate_many(Plant(mechanism, PERIOD), law, swinging(mechanism), progress=interrupt, **arguments)
    assert (whole.complete, part.complete) == (True, False)
    assert len(part.time) == 11
    np.testing.assert_array_equal(part.p, whole.p[:11])


def test_an_interrupted_native_call_counts_for_nothing() -> None:
    """The errors are those of the samples that are kept."""
    mechanism, law = arm(SMALL), learning(SMALL)

    def interrupt_soon(share: float) -> None:
        if share < 0.1:
            signal.setitimer(signal.ITIMER_REAL, 0.01)

    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        part = simulate_many(
            Plant(mechanism, PERIOD), law, swinging(mechanism), duration=300.0, progress=interrupt_soon
        )
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert not part.complete
    np.testing.assert_allclose(part.rms_error, np.sqrt(np.mean(part.error**2, axis=0)), rtol=1e-9)
    np.testing.assert_array_equal(part.largest_error, np.abs(part.error).max(axis=0))


class OwnStep(ComputedTorque):
    def step(self, state: Any, p: Any, v: Any, reference: ReferencePoint) -> Any:
        return np.zeros(3), state


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ({"duration": 0.0}, "duration: expected at least a control period of 0.001 s, got 0.0"),
        ({"record_every": 0}, "record_every: expected a whole number of at least 1, got 0"),
        ({"record_every": np.nan}, "record_every: expected a whole number of at least 1, got nan"),
        ({"batch_size": 0}, "batch_size: expected a whole number of at least 1, got 0"),
        ({"batch_size": 2.5}, "batch_size: expected a whole number of at least 1, got 2.5"),
        ({"batch_size": True}, "batch_size: expected a whole number of at least 1, got True"),
        ({"duration": "a"}, "duration: expected at least a control period of .* got 'a'"),
        ({"seed": "a"}, "seed: expected a whole number of at least 0, got 'a'"),
        ({"seed": 1.5}, r"seed: expected a whole number of at least 0, got 1\.5"),
        ({"seed": -1}, "seed: expected a whole number of at least 0, got -1"),
        ({"seed": [0, True]}, "seed: expected a whole number of at least 0, got True"),
        ({"seed": [1, [2]]}, r"seed: expected a whole number of at least 0, got \[2\]"),
        ({"seed": np.array([1.0, 2.0])}, r"seed: expected a whole number of at least 0, got 1\.0"),
        ({"threads": 0}, "threads: expected a whole number of at least 1, got 0"),
        (
            {"memory": ()},
            r"memory: expected the result of ComputedTorque.init, .* \[\(3,\)\], got \[\]",
        ),
        ({"memory": (np.zeros(2),)}, r"\[\(3,\)\], got \[\(2,\)\]"),
        (
            {"batch_size": 3, "p": np.zeros((2, 3))},
            "expected one row per arm in all arguments, got p 2, batch_size 3",
        ),
        ({"p": np.zeros((2, 2, 3))}, "got p 2×2"),
        ({"parameters": np.zeros(7)}, r"parameters: expected shape \(..., 30\), got \(7,\)"),
        ({"reference": []}, r"reference: expected a Reference or a sequence of them, got \[\]"),
        ({"reference": [Sinusoids([0.0], [0.1], [0.2])]}, r"reference: p: expected shape \(..., 3\), got \(1, 1\)"),
        (
            {"controller": ComputedTorque(arm("puma560_measured"), 8.0)},
            "the plant has 3 joints, but the controller has 6",
        ),
        ({"controller": OwnStep(arm(SMALL), 8.0)}, "OwnStep has a custom step"),
    ],
)
def test_what_does_not_fit_together_is_refused(arguments: dict[str, Any], what: str) -> None:
    mechanism = arm(SMALL)
    usual = {"plant": Plant(mechanism, PERIOD), "controller": ComputedTorque(mechanism, 8.0), "duration": 0.1}
    with pytest.raises(InputError, match=what):
        simulate_many(**({"reference": swinging(mechanism)} | usual | arguments))


def test_arms_too_long_to_compile_are_refused() -> None:
    chain = random_chain(0, MAX_COMPILED_LINKS + 1)
    law: Controller[Any] = ComputedTorque(chain, 5.0)
    still = Sinusoids(np.zeros(chain.dof), np.zeros(chain.dof), np.zeros(chain.dof))
    with pytest.raises(InputError, match=f"{MAX_COMPILED_LINKS + 1} links are too many to compile"):
        simulate_many(Plant(chain, PERIOD), law, still, duration=0.1)
