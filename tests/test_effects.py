"""What real plants have: each effect by the law it follows, their order, and what they refuse."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from every_effect import RIGID
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain, random_tree
from scipy.integrate import solve_ivp

from adaptctl.arrays import Array
from adaptctl.compilation import compile_step
from adaptctl.control import ComputedTorque
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.recursion.drive import COULOMB_SMOOTHING_SPEED
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation import LinearlyImplicitEuler, Plant, RungeKutta4, SemiImplicitEuler, rollout
from adaptctl.simulation.effects import (
    ActuatorEffect,
    ActuatorLag,
    ControlDelay,
    Effect,
    Encoder,
    FilteredDifferences,
    Friction,
    Payload,
    PayloadHeld,
    TorqueLimit,
    TorqueRateLimit,
)
from adaptctl.simulation.integrator import Integration, friction_rate, integration

PERIOD = 1e-3


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_geared")


def acted(effect: ActuatorEffect, commands: Array, held: Array) -> Array:
    """What comes out of an effect, a control period a row, over floats."""
    memory, out = Column(effect.initial_state(held, PERIOD).tolist()), []
    for command in commands:
        torque, memory = effect.apply(Column(command.tolist()), memory, PERIOD)
        out.append(torque.of)
    return np.array(out, dtype=np.float64)


@given(st.integers(0, 20), st.integers(0, 2**32 - 1))
def test_a_delay_shifts_and_the_first_torques_are_those_that_held(ticks: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    commands, held = rng.normal(size=(30, 2)), rng.normal(size=2)
    out = acted(ControlDelay(ticks), commands, held)
    np.testing.assert_array_equal(out, np.concatenate((np.tile(held, (ticks, 1)), commands))[:30])


@given(st.floats(1.0, 1e5), st.integers(0, 2**32 - 1))
def test_a_limited_rate_is_never_passed_and_a_constant_torque_is_reached(rate: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    commands, held, step = rng.normal(scale=10.0, size=(40, 2)), rng.normal(size=2), rate * PERIOD
    out = acted(TorqueRateLimit(rate), commands, held)
    assert np.abs(np.diff(out, axis=0, prepend=held[None])).max() <= step * (1.0 + 1e-12) + 1e-12
    close = np.abs(commands - np.concatenate((held[None], out))[:-1]) <= step
    np.testing.assert_array_equal(out[close], commands[close])
    away = math.ceil(np.abs(commands[0] - held).max() / step)
    if away < 1000:
        np.testing.assert_allclose(
            acted(TorqueRateLimit(rate), np.tile(commands[0], (away + 1, 1)), held)[-1], commands[0]
        )


@settings(max_examples=20)
@given(st.floats(1e-4, 0.1), st.integers(0, 2**32 - 1))
def test_a_lag_is_the_first_order_equation_in_the_mean(time_constant: float, seed: int) -> None:
    """The impulse of every period, and the torque at its end, against an integrator of differential equations."""
    rng = np.random.default_rng(seed)
    commands, held = rng.normal(size=(5, 1)), rng.normal(size=1)
    effect = ActuatorLag(time_constant)
    out, x = acted(effect, commands, held), held[0]
    for u, mean in zip(commands[:, 0], out[:, 0], strict=True):
        y = solve_ivp(
            lambda t, y, u=u: [(u - y[0]) / time_constant, y[0]], (0, PERIOD), [x, 0.0], rtol=1e-10, atol=1e-13
        ).y
        x = y[0, -1]
        assert mean * PERIOD == pytest.approx(y[1, -1], rel=1e-7, abs=1e-10)


def test_a_torque_limit_clips() -> None:
    out = acted(TorqueLimit([2.0, 5.0]), np.array([[3.0, 3.0], [-9.0, -9.0], [1.0, 5.0]]), np.zeros(2))
    np.testing.assert_array_equal(out, [[2.0, 3.0], [-2.0, -5.0], [1.0, 5.0]])


@given(st.floats(1e-6, 0.1), st.lists(st.floats(-100.0, 100.0), min_size=3, max_size=3))
def test_an_encoder_counts_whole_steps(resolution: float, positions: list[float]) -> None:
    p = Column(positions)
    read, v, _ = Encoder(resolution).measure(p, p, Column.zeros(6), Column(()), PERIOD)
    counts = np.array(read.of) / resolution
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
    assert np.abs(np.array(read.of) - positions).max() <= 0.5 * resolution * (1.0 + 1e-9)
    assert v.of == p.of


def test_noise_has_the_deviation_asked_for(puma: Mechanism) -> None:
    env = TrackingEnv(puma, 1, duration=1.0, effects=[Encoder(noise=1e-3, velocity_noise=[0.1] * 5 + [0.0])])
    run = rollout(env, ComputedTorque(puma, 5.0), seed=3)
    assert run.measured_p is not None
    assert run.measured_v is not None
    assert np.std(run.measured_p - run.p) == pytest.approx(1e-3, rel=0.05)
    spread = np.std(run.measured_v - run.v, axis=0)
    np.testing.assert_allclose(spread, [0.1] * 5 + [0.0], rtol=0.1, atol=1e-15)
    assert abs(np.mean(run.measured_p - run.p)) < 1e-4


@given(st.floats(1.0, 400.0), st.floats(-5.0, 5.0))
def test_filtered_differences_of_a_ramp_are_its_slope(cutoff: float, slope: float) -> None:
    effect, p = FilteredDifferences(cutoff), np.array([0.3])
    memory = Column(effect.initial_state(p, np.array([slope]), PERIOD).tolist())
    for k in range(20):
        at = Column((0.3 + slope * k * PERIOD,))
        same, v, memory = effect.measure(at, Column((99.0,)), Column.zeros(2), memory, PERIOD)
        assert same.of == at.of
        assert v[0] == pytest.approx(slope, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("frequency", [5.0, 20.0, 80.0])
def test_filtered_differences_have_the_gain_and_the_delay_of_their_transfer_function(frequency: float) -> None:
    cutoff, z = 20.0, np.exp(2j * np.pi * frequency * PERIOD)
    a = math.exp(-2.0 * math.pi * cutoff * PERIOD)
    expected = (1.0 - a) / (1.0 - a / z) * (1.0 - 1.0 / z) / PERIOD
    effect, out = FilteredDifferences(cutoff), []
    memory = Column(effect.initial_state(np.zeros(1), np.zeros(1), PERIOD).tolist())
    for k in range(2000):
        at = Column((float((z**k).imag),))
        _, v, memory = effect.measure(at, at, Column.zeros(2), memory, PERIOD)
        out.append(v[0])
    k = np.arange(1000, 2000)
    np.testing.assert_allclose(np.array(out)[1000:], (expected * z**k).imag, rtol=1e-6, atol=1e-6)


@given(st.floats(0.0, 10.0), st.floats(0.0, 10.0), st.floats(0.0, 10.0), st.floats(-50.0, 50.0))
def test_friction_takes_energy_out_and_is_odd(viscous: float, coulomb: float, stribeck: float, v: float) -> None:
    friction = Friction(viscous, coulomb, stribeck, 0.1)
    held = Column((7.0,))
    torque = friction.torque(Column((v,)), held)[0]
    assert torque * v >= 0.0
    assert friction.torque(Column((-v,)), held)[0] == -torque
    loaded = Friction(viscous, coulomb, stribeck, 0.1, load=0.3).torque(Column((v,)), Column((-7.0,)))[0]
    assert loaded == pytest.approx(Friction(viscous, coulomb + 2.1, stribeck, 0.1).torque(Column((v,)), held)[0])
    assert abs(torque) <= friction.max_slope(1)[0] * abs(v) * (1.0 + 1e-12) + 1e-300


def test_friction_falls_from_static_to_coulomb_and_rises_again() -> None:
    """Hess and Soom's curve, far above the smoothing."""
    friction, speeds = Friction(2.0, 10.0, 5.0, stribeck_speed=1.0), np.array([0.2, 1.0, 5.0, 1000.0])
    expected = 2.0 * speeds + (10.0 + 5.0 / (1.0 + speeds**2)) * speeds / np.sqrt(
        speeds**2 + COULOMB_SMOOTHING_SPEED**2
    )
    curve = np.array([friction.torque(Column((v,)), Column((7.0,)))[0] for v in speeds.tolist()])
    np.testing.assert_allclose(curve, expected, rtol=1e-12)
    assert curve[1] < curve[0] + 2.0 * 0.8
    assert curve[3] == pytest.approx(2010.0, rel=1e-6)


def test_viscous_friction_brakes_a_rotor_exponentially() -> None:
    """In a plant without gravity: v(t) = v_0 exp(-b t/I), by the effect and by the drive alike."""
    spinner = random_chain(1, 1)
    spinner = Mechanism(spinner.description.with_parameters(np.array([0, 0, 0, 0, 2.0, 0, 2.0, 0, 0, 2.0])))
    inertia = float(spinner.mass_matrix(np.zeros((1, 1)))[0, 0, 0])
    expected = 3.0 * math.exp(-0.7 * 0.1 / inertia)
    for plant in (
        Plant(spinner, 0.1, 50, effects=(Friction(0.7),)),
        Plant(spinner.with_drives(Drive(viscous=0.7)), 0.1, 50),
    ):
        assert plant.step(plant.init([0.0], [3.0]), [0.0]).v[0] == pytest.approx(expected, rel=1e-9)


def test_a_drive_and_the_effect_are_the_same_friction() -> None:
    tree = random_tree(3, 3).with_drives(Drive(rotor_inertia=1.0))
    rubbing = tree.with_drives(Drive(1.0, 0.4, 0.3))
    ours = Plant(tree, PERIOD, 2, effects=(Friction(0.4, 0.3),))
    theirs = Plant(rubbing, PERIOD, 2)
    p, v, torque = np.random.default_rng(0).normal(size=(3, 3))
    np.testing.assert_allclose(
        ours.step(ours.init(p, v), torque).v, theirs.step(theirs.init(p, v), torque).v, rtol=1e-12
    )


def test_the_steps_are_short_enough_for_friction() -> None:
    """A rotor of 0.01 kg m^2 braked by 1 N m stops within 0.1 ms: 1 ms is too long a step, and it is not taken."""
    spinner = random_chain(1, 1)
    light = Mechanism(spinner.description.with_parameters(np.zeros(10))).with_drives(Drive(rotor_inertia=0.01))
    friction = Friction(coulomb=1.0)
    rate = 1.0 / (0.01 * COULOMB_SMOOTHING_SPEED)
    assert friction_rate(light, [friction]) == pytest.approx(rate)
    assert friction_rate(light.with_drives(Drive(0.01, coulomb=1.0))) == pytest.approx(rate)
    steps = integration(light, [friction], PERIOD).substeps
    assert steps == math.ceil(rate * PERIOD / 2.5)
    assert integration(light, [friction], PERIOD).integrator == RungeKutta4()
    for count, settled in ((steps, True), (steps // 4, False)):
        plant = Plant(light, PERIOD, count, effects=(friction,))
        state = plant.init([0.0], [0.005])
        for _ in range(100):
            state = plant.step(state, [0.0])
        assert (abs(state.v[0]) < 1e-6) == settled
    assert integration(spinner, [], PERIOD) == (1, RungeKutta4())
    assert integration(light, [Friction(coulomb=1000.0)], 1e-4) == (4, LinearlyImplicitEuler())
    assert integration(light, [friction], PERIOD, SemiImplicitEuler()) == (steps, SemiImplicitEuler())


@pytest.mark.parametrize(
    ("share", "expected"), [(0.99, Integration(8, RungeKutta4())), (1.01, Integration(4, LinearlyImplicitEuler()))]
)
def test_steps_are_implicit_where_more_than_eight_would_have_to_be_taken(share: float, expected: Integration) -> None:
    """Twenty time constants of a rotor's friction in a control period, at most 2.5 in an explicit step."""
    spinner = random_chain(1, 1)
    light = Mechanism(spinner.description.with_parameters(np.zeros(10))).with_drives(Drive(rotor_inertia=0.01))
    assert integration(light, [Friction(viscous=share * 20.0 / PERIOD * 0.01)], PERIOD) == expected


def test_friction_of_what_has_no_inertia_is_refused() -> None:
    nothing = Mechanism(random_chain(1, 1).description.with_parameters(np.zeros(10)))
    with pytest.raises(InputError, match="the mass matrix is singular"):
        integration(nothing, [Friction(1.0)], PERIOD)


def test_friction_of_a_mechanism_with_loops_is_fast_where_its_links_are() -> None:
    arm = load("semi_direct_drive")
    slow, fast = (friction_rate(arm.with_drives(Drive(viscous=b))) for b in (1.0, 2.0))
    assert fast == pytest.approx(2.0 * slow, rel=1e-9)
    assert friction_rate(arm) == 0.0


def test_a_payload_is_picked_up_and_dropped(puma: Mechanism) -> None:
    """Before, while and after, the motion is that of an arm with the parameters of that time."""
    payload = Payload(2.0, np.array([0.0, 0.0, 0.1]))
    taken = PayloadHeld(payload, 0.02, 0.06)
    np.testing.assert_array_equal(Payload(0.0).added_to(puma.inertial_parameters, 5), puma.inertial_parameters)
    assert [taken.next_change_time(t) for t in (0.0, 0.02, 0.06)] == [0.02, 0.06, math.inf]
    env = TrackingEnv(puma, 1, duration=0.1, effects=[taken])
    observation, info = env.reset(seed=0)
    own, loaded = puma.inertial_parameters, payload.added_to(puma.inertial_parameters, 5)
    plant, torque = Plant(puma, PERIOD), np.array([5.0, -30.0, 5.0, 0.5, 0.5, 0.5])
    state = plant.init(observation[:6], observation[6:12])
    for k in range(100):
        held = 20 <= k < 60
        np.testing.assert_array_equal(info["parameters"], loaded if held else own)
        assert info["flags"] == {"payload": 2.0 if held else 0.0}
        state = plant.step(state, torque, loaded if held else own)
        observation, *_, info = env.step(torque)
        np.testing.assert_array_equal(observation[:6], state.p)


def test_native_code_is_the_equations_on_floats_and_arrays(puma: Mechanism) -> None:
    plant = Plant(puma, PERIOD, effects=RIGID)
    rng, true = np.random.default_rng(0), puma.inertial_parameters
    p, v, torque = rng.normal(size=(3, 4, 6)) * np.array([1.0, 1.0, 80.0])[:, None, None]
    noise = rng.normal(size=(4, 12))
    states = [plant.init(p[k], v[k], true) for k in range(4)]
    given = {name: np.array([getattr(state, name) for state in states]) for name in plant.sizes}
    given |= {"torque": torque, "noise": noise, "parameters": np.tile(true, (4, 1))}
    batch = plant.equation({name: Column(rows.T) for name, rows in given.items()})
    for k, state in enumerate(states):
        after = plant.step(state, torque[k], true, noise[k])
        floats = plant.equation({name: Column(rows[k].tolist()) for name, rows in given.items()})
        for name, one, many in zip(batch._fields, floats, batch, strict=True):
            got = np.ravel(getattr(after, name))
            np.testing.assert_allclose(got, one.of, rtol=1e-11, atol=1e-12)
            np.testing.assert_allclose(got, [np.broadcast_to(x, 4)[k] for x in many.of], rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("effects", [(), RIGID], ids=["none", "all"])
def test_many_arms_step_as_one_does(puma: Mechanism, effects: Sequence[Effect]) -> None:
    plant, members = Plant(puma, PERIOD, effects=effects), 3
    rng = np.random.default_rng(0)
    noise, true = rng.normal(size=(members, 12)), puma.inertial_parameters
    torques = rng.normal(scale=90.0, size=(20, members, 6))
    p, v = rng.normal(size=(2, members, 6))
    noise = noise[:, : plant.noise_size]
    together, states = plant.init(p, v, true, noise), [plant.init(p[k], v[k], true, noise[k]) for k in range(members)]
    stepper = compile_step(
        lambda **columns: tuple(plant.equation(columns)),
        state=plant.sizes,
        constants={"parameters": len(true)},
        per_member_inputs={"torque": 6, "noise": plant.noise_size},
        lanes=2,
    )
    arms = stepper.ensemble(members)
    arms.held["parameters"] = true
    for name, values in zip(plant.sizes, (getattr(together, name) for name in plant.sizes), strict=True):
        arms.state[name] = values
    for k, state in enumerate(states):
        for one, many in zip(state[1:], together[1:], strict=True):
            np.testing.assert_allclose(many[k] if np.ndim(many) else many, one, rtol=1e-11, atol=1e-11)
    for torque in torques:
        outputs = arms.run(1, {"torque": torque[None], "noise": noise[None]})
        states = [plant.step(states[k], torque[k], true, noise[k]) for k in range(members)]
        for k, state in enumerate(states):
            expected = (state.measured_p, state.measured_v, state.applied_torque, [state.clipped], state.flags)
            for got, wanted in zip(outputs, expected, strict=True):
                np.testing.assert_allclose(got[k], wanted, rtol=1e-11, atol=1e-11)
            np.testing.assert_allclose(arms.state["q"][k], state.q, rtol=1e-11)


def test_what_reached_the_joints_is_within_the_limits(puma: Mechanism) -> None:
    """Also before the first torque arrives, when the joints get what gravity asks for, as far as the limits allow."""
    plant = Plant(puma, PERIOD, torque_limits=10.0, effects=[ControlDelay(2)])
    state = plant.init([0.0, 0.3, 0.2, 0.0, 0.0, 0.0], np.zeros(6))
    assert np.abs(state.drives).max() > 20.0
    alone = Plant(puma, PERIOD, torque_limits=10.0)
    for _ in range(2):
        after = plant.step(state, np.zeros(6))
        assert np.abs(after.applied_torque).max() == 10.0
        same = alone.step(alone.init(state.p, state.v), after.applied_torque)
        np.testing.assert_array_equal(after.v, same.v)
        state = after
    np.testing.assert_array_equal(plant.step(state, np.zeros(6)).applied_torque, 0.0)


def test_a_plant_loads_what_its_effects_hold_at_its_own_time(puma: Mechanism) -> None:
    """Parameters that are given are taken as they are."""
    plant, bare = Plant(puma, PERIOD, effects=[PayloadHeld(2.0, 0.002, 0.005)]), Plant(puma, PERIOD)
    own, loaded = puma.inertial_parameters, plant.parameters(puma.inertial_parameters, 0.003)
    ours = theirs = given = plant.init(np.full(6, 0.3), np.zeros(6))
    for k in range(8):
        true = loaded if 2 <= k < 5 else own
        assert plant.energy(ours) == pytest.approx(bare.energy(theirs, true), rel=1e-14)
        ours, theirs = plant.step(ours, np.zeros(6)), bare.step(theirs, np.zeros(6), true)
        given = plant.step(given, np.zeros(6), own)
        np.testing.assert_array_equal(ours.q, theirs.q)
    assert not np.array_equal(ours.q, given.q)


def test_everything_at_once_is_repeatable_whatever_the_order(puma: Mechanism) -> None:
    law = ComputedTorque(puma, 5.0)
    runs = [
        rollout(TrackingEnv(puma, 1, duration=0.1, initial_error=0.05, effects=effects), law, seed=seed)
        for effects, seed in ((RIGID, 4), (RIGID[::-1], 4), (RIGID, 5))
    ]
    first, again, other = runs
    for name in ("p", "measured_p", "measured_v", "torque", "applied"):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()
        assert not np.array_equal(getattr(first, name), getattr(other, name))
    assert tuple(first.flags) == ("torque_limited", "rate_limited", "payload")
    np.testing.assert_array_equal(first.flags["payload"][[0, 30, 99]], [0.0, 1.5, 0.0])
    assert first.flags["rate_limited"].max() == 1.0
    assert np.abs(first.applied).max() <= 60.0
    assert set(first.flags["torque_limited"]) <= {0.0, 1.0}
    with pytest.raises(ValueError, match="read-only"):
        first.flags["payload"][0] = 1.0


def test_without_effects_what_is_measured_is_true(puma: Mechanism) -> None:
    run = rollout(TrackingEnv(puma, 1, duration=0.01), ComputedTorque(puma, 5.0), seed=0)
    assert run.measured_p is None
    assert dict(run.flags) == {}
    assert "p" not in run.info
