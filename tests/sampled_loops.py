"""Closed loops with the torque held over each period, for tests: what happened, and the proof's function V."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import (
    AdaptiveController,
    Controller,
    Gains,
    PriorRanges,
    Reference,
    ReferencePoint,
    Sinusoids,
    adaptation_gain,
)
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.dynamics import Mechanism, load
from adaptctl.experiments.laws_controllers import deviations
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.simulation import Plant

Disturbance = Callable[[float], Array]
"""A time (s) to torques (r,) that act besides the controller's, N m."""

RANGES = PriorRanges(mass=2.0, first_moment=1.0, inertia=0.3)
ELBOW = np.array([0.0, -0.6, 0.8, 0.0, 0.5, 0.0])
"""A posture in which a PUMA's elbow is bent, rad."""


@lru_cache
def arm(name: str) -> Mechanism:
    """A built-in, whether or not rigid bodies have its parameters."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load(name)


@lru_cache
def reduced(name: str) -> ReducedModel:
    return ReducedModel(arm(name), fundamental_basis(essential_space(arm(name))))


@lru_cache
def full(name: str) -> ReducedModel:
    return ReducedModel.full(arm(name))


@lru_cache
def gains(name: str, bandwidth: float = 8.0, ratio: float = 4.0) -> Gains:
    return Gains.from_bandwidth(arm(name), bandwidth, ratio)


def own_gain(name: str, rate: float = 0.3) -> Array:
    """By ranges; by each link's own size where these differ as a shoulder's and a wrist's do."""
    model = reduced(name)
    if model.mechanism.dof > 3:
        return np.asarray(rate * deviations(model, model.mechanism.inertial_parameters, 1.0) ** 2)
    return adaptation_gain(model, RANGES, rate)


@lru_cache
def plant(mechanism: Mechanism, period: float) -> Plant:
    return Plant(mechanism, period, torque_limits=np.full(mechanism.dof, np.inf))


def posture(mechanism: Mechanism) -> Array:
    return mechanism.neutral_configuration if mechanism.description.loops is not None else ELBOW[: mechanism.dof]


def swinging(mechanism: Mechanism, seed: int = 0, amplitude: float = 0.3) -> Sinusoids:
    """Sinusoids about a posture, one per joint, drawn by seed."""
    rng = np.random.default_rng(seed)
    r = mechanism.dof
    frequency, phase = rng.uniform(0.3, 1.0, r), rng.uniform(-np.pi, np.pi, r)
    return Sinusoids(posture(mechanism), np.full(r, amplitude), frequency, phase, start_time=0.3)


def loaded(mechanism: Mechanism, mass: float) -> Array:
    """The parameters with a point mass of so many kg in the last link's frame, 5 cm off its origin."""
    parameters, last = mechanism.inertial_parameters.copy(), 10 * (len(mechanism.description.bodies) - 1)
    parameters[last : last + 10] += from_center_of_mass(mass, [0.05, 0.0, 0.0], np.zeros((3, 3)))
    return parameters


@dataclass(frozen=True)
class Loop:
    """A run of T periods: states before each torque, and the torques."""

    period: float
    time: Array
    p: Array
    v: Array
    torque: Array
    states: list[Any]

    @property
    def estimate(self) -> Array:
        return np.array([state.estimate for state in self.states])

    @property
    def s(self) -> Array:
        return np.array([state.s for state in self.states])


def loop(
    controller: Controller[Any],
    mechanism: Mechanism,
    reference: Reference,
    duration: float,
    period: float = 1e-3,
    *,
    off: float | Array = 0.1,
    disturbance: Disturbance | None = None,
    noise: float = 0.0,
    parameters: Array | None = None,
    late: int = 0,
) -> Loop:
    """The controller on the mechanism from the reference's start, `off` in every joint.

    `noise` (rad/s) is the deviation of what is measured of velocities; `parameters` (P,) are the true ones; torques
    act `late` periods after they were computed, the first until then.
    """
    time = np.arange(round(duration / period)) * period
    points, rng, body = reference(time), np.random.default_rng(0), plant(mechanism, period)
    state = body.init(points.p[0] + off, points.v[0])
    memory = controller.init(state.p, state.v)
    rows: list[tuple[Array, Array, Array, Any]] = []
    coming: list[Array] = []
    for k, t in enumerate(time):
        measured = state.v + noise * rng.normal(size=mechanism.dof) if noise else state.v
        torque, memory = controller.step(memory, state.p, measured, ReferencePoint(*(part[k] for part in points)))
        rows.append((state.p, state.v, torque, memory))
        coming += [torque] * (late + 1 - len(coming))
        acting = coming.pop(0) if disturbance is None else coming.pop(0) + disturbance(t)
        state = body.step(state, acting, parameters)
    p, v, torques, states = zip(*rows, strict=True)
    return Loop(period, time, np.array(p), np.array(v), np.array(torques), list(states))


def kinetic(mechanism: Mechanism, run: Loop) -> Array:
    """s'Ms/2 (T,)."""
    return 0.5 * np.einsum("ti,tij,tj->t", run.s, mechanism.mass_matrix(run.p), run.s)


def distance(controller: AdaptiveController, run: Loop, parameters: Array) -> Array:
    """The parameters' term of V (T,)."""
    law, model = controller.adaptation_law, controller.model
    found = None if law is None else law.lyapunov_distance(model, run.estimate, model.regrouping @ parameters)
    assert found is not None
    return found


def integral(run: Loop, values: Array) -> Array:
    """The integral (T,) of samples by the trapezium."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))]) * run.period


def dissipated(run: Loop, damping: Array) -> Array:
    """The integral (T,) of s'Ks."""
    return integral(run, (run.s**2 * damping).sum(axis=1))
