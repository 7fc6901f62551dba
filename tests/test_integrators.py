"""Integrators against exact solutions, and on the PUMA: order, reversibility of energy, symplecticity."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from figures import require

from adaptctl.arrays import Array
from adaptctl.compilation import trace
from adaptctl.control import PDGravity
from adaptctl.dynamics import Mechanism, load
from adaptctl.scalars import Column, Dual
from adaptctl.simulation import ClosedLoop, Integrator, LinearlyImplicitEuler, Plant, RungeKutta4, SemiImplicitEuler

ORDERS = [(RungeKutta4(), 4), (SemiImplicitEuler(), 1), (LinearlyImplicitEuler(), 1)]


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


def spring(p: Column, v: Column) -> Column:
    return -p


def oscillation(integrator: Integrator, steps: int) -> float:
    """The error after one second of p'' = -p from p = 1 at rest."""
    p, v = Column((1.0,)), Column((0.0,))
    for _ in range(steps):
        p, v = integrator.step(spring, p, v, 1.0 / steps)
    return math.hypot(p[0] - math.cos(1.0), v[0] + math.sin(1.0))


def swung(mechanism: Mechanism, integrator: Integrator, dt: float, duration: float = 0.2) -> Array:
    """Where a free fall of the arm leads."""
    plant = Plant(mechanism, dt, integrator=integrator)
    state = plant.init([0.0, -0.6, 0.8, 0.3, 0.5, 0.2], [1.0, -1.0, 1.0, 2.0, -2.0, 1.0])
    for _ in range(round(duration / dt)):
        state = plant.step(state, np.zeros(6))
    return np.concatenate((state.p, state.v))


@pytest.mark.parametrize(("integrator", "order"), [*ORDERS[:2], (LinearlyImplicitEuler(), 2)])
def test_order_on_an_oscillator(integrator: Integrator, order: int) -> None:
    ratios = [oscillation(integrator, n) / oscillation(integrator, 2 * n) for n in (20, 40)]
    assert np.allclose(np.log2(ratios), order, atol=0.1)


@pytest.mark.parametrize(("integrator", "order"), ORDERS)
def test_order_on_the_puma(puma: Mechanism, integrator: Integrator, order: int) -> None:
    exact = swung(puma, RungeKutta4(), 1.25e-4)
    errors = [np.linalg.norm(swung(puma, integrator, dt) - exact) for dt in (4e-3, 2e-3, 1e-3)]
    assert np.allclose(np.log2(np.divide(errors[:-1], errors[1:])), order, atol=0.3)


def test_a_constant_acceleration_is_exact() -> None:
    p, v = RungeKutta4().step(lambda p, v: Column((3.0,)), Column((1.0,)), Column((2.0,)), 0.5)
    assert p[0] == pytest.approx(1.0 + 2.0 * 0.5 + 1.5 * 0.25, rel=1e-15)
    assert v[0] == pytest.approx(3.5, rel=1e-15)


def test_semi_implicit_euler_keeps_areas_and_runge_kutta_nearly_so() -> None:
    """The determinant of a step's derivative, by dual numbers, is 1 for a symplectic method."""

    def slope(integrator: Integrator, dp: float, dv: float) -> tuple[float, float]:
        start = Column((Dual(0.7, dp),)), Column((Dual(-0.2, dv),))
        p, v = integrator.step(lambda p, v: Column((-(p[0] * p[0] * p[0]),)), *start, 0.1)
        return p[0].slope, v[0].slope

    for integrator, bound in ((SemiImplicitEuler(), 1e-15), (RungeKutta4(), 1e-5)):
        a, b = slope(integrator, 1.0, 0.0), slope(integrator, 0.0, 1.0)
        assert a[0] * b[1] - a[1] * b[0] == pytest.approx(1.0, abs=bound)


@pytest.mark.parametrize("free_fall", [True, False])
def test_energy_drift_of_the_puma(puma: Mechanism, free_fall: bool) -> None:
    """RK4 at 1 ms, one second without torque: from rest under gravity, and without gravity at up to 3 rad/s."""
    rng = np.random.default_rng(0)
    still = Mechanism(replace(puma.description, gravity=np.zeros(3)))
    mechanism, speed = (puma, 0.0) if free_fall else (still, 3.0)
    plant = Plant(mechanism, 1e-3)
    for _ in range(3):
        state = plant.init(rng.uniform(-2, 2, 6), rng.uniform(-speed, speed, 6))
        energies, peak = [plant.energy(state)], 0.0
        for _ in range(1000):
            state = plant.step(state, np.zeros(6))
            energies.append(plant.energy(state))
            peak = max(peak, 0.5 * float(state.v @ mechanism.mass_matrix(state.p) @ state.v))
        require("energy-drift", np.ptp(energies) / peak, 1e-9, "energy drift of the PUMA in 1 s of RK4 at 1 ms")


@pytest.mark.parametrize(("integrator", "called"), [(RungeKutta4(), 1), (SemiImplicitEuler(), 0)])
def test_what_one_acceleration_shares_with_the_controller_is_computed_once(integrator: Integrator, called: int) -> None:
    arm = load("semi_direct_drive")
    loop = ClosedLoop(Plant(arm, 1e-3, integrator=integrator), PDGravity(arm, np.ones(3), np.ones(3)))
    columns = loop.state | loop.held | loop.reference | loop.noise
    routine = trace(lambda **given: tuple(loop.equation(**given)[0]), columns)
    assert len(routine.subroutines) == called
