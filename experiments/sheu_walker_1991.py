"""Sheu and Walker (1991), replicated: tables and figures with a verdict each, and their two arms in closed loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.control import Sinusoids, SlotineLi
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.errors import InputError, NotFoundError
from adaptctl.experiments.contest import ADAPTATION_OFF, ADAPTIVE, FULL, Contender, contest, listed, live_subject
from adaptctl.experiments.experiment import ClosedLoopExperiment, require_count, setting, stated
from adaptctl.experiments.replication import puma560, semi_direct_drive
from adaptctl.experiments.replication.cases import Study
from adaptctl.experiments.replication.judging import Computation, Item, item
from adaptctl.experiments.replication.pages import Replication
from adaptctl.experiments.replication.printed import printed
from adaptctl.experiments.replication.serial_versus_graph import PURPOSE, shown
from adaptctl.experiments.replication.sides import Side, SideBySide
from adaptctl.experiments.tip_path import ARMS, ArmWithTip, TipPath
from adaptctl.identifiability import FundamentalBasis, ReducedModel, essential_space, fundamental_basis
from adaptctl.recording import Comparison, Progress, Result, Setting

if TYPE_CHECKING:
    import gymnasium

ITEMS: dict[str, Callable[[Study], Computation]] = {
    "section5.3" if step is semi_direct_drive.section53 else step.__name__: step
    for step in (*puma560.STEPS, *semi_direct_drive.STEPS)
}
"""In the order of the paper. Figures 2 and 5 are drawings of the two arms."""
ALL, ARMS_IN_LOOP = "all", "serial-versus-graph"
OF_TABLES = ("seed", "only", "seeds", "samples", "velocity_scale", "frequency", "motion_samples", "unequal")


@dataclass(frozen=True)
class SheuWalker1991(TipPath, ClosedLoopExperiment):
    """Experiment that replicates Sheu and Walker (1991), "Identifying the independent inertial parameter space of robot
    manipulators": every table and figure of its PUMA 560 and semi-direct-drive arm is computed again and compared with
    what the paper prints; or, where `only` is "serial-versus-graph", the arms of its section 5.3, the PUMA's first
    three joints and a five-bar, follow one path in space with Slotine and Li's law.

    Both tips then start equally far off the path; the law drives each arm from zero initial estimates, on the k
    fundamental (base) parameters and on all, and with adaptation off, with gains by one rule: Λ is the bandwidth (1/s)
    and I a joint's typical inertia. Raises at construction `NotFoundError` for an unknown table or figure in `only`,
    `InputError` for a setting of the wrong type, length or out of its bounds, `NonFiniteError` for NaN or infinity."""

    name: ClassVar[str] = "sheu-walker-1991"
    title: ClassVar[str] = "Sheu and Walker (1991), replicated"

    only: tuple[str, ...] = setting(
        (ALL,), f"what to compute: {ALL}, or any of {', '.join(ITEMS)}; or the two arms in closed loop: {ARMS_IN_LOOP}"
    )
    seeds: int = setting(200, "draws of random states where the paper made one, from --seed on", low=2, high=10_000)
    samples: int = setting(101, "states a draw; the paper's 101", low=62, high=10_000)
    velocity_scale: float = setting(
        3**0.5,
        "velocities are uniform up to this times the paper's bound; the root of 3 makes the bound their root mean "
        "square, which meets the scale of Table 2",
        low=0.01,
        high=100.0,
    )
    frequency: float = setting(  # type: ignore[assignment]
        0.7, "of the sinusoid for computed torques, Hz; this one meets the scale of Table 3", low=0.01, high=10.0
    )
    motion_samples: int = setting(501, "samples over the sinusoid's period", low=11, high=5001)
    unequal: float = setting(
        0.005, "share by which link 4 of the nearly parallel arm is longer than link 2", low=1e-5, high=0.1
    )
    bandwidth: float = setting(8.0, "how fast the arms' errors decay, 1/s", symbol="Λ", low=0.1, high=100.0)
    stiffness: float = setting(
        3.0, "damping K is this times Λ times each joint's typical inertia", symbol="K/(Λ I)", low=0.1, high=100.0
    )
    rate: float = setting(
        0.6,
        "adaptation rate: the gain is it times the square of each parameter's prior range",
        symbol="Γ",
        low=1e-6,
        high=1e3,
    )
    mass_range: float = setting(10.0, "prior range of masses, kg", low=1e-3, high=1e3)
    first_moment_range: float = setting(4.0, "prior range of first moments, kg m", low=1e-3, high=1e3)
    inertia_range: float = setting(1.0, "prior range of inertias, kg m^2", low=1e-3, high=1e3)
    path_center: tuple[float, ...] = setting((0.55, 0.0, 0.47), "centre of the tips' path, m", low=-10.0, high=10.0)
    path_amplitude: tuple[float, ...] = setting((0.1, 0.25, 0.15), "its amplitude, m", low=0.0, high=10.0)
    path_frequency: tuple[float, ...] = setting((0.4, 0.2, 0.2), "its frequency, Hz", low=0.0, high=5.0)
    path_phase: tuple[float, ...] = setting((1.5708, 0.0, 1.5708), "its phase, rad", low=-10.0, high=10.0)
    start_time: float = setting(2.0, "length of the smooth (quintic) start, s", low=0.0, high=60.0)
    start_off: tuple[float, ...] = setting((0.05, 0.05, -0.05), "the tips' first error, m", low=-0.5, high=0.5)

    def __post_init__(self) -> None:
        super().__post_init__()
        chosen(self.only)
        paths = ("path_center", "path_amplitude", "path_frequency", "path_phase", "start_off")
        require_count(self, paths, 3, "x, y and z")

    def run(self, progress: Progress) -> Result:
        """Result of the replication, or of the arms in closed loop, a `Result`. `progress(what, share)` is called with
        the step's name and the fraction done, 0 to 1; Ctrl-C (`KeyboardInterrupt`) keeps what is done, and is raised
        where nothing is. Raises `RankError` where an arm's number of independent parameters cannot be certified,
        `InputError` for a path that is out of reach, `GainError` for gains too large for the control period."""
        return shown(self.side_by_side(progress)) if chosen(self.only) == () else self.compare(progress).result

    def compare(self, progress: Progress) -> Replication:
        """Replication of the tables and figures that `only` names, in the paper's order; otherwise as `run`."""
        started, names, study = time.perf_counter(), chosen(self.only), self.study
        items = list[Item]()
        try:
            for i, name in enumerate(names):
                progress("Tables and figures", i / len(names))
                items.append(item(name, study.paper, ITEMS[name](study), study.numbers))
            progress("Tables and figures", 1.0)
        except KeyboardInterrupt:
            if not items:
                raise
        return Replication(
            experiment=self.name,
            title=self.title,
            study=study,
            items=tuple(items),
            settings=tuple(self._stated(of_tables=True)),
            seconds=time.perf_counter() - started,
            complete=len(items) == len(names),
        )

    @property
    def study(self) -> Study:
        """Arms, draws and torques behind the tables, none of them computed yet."""
        return Study(paper=printed(), **{name: getattr(self, name) for name in OF_TABLES if name != "only"})

    def _stated(self, of_tables: bool) -> Iterator[Setting]:
        names = {f"--{name.replace('_', '-')}" for name in OF_TABLES}
        own = {"--seed"} if not of_tables else names
        yield from (one for one in stated(self) if (one.name in names) == of_tables or one.name in own)

    @property
    def path(self) -> Sinusoids:
        """Desired path of the tips in the world: positions x, y, z in m, with velocities and accelerations."""
        amplitude, frequency, phase = map(np.array, (self.path_amplitude, self.path_frequency, self.path_phase))
        return Sinusoids(np.array(self.path_center), amplitude, frequency, phase, self.start_time)

    def side_by_side(self, progress: Progress) -> SideBySide:
        """Runs of both arms along the path, one arm after the other; otherwise as `run`."""
        sides, complete = list[Side](), True
        for arm in ARMS:
            try:
                sides.append(self.side(arm, partial(_told, progress, arm.label)))
            except KeyboardInterrupt:
                if not sides:
                    raise
                complete = False
            if not (complete := complete and sides[-1].comparison.complete):
                break
        law = Setting("first estimate", "0", "of every parameter")
        own = [replace(k, name=f"{k.name}, {one.arm.name}") for one in sides for k in one.comparison.settings]
        return SideBySide(
            experiment=self.name,
            title="A serial arm and one with a loop, on one task",
            sides=tuple(sides),
            settings=(*own, law, *self.path_settings("tip"), *self._stated(of_tables=False)),
            seed=self.seed,
            duration=self.duration,
            complete=complete,
        )

    def side(self, arm: ArmWithTip, progress: Progress) -> Side:
        """Runs of one `arm` with its tip; otherwise as `run`."""
        progress("independent parameters from energies", 0.0)
        mechanism = load(arm.robot)
        tip = arm.on(mechanism)
        space = essential_space(mechanism, seed=self.seed)
        basis = fundamental_basis(space)
        env = self._environment(tip, arm)
        progress("independent parameters from energies", 1.0)
        contenders = self._contenders(mechanism, basis)
        outcome = contest(env, mechanism, contenders, self.seed, progress)
        comparison = Comparison(
            experiment=self.name,
            title=mechanism.name,
            purpose=PURPOSE,
            mechanism=mechanism,
            space=space,
            basis=basis,
            runs=outcome.runs,
            torque_limits=env.action_space.high,  # type: ignore[attr-defined]  # a Box, as every torque's space
            settings=(Setting("K", listed(self.gains(mechanism).damping), "damping, N·m·s, a joint each"),),
            seed=self.seed,
            duration=self.duration,
            complete=outcome.complete,
            without_adaptation=ADAPTATION_OFF,
            live=live_subject(env, contenders[0].controller, self.seed, {}) if outcome.complete else "",
        )
        desired = {run.name: self.path(run.rollout.time).p for run in outcome.runs}
        return Side(arm, comparison, desired, {run.name: tip.at(run.rollout.p) for run in outcome.runs})

    def _environment(self, tip: Tip, arm: ArmWithTip) -> gymnasium.Env[Any, Any]:
        import gymnasium

        reference = self.in_joints(tip, arm)
        first = reference(0.0).p
        off = tip.joints(tip.at(first) + np.array(self.start_off), first) - first
        return gymnasium.make(
            "adaptctl.envs:adaptctl/Tracking-v0",
            robot=tip.mechanism,
            reference=reference,
            duration=self.duration,
            control_period=self.control_period,
            initial_error=off,
        )

    def _contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Contenders: learning on the independent parameters, with adaptation off, and on all parameters."""
        model, full, gains = ReducedModel(mechanism, basis), ReducedModel.full(mechanism), self.gains(mechanism)

        def slotine_li(on: ReducedModel, adapts: bool = True) -> SlotineLi:
            gain = self.adaptation(on) if adapts else None
            return SlotineLi(on, gains.bandwidth, gains.damping, gain, period=self.control_period)

        k, everything = len(model.columns), len(full.columns)
        return [
            Contender.of(ADAPTIVE, f"Slotine-Li, {k} parameters", "nothing", slotine_li(model)),
            Contender.of(ADAPTATION_OFF, "Slotine-Li, adaptation off", "nothing", slotine_li(model, adapts=False)),
            Contender.of(FULL, f"Slotine-Li, all {everything} parameters", "nothing", slotine_li(full)),
        ]


def _told(progress: Progress, arm: str, what: str, share: float) -> None:
    progress(f"{arm}: {what}", share)


def chosen(names: Iterable[str]) -> tuple[str, ...]:
    """Names of the tables, figures and sections that `names` ask for, in the paper's order, each once: "all" is all of
    them, "serial-versus-graph" alone none. Raises `NotFoundError` for an unknown name, `InputError` for the arms in
    closed loop together with others."""
    asked = set(names)
    for name in sorted(asked - ITEMS.keys() - {ALL, ARMS_IN_LOOP}):
        close = get_close_matches(name, (*ITEMS, ARMS_IN_LOOP), n=1)
        guess = f" (did you mean {close[0]!r}?)" if close else ""
        there = ", ".join((*ITEMS, ARMS_IN_LOOP))
        raise NotFoundError(f"only: there is no {name!r}{guess}; there are {there}, and {ALL}")
    if ARMS_IN_LOOP in asked and len(asked) > 1:
        raise InputError(f"only: {ARMS_IN_LOOP} is a run of its own; ask for it alone")
    return tuple(name for name in ITEMS if name in asked or ALL in asked)
