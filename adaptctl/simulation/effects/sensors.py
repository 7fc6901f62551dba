"""Joints seen through encoders."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Scalar
from adaptctl.simulation.effects.effect import SensorEffect, at_least_zero, validate_positive

_WHOLE = 1.5 * 2.0**52
"""Adding and subtracting it rounds a double below 2^51 to the nearest whole number, ties to even."""

FINEST = 1e-12
"""rad (m): counts of a finer resolution are not whole numbers any more in double precision"""


@dataclass(frozen=True, eq=False)
class Encoder(SensorEffect):
    """Joint encoders: they measure positions in whole counts of `resolution` (rad or m), the nearest, after adding
    Gaussian noise of standard deviation `noise` (rad or m).

    Velocities get Gaussian noise of standard deviation `velocity_noise` (rad/s or m/s), as of a tachometer; use
    `FilteredDifferences` where they come from the positions. Each setting is one number or one a joint (r,), 0 by
    default: no rounding and no noise. An encoder of n counts a turn behind a gear of ratio g has a resolution of 2
    pi/(n g) rad at the joint. `rank` is 0, the effect's position in the order from the joints to the controller: before
    other sensor effects. The class itself checks nothing; a `Plant` raises `InputError` for settings that are negative,
    not finite or do not fit its r joints, and for a resolution below 1e-12 rad (m if prismatic), unless 0.
    """

    resolution: ArrayLike = 0.0
    noise: ArrayLike = 0.0
    velocity_noise: ArrayLike = 0.0

    rank: ClassVar[int] = 0

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless each of `resolution`, `noise` and `velocity_noise` is one finite number of at least
        0 or one for each of `dof` (r) joints, and each resolution is 0 or at least 1e-12 rad (m if prismatic). The
        names `links` and `control_period` (s) are not used."""
        for name in ("resolution", "noise", "velocity_noise"):
            if not np.isfinite(at_least_zero(getattr(self, name), dof, f"encoder: {name}")).all():
                raise InputError(f"encoder: {name}: expected finite numbers, got {getattr(self, name)}")
        steps = np.asarray(self.resolution)
        if np.any((steps > 0.0) & (steps < FINEST)):
            raise InputError(f"encoder: resolution: expected 0 or at least {FINEST:g}, got {steps.tolist()}")

    def initial_state(self, p: Array, v: Array, control_period: float) -> Array:
        """An empty internal state (0,), one for all arms: encoders keep nothing from one measurement to the next.
        Positions `p` and velocities `v` (..., r) of the r joints and `control_period` (s) are not used. Nothing is
        raised."""
        return np.zeros(0)

    def measure(
        self, p: Column, v: Column, noise: Column, memory: Column, control_period: float
    ) -> tuple[Column, Column, Column]:
        """The measured positions (r,) and velocities (r,) of r joints, and the `memory` (0,) as it was. Positions, rad
        (m if prismatic), have noise and are rounded to whole counts of the encoder's `resolution` (not where that is
        0); velocities, rad/s (m/s), have noise.

        `p` and `v` (r,), in the same units, are the true positions and velocities, and `noise` (2r,) holds standard
        normal numbers (unitless), the positions' first; `control_period` (s) is not used. Vectors are Columns of
        scalars of any kind: floats, arrays, or symbols to be compiled. Raises `InputError` for settings that are
        negative, NaN or do not fit r joints, `ValueError` for columns of other lengths.
        """
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
        validate_positive(self.cutoff, "filtered differences: cutoff", "Hz")

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless the cutoff (Hz) is below half the sampling rate, 0.5/`control_period` (s), which is
        taken to be positive. The number of joints `dof` and the names `links` are not used."""
        if self.cutoff >= 0.5 / control_period:
            raise InputError(
                f"filtered differences: a cutoff of {self.cutoff:g} Hz is not below half the sampling rate, "
                f"{0.5 / control_period:g} Hz"
            )

    def initial_state(self, p: Array, v: Array, control_period: float) -> Array:
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
