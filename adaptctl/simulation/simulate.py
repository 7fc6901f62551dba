"""Simulation in native code: `rollout` with controller and plant compiled together, thousands of control periods a
call."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from adaptctl.arrays import Array, frozen
from adaptctl.compilation.floats import LARGEST_COMPILED
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.dynamics.joint_units import position_units
from adaptctl.errors import NonFiniteError, NotCompiledWarning
from adaptctl.simulation.closed_loop import ClosedLoop, Sample
from adaptctl.simulation.episode import Episode
from adaptctl.simulation.kept_samples import KeptSamples
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.plant_state import PlantState
from adaptctl.simulation.rollout import interface, known_steps, rollout
from adaptctl.simulation.rollout_file import KEPT, RolloutFile
from adaptctl.simulation.run import Rollout
from adaptctl.simulation.sampled_references import REFERENCE, sampled

if TYPE_CHECKING:
    import gymnasium

CHUNK, LONGEST = 2000, 10_000
"""Control periods in one native call: in the first, if the run is as long, and at most."""


def simulate(
    env: gymnasium.Env[Any, Any],
    controller: Controller[Any],
    *,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
    progress: Callable[[float], object] | None = None,
    every: int = 1,
    last: float | None = None,
    stream: str | Path | None = None,
) -> Rollout:
    """The run, a `Rollout`, of an environment driven by a controller, from reset to termination or truncation, computed
    in native code: to round-off what `rollout`, which goes step by step, returns for the same arguments.

    Controller, effects and plant are compiled into one step, which is taken thousands of times in each call; in between
    `progress`, if given, is called with the fraction done, 0 to 1, and Ctrl-C is heard, which keeps what was computed.
    The environment is left where `rollout` leaves it. `seed` and `options` are passed to `env.reset`, None for its own
    defaults.

    The run has a sample of one in `every` control periods, the first one included, and only those of its last `last`
    seconds, None for the whole run: however long it is, it takes no more memory than these. `stream` is the path of a
    Parquet file, None for none, to which all samples that `every` chooses are written as they come, also those before
    the `last`. It appears when the run ends, and `Rollout.load` reads it.

    It takes a `TrackingEnv`, or another environment that hands over its `Episode`, in no wrappers but those of
    `gymnasium.make`; a controller that has a `law` and no `step` of its own; and at most LARGEST_COMPILED (100) links.
    Anything else is driven by `rollout`, with a `NotCompiledWarning` that says why; `stream` then has only the samples
    of the run returned. Raises `InputError` for an environment that cannot be driven by this controller, an `every`
    that is not a whole number of at least 1, and a `last` that is not positive and finite; `NonFiniteError` where the
    motion becomes non-finite; and for `stream` `FileError` where it cannot be written, `MissingExtraError` without
    pyarrow.
    """
    _, period = interface(env, controller)
    if reason := _obstacle(env, controller):
        warnings.warn(f"simulate: {reason}: rollout drives it, step by step", NotCompiledWarning, stacklevel=2)
        run = rollout(env, controller, seed=seed, options=options, progress=progress, every=every, last=last)
        if stream is not None:
            run.save(stream)
        return run
    kept = KeptSamples.of(every, last, period)
    env.reset(seed=seed, options=options)
    episode: Episode = env.unwrapped.hand_over()  # type: ignore[attr-defined]
    steps = min(episode.steps, known_steps(env) or episode.steps)
    if stream is None:
        kind = _WholeRun if kept == KeptSamples() else _NativeRun
        return kind(episode, controller, steps, period, kept).driven(env.unwrapped, progress)
    native = _NativeRun(episode, controller, steps, period, kept)
    with RolloutFile(stream, controller.dof, None, position_units(episode.plant.mechanism)) as file:
        result = native.driven(env.unwrapped, progress, file)
        file.about = {name: getattr(result, name) for name in KEPT}
    return result


def _obstacle(env: gymnasium.Env[Any, Any], controller: Controller[Any]) -> str:
    """The reason why an environment and a controller cannot be compiled together; empty when they can."""
    from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit

    wrapper, inner = env, env.unwrapped
    while wrapper is not inner:
        if type(wrapper) not in (OrderEnforcing, PassiveEnvChecker, TimeLimit):
            return f"what {type(wrapper).__name__} does to the environment is not known"
        if isinstance(wrapper, TimeLimit) and env.spec is None:
            return "the time limit is not known"
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
    """A run in the making, of which some samples are kept."""

    def __init__(
        self, episode: Episode, controller: Controller[Any], steps: int, period: float, kept: KeptSamples
    ) -> None:
        self.loop, self.episode = ClosedLoop(episode.plant, controller), episode
        self.steps, self.period, self.kept = steps, period, kept
        self.arms = self.loop.compiled().ensemble(1)
        self.loop.begin(self.arms, episode.state, controller.init(*_measured(episode.state)))
        self.samples: dict[str, Array] = {}
        self.file: RolloutFile | None = None
        self.room, self.signals = self.arms.room(self._longest + 1), self.arms.signals(self._longest + 1)
        self.sample = Sample(*map(self.room.view, self.room.columns))
        self.count, self.clips, self.terminated = 0, 0, False
        self.place, self.end = self._place(), episode.state

    def driven(self, env: Any, progress: Callable[[float], object] | None, file: RolloutFile | None = None) -> Rollout:
        """The run to its end, or to Ctrl-C."""
        complete, started, self.file = False, perf_counter(), file
        try:
            while not self.over:
                self.advance()
                if progress is not None:
                    progress(self.count / self.steps)
            complete = True
        except KeyboardInterrupt:
            pass
        return self.result(env, perf_counter() - started, complete)

    @property
    def _longest(self) -> int:
        """Control periods that there is room for at once."""
        return min(LONGEST, self.steps)

    @property
    def _stretch(self) -> int:
        """Control periods of the next native call, at most: few at first, for a run may soon be over."""
        return min(LONGEST, max(CHUNK, 4 * self.count))

    @property
    def _first(self) -> int:
        """Index in the buffer where the next control periods are recorded."""
        return 0

    @property
    def over(self) -> bool:
        """True if the environment ended the run, or its time is up."""
        return self.terminated or self.count >= self.steps

    def advance(self) -> None:
        """One stretch, in which the true parameters stay as they are; it counts when all of it is done."""
        time = self._times()
        reference = self._reference(time)
        self.arms.held["parameters"] = self._parameters(time[0])
        sample = self._taken(len(time) - 1)
        reward, over = self._judged(sample, reference)
        count = len(reward)
        if count < len(time) - 1:
            self._return()
            sample = self._taken(count)
            if not over:
                self._fail(time[count], ReferencePoint(*(part[count] for part in reference)))
        self._keep(time[: count + 1], sample, reference, reward)
        end, place = self._last(time[count], sample), self._place()
        self.count, self.end, self.place, self.terminated = self.count + count, end, place, over

    def _keep(self, time: Array, sample: Sample, reference: ReferencePoint, reward: Array) -> None:
        """Keep the samples, of all times but the last, that are to be kept."""
        count = len(reward)
        chosen = self.kept.among(self.count, count)
        columns = {name: values[:count][chosen] for name, values in self._columns(time, sample, reference, reward)}
        rows = self.kept.rows(self.count, count)[-self.kept.room(self.steps) :]
        for name, values in columns.items():
            if name not in self.samples:
                self.samples[name] = np.empty((self.kept.room(self.steps), *values.shape[1:]))
            self.samples[name][rows] = values[len(values) - len(rows) :]
        self.clips += int(sample.clipped[:count].sum())
        if self.file is not None:
            marks = columns.pop("marks"), columns.pop("payload")
            self.file.append({"measured_p": None, "measured_v": None, **columns}, self._marks(*marks))

    def _nothing(self) -> tuple[Array, Sample, ReferencePoint, Array]:
        """Empty arrays in the form of what is kept of control periods."""
        sample = Sample(*(np.empty((0, *shape)) for shape in self.arms.stepper.outputs))
        size = self.loop.controller.reference_size
        return np.zeros(1), sample, ReferencePoint(*np.empty((3, 0, size))), np.empty(0)

    def _columns(
        self, time: Array, sample: Sample, reference: ReferencePoint, reward: Array
    ) -> Iterator[tuple[str, Array]]:
        """Samples of a stretch by their names in a `Rollout`."""
        plant, count = self.episode.plant, len(reward)
        p, payload = plant.positions(sample.q), np.full(count, plant.payload(time[0]))
        payload[-1:] = plant.payload(time[count])
        yield from (("time", time[:count]), ("p", p), ("v", sample.v), ("payload", payload), ("reward", reward))
        if plant.effects:
            measured = (sample.measured_p, sample.measured_v) if plant.noise_size else (p, sample.v)
            yield from zip(("measured_p", "measured_v"), measured, strict=True)
        yield from zip(("reference_p", "reference_v", "reference_a"), reference, strict=True)
        yield from ((name, getattr(sample, name)) for name in ("torque", "applied", "estimate", "marks", "learning"))
        yield from ((name, getattr(sample, name)[:, 0]) for name in ("clipped", "energy"))

    def _last(self, time: float, sample: Sample) -> PlantState:
        """The time after the last sample, and what that keeps of a plant's state; the rest is in `place`."""
        marks, clipped = sample.marks[-1, : len(self.episode.plant.marks)].copy(), bool(sample.clipped[-1, 0])
        return self.end._replace(time=time, applied=sample.applied[-1].copy(), clipped=clipped, marks=marks)

    def _reached(self) -> PlantState:
        """The plant's state at the end of all that counts, to which it returns from a stretch that was interrupted."""
        self._return()
        if not self.count:
            return self.end
        own = {name: getattr(self.end, name) for name in ("applied", "clipped", "marks")}
        return self.loop.now(self.arms, self.end.time)[0]._replace(**own)

    def _judged(self, sample: Sample, reference: ReferencePoint) -> tuple[Array, bool]:
        """Rewards of the control periods up to the end of the run or the first number that is not finite; and True if
        the environment ended it."""
        count, after = len(sample.q), slice(self._first + 1, self._first + len(sample.q) + 1)
        q, v = self.sample.q[after], self.sample.v[after]
        q[-1], v[-1] = self.arms.state["q"][0], self.arms.state["v"][0]
        sound = count if self._sound(count) else _finite(sample.torque, q, v)
        ahead = ReferencePoint(*(part[1 : sound + 1] for part in reference))
        reward, over = self.episode.judge(q[:sound], v[:sound], ahead, sample.applied[:sound])
        return (reward[: int(over.argmax()) + 1], True) if over.any() else (reward, False)

    def _sound(self, count: int) -> bool:
        """True only if all torques just recorded and the state after them are finite, and so the states before."""
        torque = self.sample.torque[self._first : self._first + count]
        with np.errstate(over="ignore", invalid="ignore"):
            return bool(np.isfinite(torque).all()) and math.isfinite(self.arms.state.blocks.sum())

    def _times(self) -> Array:
        """The times of the next stretch and its end: as long as nothing changes, in one call's length."""
        first = self.count
        longest = min(self._stretch, self.steps - first)
        times = self.period * np.arange(first, first + longest + 1)
        same = int(np.searchsorted(times, self.episode.plant.until(times[0])))
        return np.asarray(times[: max(1, min(same, longest)) + 1])

    def _parameters(self, time: float) -> Array:
        return self.episode.plant.parameters(self.episode.parameters, time)

    def _reference(self, time: Array) -> ReferencePoint:
        """The reference (T, r) at times (T,), put among the signals that the next control periods read."""
        size, rows = self.loop.controller.reference_size, slice(self._first, self._first + len(time))
        signals = self.signals.shared.blocks[rows, 0, : 3 * size, 0].reshape(-1, 3, size)
        return sampled(self.episode.reference, time, size, out=signals)

    def _taken(self, count: int) -> Sample:
        """Samples of the next `count` control periods, which are run."""
        rows, size = slice(self._first, self._first + count), self.loop.noise["noise"]
        if size:
            self.signals.shared.view("noise")[rows] = self.episode.rng.standard_normal((count, size))
        self.arms.record_into(self.room, self._first, count, self.signals)
        return Sample(*(part[rows] for part in self.sample))

    def _place(self) -> tuple[Array, Any]:
        """State of the run and of its noise, to return to."""
        return self.arms.state.blocks.copy(), self.episode.rng.bit_generator.state

    def _return(self) -> None:
        self.arms.state.blocks[...], self.episode.rng.bit_generator.state = self.place

    def _fail(self, time: float, reference: ReferencePoint) -> NoReturn:
        """Raise what the controller or the plant raises when they step from here."""
        plant, controller = self.episode.plant, self.loop.controller
        state, memory = self.loop.now(self.arms, time)
        torque, _ = controller.step(memory, *_measured(state), reference)
        plant.step(state, torque, self._parameters(time))
        raise NonFiniteError(f"the closed loop is not finite after {time:g} s")

    def result(self, env: Any, wall_time: float, complete: bool) -> Rollout:
        """The run so far; the environment is taken there."""
        columns = self._columns_kept()
        marks = columns.pop("marks"), columns.pop("payload")
        return Rollout(
            **columns,
            control_period=self.period,
            wall_time=wall_time,
            complete=complete,
            terminated=self.terminated,
            info=env.take_back(self._reached(), self.count, self.clips, self.terminated),
            marks=self._marks(*marks),
            every=self.kept.every,
            position_units=position_units(self.episode.plant.mechanism),
        )

    def _columns_kept(self) -> dict[str, Array]:
        """Samples that were kept, in order of time, by their names in a `Rollout`."""
        if not self.samples:  # interrupted at once
            self._keep(*self._nothing())
        order = self.kept.order(self.count)
        return {name: self._in_order(values, order) for name, values in self.samples.items()}

    def _in_order(self, values: Array, order: Any) -> Array:
        """The samples so far, and no memory for more."""
        whole = isinstance(order, slice) and order.stop == len(values)
        return frozen(values if whole else values[order].copy())

    def _marks(self, values: Array, payload: Array) -> Mapping[str, Array]:
        """Marks of the effects by name, in the order of `rollout`."""
        own, by_name = self.episode.plant, dict(zip(self.loop.marks, map(frozen, values.T), strict=True))
        loaded = {"payload": frozen(payload)} if own.loads else {}
        return MappingProxyType({name: by_name[name] for name in own.marks} | loaded | by_name)


class _WholeRun(_NativeRun):
    """A run in the making whose samples are all kept, recorded where they stay."""

    def __init__(
        self, episode: Episode, controller: Controller[Any], steps: int, period: float, kept: KeptSamples
    ) -> None:
        super().__init__(episode, controller, steps, period, kept)
        self.reference = ReferencePoint(*map(self.signals.shared.view, REFERENCE))
        self.reward, self.payload = np.empty((2, steps))

    @property
    def _longest(self) -> int:
        return self.steps

    @property
    def _first(self) -> int:
        return self.count

    def _keep(self, time: Array, sample: Sample, reference: ReferencePoint, reward: Array) -> None:
        """Put what is not recorded with the samples, of all times but the last, in its place."""
        new, plant = slice(self.count, self.count + len(reward)), self.episode.plant
        self.reward[new], self.payload[new] = reward, plant.payload(time[0])
        self.payload[new.stop - 1] = plant.payload(time[-1])
        self.clips += int(sample.clipped[: len(reward)].sum())

    def _columns_kept(self) -> dict[str, Array]:
        done = slice(0, self.count)
        time = np.asarray(self.period * np.arange(self.count + 1))
        sample, reference = Sample(*(x[done] for x in self.sample)), ReferencePoint(*(x[done] for x in self.reference))
        columns = dict(self._columns(time, sample, reference, self.reward[done])) | {"payload": self.payload}
        whole = self.count == self.steps
        return {name: frozen(x if whole else x[done].copy()) for name, x in columns.items()}


def _measured(state: PlantState) -> tuple[Array, Array]:
    return state.measured_p, state.measured_v


def _finite(torque: Array, q: Array, v: Array) -> int:
    """Number of control periods before a torque or a state (T, ...) is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.vecdot(torque, torque) + np.vecdot(q, q) + np.vecdot(v, v)
    faulty = ~np.isfinite(squares)
    return int(faulty.argmax()) if faulty.any() else len(faulty)
