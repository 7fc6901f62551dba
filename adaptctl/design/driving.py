"""Closed-loop runs with and without counterweights."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array, positive_number, whole_number
from adaptctl.control import SlotineLi, Subspace
from adaptctl.design.study import DesignStudy
from adaptctl.design.task import DesignTask
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel, reduce
from adaptctl.simulation import Plant, Rollouts, simulate_many
from adaptctl.simulation.whole_runs import whole
from adaptctl.tuning import Tuning, tune

# Components that the small controllers adapt, and time of a run in s.
NUM_COMPONENTS, RUN_DURATION = 10, 20.0
# Position error in rad or m at which a run ends.
MAX_POSITION_ERROR = 1.0


class Demand(NamedTuple):
    """Tracking errors, torque, work and duration of a run; `stopped` if an error reached 1 rad (m)."""

    rms_error: float
    final_rms_error: float | None
    rms_torque: float
    work: float
    duration: float
    stopped: bool


@dataclass(frozen=True, eq=False)
class DrivenArm:
    """Closed-loop run with its demand and samples."""

    name: str
    label: str
    demand: Demand
    time: Array
    p: Array
    error: Array
    applied: Array


def driven(
    study: DesignStudy,
    *,
    control_period: float = 1e-3,
    duration: float = RUN_DURATION,
    components: int | None = None,
    seed: int,
    progress: Callable[[float], object] = lambda share: None,
) -> tuple[DrivenArm, ...]:
    """Runs with and without counterweights that adapt all parameters, few components, and none."""
    mechanism, whole = study.task.mechanism, study.task.essential_space.rank
    if len(mechanism.parameter_names) != mechanism.num_energy_parameters:
        raise InputError(f"{mechanism.name} has friction, which has no energy components; use an arm without friction")
    few = min(NUM_COMPONENTS, whole) if components is None else components
    count = whole_number(few, f"components of {mechanism.name}", 1, whole)
    positive_number(duration, "duration: expected a positive number of s")
    tuning = tune(mechanism, control_period=control_period, seed=seed, nominal_only=True)
    arms, runs = (("before", study.task), ("after", study.counterweights.balanced_task)), list[DrivenArm]()
    for when, task in arms:
        plant = Plant(task.mechanism, tuning.control_period, tuning.substeps, tuning.integrator, tuning.torque_limits)
        for kind, label, law in _laws(task, tuning, count):
            progress(len(runs) / 6.0)
            with_them = "with counterweights" if when == "after" else "as described"
            found = _run(plant, law, tuning, duration)
            runs.append(_judged(found, tuning.torque_limits, f"{kind}-{when}", f"{label}, {with_them}"))
    progress(1.0)
    return tuple(runs)


def _laws(task: DesignTask, tuning: Tuning, count: int) -> Iterator[tuple[str, str, SlotineLi]]:
    model, reduction = (
        ReducedModel(task.mechanism, task.basis),
        reduce(task.essential_space, task.parameters, components=count),
    )
    directions = task.essential_space.basis[:, list(reduction.order)[:count]]
    gains, given = tuning.gains, (tuning.control_period, tuning.workspace, tuning.torque_limits)

    def slotine_li(law: Any, first: Array | None = None) -> SlotineLi:
        return SlotineLi(model, gains.bandwidth, gains.damping, law, first, *given)

    few = Subspace(directions.T**2 @ tuning.adaptation, model.regrouping @ directions)
    yield "all", "All adapted", slotine_li(tuning.adaptation_gain_for(model))
    yield "few", f"{count} adapted", slotine_li(few)
    yield "held", f"True {count}", slotine_li(None, model.regrouping @ reduction.parameters(count))


def _run(plant: Plant, law: SlotineLi, tuning: Tuning, duration: float) -> Rollouts:
    start = tuning.reference(0.0).p + tuning.initial_error
    given = {"duration": duration, "p": start, "v": np.zeros(plant.dof), "divergence_bound": MAX_POSITION_ERROR}
    return whole(simulate_many(plant, law, tuning.reference, **given))


def _judged(runs: Rollouts, limits: Array, name: str, label: str) -> DrivenArm:
    gone = float(runs.diverged_at[0])
    kept = runs.time < gone if np.isfinite(gone) else np.ones(len(runs.time), dtype=np.bool_)
    time, p, v, error, applied = (x[kept] for x in (runs.time, runs.p, runs.v, runs.error, runs.applied))
    final = float(np.sqrt(np.mean(runs.final_rms_error[0] ** 2)))
    demand = Demand(
        float(np.sqrt(np.mean(runs.rms_error[0] ** 2))),
        final if np.isfinite(final) else None,
        float(np.sqrt(np.mean(np.sum((applied[:, 0] / limits) ** 2, axis=-1)))),
        float(np.abs(applied[:, 0] * v[:, 0]).sum() * runs.control_period),
        len(time) * runs.control_period,
        bool(np.isfinite(gone)),
    )
    return DrivenArm(name, label, demand, time, p[:, 0], error[:, 0], applied[:, 0])
