"""An arm that presses on a table or a wall, or is pushed, with an unknown load in its hand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.control import AdaptationLaw, SlotineLi, TaskImpedance, with_external_torque
from adaptctl.control.gains.workspace import Workspace
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs.contact import (
    INTO,
    LINK,
    LINKS,
    TOOL,
    ContactEnv,
    joint_path,
    of_three_joints,
    validate_scene,
    validate_within,
)
from adaptctl.errors import InputError, suggested_name
from adaptctl.experiments.contest import ADAPTATION_OFF, Contender, Learning, Outcome, Told
from adaptctl.experiments.experiment import Idle, setting, validate_count
from adaptctl.experiments.push_findings import answer_of_push, findings_of_push
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import Failure, Finding, TaskError
from adaptctl.recording.contact_force import contact_forces
from adaptctl.recording.wording import number
from adaptctl.simulation import HandPush
from adaptctl.simulation.effects import Payload
from adaptctl.tuning import Tuning, tune

if TYPE_CHECKING:
    import gymnasium

JOINT_STIFFNESS, JOINT_DAMPING = np.full(3, 50.0), np.array([20.0, 20.0, 10.0])
"""N m/rad and N m s/rad, of motions that leave the tool where it is"""
TOOL_STIFFNESS, ALONG, ACROSS = np.repeat([1000.0, 0.0], 3), 150.0, 200.0
"""N/m and N s/m: the tool moves at 5 cm/s where nothing is in its way and the force is 10 N"""
FREE = 1e3
"""N: largest force along the surface"""
SETTLED = 15.0
"""s from which on the force is judged"""
HAND = "tool"
"""name of the tool among pushed links"""
NO_PUSH = (0.0, 0.0, 0.0)
UNPUSHED = Idle("push", NO_PUSH, "without a push: add push, its force in N along x, y and z")
IN_AIR = Idle("scene", "air", "in air: add scene table or wall")


@dataclass(frozen=True)
class Contact(Learning):
    """Experiment of pressing on a table or a wall, or of being pushed, with a load that is not known."""

    name: ClassVar[str] = "contact"
    title: ClassVar[str] = "PUMA 560 in contact, with an unknown load"

    robot: str = setting("puma560_geared", "a PUMA 560, whose wrist is held straight")
    scene: str = setting("table", "what it presses on, table or wall; or air, where it only moves")
    payload: float = setting(2.0, "mass in the hand, which only the last controller knows, kg", low=0.0, high=5.0)
    force: float = setting(10.0, "force with which to press, N", low=1.0, high=50.0, idle=IN_AIR)
    surface: float = setting(1e4, "stiffness of the table or wall, N/m", low=1e3, high=1e5, idle=IN_AIR)
    push: tuple[float, ...] = setting(NO_PUSH, "force of a hand that pushes, x y z, N", low=-500.0, high=500.0)
    push_link: str = setting(
        HAND, "what the hand pushes: tool, or the center of mass of link1, link2 or link3", idle=UNPUSHED
    )
    push_start: float = setting(10.0, "time at which the hand begins to push, s", low=0.0, high=300.0, idle=UNPUSHED)
    push_duration: float = setting(5.0, "time for which it pushes, s", low=1e-3, high=300.0, idle=UNPUSHED)
    push_rise: float = setting(
        0.0, "time in which its force grows and, at the end, falls, s", low=0.0, high=150.0, idle=UNPUSHED
    )
    duration: float = setting(20.0, "duration of every run, s", low=SETTLED + 1.0, high=300.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_count(self, ("push",), 3, "a force in N along x, y and z")
        validate_scene(self.scene)
        validate_within(self.pushes, self.duration)
        if self.push_link not in (HAND, *LINKS):
            known = f"expected {', '.join((HAND, *LINKS))}, got {self.push_link!r}"
            raise InputError(f"push_link: {known}{suggested_name(self.push_link.lower(), (HAND, *LINKS))}")

    @property
    def purpose(self) -> str:
        """Question of the experiment."""
        held = f"An arm in MuJoCo holds {self.payload:g} kg that its file does not have. It moves in the air"
        if self.scene != "air":
            held += (
                f", then presses on a {self.scene} of {self.surface:g} N/m with {self.force:g} N and wipes it. No "
                "force is measured: what a controller does not know of the load goes into what it touches"
            )
        return f"{held}.{''.join(map(self._pushes_told, self.pushes))}"

    def _pushes_told(self, push: HandPush) -> str:
        how = f"within {push.rise:g} s" if push.rise else "suddenly"
        size = float(np.linalg.norm(push.force))
        return (
            f" A hand pushes the {self.push_link} with {size:.3g} N, from {push.start:g} to "
            f"{push.start + push.duration:g} s, {how}."
        )

    @cached_property
    def pushes(self) -> tuple[HandPush, ...]:
        """HandPush of the hand, if there is one."""
        body = None if self.push_link == HAND else self.push_link
        push = HandPush(np.array(self.push), self.push_start, self.push_duration, self.push_rise, body)
        return (push,) if any(self.push) else ()

    @cached_property
    def arm(self) -> Mechanism:
        """Arm of three joints as its file has it, with friction to learn."""
        return of_three_joints(load(self.robot))

    @cached_property
    def tuning(self) -> Tuning:
        """Gains for the arm as its file has it."""
        return tune(self.arm, control_period=self.control_period, seed=self.seed, nominal_only=True)

    def mechanism(self) -> Mechanism:
        """Arm with the load, a point mass at the tool."""
        arm, held = self.arm, Payload(self.payload, np.array(TOOL))
        return arm.with_parameters(held.added_to(arm.inertial_parameters, len(arm.links) - 1))

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """MuJoCo's arm beside what it touches."""
        given: Any = {"scene": self.scene, "surface": self.surface, "pushes": self.pushes}
        return ContactEnv(mechanism, duration=self.duration, control_period=self.control_period, **given)

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Impedances that learn, do not, or know the load, and a tracking law; in the air three tracking laws."""
        model = ReducedModel(mechanism, basis)
        path = joint_path(mechanism, self.duration, self.scene)(np.linspace(0.0, self.duration, 200)).p
        soft = partial(self._impedance, model, Workspace.along(mechanism, path, margin=0.2))
        file, true = model.regrouping @ self.arm.inertial_parameters, model.fundamental_parameters
        learning = with_external_torque(self.tuning.controller(model))
        if self.scene == "air":
            return self._tracking(model, file, learning)
        return [
            Contender("impedance", "Impedance, learning", "file", partial(soft, learning.adaptation_law, file)),
            Contender(ADAPTATION_OFF, "Impedance, adaptation off", "file", partial(soft, None, file)),
            Contender("tracking", "Tracking law, learning", "gains only", lambda: learning),
            Contender("impedance-true", "Impedance, true model", "exact", partial(soft, None, true)),
        ]

    def _tracking(self, model: ReducedModel, file: Array, learning: SlotineLi) -> list[Contender]:
        """Tracking laws that learn by the guarded law, by the gradient, and not."""
        gradient, off = (self.tuning.controller(model, law) for law in ("gradient", False))
        laws = {
            ("tracking", "Tracking law, learning"): learning,
            (ADAPTATION_OFF, "Tracking law, adaptation off"): off,
            ("gradient", "Tracking law, gradient"): gradient,
        }
        return [Contender.of(*named, "file", replace(law, initial=file)) for named, law in laws.items()]

    def _impedance(
        self, model: ReducedModel, workspace: Workspace, law: AdaptationLaw[Any] | None, initial: Array
    ) -> TaskImpedance:
        into = INTO[self.scene]
        return TaskImpedance(
            model,
            JOINT_STIFFNESS,
            JOINT_DAMPING,
            law,
            initial,
            self.control_period,
            workspace,
            tool_stiffness=TOOL_STIFFNESS,
            tool_damping=np.array([*np.where(into, ACROSS, ALONG), 0.0, 0.0, 0.0]),
            link=LINK,
            tool=np.array(TOOL),
            most_force=np.where(into, self.force, FREE),
        )

    @property
    def expected(self) -> Mapping[Failure, str]:
        """Joints of soft arms are kept off their path by a surface alike."""
        apart = f"the {self.scene} keeps both arms off the path; only the forces differ"
        return {} if self.scene == "air" else {Failure.NO_BETTER: apart}

    def told(self, outcome: Outcome, basis: FundamentalBasis) -> Told:
        """Forces on the surface, and what a push has left behind."""
        after = list(self._after_push(outcome, basis))
        if self.scene == "air":
            return Told(after, answer_of_push(after, outcome.runs))
        pressed = self._pressed(outcome)
        return pressed._replace(findings=[*pressed.findings, *after])

    def _pressed(self, outcome: Outcome) -> Told:
        """Force on the surface of each run, and how far it is from what was asked."""
        findings, means, errors = [], {}, {}
        for run in outcome.runs:
            time, pressed = run.rollout.time, -contact_forces(run.rollout) @ INTO[self.scene]
            wanted = np.where(time >= SETTLED, self.force, 0.0)
            errors[run.name] = 1e-3 * np.abs(pressed - wanted)  # in kN, as those of positions are in m and shown in mm
            means[run.name] = float(np.mean(pressed[time >= SETTLED])) if run.duration > SETTLED else float("nan")
            meaning = f"{run.label}: mean force on the {self.scene}, after {SETTLED:g} s"
            findings.append(Finding(f"mean_force.{run.name}", means[run.name], "N", meaning))
        on, off, stiff = (number(means.get(name)) for name in ("impedance", ADAPTATION_OFF, "tracking"))
        answer = (
            f"Asked for {self.force:g} N, the impedance that learns the load presses with {on} N, that with the file's "
            f"model with {off} N, and the tracking law with {stiff} N."
        )
        return Told(findings, answer, (), TaskError(f"Error of the force on the {self.scene}", "N", errors))

    def _after_push(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Findings of the push in each run."""
        model = ReducedModel(outcome.mechanism, basis)
        scale, true = np.sqrt(np.diag(self.tuning.adaptation_gain_for(model))), model.fundamental_parameters
        for push, run in product(self.pushes, outcome.runs):
            yield from findings_of_push(push, run, lambda estimate: float(np.linalg.norm((estimate - true) / scale)))
