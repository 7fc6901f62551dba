"""Friction in joints, adapted as parameters, against laws whose model has none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import ComputedTorque
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.errors import InputError
from adaptctl.experiments.contest import Contender, Outcome
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.friction_curves import Curve, friction_curves
from adaptctl.experiments.learning import ADAPTATION_OFF, ADAPTIVE, Found
from adaptctl.experiments.on_real_plant import OnRealPlant
from adaptctl.identifiability import FundamentalBasis, ReducedModel, essential_space, fundamental_basis
from adaptctl.recording import Finding, wording
from adaptctl.recording.wording import typeset

if TYPE_CHECKING:
    from adaptctl.recording.drawing import Drawing
    from adaptctl.simulation.effects import Effect

NO_COLUMNS = "no-friction-columns"
KINDS = ("viscous", "coulomb")


@dataclass(frozen=True)
class FrictionInJoints(OnRealPlant):
    """Experiment on joint friction: Slotine and Li's law with and without friction among its adapted parameters, and
    computed torque with and without it.

    Viscous and Coulomb friction of the drives are parameters like the others, with initial estimates of zero. The plant
    also has Stribeck's excess of static friction, which no parameter describes, so that an error remains even for a law
    that learns. `first_estimate` describes the initial estimate, for the report. Raises `InputError` at construction
    where a setting that it inherits, the reference's `center`, `amplitude` or `frequency`, has not six entries, one a
    joint, and for settings of the wrong type or out of their bounds, `NonFiniteError` for NaN or infinity.
    """

    name: ClassVar[str] = "friction"
    title: ClassVar[str] = "{robot}: friction learned, and friction ignored"
    first_estimate: ClassVar[str] = "a rough model: every link off by --parameter-error; of friction, zero"

    robot: str = setting("puma560_friction", "puma560_friction, or another arm of six joints with friction")
    stribeck: float = setting(0.2, "static friction exceeds Coulomb friction by this share of it", low=0.0, high=10.0)
    stribeck_speed: float = setting(0.1, "speed at which half of that excess is gone, rad/s", low=1e-3, high=10.0)
    friction_range: float = setting(
        0.1,
        "prior range of Coulomb friction over the torque limit; of viscous friction, at 1 rad/s",
        low=1e-4,
        high=1.0,
    )

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: whether friction should be among the
        adapted parameters."""
        return (
            "Gears rub. Viscous and Coulomb friction are two more columns of the regressor a joint: the controller "
            "that has them starts from zero friction and learns it with the rest. Another has the same gains and no "
            "such columns, so that its inertias and masses must make up for what they cannot. Static friction beyond "
            f"Coulomb's, {100 * self.stribeck:.0f} % of it, is in nobody's model."
        )

    def effects(self, mechanism: Mechanism) -> Sequence[Effect]:
        """Effects of the simulated plant that the controller's model lacks, a sequence of one `Friction`: in each joint
        Stribeck's excess of static over Coulomb friction, a torque against the motion of magnitude c F_c / (1 +
        (v/v_s)^2). c is the setting `stribeck`, a fraction of the Coulomb friction F_c (N m, N if prismatic) of the
        joint, v_s the setting `stribeck_speed`, rad/s, and v the joint's velocity, rad/s (m/s). Raises `InputError` for
        a `mechanism` with neither viscous nor Coulomb friction in its joints."""
        from adaptctl.simulation.effects import Friction

        coulomb = np.array([joint.drive.coulomb or 0.0 for joint in mechanism.primary_joints])
        if not coulomb.any() and not any(joint.drive.viscous for joint in mechanism.primary_joints):
            raise InputError(
                f"robot: {mechanism.name} has no friction in its joints: give them viscous or coulomb in its file, or "
                "use puma560_friction"
            )
        return (Friction(stribeck=self.stribeck * coulomb, speed=self.stribeck_speed),)

    def adaptation(self, model: ReducedModel) -> Array:
        """Diagonal (k,) of the adaptation gain Gamma for a model's k parameters, in their SI units squared per J:
        `rate` (1/J) times the square of a deviation. For parameters of links and rotors that is the standard deviation
        where they are off by the fraction `parameter_error` of their size. For Coulomb friction it is `friction_range`
        (a fraction) times the joint's torque limit, N m, and for viscous friction the same number in N m s/rad."""
        gain, ranges = super().adaptation(model), self.friction_range * self.torque_limits(model.mechanism)
        for k, joint in _friction_columns(model):
            gain[k] = self.rate * ranges[joint] ** 2
        return gain

    def first(self, model: ReducedModel) -> Array:
        """Initial estimate (k,) of a reduced model's k parameters in SI units: that of the rough model, with every
        link's parameters off by the fraction `parameter_error`, and zero for viscous and Coulomb friction. Nothing is
        checked."""
        estimate = super().first(model)
        estimate[[k for k, _ in _friction_columns(model)]] = 0.0
        return estimate

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """List of the controllers to compare, a `Contender` (name, label and controller) each, in the order in which
        they run: Slotine and Li's law with friction parameters, the experiment's subject; the same with adaptation off;
        the same law without friction parameters; and computed torque with true friction and with none. `basis`, a
        `FundamentalBasis`, has the mechanism's k fundamental (base) parameters. Raises `GainError` for gains too large
        for the control period, `InputError` for a basis of another geometry than the mechanism's, `RankError` where the
        number of base parameters cannot be certified."""
        model, smooth = ReducedModel(mechanism, basis), without_friction(mechanism)
        bare = ReducedModel(smooth, fundamental_basis(essential_space(smooth, seed=self.seed)))
        bandwidth, knows = self.gains(mechanism).bandwidth, f"links within {100 * self.parameter_error:.0f} %"
        return [
            Contender.of(ADAPTIVE, f"{len(model.columns)} parameters, with friction", knows, self.from_rough(model)),
            Contender.of(ADAPTATION_OFF, "Adaptation off", knows, self.from_rough(model, adapting=False)),
            Contender.of(NO_COLUMNS, f"{len(bare.columns)} parameters, no friction", knows, self.from_rough(bare)),
            Contender.of(
                "computed-torque",
                "Computed torque, true drives",
                "all but Stribeck",
                ComputedTorque(mechanism, bandwidth),
            ),
            Contender.of(
                "computed-torque-smooth", "Computed torque, no friction", "the links", ComputedTorque(smooth, bandwidth)
            ),
        ]

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Sentences for the report, never None here, with the RMS tracking errors of all joints in the last two
        seconds, mrad (mm), with friction among the parameters, without, and by computed torque, a dash for a run that
        is missing or shorter; `outcome` has the runs; `found`, the findings by name, is not used. Nothing is
        checked."""
        return (
            f"With friction among its parameters the arm ends at {_final(outcome, ADAPTIVE)} of tracking error, "
            f"without at {_final(outcome, NO_COLUMNS)}, though both adapt. Computed torque that knows all but "
            f"Stribeck's excess stays at {_final(outcome, 'computed-torque')}."
        )

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over the findings, a `Finding` (named number with unit) each: the RMS tracking error of all joints
        in the last two seconds with friction parameters, divided by that without (no unit; left out where either run is
        missing or shorter), and each friction parameter as learned at the end, in its SI unit, its meaning telling the
        true one. `outcome`, an `Outcome`, has the runs, `basis` the mechanism's fundamental (base) parameters. Raises
        `KeyError` where the run with friction parameters is missing."""
        from adaptctl.recording.wording import parameter_unit

        runs = {run.name: run for run in outcome.runs}
        if {ADAPTIVE, NO_COLUMNS} <= set(runs):
            with_columns, without = (runs[name].final_rms_error for name in (ADAPTIVE, NO_COLUMNS))
            meaning = "RMS error of the last two seconds, with the friction's columns over without"
            if with_columns and without:
                yield Finding("columns_over_none", with_columns / without, "1", meaning)
        model = ReducedModel(outcome.mechanism, basis)
        final, true = runs[ADAPTIVE].rollout.estimate[-1], model.fundamental_parameters
        for k, _ in _friction_columns(model):
            unit = parameter_unit(model.names[k], outcome.mechanism)
            meaning = f"{model.names[k]}, learned at the end; true {true[k]:.4g}"
            yield Finding(f"learned.{model.names[k]}", float(final[k]), unit, meaning)

    def drawings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Drawing]:
        """Iterator over one figure for the report, a `Drawing` (name, caption and function that draws it): true and
        learned friction of every joint, N m, over speed, rad/s. `outcome`, an `Outcome`, has the runs, `basis` the
        mechanism's fundamental (base) parameters. Nothing is checked."""
        from adaptctl.recording.drawing import Drawing

        yield Drawing(
            "friction",
            "Friction over speed: the true one, and what was learned of it, at the speeds at which the joint moved "
            "(shaded: how often). A line of two numbers is fitted where the arm is, and need not be right elsewhere.",
            partial(friction_curves, self._curves(outcome, ReducedModel(outcome.mechanism, basis))),
        )

    def _curves(self, outcome: Outcome, model: ReducedModel) -> list[Curve]:
        """Friction curve of every joint of the adapting run."""
        run = next(run for run in outcome.runs if run.name == ADAPTIVE).rollout
        learned = dict(zip(model.names, run.estimate[-1].tolist(), strict=True))
        curves = []
        for j, joint in enumerate(outcome.mechanism.primary_joints):
            true = (joint.drive.viscous or 0.0, joint.drive.coulomb or 0.0)
            found = (learned.get(f"{joint.name}.viscous", 0.0), learned.get(f"{joint.name}.coulomb", 0.0))
            excess = self.stribeck * true[1]
            units = typeset(joint.kind.effort_unit), f"{joint.kind.position_unit}/s"
            curves.append(Curve(joint.name, true, excess, self.stribeck_speed, found, run.v[:, j], units))
        return curves


def _final(outcome: Outcome, name: str) -> str:
    """Text of the RMS error of a run's last two seconds, a dash where there is none."""
    errors = {run.name: run.final_rms_error for run in outcome.runs}
    return wording.error(errors.get(name), error_unit(outcome.mechanism))


def without_friction(mechanism: Mechanism) -> Mechanism:
    """Mechanism equal to the given `mechanism` but without viscous and Coulomb friction in its joints; rotor inertias
    stay. Nothing is raised."""
    return mechanism.with_drives([Drive(link.joint.drive.rotor_inertia) for link in mechanism.links])


def _friction_columns(model: ReducedModel) -> Iterator[tuple[int, int]]:
    """Index of each friction parameter among the model's parameters, and of its joint."""
    joints = [joint.name for joint in model.mechanism.primary_joints]
    for k, name in enumerate(model.names):
        owner, _, kind = name.rpartition(".")
        if kind in KINDS:
            yield k, joints.index(owner)
