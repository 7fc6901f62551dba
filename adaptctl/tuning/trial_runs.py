"""Simulated runs of many arms, by the code that `simulate` runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import Ensemble, LaneArray
from adaptctl.control.controller import GAINS, Controller, Reference
from adaptctl.simulation import Plant
from adaptctl.simulation.closed_loop import LATE, ClosedLoop, Sample
from adaptctl.simulation.members import Noise, differing, gains_of, joined_gains
from adaptctl.simulation.references import sampled
from adaptctl.simulation.repeated_runs import keeps, recorded

RECORD_INTERVAL = 50  # control periods
NUMBERS = 2_000_000  # recorded at once


class TrialRuns(NamedTuple):
    """Samples of M runs: times (T,), positions, errors, applied torques (T, M, r); errors' largest sizes (M, r)."""

    time: Array
    p: Array
    error: Array
    applied: Array
    largest_error: Array


def run_trials(
    plant: Plant,
    laws: Sequence[Controller[Any]],
    reference: Reference,
    first: Array,
    duration: float,
    parameters: Array,
    delayed: Array,
    *,
    once: bool = False,
) -> TrialRuns:
    """
    Runs of M laws that differ in numbers alone, from rest, with the same noise of sensors.

    Positions `first` (r,) or (M, r) in rad (m), `duration` in s, true parameters (M, P), torques a period late where
    `delayed` (M,) is true; `once` with code that is made for these runs.
    """
    noise = Noise.of(0, 1, 1, plant.noise_size)[0]
    steps = round(duration / plant.control_period)
    arms = _at_rest(plant, laws, first, parameters, noise, steps * len(laws) if once else math.inf)
    arms.held[LATE] = np.asarray(delayed, dtype=np.float64)[:, None]
    numbers = sum(np.prod(shape) for shape in arms.stepper.outputs) * len(laws)
    chunk = steps if keeps(arms) else RECORD_INTERVAL * max(1, int(NUMBERS // (RECORD_INTERVAL * numbers)))
    time = np.asarray(plant.control_period * np.arange(steps))
    room = arms.allocate_outputs(min(chunk, steps) + 1)
    parts = [_advanced(plant, arms, room, reference, time[k : k + chunk], noise) for k in range(0, steps, chunk)]
    p, error, applied, largest = zip(*parts, strict=True)
    samples = map(np.concatenate, (p, error, applied))
    return TrialRuns._make((time[::RECORD_INTERVAL], *samples, np.max(largest, axis=0)))


def _at_rest(
    plant: Plant, laws: Sequence[Controller[Any]], first: Array, parameters: Array, noise: Noise, periods: float
) -> Ensemble:
    law, differ = differing(laws, {})
    loop, gains = ClosedLoop(plant, law), gains_of(law, differ, len(laws))
    p, v = np.broadcast_to(first, (len(laws), plant.dof)), np.zeros((len(laws), plant.dof))
    arms = loop.compiled(periods).ensemble(len(laws))
    state = plant.init(p, v, parameters, np.broadcast_to(noise.drawn(1)[0], (len(laws), noise.size)))
    loop.set_state(arms, state, law.init(state.measured_p, state.measured_v, gains))
    arms.held["parameters"] = parameters
    if gains:
        arms.held[GAINS] = joined_gains(gains)
    return arms


def _advanced(
    plant: Plant, arms: Ensemble, room: LaneArray, reference: Reference, time: Array, noise: Noise
) -> tuple[Array, ...]:
    """Samples of the control periods that begin at times (T,) in s, and errors' largest sizes."""
    signals, r = arms.signals(len(time)), plant.dof
    point = sampled(reference, time, r, out=signals.shared.blocks[:, 0, : 3 * r, 0].reshape(-1, 3, r))
    signals.shared["noise"] = noise.drawn(len(time))
    recorded(arms, room, len(time), signals)
    shapes = {name: (len(room.blocks), room.members, n) for name, n in room.columns.items()}
    sample = Sample(*(room.view(name).reshape(shape)[: len(time)] for name, shape in shapes.items()))
    p, every = plant.positions(sample.q), slice(None, None, RECORD_INTERVAL)
    error = p - point.p[:, None]
    return p[every].copy(), error[every].copy(), sample.applied[every].copy(), np.abs(error).max(axis=0)
