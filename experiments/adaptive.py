"""Adaptive tracking with any arm: a built-in robot, or a file of yours."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import AdaptationLaw, Gains, SlotineLi
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.experiments.contest import Contender, Outcome
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.learning import ADAPTIVE, MAPPED, Learning, numbers, one_controller
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import Finding, Setting
from adaptctl.simulation.mujoco_contacts import clear_of_contacts
from adaptctl.simulation.mujoco_plant import MuJoCoPlant, as_mujoco
from adaptctl.tuning import Tuning, tune
from adaptctl.tuning.carried_gains import LARGEST_ERROR
from adaptctl.tuning.motion_range import motion_ranges

if TYPE_CHECKING:
    import gymnasium


PLANTS = ("adaptctl", "mujoco")


@dataclass(frozen=True)
class AdaptiveTracking(Learning):
    """Experiment of learning to track on any arm from zero initial estimates of its inertial parameters: reference,
    gains and integration steps are those that `adaptctl.tuning.tune` chooses for it, and the plant is adaptctl's own or
    MuJoCo.

    In the settings' formulas T_c is the control period, M the mass matrix, B the viscous friction, K the damping, Y the
    regressor, Γ the adaptation gain and λ_max the largest eigenvalue. Raises `InputError` at construction for another
    `plant`, for a floating base in MuJoCo, and for a setting of the wrong type or out of its bounds, `NonFiniteError`
    for NaN or infinity.
    """

    name: ClassVar[str] = "adaptive"
    title: ClassVar[str] = "{robot}: learning to track from knowing nothing"

    robot: str = setting("puma560_measured", "a built-in robot or a file (.urdf, .xml, .toml)")
    floating_base: bool = setting(False, "a URDF file's root link floats instead of being fixed")
    bandwidth: float = setting(
        4.0, "how fast errors decay, where the torques can follow, 1/s", symbol="Λ", low=0.1, high=100.0
    )
    hold: float = setting(
        0.5,
        "K is as large as this T_c λ_max((M + T_c B)⁻¹K) allows along the path",
        symbol="K",
        low=0.01,
        high=1.0,
    )
    rate: float = setting(
        0.5, "Γ is as large as this T_c λ_max(K⁻¹ Y Γ Y') allows along the path", symbol="Γ", low=1e-4, high=1.0
    )
    initial_error: float = setting(
        LARGEST_ERROR,
        "initial error of every joint, rad or m, at most a tenth of its range; 0.1: no more than torques bring back",
        low=-1.0,
        high=1.0,
    )
    plant: str = setting("adaptctl", "what moves the arm: adaptctl, or mujoco with all of the scene")
    root: str = setting("", "body of a scene that the arm begins with, where more than one moves")
    servos_off: bool = setting(False, "switch off actuators of a scene's arm that are no torques")
    snap: bool = setting(False, "make angles between joint axes within 1e-3 rad of right ones exact")
    search: int = setting(0, "settings that are tried in closed loop besides those by rule", low=0, high=48)

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: whether an adaptive controller learns
        to track on an arm from zero initial estimates of its inertial parameters."""
        return (
            f"An arm follows sinusoids drawn by seed {self.seed} within its limits of positions, speeds and torques, "
            "and nobody tells the controller its inertial parameters. First those that its motion depends on are "
            "found, from energies alone. Then Slotine and Li's adaptive controller starts with estimates of zero and "
            "adapts only those."
        )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.plant not in PLANTS:
            raise InputError(f"plant: expected {' or '.join(PLANTS)}, got {self.plant!r}")
        if self.plant == "mujoco" and self.floating_base:
            raise InputError("plant: floating bases are moved by adaptctl only, whose joints they have")

    def mechanism(self) -> Mechanism:
        """The `Mechanism` that the experiment drives, loaded from `robot`, with a fixed or a floating base; a scene
        (.xml, .mjcf) that MuJoCo moves is loaded as MuJoCo reads it. Raises `NotFoundError` for an unknown name or root
        body, `FileError` for a file that cannot be used, `InputError` for settings that do not suit it, such as a
        floating base without a URDF file."""
        root = self.root or None
        if self.plant == "mujoco" and Path(self.robot).suffix.lower() in (".xml", ".mjcf"):
            return load(as_mujoco(self.robot), snap=self.snap, root=root)
        return load(self.robot, floating_base=self.floating_base, snap=self.snap, root=root)

    def tuning(self, mechanism: Mechanism) -> Tuning:
        """Tuning of a `mechanism`, a `Tuning`: the reference, gains, torque limits and integration steps that
        `adaptctl.tuning.tune` chooses for this experiment's settings; the last four tunings are cached. With MuJoCo,
        the reference is kept clear of contacts. Raises `InputError` where no gains stabilise a joint under a held
        torque."""
        return _tuned(self, mechanism)

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Gymnasium tracking environment of a `mechanism` on its tuned reference, with the tuned torque limits, N m (N
        if prismatic), and initial position error, rad (m), moved by adaptctl's plant or by MuJoCo. Raises `InputError`
        where no gains stabilise a joint under a held torque, `FileError` for a MuJoCo scene that cannot be used."""
        import gymnasium

        tuning = self.tuning(mechanism)
        own: dict[str, Any]
        name, own = "Tracking", {"robot": mechanism, "substeps": tuning.substeps, "integrator": tuning.integrator}
        if self.plant == "mujoco":
            name, own = "MuJoCoTracking", {"robot": self.scene(mechanism), **self.scene_settings}
        return gymnasium.make(
            f"adaptctl.envs:adaptctl/{name}-v0",
            **own,
            reference=tuning.reference,
            duration=self.duration,
            control_period=self.control_period,
            torque_limits=tuning.torque_limits,
            initial_error=tuning.initial_error,
        )

    def scene(self, mechanism: Mechanism) -> Any:
        """Model that MuJoCo is to simulate: the path, a text, of the robot's file where it is one of MuJoCo's (.xml,
        .mjcf), else the `mechanism` itself, from whose links a MuJoCo model is made. Nothing is raised."""
        return self.robot if Path(self.robot).suffix.lower() in (".xml", ".mjcf") else mechanism

    @property
    def scene_settings(self) -> dict[str, Any]:
        """Keyword arguments of MuJoCo's tracking environment, by name: `body`, the name of the arm's root body, None
        for the only one that moves; and `servos_off`, True to switch off actuators that are no torques."""
        return {"body": self.root or None, "servos_off": self.servos_off}

    def gains(self, mechanism: Mechanism) -> Gains:
        """Tuned gains, a `Gains`, of Slotine and Li's law for the r primary (independently moving) joints of a
        `mechanism`: the bandwidth Lambda (r,), 1/s, and the damping K (r,), N m s/rad (N s/m if prismatic). Raises
        `InputError` where no gains stabilise a joint under a held torque."""
        return self.tuning(mechanism).gains

    def adaptation(self, model: ReducedModel) -> Array:
        """Tuned adaptation gain Gamma for the parameters of a reduced `model`, in their SI units squared per J: the
        diagonal (P,) for a model of all P parameters or, mapped from these, the matrix (k, k) for one of k fundamental
        (base) parameters. Raises `InputError` where no gains stabilise a joint of the model's mechanism under a held
        torque."""
        tuning = self.tuning(model.mechanism)
        everything = len(model.columns) == len(model.mechanism.parameter_names)
        return tuning.adaptation if everything else tuning.gain_on(model)

    def slotine_li(
        self, model: ReducedModel, adaptation: AdaptationLaw[Any] | Array | None = None, first: Array | None = None
    ) -> SlotineLi:
        """Slotine and Li's control law, a `SlotineLi`, on a reduced `model` of k parameters, with the tuned gains.
        `adaptation` is an adaptation law, or the gain Gamma, its diagonal (k,) or the matrix (k, k), in the parameters'
        SI units squared per J, or None to switch adaptation off; `first` (k,) is the initial estimate in SI units,
        zeros where None. Raises `GainError` for gains too large for the control period along the tuned reference,
        `InputError` for arrays of other shapes and where no gains stabilise a joint under a held torque."""
        tuning = self.tuning(model.mechanism)
        gains, given = tuning.gains, (first, self.control_period, tuning.workspace, tuning.torque_limits)
        return SlotineLi(model, gains.bandwidth, gains.damping, adaptation, *given)

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """List of the controllers to compare, a `Contender` (name, label and controller) each, in the order in which
        they run: Slotine and Li's law on the k fundamental (base) parameters in `basis`, the experiment's subject; the
        same with adaptation off; computed torque with true parameters, with wrong ones (every link's off by the
        fraction `parameter_error`) and with zeros; and Slotine and Li's law on all parameters. Each controller is made
        when first asked for, which raises `GainError` for gains too large for the control period. Raises `InputError`
        for a basis of another geometry than the mechanism's."""
        return [contender for contender in super().contenders(mechanism, basis) if contender.name != MAPPED]

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over one `Finding` (named number with unit): the largest difference between the commanded torques, N
        m (N if prismatic), of adapting the fundamental (base) parameters and of adapting all, which are one controller
        if it is round-off; none where either was not run. `outcome`, an `Outcome`, has the runs; `basis` is not
        used. Nothing is checked."""
        return one_controller(outcome, ADAPTIVE)

    def adaptation_setting(self, mechanism: Mechanism) -> str:
        """Text for the report on how the adaptation gain Gamma of a `mechanism` is chosen: its rule, and the tuned
        value of the largest eigenvalue of T_c K^-1 Y Gamma Y' along the reference (no unit; T_c the control period, K
        the damping, Y the regressor, Y' its transpose). Raises `InputError` where no gains stabilise a joint under a
        held torque."""
        number = self.tuning(mechanism).adaptation_number
        return f"as the prior ranges of typical inertias and reach, up to an adaptation number of {number:.3g}, mapped"

    def reference_settings(self, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Iterator over settings for the report, a `Setting` (name, value and meaning) each: centre and amplitude (rad,
        m if prismatic) and frequency (Hz) of the drawn reference, one a joint; what limits each joint's gains; and
        notes on the tuning. `env`, the tracking environment, is reset with the experiment's seed. Nothing is checked.
        """
        env.reset(seed=self.seed)
        drawn = env.unwrapped.reference  # type: ignore[attr-defined]
        for name, unit in (("center", "rad"), ("amplitude", "rad"), ("frequency", "Hz")):
            yield Setting(f"reference {name}", numbers(getattr(drawn, name).ravel()), f"a joint each, {unit} (m)")
        tuning = self.tuning(env.unwrapped.mechanism)  # type: ignore[attr-defined]
        for joint, limit in zip(tuning.mechanism.primary_joints, tuning.limited_by, strict=True):
            yield Setting(f"gains of {joint.name}", limit, "what limits them")
        for k, note in enumerate(tuning.notes, 1):
            yield Setting(f"note {k}", note, "on the tuning")


@lru_cache(maxsize=4)
def _tuned(experiment: AdaptiveTracking, mechanism: Mechanism) -> Tuning:
    asked, (lower, upper) = experiment.initial_error, motion_ranges(mechanism)
    error = np.sign(asked) * np.minimum(abs(asked), 0.1 * (upper - lower))
    chosen: dict[str, Any] = {
        "period": experiment.control_period,
        "initial_error": None if asked == LARGEST_ERROR else error,
        "bandwidth": experiment.bandwidth,
        "hold": experiment.hold,
        "adaptation": experiment.rate,
        "search": experiment.search,
        "seed": experiment.seed,
    }
    tuning = tune(mechanism, **chosen)
    if experiment.plant != "mujoco" or not isinstance(drawn := tuning.reference, Sinusoids):
        return tuning
    plant = MuJoCoPlant.of(experiment.scene(mechanism), experiment.control_period, **experiment.scene_settings)
    clear = clear_of_contacts(plant, drawn)
    return tuning if clear is drawn else tune(mechanism, reference=clear, **chosen)
