"""Rows of a sweep."""

from __future__ import annotations

import platform
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import lru_cache
from itertools import islice
from typing import Any, NamedTuple, TypeVar

import numpy as np

from adaptctl.compilation.lanes import Precision
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import (
    AdaptctlError,
    NotCompiledWarning,
    NotFoundError,
    PhysicalConsistencyWarning,
    SimplificationWarning,
)
from adaptctl.experiments import find
from adaptctl.experiments.contest import Contender, FromFile, Learning
from adaptctl.experiments.experiment import CheckedSettings, Experiment
from adaptctl.files import finite_or_none
from adaptctl.identifiability import FundamentalBasis, essential_space, fundamental_basis
from adaptctl.recording import Comparison, ControllerRun
from adaptctl.simulation import Episode, Rollouts, simulate_many
from adaptctl.simulation.whole_runs import whole
from adaptctl.version import __version__

# Errors of an experiment that make its run a failed one and leave others as they are.
FAILURES = (AdaptctlError, ArithmeticError, np.linalg.LinAlgError)
# Options of a reset that change an episode's true parameters alone.
WHAT_IS_HELD = frozenset({"payload"})


class RunOutcome(NamedTuple):
    """Outcome of a run: status, reason and numbers, which are None where it failed."""

    status: str
    reason: str = ""
    rms_error: float | None = None
    final_rms_error: float | None = None
    largest_error: float | None = None
    diverged_at: float | None = None
    diverged_joint: int | None = None
    lyapunov_rise: float | None = None

    @classmethod
    def failed(cls, reason: str | Exception) -> RunOutcome:
        """Outcome of a run that could not be made or computed, for a reason."""
        return cls("failed", " ".join(str(reason).split()))

    @classmethod
    def each_of(cls, runs: Rollouts) -> list[RunOutcome]:
        """Outcomes of many simulated runs."""
        means = (np.sqrt(np.mean(errors**2, axis=-1)) for errors in (runs.rms_error, runs.final_rms_error))
        largest, rises = runs.largest_error.max(axis=-1), runs.lyapunov_rise
        found = []
        columns = (*means, largest, rises, runs.diverged_at, runs.diverged_joint)
        for rms, last, most, rise, at, joint in zip(*(x.tolist() for x in columns), strict=True):
            one = cls("done", "", finite_or_none(rms), finite_or_none(last), most, lyapunov_rise=finite_or_none(rise))
            if joint >= 0:
                why, gone = f"joint {joint + 1} exceeded its error limit at {at:g} s", (at, joint + 1)
                one = cls("diverged", why, one.rms_error, None, most, *gone, one.lyapunov_rise)
            found.append(one)
        return found


RunOutcomes = dict[int, list[tuple[str, RunOutcome]]]
# Episodes and their environments by mechanism and task.
Begun = dict[Any, tuple[Episode, Any]]
# A controller, the episode that it drives, and the environment that this is of.
Trial = tuple[Contender, Episode, Any]


def batched(
    experiments: Sequence[Experiment], controllers: Sequence[str], precision: Precision = "double"
) -> RunOutcomes:
    """Outcomes of the experiments that can be simulated together in native code, by index."""
    if not all(isinstance(one, Learning) for one in experiments):
        return {}
    outcomes: RunOutcomes = {}
    trials: dict[int, list[Trial]] = {}
    groups: dict[Any, list[tuple[int, int]]] = {}
    known: Begun = {}
    for k, one in enumerate(experiments):
        try:
            trials[k] = _trials(one, controllers, known)  # type: ignore[arg-type]  # each is a Learning
        except FAILURES as error:
            outcomes[k] = [("", RunOutcome.failed(error))]
            continue
        for c, trial in enumerate(trials[k]):
            groups.setdefault(_group(trial), []).append((k, c))
    found: dict[tuple[int, int], RunOutcome] = {}
    for places in groups.values():
        found |= dict(zip(places, _tried([trials[k][c] for k, c in places], precision), strict=False))
    for k, own in trials.items():
        if own and all((k, c) in found for c in range(len(own))):
            outcomes[k] = [(trial[0].name, found[k, c]) for c, trial in enumerate(own)]
    return outcomes


def started(experiment: Learning, mechanism: Mechanism, known: Begun) -> tuple[Episode, Any]:
    """Initial episode of an experiment after a reset, and its environment without wrappers."""
    kind = type(experiment)
    if _home(kind, "task") is not _home(kind, "environment") or experiment.options.keys() - WHAT_IS_HELD:
        return _reset(experiment, mechanism)
    key = mechanism, experiment.task(mechanism)  # type: ignore[attr-defined]  # it has one: see above
    if key not in known:
        known[key] = _reset(experiment, mechanism)
    episode, env = known[key]
    return episode._replace(parameters=env.true_parameters(experiment.options)), env


def _home(kind: type, name: str) -> type | None:
    return next((one for one in kind.__mro__ if name in vars(one)), None)


def _reset(experiment: Learning, mechanism: Mechanism) -> tuple[Episode, Any]:
    env: Any = experiment.environment(mechanism)
    return env.unwrapped.episode(seed=experiment.seed, options=experiment.options), env.unwrapped


def _trials(experiment: Learning, controllers: Sequence[str], known: Begun) -> list[Trial]:
    mechanism = _mechanism(experiment)
    chosen = named(experiment.contenders(mechanism, offline(mechanism)), controllers)
    episode, env = started(experiment, mechanism, known)
    plant, reference = episode.plant, episode.reference
    simple = not plant.effects and isinstance(reference, Sinusoids) and plant.mechanism.continuation is None
    if not simple or any(one.controller.reference_size != plant.dof for one in chosen):
        return []
    return [(one, episode, env) for one in chosen]


def _mechanism(experiment: Learning) -> Mechanism:
    """Mechanism of an experiment; a file is read once."""
    if type(experiment).mechanism is FromFile.mechanism and isinstance(experiment, FromFile):
        return robot(experiment.robot, **experiment.reading)
    return interned(experiment.mechanism())


Some = TypeVar("Some", Contender, ControllerRun)


def named(candidates: Sequence[Some], names: Sequence[str]) -> list[Some]:
    """Candidates of these names; all candidates if no name is given."""
    known = [one.name for one in candidates]
    for name in names:
        if name not in known:
            raise NotFoundError(f"unknown controller {name!r}; controllers: {', '.join(known)}")
    return [one for one in candidates if not names or one.name in names]


def validate_controllers(experiment: str, runs: Iterator[Mapping[str, Any]], names: Sequence[str]) -> None:
    """Raise `NotFoundError` for the name of a controller that neither the first nor the last of the runs has."""
    kind, missing, known = find(experiment), set(names), list[str]()
    while missing and issubclass(kind, Learning) and (run := deque(islice(runs, None if known else 1), 1)):
        if not (found := _controllers(kind, run[0])):
            return
        missing, known = missing.difference(found), [*known, *found]
    if missing and known:
        told = ", ".join(dict.fromkeys(known))
        raise NotFoundError(f"controllers: unknown controller {min(missing)!r}; controllers: {told}")


def _controllers(kind: type[Learning], settings: Mapping[str, Any]) -> list[str]:
    """Names of a run's controllers; none where it fails, as its row will say."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhysicalConsistencyWarning)
        warnings.simplefilter("ignore", SimplificationWarning)
        try:
            mechanism = _mechanism(one := kind(**settings))
            return [contender.name for contender in one.contenders(mechanism, offline(mechanism))]
        except FAILURES:
            return []


@lru_cache(maxsize=8)
def offline(mechanism: Mechanism) -> FundamentalBasis:
    """Fundamental basis of a mechanism, cached for the last 8."""
    return fundamental_basis(essential_space(mechanism))


@lru_cache(maxsize=64)
def robot(source: str, **reading: Any) -> Mechanism:
    """Mechanism of a built-in robot or file, cached by its source and the way to read it."""
    return interned(load(source, **reading))


_MECHANISMS: dict[tuple[str, str, bool], Mechanism] = {}


def interned(mechanism: Mechanism) -> Mechanism:
    """First mechanism of equal description, so that equal ones share compiled code."""
    if len(_MECHANISMS) > 64:
        _MECHANISMS.clear()
    about = mechanism.description
    key = about.sha256, mechanism.geometry_sha256, about.as_written
    return _MECHANISMS.setdefault(key, mechanism)


def _group(trial: Trial) -> Any:
    """Equal for what can run together."""
    contender, episode, env = trial
    waves = np.shape(getattr(episode.reference, "amplitude", ()))
    structures = contender.controller.structure, episode.plant.structure
    return *structures, episode.steps, env.error_bound.tobytes(), waves


def _tried(trials: Sequence[Trial], precision: Precision) -> list[RunOutcome]:
    """Outcomes of trials that run together."""
    episodes = [episode for _, episode, _ in trials]
    plant = episodes[0].plant
    try:
        runs = simulate_many(
            plant,
            [contender.controller for contender, _, _ in trials],
            [one.reference for one in episodes],
            duration=episodes[0].steps * plant.control_period,
            parameters=np.stack([one.parameters for one in episodes]),
            p=np.stack([one.state.p for one in episodes]),
            v=np.stack([one.state.v for one in episodes]),
            record_every=None,
            divergence_bound=trials[0][2].error_bound,
            precision=precision,
        )
        return RunOutcome.each_of(whole(runs))
    except FAILURES as error:
        return [] if precision == "double" else [RunOutcome.failed(error)] * len(trials)


Row = dict[str, Any]
# Columns that differ from one computer, and one time, to another.
TIMES = ("wall_time", "host")
# Kind and meaning of an outcome's columns.
OUTCOME = {
    "status": ("string", "done, diverged, or failed"),
    "reason": ("string", "reason, if not done"),
    "rms_error": ("double", "root mean square of the errors of all joints, rad or m; until it diverged"),
    "final_rms_error": ("double", "the same over the last two seconds, rad or m; None of shorter runs"),
    "largest_error": ("double", "of all joints, rad or m"),
    "diverged_at": ("double", "s"),
    "diverged_joint": ("int64", "from 1"),
    "lyapunov_rise": ("double", "largest rise of the Lyapunov function from one sample to the next, J"),
}
ABOUT = {
    "version": ("string", "of adaptctl"),
    "wall_time": ("double", "s per run, with all runs of its batch"),
    "host": ("string", "computer"),
}


def rows_of(
    experiment: str,
    runs: Sequence[Mapping[str, Any]],
    controllers: Sequence[str] = (),
    precision: Precision = "double",
) -> list[Row]:
    """Rows of an experiment's runs, one for each run and controller."""
    kind, started = find(experiment), time.perf_counter()
    with warnings.catch_warnings():
        for category in (PhysicalConsistencyWarning, SimplificationWarning, NotCompiledWarning):
            warnings.simplefilter("ignore", category)  # an experiment by itself tells them, and not a thousand times
        made = [_made(kind, settings) for settings in runs]
        found = _outcomes([one for one in made if not isinstance(one, str)], controllers, precision)
    wall_time = (time.perf_counter() - started) / max(1, len(runs))
    about = {"version": __version__, "wall_time": wall_time, "host": platform.node()}
    defaults = {entry.name: _plain(entry.default) for entry in fields(kind)}
    left, rows = iter(found), list[Row]()
    for one, run in zip(made, runs, strict=True):
        outcomes = [("", RunOutcome.failed(one))] if isinstance(one, str) else next(left)
        known = run if isinstance(one, str) else {name: getattr(one, name) for name in defaults}
        settings = defaults | {name: _plain(value) for name, value in known.items()}
        rows += [settings | {"controller": name} | outcome._asdict() | about for name, outcome in outcomes]
    return rows


def columns_of(kind: type[CheckedSettings]) -> dict[str, tuple[str, str]]:
    """Types and meanings of a sweep's columns, by name."""
    settings = {entry.name: (_kind(entry.default), entry.metadata["meaning"]) for entry in fields(kind)}
    return settings | {"controller": ("string", "name of the controller")} | OUTCOME | ABOUT


def alone(experiment: Experiment, controllers: Sequence[str]) -> list[tuple[str, RunOutcome]]:
    """Outcomes of an experiment that runs by itself, by controller."""
    compare: Callable[..., Comparison] | None = getattr(experiment, "compare", None)
    if compare is None:
        return [("", RunOutcome.failed(f"{experiment.name} compares no controllers, so there are no rows"))]
    try:
        chosen = named(compare(lambda what, share: None).runs, controllers)
    except FAILURES as error:
        return [("", RunOutcome.failed(error))]
    return [(run.name, _outcome(run)) for run in chosen]


def _made(kind: type[Experiment], settings: Mapping[str, Any]) -> Experiment | str:
    try:
        return kind(**settings)
    except AdaptctlError as error:
        return str(error)


def _outcomes(
    chosen: Sequence[Experiment], controllers: Sequence[str], precision: Precision
) -> list[list[tuple[str, RunOutcome]]]:
    together = batched(chosen, controllers, precision)
    return [together[k] if k in together else alone(one, controllers) for k, one in enumerate(chosen)]


def _outcome(run: ControllerRun) -> RunOutcome:
    error, gone = np.abs(run.rollout.error), run.rollout.terminated
    return RunOutcome(
        status="diverged" if gone else "done",
        reason="the environment ended the run" if gone else "",
        rms_error=run.rms_error(),
        final_rms_error=None if gone else run.final_rms_error,
        largest_error=float(error.max()) if error.size else None,
        diverged_at=run.duration if gone else None,
        diverged_joint=int(error[-1].argmax()) + 1 if gone and len(error) else None,
        lyapunov_rise=run.lyapunov_max_increase,
    )


def _plain(value: Any) -> Any:
    return " ".join(map(str, value)) if isinstance(value, tuple) else value


def _kind(default: Any) -> str:
    return {int: "int64", float: "double", bool: "bool"}.get(type(default), "string")
