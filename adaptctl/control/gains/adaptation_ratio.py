"""Adaptation ratio of a sampled loop."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array

ANGLES = 1000  # of a frequency, at which the limit is interpolated


def adaptation_ratio(regressor: Array, damping: Array, gain: Array, control_period: float) -> float:
    """Greatest T lambda_max(K^-1 Y Gamma Y') of regressors (S, r, k), with a diagonal gain (k,)."""
    scaled = regressor * np.sqrt(gain) / np.sqrt(damping)[:, None]
    return control_period * float(np.linalg.eigvalsh(scaled @ np.swapaxes(scaled, -1, -2))[:, -1].max())


def stable_adaptation_below(held: float, delay: int) -> float:
    """
    Adaptation ratio below which the backward rule is stable with torques so many periods late.

    Without a delay that is 2 - h, for every regressor. With one, one joint with a constant regressor and sampling ratio
    h is on the limit where (z - 1)^2 z^d + h (z - 1) + a h z = 0 has a root on the unit circle.
    """
    if not delay:
        return 2.0 - held
    half = np.linspace(0.0, np.pi / (4 * delay + 2), ANGLES)[1:]
    ratios = 2.0 * np.tan(half) * np.sin(2 * delay * half)
    return float(np.interp(held, ratios, 2.0 * np.sin(half) ** 2 * (2.0 * np.cos(2 * delay * half) / ratios - 1.0)))
