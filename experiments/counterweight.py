"""Counterweights in closed loop: an arm before and after, with all its parameters adapted and with few components."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import SlotineLi, Subspace
from adaptctl.control.controller import Reference
from adaptctl.design import DesignStudy, DesignTask, design_study
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.errors import InputError
from adaptctl.experiments.contest import Contender, contest
from adaptctl.experiments.experiment import ClosedLoopExperiment, setting
from adaptctl.identifiability import ReducedModel, Reduction, reduce
from adaptctl.recording import ControllerRun, Fact, Progress, Result
from adaptctl.recording.result import Verdict
from adaptctl.tuning import Tuning, tune

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from adaptctl.recording.drawing import Drawing

DESIGN = "Counterweights"
HEAVIEST = "heaviest"
BEFORE, AFTER = "before", "after"
EVERY, FEW, HELD = "all", "few", "held"


class Burden(NamedTuple):
    """Named tuple of what one closed-loop run asked of an arm and its motors. Tracking errors are positions less the
    reference's, rad (m if prismatic), as root mean squares over all joints and samples: `rms_error` of the whole run
    and `final_rms_error` of its last two seconds (None where it was shorter). `rms_torque` (no unit) is the root of the
    mean over time of the sum over joints of (torque / its limit)^2; `work`, J, the motors', the integral over time of
    |torque times velocity| summed over joints; `duration`, s; and `stopped`, True where an error passed its bound.
    Nothing is checked at construction."""

    rms_error: float
    """rad or m, all joints"""
    final_rms_error: float | None
    """over the last two seconds"""
    rms_torque: float
    """share of limits, all joints together"""
    work: float
    """J that the motors did or took, the integral of |torque times velocity| of each joint"""
    duration: float
    """s that it was run"""
    stopped: bool
    """whether an error passed its bound"""


@dataclass(frozen=True)
class CounterweightedTracking(ClosedLoopExperiment):
    """Experiment on counterweights in closed loop: an arm tracks one reference as its file describes it and then with
    optimal counterweights. Each time Slotine and Li's law runs thrice: adapting all parameters, adapting only the
    `components` essential components of most energy, and with their true values and adaptation off. Essential
    components are the parts of the inertial parameters along the right singular vectors of the arm's energies over
    random states.

    The setting `speed` is a multiple (no unit) of sqrt(g/L), in 1/s, g being gravity (m/s^2) and L (m) the largest
    distance from a joint to the next. A link's counterweight lies in the box around its joints and centre of mass,
    widened on all sides by `beyond` (a fraction) of the box's diagonal, 0.1 m at least. `energy_error` (%) is the
    energy error at which the design counts essential components. Raises `InputError` at construction for a setting of
    the wrong type or out of its bounds, `NonFiniteError` for NaN or infinity.
    """

    name: ClassVar[str] = "counterweight"
    title: ClassVar[str] = "{robot}: counterweights in closed loop"

    robot: str = setting("puma560_geared", "a built-in robot or a file (.urdf, .xml, .toml), without friction")
    links: tuple[str, ...] = setting((HEAVIEST,), "links that may carry counterweights, or 'heaviest'")
    share: float = setting(0.2, "largest counterweight over its link's mass", low=0.0, high=10.0)
    beyond: float = setting(0.5, "room beyond a link's joints over its length", low=0.0, high=10.0)
    objective: str = setting("energy", "what they make least: energy, torque, coupling or components")
    speed: float = setting(0.25, "of the random states that the design is for, over sqrt(g/L)", low=0.0, high=10.0)
    samples: int = setting(1000, "random states within the joints' limits", low=10, high=100_000)
    components: int = setting(10, "essential components that the small controllers carry", symbol="s", low=1)
    energy_error: float = setting(1.0, "at which components are counted, %", low=0.0, high=100.0)

    def run(self, progress: Progress) -> Result:
        """Result of comparing an arm with and without counterweights, a `Result`: outcome in words, facts (questions
        with answers), and a function that writes summary, figures, recording and report into a folder that it is given.
        `progress(what, share)` is called with the step's name and the fraction done, 0 to 1. Ctrl-C keeps the runs that
        had begun; where there are none, `KeyboardInterrupt` is raised. Raises `NotFoundError` for an unknown robot,
        `FileError` for a file that cannot be used, `InputError` for an arm with friction or linear constraints between
        its inertial parameters, for more `components` than the arm has essential (identifiable) parameters, for an
        unknown link or objective and for joints that no gains stabilise under a held torque, `RankError` where the
        number of essential parameters cannot be certified."""
        progress(DESIGN, 0.0)
        mechanism = load(self.robot)
        if len(mechanism.parameter_names) != mechanism.energetic:
            raise InputError(f"robot: {mechanism.name} has friction, which carries no energy: use an arm without")
        tuning = tune(mechanism, period=self.control_period, seed=self.seed)
        task = DesignTask.within_limits(mechanism, self.samples, self.seed, self.speed)
        links = () if self.links == (HEAVIEST,) else self.links
        study = design_study(
            task,
            links=links,
            share=self.share,
            beyond=self.beyond,
            objective=self.objective,
            percent=self.energy_error,
            seed=self.seed,
        )
        progress(DESIGN, 1.0)
        return self._judged(study, tuning, *self._driven(study, tuning, progress))

    def _driven(self, study: DesignStudy, tuning: Tuning, progress: Progress) -> tuple[tuple[ControllerRun, ...], bool]:
        """Runs of both arms, in turn, and whether all were run to their end."""
        runs: list[ControllerRun] = []
        for name, task in ((BEFORE, study.task), (AFTER, study.counterweights.balanced)):
            try:
                env = self._environment(task, tuning)
                outcome = contest(env, task.mechanism, self._contenders(name, task, tuning), self.seed, progress)
            except KeyboardInterrupt:
                if not runs:
                    raise
                return tuple(runs), False
            runs += outcome.runs
            if not outcome.complete:
                return tuple(runs), False
        return tuple(runs), True

    def _environment(self, task: DesignTask, tuning: Tuning) -> Any:
        import gymnasium

        reference: Reference = tuning.reference
        return gymnasium.make(
            "adaptctl.envs:adaptctl/Tracking-v0",
            robot=task.mechanism,
            reference=reference,
            duration=self.duration,
            control_period=self.control_period,
            substeps=tuning.substeps,
            integrator=tuning.integrator,
            torque_limits=tuning.torque_limits,
            initial_error=tuning.initial_error,
        )

    def _contenders(self, name: str, task: DesignTask, tuning: Tuning) -> list[Contender]:
        """Controllers with the same gains: adapting all, adapting few components, holding the true few."""
        model, reduction = ReducedModel(task.mechanism, task.basis), self._reduction(task)
        s, order = self.components, list(reduction.order)
        directions = task.space.basis[:, order[:s]]
        few = Subspace(directions.T**2 @ tuning.adaptation, model.regrouping @ directions)
        held = model.regrouping @ reduction.parameters(s)
        gains, label = tuning.gains, "as described" if name == BEFORE else "with counterweights"

        def slotine_li(law: Any, first: Array) -> SlotineLi:
            given = first, self.control_period, tuning.workspace, tuning.torque_limits
            return SlotineLi(model, gains.bandwidth, gains.damping, law, *given)

        nothing = np.zeros(len(model.columns))
        return [
            Contender.of(
                f"{EVERY}-{name}", f"All adapted, {label}", "nothing", slotine_li(tuning.gain_on(model), nothing)
            ),
            Contender.of(f"{FEW}-{name}", f"{s} adapted, {label}", "nothing", slotine_li(few, nothing)),
            Contender.of(f"{HELD}-{name}", f"True {s}, {label}", f"{s} components", slotine_li(None, held)),
        ]

    def _reduction(self, task: DesignTask) -> Reduction:
        if self.components > task.space.rank:
            raise InputError(
                f"components: {task.mechanism.name} has {task.space.rank} essential parameters, got {self.components}"
            )
        return reduce(task.space, task.parameters, components=self.components)

    def _judged(self, study: DesignStudy, tuning: Tuning, runs: tuple[ControllerRun, ...], complete: bool) -> Result:
        burdens = {run.name: burden(run, tuning.torque_limits) for run in runs}
        words = _outcome_words(study, burdens, self.components)
        facts = tuple(_facts(burdens, self.components, error_unit(study.task.mechanism)))
        write = partial(self._write, study, runs, burdens, words, complete)
        return Result(complete, words, facts, Verdict(), write)

    def _write(
        self,
        study: DesignStudy,
        runs: tuple[ControllerRun, ...],
        burdens: dict[str, Burden],
        words: str,
        complete: bool,
        folder: Any,
        progress: Progress,
    ) -> None:
        from adaptctl.design.files import Named, as_builtins, write_study

        title = self.title.format(robot=study.task.mechanism.name)
        shown = tuple(self._drawings(study.task.mechanism, runs))
        facts = tuple(_facts(burdens, self.components, error_unit(study.task.mechanism)))
        named = Named(self.name, title, "summary.json", self.seed, complete, words, facts, shown, runs)
        content = as_builtins(study) | {
            "experiment": self.name,
            "complete": complete,
            "settings": asdict(self),
            "runs": {name: found._asdict() for name, found in burdens.items()},
        }
        write_study(folder, study, content, named, progress)

    def _drawings(self, mechanism: Mechanism, runs: tuple[ControllerRun, ...]) -> Iterator[Drawing]:
        from adaptctl.recording.drawing import Drawing

        yield Drawing(
            "tracking",
            "Tracking errors of all joints, averaged over 0.25 s, as described and with counterweights.",
            partial(tracking_figure, mechanism, runs),
        )
        yield Drawing(
            "applied",
            "Applied torque of every joint, all parameters adapted, as described and with counterweights.",
            partial(applied_figure, mechanism, runs),
        )


def burden(run: ControllerRun, limits: Array) -> Burden:
    """Tracking errors, torque, work and duration of one closed-loop `run` of r joints, a `Burden`; torques are divided
    by `limits` (r,), N m (N if prismatic). Nothing is checked."""
    rollout = run.rollout
    shares = rollout.applied / limits
    power = np.sum(np.abs(rollout.applied * rollout.v), axis=1)
    return Burden(
        float(np.sqrt(np.mean(rollout.error**2))),
        run.final_rms_error,
        float(np.sqrt(np.mean(np.sum(shares**2, axis=1)))),
        float(np.sum(power) * rollout.spacing),
        run.duration,
        rollout.terminated,
    )


def tracking_figure(mechanism: Mechanism, runs: tuple[ControllerRun, ...]) -> Figure:
    """Matplotlib figure of the root mean square tracking error of all joints, in mrad (mm), over the 0.25 s before each
    time (s): a line for each of the `runs`, on a logarithmic scale, solid with counterweights (runs whose names end in
    "after") and dashed without. `mechanism` gives the unit by the kinds of its joints. Nothing is checked."""
    from adaptctl.recording.drawing import run_color, sheet, thinned

    figure = sheet(3.6)
    axes = figure.subplots()
    for i, run in enumerate(runs):
        every = thinned(len(run.rollout.time), 3000)
        dash = "-" if run.name.endswith(AFTER) else (0, (4, 2))
        errors = 1e3 * run.moving_rms_error(0.25)[every]
        axes.semilogy(run.rollout.time[every], errors, color=run_color(i % 3).hex, linestyle=dash, label=run.label)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"RMS tracking error [{error_unit(mechanism)}]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def applied_figure(mechanism: Mechanism, runs: tuple[ControllerRun, ...]) -> Figure:
    """Matplotlib figure of the applied torque, N m (N if prismatic), of every primary (independently moving) joint of a
    mechanism over time, s, a panel for each: those of the `runs` that adapt all parameters, by their names
    "all-before", without counterweights, and "all-after", with them. Nothing is checked."""
    from adaptctl.recording.drawing import run_color, sheet, thinned
    from adaptctl.recording.wording import torque_units

    shown = [run for run in runs if run.name.startswith(EVERY)]
    dof, units = mechanism.dof, torque_units(mechanism)
    figure = sheet(1.6 * -(-dof // 3) + 0.6)
    panels = figure.subplots(-(-dof // 3), min(3, dof), sharex=True, squeeze=False).ravel()
    for j, axes in enumerate(panels):
        axes.set_visible(j < dof)
        for i, run in enumerate(shown if j < dof else []):
            every = thinned(len(run.rollout.time), 1500)
            color = run_color(1 - i).hex
            axes.plot(run.rollout.time[every], run.rollout.applied[every, j], color=color, label=run.label, lw=1.2)
        if j < dof:
            axes.set_title(f"{mechanism.primary_joints[j].name} [{units[j]}]")
        later = [run.rollout.applied[len(run.rollout.time) // 10 :, j] for run in (shown if j < dof else [])]
        if later and (reach := 1.15 * max(float(np.abs(values).max(initial=0.0)) for values in later)) > 0.0:
            axes.set_ylim(-reach, reach)  # the first moments, off the reference, ask for far more
    figure.supxlabel("time [s]", size=9)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def _outcome_words(study: DesignStudy, burdens: dict[str, Burden], components: int) -> str:
    """The outcome in a few sentences."""
    weights = " and ".join(f"{weight.mass:.3g} kg on {weight.link}" for weight in study.counterweights.weights)
    start = f"With counterweights of {weights}" if weights else "Without counterweights, for none helps"
    text = f"{start}, the arm carries {_carried(study)} energy."
    pairs = [(burdens.get(f"{EVERY}-{name}"), burdens.get(f"{FEW}-{name}")) for name in (BEFORE, AFTER)]
    (old, few_old), (new, few_new) = pairs
    unit = error_unit(study.task.mechanism)
    if old and new and few_old and few_new:
        text += (
            f" In closed loop its motors do {_change(old.work, new.work)} work. With few components adapted, the "
            f"tracking error of the last two seconds is {_error(few_new, unit)} instead of {_error(few_old, unit)}."
        )
    return text


def _error(found: Burden, unit: str) -> str:
    """The error of the last two seconds; where the environment ended the run, when."""
    if found.stopped or found.final_rms_error is None:
        return f"{'stopped' if found.stopped else 'ended'} at {found.duration:.3g} s"
    return f"{1e3 * found.final_rms_error:.3g} {unit}"


def _carried(study: DesignStudy) -> str:
    """Relative change of the carried energy, in words."""
    share = study.counterweights.balanced.cost("energy") / study.task.cost("energy") - 1.0
    return _more_or_less(share)


def _change(before: float, after: float) -> str:
    """Relative change of what is positive, in words."""
    return _more_or_less(after / before - 1.0) if before > 0.0 else "as much"


def _more_or_less(share: float) -> str:
    return f"{100.0 * abs(share):.3g} % {'more' if share > 0.0 else 'less'}"


def _facts(burdens: dict[str, Burden], components: int, unit: str) -> Iterator[Fact]:
    words = {EVERY: "all adapted", FEW: f"{components} adapted", HELD: f"true {components}"}
    for kind, what in words.items():
        found = [burdens[name] for name in (f"{kind}-{BEFORE}", f"{kind}-{AFTER}") if name in burdens]
        if found:
            yield Fact(f"Error, {what}", " → ".join(_error(one, unit) for one in found))
    first = [burdens[name] for name in (f"{EVERY}-{BEFORE}", f"{EVERY}-{AFTER}") if name in burdens]
    yield Fact("Torque, of its limit (RMS)", " → ".join(f"{100.0 * b.rms_torque:.3g}" for b in first) + " %")
    yield Fact("Motors' work", " → ".join(f"{b.work:.3g}" for b in first) + " J")
