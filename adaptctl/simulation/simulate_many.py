"""Many closed loops of one kind at once, in SIMD lanes: for Monte Carlo studies, sweeps and tolerances."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen
from adaptctl.compilation import Stepper, compile_step
from adaptctl.compilation.limits import LARGEST_COMPILED
from adaptctl.control.controller import Controller, Reference, leaves
from adaptctl.control.reference_check import warn_of_derivatives
from adaptctl.errors import InputError
from adaptctl.scalars import Column, absolute, maximum
from adaptctl.simulation.closed_loop import ClosedLoop
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.references_of_many import ReferenceForm, ReferencesOfMany
from adaptctl.simulation.sampled_references import REFERENCE

MEMORY = 2**23
"""Bytes that a native call may read and write besides the arms' states."""
RECORDED = ("p", "v", "reference_p", "reference_v", "torque", "applied", "estimate")


@dataclass(frozen=True, eq=False)
class Rollouts:
    """What happened in M closed-loop runs of r joints; every array is read-only.

    Sample k has the states at `time[k]` and the torques commanded on them; T samples. The errors are of all control
    periods, whether or not they are sampled. Runs never see each other: where one is not finite, the others are.
    """

    time: Array
    """(T,) s"""
    p: Array
    """(T, M, r) positions, rad or m"""
    v: Array
    """(T, M, r)"""
    reference_p: Array
    """(T, M, r)"""
    reference_v: Array
    """(T, M, r)"""
    torque: Array
    """(T, M, r) commanded, N m"""
    applied: Array
    """(T, M, r) N m, what reached the joints"""
    estimate: Array
    """(T, M, k) the controllers' parameter estimates, k = 0 where they have none"""
    parameters: Array
    """(M, P) the true ones, without what effects load on them"""
    rms_error: Array
    """(M, r) root mean square of p - reference p"""
    largest_error: Array
    """(M, r) its largest magnitude"""
    control_period: float
    """s"""
    wall_time: float
    """s"""
    complete: bool
    """False when the runs were interrupted: what was computed is kept."""

    @property
    def error(self) -> Array:
        """Tracking errors (T, M, r)."""
        return self.p - self.reference_p

    @property
    def finite(self) -> Array:
        """Which runs (M,) stayed finite."""
        return np.asarray(np.isfinite(self.rms_error).all(axis=-1))


def simulate_many(
    plant: Plant,
    controller: Controller[Any],
    reference: Reference | Sequence[Reference],
    *,
    duration: float,
    members: int | None = None,
    parameters: ArrayLike | None = None,
    p: ArrayLike | None = None,
    v: ArrayLike | None = None,
    memory: Any = None,
    seed: int | None = None,
    every: int = 1,
    threads: int = 1,
    progress: Callable[[float], object] | None = None,
) -> Rollouts:
    """Many runs of one controller on one plant, of `duration` s each, that differ in what is given as a row each.

    `reference` is one for all or a sequence of M; those that are `Sinusoids` alike in their number of terms cost no
    memory. `parameters` (P,) or (M, P) are the true ones, the mechanism's own when not given; `p` and `v`, (r,) or
    (M, r), are where the arms start, on their references when not given; `memory` is what the controllers remember,
    changed from what `controller.init` gives for one arm or for M, such as estimates; `members` is M where nothing else
    tells. `seed` is that of the sensors' noise.

    Every `every`-th control period is recorded, the first one included: memory goes with T M over it. `threads` share
    the arms. `progress` is called in between with the share done, and Ctrl-C keeps what was computed. Nothing ends a
    run early. Raises `InputError` where arguments do not fit together, and for more than LARGEST_COMPILED links.
    """
    run = _Runs(ClosedLoop(plant, controller), reference, duration, every, threads)
    run.begin(members, seed, memory, parameters=parameters, p=p, v=v)
    complete, started = False, perf_counter()
    try:
        while run.count < run.steps:
            run.advance()
            if progress is not None:
                progress(run.count / run.steps)
        complete = True
    except KeyboardInterrupt:
        pass
    return run.result(perf_counter() - started, complete)


@lru_cache(maxsize=8)
def _compiled(loop: ClosedLoop, form: ReferenceForm) -> Stepper:
    """A control period of arms in lanes, with the errors summed up."""

    def step(squares: Column, largest: Column, **columns: Column) -> tuple[Any, ...]:
        point = form.point(columns)
        passed_on, sample = loop.equation(**columns | dict(zip(REFERENCE, point, strict=True)))
        p = loop.plant.primary(sample.q)
        error = p - point.p
        summed = squares + error * error, Column(map(maximum, largest, map(absolute, error)))
        done = sample.torque, sample.applied, sample.estimate
        return (*passed_on, *summed, p, sample.v, point.p, point.v, *done)

    sums = dict.fromkeys(("squares", "largest"), loop.controller.dof)
    return compile_step(
        step,
        state=loop.state | sums,
        held=loop.held | form.held,
        shared=form.shared,
        driven=form.driven | loop.noise,
        name=type(loop.controller).__name__,
    )


class _Runs:
    """Runs in the making."""

    def __init__(
        self,
        loop: ClosedLoop,
        reference: Reference | Sequence[Reference],
        duration: float,
        every: int,
        threads: int,
    ) -> None:
        self.loop, self.period, self.threads = loop, loop.plant.control_period, threads
        if not (np.isfinite(duration) and duration >= self.period):
            raise InputError(f"duration: expected at least a control period of {self.period:g} s, got {duration}")
        for name, number in (("every", every), ("threads", threads)):
            _require_count(name, number)
        _require_compilable(loop)
        self.steps, self.every = round(duration / self.period), int(every)
        self.references = ReferencesOfMany.of(reference, loop.controller.reference_size)
        first = reference[0] if isinstance(reference, Sequence) else reference
        warn_of_derivatives(first, [joint.name for joint in loop.plant.mechanism.primary_joints], duration, 4)

    @property
    def count(self) -> int:
        """Control periods done."""
        return self._done[0]

    def begin(self, members: int | None, seed: int | None, memory: Any, **given: ArrayLike | None) -> None:
        """Put every arm where it starts: at `parameters`, `p` and `v`, those of the mechanism and on the reference
        unless given."""
        loop, start = self.loop, self.references.start()
        own = {"parameters": loop.plant.mechanism.inertial_parameters, "p": start[0], "v": start[1]}
        chosen = own | {name: x for name, x in given.items() if x is not None}
        rows = {name: checked(x, own[name].shape[-1], name) for name, x in chosen.items()}
        if members is not None:
            _require_count("members", members)
        remembered = [] if memory is None else self._remembered(memory)
        told = rows | {f"memory {k}": np.asarray(part) for k, part in enumerate(remembered)}
        count = _members(members, {"reference": self.references.arms} | {k: x.shape[:-1] for k, x in told.items()})
        self.parameters, p, v = (np.broadcast_to(x, (count, x.shape[-1])) for x in rows.values())
        self.rng = np.random.default_rng(seed)
        state = loop.plant.init(p, v, loop.plant.parameters(self.parameters, 0.0), self._noise(1, count)[0])
        self.arms = _compiled(loop, self.references.form).ensemble(count)
        loop.begin(
            self.arms, state, loop.controller.init(state.measured_p, state.measured_v) if memory is None else memory
        )
        self.arms.held["parameters"] = self.parameters
        for name, values in self.references.held.items():
            self.arms.held[name] = values
        shapes = self.arms.stepper.outputs
        self.longest = max(1, MEMORY // (8 * count * (sum(map(math.prod, shapes)) + 5 * loop.controller.dof)))
        self.records = tuple(np.empty((self._samples(self.steps), count, *shape)) for shape in shapes)
        self._done = 0, self.arms.state["squares"], self.arms.state["largest"]

    def _remembered(self, memory: Any) -> list[Any]:
        """The parts of a memory of this controller."""
        own = [(size,) for name, size in self.loop.state.items() if name.startswith("memory")]
        parts = leaves(memory) if isinstance(memory, tuple) else [memory]
        sizes = [np.shape(part)[-1:] for part in parts]
        if sizes != own:
            kind = type(self.loop.controller).__name__
            raise InputError(f"memory: expected what {kind}.init gives, parts whose last axes are {own}, got {sizes}")
        return parts

    def advance(self) -> None:
        """One native call: as far as memory allows, and where not all samples are kept, up to the next one that is. It
        counts when all of it is done."""
        first, every = self.count, self.every
        time = self._times(self.steps if every == 1 else min(first + -first % every + 1, self.steps))
        outputs, last = self._taken(time, record=every == 1), first + len(time)
        for kept, part in zip(self.records, outputs, strict=True):
            kept[self._samples(first) : self._samples(last)] = part
        self._done = last, self.arms.state["squares"], self.arms.state["largest"]

    def _times(self, end: int) -> Array:
        """The times of the next control periods, at most to this one, in which the true parameters stay as they are."""
        ahead = np.arange(self.count, min(end, self.count + self.longest)) * self.period
        return np.asarray(ahead[: max(1, int(np.searchsorted(ahead, self.loop.plant.until(ahead[0]))))])

    def _taken(self, time: Array, *, record: bool) -> tuple[Array, ...]:
        """The control periods at these times."""
        if self.loop.plant.loads:
            self.arms.held["parameters"] = self.loop.plant.parameters(self.parameters, time[0])
        signals = {**self.references.signals(time), "noise": self._noise(len(time), self.arms.members)}
        return self.arms.run(len(time), signals, record=record, threads=self.threads)

    def _noise(self, steps: int, members: int) -> Array:
        return self.rng.standard_normal((steps, members, self.loop.noise["noise"]))

    def _samples(self, count: int) -> int:
        """How many of so many control periods are kept."""
        return -(-count // self.every)

    def result(self, wall_time: float, complete: bool) -> Rollouts:
        """The runs so far."""
        count, squares, largest = self._done
        samples = self._samples(count)
        parts = (frozen(kept[:samples]) for kept in self.records)
        columns = dict(zip(RECORDED, parts, strict=True))
        return Rollouts(
            **columns,
            time=frozen(np.asarray(np.arange(0, samples * self.every, self.every) * self.period)),
            parameters=frozen(self.parameters.copy()),
            rms_error=frozen(np.asarray(np.sqrt(squares / max(count, 1)))),
            largest_error=frozen(largest),
            control_period=self.period,
            wall_time=wall_time,
            complete=complete,
        )


def _require_compilable(loop: ClosedLoop) -> None:
    if (links := len(loop.plant.mechanism.links)) > LARGEST_COMPILED:
        raise InputError(
            f"simulate_many: {links} links are too many to compile, at most {LARGEST_COMPILED} are not: use `rollout` "
            "for one run after the other"
        )
    if loop.controller.reference_size != loop.controller.dof:
        raise InputError("simulate_many: expected a controller whose reference is one of joints")
    if type(loop.controller).step is not Controller.step:
        raise InputError(
            f"simulate_many: {type(loop.controller).__name__} has a step of its own, and only a law is compiled: use "
            "`rollout` for one run after the other"
        )


def _require_count(name: str, number: Any) -> None:
    if not isinstance(number, int | np.integer) or number < 1:
        raise InputError(f"{name}: expected a whole number of at least 1, got {number!r}")


def _members(given: int | None, rows: Mapping[str, tuple[int, ...]]) -> int:
    """How many arms there are: what is given, and what has a row each, must agree."""
    told = {name: axes for name, axes in rows.items() if axes} | ({} if given is None else {"members": (given,)})
    if any(len(axes) > 1 for axes in told.values()) or len(set(told.values())) > 1:
        counts = ", ".join(f"{name} {'×'.join(map(str, axes))}" for name, axes in told.items())
        raise InputError(f"members: expected a row for each arm, as many everywhere, got {counts}")
    return next((axes[0] for axes in told.values()), 1)
