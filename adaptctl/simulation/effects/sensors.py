"""Sensor effects."""

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
"""adding and subtracting it rounds to the nearest integer"""

MIN_RESOLUTION = 1e-12
"""rad (m), so that counts are exact integers"""


@dataclass(frozen=True, eq=False)
class Encoder(SensorEffect):
    """
    Joint encoders with noise and quantization.

    Parameters
    ----------
    resolution : array_like, default 0.0
        Size of a count in rad (m if prismatic), one number or (r,): 2 pi/(n g) for n counts per turn of a motor with
        gear ratio g; 0 for no rounding, else at least 1e-12.
    noise : array_like, default 0.0
        Standard deviation of Gaussian noise before the rounding in rad (m), one number or (r,). Zero for none, an
        encoder that only rounds.
    velocity_noise : array_like, default 0.0
        Standard deviation of Gaussian noise of a tachometer in rad/s (m/s), one number or (r,). Zero for none; use
        `FilteredDifferences` for velocities made of positions.

    Notes
    -----
    `Plant` checks the settings. First of the sensor effects.

    Examples
    --------
    >>> from adaptctl.simulation.effects import Encoder
    >>> measured = adaptctl.Plant(arm, period, effects=[Encoder(resolution=0.25)])
    >>> measured.init([0.3, 0.6], [0.0, 0.0]).measured_p.tolist()
    [0.25, 0.5]
    """

    resolution: ArrayLike = 0.0
    noise: ArrayLike = 0.0
    velocity_noise: ArrayLike = 0.0

    rank: ClassVar[int] = 0

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Check the settings against a plant."""
        for name in ("resolution", "noise", "velocity_noise"):
            if not np.isfinite(at_least_zero(getattr(self, name), dof, f"encoder: {name}")).all():
                raise InputError(f"encoder: {name}: expected finite numbers, got {getattr(self, name)}")
        steps = np.asarray(self.resolution)
        if np.any((steps > 0.0) & (steps < MIN_RESOLUTION)):
            raise InputError(f"encoder: resolution: expected 0 or at least {MIN_RESOLUTION:g}, got {steps.tolist()}")

    def initial_state(self, p: Array, v: Array, control_period: float) -> Array:
        """Initial internal state."""
        return np.zeros(0)

    def measure(
        self, p: Column, v: Column, noise: Column, memory: Column, control_period: float
    ) -> tuple[Column, Column, Column]:
        """Measurements and the internal state."""
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
    r"""
    Velocities from measured positions by backward differences and a low-pass filter.

    Parameters
    ----------
    cutoff : float
        Cutoff frequency f in Hz, below half the sampling rate.

    Raises
    ------
    InputError
        If the cutoff is not positive and finite or, in a `Plant`, at least half the sampling rate.

    Notes
    -----
    .. math:: w_k = a\,w_{k-1} + (1 - a)(p_k - p_{k-1})/T_c, \quad a = e^{-2 \pi f T_c}

    [1]_, delayed by about T_c/2 + 1/(2 pi f); a count of c changes it by (1 - a) c/T_c. Acts after encoders.

    References
    ----------
    .. [1] K. J. Åström, T. Hägglund, Advanced PID Control, 2006, section 3.3.

    Examples
    --------
    >>> from adaptctl.simulation.effects import FilteredDifferences
    >>> filtered = adaptctl.Plant(arm, period, effects=[FilteredDifferences(50.0)])
    >>> bool(np.allclose(filtered.init(p, v).measured_v, v))
    True
    """

    cutoff: float

    rank: ClassVar[int] = 1

    def __post_init__(self) -> None:
        validate_positive(self.cutoff, "filtered differences: cutoff", "Hz")

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Check the settings against a plant."""
        if self.cutoff >= 0.5 / control_period:
            raise InputError(
                f"filtered differences: a cutoff of {self.cutoff:g} Hz is not below half the sampling rate, "
                f"{0.5 / control_period:g} Hz"
            )

    def initial_state(self, p: Array, v: Array, control_period: float) -> Array:
        """Initial internal state."""
        return np.concatenate((p - control_period * v, v), axis=-1)

    def measure(
        self, p: Column, v: Column, noise: Column, memory: Column, control_period: float
    ) -> tuple[Column, Column, Column]:
        """Measurements and the internal state."""
        dof, kept = len(p), math.exp(-2.0 * math.pi * self.cutoff * control_period)
        before, rate = Column(memory.of[:dof]), Column(memory.of[dof:])
        after = kept * rate + ((1.0 - kept) / control_period) * (p - before)
        return p, after, Column((*p, *after))
