"""Several controllers on one environment, one after the other, under equal conditions, and what came of it."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.codegen.live_arm import LiveArm, live_arm
from adaptctl.control import ComputedTorque, Controller, ReferencePoint, SlotineLi, lyapunov
from adaptctl.control.memory import leaves
from adaptctl.dynamics import Mechanism, load
from adaptctl.experiments.experiment import ClosedLoopExperiment, setting, stated
from adaptctl.identifiability import FundamentalBasis, ReducedModel, essential_space, fundamental_basis
from adaptctl.recording import (
    Comparison,
    ControllerRun,
    Failure,
    Finding,
    Leading,
    Progress,
    Result,
    Setting,
    TickCost,
    shown,
)
from adaptctl.recording.comparison import ADAPTATION_OFF as ADAPTATION_OFF
from adaptctl.simulation import Plant, Rollout, rollout, simulate
from adaptctl.simulation.rollout import known_steps
from adaptctl.tuning.verification import scaled_links

if TYPE_CHECKING:
    import gymnasium

    from adaptctl.recording.drawing import Drawing

ADAPTIVE, FULL = "adaptive", "adaptive-full"
OFFLINE = "Independent parameters from energies"
TIMED_TICKS, REPETITIONS = 1000, 30
"""control ticks that are timed to find out how long one takes"""
LONG = 20_000
"""operations of a tick above which its native time is not told: to compile it for that takes LLVM ten seconds"""
MANY, FEW = 600_000, 30_000
"""samples of all runs: so many are kept as they are, and of more so few: with what draws them they fit into 500 MB"""


@dataclass(frozen=True, eq=False)
class Contender:
    """A controller to compare with others: `name`, short, fit for a file and unique among those compared; `label`, for
    legends; `knows`, in words what it knows of the arm beforehand; `make`, a function without arguments that makes the
    controller, called once, when it is first asked for; and `env`, a function that makes the environment that it
    drives, None for the one that all others drive."""

    name: str
    label: str
    knows: str
    make: Callable[[], Controller[Any]]
    env: Callable[[], gymnasium.Env[Any, Any]] | None = None

    @classmethod
    def of(cls, name: str, label: str, knows: str, controller: Controller[Any]) -> Contender:
        """The `Contender` for a `controller` that is made already."""
        return cls(name, label, knows, lambda: controller)

    @cached_property
    def controller(self) -> Controller[Any]:
        """Controller to compare, made when first asked for. Raises what `make` raises, such as `GainError`."""
        return self.make()


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a contest: the `mechanism` that was driven; `runs`, a `ControllerRun` a controller in their order; and
    `complete`, False where it was interrupted: `runs` are then those that had begun."""

    mechanism: Mechanism
    runs: tuple[ControllerRun, ...]
    complete: bool

    @cached_property
    def run(self) -> dict[str, ControllerRun]:
        """Runs by the names of their controllers."""
        return {run.name: run for run in self.runs}


class Told(NamedTuple):
    """Sayings of an experiment on its outcome: `findings`; `answer`, sentences, None for what adaptation is worth;
    `drawings`, figures of its own; and `leading`, what a recording shows before the joints' errors."""

    findings: Iterable[Finding] = ()
    answer: str | None = None
    drawings: Iterable[Drawing] = ()
    leading: Leading | None = None


@dataclass(frozen=True)
class Learning(ClosedLoopExperiment):
    """Abstract base class of experiments that compare controllers of one arm on one environment, the first of them
    being the subject.

    A subclass gives `name`, `title`, the property `purpose`, `environment` and `contenders`, and may give
    `mechanism`, `options`, `expected`, `chosen` and `told`. Raises `InputError` at construction for settings of the
    wrong type or out of their bounds, `NonFiniteError` for NaN or infinity."""

    robot: str = setting("puma560", "a built-in robot or a file (.urdf, .xml, .toml)")

    @property
    @abstractmethod
    def purpose(self) -> str:
        """Paragraph of text for the report that states the question."""

    def mechanism(self) -> Mechanism:
        """The `Mechanism` that the experiment drives, loaded from `robot` unless a subclass makes another. Raises
        `NotFoundError` for an unknown name, `FileError` for a file that cannot be used, `LoopError` where its kinematic
        loops cannot be closed."""
        return load(self.robot)

    @abstractmethod
    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Gymnasium tracking environment with the `mechanism` as its arm and finite torque limits, N m (N if
        prismatic), as the bounds of its actions. Raises `InputError` for a mechanism that the experiment is not for."""

    @property
    def options(self) -> dict[str, Any]:
        """Options of the environment's reset by name, such as a payload: none unless a subclass gives some."""
        return {}

    @abstractmethod
    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Controllers of the `mechanism`, whose fundamental (base) parameters `basis` has, in the order in which they
        run, the subject first. Raises `InputError` for a basis of another geometry than the mechanism's."""

    @property
    def expected(self) -> Mapping[Failure, str]:
        """Failures of the subject that are the experiment's question, and why: none unless a subclass has some."""
        return {}

    def chosen(self, mechanism: Mechanism, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Iterator over what was chosen besides the settings, a `Setting` (name, value and meaning) each, for the
        report: gains of the `mechanism` and the reference of `env`."""
        yield from ()

    def told(self, outcome: Outcome, basis: FundamentalBasis) -> Told:
        """Sayings on the `outcome`, `basis` having the mechanism's fundamental (base) parameters."""
        return Told()

    def run(self, progress: Progress) -> Result:
        """Result of comparing all controllers. `progress(label, share)` is called with what is done and the fraction
        of it, 0 to 1. Ctrl-C keeps the runs begun; where there are none, `KeyboardInterrupt` is raised. Raises
        `RankError` where the number of base parameters cannot be certified, `GainError` for gains too large for the
        control period, and what the experiment's methods raise."""
        return shown(self.compare(progress))

    def compare(self, progress: Progress) -> Comparison:
        """Comparison of all controllers on the experiment's environment, as data; otherwise as `run`."""
        progress(OFFLINE, 0.0)
        mechanism = self.mechanism()
        env = self.environment(mechanism)
        space = essential_space(mechanism, seed=self.seed)
        basis = fundamental_basis(space)
        progress(OFFLINE, 1.0)
        contenders = self.contenders(mechanism, basis)
        outcome = contest(env, mechanism, contenders, self.seed, progress, self.options)
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
            leading=told.leading,
            expected=self.expected,
            live=live_subject(env, contenders[0].controller, self.seed, self.options) if outcome.complete else "",
        )


def from_nothing(
    mechanism: Mechanism,
    basis: FundamentalBasis,
    law: Callable[[ReducedModel, Array | None], SlotineLi],
    gain: Callable[[ReducedModel], Array],
    bandwidth: Array,
    share: float,
    seed: int,
) -> list[Contender]:
    """Controllers that start from knowing nothing, or something, of an arm: Slotine and Li's `law(model, gain)` from
    estimates of zero on the k fundamental (base) parameters in `basis`, the subject; the same with adaptation off;
    computed torque with true parameters, with those of a model whose links are off by the fraction `share`, up or down
    by `seed`, and with zeros; and the law on all P. `gain(model)` is the adaptation gain, `bandwidth` (r,) in 1/s.
    Raises `InputError` for a basis of another geometry."""
    model, full = ReducedModel(mechanism, basis), ReducedModel.full(mechanism)
    true, k, P = mechanism.inertial_parameters, len(basis.columns), len(mechanism.parameter_names)
    off = f"{100 * share:.0f} % off"

    def computed_torque(parameters: Array) -> ComputedTorque:
        return ComputedTorque(mechanism, bandwidth, parameters=parameters)

    return [
        Contender(ADAPTIVE, f"Slotine-Li, {k} parameters", "nothing", lambda: law(model, gain(model))),
        Contender(ADAPTATION_OFF, "Slotine-Li, adaptation off", "nothing", lambda: law(model, None)),
        Contender("computed-torque", "Computed torque, true model", "everything", lambda: computed_torque(true)),
        Contender(
            "computed-torque-wrong",
            f"Computed torque, model {off}",
            f"links {off}",
            lambda: computed_torque(scaled_links(mechanism, share, seed)),
        ),
        Contender("computed-torque-none", "Computed torque, no model", "nothing", lambda: computed_torque(0.0 * true)),
        Contender(FULL, f"Slotine-Li, all {P} parameters", "nothing", lambda: law(full, gain(full))),
    ]


def one_controller(outcome: Outcome, mapped: str) -> Iterator[Finding]:
    """Finding with the largest difference, N m (N if prismatic), between the commanded torques of the run named
    `mapped`, on k parameters with its gain mapped from that of all P, and of the run on all P: round-off, since the two
    are one controller. None where either is missing."""
    if not {mapped, FULL} <= set(outcome.run):
        return
    one, other = (outcome.run[name].rollout for name in (mapped, FULL))
    common, sizes = min(len(one.time), len(other.time)), [run.estimate.shape[1] for run in (one, other)]
    yield Finding(
        "torque_difference_reduced_full",
        float(np.abs(one.torque[:common] - other.torque[:common]).max(initial=0.0)),
        "N m",
        f"largest difference between the torques of {sizes[0]} and of {sizes[1]} adapted parameters, Γ mapped",
    )


def listed(values: Array) -> str:
    """Text of one number a joint, such as gains, with four digits each."""
    return ", ".join(f"{value:.4g}" for value in values)


def contest(
    env: gymnasium.Env[Any, Any],
    mechanism: Mechanism,
    contenders: Sequence[Contender],
    seed: int,
    progress: Progress,
    options: Mapping[str, Any] = MappingProxyType({}),
) -> Outcome:
    """Outcome of a contest: each of the `contenders` drives the environment `env`, whose arm is `mechanism`, or its own
    one, one after the other, from the same `seed` and `options` of the environment's reset, such as a payload.

    `progress(label, share)` is called with the contender's label and the fraction of its run that is done, 0 to 1. All
    controllers are made before anything runs. Where all runs together have more than 600 000 control periods, at most
    about 30 000 of them, evenly spaced, are recorded. Raises `InputError` for an environment that a controller cannot
    drive, `NonFiniteError` where a motion diverges to non-finite values. Ctrl-C ends the contest: the runs that had
    begun are returned, as not complete; `KeyboardInterrupt` is raised where there are none."""
    for contender in contenders:
        _ = contender.controller  # what cannot be made is told before anything runs
    runs: list[ControllerRun] = []
    every = thinning((known_steps(env) or 0) * len(contenders))
    try:
        for contender in contenders:
            runs.append(_run(env, mechanism, contender, seed, options, partial(progress, contender.label), every))
            if not runs[-1].rollout.complete:
                break
    except KeyboardInterrupt:
        if not runs:
            raise
    begun = tuple(run for run in runs if len(run.rollout.time))
    if not begun:
        raise KeyboardInterrupt
    return Outcome(mechanism, begun, complete=len(begun) == len(contenders) and begun[-1].rollout.complete)


def thinning(samples: int) -> int:
    """Number of control periods per recorded sample, at least 1, where all runs together have `samples` control
    periods: 1 for at most 600 000 of them, else the least number that leaves at most 30 000 samples. Nothing is
    checked."""
    return -(-samples // FEW) if samples > MANY else 1


def live_subject(
    env: gymnasium.Env[Any, Any], controller: Controller[Any], seed: int, options: Mapping[str, Any]
) -> LiveArm | str:
    """Closed loop of an environment and a `controller` as a `LiveArm`, a WebAssembly module that a report's page runs
    in the browser, from the state in which `env` begins with the `seed` and `options` of its reset; or, as text, the
    reason why it cannot be made, such as a plant of another simulator, effects such as a payload, or a reference that
    is no sum of sinusoids. Raises what the environment's reset raises."""
    if not hasattr(env.unwrapped, "episode"):
        return f"{type(env.unwrapped).__name__} does not tell what it is made of"
    if type(env.unwrapped.plant).step is not Plant.step:  # type: ignore[attr-defined]
        return f"{type(env.unwrapped).__name__} has physics of its own"
    episode = env.unwrapped.episode(seed=seed, options=dict(options))
    return live_arm(episode.plant, controller, episode.reference, episode.state, episode.parameters)


def _run(
    env: gymnasium.Env[Any, Any],
    mechanism: Mechanism,
    contender: Contender,
    seed: int,
    options: Mapping[str, Any],
    progress: Callable[[float], object],
    every: int,
) -> ControllerRun:
    controller = contender.controller
    env = contender.env() if contender.env else env
    progress(0.0)
    step = getattr(type(getattr(env.unwrapped, "plant", None)), "step", Plant.step)
    drive = simulate if step is Plant.step else rollout  # MuJoCo's steps are not ours to compile
    with shown_live(env, mechanism) as seen:
        drive = drive if seen is env else rollout
        result = drive(seen, controller, seed=seed, options=dict(options), progress=progress, every=every)
    run = ControllerRun(name=contender.name, label=contender.label, knows=contender.knows, rollout=result)
    try:
        cost = tick_cost(controller, result) if result.complete else None
        known = "payload" not in options  # else the truth is not the mechanism's own
        run = replace(run, lyapunov=_lyapunov(controller, result, mechanism) if known else None, cost=cost)
    except KeyboardInterrupt:
        run = replace(run, rollout=replace(result, complete=False))
    progress(1.0)
    return run


@contextmanager
def shown_live(env: gymnasium.Env[Any, Any], mechanism: Mechanism) -> Iterator[gymnasium.Env[Any, Any]]:
    """Context manager that gives the environment to drive: `env` itself or, within `adaptctl.recording.live.streaming`
    and where the viewer at the address set there can be reached, a wrapper of `env` that also shows the motion of its
    arm, `mechanism`, in that viewer. Gives a `LiveViewWarning` where no viewer can be reached. Raises `InputError` for
    an address other than a port of this computer or a file .rrd, and for a mechanism that cannot be drawn, `FileError`
    for a file in a folder that cannot be written to."""
    from adaptctl.recording.live import CURRENT, Live

    if (to := CURRENT.get()) is None:
        yield env
        return
    from adaptctl.envs.live import LiveView

    with Live(mechanism, to) as live:
        yield LiveView(env, live) if live.is_seen else env


def _lyapunov(controller: Controller[Any], run: Rollout, mechanism: Mechanism) -> Array | None:
    """Lyapunov function (T,) of Slotine and Li's law where it adapts; its relatives' need more than a run keeps."""
    if type(controller) is not SlotineLi or controller.adaptation_law is None or not len(run.time):
        return None
    if controller.model.regrouping.shape[1] != len(mechanism.parameter_names):
        return None  # its model knows less of the arm, friction for one
    if run.marks.get("payload", run.time[:1] * 0.0).any():
        return None  # the truth changes in mid-motion, and no function of it falls across that
    if controller.adaptation_law.distance(controller.model, run.estimate[:1], run.estimate[0]) is None:
        return None
    return lyapunov(controller, run, mechanism)


def tick_cost(controller: Controller[Any], run: Rollout) -> TickCost:
    """Cost of a tick of a `controller`, which computes one torque, over 1000 states of a `run`: the median time of a
    call from Python, s; the mean time in a loop of native code, s, the least of 30; and the number of floating-point
    operations. The last two are None where the control law is not compiled, the native time also beyond 20 000
    operations. Raises `IndexError` for a run without samples."""
    picked = np.linspace(0, len(run.time) - 1, TIMED_TICKS).astype(int)
    states = [run.p[picked], run.v[picked], run.reference_p[picked], run.reference_v[picked], run.reference_a[picked]]
    called, kernel = _called(controller, states), controller.kernel
    if kernel is None:
        return TickCost(called)
    flops = kernel.operations.flops
    if flops > LONG:
        return TickCost(called, flops=flops)
    memory = controller.init(run.p[0], run.v[0])
    kept = [np.concatenate([np.zeros(0), *leaves(memory)]), *([controller.packed] if controller.packed.size else [])]
    arguments = [*states, *(np.tile(part, (TIMED_TICKS, 1)) for part in kept)]
    results = [np.empty((TIMED_TICKS, *shape)) for shape in kernel.outputs]  # fresh ones would time page faults
    native = min(_duration(partial(kernel.map, out=results), *arguments) for _ in range(REPETITIONS))
    return TickCost(called, native / TIMED_TICKS, flops)


def _called(controller: Controller[Any], states: list[Array]) -> float:
    """Median time (s) of a tick called from Python."""
    state = controller.init(states[0][0], states[1][0])
    ticks = [(p, v, ReferencePoint(*reference)) for p, v, *reference in zip(*states, strict=True)]
    return float(np.median([_duration(controller.step, state, *tick) for tick in ticks]))


def _duration(function: Callable[..., object], *arguments: object) -> float:
    started = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - started
