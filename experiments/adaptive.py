"""Adaptive tracking for any robot file."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Gains, SlotineLi
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.joint_units import error_unit, position_unit
from adaptctl.errors import InputError
from adaptctl.experiments.contest import (
    ADAPTATION_OFF,
    ADAPTIVE,
    Contender,
    FromFile,
    Outcome,
    Told,
    chosen_gains,
    listed,
)
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.puma560_adaptive import FROM_NOTHING, from_nothing, one_controller
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import Comparison, ControllerRun, Finding, Progress, Setting
from adaptctl.simulation.mujoco_plant import MuJoCoPlant, as_mujoco, clear_of_contacts
from adaptctl.simulation.repeated_runs import kept_runs
from adaptctl.tuning import Tuning, learning_law, tune
from adaptctl.tuning.feasible_gains import MAX_INITIAL_ERROR
from adaptctl.tuning.feasible_reference import motion_ranges
from adaptctl.tuning.learning_rule import slotine_li

if TYPE_CHECKING:
    import gymnasium

PLANTS = ("adaptctl", "mujoco", "both")
FINE, OURS = "mujoco-fine", "adaptctl"
SHORTER = 4
"""Factor by which MuJoCo's steps are shorter in the run that estimates the integrator's error."""
MUJOCO_S = "the difference is caused by MuJoCo's integrator."
FIRST_ORDER = 0.5 * SHORTER
"""Least factor by which an integrator's error shrinks at these steps."""


@dataclass(frozen=True)
class AdaptiveTracking(FromFile):
    """Experiment of learning to track on any arm."""

    name: ClassVar[str] = "adaptive"
    title: ClassVar[str] = "{robot}: adaptive tracking from zero estimates"

    robot: str = setting("puma560_measured", "a built-in robot or a file (.urdf, .xml, .toml)")
    bandwidth: float = setting(4.0, "largest bandwidth, the decay rate of errors, 1/s", symbol="Λ", low=0.1, high=100.0)
    sampling_ratio: float = setting(
        0.5,
        "normalised damping, the largest T_c λ_max((M + T_c B)⁻¹K) along the reference; stable below 2",
        symbol="K",
        low=0.01,
        high=1.0,
    )
    adaptation_ratio: float = setting(
        0.5,
        "normalised adaptation gain, T_c λ_max(K⁻¹ Y Γ Yᵀ) along the reference; stable below 2",
        symbol="Γ",
        low=1e-4,
        high=1.0,
    )
    initial_error: float = setting(
        MAX_INITIAL_ERROR,
        "initial joint error, rad or m; 0.1 is reduced to what the torque limits can correct",
        low=-1.0,
        high=1.0,
    )
    parameter_error: float = setting(0.3, "relative error of the links' inertias in the wrong model", low=0.0, high=1.0)
    plant: str = setting("adaptctl", "plant: adaptctl, mujoco (with the whole scene), or both for a comparison")
    servos_off: bool = setting(False, "switch off actuators of the arm other than torque motors")
    search: int = setting(
        0, "number of settings to try in closed loop, in addition to the tuning rules", low=0, high=48
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.plant not in PLANTS:
            raise InputError(f"plant: expected {', '.join(PLANTS[:-1])} or {PLANTS[-1]}, got {self.plant!r}")
        if self.plant != OURS and (self.floating_base or self.gravity or self.lock):
            raise InputError("plant: floating bases, locked joints and another gravity need the plant adaptctl")

    @property
    def purpose(self) -> str:
        """Question of the experiment."""
        if self.plant == "both":
            return (
                "One adaptive controller, from zero estimates and on one reference, runs on MuJoCo and on the built-in "
                "plant. If they differ only in integration, the difference vanishes with shorter steps."
            )
        return f"The arm follows random sinusoids (seed {self.seed}) within its limits. {FROM_NOTHING}"

    @property
    def in_mujoco(self) -> bool:
        """True where MuJoCo moves the arm."""
        return self.plant != OURS

    @property
    def is_scene(self) -> bool:
        """True for an MJCF file."""
        return Path(self.robot).suffix.lower() in (".xml", ".mjcf")

    def compare(self, progress: Progress) -> Comparison:
        """Comparison of all controllers, as data; the runs that judged the gains are not computed twice."""
        with kept_runs():
            return super().compare(progress)

    def mechanism(self) -> Mechanism:
        """Arm from `robot`, in MuJoCo's plant as MuJoCo reads it."""
        if self.in_mujoco and self.is_scene:
            return load(as_mujoco(self.robot), **self.reading)
        return super().mechanism()

    def tuning(self, mechanism: Mechanism) -> Tuning:
        """Reference and gains found by `tune`."""
        return _tuned(self, mechanism)

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Tracking environment on the tuned reference."""
        return self._environment(mechanism, self.in_mujoco, self.scene(mechanism))

    def _environment(self, mechanism: Mechanism, in_mujoco: bool, scene: Any) -> gymnasium.Env[Any, Any]:
        tuning = self.tuning(mechanism)
        ours = {"substeps": tuning.substeps, "integrator": tuning.integrator}
        return self.tracking(
            scene if in_mujoco else mechanism,
            tuning.reference,
            "MuJoCoTracking" if in_mujoco else "Tracking",
            torque_limits=tuning.torque_limits,
            initial_error=tuning.initial_error,
            **(self.scene_settings if in_mujoco else ours),
        )

    def scene(self, mechanism: Mechanism) -> Any:
        """File of the scene, else the `mechanism`."""
        return self.robot if self.is_scene else mechanism

    @property
    def scene_settings(self) -> dict[str, Any]:
        """Arguments of MuJoCo's plant."""
        return {"body": self.root or None, "servos_off": self.servos_off}

    def _finer(self, mechanism: Mechanism) -> Any:
        model = copy.copy(as_mujoco(self.scene(mechanism)))
        model.opt.timestep = min(model.opt.timestep, self.control_period) / SHORTER
        return model

    def slotine_li(self, model: ReducedModel, adaptation: Any = None) -> SlotineLi:
        """Slotine and Li's law from zero estimates."""
        tuning = self.tuning(model.mechanism)
        given = None, self.control_period, tuning.workspace, tuning.torque_limits
        return slotine_li(model, tuning.gains.bandwidth, tuning.gains.damping, adaptation, *given)

    def adaptation(self, model: ReducedModel) -> Array:
        """Tuned adaptation gain."""
        tuning = self.tuning(model.mechanism)
        everything = len(model.columns) == len(model.mechanism.parameter_names)
        return tuning.adaptation if everything else tuning.adaptation_gain_for(model)

    def gains(self, mechanism: Mechanism) -> Gains:
        """Bandwidth (r,), 1/s, and damping (r,), N m s/rad."""
        return self.tuning(mechanism).gains

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Controllers to compare, the subject first."""
        learning = partial(learning_law, tuning=self.tuning(mechanism))
        given = (self.slotine_li, self.adaptation, learning, self.gains(mechanism), self.parameter_error, self.seed)
        found = from_nothing(mechanism, basis, *given)
        if self.plant != "both":
            return found
        on = partial(self._environment, mechanism)
        kind, shorter = found[0].label.split(",")[0], f"steps {SHORTER} times shorter"
        subject = replace(found[0], label=f"{kind} on MuJoCo")
        off = next(one for one in found if one.name == ADAPTATION_OFF)
        fine, ours = (lambda: on(True, self._finer(mechanism))), partial(on, False, None)
        return [
            subject,
            replace(off, label="the same, adaptation off"),
            replace(subject, name=FINE, label=f"{kind} on MuJoCo, {shorter}", env=fine),
            replace(subject, name=OURS, label=f"{kind} on the built-in plant", env=ours),
        ]

    def chosen(self, mechanism: Mechanism, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Chosen settings: gains, limits, reference, notes."""
        tuning = self.tuning(mechanism)
        rule = "from prior ranges by typical inertias and reach, scaled to a normalised adaptation gain of"
        gain = f"{rule} {self.adaptation_ratio:.3g}, mapped"
        yield from chosen_gains(tuning.gains, gain, "adaptation gain: rate × (prior range)²")
        length = position_unit(mechanism)
        for name, unit in (("center", length), ("amplitude", length), ("frequency", "Hz")):
            values = getattr(tuning.reference, name)
            yield Setting(f"reference {name}", listed(values.ravel()), f"per joint, {unit}")
        for joint, limit in zip(mechanism.primary_joints, tuning.limited_by, strict=True):
            yield Setting(f"gains of {joint.name}", limit, "what limits them")
        for k, note in enumerate(tuning.notes, 1):
            yield Setting(f"note {k}", note, "on the tuning")

    def told(self, outcome: Outcome, basis: FundamentalBasis) -> Told:
        """Differences between controllers or plants."""
        if self.plant != "both":
            return Told(one_controller(outcome, ADAPTIVE))
        if OURS not in outcome.run:
            return Told()
        findings, unit = list[Finding](), position_unit(outcome.mechanism)
        meaning = "largest difference of a joint's position between MuJoCo and the built-in plant, at"
        for name, run, at in (
            ("", outcome.runs[0].name, "the step size of the MuJoCo model"),
            ("_fine", FINE, f"steps {SHORTER} times shorter"),
        ):
            value = _apart(outcome.run[run], outcome.run[OURS])
            findings.append(Finding(f"plants_apart{name}", value, unit, f"{meaning} {at}"))
        coarse, fine = (one.value for one in findings)
        reason = (
            "integration does not explain the difference; contacts, joint stops, springs or dry friction, which MuJoCo "
            "models differently, may."
        )
        return Told(
            findings,
            f"MuJoCo and the built-in plant differ by at most {1e3 * coarse:.2g} {error_unit(outcome.mechanism)}, and "
            f"by {1e3 * fine:.2g} with steps {SHORTER} times shorter: "
            f"{reason if coarse < FIRST_ORDER * fine else MUJOCO_S}",
        )


def _apart(one: ControllerRun, other: ControllerRun) -> float:
    common = min(len(one.rollout.time), len(other.rollout.time))
    return float(np.abs(one.rollout.p[:common] - other.rollout.p[:common]).max())


@lru_cache(maxsize=4)
def _tuned(experiment: AdaptiveTracking, mechanism: Mechanism) -> Tuning:
    asked, (lower, upper) = experiment.initial_error, motion_ranges(mechanism)
    error = np.sign(asked) * np.minimum(abs(asked), 0.1 * (upper - lower))
    chosen: dict[str, Any] = {
        "control_period": experiment.control_period,
        "initial_error": None if asked == MAX_INITIAL_ERROR else error,
        "bandwidth": experiment.bandwidth,
        "sampling_ratio": experiment.sampling_ratio,
        "adaptation_ratio": experiment.adaptation_ratio,
        "search": experiment.search,
        "seed": experiment.seed,
        "nominal_only": True,
    }
    tuning = tune(mechanism, **chosen)
    if not experiment.in_mujoco or not isinstance(drawn := tuning.reference, Sinusoids):
        return tuning
    plant = MuJoCoPlant.of(experiment.scene(mechanism), experiment.control_period, **experiment.scene_settings)
    clear = clear_of_contacts(plant, drawn)
    return tuning if clear is drawn else tune(mechanism, reference=clear, **chosen)
