"""Simulation of one run in native code."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np

from adaptctl.arrays import Array, frozen
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.dynamics.joint_units import position_units
from adaptctl.errors import NonFiniteError, NotCompiledWarning, warn
from adaptctl.simulation.closed_loop import ClosedLoop, Driven, Episode, Sample, not_compiled
from adaptctl.simulation.period import PlantState
from adaptctl.simulation.references import REFERENCE, sampled
from adaptctl.simulation.repeated_runs import is_kept, repeated
from adaptctl.simulation.rollout import KeptSamples, interface, known_steps, stepped, warn_if_ended_early
from adaptctl.simulation.rollout_file import STORED_ENTRIES, RolloutFile
from adaptctl.simulation.run import Rollout

if TYPE_CHECKING:
    import gymnasium

FIRST_CHUNK, MAX_CHUNK = 2000, 10_000
"""control periods in the first and in any native call"""


def simulate(
    env: gymnasium.Env[Any, Any],
    controller: Controller[Any],
    *,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
    progress: Callable[[float], object] | None = None,
    record_every: int = 1,
    keep_last: float | None = None,
    stream: str | Path | None = None,
) -> Rollout:
    """
    Simulate a controller in an environment in native code for one episode.

    A `DivergedRunWarning` says where the environment ended it early, as an error exceeded its limit.

    The result equals that of `rollout` to round-off; what cannot be compiled runs by `rollout`, with a
    `NotCompiledWarning`.

    Parameters
    ----------
    env : gymnasium.Env
        A `TrackingEnv` of up to 100 links, or an environment with a `plant` and a method `episode`, in no wrappers but
        those of `gymnasium.make`.
    controller : Controller
        Controller with a `law` and no `step` of its own, for the environment's r joints.
    seed : int, optional
        Seed of `env.reset`. Default: its generator goes on.
    options : dict, optional
        Options of `env.reset`. Default: none.
    progress : callable, optional
        Called with the fraction done, 0 to 1.
    record_every : int, default 1
        Control periods from one sample to the next; 1 records all.
    keep_last : float, optional
        Length in s of the end of the run that is kept in memory. Default: the whole run.
    stream : str or Path, optional
        Parquet file for all samples, also those before `keep_last`; it appears when the run ends. Default: none.

    Returns
    -------
    Rollout
        The run; after Ctrl-C what was computed, with `interrupted` True.

    Raises
    ------
    InputError
        If the controller does not fit the environment, `record_every` is not a whole number of at least 1 or
        `keep_last` is not positive and finite.
    NonFiniteError
        If the motion becomes NaN or infinite.
    FileError
        If `stream` cannot be written.
    MissingExtraError
        If `stream` is given and pyarrow is not installed.

    Notes
    -----
    Afterwards the environment must be reset; its generator is where `rollout` leaves it.

    Examples
    --------
    >>> run = adaptctl.simulate(env, law, seed=0)
    >>> run.p.shape
    (200, 2)
    """
    how: Any = {"seed": seed, "options": options, "progress": progress}
    run = simulated(env, controller, **how, record_every=record_every, keep_last=keep_last, stream=stream)
    warn_if_ended_early(run, "simulate")
    return run


def simulated(
    env: gymnasium.Env[Any, Any],
    controller: Controller[Any],
    *,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
    progress: Callable[[float], object] | None = None,
    record_every: int = 1,
    keep_last: float | None = None,
    stream: str | Path | None = None,
    once: bool = False,
) -> Rollout:
    """Simulate as `simulate` does, without a word on a run that diverged; `once` with code that is made for one run."""
    _, period = interface(env, controller)
    kept = KeptSamples.of(record_every, keep_last, period)
    try:
        episode = _episode(env, controller, seed, options)
    except NotImplementedError as reason:
        warn(f"simulate: {reason}: running step by step with rollout", NotCompiledWarning)
        run = stepped(
            env,
            controller,
            seed=seed,
            options=options,
            progress=progress,
            record_every=record_every,
            keep_last=keep_last,
        )
        if stream is not None:
            run.save(stream)
        return run
    episode = episode._replace(steps=min(episode.steps, known_steps(env) or episode.steps))
    if stream is None:
        return EpisodeRun(episode, controller, kept, once=once).driven(progress)
    with RolloutFile(stream, controller.dof, None, position_units(episode.plant.mechanism)) as file:
        result = EpisodeRun(episode, controller, kept, file).driven(progress)
        file.about = {name: getattr(result, name) for name in STORED_ENTRIES}
    return result


def _episode(
    env: gymnasium.Env[Any, Any], controller: Controller[Any], seed: int | None, options: dict[str, Any] | None
) -> Episode:
    """Episode of an environment; `NotImplementedError` if it cannot be compiled."""
    from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit

    wrapper, inner = env, env.unwrapped
    while wrapper is not inner:
        if type(wrapper) not in (OrderEnforcing, PassiveEnvChecker, TimeLimit):
            raise NotImplementedError(f"the wrapper {type(wrapper).__name__} is not supported")
        if isinstance(wrapper, TimeLimit) and env.spec is None:
            raise NotImplementedError("the time limit is unknown")
        wrapper = wrapper.env  # type: ignore[attr-defined]
    if not (hasattr(inner, "episode") and hasattr(inner, "plant")):
        raise NotImplementedError(f"{type(inner).__name__} has no plant and no episode()")
    if reason := not_compiled(inner.plant, controller):
        raise NotImplementedError(reason)
    episode: Episode = inner.episode(seed=seed, options=options)
    return episode


class Stretch(NamedTuple):
    """Control periods of one native call, with n + 1 times."""

    time: Array
    sample: Sample
    reference: ReferencePoint
    reward: Array
    payload: Array


class EpisodeRun(Driven):
    """Native run of an `episode` under a `controller`."""

    def __init__(
        self,
        episode: Episode,
        controller: Controller[Any],
        kept: KeptSamples = KeptSamples(),  # noqa: B008  # frozen
        file: RolloutFile | None = None,
        *,
        once: bool = False,
    ) -> None:
        self.loop, self.episode, self.kept, self.file = ClosedLoop(episode.plant, controller), episode, kept, file
        self.steps, self.control_period = episode.steps, episode.plant.control_period
        self.arms = self.loop.compiled(self.steps if once else math.inf).ensemble(1)
        self.loop.set_state(self.arms, episode.state, controller.init(*_measured(episode.state)))
        self.whole = file is None and kept == KeptSamples()  # then the buffers are the result, and nothing is copied
        self.longest = self.steps if self.whole else min(MAX_CHUNK, self.steps)
        self.records, self.signals = (
            self.arms.allocate_outputs(self.longest + 1),
            self.arms.signals(self.longest + 1),
        )
        self.recorded = Sample(*map(self.records.view, self.records.columns))
        self.samples = {name: np.empty(self.kept.room(self.steps)) for name in ("reward", "payload")}
        self._count, self.clips, self.terminated = 0, 0, False
        self.place, self.end = self._place(), episode.state
        self.lost: float | None = None
        self.earlier = 0.0  # computing time (s) of a run that is repeated

    def driven(self, progress: Callable[[float], object] | None = None) -> Rollout:
        """Run taken to its end, or to Ctrl-C."""
        seconds, complete = self.drive(progress)
        return self._result(seconds + self.earlier, complete)

    @property
    def count(self) -> int:
        """Number of valid control periods."""
        return self._count

    @property
    def over(self) -> bool:
        """True if the episode has ended."""
        return self.terminated or super().over

    def advance(self) -> Stretch:
        """Compute the next chunk, with constant true parameters."""
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
        payload = np.full(count, self.episode.plant.payload_mass(time[0]))
        payload[-1:] = self.episode.plant.payload_mass(time[count])
        stretch = Stretch(time[: count + 1], sample, reference, reward, payload)
        self._keep(stretch)
        end, place = self._last(time[count], sample), self._place()
        self._count, self.end, self.place, self.terminated = self.count + count, end, place, over
        return stretch

    @property
    def reached(self) -> PlantState:
        """Plant state at the end of all valid periods."""
        self._return()
        if not self.count:
            return self.end
        own = {name: getattr(self.end, name) for name in ("applied_torque", "clipped", "flags")}
        return self.loop.get_state(self.arms, self.end.time)[0]._replace(**own)

    @property
    def _first(self) -> int:
        """Buffer index of the next sample."""
        return self.count if self.whole else 0

    def _keep(self, stretch: Stretch) -> None:
        """Store those samples of a chunk not stored natively."""
        count, own = len(stretch.reward), self.kept.room(self.steps)
        chosen, rows = self.kept.among(self.count, count), self.kept.rows(self.count, count)[-own:]
        columns = {"reward": stretch.reward, "payload": stretch.payload} if self.whole else self._columns(stretch)
        columns = {name: values[:count][chosen] for name, values in columns.items()}
        for name, values in columns.items():
            if name not in self.samples:
                self.samples[name] = np.empty((own, *values.shape[1:]))
            self.samples[name][rows] = values[len(values) - len(rows) :]
        self.clips += int(stretch.sample.clipped[:count].sum())
        if self.file is not None:
            flags = columns.pop("flags"), columns.pop("payload")
            self.file.append({"measured_p": None, "measured_v": None, **columns}, self._flags(*flags))

    def _columns(self, stretch: Stretch) -> dict[str, Array]:
        plant, sample = self.episode.plant, stretch.sample
        names = "v", "torque", "applied", "estimate", "flags", "logged_state"
        columns = {name: getattr(sample, name) for name in names} | {"p": plant.positions(sample.q)}
        columns |= {"clipped": sample.clipped[:, 0], "energy": sample.energy[:, 0], "time": stretch.time[:-1]}
        columns |= {f"reference_{name}": part for name, part in stretch.reference._asdict().items()}
        if plant.effects:
            measured = (sample.measured_p, sample.measured_v) if plant.noise_size else (columns["p"], sample.v)
            columns |= zip(("measured_p", "measured_v"), measured, strict=True)
        return columns | {"reward": stretch.reward, "payload": stretch.payload}

    def _last(self, time: float, sample: Sample) -> PlantState:
        """Time and plant state after the last sample."""
        flags, clipped = sample.flags[-1, : len(self.episode.plant.flags)].copy(), bool(sample.clipped[-1, 0])
        return self.end._replace(time=time, applied_torque=sample.applied[-1].copy(), clipped=clipped, flags=flags)

    def _judged(self, sample: Sample, reference: ReferencePoint) -> tuple[Array, bool]:
        """Rewards of finite periods, and whether the episode ended."""
        count, after = len(sample.q), slice(self._first + 1, self._first + len(sample.q) + 1)
        q, v = self.recorded.q[after], self.recorded.v[after]
        q[-1], v[-1] = self.arms.state["q"][0], self.arms.state["v"][0]
        sound = count if self._sound(sample.torque) else _finite(sample.torque, q, v)
        ahead = ReferencePoint(*(part[1 : sound + 1] for part in reference))
        reward, over = self.episode.judge(q[:sound], v[:sound], ahead, sample.applied[:sound])
        return (reward[: int(over.argmax()) + 1], True) if over.any() else (reward, False)

    def _sound(self, torque: Array) -> bool:
        """True if all torques just recorded and the final state are finite."""
        with np.errstate(over="ignore", invalid="ignore"):
            return bool(np.isfinite(torque).all()) and math.isfinite(self.arms.state.blocks.sum())

    def _times(self) -> Array:
        """Times of the next chunk and its end."""
        kept = self.whole and is_kept(self.arms, self.steps)
        times = self.ahead(self.steps if kept else min(MAX_CHUNK, max(FIRST_CHUNK, 4 * self.count)))
        return np.append(times, self.control_period * (self.count + len(times)))

    def _parameters(self, time: float) -> Array:
        return self.episode.plant.parameters(self.episode.parameters, time)

    def _reference(self, time: Array) -> ReferencePoint:
        """Reference (T, r), written into the input signals."""
        size, rows = self.loop.controller.reference_size, slice(self._first, self._first + len(time))
        signals = self.signals.shared.blocks[rows, 0, : 3 * size, 0].reshape(-1, 3, size)
        return sampled(self.episode.reference, time, size, out=signals)

    def _taken(self, count: int) -> Sample:
        rows, size = slice(self._first, self._first + count), self.loop.noise["noise"]
        if size:
            self.signals.shared.view("noise")[rows] = self.episode.rng.standard_normal((count, size))
        if run := repeated(self.arms, count, self.signals) if self.whole and count == self.steps else None:
            self.records, self.earlier, self.arms.state.blocks[...] = run.outputs, run.seconds, run.last
            self.recorded = Sample(*map(self.records.view, self.records.columns))
        else:
            self.arms.record_into(self.records, self._first, count, self.signals)
        return Sample(*(part[rows] for part in self.recorded))

    def _place(self) -> tuple[Array, Any]:
        """State of the arm and of the random generator."""
        return self.arms.state.blocks.copy(), self.episode.rng.bit_generator.state

    def _return(self) -> None:
        self.arms.state.blocks[...], self.episode.rng.bit_generator.state = self.place

    def _fail(self, time: float, reference: ReferencePoint) -> NoReturn:
        """Raise the error of the first non-finite step."""
        plant, controller, self.lost = self.episode.plant, self.loop.controller, time
        state, memory = self.loop.get_state(self.arms, time)
        torque, _ = controller.step(memory, *_measured(state), reference)
        plant.step(state, torque, self._parameters(time))
        raise NonFiniteError(f"the closed loop diverged after {time:g} s")

    def _result(self, wall_time: float, complete: bool) -> Rollout:
        columns = self._kept()
        flags, state = (columns.pop("flags"), columns.pop("payload")), self.reached
        return Rollout(
            **columns,
            control_period=self.control_period,
            wall_time=wall_time,
            interrupted=not complete,
            terminated=self.terminated,
            info=self.episode.info(self.episode.parameters, state, self.count, self.clips, self._energy_reached()),
            flags=self._flags(*flags),
            every=self.kept.every,
            position_units=position_units(self.episode.plant.mechanism),
            joints=tuple(joint.name for joint in self.episode.plant.mechanism.primary_joints),
        )

    def _energy_reached(self) -> float:
        """Energy (J) at the end of all valid periods."""
        self.arms.held["parameters"] = self._parameters(self.end.time)
        self.arms.record_into(self.records, self._first, 1, self.signals)
        return float(self.recorded.energy[self._first, 0])

    def _kept(self) -> dict[str, Array]:
        """Stored columns in order, copied if the buffer is not full."""
        columns, order = self.samples, self.kept.order(self.count)
        if self.whole or not self.count:  # where nothing was computed yet, there is nothing else
            columns = self._columns(self._recorded(slice(0, self.count)))
        full = isinstance(order, slice) and self.count == self.steps
        return {name: frozen(values if full else values[order].copy()) for name, values in columns.items()}

    def _recorded(self, done: slice) -> Stretch:
        time = np.asarray(self.control_period * np.arange(done.start, done.stop + 1))
        reference = ReferencePoint(*(self.signals.shared.view(name)[done] for name in REFERENCE))
        sample, own = Sample(*(part[done] for part in self.recorded)), (self.samples["reward"], self.samples["payload"])
        return Stretch(time, sample, reference, *(values[done] for values in own))

    def _flags(self, values: Array, payload: Array) -> Mapping[str, Array]:
        own, by_name = self.episode.plant, dict(zip(self.loop.flags, map(frozen, values.T), strict=True))
        loaded = {"payload": frozen(payload)} if own.loads else {}
        return MappingProxyType({name: by_name[name] for name in own.flags} | loaded | by_name)


def _measured(state: PlantState) -> tuple[Array, Array]:
    return state.measured_p, state.measured_v


def _finite(torque: Array, q: Array, v: Array) -> int:
    """Number of first samples with finite torque and next state."""
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.vecdot(torque, torque) + np.vecdot(q, q) + np.vecdot(v, v)
    faulty = ~np.isfinite(squares)
    return int(faulty.argmax()) if faulty.any() else len(faulty)
