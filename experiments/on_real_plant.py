"""Common part of experiments with real effects: a PUMA with rotors, a stated reference, a rough model."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Sinusoids, SlotineLi
from adaptctl.control.gains.torque_limits import finite_torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.experiments.experiment import FAR, require_count, setting
from adaptctl.experiments.learning import Learning
from adaptctl.experiments.rough_start import RoughStart
from adaptctl.identifiability import ReducedModel
from adaptctl.recording import Setting

if TYPE_CHECKING:
    import gymnasium

    from adaptctl.simulation.effects import Effect

JOINTS = 6


@dataclass(frozen=True)
class OnRealPlant(RoughStart, Learning):
    """Abstract base class of experiments in which laws learn on an arm of six joints whose plant has more effects than
    rigid links, such as friction or a payload, from a rough model with every link's parameters off by the fraction
    `parameter_error`. A subclass gives `name`, `title`, the property `purpose` and the method `effects`. In the setting
    `ratio` a joint's typical inertia is the median of its entry of the mass matrix's diagonal over 200 random
    configurations. `error_bound` (100 rad or m) is the joint error that ends a run. Raises `InputError` at construction
    for a `center`, `amplitude` or `frequency` that has not six entries, and for settings of the wrong type or out of
    their bounds, `NonFiniteError` for NaN or infinity."""

    error_bound: ClassVar[float] = FAR

    robot: str = setting("puma560_geared", "puma560_geared, puma560_friction, or another arm of six joints")
    rate: float = setting(
        5.0,
        "adaptation rate: the gain is it times the square of each parameter's deviation",
        symbol="Γ",
        low=1e-6,
        high=1e6,
    )
    initial_error: float = setting(0.0, "initial error of every joint, rad or m", low=-1.0, high=1.0)
    parameter_error: float = setting(
        0.3, "the rough model has each link's parameters off by this share, up or down by seed", low=0.01, high=0.9
    )
    ratio: float = setting(
        2.0, "damping over bandwidth times each joint's typical inertia", symbol="K", low=0.1, high=100.0
    )
    center: tuple[float, ...] = setting(
        (0.0, -0.6, 0.8, 0.0, 0.5, 0.0), "centre of the reference, rad", low=-10.0, high=10.0
    )
    amplitude: tuple[float, ...] = setting(
        (0.5, 0.4, 0.4, 0.4, 0.4, 0.4), "amplitude of the reference, rad", low=0.0, high=3.2
    )
    frequency: tuple[float, ...] = setting(
        (0.1, 0.125, 0.15, 0.175, 0.2, 0.225), "frequency of the reference, Hz", low=0.0, high=5.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count(self, ("center", "amplitude", "frequency"), JOINTS, "one a joint")

    @abstractmethod
    def effects(self, mechanism: Mechanism) -> Sequence[Effect]:
        """Effects of the plant besides rigid links, such as friction or a payload, for the `mechanism` that is driven,
        a sequence of `Effect` that an implementation must return. It may raise `InputError` for a mechanism that they
        do not suit."""

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Gymnasium tracking environment of the arm `mechanism` on one sinusoid a joint, with the plant's effects
        besides rigid links; a run ends early only at a joint error above `error_bound` (rad or m), so that all can be
        compared. Raises `InputError` for another number of joints than six."""
        import gymnasium

        if mechanism.dof != JOINTS:
            raise InputError(
                f"robot: {mechanism.name} has {mechanism.dof} joints, this experiment is for {JOINTS}; "
                "use the experiment 'adaptive'"
            )
        return gymnasium.make(
            "adaptctl.envs:adaptctl/Tracking-v0",
            robot=mechanism,
            reference=Sinusoids(np.array(self.center), np.array(self.amplitude), np.array(self.frequency)),
            duration=self.duration,
            control_period=self.control_period,
            initial_error=self.initial_error,
            error_bound=self.error_bound,
            torque_limits=self.torque_limits(mechanism),
            effects=tuple(self.effects(mechanism)),
        )

    def torque_limits(self, mechanism: Mechanism) -> Array:
        """Torque limits (r,) of the r primary (independently moving) joints of a `mechanism`, N m (N if prismatic): its
        own, or, where a joint has none, four times the most that it needs in 200 random states of up to 2 rad/s and 10
        rad/s^2 (m/s, m/s^2), 1 N m (N) at least."""
        return finite_torque_limits(mechanism)

    def reference_settings(self, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Iterator over one `Setting` (name, value and meaning) for the report, which states the reference's formula,
        sinusoids faded in over 2 s. `env`, the tracking environment, is not used. Nothing is checked."""
        yield Setting("reference", "p(t) = centre + fade(t) · amplitude · sin(2π · frequency · t)", "faded in over 2 s")

    def from_rough(self, model: ReducedModel, *, adapting: bool = True) -> SlotineLi:
        """Slotine and Li's control law, a `SlotineLi`, on a reduced `model` of k parameters, its initial estimate (k,)
        that of a rough model of the arm, every link's parameters off by the fraction `parameter_error`; with adaptation
        off if not `adapting` (True by default). Raises `GainError` for gains too large for the control period."""
        return self.slotine_li(model, self.adaptation(model) if adapting else None, self.first(model))
