"""A controller in closed loop with a Gymnasium environment, start to end."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, frozen
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import position_units
from adaptctl.errors import InputError, validate_kind
from adaptctl.simulation.closed_loop import guards
from adaptctl.simulation.references import REFERENCE
from adaptctl.simulation.run import Rollout

if TYPE_CHECKING:
    import gymnasium


MOST = 2**62
"""Greatest number of samples that are kept, however long the time asked for: no run has as many."""


@dataclass(frozen=True)
class KeptSamples:
    """Rule for the control periods of a run that are kept as samples: those of indices 0, `every`, 2 `every`, ..., all
    by default (`every` 1). Of these only the latest `most` are kept, or all where that is None, the default.

    Samples are kept in the rows of an array, which is filled from row 0; when all `most` rows are filled, the oldest is
    overwritten. Nothing is checked at construction; `KeptSamples.of` checks.
    """

    every: int = 1
    most: int | None = None

    @classmethod
    def of(cls, every: int, last: float | None, period: float) -> KeptSamples:
        """The `KeptSamples`, a rule for keeping the control periods of indices 0, `every`, 2 `every`, ... of a run as
        samples: those of its last `last` seconds, at least one sample, or all where `last` is None. `period` (s) is the
        control period, which is not checked. Raises `InputError` for an `every` that is not an int of at least 1, and
        for a `last` that is not a positive finite number."""
        if isinstance(every, bool) or not isinstance(every, int) or every < 1:
            raise InputError(f"record_every: expected a whole number of control periods, at least 1, got {every!r}")
        if last is None:
            return cls(every)
        if isinstance(last, bool) or not isinstance(last, int | float) or not 0.0 < last < np.inf:
            raise InputError(f"keep_last: expected a positive time in s, got {last!r}")
        return cls(every, max(1, round(min(last / (every * period), MOST))))

    def room(self, steps: int) -> int:
        """Number of rows, one for each kept sample, that the array of samples of a run of `steps` control periods
        needs: `steps` divided by the rule's `every`, rounded up, and at most its `most`. Nothing is checked."""
        needed = -(-steps // self.every)
        return needed if self.most is None else min(needed, self.most)

    def row(self, period: int) -> int | None:
        """The index of the row in which the sample of control period `period`, counted from 0, is kept; None where it
        is not kept, since `period` is no multiple of the rule's `every`. Nothing is checked."""
        sample, rest = divmod(period, self.every)
        return None if rest else sample if self.most is None else sample % self.most

    def among(self, first: int, count: int) -> slice:
        """The slice that selects the control periods to be kept from an array with a row for each of `count` successive
        control periods: those whose zero-based index in the run is a multiple of the rule's `every`. `first` is the
        index of the first period in the run. Nothing is checked."""
        return slice(-first % self.every, count, self.every)

    def rows(self, first: int, count: int) -> NDArray[np.int64]:
        """The zero-based indices (s,) of the rows, in the array of samples, for the s samples that are kept of `count`
        successive control periods; `first` is the index of the first period in the run, from 0. Where s is more than
        the rule's `most`, the number of rows, indices repeat, and the later sample is the one to keep. Nothing is
        checked."""
        samples = np.arange(-(-first // self.every), -(-(first + count) // self.every))
        return samples if self.most is None else samples % self.most

    def order(self, count: int) -> slice | NDArray[np.int64]:
        """The rows of the array of samples that are filled after `count` control periods of a run, the oldest sample
        first. They are a slice or, where older samples have been overwritten, an array (s,) of the zero-based indices
        of all s rows. Nothing is checked."""
        samples = -(-count // self.every)
        if self.most is None or samples <= self.most:
            return slice(0, samples)
        return np.arange(samples - self.most, samples) % self.most


PARTS = ("p", "v", *REFERENCE)
"""The parts of an observation that a controller needs; the environment's `observation_slices` say where they are."""


def rollout(
    env: gymnasium.Env[Any, Any],
    controller: Controller[Any],
    *,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
    progress: Callable[[float], object] | None = None,
    record_every: int = 1,
    keep_last: float | None = None,
) -> Rollout:
    """The run, a `Rollout`, of a Gymnasium environment driven by a controller, from reset to termination or truncation.

    Any environment will do, wrapped or not, whose `env.unwrapped` has a `control_period` (s) and `observation_slices`,
    a mapping from the names p, v, reference_p, reference_v and reference_a to slices of the observation: measured
    positions and velocities and the reference's positions, velocities and accelerations, r joints each, in rad, rad/s
    and rad/s^2 (m, m/s and m/s^2 if prismatic). `seed` and `options` are passed to `env.reset`, None for its own
    defaults.

    `info` may have keys that are recorded: `applied_torque` (r,), N m (N), the commanded torque where it is missing;
    `energy` (J), NaN where missing; `clipped`, the number of control periods with a clipped torque so far, 0 where
    missing; and `time` (s), the number of control periods times their length where missing. It may have the true
    positions `p` and velocities `v`, and `flags`, a mapping from names of events to numbers; the controller's state may
    have a NamedTuple `flags` of arrays (1,), such as that of `SafetyFilter`. `progress`, if given, is called about a
    hundred times with the fraction done, 0 to 1, where the run's length is known. The run has a sample of one in
    `every` control periods, the first one included, and only those of its last `last` seconds, None for the whole run;
    no memory is allocated for more.

    Ctrl-C ends the run but keeps what was computed; the run's `complete` is then False. Raises `InputError` for an
    environment that cannot be driven or has another number of joints than the controller, an `every` that is not a
    whole number of at least 1, and a `last` that is not positive and finite; what controller and environment raise,
    such as `NonFiniteError`, passes.
    """
    loop = _SteppedRun(env, controller, seed, options, record_every, keep_last)
    interval = max(1, (loop.steps or 0) // 100)
    complete, started = False, perf_counter()
    try:
        while not (loop.terminated or loop.truncated):
            loop.tick()
            if progress is not None and loop.steps is not None and loop.count % interval == 0:
                progress(min(1.0, loop.count / loop.steps))
        complete = True
    except KeyboardInterrupt:
        pass
    return loop.result(perf_counter() - started, complete)


class _SteppedRun:
    """A run in the making: the memories of environment and controller, and the samples so far."""

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        controller: Controller[Any],
        seed: int | None,
        options: dict[str, Any] | None,
        every: int,
        last: float | None,
    ) -> None:
        self._parts, self.control_period = interface(env, controller)
        self.steps, self._kept_samples = known_steps(env), KeptSamples.of(every, last, self.control_period)
        self._env, self._controller = env, controller
        observation, self._info = env.reset(seed=seed, options=options)
        self._observation = np.asarray(observation, dtype=np.float64)
        self._kept = np.concatenate([np.arange(self._observation.size)[part] for part in self._parts])
        p, v, reference = self._read()
        self._state = controller.init(p, v)
        controller.step(self._state, p, v, reference)  # pure: it is compiled now, before the clock starts
        self.count, self.terminated, self.truncated = 0, False, False
        self._true = "p" in self._info and "v" in self._info
        self._flags = (*self._info.get("flags", ()), *getattr(guards(self._state), "_fields", ()))
        self._widths = {"observed": len(self._kept), "true": 2 * p.size if self._true else 0}
        self._widths |= {"torque": p.size, "applied": p.size, "estimate": _estimate(self._state).size}
        self._widths |= {"logged_state": _told(self._state).size, "scalars": 4, "flags": len(self._flags)}
        self._samples = np.empty((self._kept_samples.room(self.steps or 1024), sum(self._widths.values())))

    def tick(self) -> None:
        """One control period."""
        p, v, reference = self._read()
        torque, state = self._controller.step(self._state, p, v, reference)
        observation, reward, terminated, truncated, info = self._env.step(torque)
        if (row := self._kept_samples.row(self.count)) is not None:
            self._keep(row, torque, state, float(reward), info)
        self._state, self._info = state, info
        self._observation = np.asarray(observation, dtype=np.float64)
        self.terminated, self.truncated = bool(terminated), bool(truncated)
        self.count += 1  # last, so that an interrupted sample does not count

    def _keep(self, row: int, torque: Array, state: Any, reward: float, info: dict[str, Any]) -> None:
        """Put the sample of this control period into a row; where there is none, memory is doubled."""
        before = self._info
        if row >= len(self._samples):
            self._samples = np.concatenate((self._samples, np.empty_like(self._samples)))
        sample = [self._observation[self._kept], *((before["p"], before["v"]) if self._true else ())]
        sample += [torque, info.get("applied_torque", torque), _estimate(state), _told(state)]
        time, energy = before.get("time", self.count * self.control_period), before.get("energy", np.nan)
        sample.append((time, energy, reward, info.get("clipped", 0) != before.get("clipped", 0)))
        if self._flags:
            sample.append((*info.get("flags", {}).values(), *(float(flag[0]) for flag in guards(state))))
        np.concatenate(sample, out=self._samples[row])

    def result(self, wall_time: float, complete: bool) -> Rollout:
        """The run so far."""
        samples, ends = self._samples[self._kept_samples.order(self.count)], np.cumsum(list(self._widths.values()))
        parts = dict(zip(self._widths, np.split(samples, ends[:-1], axis=1), strict=True))
        columns = dict(zip(PARTS, np.split(parts["observed"], len(PARTS), axis=1), strict=True))
        if self._true:
            columns["measured_p"], columns["measured_v"] = columns["p"], columns["v"]
            columns["p"], columns["v"] = np.split(parts["true"], 2, axis=1)
        columns |= zip(("time", "energy", "reward", "clipped"), parts["scalars"].T, strict=True)
        columns |= {name: parts[name] for name in ("torque", "applied", "estimate", "logged_state")}
        flags = zip(self._flags, parts["flags"].T, strict=True)
        return Rollout(
            **{name: frozen(values.copy()) for name, values in columns.items()},
            flags=MappingProxyType({name: frozen(values.copy()) for name, values in flags}),
            control_period=self.control_period,
            wall_time=wall_time,
            complete=complete,
            terminated=self.terminated,
            info=dict(self._info),
            every=self._kept_samples.every,
            position_units=_units(self._env),
        )

    def _read(self) -> tuple[Array, Array, ReferencePoint]:
        p, v, *reference = (self._observation[part] for part in self._parts)
        return p, v, ReferencePoint(*reference)


def interface(env: gymnasium.Env[Any, Any], controller: Controller[Any]) -> tuple[list[slice], float]:
    """The slices of an environment's observation that a controller needs, and the environment's control period (s), a
    pair. The list has five slices of the observation (n,), a vector of n numbers, in the order p, v, reference_p,
    reference_v, reference_a (positions, velocities, and the reference's positions, velocities and accelerations).

    They are read from `env.unwrapped.observation_slices`, a mapping from these names, and
    `env.unwrapped.control_period`. Raises `InputError` for an `env` that is no Gymnasium environment and a `controller`
    that is no `Controller`, where the slices or the period are missing or of another kind (the period must be a float),
    a name is missing, observations are not of shape (n,), or the slices or the action have another number of joints
    than the `controller`.
    """
    import gymnasium

    validate_kind(env, gymnasium.Env, "environment", "as gymnasium.make(...) gives one")
    validate_kind(controller, Controller, "controller", "as SlotineLi(...) is one")
    slices = getattr(env.unwrapped, "observation_slices", None)
    period = getattr(env.unwrapped, "control_period", None)
    if not isinstance(slices, Mapping) or not isinstance(period, float):
        raise InputError(
            f"{env}: cannot be driven by a controller: its unwrapped environment needs a control_period in s and "
            f"observation_slices, a mapping from {', '.join(PARTS)} to slices of the observation"
        )
    if missing := [name for name in PARTS if name not in slices]:
        raise InputError(f"{env}: observation_slices must name {', '.join(PARTS)}; missing: {', '.join(missing)}")
    _validate_joints(env, controller, [slices[name] for name in PARTS])
    return [slices[name] for name in PARTS], period


def _validate_joints(env: gymnasium.Env[Any, Any], controller: Controller[Any], parts: list[slice]) -> None:
    shape = env.observation_space.shape
    if shape is None or len(shape) != 1:
        raise InputError(f"{env}: expected observations of shape (n,), got a space of shape {shape}")
    widths = {len(range(*part.indices(shape[0]))) for part in parts}
    if widths != {controller.dof}:
        counts = " and ".join(str(width) for width in sorted(widths))
        raise InputError(f"{env}: observes {counts} joints, the controller is for {controller.dof}")
    if env.action_space.shape != (controller.dof,):
        raise InputError(f"{env}: expected actions of shape ({controller.dof},), got {env.action_space.shape}")


def known_steps(env: gymnasium.Env[Any, Any]) -> int | None:
    """The greatest number of control periods that an environment's episode takes: the least of `env.unwrapped.steps`
    and `env.spec.max_episode_steps` that is a positive int, None where neither is one. Nothing is raised."""
    limits = (getattr(env.unwrapped, "steps", None), getattr(env.spec, "max_episode_steps", None))
    return min((steps for steps in limits if isinstance(steps, int) and steps > 0), default=None)


def _units(env: gymnasium.Env[Any, Any]) -> tuple[str, ...]:
    """Units of position of the joints of an environment's plant, "rad" or "m" each; none where its plant is not
    known."""
    mechanism = getattr(getattr(env.unwrapped, "plant", None), "mechanism", None)
    return position_units(mechanism) if isinstance(mechanism, Mechanism) else ()


def _estimate(state: object) -> Array:
    return np.asarray(getattr(state, "estimate", ()), dtype=np.float64)


def _told(state: object) -> Array:
    return np.asarray(getattr(state, "logged_state", ()), dtype=np.float64)
