"""Closed loops with the torque held over each period, for tests: what happened, and the proof's function V."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.control import Adaptive, Controller, Reference, ReferencePoint
from adaptctl.dynamics import Mechanism
from adaptctl.mechanism.pose import Array
from adaptctl.simulation import Plant

Disturbance = Callable[[float], Array]
"""A time (s) to torques (r,) that act besides the controller's, N m."""


@dataclass(frozen=True)
class Loop:
    """A run of T periods: states before each torque, and the torques."""

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
    period: float,
    *,
    off: float | Array = 0.1,
    disturbance: Disturbance | None = None,
    parameters: Callable[[float], Array] | None = None,
) -> Loop:
    """The controller on the mechanism from the reference's start, `off` in every joint."""
    plant = Plant(mechanism, period, torque_limits=np.full(mechanism.dof, np.inf))
    time = np.arange(round(duration / period)) * period
    points = reference(time)
    state = plant.init(points.p[0] + off, points.v[0])
    memory = controller.init(state.p, state.v)
    rows: list[tuple[Array, Array, Array, Any]] = []
    for k, t in enumerate(time):
        torque, memory = controller.step(memory, state.p, state.v, ReferencePoint(*(part[k] for part in points)))
        rows.append((state.p, state.v, torque, memory))
        acting = torque if disturbance is None else torque + disturbance(t)
        state = plant.step(state, acting, None if parameters is None else parameters(t))
    p, v, torques, states = zip(*rows, strict=True)
    return Loop(time, np.array(p), np.array(v), np.array(torques), list(states))


def kinetic(mechanism: Mechanism, run: Loop) -> Array:
    """s'Ms/2 (T,)."""
    return 0.5 * np.einsum("ti,tij,tj->t", run.s, mechanism.mass_matrix(run.p), run.s)


def lyapunov_function(controller: Adaptive, mechanism: Mechanism, run: Loop) -> Array:
    """V (T,): the kinetic term and the adaptation law's distance."""
    law, model = controller.adaptation_law, controller.model
    assert law is not None
    distance = law.distance(model, run.estimate, model.regrouping @ mechanism.inertial_parameters)
    assert distance is not None
    return kinetic(mechanism, run) + distance
