"""Comparison of controllers on one environment."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.codegen.live_arm import LiveArm, live_arm
from adaptctl.control import (
    Controller,
    Gains,
    PriorRanges,
    Reference,
    ReferencePoint,
    adaptation_gain,
    lyapunov,
)
from adaptctl.control.lyapunov import has_sliding_variable
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.experiments.experiment import ClosedLoopExperiment, setting, stated
from adaptctl.identifiability import FundamentalBasis, ReducedModel, essential_space, fundamental_basis
from adaptctl.recording import (
    Comparison,
    ControllerRun,
    Failure,
    Finding,
    Progress,
    Result,
    Setting,
    StepCost,
    TaskError,
    shown,
)
from adaptctl.recording.comparison import ADAPTATION_OFF as ADAPTATION_OFF
from adaptctl.recording.comparison import NO_MODEL as NO_MODEL
from adaptctl.recording.contact_force import is_touched
from adaptctl.simulation import Plant, Rollout
from adaptctl.simulation.law_operations import law_flops
from adaptctl.simulation.rollout import known_steps, stepped
from adaptctl.simulation.shared_columns import with_shared_columns
from adaptctl.simulation.simulate import simulated
from adaptctl.tuning.rotors import warn_of_rotors

if TYPE_CHECKING:
    import gymnasium

    from adaptctl.recording.drawing import Drawing

ADAPTIVE, FULL = "adaptive", "adaptive-full"
SETTING_UP, OFFLINE = "Robot, reference and gains", "Base parameters from energies"
TIMED_TICKS = 1000
"""control steps that are timed"""
MAX_SAMPLES, THINNED_SAMPLES = 600_000, 30_000
"""samples of all runs that are kept, and number to which more are thinned, to fit into 500 MB"""


@dataclass(frozen=True, eq=False)
class Contender:
    """Controller to compare."""

    name: str
    label: str
    prior_knowledge: str
    make: Callable[[], Controller[Any]]
    env: Callable[[], gymnasium.Env[Any, Any]] | None = None

    @classmethod
    def of(cls, name: str, label: str, prior_knowledge: str, controller: Controller[Any]) -> Contender:
        """`Contender` for an existing `controller`."""
        return cls(name, label, prior_knowledge, lambda: controller)

    @cached_property
    def controller(self) -> Controller[Any]:
        """Controller, made on first use. Raises what `make` raises."""
        return self.make()


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a contest."""

    mechanism: Mechanism
    runs: tuple[ControllerRun, ...]
    complete: bool

    @cached_property
    def run(self) -> dict[str, ControllerRun]:
        """Runs by controller."""
        return {run.name: run for run in self.runs}


class Told(NamedTuple):
    """Findings, answer, drawings and task errors."""

    findings: Iterable[Finding] = ()
    answer: str | None = None
    drawings: Iterable[Drawing] = ()
    task_error: TaskError | None = None


@dataclass(frozen=True)
class Learning(ClosedLoopExperiment):
    """Base class of experiments that compare controllers, the subject first."""

    robot: str = setting("puma560", "a built-in robot or a file (.urdf, .xml, .toml)")
    measure_step_time: bool = setting(
        False, "also measure the computing time of a control step of each law in Python; compiles each law once more"
    )

    @property
    @abstractmethod
    def purpose(self) -> str:
        """Question of the experiment."""

    def mechanism(self) -> Mechanism:
        """Arm from `robot`."""
        return load(self.robot)

    @abstractmethod
    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Tracking environment."""

    def tracking(
        self, robot: Any, reference: Reference, name: str = "Tracking", **more: Any
    ) -> gymnasium.Env[Any, Any]:
        """Environment adaptctl/NAME-v0 with the experiment's settings."""
        import gymnasium

        ours = {"robot": robot, "duration": self.duration, "control_period": self.control_period}
        return gymnasium.make(f"adaptctl.envs:adaptctl/{name}-v0", **ours | {"reference": reference} | more)

    @property
    def options(self) -> dict[str, Any]:
        """Options of the reset."""
        return {}

    @abstractmethod
    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Controllers to compare, the subject first."""

    @property
    def expected(self) -> Mapping[Failure, str]:
        """Expected failures of the subject, and reasons."""
        return {}

    def chosen(self, mechanism: Mechanism, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Chosen settings for the report."""
        yield from ()

    def told(self, outcome: Outcome, basis: FundamentalBasis) -> Told:
        """Findings on the `outcome`."""
        return Told()

    def run(self, progress: Progress) -> Result:
        """Result of comparing all controllers."""
        return shown(self.compare(progress))

    def compare(self, progress: Progress) -> Comparison:
        """Comparison of all controllers, as data; otherwise as `run`."""
        progress(SETTING_UP, 0.0)
        mechanism = self.mechanism()
        env = self.environment(mechanism)
        progress(SETTING_UP, 1.0)
        progress(OFFLINE, 0.0)
        space = essential_space(mechanism, seed=self.seed)
        basis = fundamental_basis(space)
        progress(OFFLINE, 1.0)
        contenders = self.contenders(mechanism, basis)
        outcome = contest(env, mechanism, contenders, self.seed, progress, self.options, self.measure_step_time)
        told = self.told(outcome, basis)
        return Comparison(
            experiment=self.name,
            title=self.title.format(robot=mechanism.name),
            purpose=self.purpose,
            mechanism=mechanism,
            space=space,
            basis=basis,
            runs=outcome.runs,
            torque_limits=env.action_space.high,  # type: ignore[attr-defined]
            settings=(*self.chosen(mechanism, env), *stated(self)),
            seed=self.seed,
            duration=self.duration,
            findings=tuple(told.findings),
            complete=outcome.complete,
            more_drawings=tuple(told.drawings),
            answer=told.answer if outcome.complete else None,
            task_error=told.task_error,
            expected=self.expected,
            live=live_contender(env, contenders, self.seed, self.options) if outcome.complete else "",
            error_bound=getattr(env.unwrapped, "error_bound", None),
            surroundings=getattr(env.unwrapped, "surroundings", ()),
        )


def _gravity(text: str) -> tuple[float, ...] | None:
    """Gravity (3,) in m/s^2 of a text; None where it is empty."""
    words = text.replace(",", " ").split()
    try:
        found = tuple(float(word) for word in words)
    except ValueError:
        found = ()
    if words and len(found) != 3:
        raise InputError(f"gravity: expected three numbers in m/s^2, such as 6.9,0,-6.9, got {text!r}")
    return found or None


@dataclass(frozen=True)
class FromFile(Learning):
    """Base class of experiments on any robot file, with the choices in reading it."""

    floating_base: bool = setting(False, "let the base float, pushed by ideal forces, instead of holding it")
    root: str = setting("", "first body of the robot, in an MJCF scene with several")
    as_written: bool = setting(False, "take angles and lengths as written, where rounding may have made them")
    gravity: str = setting("", "gravity in the frame of the base, m/s^2, for a tilted mount, such as 6.9,0,-6.9")
    lock: str = setting("", "joints to hold fast, at a position in rad or m or at 0, such as head,finger=0.02")

    def mechanism(self) -> Mechanism:
        """Arm from `robot`."""
        found = load(self.robot, **self.reading)
        warn_of_rotors(found)
        return found

    @property
    def reading(self) -> dict[str, Any]:
        """Choices in reading the robot other than the default, as arguments of `load`."""
        chosen: dict[str, Any] = {name: getattr(self, name) for name in ("floating_base", "root", "as_written")}
        chosen |= {"gravity": _gravity(self.gravity), "lock": tuple(self.lock.replace(",", " ").split())}
        return {name: value for name, value in chosen.items() if value}

    def __post_init__(self) -> None:
        super().__post_init__()
        _gravity(self.gravity)


@dataclass(frozen=True)
class FromRanges(FromFile):
    """Base class of experiments with adaptation gains from prior ranges."""

    bandwidth: float = setting(8.0, "bandwidth, the decay rate of errors, 1/s", symbol="Λ", low=0.1, high=100.0)
    gain_scale: float = setting(
        0.6,
        "adaptation gain of each parameter divided by the square of its prior range, 1/J",
        symbol="Γ",
        low=1e-6,
        high=1e3,
    )
    mass_range: float = setting(10.0, "prior range of masses, kg", low=1e-3, high=1e3)
    first_moment_range: float = setting(4.0, "prior range of first moments, kg m", low=1e-3, high=1e3)
    inertia_range: float = setting(1.0, "prior range of inertias, kg m^2", low=1e-3, high=1e3)

    @property
    def ranges(self) -> PriorRanges:
        """Prior ranges (greatest plausible errors) from the settings."""
        return PriorRanges(self.mass_range, self.first_moment_range, self.inertia_range)

    def adaptation(self, model: ReducedModel) -> Array:
        """Diagonal (k,) of the adaptation gain: `rate` times the squared prior ranges."""
        return adaptation_gain(model, self.ranges, self.gain_scale)


def chosen_gains(gains: Gains, adaptation: str = "", rule: str = "", first: str = "0") -> Iterator[Setting]:
    """Report lines on gains and the first estimate."""
    yield Setting("Λ", listed(gains.bandwidth), "bandwidth of the tracking loop, 1/s, per joint")
    yield Setting("K", listed(gains.damping), "damping, N·m·s (N·s/m), per joint")
    if adaptation:
        yield Setting("Γ", adaptation, rule)
    yield Setting("initial estimate", first, "of all parameters")


def listed(values: Array) -> str:
    """Numbers with four digits."""
    return ", ".join(f"{value:.4g}" for value in values)


def contest(
    env: gymnasium.Env[Any, Any],
    mechanism: Mechanism,
    contenders: Sequence[Contender],
    seed: int,
    progress: Progress,
    options: Mapping[str, Any] = MappingProxyType({}),
    timed: bool = False,
) -> Outcome:
    """Outcome of controllers run from one seed."""
    for contender in contenders:
        _ = contender.controller  # what cannot be made is told before anything runs
    runs, complete = list[ControllerRun](), False
    every = thinning((known_steps(env) or 0) * len(contenders))
    try:
        for one in contenders:
            progress(one.label, 0.0)
            own, told = one.env() if one.env else env, partial(progress, one.label)
            result = _driven(
                own, mechanism, one.controller, record_every=every, seed=seed, options=dict(options), progress=told
            )
            if len(result.time):
                result = with_shared_columns(result, runs[0].rollout if runs else result)
                runs.append(ControllerRun(one.name, one.label, one.prior_knowledge, result, law=law_of(one.controller)))
            if result.interrupted:
                break
            known = "payload" not in options  # else the truth is not the mechanism's own
            V = _lyapunov(one.controller, result, mechanism) if known else None
            runs[-1] = replace(runs[-1], lyapunov=V, cost=step_cost(one.controller, result, timed))
            progress(one.label, 1.0)
        else:
            complete = True
    except KeyboardInterrupt:
        if not runs:
            raise
    if not runs:
        raise KeyboardInterrupt
    return Outcome(mechanism, tuple(runs), complete)


def thinning(samples: int) -> int:
    """Control periods per recorded sample."""
    return -(-samples // THINNED_SAMPLES) if samples > MAX_SAMPLES else 1


def live_contender(
    env: gymnasium.Env[Any, Any], contenders: Sequence[Contender], seed: int, options: Mapping[str, Any]
) -> LiveArm | str:
    """Closed loop of the subject, or of the next contender where the subject's law is too large for a page."""
    found = [live_subject(env, contenders[0].controller, seed, options)]
    if not isinstance(found[0], LiveArm) and len(contenders) > 1:
        found.append(live_subject(env, contenders[1].controller, seed, options))
    shown = (
        replace(one, label=to.label) for one, to in zip(found, contenders, strict=False) if isinstance(one, LiveArm)
    )
    return next(shown, found[0])


def live_subject(
    env: gymnasium.Env[Any, Any], controller: Controller[Any], seed: int, options: Mapping[str, Any]
) -> LiveArm | str:
    """Closed loop for a report's page, or the reason why none."""
    if not hasattr(env.unwrapped, "episode"):
        return f"{type(env.unwrapped).__name__} does not expose its plant and reference"
    if type(env.unwrapped.plant).step is not Plant.step:  # type: ignore[attr-defined]
        return f"{type(env.unwrapped).__name__} has its own physics"
    episode = env.unwrapped.episode(seed=seed, options=dict(options))
    return live_arm(episode.plant, controller, episode.reference, episode.state, episode.parameters)


def _driven(env: gymnasium.Env[Any, Any], mechanism: Mechanism, controller: Controller[Any], **how: Any) -> Rollout:
    """Run in native code, unless MuJoCo moves the arm or it is shown live."""
    from adaptctl.recording.live import CURRENT, Live

    if (to := CURRENT.get()) is not None:
        from adaptctl.envs.live import LiveView

        with Live(mechanism, to, surroundings=getattr(env.unwrapped, "surroundings", ())) as live:
            if live.is_seen:
                return stepped(LiveView(env, live), controller, **how)
    ours = getattr(type(getattr(env.unwrapped, "plant", None)), "step", Plant.step) is Plant.step
    return (partial(simulated, once=True) if ours else stepped)(env, controller, **how)


def law_of(controller: Controller[Any]) -> str:
    """Names of a controller's class and of its adaptation law's."""
    law = getattr(controller, "adaptation_law", None)
    return " + ".join(type(part).__name__ for part in (controller, law) if part is not None)


def _lyapunov(controller: Controller[Any], run: Rollout, mechanism: Mechanism) -> Array | None:
    """Lyapunov function (T,) of Slotine and Li's law where it adapts."""
    if not has_sliding_variable(controller) or controller.adaptation_law is None or not len(run.time):
        return None
    if controller.model.regrouping.shape[1] != len(mechanism.parameter_names):
        return None  # its model knows less of the arm, friction for one
    if run.flags.get("payload", run.time[:1] * 0.0).any():
        return None  # the truth changes in mid-motion, and no function of it falls across that
    if is_touched(run):
        return None  # what touches the arm works on it
    if controller.adaptation_law.lyapunov_distance(controller.model, run.estimate[:1], run.estimate[0]) is None:
        return None
    return lyapunov(controller, run, mechanism)


def step_cost(controller: Controller[Any], run: Rollout, timed: bool) -> StepCost:
    """Floating-point operations of a control step and, where `timed`, its median time in s."""
    called = list[float]()
    memory = controller.init(run.p[0], run.v[0]) if timed else None
    for k in np.linspace(0, len(run.time) - 1, TIMED_TICKS if timed else 0).astype(int):
        point = ReferencePoint(run.reference_p[k], run.reference_v[k], run.reference_a[k])
        started = time.perf_counter()
        controller.step(memory, run.p[k], run.v[k], point)
        called.append(time.perf_counter() - started)
    return StepCost(float(np.median(called)) if called else None, flops=law_flops(controller))
