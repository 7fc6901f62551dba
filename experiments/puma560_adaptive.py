"""The PUMA 560 end to end: from energies to an adaptive controller that starts knowing nothing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.control import Gains, PriorRanges, Sinusoids, adaptation_gain
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.learning import Learning
from adaptctl.identifiability import ReducedModel
from adaptctl.mechanism.pose import Array
from adaptctl.recording import Setting

if TYPE_CHECKING:
    import gymnasium

JOINTS = 6


@dataclass(frozen=True)
class Puma560Adaptive(Learning):
    """The contest of `Learning` on the PUMA 560: every joint swings by 0.4 rad or more at 0.1 Hz and above."""

    name: ClassVar[str] = "puma560-adaptive"
    title: ClassVar[str] = "PUMA 560: learning to track from knowing nothing"

    robot: str = setting("puma560", "puma560 (Sheu and Walker 1991), puma560_measured, or a file of six joints")
    damping: tuple[float, ...] = setting(
        (90.0, 150.0, 70.0, 20.0, 16.0, 18.0), "damping of each joint, N m s", symbol="K", low=1e-3, high=1e4
    )
    mass_range: float = setting(5.0, "prior range of masses, kg", low=1e-3, high=1e3)
    first_moment_range: float = setting(2.0, "prior range of first moments, kg m", low=1e-3, high=1e3)
    inertia_range: float = setting(0.6, "prior range of inertias, kg m^2", low=1e-3, high=1e3)
    center: tuple[float, ...] = setting(
        (0.0, -0.6, 0.8, 0.0, 0.5, 0.0), "centre of the reference, rad", low=-10.0, high=10.0
    )
    amplitude: tuple[float, ...] = setting(
        (0.5, 0.4, 0.4, 0.4, 0.4, 0.4), "amplitude of the reference, rad", low=0.0, high=3.2
    )
    frequency: tuple[float, ...] = setting(
        (0.1, 0.125, 0.15, 0.175, 0.2, 0.225), "frequency of the reference, Hz", low=0.0, high=5.0
    )
    start_time: float = setting(2.0, "length of the smooth (quintic) start, s", low=0.0, high=60.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("damping", "center", "amplitude", "frequency"):
            if (count := len(getattr(self, name))) != JOINTS:
                raise InputError(f"{name}: expected {JOINTS} numbers, one a joint, got {count}")

    @property
    def purpose(self) -> str:
        """What is asked."""
        return (
            "The PUMA 560 follows sinusoids in all six joints, and nobody tells the controller a single mass, centre "
            "of mass or inertia. First the parameters that its motion depends on are found, from energies alone. "
            "Then Slotine and Li's adaptive controller starts with estimates of zero and adapts only those. "
            "Every controller drives the same environment from the same seed, and starts "
            f"{self.initial_error:g} rad off in every joint."
        )

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """The PUMA's tracking environment on this experiment's reference."""
        import gymnasium

        if mechanism.dof != JOINTS:
            raise InputError(
                f"robot: {mechanism.name} has {mechanism.dof} joints, this experiment is for {JOINTS}; "
                "use the experiment 'adaptive'"
            )
        return gymnasium.make(
            "adaptctl.envs:adaptctl/Puma560Tracking-v0",
            robot=mechanism,
            reference=Sinusoids(
                np.array(self.center), np.array(self.amplitude), np.array(self.frequency), start_time=self.start_time
            ),
            duration=self.duration,
            control_period=self.control_period,
            initial_error=self.initial_error,
        )

    def gains(self, mechanism: Mechanism) -> Gains:
        """Lambda and K as set."""
        return Gains(np.full(JOINTS, self.bandwidth), np.array(self.damping))

    def adaptation(self, model: ReducedModel) -> Array:
        """Gamma from the prior ranges as set."""
        ranges = PriorRanges(self.mass_range, self.first_moment_range, self.inertia_range)
        return adaptation_gain(model, ranges, self.rate)

    def adaptation_setting(self, mechanism: Mechanism) -> str:
        """Gamma by kinds of parameters."""
        of = ((self.mass_range, "kg"), (self.first_moment_range, "kg·m"), (self.inertia_range, "kg·m²"))
        return "; ".join(f"{self.rate:g}·({value:g} {unit})²" for value, unit in of)

    def reference_settings(self, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """The settings say it all."""
        yield Setting(
            "reference",
            "p(t) = centre + fade(t) · amplitude · sin(2π · frequency · t)",
            f"fade is a quintic from rest over {self.start_time:g} s",
        )
