"""A serial arm against one with a closed loop, on one task: section 5.3 of Sheu and Walker (1991)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.control import SlotineLi
from adaptctl.dynamics import Mechanism, equation_costs, load
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.experiments.contest import Contender, Outcome, contest, live_subject
from adaptctl.experiments.experiment import ClosedLoopExperiment, require_count, setting, stated
from adaptctl.experiments.learning import ADAPTATION_OFF, ADAPTIVE, FULL, numbers
from adaptctl.experiments.serial_versus_graph.artifacts import shown
from adaptctl.experiments.serial_versus_graph.result import OperationCounts, Side, SideBySide
from adaptctl.experiments.tip_path import ARMS, ArmWithTip, TipPath
from adaptctl.identifiability import (
    EssentialSpace,
    FundamentalBasis,
    ReducedModel,
    essential_space,
    fundamental_basis,
)
from adaptctl.recording import Comparison, Progress, Result, Setting

if TYPE_CHECKING:
    import gymnasium


@dataclass(frozen=True)
class SerialVersusGraph(TipPath, ClosedLoopExperiment):
    """Experiment that compares a serial arm, the PUMA's first three joints, with one that has a closed loop, a five-bar
    linkage: numbers of parameters and operations, and tracking of one path in space (Sheu and Walker 1991, section
    5.3).

    Both tips follow one path, turned into joint positions by inverse kinematics, and start equally far off it. Slotine
    and Li's law drives both arms from zero initial estimates, on the k fundamental (base) parameters and on all, and
    with adaptation off, with gains by one rule. In the settings Λ is the bandwidth (1/s) and I a joint's typical
    inertia (the median of its entry of the mass matrix's diagonal over 200 random configurations). Raises `InputError`
    at construction for a `center`, `amplitude`, `frequency`, `phase` or `start_off` that has not three entries (x, y,
    z), and for settings of the wrong type or out of their bounds, `NonFiniteError` for NaN or infinity.
    """

    name: ClassVar[str] = "serial-versus-graph"
    title: ClassVar[str] = "A serial arm and one with a loop, on one task"

    bandwidth: float = setting(8.0, "how fast errors decay, 1/s", symbol="Λ", low=0.1, high=100.0)
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
    center: tuple[float, ...] = setting((0.55, 0.0, 0.47), "centre of the tip's path, m", low=-10.0, high=10.0)
    amplitude: tuple[float, ...] = setting((0.1, 0.25, 0.15), "amplitude of the tip's path, m", low=0.0, high=10.0)
    frequency: tuple[float, ...] = setting((0.4, 0.2, 0.2), "frequency of the tip's path, Hz", low=0.0, high=5.0)
    phase: tuple[float, ...] = setting((1.5708, 0.0, 1.5708), "phase of the tip's path, rad", low=-10.0, high=10.0)
    start_time: float = setting(2.0, "length of the smooth (quintic) start, s", low=0.0, high=60.0)
    start_off: tuple[float, ...] = setting((0.05, 0.05, -0.05), "the tips' first error, m", low=-0.5, high=0.5)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count(self, ("center", "amplitude", "frequency", "phase", "start_off"), 3, "x, y and z")

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: how many parameters and operations,
        and how much tracking error, an arm with a closed loop costs, against a serial arm on the same path."""
        return (
            "Sheu and Walker compare two arms whose end points move with three degrees of freedom: the PUMA's first "
            "three joints, and the semi-direct-drive arm, whose forearm follows through a closed loop. How much does "
            "the loop cost? Both tips follow one path in space, and both controllers start knowing nothing, by the "
            "same distance off it. The PUMA's wrist is held straight, its tip is the flange."
        )

    def run(self, progress: Progress) -> Result:
        """Result of comparing both arms, a `Result`: outcome in words, facts (questions with answers), verdict, and a
        function that writes the result files into a folder that it is given. `progress(what, share)` is called with the
        step's name and the fraction done, 0 to 1; Ctrl-C keeps the runs begun; where there are none,
        `KeyboardInterrupt` is raised. Raises `InputError` for a path that is out of reach, `GainError` for gains too
        large for the control period, `RankError` where an arm's number of fundamental (base) parameters cannot be
        certified."""
        return shown(self.compare(progress))

    def compare(self, progress: Progress) -> SideBySide:
        """Outcome of the comparison, a `SideBySide`: the simulated runs of both arms, one after the other.
        `progress(what, share)` is called with the step's name and the fraction done, 0 to 1; Ctrl-C keeps the runs
        begun; where there are none, `KeyboardInterrupt` is raised. Raises `InputError` for a path that is out of reach,
        `GainError` for gains too large for the control period, `RankError` where an arm's number of fundamental (base)
        parameters cannot be certified."""
        sides: list[Side] = []
        complete = True
        for arm in ARMS:
            try:
                sides.append(self.side(arm, partial(_report_progress, progress, arm.label)))
            except KeyboardInterrupt:
                if not sides:
                    raise
                complete = False
            if not (complete := complete and sides[-1].comparison.complete):
                break
        return SideBySide(
            experiment=self.name,
            title=self.title,
            purpose=self.purpose,
            sides=tuple(sides),
            settings=tuple(self._settings(sides)),
            seed=self.seed,
            duration=self.duration,
            complete=complete,
        )

    def side(self, arm: ArmWithTip, progress: Progress) -> Side:
        """Simulated runs of one `arm` with its tip, a `Side`: the controllers' runs on it, the motions of its tip, and
        the numbers of operations and parameters of its model. `progress(what, share)` is called with the step's name
        and the fraction done, 0 to 1. Raises `InputError` for a path that is out of reach, `GainError` for gains too
        large for the control period, `RankError` where the number of fundamental parameters cannot be certified."""
        progress("independent parameters from energies", 0.0)
        mechanism = load(arm.robot)
        tip = arm.on(mechanism)
        space = essential_space(mechanism, seed=self.seed)
        basis = fundamental_basis(space)
        env = self._environment(tip, arm)
        progress("independent parameters from energies", 1.0)
        contenders = self._contenders(mechanism, basis)
        outcome = contest(env, mechanism, contenders, self.seed, progress)
        live = live_subject(env, contenders[0].controller, self.seed, {}) if outcome.complete else ""
        loops = mechanism.description.loops
        return Side(
            name=arm.name,
            label=arm.label,
            comparison=replace(self._comparison(mechanism, space, basis, env, outcome), live=live),
            tip_link=[link.name for link in mechanism.links].index(arm.link),
            tip=tip.offset,
            desired={run.name: self.path(run.rollout.time).p for run in outcome.runs},
            tips={run.name: tip.at(run.rollout.p) for run in outcome.runs},
            regressor=regressor_counts(mechanism, basis),
            closures=len(loops.closures) if loops else 0,
            printed_rank=arm.printed_rank,
        )

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

    def _comparison(
        self,
        mechanism: Mechanism,
        space: EssentialSpace,
        basis: FundamentalBasis,
        env: gymnasium.Env[Any, Any],
        outcome: Outcome,
    ) -> Comparison:
        return Comparison(
            experiment=self.name,
            title=mechanism.name,
            purpose=self.purpose,
            mechanism=mechanism,
            space=space,
            basis=basis,
            runs=outcome.runs,
            torque_limits=env.action_space.high,  # type: ignore[attr-defined]  # a Box, as every torque's space
            settings=(Setting("K", numbers(self.gains(mechanism).damping), "damping, N·m·s, a joint each"),),
            seed=self.seed,
            duration=self.duration,
            complete=outcome.complete,
            without_adaptation=ADAPTATION_OFF,
        )

    def _settings(self, sides: list[Side]) -> Iterator[Setting]:
        for side in sides:
            for own in side.comparison.settings:
                yield Setting(f"{own.name}, {side.name}", own.value, own.meaning)
        yield Setting("first estimate", "0", "of every parameter")
        yield from self.path_settings("tip")
        yield from stated(self)


def _report_progress(progress: Progress, arm: str, what: str, share: float) -> None:
    progress(f"{arm}: {what}", share)


def regressor_counts(mechanism: Mechanism, basis: FundamentalBasis) -> OperationCounts:
    """Counts of floating-point operations, an `OperationCounts`, of a mechanism's Slotine-Li regressor (the matrix that
    takes parameters to torques), on the fundamental (base) parameters of `basis` and on all; closing its kinematic
    loops is not counted. Nothing is checked."""
    return OperationCounts(equation_costs(mechanism, basis.columns).regressor, equation_costs(mechanism).regressor)
