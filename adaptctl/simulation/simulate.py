"""What `rollout` does, in native code: controller and plant together, thousands of control periods a call."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from adaptctl.arrays import Array, frozen
from adaptctl.compilation.limits import LARGEST_COMPILED
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.errors import NonFiniteError, NotCompiledWarning
from adaptctl.simulation.closed_loop import ClosedLoop, Sample
from adaptctl.simulation.episode import Episode
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.plant_state import PlantState
from adaptctl.simulation.rollout import interface, known_steps, rollout
from adaptctl.simulation.run import Rollout
from adaptctl.simulation.sampled_references import REFERENCE, sampled

if TYPE_CHECKING:
    import gymnasium

CHUNK, LONGEST = 2000, 10_000
"""Control periods in one native call: at least, if the run is as long, and at most."""


def simulate(
    env: gymnasium.Env[Any, Any],
    controller: Controller[Any],
    *,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
    progress: Callable[[float], object] | None = None,
) -> Rollout:
    """What `rollout` returns for the same arguments, to round-off, computed in native code as a whole.

    Controller, effects and plant are compiled into one step, which is taken thousands of times in each call;
    in between `progress` is called, with the share done, and Ctrl-C is heard, which keeps what was computed. The
    environment is left where `rollout` leaves it.

    It takes a `TrackingEnv`, or another environment that hands over its `Episode`, in no wrappers but those of
    `gymnasium.make`; a controller whose torque is that of its `law`; and at most LARGEST_COMPILED links. Anything else
    is driven by `rollout`, with a `NotCompiledWarning` that says why. Raises what `rollout` raises.
    """
    _, period = interface(env, controller)
    if reason := _obstacle(env, controller):
        warnings.warn(f"simulate: {reason}: rollout drives it, step by step", NotCompiledWarning, stacklevel=2)
        return rollout(env, controller, seed=seed, options=options, progress=progress)
    env.reset(seed=seed, options=options)
    episode: Episode = env.unwrapped.hand_over()  # type: ignore[attr-defined]
    run = _NativeRun(episode, controller, min(episode.steps, known_steps(env) or episode.steps), period)
    complete, started = False, perf_counter()
    try:
        while not run.over:
            run.advance()
            if progress is not None:
                progress(run.count / run.steps)
        complete = True
    except KeyboardInterrupt:
        pass
    return run.result(env.unwrapped, perf_counter() - started, complete)


def _obstacle(env: gymnasium.Env[Any, Any], controller: Controller[Any]) -> str:
    """Why an environment and a controller cannot be compiled together; nothing when they can."""
    from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit

    wrapper, inner = env, env.unwrapped
    while wrapper is not inner:
        if type(wrapper) not in (OrderEnforcing, PassiveEnvChecker, TimeLimit):
            return f"what {type(wrapper).__name__} does to the environment is not known"
        if isinstance(wrapper, TimeLimit) and env.spec is None:
            return "the time limit is not told"
        wrapper = wrapper.env  # type: ignore[attr-defined]
    if not hasattr(inner, "hand_over"):
        return f"{type(inner).__name__} has no hand_over() for its episode"
    if type(controller).step is not Controller.step:
        return f"{type(controller).__name__} has a step of its own"
    if _home_of(inner, "step") is not _home_of(inner, "hand_over"):
        return f"{type(inner).__name__} has a step of its own"
    if type(inner.plant).step is not Plant.step:  # type: ignore[attr-defined]
        return f"{type(inner.plant).__name__} has a step of its own"  # type: ignore[attr-defined]
    links = len(inner.plant.mechanism.links)  # type: ignore[attr-defined]
    return f"{links} links are too many to compile" if links > LARGEST_COMPILED else ""


def _home_of(thing: object, method: str) -> type | None:
    """The class that has a method's code."""
    return next((kind for kind in type(thing).__mro__ if method in vars(kind)), None)


class _NativeRun:
    """A run in the making."""

    def __init__(self, episode: Episode, controller: Controller[Any], steps: int, period: float) -> None:
        self.loop, self.episode = ClosedLoop(episode.plant, controller), episode
        self.steps, self.period = steps, period
        self.arms = self.loop.compiled().ensemble(1)
        self.loop.begin(self.arms, episode.state, controller.init(*_measured(episode.state)))
        self.sample = Sample(*(np.empty((steps, *shape)) for shape in self.arms.stepper.outputs))
        self.reference = ReferencePoint(*np.empty((3, steps, controller.reference_size)))
        self.reward, self.payload = np.empty((2, steps))
        self.count, self.end, self.terminated = 0, episode.state, False

    @property
    def over(self) -> bool:
        """Whether the environment ended the run, or its time is up."""
        return self.terminated or self.count >= self.steps

    def advance(self) -> None:
        """One stretch, in which the true parameters stay as they are; it counts when all of it is done."""
        time, place = self._times(), self._place()
        reference = sampled(self.episode.reference, time, self.loop.controller.reference_size)
        self.arms.held["parameters"] = self._parameters(time[0])
        sample = self._taken(len(time) - 1, reference)
        reward, over = self._judged(sample, reference)
        count = len(reward)
        if count < len(time) - 1:
            self._return(place)
            sample = self._taken(count, reference)
            if not over:
                self._fail(time[count], ReferencePoint(*(part[count] for part in reference)))
        self._keep(time[: count + 1], sample, reference, reward)
        self.count, self.end, self.terminated = self.count + count, self._reached(time[count], sample), over

    def _keep(self, time: Array, sample: Sample, reference: ReferencePoint, reward: Array) -> None:
        """Put samples at all times but the last in their place."""
        new, plant = slice(self.count, self.count + len(reward)), self.episode.plant
        for kept, part in zip((*self.sample, *self.reference), (*sample, *reference), strict=True):
            kept[new] = part[: len(reward)]
        self.reward[new], self.payload[new] = reward, plant.payload(time[0])
        self.payload[new.stop - 1] = plant.payload(time[-1])

    def _reached(self, time: float, sample: Sample) -> PlantState:
        """The plant after the last sample."""
        end, _ = self.loop.now(self.arms, time)
        marks = sample.marks[-1, : len(self.episode.plant.marks)]
        return end._replace(applied=sample.applied[-1], clipped=bool(sample.clipped[-1, 0]), marks=marks)

    def _judged(self, sample: Sample, reference: ReferencePoint) -> tuple[Array, bool]:
        """The rewards of the control periods until the environment ends the run, which is then told, or until
        something is not finite."""
        q, v = (np.concatenate((getattr(sample, name)[1:], self.arms.state[name])) for name in ("q", "v"))
        sound = _finite(sample.torque, q, v)
        ahead = ReferencePoint(*(part[1 : sound + 1] for part in reference))
        reward, over = self.episode.judge(q[:sound], v[:sound], ahead, sample.applied[:sound])
        return (reward[: int(over.argmax()) + 1], True) if over.any() else (reward, False)

    def _times(self) -> Array:
        """The times of the next stretch and its end: as long as nothing changes, in one call's length."""
        first = self.count
        longest = min(LONGEST, max(CHUNK, self.steps // 100), self.steps - first)
        times = self.period * np.arange(first, first + longest + 1)
        same = int(np.searchsorted(times, self.episode.plant.until(times[0])))
        return np.asarray(times[: max(1, min(same, longest)) + 1])

    def _parameters(self, time: float) -> Array:
        return self.episode.plant.parameters(self.episode.parameters, time)

    def _taken(self, count: int, reference: ReferencePoint) -> Sample:
        """So many control periods."""
        noise = self.episode.rng.standard_normal((count, self.loop.noise["noise"]))
        signals = {name: part[:count] for name, part in zip(REFERENCE, reference, strict=True)} | {"noise": noise}
        return Sample(*(values[:, 0] for values in self.arms.run(count, signals, record=True)))

    def _place(self) -> tuple[Array, Any]:
        """Where the run is, to return there."""
        return self.arms.state.blocks.copy(), self.episode.rng.bit_generator.state

    def _return(self, place: tuple[Array, Any]) -> None:
        self.arms.state.blocks[...], self.episode.rng.bit_generator.state = place

    def _fail(self, time: float, reference: ReferencePoint) -> NoReturn:
        """Raise what the controller or the plant raises when they step from here."""
        plant, controller = self.episode.plant, self.loop.controller
        state, memory = self.loop.now(self.arms, time)
        torque, _ = controller.step(memory, *_measured(state), reference)
        plant.step(state, torque, self._parameters(time))
        raise NonFiniteError(f"the closed loop is not finite after {time:g} s")

    def result(self, env: Any, wall_time: float, complete: bool) -> Rollout:
        """The run so far; the environment is taken there."""
        sample, reference = Sample(*map(self._kept, self.sample)), ReferencePoint(*map(self._kept, self.reference))
        clipped, plant = sample.clipped[:, 0], self.episode.plant
        p = frozen(plant.positions(sample.q))
        told = (sample.measured_p, sample.measured_v) if plant.noise_size else (p, sample.v)
        return Rollout(
            time=frozen(np.asarray(self.period * np.arange(self.count))),
            p=p,
            v=sample.v,
            reference_p=reference.p,
            reference_v=reference.v,
            reference_a=reference.a,
            torque=sample.torque,
            applied=sample.applied,
            clipped=clipped,
            energy=sample.energy[:, 0],
            reward=self._kept(self.reward),
            estimate=sample.estimate,
            control_period=self.period,
            wall_time=wall_time,
            complete=complete,
            terminated=self.terminated,
            info=env.take_back(self.end, self.count, int(clipped.sum()), self.terminated),
            measured_p=told[0] if plant.effects else None,
            measured_v=told[1] if plant.effects else None,
            marks=self._marks(sample.marks),
        )

    def _marks(self, values: Array) -> Mapping[str, Array]:
        """By name, in the order in which `rollout` tells them."""
        own, by_name = self.episode.plant, dict(zip(self.loop.marks, values.T, strict=True))
        loaded = {"payload": self._kept(self.payload)} if own.loads else {}
        return MappingProxyType({name: by_name[name] for name in own.marks} | loaded | by_name)

    def _kept(self, values: Array) -> Array:
        """The samples so far, and no memory for more."""
        return frozen(values if self.count == self.steps else values[: self.count].copy())


def _measured(state: PlantState) -> tuple[Array, Array]:
    return state.measured_p, state.measured_v


def _finite(torque: Array, q: Array, v: Array) -> int:
    """How many of the control periods pass before a torque or a state (T, ...) is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.vecdot(torque, torque) + np.vecdot(q, q) + np.vecdot(v, v)
    faulty = ~np.isfinite(squares)
    return int(faulty.argmax()) if faulty.any() else len(faulty)
