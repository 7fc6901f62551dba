"""Adaptive control of the semi-direct-drive arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from adaptctl.experiments.experiment import setting
from adaptctl.experiments.puma560_adaptive import DAMPING, Puma560Adaptive


@dataclass(frozen=True)
class SemiDirectDriveAdaptive(Puma560Adaptive):
    """Experiment `Puma560Adaptive` on a five-bar linkage."""

    name: ClassVar[str] = "semi-direct-drive-adaptive"
    title: ClassVar[str] = "Semi-direct-drive arm: adaptive tracking with a closed loop"
    joints: ClassVar[int] = 3
    environment_id: ClassVar[str] = "SemiDirectDriveTracking"
    asks: ClassVar[str] = "Two motors on a rotating pillar drive a five-bar linkage, a closed loop."

    robot: str = setting("semi_direct_drive", "semi_direct_drive, semi_direct_drive_parallelogram, or a robot file")
    damping: tuple[float, ...] = setting((60.0, 60.0, 60.0), DAMPING, symbol="K", low=1e-3, high=1e4)
    mass_range: float = setting(10.0, "prior range of masses, kg", low=1e-3, high=1e3)
    first_moment_range: float = setting(4.0, "prior range of first moments, kg m", low=1e-3, high=1e3)
    inertia_range: float = setting(1.0, "prior range of inertias, kg m^2", low=1e-3, high=1e3)
    center: tuple[float, ...] = setting((0.0, -1.5708, -3.1416), "centre of the sinusoids, rad", low=-10.0, high=10.0)
    amplitude: tuple[float, ...] = setting((0.6, 0.4, 0.4), "amplitude of the sinusoids, rad", low=0.0, high=3.2)
    frequency: tuple[float, ...] = setting((0.15, 0.2, 0.25), "frequency of the sinusoids, Hz", low=0.0, high=5.0)
