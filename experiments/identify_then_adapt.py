"""Adaptation that starts from what was identified from a real arm's log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import SlotineLi
from adaptctl.dynamics import Mechanism, load
from adaptctl.experiments.contest import Contender, Outcome
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.learning import ADAPTATION_OFF, ADAPTIVE, Found
from adaptctl.experiments.on_real_plant import OnRealPlant
from adaptctl.experiments.rough_model import deviations
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import Finding, wording

if TYPE_CHECKING:
    from adaptctl.simulation.effects import Effect

FROM_ZERO, FROM_FILE = "from-zero", "from-urdf"
BEGINNING = 2.0
"""s over which the first errors are taken"""


@dataclass(frozen=True)
class IdentifyThenAdapt(OnRealPlant):
    """Experiment on initial estimates identified from a real arm's log: Slotine and Li's law adapts on a simulated arm
    from zero, from the links' parameters in the arm's URDF file, and from what is identified from the first part of the
    log, the fraction `known` of it.

    The simulated arm has the parameters that are identified from the whole log. Raises `InputError` at construction for
    a `center`, `amplitude` or `frequency` of the reference that has not six entries, one a joint, and for settings of
    the wrong type or out of their bounds, `NonFiniteError` for NaN or infinity.
    """

    name: ClassVar[str] = "identify-then-adapt"
    title: ClassVar[str] = "{robot}: adaptation from an identified estimate"
    first_estimate: ClassVar[str] = "identified from the first part of the log"

    robot: str = setting("tx40", "an example that comes with a real log")
    known: float = setting(0.6, "share of the log that the first estimate is identified from", low=0.3, high=1.0)
    rate: float = setting(
        50.0,
        "adaptation rate: the gain is it times the square of each parameter's deviation",
        symbol="Γ",
        low=1e-6,
        high=1e6,
    )
    parameter_error: float = setting(
        0.9, "what the gain takes each link and drive to be off by, as a share of its size", low=0.01, high=0.9
    )
    duration: float = setting(10.0, "length of every run, s", low=2.5, high=300.0)
    center: tuple[float, ...] = setting(
        (0.0, 0.3, 1.0, 0.0, 0.6, 0.0), "centre of the reference, rad", low=-10.0, high=10.0
    )
    amplitude: tuple[float, ...] = setting(
        (0.6, 0.5, 0.5, 0.6, 0.5, 0.8), "amplitude of the reference, rad", low=0.0, high=3.2
    )
    frequency: tuple[float, ...] = setting(
        (0.4, 0.45, 0.5, 0.55, 0.6, 0.7), "frequency of the reference, Hz", low=0.0, high=5.0
    )

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: how much an adaptive controller's
        first tracking errors are reduced by an initial estimate of an arm's parameters that is identified from a log,
        against initial estimates of zero and from a URDF file."""
        return (
            "A log of a real arm, motor positions and torques, is worth a first estimate. The simulated arm has the "
            "parameters that the whole log shows, rotors, friction and the wrist's coupling included. Slotine and Li's "
            "controller adapts on it with one gain, from three first estimates: zero, the links of the arm's URDF, and "
            f"what the first {self.known:.0%} of the log shows, made physically consistent."
        )

    def mechanism(self) -> Mechanism:
        """The `Mechanism` that the experiment drives: the arm as identified from the whole log of the example that
        `robot` names. Raises `NotFoundError` for a name of no example with a log."""
        return identified_from(self.robot, 1.0)

    def effects(self, mechanism: Mechanism) -> Sequence[Effect]:
        """Effects of the plant besides rigid links: an empty sequence, since the `mechanism` itself has the identified
        rotors and friction. Nothing is checked."""
        return ()

    def adaptation(self, model: ReducedModel) -> Array:
        """Diagonal (k,) of the adaptation gain Gamma for a model's k parameters, in their SI units squared per J:
        `rate` (1/J) times the square of each one's standard deviation where the true parameters of links and drives are
        off by the fraction `parameter_error` of their size; the size of a link's first moments and inertias is the most
        that its mass and second moments allow, of other parameters their magnitude."""
        true = model.mechanism.inertial_parameters
        return np.asarray(self.rate * deviations(model, true, self.parameter_error) ** 2)

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """List of the controllers to compare, a `Contender` (name, label and controller) each, in the order in which
        they run: Slotine and Li's law from the identified initial estimate, the experiment's subject; the same with
        adaptation off; from the URDF file's parameters; and from zero. `basis`, a `FundamentalBasis`, has the
        mechanism's k fundamental (base) parameters. Raises `GainError` for gains too large for the control period,
        `InputError` for a basis of another geometry than the mechanism's and a first part of the log that is too
        short."""
        model = ReducedModel(mechanism, basis)
        part = _parameters(mechanism, identified_from(self.robot, self.known))
        file = _parameters(mechanism, robot_file(self.robot))
        share = f"{self.known:.0%} of the log"
        return [
            Contender.of(ADAPTIVE, "Identified, adapting", share, self._from(model, part)),
            Contender.of(ADAPTATION_OFF, "Identified, adaptation off", share, self._from(model, part, adapting=False)),
            Contender.of(FROM_FILE, "From the URDF, adapting", "the URDF's links", self._from(model, file)),
            Contender.of(FROM_ZERO, "From zero, adapting", "nothing", self._from(model, 0.0 * part)),
        ]

    def _from(self, model: ReducedModel, parameters: Array, *, adapting: bool = True) -> SlotineLi:
        return self.slotine_li(model, self.adaptation(model) if adapting else None, model.regrouping @ parameters)

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Sentence for the report with the RMS tracking errors of all joints in the first two seconds, mrad, from each
        initial estimate; None where one of the adapting runs in `outcome` is missing. `found`, the findings by name, is
        not used. Nothing is checked."""
        first = {name: wording.number(1e3 * error, 2) for name, error in _first_errors(outcome).items()}
        if not {ADAPTIVE, FROM_ZERO, FROM_FILE} <= set(first):
            return None
        return (
            f"In the first {BEGINNING:g} s the arm is off by {first[ADAPTIVE]} mrad from the identified estimate, "
            f"by {first[FROM_FILE]} from the URDF and by {first[FROM_ZERO]} from zero."
        )

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over the findings, a `Finding` (named number with unit) each: the RMS tracking error of all joints
        in each run's first two seconds, rad, and the ratio of two of these (no unit), that of the run from zero divided
        by that of the run from the identified estimate, none where that is 0. `outcome`, an `Outcome`, has the runs;
        `basis` is not used. Nothing is checked."""
        first = _first_errors(outcome)
        for name, value in first.items():
            yield Finding(f"first_error.{name}", value, "rad", f"RMS error of the first {BEGINNING:g} s, {name}")
        if FROM_ZERO in first and first.get(ADAPTIVE):
            meaning = f"RMS error of the first {BEGINNING:g} s, from zero over from the identified estimate"
            yield Finding("zero_over_identified", first[FROM_ZERO] / first[ADAPTIVE], "1", meaning)


def _first_errors(outcome: Outcome) -> dict[str, float]:
    """RMS errors (rad) of the runs' beginnings by name, of those that have one."""
    found = ((run.name, run.rms_error(stop=BEGINNING)) for run in outcome.runs)
    return {name: error for name, error in found if error is not None}


@cache
def identified_from(name: str, share: float) -> Mechanism:
    """Mechanism whose parameters, those of drives (rotor inertias, friction) included, are identified from the first
    part of a log, the fraction `share` (0 to 1) of it; the log is that of the example called `name`. Results are
    cached. Raises `NotFoundError` for a name of no example, `InputError` for a part that is too short to identify
    from."""
    from adaptctl.identification.columns import JointLog, joint_log
    from adaptctl.identification.drives_file import read_drives
    from adaptctl.identification.examples import example
    from adaptctl.identification.identify import identified
    from adaptctl.identification.log_files import read_log

    with example(name) as files:
        mechanism = load(files.robot, snap=True)
        drives = read_drives(files.drives).of(mechanism)
        log = joint_log(read_log(files.log), drives)
    part = slice(0, round(share * len(log)))
    kept = JointLog(log.source, log.time[part], log.position[part], log.torque[part])
    return identified(mechanism, drives, [kept], [kept]).mechanism


def robot_file(name: str) -> Mechanism:
    """Mechanism of the robot of the example called `name` as its URDF file describes it, before any identification;
    angles between joint axes within 1e-3 rad of right ones are made exact. Raises `NotFoundError` for a name of no
    example."""
    from adaptctl.identification.examples import example

    with example(name) as files:
        return load(files.robot, snap=True)


def _parameters(mechanism: Mechanism, other: Mechanism) -> Array:
    """Parameters (P,) of another mechanism by the names of this one's, zero where it has none."""
    values: dict[str, Any] = dict(zip(other.parameter_names, other.inertial_parameters.tolist(), strict=True))
    return np.array([values.get(name, 0.0) for name in mechanism.parameter_names])
