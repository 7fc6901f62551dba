"""Stability margins of a sampled loop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from adaptctl.arrays import Array
from adaptctl.errors import InputError

if TYPE_CHECKING:
    import control

POINTS = 1000
LOWEST = 1e-6
"""The lowest frequency looked at, over half the sampling rate."""


@dataclass(frozen=True)
class Margins:
    """Gain, phase and delay margins of one sampled loop, stable when closed. Nothing is checked.

    `gain` is the factor, without a unit, by which the loop's gain may grow (its inertia fall), infinite if it may grow
    without limit; `gain_reduction` is the factor, without a unit, to which it may fall (its inertia grow), 0 if it may
    fall without limit. `phase` is the lag in rad and `delay` the delay in s that the loop bears, the least over all
    frequencies where its gain crosses 1, infinite where it does so nowhere; `crossover` is the frequency in rad/s at
    which a delay makes it unstable first, NaN where there is none.
    """

    gain: float
    """factor by which the loop's gain may grow (its inertia fall), infinite where without limit"""
    gain_reduction: float
    """factor to which the loop's gain may fall (its inertia grow), 0 where any is stable"""
    phase: float
    """rad of lag at the crossover"""
    delay: float
    """s of delay that it bears"""
    crossover: float
    """rad/s, where a delay makes it unstable first"""


def margins(loop: control.LTI) -> Margins:
    """The gain, phase and delay margins of a `loop`, a `Margins`: gains as factors without a unit (not dB), the phase
    in rad, the delay in s. `loop` is a discrete-time python-control system with one input, one output and its sampling
    time in s. It is open, to be closed by negative feedback, and must then be stable, which is not checked. Raises
    `InputError` for a loop in continuous time or without a stated sampling time, and for one with more inputs or
    outputs.

    Of several crossings the tightest counts: `gain` is the least factor above 1, and `gain_reduction` the largest of at
    most 1, that brings a crossing of the negative real axis to -1; `phase` is the least lag, and `delay` the least lag
    over frequency, which is at the frequency `crossover` (rad/s), of the crossings of gain 1. Without such a crossing
    `gain`, `phase` and `delay` are infinite, `gain_reduction` 0 and `crossover` NaN. Crossings are sought on
    python-control's frequency response from 1e-6 of half the sampling rate up to half the sampling rate, included,
    where a sampled loop often crosses; `control.stability_margins` of version 0.10 looks only below it.
    """
    _require_sampled(loop)
    angles = np.concatenate((np.geomspace(LOWEST * np.pi, np.pi, POINTS)[:-1], [np.pi]))
    values = np.asarray(loop(np.exp(1j * angles)), dtype=np.complex128)

    def response(angle: float) -> complex:
        return complex(loop(np.exp(1j * angle)))

    real = _crossings(lambda angle: response(angle).imag, angles[:-1], values.imag[:-1])
    turned = [value for value in (*map(response, real), values[-1]) if value.real < 0.0]
    factors = [float(1.0 / abs(value)) for value in turned]
    unit = _crossings(lambda angle: abs(response(angle)) - 1.0, angles, np.abs(values) - 1.0)
    lags = [(_lag(response(angle)), angle) for angle in unit]
    phase = min((lag for lag, _ in lags), default=math.inf)
    delay, crossover = min(((lag / angle, angle) for lag, angle in lags), default=(math.inf, math.nan))
    return Margins(
        gain=min((factor for factor in factors if factor > 1.0), default=math.inf),
        gain_reduction=max((factor for factor in factors if factor <= 1.0), default=0.0),
        phase=phase,
        delay=delay * loop.dt,
        crossover=crossover / loop.dt,
    )


def _require_sampled(loop: control.LTI) -> None:
    if not loop.ninputs == loop.noutputs == 1:
        raise InputError(f"margins: expected one input and one output, got {loop.ninputs} and {loop.noutputs}")
    if loop.dt is None or loop.dt is True or not loop.dt > 0.0:  # python-control's True is a period that is not stated
        raise InputError(f"margins: expected a sampled loop with its sampling time in s, got dt = {loop.dt}")


def _lag(value: complex) -> float:
    """Lag (rad) that turns a value on the unit circle to -1, in (0, 2 pi]."""
    lag = math.pi + math.atan2(value.imag, value.real)
    return lag if lag > 0.0 else lag + 2.0 * math.pi


def _crossings(function: Callable[[float], float], angles: Array, values: Array) -> list[float]:
    """Angles at which a function, known at some, changes its sign."""
    places = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    return [float(brentq(function, angles[k], angles[k + 1], xtol=1e-15, rtol=1e-14)) for k in places]
