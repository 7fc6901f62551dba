"""The physical arm in time: integrators, the plant, its effects, and closed-loop runs."""

from adaptctl.simulation.integrator import Acceleration, Integrator, RungeKutta4, SemiImplicitEuler
from adaptctl.simulation.plant import Plant, PlantState
from adaptctl.simulation.real_plant import RealPlant, RealPlantState
from adaptctl.simulation.rollout import Rollout, rollout
from adaptctl.simulation.simulate import simulate

__all__ = [
    "Acceleration",
    "Integrator",
    "Plant",
    "PlantState",
    "RealPlant",
    "RealPlantState",
    "Rollout",
    "RungeKutta4",
    "SemiImplicitEuler",
    "rollout",
    "simulate",
]
