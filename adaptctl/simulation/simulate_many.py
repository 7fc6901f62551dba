"""Batches of closed loops in SIMD lanes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import MAX_DURATION, Array, checked, frozen, per_joint, positive_number, whole_count
from adaptctl.caching import sent_as_made
from adaptctl.compilation import Ensemble, Stepper, compile_step
from adaptctl.compilation.lanes import Precision
from adaptctl.compilation.stepper import Source
from adaptctl.control.controller import GAINS, Controller, Reference
from adaptctl.control.pytree import leaves, like
from adaptctl.control.safety_filter import SafetyFilter
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation.closed_loop import ClosedLoop, Driven, not_compiled
from adaptctl.simulation.members import (
    Noise,
    Seeds,
    arms_of,
    checked_seeds,
    differing,
    gains_of,
    joined_gains,
    validate_single,
)
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.reference_limits import warn_of_limits
from adaptctl.simulation.references import REFERENCE, ReferenceForm, ReferencesOfMany, SignalsAhead, warn_of_derivatives
from adaptctl.simulation.summaries import (
    FINAL_WINDOW,
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

BATCH, MAX_STRETCH, MAX_CALL_BYTES = 512, 2000, 2**23
"""arms, control periods and bytes of one native call, so that its data fit the caches"""
RECORDED = ("p", "v", "reference_p", "reference_v", "torque", "applied", "estimate")


@sent_as_made
@dataclass(frozen=True, eq=False)
class Rollouts:
    r"""
    Record of M closed-loop runs of r joints: T samples each, and error summaries.

    Parameters
    ----------
    time : ndarray
        Times (T,) of the samples in s.
    p, v : ndarray
        Positions in rad (m if prismatic) and velocities in rad/s (m/s), (T, M, r).
    reference_p, reference_v : ndarray
        The reference's positions in rad (m) and velocities in rad/s (m/s), (T, M, r).
    torque : ndarray
        Commanded torques (T, M, r) in N m (N).
    applied : ndarray
        Torques at the joints (T, M, r) in N m (N).
    estimate : ndarray
        Parameter estimates (T, M, k) in SI units; k = 0 for a controller without.
    parameters : ndarray
        True inertial and friction parameters (M, P) without loads, SI units, ordered as `Mechanism.parameter_names`.
    rms_error : ndarray
        Root mean square errors (M, r) in rad (m); NaN in a run that diverged without a finite `divergence_bound`.
    largest_error : ndarray
        Largest magnitudes of the errors (M, r) in rad (m), NaN likewise.
    final_rms_error : ndarray
        Root mean square errors (M, r) in rad (m) over the last 2 s; NaN in shorter runs and those that diverged before.
    settling_time : ndarray
        Times (M,) in s after which every error stayed within `tolerance`; NaN if the last one did not.
    diverged_at : ndarray
        Times (M,) in s at which an error was first not finite or above `divergence_bound`; NaN if none was.
    diverged_joint : ndarray of int
        Indices (M,) of the joint that diverged first, -1 if none did.
    lyapunov_rise : ndarray
        Largest rises (M,) of V from one control period to the next in J; NaN where V is not known: in single precision,
        for other controllers, and with loads or elastic joints.
    control_period : float
        Control period in s.
    wall_time : float
        Computing time in s.
    complete : bool
        False after Ctrl-C.

    Notes
    -----
    Sample k has the states at ``time[k]`` and the torques commanded there; summaries are of all control periods. Arrays
    are read-only and unchecked.

    The Lyapunov function is

    .. math::

        V = \tfrac12 s^T M s + \tfrac12 \tilde\theta^T \Gamma^{-1} \tilde\theta,
        \quad s = v - v_d + \Lambda (p - p_d),

    with the mass matrix M, the estimation error :math:`\tilde\theta`, the gain :math:`\Gamma` and the bandwidth
    :math:`\Lambda`; adaptation laws may have another second term.

    Examples
    --------
    >>> runs = adaptctl.simulate_many(plant, law, reference, duration=0.05, batch_size=3)
    >>> runs
    <Rollouts: 3 runs of 2 joints, 50 samples each>
    >>> runs.p.shape, runs.rms_error.shape
    ((50, 3, 2), (3, 2))
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

    def __repr__(self) -> str:
        runs, joints = self.rms_error.shape
        return f"<Rollouts: {runs} runs of {joints} joints, {len(self.time)} samples each>"

    @property
    def error(self) -> Array:
        """Tracking errors p - p_d (T, M, r) in rad (m if prismatic)."""
        return self.p - self.reference_p

    @property
    def finite(self) -> Array:
        """Mask (M,) of the runs whose `largest_error` is finite."""
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
    """
    Simulate M closed loops at once in native code.

    Arguments with M rows, such as parameters or gains, differ between runs.

    Parameters
    ----------
    plant : Plant
        Robot with r joints and up to 100 links.
    controller : Controller or sequence of Controller
        One for all runs, or M that differ in their `numbers` (gains) alone.
    reference : Reference or sequence of Reference
        One for all runs or M. Sums of equally many sinusoids (`Sinusoids`) are computed natively; others are sampled.
    duration : float
        Length of every run in s.
    batch_size : int, optional
        Number M of runs. Default: the rows of the other arguments, else 1.
    parameters : array_like, optional
        True inertial and friction parameters (P,) or (M, P), SI units, ordered as `Mechanism.parameter_names`. Default:
        the mechanism's.
    p, v : array_like, optional
        Initial positions in rad (m if prismatic) and velocities in rad/s (m/s), (r,) or (M, r). Default: on the
        reference.
    memory : object, optional
        Initial internal state of the controllers, for one run or for M. Default: that of `controller.init`.
    gains : mapping, optional
        Numbers of the controller by their names in `controller.numbers`, in their shapes or with a leading axis of M.
        Default: the controller's.
    seed : int or sequence of int, optional
        Seed of the sensors' noise, one for all or M; with M a run's noise does not depend on the others. Default: new
        noise each time.
    record_every : int or None, default 1
        Control periods from one sample to the next; None records no samples.
    tolerance : array_like, default infinity
        Bound of the errors for `settling_time` in rad (m), one number or (r,).
    divergence_bound : array_like, default infinity
        Error in rad (m), one number or (r,), above which a run counts as diverged.
    threads : int, default 1
        Threads that share the runs. One by default, as more pay only from milliseconds on.
    progress : callable, optional
        Called with the fraction done, 0 to 1.
    precision : {"double", "single"}, default "double"
        Single precision fits twice as many runs in a register; `lyapunov_rise` is then NaN, lost in round-off.

    Returns
    -------
    Rollouts
        Samples and summaries; after Ctrl-C what was computed, with `complete` False. Nothing else ends a run early.

    Raises
    ------
    InputError
        If a number is out of range, shapes or numbers of rows do not fit, controllers differ in more than numbers, or
        the case cannot be compiled or needs double precision.
    NonFiniteError
        If `parameters`, `p`, `v` or a bound is NaN, or one of the first three is infinite.
    NotFoundError
        If `gains` has an unknown name.
    SingularityError
        If kinematic loops cannot be followed to p.

    Examples
    --------
    >>> masses = np.array([0.9, 1.0, 1.1])[:, None] * arm.inertial_parameters
    >>> runs = adaptctl.simulate_many(plant, law, reference, duration=0.05, parameters=masses)
    >>> bool(runs.finite.all())
    True
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
    """Compiled control period of arms in lanes, with error sums."""
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
    """Runs advanced together."""

    members: slice
    arms: Ensemble
    signals: SignalsAhead
    noise: Noise


class _Runs(Driven):
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
        if positive_number(duration, what, most=MAX_DURATION) < self.control_period:
            raise InputError(f"{what}, got {duration}")
        for name, number in (("record_every", 1 if every is None else every), ("threads", threads)):
            whole_count(number, name, 1)
        _validate_compilable(loop)
        self.steps, self.every = round(duration / self.control_period), every
        if precision == "single":
            validate_single(loop, self.steps)
        self.references = ReferencesOfMany.of(reference, loop.controller.reference_size)
        self.final = max(0, self.steps - round(FINAL_WINDOW / self.control_period))
        first = reference[0] if isinstance(reference, Sequence) else reference
        joints = loop.plant.mechanism.primary_joints
        warn_of_derivatives(first, [joint.name for joint in joints], duration)
        if _is_in_joints(loop.controller):
            warn_of_limits(first, joints, duration)

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
            signals = SignalsAhead(self.references.of_arms(arms), self.control_period, self.steps)
            batch = _Batch(arms, stepper.ensemble(noise.members), signals, noise)
            chosen = {name: x[arms] for name, x in gains.items()}
            self._start(batch, p[arms], v[arms], _of_arms(memory, arms), chosen, bounds)
            self.batches.append(batch)
        self.records = tuple(np.empty((self._samples(self.steps), count, *shape)) for shape in stepper.outputs)
        self.longest = self._longest(stepper)
        self._done = 0, self._sums(), self._rises()

    def _start(
        self, batch: _Batch, p: Array, v: Array, memory: Any, gains: dict[str, Array], bounds: Mapping[str, Array]
    ) -> None:
        loop, arms, own = self.loop, batch.arms, self.parameters[batch.members]
        state = loop.plant.init(p, v, loop.plant.parameters(own, 0.0), batch.noise.drawn(1)[0])
        new = loop.controller.init(state.measured_p, state.measured_v, gains) if memory is None else memory
        loop.set_state(arms, state, new)
        rise, true = first_rise(watched(loop, self.precision), own, gains)
        largest = float(np.finfo(arms.stepper.dtype).max)
        held: dict[str, Any] = {"parameters": own, **batch.signals.references.held, "final": float(self.final), **true}
        held |= {name: np.minimum(bound, largest) for name, bound in bounds.items()}
        if gains:
            held[GAINS] = joined_gains(gains)
        for columns, values in ((arms.state, rise), (arms.held, held)):
            for name, each in values.items():
                columns[name] = each

    def _longest(self, stepper: Stepper) -> int:
        """Most control periods per native call."""
        numbers = sum(stepper.columns[Source.DRIVEN].values())
        numbers += sum(map(math.prod, stepper.outputs)) if self.every == 1 else 0
        return max(1, min(MAX_STRETCH, MAX_CALL_BYTES // (8 * min(BATCH, len(self.parameters)) * max(1, numbers))))

    def _remembered(self, memory: Any) -> list[Any]:
        own = [(size,) for name, size in self.loop.state.items() if name.startswith("memory")]
        parts = leaves(memory) if isinstance(memory, tuple) else [memory]
        sizes = [np.shape(part)[-1:] for part in parts]
        if sizes != own:
            kind = type(self.loop.controller).__name__
            raise InputError(f"memory: expected the result of {kind}.init, with last axes {own}, got {sizes}")
        return parts

    def advance(self) -> None:
        """Compute a chunk, at most up to the next sample."""
        first, every, plant = self.count, self.every, self.loop.plant
        end = min(first + -first % every + 1, self.steps) if every and every > 1 else self.steps
        time = self.ahead(min(end - first, self.longest))
        kept = slice(self._samples(first), self._samples(first + len(time)))
        for members, arms, ahead, noise in self.batches:
            if plant.loads:
                arms.held["parameters"] = plant.parameters(self.parameters[members], time[0])
            signals = {**ahead.part(first, len(time)), "noise": noise.drawn(len(time))}
            outputs = arms.run(len(time), signals, record=every == 1, threads=self.threads)
            for record, part in zip(self.records if every is not None else (), outputs, strict=False):
                record[kept, members] = part
        self._done = first + len(time), self._sums(), self._rises()

    def _sums(self) -> ErrorSums:
        parts = (np.concatenate([batch.arms.state[name] for batch in self.batches]) for name in ErrorSums._fields)
        return ErrorSums(*parts)

    def _rises(self) -> Array:
        rises = np.concatenate([batch.arms.state["lyapunov_rise"] for batch in self.batches])
        return np.asarray(rises[:, 0]) if rises.shape[1] else np.full(len(rises), np.nan)

    def _samples(self, count: int) -> int:
        return 0 if self.every is None else -(-count // self.every)

    def result(self, wall_time: float, complete: bool) -> Rollouts:
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
    """Memory of some of the arms, or None."""
    if memory is None:
        return None
    return like(memory, (part[arms] if np.ndim(part) > 1 else part for part in leaves(memory)))


def _given(values: ArrayLike | None, own: Array) -> ArrayLike:
    return own if values is None else values


def _is_in_joints(controller: Controller[Any]) -> bool:
    """True where a reference point gives positions of joints, not of a point in space."""
    while isinstance(controller, SafetyFilter):
        controller = controller.inner
    return bool(getattr(controller, "reference_in_joints", True))


def _validate_compilable(loop: ClosedLoop) -> None:
    if reason := not_compiled(loop.plant, loop.controller):
        raise InputError(f"simulate_many: {reason}: use `rollout` for one run after the other")
    if loop.controller.reference_size != loop.controller.dof:
        raise InputError("simulate_many: expected a controller with a joint-space reference")


def _members(given: int | None, rows: Mapping[str, tuple[int, ...]]) -> int:
    """Checked number of arms."""
    named_rows = {name: axes for name, axes in rows.items() if axes} | (
        {} if given is None else {"batch_size": (given,)}
    )
    if any(len(axes) > 1 for axes in named_rows.values()) or len(set(named_rows.values())) > 1:
        counts = ", ".join(f"{name} {'×'.join(map(str, axes))}" for name, axes in named_rows.items())
        raise InputError(f"members: expected one row per arm in all arguments, got {counts}")
    return next((axes[0] for axes in named_rows.values()), 1)
