"""Several controllers on one environment, one after the other, under equal conditions."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.control import Controller, ReferencePoint, SlotineLi, lyapunov
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.experiment import Progress
from adaptctl.mechanism.pose import Array
from adaptctl.recording import Run
from adaptctl.simulation import Rollout, rollout

if TYPE_CHECKING:
    import gymnasium

TIMED_TICKS = 400
"""control ticks that are timed to find out how long one takes"""


@dataclass(frozen=True, eq=False)
class Contender:
    """A controller, what to call it, and what it knows of the arm."""

    name: str
    label: str
    knows: str
    controller: Controller[Any]


@dataclass(frozen=True, eq=False)
class Outcome:
    """The runs of a contest; when it was interrupted, those that were begun."""

    runs: tuple[Run, ...]
    complete: bool


def contest(
    env: gymnasium.Env[Any, Any],
    mechanism: Mechanism,
    contenders: Sequence[Contender],
    seed: int,
    progress: Progress,
) -> Outcome:
    """Drive the environment with each contender from the same seed.

    Ctrl-C ends the contest and keeps what was run; before anything was run it passes.
    """
    runs: list[Run] = []
    try:
        for contender in contenders:
            runs.append(_run(env, mechanism, contender, seed, partial(progress, contender.label)))
            if not runs[-1].rollout.complete:
                break
    except KeyboardInterrupt:
        if not runs:
            raise
    begun = tuple(run for run in runs if len(run.rollout.time))
    if not begun:
        raise KeyboardInterrupt
    return Outcome(begun, complete=len(begun) == len(contenders) and begun[-1].rollout.complete)


def _run(
    env: gymnasium.Env[Any, Any],
    mechanism: Mechanism,
    contender: Contender,
    seed: int,
    progress: Callable[[float], object],
) -> Run:
    controller = contender.controller
    progress(0.0)
    result = rollout(env, controller, seed=seed, progress=progress)
    run = Run(
        name=contender.name,
        label=contender.label,
        knows=contender.knows,
        rollout=result,
        lyapunov=_lyapunov(controller, result, mechanism),
        tick_time=tick_time(controller, result) if result.complete else None,
    )
    progress(1.0)
    return run


def _lyapunov(controller: Controller[Any], run: Rollout, mechanism: Mechanism) -> Array | None:
    """The Lyapunov function of a law that adapts."""
    if isinstance(controller, SlotineLi) and controller.adaptation is not None and len(run.time):
        return lyapunov(controller, run, mechanism)
    return None


def tick_time(controller: Controller[Any], run: Rollout) -> float:
    """The median time (s) of one control tick, over states of a run."""
    picked = np.linspace(0, len(run.time) - 1, TIMED_TICKS).astype(int)
    state = controller.init(run.p[0], run.v[0])
    times = np.empty(TIMED_TICKS)
    for i, k in enumerate(picked):
        reference = ReferencePoint(run.reference_p[k], run.reference_v[k], run.reference_a[k])
        p, v = run.p[k], run.v[k]
        started = time.perf_counter()
        _, state = controller.step(state, p, v, reference)
        times[i] = time.perf_counter() - started
    return float(np.median(times))
