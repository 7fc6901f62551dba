"""Rollout of a controller in a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, frozen, whole_count
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.control.held_state import HeldState
from adaptctl.control.wrench_torque import WrenchTorque
from adaptctl.description import Joint
from adaptctl.dynamics import Mechanism
from adaptctl.errors import DivergedRunWarning, InputError, validate_kind, warn
from adaptctl.simulation.closed_loop import guards
from adaptctl.simulation.mujoco_plant import TOUCH_FLAGS
from adaptctl.simulation.references import REFERENCE
from adaptctl.simulation.run import Rollout

if TYPE_CHECKING:
    import gymnasium


MAX_KEPT_SAMPLES = 2**62
"""more than any run has"""


@dataclass(frozen=True)
class KeptSamples:
    """Rule that keeps one in `every` samples, the latest `most`."""

    every: int = 1
    most: int | None = None

    @classmethod
    def of(cls, every: int, last: float | None, period: float) -> KeptSamples:
        """Rule for the last `last` seconds, else `InputError`."""
        if isinstance(every, bool) or not isinstance(every, int) or every < 1:
            raise InputError(f"record_every: expected a whole number of control periods, at least 1, got {every!r}")
        if last is None:
            return cls(every)
        if isinstance(last, bool) or not isinstance(last, int | float) or not 0.0 < last < np.inf:
            raise InputError(f"keep_last: expected a positive time in s, got {last!r}")
        return cls(every, max(1, round(min(last / (every * period), MAX_KEPT_SAMPLES))))

    def room(self, steps: int) -> int:
        """Rows needed for `steps` control periods."""
        needed = -(-steps // self.every)
        return needed if self.most is None else min(needed, self.most)

    def row(self, period: int) -> int | None:
        """Row of a control period's sample, or None."""
        sample, rest = divmod(period, self.every)
        return None if rest else sample if self.most is None else sample % self.most

    def among(self, first: int, count: int) -> slice:
        """Slice of those kept among `count` periods from `first`."""
        return slice(-first % self.every, count, self.every)

    def rows(self, first: int, count: int) -> NDArray[np.int64]:
        """Rows (s,) of those kept; the last of equal rows counts."""
        samples = np.arange(-(-first // self.every), -(-(first + count) // self.every))
        return samples if self.most is None else samples % self.most

    def order(self, count: int) -> slice | NDArray[np.int64]:
        """Filled rows, the oldest sample first."""
        samples = -(-count // self.every)
        if self.most is None or samples <= self.most:
            return slice(0, samples)
        return np.arange(samples - self.most, samples) % self.most


PARTS = ("p", "v", *REFERENCE)
"""parts of an observation that a controller needs"""


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
    """
    Run a controller in a Gymnasium environment step by step for one episode.

    Parameters
    ----------
    env : gymnasium.Env
        Environment, wrapped or not, whose unwrapped one has a `control_period` in s and `observation_slices`, see
        Notes.
    controller : Controller
        Controller for the environment's r joints.
    seed : int, optional
        Seed of `env.reset`. Default: its generator goes on.
    options : dict, optional
        Options of `env.reset`. Default: none.
    progress : callable, optional
        Called some hundred times with the fraction done, 0 to 1, if the run's length is known.
    record_every : int, default 1
        Control periods from one sample to the next; 1 records all.
    keep_last : float, optional
        Length in s of the end of the run that is kept; no memory is allocated for more. Default: the whole run.

    Returns
    -------
    Rollout
        The run; after Ctrl-C what was computed, with `interrupted` True.

    Raises
    ------
    InputError
        If the environment cannot be driven or has another number of joints, `record_every` is not a whole number of at
        least 1 or `keep_last` is not positive and finite. Errors of controller and environment pass.

    Notes
    -----
    A `DivergedRunWarning` says where the environment ended the run early, as an error exceeded its limit.
    `observation_slices` maps p, v, reference_p, reference_v and reference_a to slices of the observation. These keys of
    `info` are recorded if present: `time`, `applied_torque`, `energy`, `clipped` (count so far), true `p` and `v`, and
    `flags` (numbers by name); also the `flags` of the controller's state.

    Examples
    --------
    >>> run = adaptctl.rollout(env, law, seed=0)
    >>> run.p.shape, run.reached_end
    ((200, 2), True)
    """
    how: Any = {"seed": seed, "options": options, "progress": progress}
    run = stepped(env, controller, **how, record_every=record_every, keep_last=keep_last)
    warn_if_ended_early(run, "rollout")
    return run


def warn_if_ended_early(run: Rollout, caller: str) -> None:
    """Give a `DivergedRunWarning` on a run that its environment ended."""
    if run.terminated:
        text = f"{caller}: the environment ended the run after {run.duration:.6g} s, before its end: see `terminated`"
        warn(text, DivergedRunWarning)


def stepped(
    env: gymnasium.Env[Any, Any],
    controller: Controller[Any],
    *,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
    progress: Callable[[float], object] | None = None,
    record_every: int = 1,
    keep_last: float | None = None,
) -> Rollout:
    """Run as `rollout` does, without a word on a run that diverged."""
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
        number = None if seed is None else whole_count(seed, "seed")
        observation, self._info = env.reset(seed=number, options=options)
        self._observation = np.asarray(observation, dtype=np.float64)
        self._kept = np.concatenate([np.arange(self._observation.size)[part] for part in self._parts])
        p, v, reference = self._read()
        self._state = controller.init(p, v)
        controller.step(self._state, p, v, reference)  # pure: it is compiled now, before the clock starts
        self.count, self.terminated, self.truncated = 0, False, False
        self._held_state, self._wrench_torque = HeldState(controller), None
        if self._held_state.driven:
            self._wrench_torque = WrenchTorque(_measuring(env, self._info))
        self._true = "p" in self._info and "v" in self._info
        self._flags = (*self._info.get("flags", ()), *getattr(guards(self._state), "_fields", ()))
        self._widths = {"observed": len(self._kept), "true": 2 * p.size if self._true else 0}
        self._widths |= {"torque": p.size, "applied": p.size, "estimate": _estimate(self._state).size}
        self._widths |= {"logged_state": _told(self._state).size, "scalars": 4, "flags": len(self._flags)}
        self._samples = np.empty((self._kept_samples.room(self.steps or 1024), sum(self._widths.values())))

    def tick(self) -> None:
        p, v, reference = self._read()
        before = self._state if self._wrench_torque is None else self._felt(self._wrench_torque, p)
        torque, state = self._controller.step(before, p, v, reference)
        observation, reward, terminated, truncated, info = self._env.step(torque)
        if (row := self._kept_samples.row(self.count)) is not None:
            self._keep(row, torque, state, float(reward), info)
        self._state, self._info = state, info
        self._observation = np.asarray(observation, dtype=np.float64)
        self.terminated, self.truncated = bool(terminated), bool(truncated)
        self.count += 1  # last, so that an interrupted sample does not count

    def _felt(self, wrench_torque: WrenchTorque, p: Array) -> Any:
        """State that knows the force of the contacts."""
        touch = np.array([self._info["flags"][name] for name in TOUCH_FLAGS])
        external = wrench_torque(p, np.append(touch[:3], np.zeros(3)), touch[3:])
        return self._held_state.feeling(self._state, self._info.get("applied_torque", 0.0 * p), external)

    def _keep(self, row: int, torque: Array, state: Any, reward: float, info: dict[str, Any]) -> None:
        """Store a sample; memory doubles when full."""
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
            interrupted=not complete,
            terminated=self.terminated,
            info=dict(self._info),
            every=self._kept_samples.every,
            position_units=tuple(joint.kind.position_unit for joint in _joints(self._env)),
            joints=tuple(joint.name for joint in _joints(self._env)),
        )

    def _read(self) -> tuple[Array, Array, ReferencePoint]:
        p, v, *reference = (self._observation[part] for part in self._parts)
        return p, v, ReferencePoint(*reference)


def _measuring(env: gymnasium.Env[Any, Any], info: Mapping[str, Any]) -> Mechanism:
    """Mechanism of an environment that tells the forces of contacts."""
    mechanism = getattr(getattr(env.unwrapped, "plant", None), "mechanism", None)
    if not isinstance(mechanism, Mechanism) or not set(TOUCH_FLAGS) <= set(info.get("flags", ())):
        raise InputError(
            f"{env}: tells no force of contacts, which drives the target inertia of the controller: leave out "
            "force_cutoff, and give it an adaptation of with_external_torque(...)"
        )
    return mechanism


def interface(env: gymnasium.Env[Any, Any], controller: Controller[Any]) -> tuple[list[slice], float]:
    """Checked observation slices and control period (s)."""
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
        raise InputError(f"{env}: has {counts} joints, but the controller has {controller.dof}")
    if env.action_space.shape != (controller.dof,):
        raise InputError(f"{env}: expected actions of shape ({controller.dof},), got {env.action_space.shape}")


def known_steps(env: gymnasium.Env[Any, Any]) -> int | None:
    """Control periods of an episode, None if unknown."""
    limits = (getattr(env.unwrapped, "steps", None), getattr(env.spec, "max_episode_steps", None))
    return min((steps for steps in limits if isinstance(steps, int) and steps > 0), default=None)


def _joints(env: gymnasium.Env[Any, Any]) -> tuple[Joint, ...]:
    """Primary joints, empty if unknown."""
    mechanism = getattr(getattr(env.unwrapped, "plant", None), "mechanism", None)
    return tuple(mechanism.primary_joints) if isinstance(mechanism, Mechanism) else ()


def _estimate(state: object) -> Array:
    return np.asarray(getattr(state, "estimate", ()), dtype=np.float64)


def _told(state: object) -> Array:
    return np.asarray(getattr(state, "logged_state", ()), dtype=np.float64)
