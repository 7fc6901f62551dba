"""Joints seen through encoders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Scalar
from adaptctl.simulation.effects.effect import SensorEffect, at_least_zero

_WHOLE = 1.5 * 2.0**52
"""Adding and subtracting it rounds a double below 2^51 to the nearest whole number, ties to even."""


@dataclass(frozen=True, eq=False)
class Encoder(SensorEffect):
    """Encoders: positions in whole counts of `resolution` (rad or m), after Gaussian noise of standard deviation
    `noise` (rad or m).

    Velocities get Gaussian noise of standard deviation `velocity_noise` (rad/s or m/s), as of a tachometer; use
    `FilteredDifferences` where they come from the positions. Each is one number or (r,), zero for none. An encoder of n
    counts a turn behind a gear of ratio g has a resolution of 2 pi/(n g) rad at the joint. `rank` 0: encoders come
    before other sensor effects. A `Plant` raises `InputError` for settings that are negative, not finite or do not fit
    its r joints.
    """

    resolution: ArrayLike = 0.0
    noise: ArrayLike = 0.0
    velocity_noise: ArrayLike = 0.0

    rank: ClassVar[int] = 0

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless each of `resolution`, `noise` and `velocity_noise` is a finite number of at least
        0, or one for each of `dof` (r) joints; links and control period (s) may be any."""
        for name in ("resolution", "noise", "velocity_noise"):
            if not np.isfinite(at_least_zero(getattr(self, name), dof, f"encoder: {name}")).all():
                raise InputError(f"encoder: {name}: expected finite numbers, got {getattr(self, name)}")

    def start(self, p: Array, v: Array, control_period: float) -> Array:
        """An empty memory (0,), one for all arms, at any positions p (..., r), velocities v (..., r) and control period
        (s)."""
        return np.zeros(0)

    def measure(
        self, p: Column, v: Column, noise: Column, memory: Column, control_period: float
    ) -> tuple[Column, Column, Column]:
        """Positions (r,), rad or m, in whole counts, noisy velocities (r,), rad/s or m/s, and the memory (0,)
        unchanged, of true p and v (r,) and standard normal `noise` (2r,), the positions' first, whatever the control
        period (s). Raises `InputError` for settings that do not fit r joints."""
        dof = len(p)
        jitter, steps, shake = (
            at_least_zero(values, dof, "encoder").tolist()
            for values in (self.noise, self.resolution, self.velocity_noise)
        )
        shaken = p + Column(jitter) * Column(noise.of[:dof])
        read = Column(x if step == 0.0 else step * _rounded(x / step) for x, step in zip(shaken, steps, strict=True))
        return read, v + Column(shake) * Column(noise.of[dof:]), memory


def _rounded(x: Scalar) -> Scalar:
    return (x + _WHOLE) - _WHOLE
