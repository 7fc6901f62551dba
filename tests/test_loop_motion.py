"""Mechanisms with loops in motion: they stay closed, keep their energy, and learn like any other arm."""

from __future__ import annotations

import itertools
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from adaptctl.arrays import Array
from adaptctl.control import (
    ComputedTorque,
    PriorRanges,
    ReferencePoint,
    SlotineLi,
    adaptation_gain,
    lyapunov,
    mapped_gain,
)
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.loop_equations import LoopEquations
from adaptctl.dynamics.recursion.segment import placements
from adaptctl.envs import SemiDirectDriveTrackingEnv, TrackingEnv, random_sinusoids
from adaptctl.envs.built_in import FIVE_BAR_REFERENCE
from adaptctl.errors import SingularityError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column
from adaptctl.simulation import Plant, PlantState, Rollout, RungeKutta4, SemiImplicitEuler, simulate

START = np.array([0.0, -0.5 * np.pi, -np.pi])
DAMPING = np.full(3, 60.0)
RANGES = PriorRanges(mass=10.0, first_moment=4.0, inertia=1.0)


@pytest.fixture(scope="module")
def arm() -> Mechanism:
    return load("semi_direct_drive")


@pytest.fixture(scope="module")
def reduced(arm: Mechanism) -> ReducedModel:
    return ReducedModel(arm)


def gap(mechanism: Mechanism, q: Array) -> float:
    """The largest closure residual, in m."""
    equations = mechanism.equations
    assert isinstance(equations, LoopEquations)
    column = Column(q.tolist())
    return max(abs(x) for x in equations.closing.residual(placements(equations.links, column), column))


def coasted(mechanism: Mechanism, dt: float, duration: float, speed: float = 0.3) -> list[PlantState]:
    """Free motion without gravity: the arm turns and the loop swings."""
    still = Mechanism(replace(mechanism.description, gravity=np.zeros(3)))
    plant = Plant(still, dt)
    states = [plant.init(START, np.array([1.0, speed, -speed]))]
    for _ in range(round(duration / dt)):
        states.append(plant.step(states[-1], np.zeros(3)))
    return states


@pytest.mark.parametrize("integrator", [RungeKutta4(), SemiImplicitEuler()])
def test_the_loop_is_closed_after_ten_seconds(arm: Mechanism, integrator: RungeKutta4 | SemiImplicitEuler) -> None:
    plant, law = Plant(arm, 1e-3, integrator=integrator), ComputedTorque(arm, 8.0)
    state = plant.init(START + 0.1, np.zeros(3))
    memory = law.init(state.p, state.v)
    points = FIVE_BAR_REFERENCE(np.arange(10_000) * 1e-3)
    for p, v, a in zip(*points, strict=True):
        torque, memory = law.step(memory, state.p, state.v, ReferencePoint(p, v, a))
        state = plant.step(state, torque)
    assert np.abs(state.p - points.p[-1]).max() < 1e-2
    assert gap(arm, state.q) < (1e-12 if isinstance(integrator, RungeKutta4) else 1e-7)


def test_energy_is_kept_and_the_order_is_four(arm: Mechanism) -> None:
    still = Mechanism(replace(arm.description, gravity=np.zeros(3)))
    coarse = coasted(arm, 1e-3, 1.0)
    energies = np.array([float(still.energy(s.p, s.v)) for s in coarse[::100]])
    assert np.ptp(energies) < 1e-9 * energies[0]
    exact = coasted(arm, 2e-3, 0.4)[-1]
    errors = [np.abs(coasted(arm, dt, 0.4)[-1].q - coasted(arm, 1e-3, 0.4)[-1].q).max() for dt in (1.6e-2, 8e-3)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.5)
    assert gap(arm, exact.q) < 1e-12


def test_dependent_joints_stay_where_continuation_puts_them(arm: Mechanism) -> None:
    for state in coasted(arm, 1e-3, 0.5)[::100]:
        np.testing.assert_allclose(state.q, arm.configuration(state.p), atol=1e-9)


@pytest.fixture(scope="module")
def runs(arm: Mechanism, reduced: ReducedModel) -> dict[str, tuple[SlotineLi, Rollout]]:
    full = ReducedModel.full(arm)
    gain = adaptation_gain(full, RANGES)
    laws = {
        "26": SlotineLi(reduced, 8.0, DAMPING, adaptation_gain(reduced, RANGES)),
        "26 mapped": SlotineLi(reduced, 8.0, DAMPING, mapped_gain(reduced, gain)),
        "50": SlotineLi(full, 8.0, DAMPING, gain),
        "off": SlotineLi(reduced, 8.0, DAMPING),
    }
    env = gymnasium.make("adaptctl.envs:adaptctl/SemiDirectDriveTracking-v0", duration=12.0)
    return {name: (law, simulate(env, law, seed=0)) for name, law in laws.items()}


def rms(run: Rollout, part: slice) -> float:
    return float(np.sqrt((run.error[part] ** 2).mean()))


def test_it_learns_from_nothing(runs: dict[str, tuple[SlotineLi, Rollout]], arm: Mechanism) -> None:
    law, run = runs["26"]
    V = lyapunov(law, run, arm)
    assert np.diff(V).max() <= 0.0
    first, last = rms(run, slice(1000)), rms(run, slice(-2000, None))
    assert last < 2e-3
    assert last < 0.1 * first
    assert last < 0.1 * rms(runs["off"][1], slice(-2000, None))
    assert not run.clipped.any()


def test_26_parameters_are_the_same_controller_as_50(runs: dict[str, tuple[SlotineLi, Rollout]]) -> None:
    difference = np.abs(runs["26 mapped"][1].torque - runs["50"][1].torque).max()
    assert difference < 1e-9 * np.abs(runs["50"][1].torque).max()


def test_the_environment_is_gymnasiums() -> None:
    with pytest.warns(UserWarning, match="normalized") as caught:
        check_env(
            gymnasium.make("adaptctl.envs:adaptctl/SemiDirectDriveTracking-v0", duration=0.1).unwrapped,
            skip_render_check=True,
        )
    assert len(caught) == 1


def test_leaving_the_conditions_ends_the_episode(arm: Mechanism) -> None:
    env = SemiDirectDriveTrackingEnv(duration=5.0, error_bound=np.inf)
    env.reset(seed=0)
    terminated, steps = False, 0
    while not terminated and steps < 3000:
        observation, _, terminated, _, _ = env.step(np.array([0.0, 230.0, -230.0]))
        steps += 1
    assert terminated
    assert not arm.description.within_conditions(observation[env.observation_slices["p"]])


@pytest.mark.parametrize("seed", range(5))
def test_random_references_stay_where_the_loop_allows(arm: Mechanism, seed: int) -> None:
    reference = random_sinusoids(arm, np.random.default_rng(seed))
    p = reference(np.linspace(0.0, 30.0, 500)).p
    for corner in itertools.product((-0.1, 0.0, 0.1), repeat=3):  # room for errors of 0.1 rad
        assert arm.description.within_conditions(p + np.array(corner)).all()
    env = TrackingEnv(arm, seed, duration=0.05, initial_error=0.05)
    env.reset(seed=0)
    assert not env.step(np.zeros(3))[2]


def test_a_configuration_that_cannot_be_followed_is_refused() -> None:
    """Stretched out, the parallelogram could go on as its antiparallel twin."""
    parallelogram = load("semi_direct_drive_parallelogram")
    with pytest.raises(SingularityError, match="near a singularity at p"):
        parallelogram.configuration([0.0, 0.2, -np.pi])
