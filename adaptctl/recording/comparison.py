"""Comparisons as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from adaptctl.arrays import Array, checked
from adaptctl.caching import cached_property
from adaptctl.control.excitation.torque_uncertainty import OPEN_SHARE, torque_uncertainty
from adaptctl.description.visual import Visual
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit, position_units
from adaptctl.errors import InputError
from adaptctl.identifiability import EssentialSpace, FundamentalBasis, ReducedModel
from adaptctl.markup import table, titled
from adaptctl.recording.controller_run import FINAL_ERROR_TIME, ControllerRun
from adaptctl.recording.result import Failure

if TYPE_CHECKING:
    from adaptctl.recording.drawing import Drawing

# `prior_knowledge` of a controller without a model: estimates start at zero, gains come from the file's inertias.
NO_MODEL = "gains only"
# Name of the run of a subject's controller with adaptation off, unless a comparison says another
ADAPTATION_OFF = "adaptation-off"
# Share of its limit at which a torque counts as limited.
LIMIT_SHARE = 1.0 - 1e-9


@dataclass(frozen=True)
class Setting:
    """
    Input value of an experiment, as its summary and report state it.

    Parameters
    ----------
    name : str
        Name of the setting.
    value : str
        Value as text.
    meaning : str
        Meaning in words, with the unit.

    Examples
    --------
    >>> from adaptctl.recording import Setting
    >>> Setting("bandwidth", "5", "gain of the sliding variable, 1/s").value
    '5'
    """

    name: str
    value: str
    meaning: str


@dataclass(frozen=True)
class Finding:
    """
    Scalar result of an experiment, in addition to those computed for every run.

    Nothing is checked at construction; NaN and infinity become null in summary.json.

    Parameters
    ----------
    name : str
        Key in summary.json, with a dot and the run's name at its end where it is about one run.
    value : float
        Result, a scalar in `unit`.
    unit : str
        Unit, "1" for none.
    meaning : str
        Meaning in words.

    Examples
    --------
    >>> from adaptctl.recording import Finding
    >>> Finding("peak_speed.adaptive", 2.1, "rad/s", "largest joint speed").name
    'peak_speed.adaptive'
    """

    name: str
    value: float
    unit: str
    meaning: str


def _thousandths(value: float | None) -> str:
    return "–" if value is None else f"{1e3 * value:.3g}"


@dataclass(frozen=True, eq=False)
class TaskError:
    """
    Error of the task in each run, such as a tool's distance from its path, shown before the joint errors.

    Nothing is checked at construction; `Comparison` checks the shapes.

    Parameters
    ----------
    meaning : str
        Meaning in words.
    unit : str
        Unit in which they are shown, a thousandth of that of `errors`, such as mm.
    errors : mapping of str to numpy.ndarray
        Errors (T,) by the run's name, in a unit such as m.

    Examples
    --------
    >>> from adaptctl.recording import TaskError
    >>> TaskError("distance of the tool from its path", "mm", {"adaptive": np.zeros(201)}).unit
    'mm'
    """

    meaning: str
    unit: str
    errors: Mapping[str, Array]

    def final_rms(self, run: ControllerRun) -> float | None:
        """
        Compute the root mean square of the task error over the last two seconds of a run.

        Parameters
        ----------
        run : ControllerRun
            Run, one of those in `errors`.

        Returns
        -------
        float or None
            Root mean square in the unit of `errors`; None where the run is shorter.

        Raises
        ------
        KeyError
            If the run is none of these.
        """
        if run.final_rms_error is None:
            return None
        late = run.rollout.time >= run.duration - FINAL_ERROR_TIME
        return float(np.sqrt(np.mean(np.square(self.errors[run.name][late]))))


def _validate_errors(task_error: TaskError, run: ControllerRun) -> None:
    samples = run.rollout.time.shape
    if (given := np.shape(task_error.errors.get(run.name, ()))) != samples:
        raise InputError(f"task_error: errors of {run.name!r}: expected shape {samples}, got {given}")


def color_indices(runs: Sequence[ControllerRun], without_adaptation: str = ADAPTATION_OFF) -> dict[str, int]:
    """Index of each run's color: 0 for the first run, 1 for the one without adaptation, then the others."""
    first, *others = [run.name for run in runs]
    others.sort(key=lambda name: name != without_adaptation)
    shift = 0 if first == without_adaptation or without_adaptation in others else 1
    return {first: 0} | {name: i + 1 + shift for i, name in enumerate(others)}


class InPage(Protocol):
    """Protocol of what a report's page runs by itself, such as a live arm."""

    @property
    def label(self) -> str:
        """Label of the controller that runs, empty for the subject."""

    def html(self, label: str) -> str:
        """HTML of the piece, escaped."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """
    Closed-loop runs of several controllers on one arm and reference. The first is the subject, which is judged.

    Parameters
    ----------
    experiment : str
        Experiment by name, as report and summary.json state it.
    title : str
        Title of the report.
    purpose : str
        Purpose of the experiment, for the report.
    mechanism : Mechanism
        Mechanism with r primary (independent) joints.
    space : EssentialSpace
        Essential space of its inertial parameters.
    basis : FundamentalBasis
        Basis of the subject's estimates.
    runs : tuple of ControllerRun
        At least one run, names unique.
    torque_limits : numpy.ndarray
        Torque limits (r,) in N m (N for a prismatic joint).
    settings : tuple of Setting
        Input values of the experiment with their meaning and unit.
    seed : int
        Seed of the random numbers.
    duration : float
        Duration in s that was asked for.
    findings : tuple of Finding, optional
        Further scalar results. Default: none besides those of every run.
    complete : bool, default True
        False where the experiment was interrupted.
    without_adaptation : str, default "adaptation-off"
        Name of the run with the subject's gains and adaptation off, by default as experiments label it.
    more_drawings : tuple of Drawing, optional
        Further figures of the report. Default: none besides those of every comparison.
    answer : str, optional
        Outcome in a sentence; made from the errors with and without adaptation by default.
    truth_known : bool, default True
        False where the mechanism's parameters are not the arm's.
    task_error : TaskError, optional
        Errors of the task, shown before those of the joints. Default: none.
    expected : mapping of Failure to str, optional
        Reasons why the experiment expects a failure of the subject. Default: none, every failure counts.
    live : InPage or str, default ""
        Closed loop that the report's page runs, or the reason why there is none.
    error_bound : numpy.ndarray, optional
        Tracking errors (r,) in rad (m) beyond which the environment ends a run, as the verdict states. Default: not
        stated.
    surroundings : tuple of Visual, optional
        Shapes beside the arm, fixed to the ground and without meshes, as the recording shows them. Default: none.

    Raises
    ------
    InputError
        If there are no runs or samples, names are not unique, limits are not positive and finite, or task errors are
        missing.

    Examples
    --------
    >>> from adaptctl.recording import compared_runs
    >>> comparison = compared_runs(arm, {"adaptive": run}, truth_known=True)
    >>> comparison.joint_names, comparison.error_unit
    (('shoulder', 'elbow'), 'mrad')
    >>> comparison.limited_steps(comparison.subject)
    0
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
    task_error: TaskError | None = None
    expected: Mapping[Failure, str] = field(default_factory=dict)
    live: InPage | str = ""
    error_bound: Array | None = None
    surroundings: tuple[Visual, ...] = ()

    def __post_init__(self) -> None:
        if not self.runs or len(self.runs[0].rollout.time) == 0:
            raise InputError(f"{self.experiment}: expected a run with at least one sample")
        names = [run.name for run in self.runs]
        if repeated := [name for name in names if names.count(name) > 1]:
            raise InputError(f"{self.experiment}: runs: expected unique names, got {repeated[0]!r} twice")
        limits = checked(self.torque_limits, self.mechanism.dof, "torque_limits")
        if limits.ndim != 1 or not (limits > 0.0).all():
            raise InputError(f"torque_limits: expected {self.mechanism.dof} positive numbers, got {limits.tolist()}")
        if self.task_error is not None:
            for run in self.runs:
                _validate_errors(self.task_error, run)

    def __repr__(self) -> str:
        return f"<Comparison {self.experiment!r}: {len(self.runs)} runs of {self.mechanism.name!r}>"

    def _repr_html_(self) -> str:
        heads = (
            "controller",
            "initial model",
            f"first second [{self.error_unit}]",
            f"last 2 s [{self.error_unit}]",
            "seconds",
        )
        rows = [
            (
                run.label,
                run.prior_knowledge,
                _thousandths(run.first_rms_error),
                _thousandths(run.final_rms_error),
                run.duration,
            )
            for run in self.runs
        ]
        return titled(self.title, "RMS errors") + table(heads, rows)

    @property
    def subject(self) -> ControllerRun:
        """First run, of the adaptive controller that the experiment is about."""
        return self.runs[0]

    @cached_property
    def color_indices(self) -> dict[str, int]:
        """Index of each run's color by the run's name, 0 for the subject and 1 for adaptation off."""
        return color_indices(self.runs, self.without_adaptation)

    @property
    def baseline(self) -> ControllerRun | None:
        """Run with the subject's controller and adaptation off."""
        return next((run for run in self.runs if run.name == self.without_adaptation), None)

    @cached_property
    def model(self) -> ReducedModel:
        """Reduced model whose parameters the subject estimates."""
        return ReducedModel(self.mechanism, self.basis)

    @property
    def true_parameters(self) -> Array:
        """True values (k,) of the subject's estimates in SI units."""
        own = self.model.fundamental_parameters
        return own if self.truth_known else np.full_like(own, np.nan)

    @cached_property
    def is_open(self) -> tuple[bool, ...]:
        """True for each of k parameters that a subject estimates and its motion hardly shows, above 1 % of
        `torque_uncertainty`."""
        if not self.subject.is_estimating:
            return (False,) * len(self.model.names)
        found = torque_uncertainty(self.model, self.subject.rollout, self.torque_limits)
        return tuple((found > OPEN_SHARE).tolist())

    @property
    def open_names(self) -> tuple[str, ...]:
        """Names of the parameters that the subject's motion hardly shows."""
        return tuple(name for name, is_open in zip(self.model.names, self.is_open, strict=True) if is_open)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the r primary (independent) joints."""
        return tuple(joint.name for joint in self.mechanism.primary_joints)

    @property
    def error_unit(self) -> str:
        """Unit in which position errors are shown: "mrad", "mm", or "mrad or mm"."""
        return error_unit(self.mechanism)

    @property
    def joints_by_unit(self) -> dict[str, list[int]]:
        """Indices of the joints by the unit of their positions, "rad" or "m"."""
        units = position_units(self.mechanism)
        return {unit: [j for j, one in enumerate(units) if one == unit] for unit in sorted(set(units), reverse=True)}

    def limited_steps(self, run: ControllerRun) -> int:
        """
        Count the samples of a run at which a torque was clipped or at its limit.

        Parameters
        ----------
        run : ControllerRun
            Run of the mechanism's r joints.

        Returns
        -------
        int
            Number of samples.
        """
        if run not in self._limited_steps:
            largest = np.abs(run.rollout.applied) / self.torque_limits
            at_limit = (largest >= LIMIT_SHARE).any(axis=1) | (run.rollout.clipped > 0.0)
            self._limited_steps[run] = int(np.count_nonzero(at_limit))
        return self._limited_steps[run]

    @cached_property
    def _limited_steps(self) -> dict[ControllerRun, int]:
        """Samples at a limit, of runs that were asked for."""
        return {}

    @property
    def peak_torque_shares(self) -> Array:
        """Largest torques (r,) of the subject divided by their limits."""
        return np.asarray(np.abs(self.subject.rollout.applied).max(axis=0) / self.torque_limits)
