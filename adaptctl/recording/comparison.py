"""Comparisons as data: runs of several controllers on one arm, one reference, one seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from adaptctl.arrays import Array, checked, positive_number
from adaptctl.caching import cached_property
from adaptctl.codegen.live_arm import LiveArm
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import EssentialSpace, FundamentalBasis, ReducedModel
from adaptctl.markup import table, titled
from adaptctl.recording.units import error_unit, position_units, torque_units
from adaptctl.recording.verdict import Failure
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
    """Cost of one control tick, the computation of one torque, in time and in operations: `called`, s, called from
    Python, the median; `native`, s, within a native loop over many states; `flops`, the number of additions,
    subtractions, multiplications, divisions and negations. The last two are None where not known. Nothing is checked at
    construction."""

    called: float
    """s, called from Python"""
    native: float | None = None
    """s, within a native loop over many states"""
    flops: int | None = None
    """additions, subtractions, multiplications, divisions, negations"""


@dataclass(frozen=True, eq=False)
class ControllerRun:
    """A closed-loop run of one controller, with its name, label and cost.

    `name` is short, fit for a file, and one run's alone; `label` is for legends and tables; `knows`, what it knew of
    the arm beforehand, in words or empty; `rollout`, its T samples of r joints; `lyapunov` (T,), J, the Lyapunov
    function, None where the law has none; `cost`, that of a control tick, None where it was not measured. Nothing is
    checked at construction.
    """

    name: str
    """short and fit for a file: ``adaptive``"""
    label: str
    """for legends and tables: ``Slotine-Li, 36 parameters``"""
    knows: str
    """what it knew of the arm beforehand: ``nothing``"""
    rollout: Rollout
    lyapunov: Array | None = None
    """(T,) where the law has such a function"""
    cost: TickCost | None = None
    """where it was measured"""

    @property
    def duration(self) -> float:
        """Duration of the run in closed loop, s, from time zero to its end, that of its `rollout`."""
        return self.rollout.duration

    def rms_error(self, start: float = 0.0, stop: float = np.inf, joints: Joints = ALL) -> float | None:
        """Root mean square of the tracking errors p - p_d, rad (m), of joints at times t with `start` <= t < `stop`, s,
        all of the run unless given; None without such samples. `joints` is a slice or a list of indices from 0, all
        unless given; joints of both kinds go into one number. Raises `IndexError` for an index that is no joint's,
        `InputError` for no joints."""
        inside = (self.rollout.time >= start) & (self.rollout.time < stop)
        errors = self.rollout.error[inside][:, joints]
        if errors.shape[1] == 0:
            raise InputError(f"joints: expected at least one joint, got {joints}")
        return float(np.sqrt(np.mean(errors**2))) if inside.any() else None

    @property
    def first_rms_error(self) -> float | None:
        """Root mean square tracking error (rad or m) of all joints over the first second; None where the run is
        shorter."""
        return self.first_rms_error_of(ALL)

    @property
    def final_rms_error(self) -> float | None:
        """Root mean square tracking error (rad or m) of all joints over the last two seconds that were run; None where
        the run is shorter."""
        return self.final_rms_error_of(ALL)

    def first_rms_error_of(self, joints: Joints) -> float | None:
        """Root mean square tracking error (rad or m) of some joints, a slice or a list of indices from 0, over the
        first second; None where the run is shorter. Raises `IndexError` for an index that is no joint's, `InputError`
        for no joints."""
        return self.rms_error(stop=BEGINNING, joints=joints) if self._lasts(BEGINNING) else None

    def final_rms_error_of(self, joints: Joints) -> float | None:
        """Root mean square tracking error (rad or m) of some joints, a slice or a list of indices from 0, over the last
        two seconds that were run; None where the run is shorter. Raises `IndexError` for an index that is no joint's,
        `InputError` for no joints."""
        return self.rms_error(start=self.duration - SETTLED, joints=joints) if self._lasts(SETTLED) else None

    def _lasts(self, length: float) -> bool:
        """True if the run lasts that many seconds, to half a sample."""
        return self.duration > length - 0.5 * self.rollout.spacing

    def moving_rms_error(self, window: float) -> Array:
        """Root mean square tracking errors (T,) of all joints, rad or m, over the last `window`, s, up to and with each
        sample, fewer at the run's start; of the sample alone for a window below its spacing. Raises `InputError` for a
        window that is not positive and finite."""
        positive_number(window, "window: expected a positive number of s")
        squares = np.mean(self.rollout.error**2, axis=1)
        sums = np.cumsum(np.concatenate([[0.0], squares]))
        stop = np.arange(1, len(squares) + 1)
        width = max(1, round(min(window / self.rollout.spacing, len(squares))))
        start = np.maximum(stop - width, 0)
        return np.sqrt(np.maximum(sums[stop] - sums[start], 0.0) / (stop - start))

    @property
    def lyapunov_max_increase(self) -> float | None:
        """Largest rise of the Lyapunov function from one sample to the next, J; 0 when it never rises; None where the
        law has none, and where it holds NaN or infinity, which tells of no fall."""
        if self.lyapunov is None or len(self.lyapunov) == 0 or not np.isfinite(self.lyapunov).all():
            return None
        return max(0.0, float(np.diff(self.lyapunov).max(initial=0.0)))


@dataclass(frozen=True)
class Setting:
    """A setting of an experiment, for the record: its `name`, its `value` as text, and its `meaning` in words; the unit
    is in one of these two. Nothing is checked at construction."""

    name: str
    value: str
    meaning: str


@dataclass(frozen=True)
class Finding:
    """A measured quantity besides the runs: `name`, its key in summary.json, which for one of a single run ends in a
    dot and the run's name; `value`, a number in `unit`, "1" for none; `meaning`, in words. Nothing is checked at
    construction, but `write_artifacts` raises `FileError` for a value of NaN or infinity."""

    name: str
    """the key in summary.json"""
    value: float
    unit: str
    meaning: str


def _thousandths(value: float | None) -> str:
    return "–" if value is None else f"{1e3 * value:.3g}"


@dataclass(frozen=True, eq=False)
class Leading:
    """The leading errors of an experiment, which its pages show before the joints', such as a tool's distance from its
    path.

    `meaning` says what is drawn; `errors` maps the name of every run compared to its errors (T,), such as in m; `unit`
    is that of a thousandth of these, such as mm. Nothing is checked at construction, but by `Comparison`.
    """

    meaning: str
    """what is drawn: ``Distance of the tool from its path``"""
    unit: str
    """of a thousandth of it: ``mm``"""
    errors: Mapping[str, Array]
    """(T,) by the name of the run"""

    def final_rms(self, run: ControllerRun) -> float | None:
        """Root mean square of a run's leading error, in the unit of `errors`, such as m (not the thousandth that `unit`
        names), over the last two seconds that were run; None where the run is shorter. Raises `KeyError` for a run
        without errors, `IndexError` for errors that are not T."""
        if run.final_rms_error is None:
            return None
        late = run.rollout.time >= run.duration - SETTLED
        return float(np.sqrt(np.mean(np.square(self.errors[run.name][late]))))


def _require_errors(leading: Leading, run: ControllerRun) -> None:
    """Raise `InputError` unless there is a leading error for every sample of a run."""
    samples = run.rollout.time.shape
    if (given := np.shape(leading.errors.get(run.name, ()))) != samples:
        raise InputError(f"leading: errors of {run.name!r}: expected shape {samples}, got {given}")


def color_places(runs: Sequence[ControllerRun], without_adaptation: str = ADAPTATION_OFF) -> dict[str, int]:
    """Place of every run's colour among the palette's, by the run's name: the subject, which is the first, then the run
    with adaptation off, then the others in their order."""
    first, *others = [run.name for run in runs]
    others.sort(key=lambda name: name != without_adaptation)
    shift = 0 if first == without_adaptation or without_adaptation in others else 1
    return {first: 0} | {name: i + 1 + shift for i, name in enumerate(others)}


@dataclass(frozen=True, eq=False)
class Comparison:
    """A comparison of runs on one arm, one reference and one seed; the first is the experiment's subject, which adapts.

    `experiment` is its name, `title` and `purpose` are words for the report; `mechanism` has r primary joints; `space`
    and `basis` are its essential space and the fundamental basis of the estimates; `runs`, at least one, with names
    that differ; `torque_limits` (r,), N m (N for a prismatic joint), positive and finite; `settings` and `findings`,
    for the record; `seed`, of the random numbers; `duration`, s asked for; `complete`, False when it was interrupted:
    what was computed is kept; `without_adaptation`, the name of the run with the subject's gains and adaptation off;
    `more_drawings`, figures besides those of every comparison; `answer`, the outcome in a sentence or two, None where
    it is how much adaptation is worth; `truth_known`, False where the mechanism's parameters are not the arm's;
    `leading`, the errors that a recording shows before the joints', None for none; `expected`, the failures that the
    experiment expects of its subject, and why; `live`, the subject's closed loop for the report to run, or why there is
    none.

    Raises `InputError` without a run, where the first has no samples, where two have one name, for torque limits of
    another shape, not above 0 or no numbers (`NonFiniteError` for NaN and infinity), and for a `leading` without (T,)
    errors of a run; nothing else is checked at construction.
    """

    experiment: str
    title: str
    purpose: str
    mechanism: Mechanism
    space: EssentialSpace
    basis: FundamentalBasis
    runs: tuple[ControllerRun, ...]
    torque_limits: Array
    """(r,) of the environment, N m or N"""
    settings: tuple[Setting, ...]
    seed: int
    duration: float
    """s asked for"""
    findings: tuple[Finding, ...] = ()
    complete: bool = True
    """False when it was interrupted: what was computed is kept."""
    without_adaptation: str = ADAPTATION_OFF
    """the name of the run with the subject's gains and adaptation off"""
    more_drawings: tuple[Drawing, ...] = ()
    """figures besides those of every comparison: what this one is about"""
    answer: str | None = None
    """the outcome in a sentence or two, where it is not how much adaptation is worth"""
    truth_known: bool = True
    """whether the mechanism's own parameters are the arm's: those of a real arm are not known"""
    leading: Leading | None = None
    """what a recording shows before the joints' errors"""
    expected: Mapping[Failure, str] = field(default_factory=dict)
    """the failures that the experiment expects of its subject, and why: they are its question"""
    live: LiveArm | str = ""
    """the subject's closed loop for the report to run, or why there is none"""

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
                _require_errors(self.leading, run)

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
        """The run of the adaptive controller that the experiment is about, the first of `runs`."""
        return self.runs[0]

    @cached_property
    def color_places(self) -> dict[str, int]:
        """Index of every run's colour in the palette, from 0, by the run's name: 0 for the subject, 1 for the run with
        adaptation off (left free where there is none), then the others in their order."""
        return color_places(self.runs, self.without_adaptation)

    @property
    def baseline(self) -> ControllerRun | None:
        """The run of the subject's controller with adaptation off, named `without_adaptation`; None where it was not
        run."""
        return next((run for run in self.runs if run.name == self.without_adaptation), None)

    @cached_property
    def model(self) -> ReducedModel:
        """The reduced model whose k parameters the subject estimates: the fundamental ones, and all friction. Raises
        `InputError` for a `basis` of another mechanism."""
        return ReducedModel(self.mechanism, self.basis)

    @property
    def true_parameters(self) -> Array:
        """True values (k,) of the model's parameters, in the order of `model.names` and SI units (kg, kg m, kg m^2;
        friction by its kind, such as N m); NaN where the truth is not known."""
        own = self.model.fundamental_parameters
        return own if self.truth_known else np.full_like(own, np.nan)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the r primary joints, in the order of the runs' columns."""
        return tuple(joint.name for joint in self.mechanism.primary_joints)

    @property
    def position_units(self) -> tuple[str, ...]:
        """Units, as texts, of the r primary joints' positions: "rad" or "m" each."""
        return position_units(self.mechanism)

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Units, as texts, of the r primary joints' torques: "N·m" or, of a prismatic joint's force, "N" each."""
        return torque_units(self.mechanism)

    @property
    def error_unit(self) -> str:
        """Unit, as text, of a thousandth of a joint's position: "mrad", "mm", or "mrad or mm" where joints are of both
        kinds."""
        return error_unit(self.mechanism)

    @property
    def joints_by_unit(self) -> dict[str, list[int]]:
        """Indices from 0 of the primary joints, as lists, by the unit of their positions, "rad" or "m": rad before m,
        and no unit that no joint has."""
        units = self.position_units
        return {unit: [j for j, one in enumerate(units) if one == unit] for unit in sorted(set(units), reverse=True)}

    def limited_steps(self, run: ControllerRun) -> int:
        """Number of samples of a run, each of `every` control periods, in which a torque was clipped, or was at its
        limit to 1e-9 of it. Raises `ValueError` for a run of another number of joints."""
        largest = np.abs(run.rollout.applied) / self.torque_limits
        at_limit = (largest >= AT_LIMIT).any(axis=1) | (run.rollout.clipped > 0.0)
        return int(np.count_nonzero(at_limit))

    @property
    def peak_torque_shares(self) -> Array:
        """Largest applied torque of the subject's run over its limit, in size, for each joint (r,), no unit: 1 at the
        limit."""
        return np.asarray(np.abs(self.subject.rollout.applied).max(axis=0) / self.torque_limits)
