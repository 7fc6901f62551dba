"""An arm that presses on a table with an unknown load in its hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.control import AdaptationLaw, TaskImpedance
from adaptctl.control.gains.workspace import Workspace
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs.contact import LINK, TOOL, ContactEnv, joint_path, of_three_joints
from adaptctl.experiments.contest import ADAPTATION_OFF, Contender, Learning, Outcome, Told
from adaptctl.experiments.experiment import setting
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import Failure, Finding, TaskError
from adaptctl.recording.contact_force import contact_forces
from adaptctl.recording.wording import number
from adaptctl.simulation.effects import Payload
from adaptctl.tuning import tune

if TYPE_CHECKING:
    import gymnasium

JOINT_STIFFNESS, JOINT_DAMPING = np.full(3, 50.0), np.array([20.0, 20.0, 10.0])
"""N m/rad and N m s/rad, of motions that leave the tool where it is"""
TOOL_STIFFNESS, TOOL_DAMPING = np.repeat([1000.0, 0.0], 3), np.array([150.0, 150.0, 200.0, 0.0, 0.0, 0.0])
"""N/m and N s/m: the tool comes down at 5 cm/s where nothing is in its way and the force is 10 N"""
FREE = 1e3
"""N: largest force along the table"""
SETTLED = 15.0
"""s from which on the force is judged"""


@dataclass(frozen=True)
class Contact(Learning):
    """Experiment of pressing on a table with a load that is not known."""

    name: ClassVar[str] = "contact"
    title: ClassVar[str] = "PUMA 560: pressing on a table with an unknown load"

    robot: str = setting("puma560_geared", "a PUMA 560, whose wrist is held straight")
    payload: float = setting(2.0, "mass in the hand, which only the last controller knows, kg", low=0.0, high=5.0)
    force: float = setting(10.0, "force with which to press, N", low=1.0, high=50.0)
    surface: float = setting(1e4, "stiffness of the table, N/m", low=1e3, high=1e5)
    duration: float = setting(20.0, "duration of every run, s", low=SETTLED + 1.0, high=300.0)

    @property
    def purpose(self) -> str:
        """Question of the experiment."""
        return (
            f"An arm in MuJoCo holds {self.payload:g} kg that its file does not have. It moves in the air, then "
            f"presses on a table of {self.surface:g} N/m with {self.force:g} N and wipes it. No force is measured: "
            "what a controller does not know of the load goes into the table."
        )

    @cached_property
    def arm(self) -> Mechanism:
        """Arm of three joints as its file has it, with friction to learn."""
        return of_three_joints(load(self.robot))

    def mechanism(self) -> Mechanism:
        """Arm with the load, a point mass at the tool."""
        arm, held = self.arm, Payload(self.payload, np.array(TOOL))
        return arm.with_parameters(held.added_to(arm.inertial_parameters, len(arm.links) - 1))

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """MuJoCo's arm over the table."""
        return ContactEnv(mechanism, surface=self.surface, duration=self.duration, control_period=self.control_period)

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Impedances that learn, keep the file's model, and know the load; and a tracking law."""
        model = ReducedModel(mechanism, basis)
        tuning = tune(self.arm, control_period=self.control_period, seed=self.seed)
        path = joint_path(mechanism, self.duration)(np.linspace(0.0, self.duration, 200)).p
        soft = partial(self._impedance, model, Workspace.along(mechanism, path, margin=0.2))
        tracking = tuning.controller(model)
        file, true = model.regrouping @ self.arm.inertial_parameters, model.fundamental_parameters
        return [
            Contender("impedance", "Impedance, learning", "file", partial(soft, tracking.adaptation_law, file)),
            Contender(ADAPTATION_OFF, "Impedance, adaptation off", "file", partial(soft, None, file)),
            Contender("tracking", "Tracking law, learning", "gains only", lambda: tracking),
            Contender("impedance-true", "Impedance, true model", "exact", partial(soft, None, true)),
        ]

    def _impedance(
        self, model: ReducedModel, workspace: Workspace, law: AdaptationLaw[Any] | None, initial: Array
    ) -> TaskImpedance:
        return TaskImpedance(
            model,
            JOINT_STIFFNESS,
            JOINT_DAMPING,
            law,
            initial,
            self.control_period,
            workspace,
            tool_stiffness=TOOL_STIFFNESS,
            tool_damping=TOOL_DAMPING,
            link=LINK,
            tool=np.array(TOOL),
            most_force=[FREE, FREE, self.force],
        )

    @property
    def expected(self) -> Mapping[Failure, str]:
        """Joints of soft arms are kept off their path by the table alike."""
        return {Failure.NO_BETTER: "the table keeps both off their path; the force tells them apart"}

    def told(self, outcome: Outcome, basis: FundamentalBasis) -> Told:
        """Force on the table of each run, and how far it is from what was asked."""
        findings, means, errors = [], {}, {}
        for run in outcome.runs:
            time, pressed = run.rollout.time, contact_forces(run.rollout)[:, 2]
            wanted = np.where(time >= SETTLED, self.force, 0.0)
            errors[run.name] = 1e-3 * np.abs(pressed - wanted)  # in kN, as those of positions are in m and shown in mm
            means[run.name] = float(np.mean(pressed[time >= SETTLED])) if run.duration > SETTLED else float("nan")
            meaning = f"{run.label}: mean force on the table, after {SETTLED:g} s"
            findings.append(Finding(f"mean_force.{run.name}", means[run.name], "N", meaning))
        on, off, stiff = (number(means.get(name)) for name in ("impedance", ADAPTATION_OFF, "tracking"))
        answer = (
            f"Asked for {self.force:g} N, the impedance that learns the load presses with {on} N, that with the file's "
            f"model with {off} N, and the tracking law with {stiff} N."
        )
        return Told(findings, answer, (), TaskError("Error of the force on the table", "N", errors))
