"""Elastic joints: the motion of motors and links against SciPy, the rigid limit, energy, and what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
from nightly import at_night
from random_trees import random_chain
from scipy.integrate import solve_ivp

from adaptctl.arrays import Array
from adaptctl.control import ComputedTorque
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.simulation import LinearlyImplicitEuler, Plant, PlantState, RungeKutta4, rollout, simulate, simulate_many
from adaptctl.simulation.effects import (
    ActuatorLag,
    ControlDelay,
    ElasticJoints,
    Encoder,
    Friction,
    PayloadHeld,
    PlantEffects,
)
from adaptctl.simulation.integrator import MAX_SPRING_SUBSTEPS, integration
from adaptctl.simulation.transmission import Transmission

PERIOD = 1e-3


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_geared")


def rotors(mechanism: Mechanism) -> list[int]:
    return [k for k, name in enumerate(mechanism.parameter_names) if name.endswith("rotor_inertia")]


def without_rotors(mechanism: Mechanism) -> Mechanism:
    parameters = mechanism.inertial_parameters.copy()
    parameters[rotors(mechanism)] = 0.0
    return mechanism.with_parameters(parameters)


def chain(joints: int, seed: int) -> Mechanism:
    return random_chain(seed, joints).with_drives(Drive(rotor_inertia=0.3))


def path(plant: Plant, state: PlantState, torque: Array, periods: int) -> Array:
    """Positions (periods, r)."""
    states = []
    for _ in range(periods):
        state = plant.step(state, torque)
        states.append(state.p)
    return np.array(states)


def moved(plant: Plant, state: PlantState, torque: Array, periods: int) -> PlantState:
    for _ in range(periods):
        state = plant.step(state, torque)
    return state


def spongs(
    links: Mechanism, J: Array, stiffness: Array, damping: Array, friction: Callable[[Array], Array]
) -> Callable[[float, Array, Array], Array]:
    """Motor and link equations, for x = (p, theta, v, w)."""

    def rates(t: float, x: Array, torque: Array) -> Array:
        p, theta, v, w = np.split(x, 4)
        force = stiffness * (theta - p) + damping * (w - v)
        return np.concatenate((v, w, links.forward_dynamics(p, v, force - friction(v)), (torque - force) / J))

    return rates


@pytest.mark.parametrize("arm", ["puma560_geared", "chain", "semi_direct_drive"])
def test_motors_and_links_move_as_the_differential_equations_say(arm: str) -> None:
    """On chains, and on loops, whose primary joints are sprung; friction brakes the links."""
    mechanism = chain(3, 5) if arm == "chain" else load(arm)
    r, rng = mechanism.dof, np.random.default_rng(1)
    own = np.array([mechanism.inertial_parameters[k] for k in rotors(mechanism)])
    more = rng.uniform(0.5, 2.0, r)
    stiffness, damping = rng.uniform(300.0, 900.0, r), rng.uniform(0.0, 0.02, r)
    joints = ElasticJoints(stiffness, damping, more)
    substeps = 2 * integration(mechanism, (), PERIOD, None, Transmission.of(mechanism, joints)).substeps
    plant = Plant(mechanism, PERIOD, substeps, torque_limits=np.inf, effects=(joints, Friction(viscous=0.3)))
    p, v, torque = (
        mechanism.neutral_configuration + rng.normal(scale=0.1, size=r),
        rng.normal(scale=0.3, size=r),
        rng.normal(size=r),
    )
    state = plant.init(p, v)
    theta = state.drives[:r]
    J = more + (own if own.size else 0.0)
    rates = spongs(without_rotors(mechanism), J, stiffness, damping, lambda v: 0.3 * v)
    start = np.concatenate((p, theta, v, v))
    end = solve_ivp(rates, (0.0, 0.02), start, args=(torque,), method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    after = moved(plant, state, torque, 20)
    np.testing.assert_allclose(np.concatenate((after.p, after.drives[:r], after.v, after.drives[r:])), end, atol=2e-7)
    assert np.abs(end - start).max() > 1e-2


def test_springs_are_stretched_by_what_holds_the_arm(puma: Mechanism) -> None:
    """Under that torque nothing moves."""
    plant = Plant(puma, PERIOD, 30, effects=(ElasticJoints(1e3, 2.0),))
    p = np.array([0.3, 0.4, -0.2, 0.1, 0.5, 0.0])
    state = plant.init(p, np.zeros(6))
    held = puma.inverse_dynamics(p, np.zeros(6), np.zeros(6))
    np.testing.assert_allclose(state.drives[:6] - p, held / 1e3, rtol=1e-9, atol=1e-15)
    after = moved(plant, state, held, 100)
    np.testing.assert_allclose(after.p, p, atol=1e-10)
    assert np.abs(after.v).max() < 1e-9


def test_stiff_springs_are_the_rigid_plant(puma: Mechanism) -> None:
    """Rotor inertia turns with the motors: ten times the stiffness, a tenth of the difference."""
    p, torque, apart = np.full(6, 0.3), np.array([20.0, -30.0, 10.0, 3.0, 2.0, 1.0]), []
    rigid = Plant(puma, PERIOD, 2)
    expected = path(rigid, rigid.init(p, np.zeros(6)), torque, 200)
    for stiffness in (1e3, 1e4, 1e5):
        joints = ElasticJoints(stiffness, 2.0)
        steps = integration(puma, (), PERIOD, None, Transmission.of(puma, joints)).substeps
        plant = Plant(puma, PERIOD, steps, effects=(joints,))
        apart.append(np.abs(path(plant, plant.init(p, np.zeros(6)), torque, 200) - expected).max())
    assert np.abs(expected - p).max() > 0.1
    assert apart[1] < 0.2 * apart[0]
    assert apart[2] < 0.2 * apart[1]
    assert apart[2] < 3e-4


def test_energy_stays_without_dampers_and_falls_with_them() -> None:
    mechanism, rng = chain(3, 2), np.random.default_rng(0)
    p, v = rng.normal(size=(2, 3))
    for damping, kept in ((0.0, True), (0.05, False)):
        joints = ElasticJoints(200.0, damping)
        steps = 4 * integration(mechanism, (), PERIOD, None, Transmission.of(mechanism, joints)).substeps
        plant = Plant(mechanism, PERIOD, steps, torque_limits=np.inf, effects=(joints,))
        state = plant.init(p, v)
        state = state._replace(drives=state.drives + np.array([0.1, -0.1, 0.1, 0.0, 0.0, 0.0]))
        energies = []
        for _ in range(500):
            energies.append(plant.energy(state))
            state = plant.step(state, np.zeros(3))
        assert (np.ptp(energies) < 1e-6 * abs(np.max(energies))) == kept
        assert kept or np.diff(energies).max() <= 1e-9


def test_a_spring_rings_at_its_frequency() -> None:
    """sqrt(k (1/J + 1/M)), found from the turning points of p - theta of a joint about a vertical axis."""
    spinner = Mechanism(random_chain(1, 1).description.with_parameters(np.array([0, 0, 0, 0, 2.0, 0, 2.0, 0, 0, 2.0])))
    M, J, k = float(spinner.mass_matrix(np.zeros(1))[0, 0]), 0.5, 800.0
    plant = Plant(spinner, 1e-4, torque_limits=np.inf, effects=(ElasticJoints(k, motor_inertia=J),))
    state = plant.init([0.0], [0.0])
    state = state._replace(drives=state.drives + np.array([0.1, 0.0]))
    stretch = []
    for _ in range(5000):
        stretch.append(state.drives[0] - state.p[0])
        state = plant.step(state, [0.0])
    crossed = np.flatnonzero(np.diff(np.sign(stretch)))
    found = math.pi * (len(crossed) - 1) / (1e-4 * (crossed[-1] - crossed[0]))
    assert found == pytest.approx(math.sqrt(k * (1.0 / J + 1.0 / M)), rel=2e-3)


def test_the_implicit_integrator_goes_the_same_way_however_stiff() -> None:
    """To first order; at a tenth of the steps that explicit ones need it stays finite."""
    mechanism, torque = chain(2, 4), np.array([1.0, -0.5])
    effects = (ElasticJoints(500.0, 0.5), Friction(viscous=0.2))
    steps = integration(mechanism, (), PERIOD, None, Transmission.of(mechanism, effects[0])).substeps
    exact = Plant(mechanism, PERIOD, 4 * steps, torque_limits=np.inf, effects=effects)
    start, apart = exact.init(np.array([0.3, -0.2]), np.zeros(2)), []
    end = moved(exact, start, torque, 50)
    for count in (20 * steps, 40 * steps):
        plant = Plant(mechanism, PERIOD, count, LinearlyImplicitEuler(), np.inf, effects=effects)
        apart.append(np.abs(moved(plant, start, torque, 50).p - end.p).max())
    assert apart[0] / apart[1] == pytest.approx(2.0, rel=0.1)
    stiff = ElasticJoints(1e9, 1e3)
    plant = Plant(mechanism, PERIOD, 4, LinearlyImplicitEuler(), np.inf, effects=(stiff,))
    assert np.isfinite(moved(plant, plant.init(np.array([0.3, -0.2]), np.zeros(2)), torque, 200).p).all()


def test_encoders_on_motors_tell_of_motors(puma: Mechanism) -> None:
    joints = ElasticJoints(500.0, 2.0, encoders="motor")
    plant = Plant(puma, PERIOD, 30, effects=(joints,))
    state = plant.init(np.full(6, 0.3), np.zeros(6))
    for _ in range(5):
        np.testing.assert_array_equal(np.concatenate((state.measured_p, state.measured_v)), state.drives)
        state = plant.step(state, np.full(6, 5.0))
    assert np.abs(state.measured_p - state.p).max() > 1e-3
    read = Plant(puma, PERIOD, 30, effects=(joints, Encoder(resolution=1e-3)))
    coarse = read.step(read.init(np.full(6, 0.3), np.zeros(6)), np.full(6, 5.0))
    assert 0.0 < np.abs(coarse.measured_p - coarse.drives[:6]).max() <= 0.5e-3 + 1e-12


@pytest.mark.parametrize("encoders", [at_night("link"), "motor"])
def test_every_way_to_run_is_one_motion(puma: Mechanism, encoders: str) -> None:
    """Step by step, natively as a whole, and in lanes; with what else plants have."""
    effects = (ElasticJoints(2e3, 2.0, encoders=encoders), ActuatorLag(2e-3), ControlDelay(1), PayloadHeld(1.0, 0.01))
    env, law = TrackingEnv(puma, 1, duration=0.05, initial_error=0.02, effects=effects), ComputedTorque(puma, 5.0)
    stepped, whole = rollout(env, law, seed=0), simulate(env, law, seed=0)
    for name in ("p", "v", "torque", "energy"):
        np.testing.assert_allclose(getattr(whole, name), getattr(stepped, name), rtol=1e-9, atol=1e-9)
    env.reset(seed=0)
    many = simulate_many(env.plant, law, env.reference, duration=0.05, p=stepped.p[0], v=stepped.v[0], batch_size=3)
    for k in range(3):
        np.testing.assert_allclose(many.p[:, k], stepped.p, atol=1e-10)


def test_many_arms_of_an_environment_are_sprung_too(puma: Mechanism) -> None:
    effects = (ElasticJoints(2e3, 2.0), PayloadHeld(1.0, 0.002, 0.004))
    options = {"robot": puma, "reference": 1, "duration": 0.02, "effects": effects}
    many = gymnasium.make_vec("adaptctl.envs:adaptctl/Tracking-v0", num_envs=3, **options)
    one = gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", **options)
    together, _ = many.reset(seed=4)
    alone, _ = one.reset(seed=4)
    torque = np.array([5.0, -30.0, 5.0, 0.5, 0.5, 0.5])
    for _ in range(6):
        together, *_, info = many.step(np.tile(torque, (3, 1)))
        alone, *_, told = one.step(torque)
        np.testing.assert_allclose(together[0], alone, atol=1e-9)
        assert info["energy"][0] == pytest.approx(told["energy"], rel=1e-9)


def test_steps_are_as_many_as_springs_need(puma: Mechanism) -> None:
    soft, stiff = (integration(puma, (), PERIOD, None, Transmission.of(puma, ElasticJoints(k))) for k in (1e3, 1e5))
    assert stiff.substeps == pytest.approx(10 * soft.substeps, abs=10)
    assert soft.integrator == RungeKutta4()
    env = TrackingEnv(puma, 1, effects=(ElasticJoints(1e5),))
    assert env.plant.substeps == stiff.substeps


@pytest.mark.parametrize(("share", "steps"), [(0.99, 4), (1.01, 5)])
@pytest.mark.parametrize("kind", ["springs", "dampers", "friction", "dampers and friction"])
def test_steps_are_as_many_as_the_fastest_motion_needs(kind: str, share: float, steps: int) -> None:
    """Four radians of an oscillation, or ten of a decay, are four steps: sqrt(k/m) and d/m of a link M and a motor J
    that swing against each other, 1/m = 1/M + 1/J, and f/(M + J) where they turn as one."""
    wheel, J = random_chain(3, 1).with_drives(Drive(rotor_inertia=0.3)), 0.3
    M = float(without_rotors(wheel).mass_matrix(np.zeros(1))[0, 0])
    m = 1.0 / (1.0 / M + 1.0 / J)
    waves, decay = share * 4.0 / PERIOD, share * 10.0 / PERIOD
    by_dampers = {"dampers": 1.0, "dampers and friction": 0.4}.get(kind, 0.0)
    by_friction = {"friction": 1.0, "dampers and friction": 0.6}.get(kind, 0.0)
    springs = ElasticJoints(waves**2 * m if kind == "springs" else m, by_dampers * decay * m)
    friction = Friction(viscous=by_friction * decay * (M + J))
    found = integration(wheel, (friction,), PERIOD, RungeKutta4(), Transmission.of(wheel, springs))
    assert found == (steps, RungeKutta4())
    implicit = integration(wheel, (friction,), PERIOD, LinearlyImplicitEuler(), Transmission.of(wheel, springs))
    assert implicit.substeps == (steps if kind == "springs" else 4)
    if least := {"springs": 2, "dampers": steps}.get(kind):
        assert Plant(wheel, PERIOD, least, effects=(springs,)).substeps == least
        with pytest.raises(InputError, match="too few"):
            Plant(wheel, PERIOD, least - 1, effects=(springs,))


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (ElasticJoints(-1e3), r"elastic joints: stiffness: expected numbers of at least 0, got -1000"),
        (ElasticJoints(0.0), r"elastic joints: stiffness: expected positive numbers, got \[0"),
        (ElasticJoints([1e3] * 5 + [-1.0]), "elastic joints: stiffness: expected numbers of at least 0"),
        (ElasticJoints([1e3, 2e3]), "elastic joints: stiffness: expected a number or 6 of them"),
        (ElasticJoints(math.inf), "elastic joints: stiffness: expected finite numbers, got inf"),
        (ElasticJoints(math.nan), "elastic joints: stiffness: expected numbers of at least 0"),
        (ElasticJoints(1e3, -1.0), "elastic joints: damping: expected numbers of at least 0"),
        (ElasticJoints(1e3, motor_inertia=-1.0), "elastic joints: motor_inertia: expected numbers of at least 0"),
        (ElasticJoints(1e12), f"but the limit is {MAX_SPRING_SUBSTEPS}: use softer springs"),
    ],
)
def test_springs_that_cannot_be_are_refused(puma: Mechanism, joints: ElasticJoints, message: str) -> None:
    for make in (lambda: Plant(puma, PERIOD, effects=(joints,)), lambda: TrackingEnv(puma, effects=(joints,))):
        with pytest.raises(InputError, match=message):
            make()


def test_what_springs_do_not_fit_is_refused(puma: Mechanism) -> None:
    spring = ElasticJoints(1e3)
    with pytest.raises(InputError, match="encoders: expected 'link' or 'motor', got 'both'"):
        ElasticJoints(1e3, encoders="both")
    with pytest.raises(InputError, match="ElasticJoints is given 2 times"):
        PlantEffects.of((spring, spring))
    with pytest.raises(InputError, match=r"motor of .* has no inertia: give motor_inertia"):
        Plant(load("puma560_measured"), PERIOD, effects=(spring,))
    with pytest.raises(InputError, match=r"1 substeps per 0.001 s are too few for springs .*: use at least"):
        Plant(puma, PERIOD, effects=(ElasticJoints(1e5),))
    massless = Mechanism(random_chain(1, 1).description.with_parameters(np.zeros(10))).with_drives(Drive(1.0))
    with pytest.raises(InputError, match="without rotors the mass matrix is singular"):
        Plant(massless, PERIOD, effects=(spring,))
    turning = random_chain(1, 2)
    first = turning.description.joint_names[0]
    coupled = turning.with_drives([Drive(1.0), Drive(1.0, turns_with=((first, 1.0),))])
    with pytest.raises(InputError, match="is coupled to several joints"):
        Plant(coupled, PERIOD, effects=(spring,))
