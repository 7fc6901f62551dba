"""The semi-direct-drive arm end to end: the same method where links form a closed loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from adaptctl.experiments.experiment import setting
from adaptctl.experiments.stated_task import StatedTask


@dataclass(frozen=True)
class SemiDirectDriveAdaptive(StatedTask):
    """Experiment of learning to track on the semi-direct-drive arm, a five-bar linkage (closed loop) behind a vertical
    joint, from zero initial estimates of its inertial parameters: by default each of its three driven joints swings by
    0.4 rad or more at 0.15 Hz or more. Raises `InputError` at construction for settings of the wrong type, out of their
    bounds, or not one a joint, `NonFiniteError` for NaN or infinity."""

    name: ClassVar[str] = "semi-direct-drive-adaptive"
    title: ClassVar[str] = "Semi-direct-drive arm: learning to track through a closed loop"
    joints: ClassVar[int] = 3
    environment_id: ClassVar[str] = "adaptctl/SemiDirectDriveTracking-v0"

    robot: str = setting("semi_direct_drive", "semi_direct_drive, semi_direct_drive_parallelogram, or a file of yours")
    damping: tuple[float, ...] = setting(
        (60.0, 60.0, 60.0), "damping of each joint, N m s", symbol="K", low=1e-3, high=1e4
    )
    mass_range: float = setting(10.0, "prior range of masses, kg", low=1e-3, high=1e3)
    first_moment_range: float = setting(4.0, "prior range of first moments, kg m", low=1e-3, high=1e3)
    inertia_range: float = setting(1.0, "prior range of inertias, kg m^2", low=1e-3, high=1e3)
    center: tuple[float, ...] = setting((0.0, -1.5708, -3.1416), "centre of the reference, rad", low=-10.0, high=10.0)
    amplitude: tuple[float, ...] = setting((0.6, 0.4, 0.4), "amplitude of the reference, rad", low=0.0, high=3.2)
    frequency: tuple[float, ...] = setting((0.15, 0.2, 0.25), "frequency of the reference, Hz", low=0.0, high=5.0)

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: whether an adaptive controller learns
        to track on an arm with a closed loop from zero initial estimates of its inertial parameters."""
        return (
            "Two motors on a turning pillar move a five-bar linkage, whose forearm follows through a closed loop. "
            "Nobody tells the controller a single mass, centre of mass or inertia. The parameters that the motion "
            "depends on are found from energies alone, loop included; then Slotine and Li's adaptive controller "
            "starts with estimates of zero and adapts only those, in the coordinates of the three driven joints. "
            f"Every controller drives the same environment and starts {self.initial_error:g} rad off in every joint."
        )
