"""Many closed loops of one kind at once, in SIMD lanes: for Monte Carlo studies, sweeps and tolerances."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, checked, frozen, per_joint, positive_number, whole_count
from adaptctl.caching import sent_as_made
from adaptctl.compilation import Stepper, compile_step
from adaptctl.compilation.lanes import Precision
from adaptctl.control.controller import Controller, Reference
from adaptctl.control.memory import leaves, like
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation.closed_loop import ClosedLoop, Driven, not_compiled
from adaptctl.simulation.herd import GainsOfMany, Herd, Noise, checked_seeds, require_single
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.references import REFERENCE, ReferenceForm, ReferencesOfMany, warn_of_derivatives
from adaptctl.simulation.summaries import (
    SETTLED,
    ErrorSums,
    judged_by,
    rise_sizes,
    risen,
    sum_sizes,
    summary,
    summed,
    truth_sizes,
    watched,
)

HERD = 512
"""Arms that take a stretch of time together, one herd after the other: what they read and write fits the caches."""
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
    return_time: Array
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
    members: int | None = None,
    parameters: ArrayLike | None = None,
    p: ArrayLike | None = None,
    v: ArrayLike | None = None,
    memory: Any = None,
    gains: Mapping[str, ArrayLike] | None = None,
    seed: int | Sequence[int] | None = None,
    every: int | None = 1,
    within: ArrayLike = np.inf,
    beyond: ArrayLike = np.inf,
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
    reference or a `step` of its own, in single precision a case that needs double (`require_single`), and for more than
    LARGEST_COMPILED (100) links; `NonFiniteError` for NaN or infinity in `parameters`, `p` or `v` and NaN in a bound,
    `NotFoundError` for an unknown name in `gains` and what a new controller raises for theirs, and `SingularityError`
    where loops cannot be followed to `p`.
    """
    tuned = GainsOfMany.of(controller, gains or {})
    run = _Runs(ClosedLoop(plant, tuned.controller), reference, duration, every, threads, precision)
    bounds = {"within": per_joint(within, plant.dof, "within"), "beyond": per_joint(beyond, plant.dof, "beyond")}
    run.begin(members, seed, memory, tuned, bounds, parameters=parameters, p=p, v=v)
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
        held=loop.held | form.held | judged_by(r) | truth_sizes(law),
        shared=form.shared,
        driven=form.driven | loop.noise,
        name=type(loop.controller).__name__,
        precision=precision,
    )


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
        self.loop, self.period, self.threads, self.precision = loop, loop.plant.control_period, threads, precision
        what = f"duration: expected at least a control period of {self.period:g} s"
        if positive_number(duration, what) < self.period:
            raise InputError(f"{what}, got {duration}")
        for name, number in (("every", 1 if every is None else every), ("threads", threads)):
            whole_count(number, name, 1)
        _require_compilable(loop)
        self.steps, self.every = round(duration / self.period), every
        if precision == "single":
            require_single(loop, self.steps)
        self.references = ReferencesOfMany.of(reference, loop.controller.reference_size)
        self.final = max(0, self.steps - round(SETTLED / self.period))
        first = reference[0] if isinstance(reference, Sequence) else reference
        warn_of_derivatives(first, [joint.name for joint in loop.plant.mechanism.primary_joints], duration, 4)

    @property
    def count(self) -> int:
        """Control periods done."""
        return self._done[0]

    def begin(
        self,
        members: int | None,
        seed: int | Sequence[int] | None,
        memory: Any,
        tuned: GainsOfMany,
        bounds: Mapping[str, Array],
        **given: ArrayLike | None,
    ) -> None:
        """Put every arm where it starts: at `parameters`, `p` and `v`, those of the mechanism and on the reference
        unless given."""
        loop, start = self.loop, self.references.start()
        own = {"parameters": loop.plant.mechanism.inertial_parameters, "p": start[0], "v": start[1]}
        chosen = own | {name: x for name, x in given.items() if x is not None}
        rows = {name: checked(x, own[name].shape[-1], name) for name, x in chosen.items()}
        if members is not None:
            whole_count(members, "members", 1)
        remembered = [] if memory is None else self._remembered(memory)
        seeds = checked_seeds(seed)
        seeded = {"seed": seeds.shape} if isinstance(seeds, np.ndarray) else {}
        named_rows = rows | {f"memory {k}": np.asarray(part) for k, part in enumerate(remembered)}
        axes = {k: x.shape[:-1] for k, x in named_rows.items()} | tuned.arms | seeded
        count = _members(members, {"reference": self.references.arms} | axes)
        self.parameters, p, v = (np.broadcast_to(x, (count, x.shape[-1])) for x in rows.values())
        self.beyond = bounds["beyond"]
        noise = Noise.of(seeds, count, HERD, loop.noise["noise"])
        self.herds, stepper = [], _compiled(loop, self.references.form, self.precision)
        for k, first in enumerate(range(0, count, HERD)):
            arms = slice(first, min(first + HERD, count))
            herd = Herd(loop, stepper, self.references.of_arms(arms), self.parameters[arms], noise[k], arms)
            own_memory = memory if memory is None else _of_arms(memory, arms)
            herd.begin(p[arms], v[arms], own_memory, tuned, bounds, self.final)
            self.herds.append(herd)
        shapes = self.herds[0].arms.stepper.outputs
        self.records = tuple(np.empty((self._samples(self.steps), count, *shape)) for shape in shapes)
        self._done = 0, self._sums(), self._rises()

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
        first, every = self.count, self.every
        end = self.steps if every in (None, 1) else min(first + -first % (every or 1) + 1, self.steps)
        time = self.ahead(min(end - first, *(herd.longest(record=every == 1) for herd in self.herds)))
        last = first + len(time)
        kept = slice(self._samples(first), self._samples(last))
        for herd in self.herds:
            outputs = herd.taken(time, record=every == 1, threads=self.threads)
            for record, part in zip(self.records if every is not None else (), outputs, strict=False):
                record[kept, herd.members] = part
        self._done = last, self._sums(), self._rises()

    def _sums(self) -> ErrorSums:
        """Sums of errors of all arms so far."""
        parts = [[herd.arms.state[name] for name in ErrorSums._fields] for herd in self.herds]
        return ErrorSums(*(np.concatenate(part) for part in zip(*parts, strict=True)))

    def _rises(self) -> Array:
        """The largest rises of V so far (M,)."""
        parts = [np.asarray(herd.arms.state["lyapunov_rise"]) for herd in self.herds]
        return np.concatenate([part[:, 0] if part.shape[1] else np.full(len(part), np.nan) for part in parts])

    def _samples(self, count: int) -> int:
        """Number of samples kept of `count` control periods."""
        return 0 if self.every is None else -(-count // self.every)

    def result(self, wall_time: float, complete: bool) -> Rollouts:
        """The runs so far."""
        count, sums, rises = self._done
        samples = self._samples(count)
        parts = (frozen(kept[:samples]) for kept in self.records)
        summaries = summary(sums, count, min(self.final, count), self.period, self.beyond)
        columns: dict[str, Any] = {name: frozen(values) for name, values in summaries._asdict().items()}
        columns |= zip(RECORDED, parts, strict=True)
        return Rollouts(
            **columns,
            lyapunov_rise=frozen(rises),
            time=frozen(np.asarray(np.arange(samples) * (self.every or 1) * self.period)),
            parameters=frozen(self.parameters.copy()),
            control_period=self.period,
            wall_time=wall_time,
            complete=complete,
        )


def _of_arms(memory: Any, arms: slice) -> Any:
    """The memory of some of the arms, where there is one for each."""
    return like(memory, (part[arms] if np.ndim(part) > 1 else part for part in leaves(memory)))


def _require_compilable(loop: ClosedLoop) -> None:
    if reason := not_compiled(loop.plant, loop.controller):
        raise InputError(f"simulate_many: {reason}: use `rollout` for one run after the other")
    if loop.controller.reference_size != loop.controller.dof:
        raise InputError("simulate_many: expected a controller whose reference is one of joints")


def _members(given: int | None, rows: Mapping[str, tuple[int, ...]]) -> int:
    """Number of arms: as given, or as the arguments that have a row each say. Raises `InputError` where they
    disagree."""
    named_rows = {name: axes for name, axes in rows.items() if axes} | ({} if given is None else {"members": (given,)})
    if any(len(axes) > 1 for axes in named_rows.values()) or len(set(named_rows.values())) > 1:
        counts = ", ".join(f"{name} {'×'.join(map(str, axes))}" for name, axes in named_rows.items())
        raise InputError(f"members: expected a row for each arm, as many everywhere, got {counts}")
    return next((axes[0] for axes in named_rows.values()), 1)
