"""Contests: several controllers on one environment, one after the other, under equal conditions."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.codegen.live_arm import LiveArm, live_arm
from adaptctl.control import Controller, ReferencePoint, SlotineLi, lyapunov
from adaptctl.control.memory import leaves
from adaptctl.dynamics import Mechanism
from adaptctl.recording import ControllerRun, Progress, TickCost
from adaptctl.simulation import Plant, Rollout, rollout, simulate
from adaptctl.simulation.rollout import known_steps

if TYPE_CHECKING:
    import gymnasium

TIMED_TICKS, REPETITIONS = 1000, 30
"""control ticks that are timed to find out how long one takes"""
LONG = 20_000
"""operations of a tick above which its native time is not told: to compile it for that takes LLVM ten seconds"""
MANY, FEW = 600_000, 30_000
"""samples of all runs: so many are kept as they are, and of more so few: with what draws them they fit into 500 MB"""


@dataclass(frozen=True, eq=False)
class Contender:
    """A controller to compare with others on one environment, with its names: `name`, short, fit for a file and unique
    among those compared; `label`, for legends; `knows`, in words what the controller knows of the arm beforehand; and
    `make`, a function without arguments that makes the controller, called once, when it is first asked for. Nothing is
    checked at construction."""

    name: str
    label: str
    knows: str
    make: Callable[[], Controller[Any]]

    @classmethod
    def of(cls, name: str, label: str, knows: str, controller: Controller[Any]) -> Contender:
        """The `Contender`, a controller to compare with its names, for a `controller` that is made already: `name`,
        short and fit for a file; `label`, for legends; and `knows`, in words what the controller knows of the arm
        beforehand. Nothing is checked."""
        return cls(name, label, knows, lambda: controller)

    @cached_property
    def controller(self) -> Controller[Any]:
        """Controller to compare, a `Controller`, made by the field `make` when first asked for and then cached. Raises
        what `make` raises, such as `GainError` for gains too large for the control period."""
        return self.make()


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a contest, a comparison of controllers on one environment: the `mechanism` that they drove; `runs`, a
    `ControllerRun` for each controller, in their order; and `complete`, False where the contest was interrupted: `runs`
    are then those that had begun. Nothing is checked at construction."""

    mechanism: Mechanism
    runs: tuple[ControllerRun, ...]
    complete: bool


def contest(
    env: gymnasium.Env[Any, Any],
    mechanism: Mechanism,
    contenders: Sequence[Contender],
    seed: int,
    progress: Progress,
    options: Mapping[str, Any] = MappingProxyType({}),
) -> Outcome:
    """Outcome, an `Outcome`, of a contest: each of the `contenders` (controllers with names) drives the environment
    `env`, whose arm is `mechanism`, one after the other, from the same `seed` and `options` of the environment's reset,
    such as a payload.

    `progress(label, share)` is called with the contender's label and the fraction of its run that is done, 0 to 1. All
    controllers are made before anything runs, so that what their making raises, such as `GainError`, comes first. Where
    all runs together have more than 600 000 control periods, at most about 30 000 of them, evenly spaced, are recorded.
    Raises `InputError` for an environment that a controller cannot drive, `NonFiniteError` where a motion diverges to
    non-finite values. Ctrl-C ends the contest: the runs that had begun are returned, as not complete;
    `KeyboardInterrupt` is raised where there are none, and for an environment that gives no sample.
    """
    for contender in contenders:
        _ = contender.controller  # what cannot be made is told before anything runs
    runs: list[ControllerRun] = []
    every = thinning((known_steps(env) or 0) * len(contenders))
    try:
        for contender in contenders:
            runs.append(_run(env, mechanism, contender, seed, options, partial(progress, contender.label), every))
            if not runs[-1].rollout.complete:
                break
    except KeyboardInterrupt:
        if not runs:
            raise
    begun = tuple(run for run in runs if len(run.rollout.time))
    if not begun:
        raise KeyboardInterrupt
    return Outcome(mechanism, begun, complete=len(begun) == len(contenders) and begun[-1].rollout.complete)


def thinning(samples: int) -> int:
    """Number of control periods per recorded sample, at least 1, where all runs together have `samples` control
    periods: 1 for at most 600 000 of them, else the least number that leaves at most 30 000 samples. Nothing is
    checked."""
    return -(-samples // FEW) if samples > MANY else 1


def live_subject(
    env: gymnasium.Env[Any, Any], controller: Controller[Any], seed: int, options: Mapping[str, Any]
) -> LiveArm | str:
    """Closed loop of an environment and a `controller` as a `LiveArm`, a WebAssembly module that a report's page runs
    in the browser, from the state in which `env` begins with the `seed` and `options` of its reset; or, as text, the
    reason why it cannot be made, such as a plant of another simulator, effects such as a payload, or a reference that
    is no sum of sinusoids. Raises what the environment's reset raises."""
    if not hasattr(env.unwrapped, "hand_over"):
        return f"{type(env.unwrapped).__name__} does not tell what it is made of"
    if type(env.unwrapped.plant).step is not Plant.step:  # type: ignore[attr-defined]
        return f"{type(env.unwrapped).__name__} has physics of its own"
    env.reset(seed=seed, options=dict(options))
    episode = env.unwrapped.hand_over()
    return live_arm(episode.plant, controller, episode.reference, episode.state, episode.parameters)


def _run(
    env: gymnasium.Env[Any, Any],
    mechanism: Mechanism,
    contender: Contender,
    seed: int,
    options: Mapping[str, Any],
    progress: Callable[[float], object],
    every: int,
) -> ControllerRun:
    controller = contender.controller
    progress(0.0)
    step = getattr(type(getattr(env.unwrapped, "plant", None)), "step", Plant.step)
    drive = simulate if step is Plant.step else rollout  # MuJoCo's steps are not ours to compile
    with shown_live(env, mechanism) as seen:
        drive = drive if seen is env else rollout
        result = drive(seen, controller, seed=seed, options=dict(options), progress=progress, every=every)
    run = ControllerRun(name=contender.name, label=contender.label, knows=contender.knows, rollout=result)
    try:
        cost = tick_cost(controller, result) if result.complete else None
        known = "payload" not in options  # else the truth is not the mechanism's own
        run = replace(run, lyapunov=_lyapunov(controller, result, mechanism) if known else None, cost=cost)
    except KeyboardInterrupt:
        run = replace(run, rollout=replace(result, complete=False))
    progress(1.0)
    return run


@contextmanager
def shown_live(env: gymnasium.Env[Any, Any], mechanism: Mechanism) -> Iterator[gymnasium.Env[Any, Any]]:
    """Context manager that gives the environment to drive: `env` itself or, within `adaptctl.recording.live.streaming`
    and where the viewer at the address set there can be reached, a wrapper of `env` that also shows the motion of its
    arm, `mechanism`, in that viewer. Gives a `LiveViewWarning` where no viewer can be reached. Raises `InputError` for
    an address other than a port of this computer or a file .rrd, and for a mechanism that cannot be drawn, `FileError`
    for a file in a folder that cannot be written to."""
    from adaptctl.recording.live import CURRENT, Live

    if (to := CURRENT.get()) is None:
        yield env
        return
    from adaptctl.envs.live import LiveView

    with Live(mechanism, to) as live:
        yield LiveView(env, live) if live.is_seen else env


def _lyapunov(controller: Controller[Any], run: Rollout, mechanism: Mechanism) -> Array | None:
    """Lyapunov function (T,) of Slotine and Li's law where it adapts; its relatives' need more than a run keeps."""
    if type(controller) is not SlotineLi or controller.adaptation_law is None or not len(run.time):
        return None
    if controller.model.regrouping.shape[1] != len(mechanism.parameter_names):
        return None  # its model knows less of the arm, friction for one
    if run.marks.get("payload", run.time[:1] * 0.0).any():
        return None  # the truth changes in mid-motion, and no function of it falls across that
    if controller.adaptation_law.distance(controller.model, run.estimate[:1], run.estimate[0]) is None:
        return None
    return lyapunov(controller, run, mechanism)


def tick_cost(controller: Controller[Any], run: Rollout) -> TickCost:
    """Cost of a control tick, the computation of one torque, a `TickCost`, over 1000 states evenly spread over a `run`
    of a `controller`: the median time of a call from Python, s; the mean time in a loop of native code over all these
    states, s, the least of 30 such loops; and the number of floating-point operations. The last two are None where the
    control law is not compiled; the native time is None also beyond 20 000 operations, which take too long to compile.
    Raises `IndexError` for a run without samples."""
    picked = np.linspace(0, len(run.time) - 1, TIMED_TICKS).astype(int)
    states = [run.p[picked], run.v[picked], run.reference_p[picked], run.reference_v[picked], run.reference_a[picked]]
    called, kernel = _called(controller, states), controller.kernel
    if kernel is None:
        return TickCost(called)
    flops = kernel.operations.flops
    if flops > LONG:
        return TickCost(called, flops=flops)
    memory = controller.init(run.p[0], run.v[0])
    kept = [np.concatenate([np.zeros(0), *leaves(memory)]), *([controller.packed] if controller.packed.size else [])]
    arguments = [*states, *(np.tile(part, (TIMED_TICKS, 1)) for part in kept)]
    results = [np.empty((TIMED_TICKS, *shape)) for shape in kernel.outputs]  # fresh ones would time page faults
    native = min(_duration(partial(kernel.map, out=results), *arguments) for _ in range(REPETITIONS))
    return TickCost(called, native / TIMED_TICKS, flops)


def _called(controller: Controller[Any], states: list[Array]) -> float:
    """Median time (s) of a tick called from Python."""
    state = controller.init(states[0][0], states[1][0])
    ticks = [(p, v, ReferencePoint(*reference)) for p, v, *reference in zip(*states, strict=True)]
    return float(np.median([_duration(controller.step, state, *tick) for tick in ticks]))


def _duration(function: Callable[..., object], *arguments: object) -> float:
    started = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - started
