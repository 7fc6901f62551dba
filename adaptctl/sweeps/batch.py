"""Runs that share a mechanism and a law, computed together in native code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from adaptctl.compilation.lanes import Precision
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import NotFoundError
from adaptctl.experiments.contest import Contender
from adaptctl.experiments.experiment import Experiment
from adaptctl.experiments.learning import Learning
from adaptctl.identifiability import FundamentalBasis, essential_space, fundamental_basis
from adaptctl.simulation import simulate_many
from adaptctl.sweeps.episodes import BegunEpisode, Episodes
from adaptctl.sweeps.outcome import FAILURES, RunOutcome

RunOutcomes = dict[int, list[tuple[str, RunOutcome]]]


class BatchedRun(NamedTuple):
    """Named tuple of what one run of an experiment needs to be simulated in a batch with others: `contenders`, the
    controllers to compare, a `Contender` each (name, label and controller), and `begun`, a `BegunEpisode`, the tracking
    episode in its initial state that each of them drives. Nothing is checked."""

    contenders: list[Contender]
    begun: BegunEpisode


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
    trials: dict[int, BatchedRun] = {}
    episodes = Episodes()
    outcomes: RunOutcomes = {}
    for k, one in enumerate(experiments):
        try:
            trial = _trial(one, controllers, episodes)  # type: ignore[arg-type]  # each is a Learning
        except FAILURES as error:
            outcomes[k] = [("", RunOutcome.failed(error))]
            continue
        if trial is not None:
            trials[k] = trial
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


def _trial(experiment: Learning, controllers: Sequence[str], episodes: Episodes) -> BatchedRun | None:
    """The run of an experiment with these controllers; None where it cannot be one of many at once. Raises what the
    experiment raises."""
    mechanism = _loaded(experiment)
    chosen = named(experiment.contenders(mechanism, offline(mechanism)), controllers)
    begun = episodes.of(experiment, mechanism)
    plant, reference = begun.episode.plant, begun.episode.reference
    simple = not plant.effects and isinstance(reference, Sinusoids) and plant.mechanism.continuation is None
    if not simple or any(one.controller.reference_size != plant.dof for one in chosen):
        return None
    return BatchedRun(chosen, begun)


class NamedRun(Protocol):
    """Protocol of objects with a `name`, such as contenders or recorded runs, among which the function `named` selects.
    Nothing is checked."""

    @property
    def name(self) -> str:
        """Name of the controller that the object stands for, a text that an implementation must return: unique among
        the objects to select from."""
        ...


Some = TypeVar("Some", bound=NamedRun)


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


def _loaded(experiment: Learning) -> Mechanism:
    """The mechanism of an experiment: read once where it is that of its robot."""
    if type(experiment).mechanism is Learning.mechanism:
        return robot(experiment.robot)
    return interned(experiment.mechanism())


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
    episode, bound = trial.begun.episode, trial.begun.error_bound
    waves = np.shape(getattr(episode.reference, "amplitude", ()))
    return contender.controller.structure, episode.plant.structure, episode.steps, bound.tobytes(), waves


def _tried(
    trials: Mapping[int, BatchedRun], places: Sequence[tuple[int, int]], precision: Precision
) -> dict[tuple[int, int], RunOutcome]:
    """Outcomes of trials' contenders that can run together. Where they fail together, nobody knows which of them does:
    there are none in double, in which each can run by itself, and failed ones in single, in which none can."""
    try:
        return _together(trials, places, precision)
    except FAILURES as error:
        return {} if precision == "double" else dict.fromkeys(places, RunOutcome.failed(error))


def _together(
    trials: Mapping[int, BatchedRun], places: Sequence[tuple[int, int]], precision: Precision
) -> dict[tuple[int, int], RunOutcome]:
    """Outcomes of trials' contenders that can run together."""
    chosen = [trials[k].contenders[c].controller for k, c in places]
    begun = [trials[k].begun for k, _ in places]
    episodes, plant = [one.episode for one in begun], begun[0].episode.plant
    runs = simulate_many(
        plant,
        chosen,
        [one.reference for one in episodes],
        duration=episodes[0].steps * plant.control_period,
        parameters=np.stack([one.parameters for one in episodes]),
        p=np.stack([one.state.p for one in episodes]),
        v=np.stack([one.state.v for one in episodes]),
        every=None,
        beyond=begun[0].error_bound,
        precision=precision,
    )
    return dict(zip(places, RunOutcome.each_of(runs), strict=True))
