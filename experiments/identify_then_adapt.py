"""Adaptation from estimates identified from a log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Gains, Sinusoids, SlotineLi
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.dynamics import Mechanism, load
from adaptctl.experiments.contest import (
    ADAPTATION_OFF,
    ADAPTIVE,
    NO_MODEL,
    Contender,
    Learning,
    Outcome,
    Told,
    chosen_gains,
)
from adaptctl.experiments.experiment import DIVERGENCE_ERROR, setting, validate_count
from adaptctl.experiments.laws_controllers import deviations
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import Finding, Setting, wording

if TYPE_CHECKING:
    import gymnasium

FROM_ZERO, FROM_FILE = "from-zero", "from-urdf"
FIRST_WINDOW = 2.0
"""s of the first errors"""


@dataclass(frozen=True)
class IdentifyThenAdapt(Learning):
    """Experiment of adapting from identified estimates."""

    name: ClassVar[str] = "identify-then-adapt"
    title: ClassVar[str] = "{robot}: adaptation from an identified estimate"

    robot: str = setting("tx40", "an example with a real log")
    training_share: float = setting(
        0.6, "fraction of the log that the initial estimate is identified from", low=0.3, high=1.0
    )
    duration: float = setting(10.0, "duration of every run, s", low=2.5, high=300.0)
    bandwidth: float = setting(8.0, "bandwidth, the decay rate of errors, 1/s", symbol="Λ", low=0.1, high=100.0)
    damping_scale: float = setting(
        2.0, "damping divided by Λ and the typical inertia of the joint", symbol="K", low=0.1, high=100.0
    )
    gain_scale: float = setting(
        50.0,
        "adaptation gain of each parameter divided by the variance of its prior, 1/J",
        symbol="Γ",
        low=1e-6,
        high=1e6,
    )
    parameter_error: float = setting(0.9, "prior deviation of each link, relative to its size", low=0.01, high=0.9)
    initial_error: float = setting(0.0, "initial error of every joint, rad or m", low=-1.0, high=1.0)
    center: tuple[float, ...] = setting(
        (0.0, 0.3, 1.0, 0.0, 0.6, 0.0), "centre of the sinusoids, rad", low=-10.0, high=10.0
    )
    amplitude: tuple[float, ...] = setting(
        (0.6, 0.5, 0.5, 0.6, 0.5, 0.8), "amplitude of the sinusoids, rad", low=0.0, high=3.2
    )
    frequency: tuple[float, ...] = setting(
        (0.4, 0.45, 0.5, 0.55, 0.6, 0.7), "frequency of the sinusoids, Hz", low=0.0, high=5.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_count(self, ("center", "amplitude", "frequency"), 6, "one per joint")

    @property
    def purpose(self) -> str:
        """Question of the experiment."""
        return (
            "The benefit of an initial estimate from a real log. The simulated arm has the parameters identified from "
            "the whole log, including rotors, friction and the wrist coupling. Slotine and Li's controller adapts "
            "with one gain, from zero, from the links of the URDF file, and from the parameters of the first "
            f"{self.training_share:.0%} of the log."
        )

    def mechanism(self) -> Mechanism:
        """Example arm with parameters from its whole log."""
        return identified_from(self.robot, 1.0)

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Tracking environment on sinusoids."""
        return self.tracking(
            mechanism,
            Sinusoids(np.array(self.center), np.array(self.amplitude), np.array(self.frequency)),
            initial_error=self.initial_error,
            error_bound=DIVERGENCE_ERROR,
            torque_limits=finite_torque_limits(mechanism),
        )

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Controllers from several first estimates."""
        model, gains = (
            ReducedModel(mechanism, basis),
            Gains.from_bandwidth(mechanism, self.bandwidth, self.damping_scale),
        )
        gain = self.gain_scale * deviations(model, mechanism.inertial_parameters, self.parameter_error) ** 2
        part = _parameters(mechanism, identified_from(self.robot, self.training_share))
        file = _parameters(mechanism, robot_file(self.robot))
        share = f"{self.training_share:.0%} of the log"

        def law(first: Array, adaptation: Array | None = gain) -> SlotineLi:
            start = model.regrouping @ first
            return SlotineLi(model, gains.bandwidth, gains.damping, adaptation, start, self.control_period)

        return [
            Contender(ADAPTIVE, "Identified, adaptive", share, partial(law, part)),
            Contender(ADAPTATION_OFF, "Identified, adaptation off", share, partial(law, part, None)),
            Contender(FROM_FILE, "From the URDF, adaptive", "URDF links", partial(law, file)),
            Contender(FROM_ZERO, "From zero, adaptive", NO_MODEL, partial(law, 0.0 * part)),
        ]

    def chosen(self, mechanism: Mechanism, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Chosen settings: gains, first estimate."""
        gains = Gains.from_bandwidth(mechanism, self.bandwidth, self.damping_scale)
        rule = f"prior deviation: {100 * self.parameter_error:.0f} % of the size of each link and drive"
        first = "identified from the first part of the log"
        yield from chosen_gains(gains, f"{self.gain_scale:g} × (deviation)²", rule, first)

    def told(self, outcome: Outcome, basis: FundamentalBasis) -> Told:
        """Errors of the first two seconds by first estimate."""
        measured = {run.name: run.rms_error(stop=FIRST_WINDOW) for run in outcome.runs}
        first = {name: error for name, error in measured.items() if error is not None}
        findings = [
            Finding(f"first_error.{name}", value, "rad", f"RMS error of the first {FIRST_WINDOW:g} s, {name}")
            for name, value in first.items()
        ]
        if FROM_ZERO in first and first.get(ADAPTIVE):
            meaning = (
                f"RMS error of the first {FIRST_WINDOW:g} s, from zero, divided by that from the identified estimate"
            )
            findings.append(Finding("zero_over_identified", first[FROM_ZERO] / first[ADAPTIVE], "1", meaning))
        if not {ADAPTIVE, FROM_ZERO, FROM_FILE} <= set(first):
            return Told(findings)
        told = [wording.number(1e3 * first[name], 2) for name in (ADAPTIVE, FROM_FILE, FROM_ZERO)]
        return Told(
            findings,
            f"The RMS tracking error of the first {FIRST_WINDOW:g} s is {told[0]} mrad from the identified estimate, "
            f"{told[1]} mrad from the URDF and {told[2]} mrad from zero.",
        )


@cache
def identified_from(name: str, share: float) -> Mechanism:
    """Mechanism identified from the first share of a log; cached."""
    from adaptctl.identification.columns import JointLog, joint_log
    from adaptctl.identification.drives_file import read_drives
    from adaptctl.identification.examples import example
    from adaptctl.identification.identify import identified
    from adaptctl.identification.log_files import read_log

    with example(name) as files:
        mechanism = load(files.robot)
        drives = read_drives(files.drives).ordered_like(mechanism)
        log = joint_log(read_log(files.log), drives)
    part = slice(0, round(share * len(log)))
    kept = JointLog(log.source, log.time[part], log.position[part], log.torque[part])
    return identified(mechanism, drives, [kept], [kept]).mechanism


def robot_file(name: str) -> Mechanism:
    """Mechanism of an example arm's file. Raises `InputError` for an unknown name."""
    from adaptctl.identification.examples import example

    with example(name) as files:
        return load(files.robot)


def _parameters(mechanism: Mechanism, other: Mechanism) -> Array:
    """Parameters of another mechanism, zero where it has none."""
    values: dict[str, Any] = dict(zip(other.parameter_names, other.inertial_parameters.tolist(), strict=True))
    return np.array([values.get(name, 0.0) for name in mechanism.parameter_names])
