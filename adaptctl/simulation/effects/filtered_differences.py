"""Velocity estimates from filtered position differences."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation.effects.effect import SensorEffect, require_positive


@dataclass(frozen=True)
class FilteredDifferences(SensorEffect):
    """Sensor effect that estimates velocities from measured positions: backward differences through a first-order
    low-pass filter.

        w_k = a w_(k-1) + (1 - a) (p_k - p_(k-1))/T_c,   a = exp(-2 pi cutoff T_c)

    w (r,) is the estimate for r joints in rad/s (m/s of a prismatic joint), p (r,) the measured position in rad (m), k
    counts control periods, T_c is their length in s, and `cutoff` is in Hz, one number for all joints. Before the first
    measurement w is the true velocity v, and p is taken to have been p - T_c v. This is the derivative that controllers
    use in practice (Astrom and Hagglund, Advanced PID Control, 2006, section 3.3); it is late by about T_c/2 + 1/(2 pi
    cutoff) s. An encoder's count of c rad (m) makes it jump by (1 - a) c/T_c. `rank` is 1, the effect's position in the
    order from the joints to the controller: after encoders. Raises `InputError` for a cutoff that is not positive and
    finite, and in a `Plant` for one of at least half the sampling rate, 0.5/T_c.
    """

    cutoff: float

    rank: ClassVar[int] = 1

    def __post_init__(self) -> None:
        require_positive(self.cutoff, "filtered differences: cutoff", "Hz")

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless the cutoff (Hz) is below half the sampling rate, 0.5/`control_period` (s), which is
        taken to be positive. The number of joints `dof` and the names `links` are not used."""
        if self.cutoff >= 0.5 / control_period:
            raise InputError(
                f"filtered differences: a cutoff of {self.cutoff:g} Hz is not below half the sampling rate, "
                f"{0.5 / control_period:g} Hz"
            )

    def start(self, p: Array, v: Array, control_period: float) -> Array:
        """The filter's initial internal state (..., 2r) for arms of r joints at positions p (..., r), rad (m if
        prismatic), with velocities v (..., r), rad/s (m/s). It has the positions (..., r) one `control_period` (s)
        earlier, p - control_period v, then the velocity estimate (..., r), which is v. Shapes are not checked."""
        return np.concatenate((p - control_period * v, v), axis=-1)

    def measure(
        self, p: Column, v: Column, noise: Column, memory: Column, control_period: float
    ) -> tuple[Column, Column, Column]:
        """The positions p (r,) of r joints, unchanged, the velocities (r,) estimated from them, and the filter's
        internal state (2r,) after them: p, then the estimate. Positions are in rad (m if prismatic), velocities in
        rad/s (m/s).

        `memory` (2r,), p and the estimate, is the internal state of the period before, `control_period` is in s; the
        velocities v (r,) and `noise` (2r,) are not used. Vectors are Columns of scalars of any kind: floats, arrays, or
        symbols to be compiled. Raises `ValueError` for an internal state of another length.
        """
        dof, kept = len(p), math.exp(-2.0 * math.pi * self.cutoff * control_period)
        before, rate = Column(memory.of[:dof]), Column(memory.of[dof:])
        after = kept * rate + ((1.0 - kept) / control_period) * (p - before)
        return p, after, Column((*p, *after))
