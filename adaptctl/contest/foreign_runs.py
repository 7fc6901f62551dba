"""Runs of a contest on the physics of another engine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.contest.conditions import CONDITIONS, PlantCondition
from adaptctl.contest.drake_plant import DrakePlant
from adaptctl.contest.measures import DIVERGED, ContestRuns
from adaptctl.contest.scene import Scene
from adaptctl.control import Controller
from adaptctl.control.controller import Reference
from adaptctl.errors import NonFiniteError
from adaptctl.scalars import Column
from adaptctl.simulation.effects import PlantEffects
from adaptctl.simulation.mujoco_plant import MuJoCoPlant
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.references import sampled

ENGINES: dict[str, Callable[..., Plant]] = {"mujoco": MuJoCoPlant.of, "drake": DrakePlant}
"""Plants of a mechanism, by the engine's name."""


def fits(engine: str, condition: str) -> bool:
    """True for a condition whose effects act on torques and loads, or that has none; Drake has no Coulomb friction."""
    return CONDITIONS[condition].foreign and (engine, condition) != ("drake", "friction")


def foreign_runs(
    engine: str,
    scene: Scene,
    condition: PlantCondition,
    laws: Controller[Any] | Sequence[Controller[Any]],
    references: Sequence[Reference],
    start: Array,
    truth: Array,
    *,
    duration: float,
    record_every: int,
) -> ContestRuns:
    """Runs of all seeds, one after the other."""
    limits, period = condition.limit_share * scene.tuning.torque_limits, scene.tuning.control_period
    plant = ENGINES[engine](scene.mechanism, period, torque_limits=limits)
    each = [laws] * len(references) if isinstance(laws, Controller) else laws
    effects, count = PlantEffects.of(condition.effects(scene)), round(duration / period)
    times: Array = period * np.arange(count, dtype=np.float64)
    runs = [
        _run(plant, effects, law, sampled(reference, times, plant.dof), p, parameters)
        for law, reference, p, parameters in zip(each, references, start, truth, strict=True)
    ]
    *parts, estimates = zip(*runs, strict=True)
    error, torque, diverged = (np.stack(part, axis=1) for part in parts)
    with np.errstate(invalid="ignore"):
        largest = np.abs(error).max(axis=0)
    kept = slice(0, count, record_every)
    return ContestRuns(times[kept], error[kept], torque[kept], largest, diverged[0], np.stack(estimates))


def _run(
    plant: Plant, effects: PlantEffects, law: Controller[Any], points: Any, p: Array, parameters: Array
) -> tuple[Array, Array, Array, Array]:
    """Errors and torques (T, r) of a run, when it diverged in s, NaN if never, and the last estimate (k,)."""
    error, commanded = (np.full((len(points.p), plant.dof), np.nan) for _ in range(2))
    links = plant.mechanism.description.body_names
    loaded, still = effects.loaded(parameters, links, 0.0), np.zeros(plant.dof)
    state, held = (
        plant.init(p, points.v[0], loaded),
        plant.mechanism.with_parameters(loaded).inverse_dynamics(p, still, still),
    )
    memory = law.init(state.p, state.v)
    kept = [each.initial_state(held, plant.control_period) for each in effects.actuators]
    for k, (p_d, v_d, a_d) in enumerate(zip(*points, strict=True)):
        time = k * plant.control_period
        error[k] = state.p - p_d
        if not np.abs(error[k]).max() <= DIVERGED:
            return error, commanded, np.array([time]), _estimate(memory)
        try:
            torque, memory = law.step(memory, state.p, state.v, type(points)(p_d, v_d, a_d))
            commanded[k] = torque
            for i, each in enumerate(effects.actuators):
                moved, after = each.apply(Column(torque.tolist()), Column(kept[i].tolist()), plant.control_period)
                torque, kept[i] = np.array(list(moved)), np.array(list(after))
            state = plant.step(state, torque, effects.loaded(parameters, links, time))
        except NonFiniteError:
            return error, commanded, np.array([time]), _estimate(memory)
    return error, commanded, np.array([np.nan]), _estimate(memory)


def _estimate(memory: Any) -> Array:
    return np.asarray(getattr(memory, "estimate", ()))
