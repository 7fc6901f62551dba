"""Runs that share a mechanism and a law, computed together in native code, and what comes of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar

import numpy as np

from adaptctl.compilation.lanes import Precision
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import AdaptctlError, NotFoundError
from adaptctl.experiments.contest import Contender, Learning
from adaptctl.experiments.experiment import Experiment
from adaptctl.identifiability import FundamentalBasis, essential_space, fundamental_basis
from adaptctl.recording import ControllerRun
from adaptctl.simulation import Episode, Rollouts, simulate_many

FAILURES = (AdaptctlError, ArithmeticError, np.linalg.LinAlgError)
"""Errors of an experiment that make its run a failed one and leave others as they are."""
WHAT_IS_HELD = frozenset({"payload"})
"""Options of a reset that change an episode's true parameters alone."""


class RunOutcome(NamedTuple):
    """Outcome of one run of a sweep. `status` is "done", "diverged" or "failed", and `reason` says why it is not
    "done". Errors are of joint positions, actual less reference, rad (m if prismatic), joints of both kinds counting
    alike: `rms_error` is their root mean square over all joints and control periods until the run ended or diverged,
    `rms_error_last` that over the last two seconds (None for a run that diverged or is shorter), `largest_error` the
    largest magnitude of any joint. `diverged_at` is the time, s, and `diverged_joint` the joint, from 1, of the first
    error out of bounds; `lyapunov_rise`, J, is the largest rise of the control law's Lyapunov function from one sample
    to the next. None stands for a number that is not known. Nothing is checked."""

    status: str
    reason: str = ""
    rms_error: float | None = None
    rms_error_last: float | None = None
    largest_error: float | None = None
    diverged_at: float | None = None
    diverged_joint: int | None = None
    lyapunov_rise: float | None = None

    @classmethod
    def failed(cls, reason: str | Exception) -> RunOutcome:
        """Outcome "failed", a `RunOutcome`, of a run that could not be made or computed, for the `reason` given, a text
        or an error, as one line; its numbers are None. Nothing is raised."""
        return cls("failed", " ".join(str(reason).split()))

    @classmethod
    def each_of(cls, runs: Rollouts) -> list[RunOutcome]:
        """List of the `RunOutcome` of each of many simulated `runs`, a `Rollouts`, in their order: "diverged" where a
        joint's position error left its bound, "done" otherwise. Root mean squares and rises of the Lyapunov function
        that are not finite become None. Nothing is raised."""
        means = (np.sqrt(np.mean(errors**2, axis=-1)) for errors in (runs.rms_error, runs.final_rms_error))
        largest, rises = runs.largest_error.max(axis=-1), runs.lyapunov_rise
        columns = (x.tolist() for x in (*means, largest, rises, runs.diverged_at, runs.diverged_joint))
        return [cls._of(*numbers) for numbers in zip(*columns, strict=True)]

    @classmethod
    def _of(cls, rms: float, last: float, largest: float, rise: float, diverged_at: float, joint: int) -> RunOutcome:
        if joint < 0:
            return cls("done", "", _known(rms), _known(last), largest, lyapunov_rise=_known(rise))
        message = f"joint {joint + 1} left its bound at {diverged_at:g} s"
        return cls("diverged", message, _known(rms), None, largest, diverged_at, joint + 1, _known(rise))


class BatchedRun(NamedTuple):
    """Named tuple of what one run of an experiment needs to be simulated in a batch with others: `contenders`, the
    controllers to compare, a `Contender` each (name, label and controller); `episode`, the tracking `Episode` that each
    of them drives; and `env`, the environment that it is of. Nothing is checked."""

    contenders: list[Contender]
    episode: Episode
    env: Any


RunOutcomes = dict[int, list[tuple[str, RunOutcome]]]
Begun = dict[Any, tuple[Episode, Any]]
"""Episodes and their environments by mechanism and task."""


def batched(
    experiments: Sequence[Experiment], controllers: Sequence[str], precision: Precision = "double"
) -> RunOutcomes:
    """Outcomes of those `experiments` that can be simulated together in native code: a mapping from an experiment's
    index, from 0, in `experiments` to a list of pairs, a controller's name and its `RunOutcome`. An experiment is left
    out where its plant has kinematic loops or effects (delays and limits of torques, friction and springs in joints,
    sensors, loads), where its reference is not `Sinusoids` of the joints, or where a controller takes a reference of
    another size. The mapping is empty unless all `experiments` are instances of `Learning`, the class of experiments
    that compare controllers.

    `controllers` has the names of the controllers that run, all where it is empty; `precision` is that of the
    floating-point numbers, "double" by default, or "single". In double the outcomes are those of each experiment by
    itself, to round-off. An experiment that raises an `AdaptctlError`, an `ArithmeticError` or NumPy's `LinAlgError`
    before it runs, such as `NotFoundError` for a name in `controllers` that none of its own has, has one outcome,
    "failed" with the error's message, under the empty name "". Where the simulation of a batch raises one of these, its
    experiments are left out in double precision, so that each can be run by itself, and have "failed" outcomes under
    their controllers' names in single. Other errors are not caught.
    """
    if not all(isinstance(one, Learning) for one in experiments):
        return {}
    outcomes: RunOutcomes = {}
    trials: dict[int, BatchedRun] = {}
    known: Begun = {}
    for k, one in enumerate(experiments):
        try:
            trial = _trial(one, controllers, known)  # type: ignore[arg-type]  # each is a Learning
        except FAILURES as error:
            outcomes[k] = [("", RunOutcome.failed(error))]
        else:
            trials |= {} if trial is None else {k: trial}
    groups: dict[Any, list[tuple[int, int]]] = {}
    for k, trial in trials.items():
        for c, contender in enumerate(trial.contenders):
            groups.setdefault(_group(trial, contender), []).append((k, c))
    found: dict[tuple[int, int], RunOutcome] = {}
    for places in groups.values():
        found |= _tried(trials, places, precision)
    for k, trial in trials.items():
        if all((k, c) in found for c in range(len(trial.contenders))):
            outcomes[k] = [(one.name, found[k, c]) for c, one in enumerate(trial.contenders)]
    return outcomes


def begun(experiment: Learning, mechanism: Mechanism, known: Begun) -> tuple[Episode, Any]:
    """The initial `Episode` of an `experiment` on a `mechanism`, its plant, state, true parameters and reference after
    a reset with the experiment's seed and options; and the environment that it is of, without wrappers.

    Experiments whose class has a method `task` beside the method `environment`, which says all that an environment is
    made of, share an environment with those of an equal task in `known`, which is filled: it is made and reset once,
    and their episodes differ only in what the arm holds. Raises what an environment raises, such as `InputError` for
    another number of joints.
    """
    kind = type(experiment)
    if _home(kind, "task") is not _home(kind, "environment") or experiment.options.keys() - WHAT_IS_HELD:
        return _reset(experiment, mechanism)
    key = mechanism, experiment.task(mechanism)  # type: ignore[attr-defined]  # it has one: see above
    if key not in known:
        known[key] = _reset(experiment, mechanism)
    episode, env = known[key]
    return episode._replace(parameters=env.true_parameters(experiment.options)), env


def _home(kind: type, name: str) -> type | None:
    """The class that defines a method."""
    return next((one for one in kind.__mro__ if name in vars(one)), None)


def _reset(experiment: Learning, mechanism: Mechanism) -> tuple[Episode, Any]:
    env: Any = experiment.environment(mechanism)
    return env.unwrapped.episode(seed=experiment.seed, options=experiment.options), env.unwrapped


def _trial(experiment: Learning, controllers: Sequence[str], known: Begun) -> BatchedRun | None:
    """The run of an experiment with these controllers; None where it cannot be one of many at once. Raises what the
    experiment raises."""
    own = type(experiment).mechanism is not Learning.mechanism
    mechanism = interned(experiment.mechanism()) if own else robot(experiment.robot)
    chosen = named(experiment.contenders(mechanism, offline(mechanism)), controllers)
    episode, env = begun(experiment, mechanism, known)
    plant, reference = episode.plant, episode.reference
    simple = not plant.effects and isinstance(reference, Sinusoids) and plant.mechanism.continuation is None
    if not simple or any(one.controller.reference_size != plant.dof for one in chosen):
        return None
    return BatchedRun(chosen, episode, env)


Some = TypeVar("Some", Contender, ControllerRun)


def named(candidates: Sequence[Some], names: Sequence[str]) -> list[Some]:
    """List of those `candidates` whose name is among `names`, in the candidates' order; all where `names` is empty.
    Repeated names count once. Raises `NotFoundError`, with the names that exist, for a name that no candidate has."""
    known = [one.name for one in candidates]
    for name in names:
        if name not in known:
            raise NotFoundError(f"there is no controller {name!r}; there are: {', '.join(known)}")
    return [one for one in candidates if not names or one.name in names]


@lru_cache(maxsize=8)
def offline(mechanism: Mechanism) -> FundamentalBasis:
    """Fundamental (base) parameters of a `mechanism`, a `FundamentalBasis`, found from energies at random states.
    Results for the last 8 mechanisms are cached. Raises `RankError` where the number of identifiable parameters cannot
    be certified."""
    return fundamental_basis(essential_space(mechanism))


@lru_cache(maxsize=64)
def robot(source: str) -> Mechanism:
    """The `Mechanism` loaded from `source`, a built-in robot's name or a file (.urdf, .xml, .toml). The last 64 are
    cached by `source`, so that a file that has changed is not read again. Raises `NotFoundError` for an unknown name,
    `FileError` for a file that cannot be used."""
    return interned(load(source))


_MECHANISMS: dict[tuple[str, str], Mechanism] = {}


def interned(mechanism: Mechanism) -> Mechanism:
    """The first `Mechanism` passed to this function whose description, and linear constraints on parameters, equal
    those of `mechanism`; `mechanism` itself where there was none. Runs on equal mechanisms then share compiled code. At
    most 65 are kept; the call after that clears them. Nothing is raised."""
    if len(_MECHANISMS) > 64:
        _MECHANISMS.clear()
    return _MECHANISMS.setdefault((mechanism.description.sha256, mechanism.geometry_sha256), mechanism)


def _group(trial: BatchedRun, contender: Contender) -> Any:
    """Equal for what can run together."""
    episode, bound = trial.episode, trial.env.error_bound
    waves = np.shape(getattr(episode.reference, "amplitude", ()))
    return contender.controller.structure, episode.plant.structure, episode.steps, bound.tobytes(), waves


def _tried(
    trials: Mapping[int, BatchedRun], places: Sequence[tuple[int, int]], precision: Precision
) -> dict[tuple[int, int], RunOutcome]:
    """Outcomes of trials' contenders that can run together. Where they fail together, nobody knows which of them does:
    there are none in double, in which each can run by itself, and failed ones in single, in which none can."""
    episodes = [trials[k].episode for k, _ in places]
    plant = episodes[0].plant
    try:
        runs = simulate_many(
            plant,
            [trials[k].contenders[c].controller for k, c in places],
            [one.reference for one in episodes],
            duration=episodes[0].steps * plant.control_period,
            parameters=np.stack([one.parameters for one in episodes]),
            p=np.stack([one.state.p for one in episodes]),
            v=np.stack([one.state.v for one in episodes]),
            every=None,
            beyond=trials[places[0][0]].env.error_bound,
            precision=precision,
        )
    except FAILURES as error:
        return {} if precision == "double" else dict.fromkeys(places, RunOutcome.failed(error))
    return dict(zip(places, RunOutcome.each_of(runs), strict=True))


def _known(value: float) -> float | None:
    """The number, or None where there is none."""
    return value if math.isfinite(value) else None
