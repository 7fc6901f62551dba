"""Elastic joints under every law: the largest bandwidth of the tracking loop that each law carries, over stiffness."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Controller, ReferencePoint, typical_inertia
from adaptctl.dynamics import Mechanism
from adaptctl.errors import GainError, InputError, NonFiniteError
from adaptctl.experiments.adaptation_laws import AdaptationLaws
from adaptctl.experiments.contest import Outcome
from adaptctl.experiments.experiment import FAR, setting
from adaptctl.experiments.learning import ADAPTATION_OFF, Found
from adaptctl.identifiability import FundamentalBasis
from adaptctl.recording import Comparison, Failure, Finding, Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from adaptctl.simulation import Plant
    from adaptctl.simulation.effects import Effect, ElasticJoints

BANDWIDTHS = 0.5 * 2.0 ** (np.arange(45) / 4.0)
"""1/s that are tried, from 0.5 to 1024"""
SHAKING = 0.25
"""rad/s (m/s): root mean square of velocity errors in a trial's last third, above which a loop shakes"""
SATURATED = 0.01
"""of that third's control periods with a motor at its limit: more is no tracking"""
RIGID = np.inf


@dataclass(frozen=True)
class StableBandwidth(AdaptationLaws):
    """Experiment on elastic joints: the largest bandwidth of the tracking loop at which each law is stable on an arm
    whose motors drive the links through springs, over the springs' stiffness.

    The laws are compared on the stiffest springs, which the settings call the contest; then, for every law and
    stiffness and for the rigid arm, bandwidths from 0.5 to 1024 1/s are tried by bisection. `error_bound` (100 rad or
    m) is the joint error that ends a run; `expected` maps failures of the first controller to the reason why they may
    come. Raises at construction `NotFoundError` for an unknown law or motion, `InputError` for a law given twice and
    settings of the wrong type or out of their bounds, `NonFiniteError` for NaN or infinity.
    """

    name: ClassVar[str] = "stable-bandwidth"
    title: ClassVar[str] = "{robot}: elastic joints, and the bandwidth that each law carries"

    laws: tuple[str, ...] = setting(("gradient", "composite", "computed-torque"), "which laws run, the subject first")
    bandwidth: float = setting(4.0, "how fast errors decay in the contest, 1/s", symbol="Λ", low=0.1, high=2e3)
    duration: float = setting(5.0, "length of every run of the contest, s", low=0.01, high=300.0)
    stiffness: tuple[float, ...] = setting((1e2, 1e3, 1e4, 1e5), "of every joint's spring, N m/rad", low=1e-3, high=1e9)
    damping_ratio: float = setting(
        0.05, "of a spring's own oscillation, between a joint's motor and its typical links", low=0.0, high=2.0
    )
    encoders: str = setting("link", "where encoders sit: behind the spring, on the link, or before it, on the motor")
    trial: float = setting(3.0, "length of the run that decides whether a bandwidth is stable, s", low=0.05, high=60.0)

    error_bound: ClassVar[float] = FAR
    expected: ClassVar[Mapping[Failure, str]] = dict.fromkeys(Failure, "springs ring")

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: up to which bandwidth each law is
        stable on elastic joints."""
        return (
            f"Motors turn the links through springs and dampers (Spong 1987); encoders sit on the {self.encoders}. No "
            f"law knows of the springs. {self.comparing} A bandwidth counts as stable where, after {self.trial:g} s, "
            f"velocity errors are below {SHAKING:g} rad/s and motors below their limits; K is the bandwidth times "
            f"typical inertia times {self.ratio:g} throughout."
        )

    def effects(self) -> Iterator[Effect]:
        """Iterator over the plant's effects besides rigid links: springs in the joints, of the greatest `stiffness` (N
        m/rad), with the damping ratio `damping_ratio` (no unit) and encoders on the link or the motor, as `encoders`
        says; and noise of measured velocities unless it is 0. Raises `InputError` for an arm without rotor inertias and
        for `encoders` other than "link" and "motor", `NotFoundError` or `FileError` for a `robot` that cannot be
        loaded."""
        yield self._springs(self.mechanism(), max(self.stiffness))
        yield from super().effects()

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over the findings, a `Finding` (named number with unit) each: the largest stable bandwidth, 1/s, of
        every law on springs of every stiffness and on the rigid arm, found by bisection among 45 from 0.5 to 1024, 0
        where even the least is not stable; each law's parameter error at the end, |w (estimate - true)| / |w true| (no
        unit), w being the RMS torque that each parameter makes along the reference; the fraction of samples (no unit)
        whose excitation passed the law's threshold, if it has one, or, of laws on pseudo-inertias, the least eigenvalue
        of these, SI units; and the median time, us, of computing one torque. `outcome`, an `Outcome`, has the runs,
        `basis` the k fundamental (base) parameters that are adapted. Nothing is checked."""
        yield from super().findings(outcome, basis)
        labels = {run.name: run.label for run in outcome.runs}
        for stiffness in (*self.stiffness, RIGID):
            plant = self._plant(outcome.mechanism, stiffness)
            for name in (*self.laws, ADAPTATION_OFF):
                found = self._largest(plant, basis, name)
                where = "the rigid arm" if stiffness == RIGID else f"springs of {stiffness:g} N·m/rad"
                meaning = f"{labels.get(name, name)}: largest stable bandwidth on {where}, of those tried, 0.5 to 1024"
                yield Finding(f"stable_bandwidth.{name}.{_stiffness_text(stiffness)}", found, "1/s", meaning)

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Sentence for the report, never None here, with the largest stable bandwidths, 1/s, of the experiment's
        subject (the first of `laws`) on the rigid arm, on the stiffest and on the softest springs, a dash for one that
        is missing; `outcome`, an `Outcome`, has the runs, `found` the findings by name. Nothing is checked."""
        stiffest, softest = max(self.stiffness), min(self.stiffness)
        rigid, stiff, soft = (
            found.text(f"stable_bandwidth.{self.laws[0]}.{_stiffness_text(k)}") for k in (RIGID, stiffest, softest)
        )
        return (
            f"{outcome.runs[0].label} is stable up to {rigid} 1/s on the rigid arm, {stiff} 1/s with springs of "
            f"{stiffest:,.6g} N·m/rad in its joints and {soft} 1/s with springs of {softest:,.6g}."
        )

    def compare(self, progress: Progress) -> Comparison:
        """Comparison of the runs on the stiffest springs, a `Comparison`, with the largest stable bandwidths, 1/s,
        among its findings and in a figure. `progress(what, share)` is called with the step's name and the fraction
        done, 0 to 1. Raises `NotFoundError` for an unknown robot, `FileError` for a file that cannot be used,
        `InputError` for an arm without rotor inertias or a reference that the arm cannot follow, `GainError` for gains
        too large for the control period, `RankError` where the number of fundamental (base) parameters cannot be
        certified."""
        from adaptctl.recording.drawing import Drawing

        done = super().compare(progress)
        found = {finding.name: finding.value for finding in done.findings}
        drawing = Drawing(
            "stable-bandwidth",
            "Largest stable bandwidth over the stiffness of the joints, one line a law; at the right, the rigid arm.",
            partial(bandwidths_over_stiffness, found, self.stiffness, [(run.name, run.label) for run in done.runs]),
        )
        return replace(done, more_drawings=(drawing, *done.more_drawings))

    def _springs(self, mechanism: Mechanism, stiffness: float) -> ElasticJoints:
        """Springs with the damping that is asked for at typical inertias of the links."""
        from adaptctl.simulation.effects import ElasticJoints

        inertia, rotors = typical_inertia(mechanism), _rotors(mechanism)
        links = np.maximum(inertia - rotors, 1e-3 * inertia)
        together = links * rotors / inertia
        return ElasticJoints(
            stiffness, 2.0 * self.damping_ratio * np.sqrt(stiffness * together), encoders=self.encoders
        )

    def _plant(self, mechanism: Mechanism, stiffness: float) -> Plant:
        from adaptctl.simulation import Plant
        from adaptctl.simulation.stiffness import integration
        from adaptctl.simulation.transmission import Transmission

        limits = self.motors(mechanism)
        if stiffness == RIGID:
            return Plant(mechanism, self.control_period, *integration(mechanism, (), self.control_period), limits)
        springs = self._springs(mechanism, stiffness)
        steps = integration(mechanism, (), self.control_period, None, Transmission.of(mechanism, springs))
        return Plant(mechanism, self.control_period, *steps, limits, effects=(springs,))

    def _largest(self, plant: Plant, basis: FundamentalBasis, name: str) -> float:
        """Largest bandwidth that is stable with all smaller ones that a bisection tries."""
        low, high = -1, len(BANDWIDTHS)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self._carries(plant, basis, name, BANDWIDTHS[middle]) else (low, middle)
        return float(BANDWIDTHS[low]) if low >= 0 else 0.0

    def _carries(self, plant: Plant, basis: FundamentalBasis, name: str, bandwidth: float) -> bool:
        laws = self.laws if name == ADAPTATION_OFF else (name,)
        other = replace(self, laws=laws, bandwidth=float(bandwidth))
        try:
            contenders = other.contenders(plant.mechanism, basis)
        except GainError:  # the period does not carry it
            return False
        controller = next(one.controller for one in contenders if one.name == name)
        return tracks(plant, controller, self.reference(plant.mechanism), self.trial)


def tracks(plant: Plant, controller: Controller[Any], reference: Any, seconds: float) -> bool:
    """True if a `controller` follows a `reference` on a `plant` for a run of `seconds`. In the last third of the run,
    the RMS velocity error of all joints must be below 0.25 rad/s (m/s), and in fewer than 1 % of the control periods
    may the torque that the law asks of some joint reach its limit. False also where values become infinite or NaN. The
    run starts on the reference, a function of T times (T,), s, that gives positions, velocities and accelerations (T,
    r) of the plant's r joints, in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic)."""
    count = round(seconds / plant.control_period)
    points = reference(plant.control_period * np.arange(count))
    state = plant.init(points.p[0], points.v[0])
    memory = controller.init(state.measured_p, state.measured_v)
    limits, apart, beyond = np.asarray(plant.torque_limits), [], []
    try:
        for p, v, a in zip(*points, strict=True):
            torque, memory = controller.step(memory, state.measured_p, state.measured_v, ReferencePoint(p, v, a))
            state = plant.step(state, torque)
            apart.append(state.v - v)
            beyond.append(bool((np.abs(torque) >= limits).any()))
    except NonFiniteError:
        return False
    last = slice(2 * count // 3, None)
    return float(np.sqrt(np.mean(np.square(apart[last])))) < SHAKING and float(np.mean(beyond[last])) < SATURATED


def _rotors(mechanism: Mechanism) -> Array:
    """Rotor inertias (r,) of the joints."""
    names = mechanism.parameter_names
    wanted = [f"{joint.name}.rotor_inertia" for joint in mechanism.primary_joints]
    for name in wanted:
        if name not in names:
            raise InputError(
                f"robot: {mechanism.name} has no {name}: springs need motors with inertia; use an arm with rotors"
            )
    return np.array([mechanism.inertial_parameters[names.index(name)] for name in wanted])


def _stiffness_text(stiffness: float) -> str:
    """Name of a stiffness among the findings."""
    return "rigid" if stiffness == RIGID else f"{stiffness:g}"


def bandwidths_over_stiffness(
    found: dict[str, float], stiffness: tuple[float, ...], laws: list[tuple[str, str]]
) -> Figure:
    """Matplotlib figure of the largest stable bandwidths, 1/s, over the `stiffness` (N m/rad) of the joints, a line for
    each of `laws` (pairs of a name and a label), the rigid arm at the right end. `found` maps names of findings, such
    as "stable_bandwidth.gradient.1000" and "stable_bandwidth.gradient.rigid", to bandwidths, 1/s. A bandwidth of 0,
    where none is stable, is drawn at 0.25, a missing one is not drawn. Nothing is checked."""
    from adaptctl.recording.drawing import run_color, sheet

    figure = sheet(3.6)
    axes = figure.subplots()
    each = (*sorted(stiffness), RIGID)
    for i, (name, label) in enumerate(laws):
        values = [
            max(found.get(f"stable_bandwidth.{name}.{_stiffness_text(k)}", np.nan), BANDWIDTHS[0] / 2.0) for k in each
        ]
        axes.semilogy(range(len(each)), values, "o-", color=run_color(i).hex, label=label)
    axes.set_xticks(range(len(each)), [_stiffness_text(k) for k in each])
    axes.set_xlabel("stiffness [N·m/rad]")
    axes.set_ylabel("largest stable bandwidth [1/s]")
    figure.legend(loc="outside upper center", ncols=3)
    return figure
