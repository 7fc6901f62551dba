"""Comparisons as data: runs of several controllers on one arm, one reference, one seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np

from adaptctl.arrays import Array, checked, positive_number
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit, position_units
from adaptctl.errors import InputError
from adaptctl.identifiability import EssentialSpace, FundamentalBasis, ReducedModel
from adaptctl.markup import table, titled
from adaptctl.recording.result import Failure
from adaptctl.simulation.run import Rollout

if TYPE_CHECKING:
    from adaptctl.recording.drawing import Drawing

SETTLED = 2.0
"""s at the end of a run over which its final error is taken."""
BEGINNING = 1.0
"""s at the start of a run over which its first error is taken."""
ADAPTATION_OFF = "adaptation-off"
"""name of the run of a subject's controller with adaptation off, unless a comparison says another"""
AT_LIMIT = 1.0 - 1e-9
"""of a torque's limit"""

Joints: TypeAlias = slice | list[int]
"""Joints by their indices."""
ALL = slice(None)


@dataclass(frozen=True)
class TickCost:
    """Cost of one control tick, the computation of one torque vector, in time and in operations. `called`, s, is the
    median time of a call from Python; `native`, s, the mean time of one tick within a loop over many states in native
    code; `flops`, the number of additions, subtractions, multiplications, divisions and negations. Each is None, the
    default, where it is not known. Nothing is checked at construction."""

    called: float | None = None
    native: float | None = None
    flops: int | None = None


@dataclass(frozen=True, eq=False)
class ControllerRun:
    """A closed-loop run of one controller, with its name, label and cost.

    `name` is short, fit for a file, and no other run's in a comparison; `label` is for legends and tables; `knows` is a
    text, or empty, on what the controller knew of the arm beforehand. `rollout` is the run as T samples of r joints.
    `lyapunov` (T,) are values of the Lyapunov function, J, None, the default, where the control law has none. `cost` is
    that of a control tick (the computation of one torque vector), None, the default, where it was not measured. Nothing
    is checked at construction.
    """

    name: str
    label: str
    knows: str
    rollout: Rollout
    lyapunov: Array | None = None
    cost: TickCost | None = None

    @property
    def duration(self) -> float:
        """Duration of the run in closed loop, s, from time zero to its end, rounded up to a whole sample
        (`rollout.every` control periods)."""
        return self.rollout.duration

    def rms_error(self, start: float = 0.0, stop: float = np.inf, joints: Joints = ALL) -> float | None:
        """Root mean square of the tracking errors of the run, positions less desired ones, over some joints and over
        the samples at times t with `start` <= t < `stop`, s, all of the run by default; None without such samples. It
        is in rad (m if prismatic), and mixes both where the joints are of both kinds. `joints` is a slice or a list of
        zero-based indices, all by default. Raises `IndexError` for an index without a joint, `InputError` where
        `joints` selects none."""
        inside = (self.rollout.time >= start) & (self.rollout.time < stop)
        errors = self.rollout.error[inside][:, joints]
        if errors.shape[1] == 0:
            raise InputError(f"joints: expected at least one joint, got {joints}")
        return float(np.sqrt(np.mean(errors**2))) if inside.any() else None

    @property
    def first_rms_error(self) -> float | None:
        """Root mean square tracking error of the run over all joints and over its first second, in rad (m if
        prismatic), mixed where joints are of both kinds; None where the run is shorter."""
        return self.first_rms_error_of(ALL)

    @property
    def final_rms_error(self) -> float | None:
        """Root mean square tracking error of the run over all joints and over its last two seconds, in rad (m if
        prismatic), mixed where joints are of both kinds; None where the run is shorter."""
        return self.final_rms_error_of(ALL)

    def first_rms_error_of(self, joints: Joints) -> float | None:
        """Root mean square tracking error of the run over some `joints`, a slice or a list of zero-based indices, and
        over its first second, in rad (m if prismatic); None where the run is shorter. Raises `IndexError` for an index
        without a joint, `InputError` where `joints` selects none."""
        return self.rms_error(stop=BEGINNING, joints=joints) if self._lasts(BEGINNING) else None

    def final_rms_error_of(self, joints: Joints) -> float | None:
        """Root mean square tracking error of the run over some `joints`, a slice or a list of zero-based indices, and
        over its last two seconds, in rad (m if prismatic); None where the run is shorter. Raises `IndexError` for an
        index without a joint, `InputError` where `joints` selects none."""
        return self.rms_error(start=self.duration - SETTLED, joints=joints) if self._lasts(SETTLED) else None

    def _lasts(self, length: float) -> bool:
        """True if the run lasts that many seconds, to half a sample."""
        return self.duration > length - 0.5 * self.rollout.sample_time

    def moving_rms_error(self, window: float) -> Array:
        """Root mean square of the run's tracking errors (positions less desired ones) over a moving window, an array
        (T,) with a value for each of its T samples: over all joints and over the samples of the last `window` s, that
        sample included. It is in rad (m if prismatic), mixed where joints are of both kinds.

        At the run's start there are fewer samples; a window shorter than the time between samples has one. From the
        first NaN or infinite error on, values are NaN or infinite. Raises `InputError` for a window that is not
        positive and finite.
        """
        positive_number(window, "window: expected a positive number of s")
        squares = np.mean(self.rollout.error**2, axis=1)
        sums = np.cumsum(np.concatenate([[0.0], squares]))
        stop = np.arange(1, len(squares) + 1)
        width = max(1, round(min(window / self.rollout.sample_time, len(squares))))
        start = np.maximum(stop - width, 0)
        with np.errstate(invalid="ignore"):
            return np.sqrt(np.maximum(sums[stop] - sums[start], 0.0) / (stop - start))

    @property
    def realtime_factor(self) -> float | None:
        """Ratio of simulated time to computing time, no unit: above 1 for a run faster than real time; None where the
        run's wall time is not above 0, as where it was not measured."""
        return self.duration / self.rollout.wall_time if self.rollout.wall_time > 0.0 else None

    @property
    def lyapunov_max_increase(self) -> float | None:
        """Largest rise of the Lyapunov function from one sample of the run to the next, J; 0 where it never rises; None
        where the control law has no such function, or where its values hold NaN or infinity."""
        if self.lyapunov is None or len(self.lyapunov) == 0 or not np.isfinite(self.lyapunov).all():
            return None
        return max(0.0, float(np.diff(self.lyapunov).max(initial=0.0)))


@dataclass(frozen=True)
class Setting:
    """Input value of an experiment, as its summary and report state it: its `name`, its `value` as text, and its
    `meaning` in words; the unit, if any, is in the value or the meaning. Nothing is checked at construction."""

    name: str
    value: str
    meaning: str


@dataclass(frozen=True)
class Finding:
    """Scalar result of an experiment, besides those that are computed of every run. `name` is its key in summary.json;
    where it is about one run it ends in a dot and the run's name. `value` is in `unit`, "1" for a number without a
    unit; `meaning` is in words. A value of NaN or infinity is null in summary.json and in words in the report; what a
    run did not reach has no finding. Nothing is checked at construction."""

    name: str
    value: float
    unit: str
    meaning: str


def _thousandths(value: float | None) -> str:
    return "–" if value is None else f"{1e3 * value:.3g}"


@dataclass(frozen=True, eq=False)
class Leading:
    """Errors that an experiment's recording and report show before the joints' errors, such as a tool's distance from
    its path.

    `meaning` says what they are; `errors` maps the name of every run compared to its errors (T,), one for each of T
    samples, in a unit such as m; `unit` is a thousandth of that unit, such as mm, in which they are shown. Nothing is
    checked at construction; `Comparison` checks the shapes of the errors.
    """

    meaning: str
    unit: str
    errors: Mapping[str, Array]

    def final_rms(self, run: ControllerRun) -> float | None:
        """Root mean square, over the last two seconds of a `run`, of the leading errors that this object has for it, in
        their own unit, such as m (not the thousandth in which they are shown); None where the run is shorter. Raises
        `KeyError` for a run without errors here, `IndexError` for another number of errors than samples."""
        if run.final_rms_error is None:
            return None
        late = run.rollout.time >= run.duration - SETTLED
        return float(np.sqrt(np.mean(np.square(self.errors[run.name][late]))))


def _validate_errors(leading: Leading, run: ControllerRun) -> None:
    """Raise `InputError` unless there is a leading error for every sample of a run."""
    samples = run.rollout.time.shape
    if (given := np.shape(leading.errors.get(run.name, ()))) != samples:
        raise InputError(f"leading: errors of {run.name!r}: expected shape {samples}, got {given}")


def color_places(runs: Sequence[ControllerRun], without_adaptation: str = ADAPTATION_OFF) -> dict[str, int]:
    """Zero-based indices of the runs' colours in the palette, by the runs' names: 0 for the first run, the one that a
    comparison is about, 1 for the run named `without_adaptation`, by default "adaptation-off", then the others in their
    order, from 2 on also where no run has that name; from 1 on where the first run has it. Raises `ValueError` where
    `runs` is empty."""
    first, *others = [run.name for run in runs]
    others.sort(key=lambda name: name != without_adaptation)
    shift = 0 if first == without_adaptation or without_adaptation in others else 1
    return {first: 0} | {name: i + 1 + shift for i, name in enumerate(others)}


class InPage(Protocol):
    """Protocol of what a report's page runs by itself, such as a live arm: it makes its own piece of HTML."""

    def html(self, label: str) -> str:
        """HTML of the piece, escaped; `label` is the name of the run that it repeats."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Comparison of closed-loop runs on one arm, one reference and one seed; the first run is the subject, that of the
    adaptive controller that the experiment is about.

    `experiment` is the experiment's name, `title` and `purpose` are texts for the report; `mechanism` has r primary
    (independent) joints; `space` is the essential space of its inertial parameters (their directions that change
    energies and torques), `basis` the fundamental basis (base parameters) of the subject's estimates. `runs` are at
    least one, with names that differ; `torque_limits` (r,), N m (N for a prismatic joint), are positive and finite;
    `settings` and `findings` are the experiment's settings and further results, for summary and report; `seed` is that
    of the random numbers; `duration`, s, is the length asked for; `complete` is False where the experiment was
    interrupted: the runs hold what was computed until then.

    `without_adaptation` is the name of the run with the subject's gains and adaptation off, "adaptation-off" unless
    given; `more_drawings` are figures for the report besides those of every comparison; `answer` is the outcome in a
    sentence or two, None for one made from the errors with and without adaptation; `truth_known` is False where the
    mechanism's parameters are not the arm's true ones; `leading` are errors that recording and report show before the
    joints' errors, None where there are none; `expected` maps the subject's failures that the experiment expects to the
    reasons why; `live` is the subject's closed loop to run in the report's page, or a text that says why there is none
    (empty by default).

    Raises `InputError` for empty `runs`, where the first has no samples, where two have one name, for torque limits of
    another shape, not above 0 or not numbers (`NonFiniteError` for NaN and infinity), and for a `leading` without an
    error for every sample of every run; nothing else is checked at construction.
    """

    experiment: str
    title: str
    purpose: str
    mechanism: Mechanism
    space: EssentialSpace
    basis: FundamentalBasis
    runs: tuple[ControllerRun, ...]
    torque_limits: Array
    settings: tuple[Setting, ...]
    seed: int
    duration: float
    findings: tuple[Finding, ...] = ()
    complete: bool = True
    without_adaptation: str = ADAPTATION_OFF
    more_drawings: tuple[Drawing, ...] = ()
    answer: str | None = None
    truth_known: bool = True
    leading: Leading | None = None
    expected: Mapping[Failure, str] = field(default_factory=dict)
    live: InPage | str = ""

    def __post_init__(self) -> None:
        if not self.runs or len(self.runs[0].rollout.time) == 0:
            raise InputError(f"{self.experiment}: nothing was run, so there is nothing to show")
        names = [run.name for run in self.runs]
        if repeated := [name for name in names if names.count(name) > 1]:
            raise InputError(f"{self.experiment}: runs: expected names that differ, got {repeated[0]!r} twice")
        limits = checked(self.torque_limits, self.mechanism.dof, "torque_limits")
        if limits.ndim != 1 or not (limits > 0.0).all():
            raise InputError(f"torque_limits: expected {self.mechanism.dof} positive numbers, got {limits.tolist()}")
        if self.leading is not None:
            for run in self.runs:
                _validate_errors(self.leading, run)

    def _repr_html_(self) -> str:
        """Notebook's view of the comparison: a table with a row a run."""
        heads = ("controller", "knows", f"first second [{self.error_unit}]", f"last 2 s [{self.error_unit}]", "seconds")
        rows = [
            (run.label, run.knows, _thousandths(run.first_rms_error), _thousandths(run.final_rms_error), run.duration)
            for run in self.runs
        ]
        return titled(self.title, "RMS errors") + table(heads, rows)

    @property
    def subject(self) -> ControllerRun:
        """The run of the adaptive controller that the experiment is about, the first of the comparison's `runs`."""
        return self.runs[0]

    @cached_property
    def color_places(self) -> dict[str, int]:
        """Zero-based index of every run's colour in the palette, by the run's name: 0 for the first run, the subject, 1
        for the run with adaptation off, then the others in their order, from 2 on also where no run has adaptation off.
        Where the first run is the one with adaptation off, the others begin at 1."""
        return color_places(self.runs, self.without_adaptation)

    @property
    def baseline(self) -> ControllerRun | None:
        """The run of the comparison with the first run's controller and its adaptation off, named by
        `without_adaptation`; None where there is none."""
        return next((run for run in self.runs if run.name == self.without_adaptation), None)

    @cached_property
    def model(self) -> ReducedModel:
        """The reduced model of the comparison's mechanism, dynamics on k parameters alone, whose parameters the first
        run estimates: the fundamental (base) inertial parameters of the comparison's `basis`, then all friction
        parameters. Raises `InputError` for a basis of another mechanism."""
        return ReducedModel(self.mechanism, self.basis)

    @property
    def true_parameters(self) -> Array:
        """True values (k,) of the k parameters that the comparison's first run estimates, fundamental (base) inertial
        parameters and then friction's, in the order of `model.names`. Units are SI (kg, kg m, kg m^2; friction by its
        kind, such as N m); values are NaN where `truth_known` is False. Raises `InputError` for a basis of another
        mechanism."""
        own = self.model.fundamental_parameters
        return own if self.truth_known else np.full_like(own, np.nan)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the mechanism's r primary (independent) joints, in the order of the columns of the runs' positions
        and torques."""
        return tuple(joint.name for joint in self.mechanism.primary_joints)

    @property
    def error_unit(self) -> str:
        """Unit, as text, in which position errors are shown, a thousandth of the positions' own: "mrad", "mm", or "mrad
        or mm" where joints are of both kinds."""
        return error_unit(self.mechanism)

    @property
    def joints_by_unit(self) -> dict[str, list[int]]:
        """Zero-based indices of the mechanism's primary (independent) joints, a list each, by the unit of their
        positions, "rad" or "m": rad before m; a unit that no joint has is left out."""
        units = position_units(self.mechanism)
        return {unit: [j for j, one in enumerate(units) if one == unit] for unit in sorted(set(units), reverse=True)}

    def limited_steps(self, run: ControllerRun) -> int:
        """Number of samples of a `run` at which any joint's torque was clipped, or its magnitude at least (1 - 1e-9)
        times its limit. A run has one sample in `rollout.every` control periods. Raises `ValueError` for a run of
        another number of joints."""
        largest = np.abs(run.rollout.applied) / self.torque_limits
        at_limit = (largest >= AT_LIMIT).any(axis=1) | (run.rollout.clipped > 0.0)
        return int(np.count_nonzero(at_limit))

    @property
    def peak_torque_shares(self) -> Array:
        """Largest magnitudes (r,) of the applied torques of the r primary (independent) joints in the comparison's
        first run, divided by the joints' torque limits, no unit: 1 at the limit. Raises `ValueError` for a run of
        another number of joints."""
        return np.asarray(np.abs(self.subject.rollout.applied).max(axis=0) / self.torque_limits)
