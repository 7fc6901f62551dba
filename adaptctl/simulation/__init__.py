"""Simulation of closed loops."""

from adaptctl.simulation.closed_loop import ClosedLoop, Episode
from adaptctl.simulation.integrator import (
    Acceleration,
    Integrator,
    LinearlyImplicitEuler,
    RungeKutta4,
    SemiImplicitEuler,
)
from adaptctl.simulation.period import PlantState
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.push import HandPush
from adaptctl.simulation.rollout import rollout
from adaptctl.simulation.run import Rollout
from adaptctl.simulation.run_logger import RunLogger
from adaptctl.simulation.simulate import simulate
from adaptctl.simulation.simulate_many import Rollouts, simulate_many

__all__ = [
    "Acceleration",
    "ClosedLoop",
    "Episode",
    "HandPush",
    "Integrator",
    "LinearlyImplicitEuler",
    "Plant",
    "PlantState",
    "Rollout",
    "Rollouts",
    "RunLogger",
    "RungeKutta4",
    "SemiImplicitEuler",
    "rollout",
    "simulate",
    "simulate_many",
]
