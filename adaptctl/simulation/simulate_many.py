"""Many closed loops of one kind at once, in SIMD lanes: for Monte Carlo studies, sweeps and tolerances."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, checked, frozen, per_joint, positive_number, whole_count
from adaptctl.caching import sent_as_made
from adaptctl.compilation import Ensemble, Stepper, compile_step
from adaptctl.compilation.lanes import Precision
from adaptctl.compilation.stepper import Source
from adaptctl.control.controller import GAINS, Controller, Reference
from adaptctl.control.pytree import leaves, like
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation.closed_loop import ClosedLoop, Driven, not_compiled
from adaptctl.simulation.members import Noise, Seeds, arms_of, checked_seeds, differing, gains_of, validate_single
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.references import REFERENCE, ReferenceForm, ReferencesOfMany, warn_of_derivatives
from adaptctl.simulation.summaries import (
    SETTLED,
    ErrorSums,
    first_rise,
    judged_by,
    rise_sizes,
    risen,
    sum_sizes,
    summary,
    summed,
    truth_sizes,
    watched,
)

BATCH, STRETCH, MEMORY = 512, 2000, 2**23
"""Arms and control periods, at most, and bytes that one native call reads and writes, so that these fit the caches: one
batch of arms takes a stretch of time after the other. In between progress is reported, and Ctrl-C handled."""
RECORDED = ("p", "v", "reference_p", "reference_v", "torque", "applied", "estimate")


@sent_as_made
@dataclass(frozen=True, eq=False)
class Rollouts:
    """Many closed-loop runs (M) of r joints, as T samples each and summaries of tracking errors, p - reference_p; every
    array is read-only. Nothing is checked at construction.

    Sample k has the states at `time[k]` and the torques commanded on them. The errors are of all control periods until
    a run diverged, whether or not they are sampled. Runs are independent: NaN in one does not touch the others.

    `time` (T,), s. (T, M, r): positions `p` and `reference_p`, rad (m if prismatic), velocities `v` and `reference_v`,
    rad/s (m/s), `torque`, the one commanded, and `applied`, the one at the joints, N m (N). `estimate` (T, M, k), the
    controllers' k parameter estimates, k = 0 where they have none; `parameters` (M, P), the P true inertial and
    friction parameters without the effects' loads, in the order of `Mechanism.parameter_names`; both in SI units.

    (M, r), rad (m): `rms_error`, root mean square, `largest_error`, largest magnitude, and `final_rms_error`, root mean
    square over the last SETTLED (2) s, NaN in shorter runs and those that diverged before; the first two are NaN in a
    run that diverged where no bound for divergence was asked for. (M,): `return_time`, s, after which every error
    stayed within the bounds asked for, NaN where the last one did not or the run diverged; `diverged_at`, s, at which
    an error was first not finite or beyond the bound for divergence, NaN where none was, and `diverged_joint`, the
    index from 0 of the first joint whose error was, else -1.

    `lyapunov_rise` (M,), J, is the largest rise from one control period to the next of Slotine and Li's Lyapunov
    function V = s^T H s/2 + e^T Gamma^-1 e/2, 0 where it never rose. s = v - v_d + Lambda (p - p_d) is the sliding
    variable, p_d and v_d the reference, Lambda the bandwidth, H the mass matrix, e the estimate minus the true
    parameters, Gamma the adaptation gain, T the transpose; an adaptation law may have a second term of its own. It is
    NaN where V is not known: in single precision, for other controllers, and with loads or elastic joints.

    `control_period`, s; `wall_time`, s, that the runs took; `complete`, False if they were interrupted.
    """

    time: Array
    p: Array
    v: Array
    reference_p: Array
    reference_v: Array
    torque: Array
    applied: Array
    estimate: Array
    parameters: Array
    rms_error: Array
    largest_error: Array
    final_rms_error: Array
    settling_time: Array
    diverged_at: Array
    diverged_joint: NDArray[np.int64]
    lyapunov_rise: Array
    control_period: float
    wall_time: float
    complete: bool

    @property
    def error(self) -> Array:
        """Tracking errors p - p_d (T, M, r), rad or m: the positions of T samples of M runs of r joints minus the
        reference's."""
        return self.p - self.reference_p

    @property
    def finite(self) -> Array:
        """Mask (M,) of bools, True for each of M runs whose field `largest_error` is finite. They are the runs that did
        not diverge and, if any bound `beyond` (rad or m) given to `simulate_many` was finite, those that did too, as
        their largest error is of the time before. The field `diverged_at` (M,), s, distinguishes these: it is NaN for a
        run that did not diverge."""
        return np.asarray(np.isfinite(self.largest_error).all(axis=-1))


def simulate_many(
    plant: Plant,
    controller: Controller[Any] | Sequence[Controller[Any]],
    reference: Reference | Sequence[Reference],
    *,
    duration: float,
    batch_size: int | None = None,
    parameters: ArrayLike | None = None,
    p: ArrayLike | None = None,
    v: ArrayLike | None = None,
    memory: Any = None,
    gains: Mapping[str, ArrayLike] | None = None,
    seed: int | Sequence[int] | None = None,
    record_every: int | None = 1,
    tolerance: ArrayLike = np.inf,
    divergence_bound: ArrayLike = np.inf,
    threads: int = 1,
    progress: Callable[[float], object] | None = None,
    precision: Precision = "double",
) -> Rollouts:
    """Closed-loop runs, a `Rollouts`, of a controller on a plant of r joints: M at once, of `duration` (s) each. They
    differ in the arguments that are given with one row for each run.

    `controller` is one for all runs or a sequence of M, which may differ in their `numbers`, such as gains, alone;
    `reference` is one for all or a sequence of M; `Sinusoids` with equal numbers of terms are not stored as samples.
    `parameters` (P,) or (M, P), SI units, are the P true inertial and friction ones, in the order of
    `Mechanism.parameter_names`, the mechanism's own when not given; `p`, rad (m if prismatic), and `v`, rad/s (m/s),
    (r,) or (M, r), are where the arms start, on their references when not given; `memory` is the controllers' initial
    internal state, such as estimates, in the form in which `controller.init` gives it for one arm or for M, which is
    taken when it is not given; `members` is M, needed where nothing else has M rows, else 1. `gains` are numbers of the
    controller by their names in `controller.numbers`, of the shapes there or with a leading axis of M, the controller's
    own when not given. `seed` is that of the sensors' noise, one for all or M: with one each, an arm's noise does not
    depend on who else runs; None draws another noise each time.

    Every `every`-th control period is recorded as a sample, the first one included; None records no samples. Summaries
    of the errors are of all control periods. `within` (rad or m, a number or (r,), infinite unless given) bounds the
    errors for `return_time`; a run counts as diverged once an error is not finite or larger than `beyond` (rad or m, a
    number or (r,), infinite unless given). `threads` is the number of threads. `precision` is "double" or "single": in
    single precision twice as many arms fit a register, but `lyapunov_rise` is NaN, since round-off would hide it.
    `progress`, if given, is called in between with the fraction done, 0 to 1, and Ctrl-C keeps what was computed.
    Nothing ends a run early.

    Raises `InputError` for a duration that is below a control period or infinite, an `every`, `threads` or `members`
    that is not a whole number of at least 1, a `seed` that is not one of at least 0, shapes that do not fit and unlike
    numbers of rows, controllers that differ in more than numbers or come with `gains`, a controller with a task-space
    reference or a `step` of its own, in single precision a case that needs double (`validate_single`), and for more
    than 100 links; `NonFiniteError` for NaN or infinity in `parameters`, `p` or `v` and NaN in a
    bound, `NotFoundError` for an unknown name in `gains` and what a new controller raises for theirs, and
    `SingularityError` where loops cannot be followed to `p`.
    """
    law, differ = differing(controller, gains or {})
    run = _Runs(ClosedLoop(plant, law), reference, duration, record_every, threads, precision)
    bounds = {
        "within": per_joint(tolerance, plant.dof, "tolerance"),
        "beyond": per_joint(divergence_bound, plant.dof, "divergence_bound"),
    }
    run.begin(batch_size, checked_seeds(seed), memory, differ, bounds, {"parameters": parameters, "p": p, "v": v})
    return run.result(*run.drive(progress))


@lru_cache(maxsize=8)
def _compiled(loop: ClosedLoop, form: ReferenceForm, precision: Precision) -> Stepper:
    """A control period of arms in lanes, with the errors summed up."""
    law = watched(loop, precision)

    def step(clock: Column, **columns: Column) -> tuple[Any, ...]:
        point = form.point(columns)
        passed_on, sample = loop.equation(**columns | dict(zip(REFERENCE, point, strict=True)))
        p = loop.plant.primary(sample.q)
        sums = summed(clock[0], p - point.p, columns)
        rise = risen(loop, sample, point, sums.joint[0] < 0.5, columns)
        done = sample.torque, sample.applied, sample.estimate
        return (*passed_on, Column((clock[0] + 1.0,)), *sums, *rise, p, sample.v, point.p, point.v, *done)

    r = loop.controller.dof
    return compile_step(
        step,
        state=loop.state | {"clock": 1} | sum_sizes(r) | rise_sizes(law),
        constants=loop.held | form.held | judged_by(r) | truth_sizes(law),
        inputs=form.shared,
        per_member_inputs=form.driven | loop.noise,
        name=type(loop.controller).__name__,
        precision=precision,
    )


class _Batch(NamedTuple):
    """Arms that take a stretch of time together: which of all they are, the native code's copies of them, their
    references and the source of their noise."""

    members: slice
    arms: Ensemble
    references: ReferencesOfMany
    noise: Noise


class _Runs(Driven):
    """Runs in the making."""

    def __init__(
        self,
        loop: ClosedLoop,
        reference: Reference | Sequence[Reference],
        duration: float,
        every: int | None,
        threads: int,
        precision: Precision,
    ) -> None:
        self.loop, self.control_period, self.threads, self.precision = (
            loop,
            loop.plant.control_period,
            threads,
            precision,
        )
        what = f"duration: expected at least a control period of {self.control_period:g} s"
        if positive_number(duration, what) < self.control_period:
            raise InputError(f"{what}, got {duration}")
        for name, number in (("record_every", 1 if every is None else every), ("threads", threads)):
            whole_count(number, name, 1)
        _validate_compilable(loop)
        self.steps, self.every = round(duration / self.control_period), every
        if precision == "single":
            validate_single(loop, self.steps)
        self.references = ReferencesOfMany.of(reference, loop.controller.reference_size)
        self.final = max(0, self.steps - round(SETTLED / self.control_period))
        first = reference[0] if isinstance(reference, Sequence) else reference
        warn_of_derivatives(first, [joint.name for joint in loop.plant.mechanism.primary_joints], duration, 4)

    @property
    def count(self) -> int:
        """Control periods done."""
        return self._done[0]

    def begin(
        self,
        members: int | None,
        seeds: Seeds,
        memory: Any,
        differ: Mapping[str, Array],
        bounds: Mapping[str, Array],
        given: Mapping[str, ArrayLike | None],
    ) -> None:
        """Put every arm where it starts: at `parameters`, `p` and `v`, those of the mechanism and on the reference
        unless given."""
        loop, start = self.loop, self.references.start()
        own = {"parameters": loop.plant.mechanism.inertial_parameters, "p": start[0], "v": start[1]}
        rows = {name: checked(_given(given[name], x), x.shape[-1], name) for name, x in own.items()}
        if members is not None:
            whole_count(members, "batch_size", 1)
        remembered = [] if memory is None else self._remembered(memory)
        axes = {"reference": self.references.arms} | {name: x.shape[:-1] for name, x in rows.items()}
        axes |= {f"memory {k}": np.shape(part)[:-1] for k, part in enumerate(remembered)}
        axes |= {f"gains {name}": arms for name, arms in arms_of(loop.controller, differ).items()}
        count = _members(members, axes | {"seed": np.shape(seeds) if isinstance(seeds, np.ndarray) else ()})
        self.parameters, p, v = (np.broadcast_to(x, (count, x.shape[-1])) for x in rows.values())
        self.beyond, gains = bounds["beyond"], gains_of(loop.controller, differ, count)
        stepper = _compiled(loop, self.references.form, self.precision)
        self.batches, sources = [], Noise.of(seeds, count, BATCH, loop.noise["noise"])
        for first, noise in zip(range(0, count, BATCH), sources, strict=True):
            arms = slice(first, first + noise.members)
            batch = _Batch(arms, stepper.ensemble(noise.members), self.references.of_arms(arms), noise)
            chosen = {name: x[arms] for name, x in gains.items()}
            self._start(batch, p[arms], v[arms], _of_arms(memory, arms), chosen, bounds)
            self.batches.append(batch)
        self.records = tuple(np.empty((self._samples(self.steps), count, *shape)) for shape in stepper.outputs)
        self.longest = self._longest(stepper)
        self._done = 0, self._sums(), self._rises()

    def _start(
        self, batch: _Batch, p: Array, v: Array, memory: Any, gains: dict[str, Array], bounds: Mapping[str, Array]
    ) -> None:
        """Put a batch at time zero, with a new memory if it has none."""
        loop, arms, own = self.loop, batch.arms, self.parameters[batch.members]
        state = loop.plant.init(p, v, loop.plant.parameters(own, 0.0), batch.noise.drawn(1)[0])
        new = loop.controller.init(state.measured_p, state.measured_v, gains) if memory is None else memory
        loop.begin(arms, state, new)
        rise, true = first_rise(watched(loop, self.precision), own, gains)
        largest = float(np.finfo(arms.stepper.dtype).max)
        held: dict[str, Any] = {"parameters": own, **batch.references.held, "final": float(self.final), **true}
        held |= {name: np.minimum(bound, largest) for name, bound in bounds.items()}
        if gains:
            held[GAINS] = np.concatenate([x.reshape(len(x), -1) for x in gains.values()], axis=1)
        for columns, values in ((arms.state, rise), (arms.held, held)):
            for name, each in values.items():
                columns[name] = each

    def _longest(self, stepper: Stepper) -> int:
        """The number of control periods in one native call, at most: as many as keep what it reads and writes, besides
        the arms' states, within the caches."""
        numbers = sum(stepper.columns[Source.DRIVEN].values())
        numbers += sum(map(math.prod, stepper.outputs)) if self.every == 1 else 0
        return max(1, min(STRETCH, MEMORY // (8 * min(BATCH, len(self.parameters)) * max(1, numbers))))

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
        """A stretch of time: as far as memory allows, and where not all samples are kept, up to the next one that is.
        It counts when all arms have done it."""
        first, every, plant = self.count, self.every, self.loop.plant
        end = self.steps if every in (None, 1) else min(first + -first % (every or 1) + 1, self.steps)
        time = self.ahead(min(end - first, self.longest))
        kept = slice(self._samples(first), self._samples(first + len(time)))
        for members, arms, references, noise in self.batches:
            if plant.loads:
                arms.held["parameters"] = plant.parameters(self.parameters[members], time[0])
            signals = {**references.signals(time), "noise": noise.drawn(len(time))}
            outputs = arms.run(len(time), signals, record=every == 1, threads=self.threads)
            for record, part in zip(self.records if every is not None else (), outputs, strict=False):
                record[kept, members] = part
        self._done = first + len(time), self._sums(), self._rises()

    def _sums(self) -> ErrorSums:
        """Sums of errors of all arms so far."""
        parts = (np.concatenate([batch.arms.state[name] for batch in self.batches]) for name in ErrorSums._fields)
        return ErrorSums(*parts)

    def _rises(self) -> Array:
        """The largest rises of V so far (M,)."""
        rises = np.concatenate([batch.arms.state["lyapunov_rise"] for batch in self.batches])
        return np.asarray(rises[:, 0]) if rises.shape[1] else np.full(len(rises), np.nan)

    def _samples(self, count: int) -> int:
        """Number of samples kept of `count` control periods."""
        return 0 if self.every is None else -(-count // self.every)

    def result(self, wall_time: float, complete: bool) -> Rollouts:
        """The runs so far."""
        count, sums, rises = self._done
        samples = self._samples(count)
        parts = (frozen(kept[:samples]) for kept in self.records)
        columns: dict[str, Any] = dict(zip(RECORDED, parts, strict=True))
        return Rollouts(
            **columns,
            **summary(sums, count, min(self.final, count), self.control_period, self.beyond),
            lyapunov_rise=frozen(rises),
            time=frozen(np.asarray(np.arange(samples) * (self.every or 1) * self.control_period)),
            parameters=frozen(self.parameters.copy()),
            control_period=self.control_period,
            wall_time=wall_time,
            complete=complete,
        )


def _of_arms(memory: Any, arms: slice) -> Any:
    """The memory of some of the arms, where there is one for each; None where there is none."""
    if memory is None:
        return None
    return like(memory, (part[arms] if np.ndim(part) > 1 else part for part in leaves(memory)))


def _given(values: ArrayLike | None, own: Array) -> ArrayLike:
    return own if values is None else values


def _validate_compilable(loop: ClosedLoop) -> None:
    if reason := not_compiled(loop.plant, loop.controller):
        raise InputError(f"simulate_many: {reason}: use `rollout` for one run after the other")
    if loop.controller.reference_size != loop.controller.dof:
        raise InputError("simulate_many: expected a controller whose reference is one of joints")


def _members(given: int | None, rows: Mapping[str, tuple[int, ...]]) -> int:
    """Number of arms: as given, or as the arguments that have a row each say. Raises `InputError` where they
    disagree."""
    named_rows = {name: axes for name, axes in rows.items() if axes} | (
        {} if given is None else {"batch_size": (given,)}
    )
    if any(len(axes) > 1 for axes in named_rows.values()) or len(set(named_rows.values())) > 1:
        counts = ", ".join(f"{name} {'×'.join(map(str, axes))}" for name, axes in named_rows.items())
        raise InputError(f"members: expected a row for each arm, as many everywhere, got {counts}")
    return next((axes[0] for axes in named_rows.values()), 1)
