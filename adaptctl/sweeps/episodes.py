"""Episodes of experiments at their beginning; those of one task share an environment."""

from __future__ import annotations

from typing import Any, NamedTuple

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.learning import Learning
from adaptctl.experiments.stated_task import SinusoidTask, StatedTask
from adaptctl.simulation import Episode

WHAT_IS_HELD = frozenset({"payload"})
"""Options of a reset that change an episode's true parameters alone."""


class BegunEpisode(NamedTuple):
    """An episode of a tracking environment in its initial state: `episode`, an `Episode`, its plant, state, true
    parameters (inertial and friction) and reference trajectory, and `env`, the environment without Gymnasium's
    wrappers. Nothing is checked."""

    episode: Episode
    env: Any

    @property
    def error_bound(self) -> Array:
        """Bounds (r,) of the magnitudes of position errors of r primary (independent) joints, rad (m if prismatic),
        beyond which the environment ends the episode."""
        bound: Array = self.env.error_bound
        return bound


class Episodes:
    """Cache of experiments' tracking environments after their reset, empty at first, from which the method `of` takes
    the initial episode of an experiment. Experiments with equal tasks on one mechanism share an environment, which is
    made and reset once; their episodes differ only in the arm's true inertial and friction parameters, such as by a
    payload. It keeps every environment and has no bound on their number. Nothing is checked at construction; `of`
    raises what an environment raises."""

    def __init__(self) -> None:
        self._known: dict[tuple[Mechanism, SinusoidTask], BegunEpisode] = {}

    def of(self, experiment: Learning, mechanism: Mechanism) -> BegunEpisode:
        """The initial episode of an `experiment` on a `mechanism`, a `BegunEpisode`: its plant, initial state, true
        parameters and reference, after a reset of the experiment's environment with the experiment's seed and options.
        Experiments with the same task and mechanism share an environment, which is reset once; one with another kind of
        environment, or with options other than a payload, gets its own. Raises what the environment raises, such as
        `InputError` for another number of joints."""
        if type(experiment).environment is not StatedTask.environment or experiment.options.keys() - WHAT_IS_HELD:
            return _begun(experiment, mechanism)
        key = mechanism, experiment.task(mechanism)  # type: ignore[attr-defined]  # as its environment tells
        if key not in self._known:
            self._known[key] = _begun(experiment, mechanism)
        episode, env = self._known[key]
        return BegunEpisode(episode._replace(parameters=env.true_parameters(experiment.options)), env)


def _begun(experiment: Learning, mechanism: Mechanism) -> BegunEpisode:
    """The episode of an experiment in an environment of its own."""
    env: Any = experiment.environment(mechanism)
    env.reset(seed=experiment.seed, options=experiment.options)
    return BegunEpisode(env.unwrapped.hand_over(), env.unwrapped)
