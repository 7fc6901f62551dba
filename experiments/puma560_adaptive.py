"""The PUMA 560 end to end: from energies to an adaptive controller that starts knowing nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from adaptctl.experiments.experiment import setting
from adaptctl.experiments.stated_task import StatedTask


@dataclass(frozen=True)
class Puma560Adaptive(StatedTask):
    """Experiment of learning to track on the PUMA 560 from zero initial estimates of its inertial parameters, on one
    sinusoid a joint: by default each of the six joints swings by 0.4 rad or more at 0.1 Hz or more. Raises `InputError`
    at construction for settings of the wrong type, out of their bounds, or not one a joint, `NonFiniteError` for NaN or
    infinity."""

    name: ClassVar[str] = "puma560-adaptive"
    title: ClassVar[str] = "PUMA 560: learning to track from knowing nothing"
    joints: ClassVar[int] = 6
    environment_id: ClassVar[str] = "adaptctl/Puma560Tracking-v0"

    robot: str = setting("puma560", "puma560 (Sheu and Walker 1991), or another arm of six joints")
    damping: tuple[float, ...] = setting(
        (90.0, 150.0, 70.0, 20.0, 16.0, 18.0), "damping of each joint, N m s", symbol="K", low=1e-3, high=1e4
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

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: whether an adaptive controller learns
        to track on the PUMA 560 from zero initial estimates of its inertial parameters."""
        return (
            "The PUMA 560 follows sinusoids in all six joints, and nobody tells the controller a single mass, centre "
            "of mass or inertia. First the parameters that its motion depends on are found, from energies alone. "
            "Then Slotine and Li's adaptive controller starts with estimates of zero and adapts only those. "
            "Every controller drives the same environment from the same seed, and starts "
            f"{self.initial_error:g} rad off in every joint."
        )
